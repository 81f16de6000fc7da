//! Clients of one server on virtual time, who come, ask, talk nonsense, part and vanish in any order: one writes at most and
//! whoever may come is let in, requests are answered once and in their order, what was acknowledged is what the board got, and
//! counts tell the truth.

#![no_main]

#[path = "support/board.rs"]
mod board;
#[path = "support/frames.rs"]
mod frames;

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use ecmsk::engine::Firmware;
use ecmsk::link::engine::{EngineLink, RunOptions};
use ecmsk::link::{Layer, Link, LinkError, ReadMeta, Stamp, Wait};
use ecmsk::port::tcp::in_memory::{ClientMessage, InMemoryClient, InMemoryServer, ServerMessage};
use ecmsk::port::tcp::{OnVanish, ServeOptions};
use ecmsk::sk::{Frame, SlotSize};
use libfuzzer_sys::fuzz_target;

/// Bytes of a step.
const STEP: usize = 16;
/// Steps and ends of writers of an input at most: the server may take 2 s of a model's time for each end.
const STEPS_MAX: usize = 400;
const ENDS_MAX: u32 = 12;
/// Reports that a server keeps for a client.
const KEPT: u64 = 32;

fuzz_target!(|bytes: &[u8]| {
    let Some((&kind, bytes)) = bytes.split_first() else { return };
    let size = if kind & 1 == 0 { SlotSize::Bytes12 } else { SlotSize::Bytes16 };
    let (board, _) = board::board(size, Firmware::V17);
    let run = RunOptions { queue: [1, 4, 32, 8][usize::from(kind >> 1 & 3)], ..RunOptions::default() };
    let inner = EngineLink::open("sim:", board, run, None).expect("it talks");
    let link = Arc::new(Counted { inner, written: AtomicU64::new(0), read: AtomicU64::new(0) });
    let on_vanish = [OnVanish::Ramp, OnVanish::Ramp, OnVanish::ServoOff, OnVanish::Leave][usize::from(kind >> 3 & 3)];
    let options = ServeOptions {
        max_clients: 1 + usize::from(kind >> 5),
        on_vanish,
        tell: Arc::new(|line| panic!("nobody takes what a server tells people: {line}")),
        ..ServeOptions::default()
    };
    let max_clients = options.max_clients;
    let server = InMemoryServer::new(Arc::clone(&link) as Arc<dyn Link>, options);
    let mut hub =
        Hub { server: &server, link, size, max_clients, clients: Vec::new(), now: Stamp(0), is_lost: false, ends: 0 };
    let mut frame = Frame::new();
    for step in bytes.chunks_exact(STEP).take(STEPS_MAX) {
        hub.step(step, &mut frame);
    }
    while !hub.clients.is_empty() {
        hub.end(0, false);
    }
    hub.join(true);
});

/// The board, and the calls that it has done.
struct Counted {
    inner: EngineLink,
    written: AtomicU64,
    read: AtomicU64,
}

/// A client, and what it may expect.
struct Client<'a> {
    caller: InMemoryClient<'a>,
    is_writer: bool,
    /// What it has said so far, with the number of the last.
    said: u64,
    /// Requests without an answer.
    asked: VecDeque<u64>,
    /// The server does not keep it.
    is_over: bool,
    /// What the link had counted when it came.
    written: u64,
    read: u64,
    dropped: u64,
}

struct Hub<'a> {
    server: &'a InMemoryServer,
    link: Arc<Counted>,
    size: SlotSize,
    max_clients: usize,
    clients: Vec<Client<'a>>,
    /// The board's time, as somebody was told.
    now: Stamp,
    is_lost: bool,
    ends: u32,
}

impl Hub<'_> {
    fn step(&mut self, step: &[u8], frame: &mut Frame) {
        let [what, who, a, b, ..] = *step else { return };
        let count = self.clients.len();
        match what % 12 {
            0 => self.join(true),
            1 => self.join(false),
            2 => *frame = board::set_up(self.size, b)[usize::from(a) % 3].clone(),
            3 if a & 0x80 != 0 => *frame = Frame::new(),
            3 => frame.put(self.size, usize::from(a) % self.size.slots(), &frames::slot(&step[4..])),
            _ if count == 0 => {}
            4 | 5 => (0..=a % 64).for_each(|_| self.say(who, ClientMessage::Write(frame))),
            6 => (0..=a % 64).for_each(|_| self.say(who, ClientMessage::Read)),
            7 => self.say(who, ClientMessage::Pass(Duration::from_micros(u64::from(a) * 500))),
            // As long as it takes: it is only begun.
            8 => self.begin(who, ClientMessage::Pass(Duration::from_nanos(1 << (a % 64)))),
            9 => match a % 4 {
                0 => self.say(who, ClientMessage::Cancel),
                1 => self.say(who, ClientMessage::Ping),
                _ => self.say(who, ClientMessage::Count),
            },
            10 => match a % 3 {
                0 => self.hear(who, &step[4..]),
                // A whole message of any kind.
                1 => self.hear(who, &[&[8, 0, b, 0], &step[4..12]].concat()),
                _ => self.work(who),
            },
            _ => {
                let who = usize::from(who) % count;
                if self.may_end(who) {
                    self.end(who, a & 1 == 0);
                }
            }
        }
    }

    fn may_end(&self, who: usize) -> bool {
        !self.clients[who].is_writer || self.ends < ENDS_MAX
    }

    fn writer(&self) -> Option<&Client<'_>> {
        let mut writers = self.clients.iter().filter(|client| client.is_writer);
        let writer = writers.next();
        assert!(writers.next().is_none(), "two write");
        writer
    }

    fn join(&mut self, is_writer: bool) {
        let kept = usize::from(!is_writer && self.writer().is_none() && self.max_clients > 1);
        let has_room = self.clients.len() + kept < self.max_clients;
        let may_come = !self.is_lost && has_room && (!is_writer || self.writer().is_none());
        let caller = self.server.join(is_writer);
        assert_eq!(caller.is_some(), may_come, "writer: {is_writer}, {} clients", self.clients.len());
        if let Some(caller) = caller {
            let stats = self.link.inner.stats();
            self.clients.push(Client {
                caller,
                is_writer,
                said: 0,
                asked: VecDeque::new(),
                is_over: false,
                written: stats.written,
                read: self.link.read.load(Ordering::Relaxed),
                dropped: stats.reports_dropped,
            });
        }
    }

    /// Has a client say something, and the server do it.
    fn say(&mut self, who: u8, what: ClientMessage<'_>) {
        self.begin(who, what);
        let who = usize::from(who) % self.clients.len();
        let client = &mut self.clients[who];
        // It may ask for more time than there is.
        for _ in 0..20 {
            if client.is_over || !client.caller.work() {
                break;
            }
        }
        self.look();
    }

    fn begin(&mut self, who: u8, what: ClientMessage<'_>) {
        let who = usize::from(who) % self.clients.len();
        let client = &mut self.clients[who];
        if client.is_over {
            return;
        }
        client.said += 1;
        let is_asked = match what {
            ClientMessage::Write(_) | ClientMessage::Read | ClientMessage::Pass(_) => {
                client.is_writer && client.asked.is_empty()
            }
            ClientMessage::Count => client.asked.is_empty(),
            _ => false,
        };
        let is_write = matches!(what, ClientMessage::Write(_));
        let may_say = is_asked || matches!(what, ClientMessage::Cancel | ClientMessage::Ping);
        if is_asked {
            client.asked.push_back(client.said);
        }
        let written = self.link.written();
        let keeps = client.caller.begin(what, usize::MAX);
        assert!(keeps || !may_say || self.link.inner.check().is_err(), "{what:?} is no reason to part");
        assert!(!keeps || may_say, "{what:?} out of turn");
        client.is_over = !keeps;
        assert!(is_write || self.link.written() == written, "nobody has written");
        self.look();
    }

    fn hear(&mut self, who: u8, bytes: &[u8]) {
        let who = usize::from(who) % self.clients.len();
        if self.clients[who].is_over || !self.may_end(who) {
            return;
        }
        let client = &mut self.clients[who];
        // Whatever it means, the board gets no frame of it: none is that short.
        let written = self.link.written();
        client.is_over = !client.caller.hear(bytes);
        assert_eq!(self.link.written(), written, "a frame of {} bytes", bytes.len());
        // What it has asked for nobody knows.
        self.look_at(who, true);
        self.end(who, false);
    }

    fn work(&mut self, who: u8) {
        let who = usize::from(who) % self.clients.len();
        let client = &mut self.clients[who];
        if !client.is_over {
            client.caller.work();
        }
        self.look();
    }

    /// What the server has sent meanwhile.
    fn look(&mut self) {
        (0..self.clients.len()).for_each(|who| self.look_at(who, false));
    }

    fn look_at(&mut self, who: usize, any: bool) {
        let link = Arc::clone(&self.link);
        let client = &mut self.clients[who];
        for message in client.caller.take_messages().expect("what a server says can be read") {
            let (request, now) = match message {
                ServerMessage::Done { request, now } | ServerMessage::Failed { request, now } => (request, now),
                ServerMessage::Counted { request, reports_dropped, board } => {
                    let stats = link.inner.stats();
                    let read = link.read.load(Ordering::Relaxed) - client.read;
                    let kept = if client.is_writer { 0 } else { read.saturating_sub(KEPT) };
                    assert_eq!(reports_dropped, stats.reports_dropped - client.dropped + kept);
                    let board = board.expect("a model counts");
                    assert_eq!(board.frames + board.while_booting, stats.written - client.written);
                    (request, None)
                }
                ServerMessage::Bye => {
                    (self.is_lost, client.is_over) = (true, true);
                    assert!(link.inner.check().is_err(), "a good-bye, and the board is there");
                    continue;
                }
                ServerMessage::Other | ServerMessage::Stopped { .. } => continue,
            };
            if !any {
                let asked = client.asked.pop_front();
                assert_eq!(asked, Some(request), "answered, and not asked");
            }
            if let Some(now) = now {
                assert!(now >= self.now, "time goes back from {:?} to {now:?}", self.now);
                self.now = now;
            }
        }
    }

    /// A client parts, or vanishes.
    fn end(&mut self, who: usize, says_bye: bool) {
        let mut client = self.clients.remove(who);
        let says_bye = says_bye && !client.is_over;
        let written = self.link.written();
        if says_bye {
            client.said += 1;
            assert!(!client.caller.begin(ClientMessage::Bye, usize::MAX), "it has said good-bye");
        }
        client.caller.end(says_bye);
        self.ends += u32::from(client.is_writer);
        if says_bye || !client.is_writer {
            assert_eq!(self.link.written(), written, "nothing is sent after a good-bye, or for a reader");
        }
        drop(self.server.told());
    }
}

impl Counted {
    fn written(&self) -> u64 {
        self.written.load(Ordering::Relaxed)
    }
}

impl Layer for Counted {
    fn inner(&self) -> &dyn Link {
        &self.inner
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        let done = self.inner.write(frame, wait);
        self.written.fetch_add(done.is_ok().into(), Ordering::Relaxed);
        done
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        let done = self.inner.read(out, wait);
        self.read.fetch_add(done.is_ok().into(), Ordering::Relaxed);
        done
    }
}

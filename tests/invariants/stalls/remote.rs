//! The link of a program to a served board, in virtual time: the server is one without sockets, in a thread of its own,
//! which works while a call of the program waits for it.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use ecmsk::link::{Dir, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Stamp, Wait};
use ecmsk::port::tcp::ServeOptions;
use ecmsk::port::tcp::in_memory::{ClientMessage, InMemoryClient, InMemoryServer, ServerMessage};
use ecmsk::sk::Frame;

use super::link::Stalling;

/// What the program asks of the server.
enum Ask {
    Write(Box<Frame>),
    Read(Wait),
    Pass(Duration),
    End { says_bye: bool },
}

/// The link.
pub struct Remote {
    /// The board's time after a request; `None`: it has failed.
    line: Mutex<(Sender<Ask>, Receiver<Option<Stamp>>)>,
    /// The server's link to its board.
    board: Arc<Stalling>,
    is_over: AtomicBool,
}

impl Remote {
    /// A server for that link, and its writer.
    pub fn new(board: Arc<Stalling>) -> Self {
        let ((ask, asked), (tell, told)) = (channel(), channel());
        let link = Arc::clone(&board) as Arc<dyn Link>;
        thread::spawn(move || serve(link, &asked, &tell));
        Self { line: Mutex::new((ask, told)), board, is_over: AtomicBool::new(false) }
    }

    /// The connection ends, and the server has done what it does then. Returns whether there was a connection.
    pub fn end(&self, says_bye: bool) -> bool {
        let ends = !self.is_over.swap(true, Ordering::Relaxed);
        if ends {
            self.ask(Ask::End { says_bye });
        }
        ends
    }

    fn is_over(&self) -> bool {
        self.is_over.load(Ordering::Relaxed)
    }

    fn ask(&self, what: Ask) -> Option<Stamp> {
        let line = self.line.lock().expect("no panic");
        line.0.send(what).expect("the server runs");
        line.1.recv().expect("the server has not panicked")
    }

    fn lost(&self) -> LinkError {
        LinkError::Lost { name: "remote".into(), reason: "the server has ended the connection".into() }
    }
}

fn serve(link: Arc<dyn Link>, asked: &Receiver<Ask>, tell: &Sender<Option<Stamp>>) {
    let server = InMemoryServer::new(link, ServeOptions::default());
    let mut writer = server.join(true);
    for ask in asked {
        let mut now = None;
        match (ask, &mut writer) {
            (Ask::End { says_bye }, writer) => writer.take().expect("the writer").end(says_bye),
            (Ask::Write(frame), Some(client)) => now = say(client, ClientMessage::Write(&frame)),
            (Ask::Pass(time), Some(client)) => now = say(client, ClientMessage::Pass(time)),
            (Ask::Read(wait), Some(client)) => {
                client.hear(&read_request(wait));
                while client.work() {}
                now = done(client);
            }
            (_, None) => {}
        }
        if tell.send(now).is_err() {
            return;
        }
    }
}

fn say(client: &mut InMemoryClient<'_>, what: ClientMessage<'_>) -> Option<Stamp> {
    client.say(what, usize::MAX);
    done(client)
}

fn done(client: &InMemoryClient<'_>) -> Option<Stamp> {
    let told = client.take_messages().expect("valid messages");
    told.into_iter().find_map(|one| if let ServerMessage::Done { now, .. } = one { now } else { None })
}

/// The message Read with a limit of its own, which [`ClientMessage::Read`] has not.
fn read_request(wait: Wait) -> [u8; 20] {
    let limit = wait.limit().map_or(u64::MAX, |limit| limit.as_nanos() as u64);
    let mut bytes = [0; 20];
    (bytes[0], bytes[2]) = (16, 0x03);
    bytes[12..].copy_from_slice(&limit.to_le_bytes());
    bytes
}

impl Link for Remote {
    fn info(&self) -> LinkInfo {
        Link::info(&*self.board)
    }

    fn write(&self, frame: &Frame, _: Wait) -> Result<Stamp, LinkError> {
        self.check()?;
        let failed = LinkError::Timeout { dir: Dir::Write, waited: Duration::ZERO, what: "the board did not take it" };
        self.ask(Ask::Write(Box::new(frame.clone()))).ok_or(failed)
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        self.check()?;
        let failed = LinkError::Timeout { dir: Dir::Read, waited: Duration::ZERO, what: "no report" };
        self.ask(Ask::Read(wait)).ok_or(failed)?;
        let (report, meta) = self.board.last_read();
        out.clone_from(&report);
        Ok(meta)
    }

    fn pass(&self, time: Duration) -> Result<Option<Stamp>, LinkError> {
        self.check()?;
        self.ask(Ask::Pass(time)).map(Some).ok_or_else(|| self.lost())
    }

    fn cancel(&self, _: Dir) {}

    fn close(&self) {
        self.end(true);
    }

    fn vanish(&self) {
        self.end(false);
    }

    fn check(&self) -> Result<(), LinkError> {
        if self.is_over() { Err(self.lost()) } else { Ok(()) }
    }

    fn stats(&self) -> LinkStats {
        Link::stats(&*self.board)
    }
}

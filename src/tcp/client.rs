//! The link `tcp:`: opening, closing, and the calls of a [`Link`].

use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use parking_lot::Mutex;

use super::connect::{Connected, connect, until_closed};
use super::connection::{Sender, Shared, State};
use super::exchange::{Answer, Ended, Exchange};
use super::hang::MotionInForce;
use super::options::TcpOptions;
use super::wire::{End, Message, Role};
use crate::address::uri::LinkUri;
use crate::link::call_counts::CallCounts;
use crate::link::common_options::CommonOptions;
use crate::link::{Dir, KnownNetwork, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Stamp, Wait, check_pass};
use crate::sk::Frame;
use crate::threads::sync::{self, Condvar};
use crate::threads::{self, WaitQueue};

/// How long closing the link waits until the server has received its Bye and closed the connection. \[OURS]
const CLOSE_LIMIT: Duration = Duration::from_secs(1);

/// How many threads may wait in calls at the same time without an allocation: memory for them is allocated when the
/// link is opened. \[OURS]
const WAITING_CAPACITY: usize = 8;

/// A link to a board that another process or machine serves.
pub struct TcpLink {
    shared: Arc<Shared>,
    background: Mutex<Option<JoinHandle<()>>>,
}

impl TcpLink {
    /// Connects to the server in the URI.
    ///
    /// # Errors
    /// [`LinkError::NoBoard`] if the server cannot be reached, has no board or refuses the client, with the reason;
    /// [`LinkError::InUse`] if the board has a writer already, with its name; [`LinkError::Io`] if the secret cannot be read,
    /// or no thread can be started.
    pub fn connect(uri: &LinkUri, options: &TcpOptions, common: &CommonOptions) -> Result<Self, LinkError> {
        let name = uri.to_string();
        let Connected {
            #[cfg(unix)]
            let_go,
            channel,
            mut inbox,
            out,
            slot,
            virtual_time,
            now,
            sequence,
            board,
            network,
        } = connect(&name, options)?;
        // Virtual time advances by the writer's calls. A reader's calls do not advance it, so a reader's waits end by the real
        // clock.
        let virtual_time = virtual_time && options.role == Role::Writer;
        let info = LinkInfo { virtual_time, opened_at: now, ..common.info(name.clone(), common.slot.or(slot)) };
        // `hang_ms=` has nothing to detect on virtual time: no axis moves while the program makes no call.
        let watches = !options.hang.is_zero() && options.role == Role::Writer && !virtual_time;
        if watches && info.slot.is_none() {
            log::warn!("`{name}`: hang_ms= has no effect while it is not known how wide slots are; give it slot= too");
        }
        let in_force = info.slot.filter(|_| watches).map(|size| MotionInForce::new(options.hang, size));
        let mut exchange = Exchange::new(name, sequence, common.queue, virtual_time.then_some(now));
        // The inbox may already contain messages that arrived together with the Welcome.
        exchange.take_all(&mut inbox);
        let shared = Arc::new(Shared {
            info,
            board,
            network,
            role: options.role,
            keepalive: options.keepalive,
            in_force,
            #[cfg(unix)]
            _let_go: let_go,
            channel,
            out: Mutex::new(Sender { out, last: Instant::now() }),
            state: sync::Mutex::new(State {
                exchange,
                receiver: None,
                inbox: Some(inbox),
                waiting: Vec::with_capacity(WAITING_CAPACITY),
                cancels: [0; 2],
            }),
            changed: WaitQueue::new(),
            over: Condvar::new(),
            counts: CallCounts::default(),
        });
        let background = threads::spawn("ecmsk-tcp", {
            let shared = Arc::clone(&shared);
            move || shared.run_background()
        });
        let background = background.map_err(|error| LinkError::no_thread(&shared.info.name, &error))?;
        Ok(Self { shared, background: Mutex::new(Some(background)) })
    }

    /// Ends the link; a second call has no effect. After a Bye the server leaves the axes in their present motion;
    /// without one it brings them to a standstill.
    fn end(&self, says_bye: bool) {
        let shared = &self.shared;
        let closed = Ended { error: LinkError::Closed, unsure: false };
        let was_open = match shared.state().exchange.ended.replace(closed) {
            Some(Ended { error: LinkError::Closed, .. }) => return,
            ended => ended.is_none(),
        };
        shared.over.notify_all();
        shared.changed.notify_all();
        shared.channel.wake();
        if was_open
            && says_bye
            && let Some(mut sender) = shared.out.try_lock_for(CLOSE_LIMIT)
        {
            let bye = Message::Bye { end: End::Closed, text: "" };
            let deadline = Instant::now() + CLOSE_LIMIT;
            let said = shared
                .channel
                .stage(&bye, &mut sender.out)
                .and_then(|()| shared.channel.flush(&mut sender.out, deadline));
            shared.channel.end(false);
            if said.is_ok() {
                // Waits for the server to close its end: from then on another client can become the writer.
                until_closed(&shared.channel, deadline);
            }
        }
        shared.channel.end(true);
        if let Some(background) = self.background.lock().take() {
            // The thread was woken and ends, because the link has ended. The result would only say whether it has panicked.
            let _ = background.join();
        }
    }

    /// The URI with which the server has opened the board, for example `usb:`.
    pub fn board(&self) -> &str {
        &self.shared.board
    }
}

impl Link for TcpLink {
    fn info(&self) -> LinkInfo {
        self.shared.info.clone()
    }

    fn network(&self) -> Option<KnownNetwork> {
        Some(self.shared.network.clone()).filter(|network| !network.is_empty())
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        self.shared.counts.write(self.shared.write(frame, wait))
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        self.shared.counts.read(self.shared.read(out, wait))
    }

    fn pass(&self, time: Duration) -> Result<Option<Stamp>, LinkError> {
        self.check()?;
        if !self.shared.info.virtual_time {
            return Ok(None);
        }
        // Only this client advances the board's time, so the time in the server's last answer is still the present one.
        if time.is_zero()
            && let Some(now) = self.shared.state().exchange.now
        {
            return Ok(Some(now));
        }
        check_pass(time)?;
        let ns = u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
        // Advancing a long time takes long; the server sends keep-alive messages meanwhile.
        match self.shared.request(Dir::Read, Wait::Forever, |request| Message::Pass { request, ns }).1? {
            Answer::Passed(now) => Ok(now),
            _ => Err(self.shared.unexpected_answer()),
        }
    }

    fn cancel(&self, dir: Dir) {
        self.shared.state().cancels[dir as usize] += 1;
        self.shared.changed.notify_all();
        self.shared.channel.wake();
    }

    fn close(&self) {
        self.end(true);
    }

    fn vanish(&self) {
        // A reader has not moved any axis, so there is nothing to stop.
        self.end(self.shared.role == Role::Reader);
    }

    fn check(&self) -> Result<(), LinkError> {
        self.shared.state().exchange.check()
    }

    fn stats(&self) -> LinkStats {
        let shared = &self.shared;
        let wait = Wait::For(shared.patience());
        let (state, asked) = shared.request(Dir::Read, wait, |request| Message::Count { request });
        // If the server does not answer in time, the counters of its previous answer are returned.
        let counts = match asked {
            Ok(Answer::Counted(counts)) => counts,
            _ => state.exchange.counts,
        };
        let here = state.exchange.dropped;
        drop(state);
        LinkStats {
            reports_dropped: counts.reports_dropped.saturating_add(here),
            board: counts.board,
            ..shared.counts.stats()
        }
    }
}

/// Dropping a link without closing it counts as the program vanishing: the program has not decided that its axes may go
/// on moving.
impl Drop for TcpLink {
    fn drop(&mut self) {
        self.vanish();
    }
}

#[cfg(all(test, feature = "sim"))]
mod tests {
    use std::sync::mpsc;
    use std::thread;

    use super::*;
    use crate::link::{self, Share};
    use crate::port::tcp::{ServeOptions, Server};

    /// TCP-22 The velocities and torques in force are noted in the order in which the board has accepted the frames of
    /// several threads. The request of a second thread begins only after the first thread's frame was noted.
    #[test]
    fn writes_of_threads_are_noted_in_their_order() {
        let open = || link::open("sim:?slaves=drive&clock=real&name=noted", Share::ByUri);
        let options = ServeOptions { listen: ([127, 0, 0, 1], 0).into(), ..ServeOptions::default() };
        let server = Server::start(open, options).expect("a server");
        let uri: LinkUri = format!("tcp://{}", server.address()).parse().expect("a link");
        let options = TcpOptions::from_uri(&uri).expect("its keys");
        let link =
            TcpLink::connect(&uri, &options, &CommonOptions::from_uri(&uri).expect("its keys")).expect("a writer");
        let frame = Frame::new();
        let noted = &Mutex::new(Vec::new());
        let write = |note: &dyn Fn()| {
            let message = |request| Message::Write { request, wait: Wait::Forever, frame: frame.bytes() };
            link.shared.request_and(Dir::Write, Wait::Forever, message, note).1.expect("it is taken");
        };
        let (began, begins) = mpsc::channel();
        thread::scope(|scope| {
            scope.spawn(|| {
                write(&move || {
                    began.send(()).expect("it is waited for");
                    thread::sleep(Duration::from_millis(50));
                    noted.lock().push(1);
                });
            });
            begins.recv().expect("it is noted");
            write(&|| noted.lock().push(2));
        });
        assert_eq!(*noted.lock(), [1, 2]);
    }
}

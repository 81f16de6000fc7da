//! The thread of a control socket. It waits for clients, parses their events, and puts them into the [`Slot`] from
//! which a cycle takes them.

use std::io::{self, Read, Write};
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, poll};
use rustix::time::Timespec;

use super::{ControlError, place};
use crate::address::slaves::SlaveSpec;
use crate::link::LinkError;
use crate::local_socket::LocalSocket;
use crate::testbed::script::injected::{Abilities, Injected, Outcome, Slot};
use crate::threads;

/// The time limit for receiving the line of a client. \[OURS]
const REQUEST_LIMIT: Duration = Duration::from_secs(2);
/// The longest line of a client, bytes. \[OURS]
const REQUEST_BYTES_MAX: usize = 4096;
/// The time before the next client is accepted after an error, such as too many open files. \[OURS]
const AFTER_ERROR: Duration = Duration::from_millis(100);
/// The interval at which the thread checks whether a cycle has handled the event. \[OURS]
const LOOK_INTERVAL: Duration = Duration::from_millis(1);
/// The time limit for the end of the thread, whose waits all end when the `waker` is closed.
const END_LIMIT: Duration = Duration::from_secs(1);

/// A listening control socket. Dropping it ends the thread and removes the socket.
pub(crate) struct Control {
    thread: Option<JoinHandle<()>>,
    /// Closing this socket wakes the thread, which then ends.
    waker: Option<UnixStream>,
}

impl Control {
    /// Listens at the control socket `name` (a name or a path) of a board with these slaves. `link` is the name of the
    /// link in messages.
    ///
    /// # Errors
    /// [`LinkError::NoBoard`]: the name is invalid, or the socket cannot be created. [`LinkError::Io`]: the thread
    /// cannot be started.
    pub(crate) fn start(
        link: &str,
        name: &str,
        slaves: Vec<SlaveSpec>,
        abilities: Abilities,
        slot: Arc<Slot>,
    ) -> Result<Self, LinkError> {
        let refused = |reason: String| LinkError::NoBoard { name: link.to_owned(), reason };
        let path = place(name).map_err(|error: ControlError| refused(format!("control={name}: {error}")))?;
        let failed = |error: io::Error| {
            let next = match error.kind() {
                io::ErrorKind::AddrInUse => "another board has this control=, give each its own",
                io::ErrorKind::AlreadyExists => "name another path",
                _ => "name a path of at most 107 bytes in a folder that this user may write to",
            };
            refused(format!("control={name}: cannot listen at {}: {error}; {next}", path.display()))
        };
        let socket = LocalSocket::bind(&path).map_err(failed)?;
        let (waker, ended) = UnixStream::pair().map_err(failed)?;
        let work = move || Thread { socket, ended, slaves, abilities, slot }.run();
        let thread = threads::spawn("ecmsk-control", work).map_err(|error| LinkError::no_thread(link, &error))?;
        Ok(Self { thread: Some(thread), waker: Some(waker) })
    }
}

impl Drop for Control {
    fn drop(&mut self) {
        self.waker = None;
        if let Some(thread) = self.thread.take() {
            threads::end_within(thread, END_LIMIT);
        }
    }
}

struct Thread {
    socket: LocalSocket,
    /// Readable when the thread is to end.
    ended: UnixStream,
    slaves: Vec<SlaveSpec>,
    abilities: Abilities,
    slot: Arc<Slot>,
}

/// Why [`Thread::wait`] has returned.
#[derive(PartialEq, Eq)]
enum Waited {
    /// There is something to read, or the client has disconnected.
    Ready,
    TimedOut,
    /// The thread is to end.
    Ended,
}

impl Thread {
    fn run(self) {
        while self.wait(self.socket.listener(), None) != Waited::Ended {
            match self.socket.listener().accept() {
                // An error is ignored: a client that has disconnected needs no answer.
                Ok((client, _)) => drop(self.serve(client)),
                // If no file descriptor is free, the client stays in the queue and the socket stays readable. The pause
                // avoids a busy loop.
                Err(_) => {
                    self.wait(&self.ended, Some(AFTER_ERROR));
                }
            }
        }
    }

    /// Waits until `other` has something to read or the thread is to end, at most for `limit`; `None`: without a limit.
    fn wait(&self, other: impl AsFd, limit: Option<Duration>) -> Waited {
        let limit = limit.map(|limit| Timespec {
            tv_sec: i64::try_from(limit.as_secs()).unwrap_or(i64::MAX),
            tv_nsec: limit.subsec_nanos().into(),
        });
        let mut fds = [PollFd::new(&other, PollFlags::IN), PollFd::new(&self.ended, PollFlags::IN)];
        match poll(&mut fds, limit.as_ref()) {
            _ if !fds[1].revents().is_empty() => Waited::Ended,
            Ok(0) => Waited::TimedOut,
            // After an error, such as an interruption by a signal, the caller tries to read and waits again.
            _ => Waited::Ready,
        }
    }

    fn serve(&self, mut client: UnixStream) -> io::Result<()> {
        client.set_nonblocking(true)?;
        let Some(text) = self.request(&mut client)? else { return Ok(()) };
        match Injected::parse(&text, &self.slaves, self.abilities) {
            Err(why) => client.write_all(format!("wrong {why}\n").as_bytes()),
            Ok(event) => {
                // The event is put into the slot before `taken` is sent, because a client that has read `taken` may
                // start the next cycle.
                self.slot.ask(event);
                let sent = client.write_all(b"taken\n");
                let answer = self.outcome(&mut client);
                sent.and_then(|()| client.write_all(answer.unwrap_or_default().as_bytes()))
            }
        }
    }

    /// Reads the line of a client; `None` if the client sends no complete line in time, or a line that is too long.
    fn request(&self, client: &mut UnixStream) -> io::Result<Option<String>> {
        let deadline = Instant::now() + REQUEST_LIMIT;
        let mut line = Vec::new();
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() || self.wait(&*client, Some(left)) != Waited::Ready {
                return Ok(None);
            }
            let mut bytes = [0; 512];
            match client.read(&mut bytes) {
                Ok(0) => return Ok(None),
                Ok(count) => line.extend_from_slice(&bytes[..count]),
                Err(error) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted) => {}
                Err(error) => return Err(error),
            }
            if let Some(end) = line.iter().position(|byte| *byte == b'\n') {
                return Ok(Some(String::from_utf8_lossy(&line[..end]).into_owned()));
            }
            if line.len() > REQUEST_BYTES_MAX {
                return Ok(None);
            }
        }
    }

    /// Waits until a cycle has handled the event or the thread is to end, and returns the answer. `None`: the client
    /// has disconnected before. The slot is free afterwards.
    fn outcome(&self, client: &mut UnixStream) -> Option<String> {
        loop {
            if let Some(outcome) = self.slot.outcome() {
                return Some(match outcome {
                    Outcome::Done { cycle, at } => format!("done {cycle} {at}\n"),
                    Outcome::TooMany => {
                        format!(
                            "failed {} events with `for` are in force; end one with `end VERB`\n",
                            Slot::LASTING_MAX
                        )
                    }
                });
            }
            match self.wait(&*client, Some(LOOK_INTERVAL)) {
                Waited::Ended if self.slot.take_back() => {
                    return Some("failed the board was closed before it happened\n".to_owned());
                }
                Waited::Ready if has_gone(client) && self.slot.take_back() => return None,
                _ => {}
            }
        }
    }
}

/// Whether the client has closed its connection. Bytes that the client sends after its line are discarded.
fn has_gone(client: &mut UnixStream) -> bool {
    match client.read(&mut [0; 64]) {
        Ok(count) => count == 0,
        Err(error) => !matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted),
    }
}

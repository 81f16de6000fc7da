//! The thread of the server. It owns the chip and all connections.

use std::sync::Arc;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::address::{Listener, Stream};
use super::connection::{Connection, Left};
use super::vanish::{self, Stopped};
use super::wire::{Kind, Request, Status};
use super::{OnVanish, Opened, Options};
use crate::link::chip_link::{ChipError, ChipLink};
use crate::notes::Notes;
use crate::port::log_limit::LogLimit;
use crate::port::serving::Shared;
use crate::xf::host::HostConfig;

/// While no host uses the chip, the server accesses the chip at this interval: the model of a chip runs its cycles only
/// in such calls, and its cycles shall not stand still. \[OURS]
const IDLE_INTERVAL: Duration = Duration::from_millis(100);
/// The longest wait on the chip during which no other event is handled. \[OURS]
const WAIT_SLICE_NS: u64 = 20_000_000;
/// How many messages of the host are handled in a row before the server looks for new connections. \[OURS]
const MESSAGES_IN_A_ROW_MAX: usize = 64;
/// The pause after an error of `accept`, for example because no file descriptor was left. \[OURS]
const ACCEPT_RETRY_PAUSE: Duration = Duration::from_millis(50);

type Open = Box<dyn FnMut() -> Result<Opened, ChipError> + Send>;
/// Why a request could not be carried out: status and text of its answer.
type Refused = (Status, String);

pub(super) struct Service {
    chip: Served,
    open: Open,
    listener: Listener,
    shared: Arc<Shared>,
    options: Options,
    notes: Notes<String>,
    log_limit: LogLimit,
    host: Option<Connection>,
    /// Whether messages of the host may be waiting that were not handled yet, because of [`MESSAGES_IN_A_ROW_MAX`].
    has_more: bool,
    next_accept: Instant,
    /// When the chip is accessed next while no host uses it, see [`Served::pass_time`].
    next_tick: Instant,
}

/// The chip that the server gives to one host at a time, and its link.
struct Served {
    /// The link to the chip; `None` while the link is being opened again after a failure.
    link: Option<Box<dyn ChipLink>>,
    config: HostConfig,
    has_int0: bool,
    virtual_time: bool,
    /// Whether the last access to the link has failed, so that the link has to be opened again.
    failed: bool,
    /// Whether the present host has exchanged packets with the chip since the chip's last reset: if not, nothing has to
    /// be stopped when the host vanishes.
    was_used: bool,
}

impl Service {
    pub fn new(
        opened: Opened,
        open: Open,
        listener: Listener,
        shared: Arc<Shared>,
        options: Options,
        notes: Notes<String>,
    ) -> Self {
        let chip = Served::new(opened);
        let now = Instant::now();
        Self {
            chip,
            open,
            listener,
            shared,
            options,
            notes,
            log_limit: LogLimit::default(),
            host: None,
            has_more: false,
            next_accept: now,
            next_tick: now,
        }
    }

    pub fn run(mut self) {
        while !self.shared.is_stopping() {
            self.wait();
            if let Some(left) = self.serve_host() {
                self.host_left(&left);
            }
            self.take_newcomers();
            let now = Instant::now();
            self.log_limit.due(now).into_iter().for_each(|line| self.notes.push(line));
            if now >= self.next_tick {
                self.chip.pass_time();
                self.next_tick = now + IDLE_INTERVAL;
            }
        }
        if self.host.is_some() {
            self.host_left(&Left::Gone("the server ends".to_owned()));
        }
    }

    /// Waits until a connection or bytes arrive, a deadline has passed, or the idle chip has to be accessed.
    fn wait(&mut self) {
        let now = Instant::now();
        let retry = (self.next_accept > now).then_some(self.next_accept);
        let deadline = self.host.as_ref().and_then(Connection::deadline);
        let more = std::mem::take(&mut self.has_more).then_some(now);
        let until = [Some(self.next_tick), more, retry, deadline].into_iter().flatten().min();
        let limit = until.and_then(|until| Timespec::try_from(until.saturating_duration_since(now)).ok());
        let mut fds = vec![PollFd::new(self.shared.waker.waited(), PollFlags::IN)];
        fds.extend(self.host.as_ref().map(Connection::poll_fd));
        if retry.is_none() {
            fds.push(self.listener.poll_fd());
        }
        // If the wait fails, the following calls on the sockets report the error.
        let _ = poll(&mut fds, limit.as_ref());
        if !fds[0].revents().is_empty() {
            self.shared.waker.seen();
        }
    }

    /// Handles the host's messages. Returns the reason if the host has left; `None`: it has not left, and no further
    /// message is complete, or new connections are handled first ([`MESSAGES_IN_A_ROW_MAX`]).
    fn serve_host(&mut self) -> Option<Left> {
        let host = self.host.as_mut()?;
        for _ in 0..MESSAGES_IN_A_ROW_MAX {
            if self.shared.is_stopping() {
                return None;
            }
            match host.next(Instant::now()) {
                Ok(true) => {}
                Ok(false) => return None,
                Err(left) => return Some(left),
            }
            let (chip, shared) = (&mut self.chip, &self.shared);
            let mut closes = false;
            let answered = host.answer(|kind, body, room, stream| {
                let request = Request::parse(kind, body).map_err(|bad| (Status::BadRequest, bad.to_string()))?;
                closes = request == Request::Close;
                chip.carry_out(request, room, &|| shared.is_stopping() || stream.has_ended())
            });
            match answered {
                Err(left) => return Some(left),
                Ok(()) if closes => return Some(Left::Closed),
                Ok(()) => {}
            }
        }
        self.has_more = true;
        None
    }

    /// Handles the end of a host's connection: stops the axes if the host has vanished, logs it, and frees the chip.
    fn host_left(&mut self, left: &Left) {
        let Some(mut host) = self.host.take() else { return };
        let who = host.name.clone();
        let stopped = if *left == Left::Closed { None } else { self.stop_axes(&who) };
        match left {
            Left::Closed => {
                host.end();
                self.tell_limited("a host has closed", &format!("{who} has closed"));
            }
            Left::Gone(why) => {
                host.say_and_end(Kind::Close, Status::Ends, why);
                self.tell_limited("a host is gone", &format!("{who} is gone: {why}"));
            }
            Left::Broken(bad) => {
                host.say_and_end(Kind::Close, Status::BadRequest, &bad.to_string());
                self.tell_limited("a host does not keep to the protocol", &format!("{who} is gone: {bad}"));
            }
        }
        if let Some(line) = stopped {
            self.notes.push(line);
        }
    }

    /// Stops the axes of a vanished host. Returns a text for the log about what was done; `None`: nothing had to be
    /// stopped.
    fn stop_axes(&mut self, who: &str) -> Option<String> {
        if !std::mem::take(&mut self.chip.was_used) {
            return None;
        }
        if self.options.on_vanish == OnVanish::Leave {
            return Some("the chip is left as it is (on-vanish=leave): it repeats the last outputs".to_owned());
        }
        let config = self.chip.config;
        match vanish::bring_to_safe_op(self.chip.link.as_deref_mut()?, config) {
            Ok(Stopped::NotInOp) => None,
            Ok(Stopped::Slaves(count)) => Some(format!(
                "{count} slaves that were in OP are in SafeOP after {who}: drives brake by themselves and are off"
            )),
            Err(error) => {
                self.chip.failed = true;
                Some(format!("axes may still move after {who}: {error}; use the emergency stop"))
            }
        }
    }

    fn take_newcomers(&mut self) {
        if self.next_accept > Instant::now() {
            return;
        }
        for _ in 0..MESSAGES_IN_A_ROW_MAX {
            match self.listener.accept() {
                Ok(Some((stream, who))) => self.take_in(stream, who),
                Ok(None) => return,
                Err(error) => {
                    let line = format!("no connection can be taken: {error}");
                    self.tell_limited(&line, &line);
                    self.next_accept = Instant::now() + ACCEPT_RETRY_PAUSE;
                    return;
                }
            }
        }
    }

    /// Gives the chip to a host, or refuses it with a reason.
    fn take_in(&mut self, stream: Stream, who: String) {
        let mut connection = Connection::new(stream, who, self.options.message_limit);
        let refused = match &self.host {
            Some(host) => Err((
                Status::Busy,
                format!("{} has the chip, which one host has at a time; end that one first", host.name),
            )),
            None => self.open_again(),
        };
        if let Err((status, why)) = refused {
            self.tell_limited("a host is refused", &format!("{} is refused: {why}", connection.name));
            connection.refuse(status, &why);
            return;
        }
        self.tell_limited("a host has the chip", &format!("{} has the chip", connection.name));
        self.chip.was_used = false;
        self.host = Some(connection);
    }

    /// Opens the link again after it has failed.
    fn open_again(&mut self) -> Result<(), Refused> {
        if !self.chip.failed {
            return Ok(());
        }
        // The link must be closed before it is opened again, since a device can be open only once.
        self.chip.link = None;
        let opened = (self.open)().map_err(|error| (Status::Chip, error.to_string()))?;
        self.chip = Served::new(opened);
        Ok(())
    }

    /// Logs a line that hosts can cause as often as they like. If there are too many lines of the same `kind`, further
    /// ones are only counted.
    fn tell_limited(&mut self, kind: &str, line: &str) {
        if self.log_limit.may_log(kind, Instant::now()) {
            self.notes.push(line.to_owned());
        }
    }
}

impl Served {
    fn new((link, config): Opened) -> Self {
        let info = link.info();
        let (has_int0, virtual_time) = (info.has_int0, info.virtual_time);
        Self { link: Some(link), config, has_int0, virtual_time, failed: false, was_used: false }
    }

    /// Carries out a request. Returns the length of the answer in `room`. `ends` returns true when a wait in progress
    /// has to stop.
    fn carry_out(&mut self, request: Request<'_>, room: &mut [u8], ends: &dyn Fn() -> bool) -> Result<usize, Refused> {
        let Some(link) = &mut self.link else { return Err((Status::Chip, "the chip is not open".to_owned())) };
        let done = match request {
            Request::Exchange(bytes) => {
                self.was_used = true;
                link.exchange(bytes, &mut room[..bytes.len()]).map(|()| bytes.len())
            }
            Request::WaitInt0(_) if !self.has_int0 => return Err(no_line("INT0", "wait for a time with request 4")),
            Request::WaitInt0(micros) => in_slices(&mut **link, micros, ends, |link, until| link.wait_ready(until))
                .map(|active| {
                    room[0] = u8::from(active);
                    1
                }),
            Request::Int1 => match link.int1() {
                Ok(Some(level)) => {
                    room[0] = u8::from(level);
                    Ok(1)
                }
                Ok(None) => return Err(no_line("INT1", "ask the chip with INFO_UPDATE")),
                Err(error) => Err(error),
            },
            Request::Delay(micros) => {
                in_slices(&mut **link, micros, ends, |link, until| link.wait_until(until).map(|()| false)).map(|_| 0)
            }
            Request::Reset => match link.reset() {
                Ok(true) => {
                    // A reset chip is in the state after power-on, so nothing has to be stopped if the host vanishes
                    // now.
                    self.was_used = false;
                    Ok(0)
                }
                Ok(false) => return Err(no_line("the reset line", "name it with reset=, or send WARM_RESET")),
                Err(error) => Err(error),
            },
            Request::Close => Ok(0),
        };
        if !matches!(request, Request::Close) {
            self.failed = done.is_err();
        }
        done.map_err(|error| (Status::Chip, error.to_string()))
    }

    /// Accesses the chip while no host uses it. A model of a chip runs the cycles of the past time when it is accessed.
    /// Without this call, the first access of the next host might have to run the cycles of a whole day at once.
    fn pass_time(&mut self) {
        if let Some(link) = &mut self.link
            && !self.virtual_time
        {
            // An error of the link will be reported to the next host that uses the chip.
            let _ = link.int1();
        }
    }
}

fn no_line(name: &str, next: &str) -> Refused {
    (Status::NoLine, format!("{name} is not wired; {next}"))
}

/// Waits in slices until `wait` returns true, `micros` microseconds have passed, or `ends` returns true. Returns
/// whether `wait` has returned true.
fn in_slices(
    link: &mut dyn ChipLink,
    micros: u32,
    ends: &dyn Fn() -> bool,
    mut wait: impl FnMut(&mut dyn ChipLink, u64) -> Result<bool, ChipError>,
) -> Result<bool, ChipError> {
    let end = link.now().saturating_add(u64::from(micros) * 1000);
    loop {
        let now = link.now();
        if wait(link, end.min(now.saturating_add(WAIT_SLICE_NS)))? {
            return Ok(true);
        }
        if link.now() >= end || ends() {
            return Ok(false);
        }
    }
}

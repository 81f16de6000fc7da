//! One open board for as many steps as there are: it knows what the network is, brings it up when told to, ends what
//! takes long on Ctrl-C, and leaves the axes as wanted.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::panic::resume_unwind;
use std::sync::Arc;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::{Duration, Instant};

use ecmsk::cia402::{Mode, Statusword};
use ecmsk::ecm::{Axis, Close, Config, Ecm, EcmError, Options, SlaveView, Snapshot};
use ecmsk::link::uri::LinkUri;
use ecmsk::link::{self, Dir, Link, Share};
use ecmsk::sk::{MasterState, SlotSize};
use serde_json::json;

use super::Args;
use super::error::BoardError;
use super::interrupt::Interrupt;
use super::network::{describe, find_slave, list};
use super::talk::Talk;

/// \[OURS] How often Ctrl-C is looked for while the board is waited for.
const LOOK: Duration = Duration::from_millis(20);
/// \[OURS] How long work may take to end by itself on Ctrl-C.
const STOP_LIMIT: Duration = Duration::from_secs(1);
/// \[OURS] Where a move begins, if the axis is no further from its last target: a standing drive is a few counts off it.
const NEAR_COUNTS: u32 = 64;

/// Where steps come from: it decides what an error tells to type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// One verb on the command line.
    CommandLine,
    /// Lines of a script or of the shell.
    Lines,
}

/// What closing does if nobody says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Use {
    /// The verb moves nothing.
    Looks,
    /// The verb may move axes or switch them on.
    Moves,
}

/// What a step needs of the network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Needs<'a> {
    /// PreOP or higher.
    Sdo,
    /// OP.
    Op,
    /// OP, and these axes on.
    On(&'a [u8]),
}

/// An open board.
pub struct Board {
    pub ecm: Ecm,
    pub talk: Talk,
    pub interrupt: Interrupt,
    /// What the network is, if that is known.
    pub config: Option<Config>,
    pub uri: LinkUri,
    pub options: Options,
    /// `--timeout`.
    pub limit: Option<Duration>,
    link: Arc<dyn Link>,
    up: bool,
    close: Close,
    place: Place,
    /// Where moves ended, by slave.
    targets: RefCell<BTreeMap<u8, i32>>,
}

impl Board {
    /// Opens the board that the options name. Nothing is sent.
    ///
    /// # Errors
    /// [`BoardError`]
    pub fn open(args: &Args, used: Use, place: Place) -> Result<Self, BoardError> {
        let uri = args.uri()?;
        let config = args.network(&uri);
        let default = Options::default();
        let limit = |default| args.timeout.unwrap_or(default);
        let options = Options {
            slot: args.slot,
            guard: args.guard != Some(ecmsk::ecm::Guard::Off),
            state_limit: limit(default.state_limit),
            sdo_limit: limit(default.sdo_limit),
            servo_limit: limit(default.servo_limit),
            ..default
        };
        let close = args.close.unwrap_or(match used {
            Use::Looks => Close::Leave,
            Use::Moves => Close::Hold,
        });
        let options = Options { close, ..options };
        let interrupt = Interrupt::watch()?;
        let link = link::open(&uri.to_string(), Share::ByName)?;
        let ecm = Ecm::over(Arc::clone(&link), options).map_err(|error| wrong_slot(error, args.slot))?;
        if let Some(config) = &config {
            let size = ecm.slot_size()?;
            config.check(size).map_err(EcmError::from)?;
            // A network that runs already is what it was configured as.
            if matches!(ecm.state()?.state(), Some(MasterState::SafeOp | MasterState::Op)) {
                ecm.adopt(config)?;
            }
        }
        Ok(Self {
            ecm,
            talk: Talk::new(args.json),
            interrupt,
            config,
            uri,
            options,
            limit: args.timeout,
            link,
            up: args.up,
            close,
            place,
            targets: RefCell::default(),
        })
    }

    /// What the link has counted.
    pub fn link_stats(&self) -> link::LinkStats {
        self.link.stats()
    }

    /// Leaves the axes as wanted. What a stopped step left is said here.
    ///
    /// # Errors
    /// [`BoardError`]: that of the step, if it failed.
    pub fn close(self, done: Result<(), BoardError>) -> Result<(), BoardError> {
        let Self { ecm, talk, close, .. } = self;
        talk.clear();
        let closed = ecm.close(close);
        if let (Err(BoardError::Stopped { signal, .. }), Ok(())) = (&done, &closed) {
            let next = match close {
                Close::Hold => "no axis moves, those that were on stay on; run it again to go on",
                Close::ServoOff => "the axes are off; run it again to go on",
                Close::Leave => "the axes were left as they are; see what they do with `ecmsk info`",
            };
            return Err(BoardError::Stopped { signal: *signal, next: next.into() });
        }
        match (done, closed) {
            (Ok(()), closed) => Ok(closed?),
            (Err(error), Err(also)) => {
                talk.note(format_args!("closing the board failed too: {also}"));
                Err(error)
            }
            (failed, Ok(())) => failed,
        }
    }

    /// The network, or why a step cannot go on.
    pub fn known(&self, what: &str) -> Result<&Config, BoardError> {
        self.config.as_ref().ok_or_else(|| BoardError::UnknownNetwork { what: what.to_owned() })
    }

    /// The axis of a slave.
    pub fn axis(&self, what: &str, slave: u8) -> Result<Axis, BoardError> {
        let config = self.known(what)?;
        let found = find_slave(config, what, slave)?;
        found.axis().copied().ok_or_else(|| BoardError::WrongKind {
            what: what.to_owned(),
            slave,
            found: describe(found),
            wanted: "a drive, step or hsp",
        })
    }

    /// All slaves with an axis.
    pub fn axes(&self, what: &str) -> Result<Vec<u8>, BoardError> {
        let config = self.known(what)?;
        Ok((1..).zip(&config.slaves).filter(|(_, slave)| slave.axis().is_some()).map(|(number, _)| number).collect())
    }

    /// What a step has to type to go on: the command line with `--up`, or the lines that bring it up.
    fn next(&self, lines: &str) -> String {
        match self.place {
            Place::CommandLine => format!("to bring it up first, type: {} --up", command_line()),
            Place::Lines => format!("write {lines} before it"),
        }
    }

    /// Sees to what a step needs, with `--up` by bringing the network up; else says what to type.
    ///
    /// # Errors
    /// [`BoardError::NotUp`], [`BoardError::AxisOff`], [`BoardError::Alarm`], and what goes wrong on the way up.
    pub fn ready(&self, what: &str, needs: Needs<'_>) -> Result<(), BoardError> {
        let found = self.ecm.state()?;
        let state = found.state().filter(|_| !found.is_failed());
        let wanted = if needs == Needs::Sdo { MasterState::PreOp } else { MasterState::Op };
        if needs != Needs::Sdo {
            self.known(what)?;
        }
        if state.is_none_or(|state| state < wanted) {
            if !self.up {
                let needs = if wanted == MasterState::Op { "OP" } else { "PreOP, SafeOP or OP" };
                let next = self.next(if wanted == MasterState::Op { "`state op`" } else { "`state preop`" });
                return Err(BoardError::NotUp { what: what.to_owned(), needs, found, next });
            }
            self.go_to(wanted)?;
        }
        let Needs::On(axes) = needs else { return Ok(()) };
        let snapshot = self.ecm.snapshot()?;
        let mut off = Vec::new();
        for slave in axes {
            let word = self.statusword(&snapshot, *slave);
            self.refuse_alarm(&snapshot, *slave)?;
            if !word.is_enabled() {
                off.push((*slave, word));
            }
        }
        let Some((slave, word)) = off.first() else { return Ok(()) };
        if !self.up {
            let next = self.next(&format!("`servo on {slave}`"));
            return Err(BoardError::AxisOff { what: what.to_owned(), slave: *slave, state: shown(*word), next });
        }
        let axes: Vec<u8> = off.iter().map(|(slave, _)| *slave).collect();
        self.attend("switching on", |ecm| ecm.servo_on(&axes))?;
        self.talk.note(format_args!("switched on: {}", named("axis", "axes", &axes)));
        Ok(())
    }

    /// Changes the state; on the way from PreOP to higher ones the network is configured.
    ///
    /// # Errors
    /// [`BoardError::UnknownNetwork`], and what the board says.
    pub fn go_to(&self, wanted: MasterState) -> Result<(), BoardError> {
        let change = |to: MasterState| self.attend(&format!("going to {to}"), |ecm| ecm.set_state(to));
        let from = self.ecm.state()?;
        let settled = from.state().filter(|_| !from.is_failed());
        self.targets.borrow_mut().clear();
        if wanted <= MasterState::PreOp || matches!(settled, Some(MasterState::SafeOp | MasterState::Op)) {
            return change(wanted);
        }
        let config = self.known(&format!("going to {wanted}"))?;
        if settled != Some(MasterState::PreOp) {
            change(MasterState::PreOp)?;
        }
        self.attend("configuring", |ecm| ecm.configure(config))?;
        self.talk.note(format_args!("configured: {}, cycle {} us", list(config), config.cycle_us));
        change(wanted)
    }

    /// Does what may take long in a thread, so that Ctrl-C ends it, and says so after a second.
    ///
    /// # Errors
    /// [`BoardError::Stopped`], else those of the work.
    pub fn attend<T: Send>(
        &self,
        what: &str,
        work: impl FnOnce(&Ecm) -> Result<T, EcmError> + Send,
    ) -> Result<T, BoardError> {
        self.attend_with(what, work, None)
    }

    /// As [`Board::attend`]; on Ctrl-C `stop` is called, which lets the work end by itself.
    pub fn attend_with<T: Send>(
        &self,
        what: &str,
        work: impl FnOnce(&Ecm) -> Result<T, EcmError> + Send,
        stop: Option<&dyn Fn()>,
    ) -> Result<T, BoardError> {
        self.check_stop()?;
        let began = Instant::now();
        let mut pace = self.talk.pace();
        let mut stopped: Option<Instant> = None;
        let (ecm, (running, ended)) = (&self.ecm, mpsc::channel::<()>());
        let done = thread::scope(|scope| {
            let worker = scope.spawn(move || {
                let _running = running;
                work(ecm)
            });
            while ended.recv_timeout(LOOK) == Err(RecvTimeoutError::Timeout) {
                if self.interrupt.signal().is_some() {
                    if stopped.is_none() {
                        stop.into_iter().for_each(|stop| stop());
                    }
                    let since = *stopped.get_or_insert_with(Instant::now);
                    if stop.is_none() || since.elapsed() > STOP_LIMIT {
                        // Whatever it waits for, it waits for a report.
                        self.link.cancel(Dir::Read);
                        self.link.cancel(Dir::Write);
                    }
                }
                if stop.is_none() && pace.due(began.elapsed()) {
                    let seconds = began.elapsed().as_secs();
                    // An error of standard output shows with the result.
                    let _ = self.talk.progress(
                        format_args!("{what}, {seconds} s"),
                        || json!({"progress": what, "seconds": seconds}),
                    );
                }
            }
            worker.join().unwrap_or_else(|panic| resume_unwind(panic))
        });
        self.talk.clear();
        if done.is_err() {
            self.check_stop()?;
        }
        done.map_err(|error| self.told(error))
    }

    /// Whether Ctrl-C came.
    ///
    /// # Errors
    /// [`BoardError::Stopped`]
    pub fn check_stop(&self) -> Result<(), BoardError> {
        match self.interrupt.signal() {
            None => Ok(()),
            Some(signal) => Err(BoardError::Stopped { signal, next: "the board is still open".into() }),
        }
    }

    /// An error of the library in words of the tool.
    pub fn told(&self, error: EcmError) -> BoardError {
        match error {
            EcmError::Alarm { slave, code } => BoardError::Alarm { slave, code, next: self.clear_words(slave) },
            error => error.into(),
        }
    }

    fn clear_words(&self, slave: u8) -> String {
        match self.place {
            Place::CommandLine => format!("type: ecmsk servo clear {slave} (with the same options)"),
            Place::Lines => format!("`servo clear {slave}` and `servo on {slave}`"),
        }
    }

    /// # Errors
    /// [`BoardError::Alarm`]
    pub fn refuse_alarm(&self, snapshot: &Snapshot, slave: u8) -> Result<(), BoardError> {
        if self.statusword(snapshot, slave).0 & Statusword::FAULT == 0 {
            return Ok(());
        }
        let code = snapshot.drive(slave).map_or(0, |drive| drive.error_code);
        Err(self.told(EcmError::Alarm { slave, code }))
    }

    /// Statusword of an axis.
    pub fn statusword(&self, snapshot: &Snapshot, slave: u8) -> Statusword {
        match snapshot.slave(slave) {
            Some(SlaveView::Drive(drive)) => drive.statusword,
            Some(SlaveView::Hsp(hsp)) => hsp.statusword,
            _ => Statusword(0),
        }
    }

    /// Where an axis was told to be, if it is there, else where it is.
    pub fn rests_at(&self, snapshot: &Snapshot, slave: u8) -> i32 {
        let actual = snapshot.position(slave).unwrap_or_default();
        let told = self.targets.borrow().get(&slave).copied();
        told.filter(|told| told.wrapping_sub(actual).unsigned_abs() <= NEAR_COUNTS).unwrap_or(actual)
    }

    /// A move has ended there.
    pub fn told_to(&self, slave: u8, target: i32) {
        self.targets.borrow_mut().insert(slave, target);
    }

    /// Where moves ended counts no more: an axis got new coordinates or went off.
    pub fn forget_targets(&self) {
        self.targets.borrow_mut().clear();
    }
}

/// An axis that a mode of operation fits.
pub fn in_mode(slave: u8, what: &str, axis: &Axis, wanted: Mode) -> Result<(), BoardError> {
    if axis.mode == wanted {
        return Ok(());
    }
    Err(BoardError::Refused {
        what: what.to_owned(),
        why: format!("axis {slave} runs in {}, not in {wanted}", axis.mode),
        next: "leave its mode out of --slaves, and configure the network again from PreOP".into(),
    })
}

/// `axis 1`, `axes 1, 2`.
pub fn named(one: &str, many: &str, slaves: &[u8]) -> String {
    let numbers = slaves.iter().map(u8::to_string).collect::<Vec<_>>().join(", ");
    format!("{} {numbers}", if slaves.len() == 1 { one } else { many })
}

/// `Operation enabled (0x0637)`.
pub fn shown(word: Statusword) -> String {
    format!("{} (0x{:04X})", word.state().map_or("an unknown state", |state| state.name()), word.0)
}

fn wrong_slot(error: EcmError, given: Option<SlotSize>) -> BoardError {
    match (error, given) {
        (EcmError::NoReport { bad_crc: bad_crc @ 1.., .. }, Some(slot)) => {
            let other = if slot == SlotSize::Bytes12 { 16 } else { 12 };
            BoardError::WrongSlot { slot: slot.bytes(), bad_crc, other }
        }
        (error, _) => error.into(),
    }
}

/// What was typed, as a shell takes it again.
fn command_line() -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "_-./:=,+@%".contains(c);
    let quoted = std::env::args().skip(1).map(|word| {
        if !word.is_empty() && word.chars().all(plain) { word } else { format!("'{}'", word.replace('\'', r"'\''")) }
    });
    std::iter::once("ecmsk".to_owned()).chain(quoted).collect::<Vec<_>>().join(" ")
}

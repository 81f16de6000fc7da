//! An open board, on which steps run. It knows the network, brings it up with `--up`, ends long calls on Ctrl-C, and
//! leaves the axes in the state that `--close` requests.

use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use ecmsk::cia402::{Mode, Statusword};
use ecmsk::ecm::{Axis, Close, Config, Ecm, EcmError, Guard, HeldBack, Options, Scales, SlaveView, Snapshot, Suspect};
use ecmsk::engine::StateFailure;
use ecmsk::link::keys::Scheme;
use ecmsk::link::uri::LinkUri;
use ecmsk::link::{self, Link, LinkError, Share};
use ecmsk::machine_file::MachineFile;
use ecmsk::sk::{MasterState, SlotSize, StateByte};

use super::Args;
use super::error::BoardError;
use super::interrupt::Interrupt;
use super::network::find_axis;
use super::reporter::Reporter;
use crate::link_option::as_reader;
use crate::machine_option::{AxisDifference, note_differences};
use crate::{recording_end, streams};

/// \[OURS] An axis at most this far from its last target counts as being at the target, since drives settle within a
/// few counts. Its next move begins at that target. An axis further away has not completed its move.
pub const NEAR_COUNTS: u32 = 64;

/// The source of the steps. It decides what the advice at the end of an error is: an `ecmsk` command line, or lines for
/// the script or shell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StepSource {
    /// A verb of the command line.
    CommandLine,
    /// Lines of a script or of the shell.
    Lines,
    /// Buttons of the page of `ecmsk serve web --control`.
    #[cfg_attr(not(feature = "web"), allow(dead_code, reason = "only the page uses it"))]
    Page,
}

/// How a verb uses the board. This decides the default of `--close`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoardUse {
    /// The verb sends nothing, so it also works while another program sends commands.
    Reads,
    /// The verb sends commands but moves no axis.
    Looks,
    /// The verb may switch axes on or off, or stop them, but sends no targets.
    Switches,
    /// The verb may move axes.
    Moves,
}

impl BoardUse {
    /// Whether the verb may move axes or switch them.
    const fn commands_axes(self) -> bool {
        matches!(self, Self::Switches | Self::Moves)
    }
}

/// The open board of a verb, with the options that apply to it.
pub struct Board {
    pub ecm: Ecm,
    pub reporter: Reporter,
    pub interrupt: Interrupt,
    /// The configuration of the network; `None` if it is unknown.
    pub config: Option<Config>,
    pub uri: LinkUri,
    pub options: Options,
    /// The value of `--timeout`.
    pub limit: Option<Duration>,
    /// The largest allowed distance of a target of `move` from the position of the axis, from `--guard`.
    pub guard: Guard,
    /// The value of `--counts-per-unit`.
    pub(super) scales: Option<Scales>,
    /// The counts per unit for axes that are given by slave number.
    pub(super) number_scales: Option<Scales>,
    /// The machine file, with the names and units of the axes; `None` if there is none.
    pub machine: Option<MachineFile>,
    /// The axes for which the machine file differs from that of the server; these axes are not moved. Empty with
    /// `--machine`.
    pub(super) differing: Vec<AxisDifference>,
    pub(super) link: Arc<dyn Link>,
    /// Whether `--up` is given.
    pub(super) up: bool,
    close: Close,
    board_use: BoardUse,
    pub(super) source: StepSource,
    /// Whether the network was already running when the board was opened, and this process has not configured it since.
    /// The configuration then comes from the options, and may differ from the real one.
    pub(super) adopted: Cell<bool>,
    /// For each slave, the target at which its last move ended, in counts.
    targets: RefCell<BTreeMap<u8, i32>>,
    /// For each IO slave, the outputs that this process has set.
    outputs: RefCell<BTreeMap<u8, u16>>,
    /// The slaves whose drive had an internal limit active when the axes were last stopped.
    limited: RefCell<BTreeSet<u8>>,
}

impl Board {
    /// Opens the board of the options, and sends nothing. `interrupt` ends long calls.
    ///
    /// # Errors
    /// [`BoardError`] if the link, the machine file, the recording or an option is invalid, if the board does not open
    /// or sends no report, or if the operating system refuses a thread.
    pub fn open(
        args: &Args,
        board_use: BoardUse,
        source: StepSource,
        interrupt: Interrupt,
    ) -> Result<Self, BoardError> {
        // From here on axes may be moving, so output is queued: the program must not block when nobody reads its
        // output.
        streams::queue().map_err(|error| LinkError::Io {
            what: "cannot start the threads of standard output and error".into(),
            message: format!("{error}; end other programs, or raise the limit of threads (ulimit -u)"),
        })?;
        let machine = args.machine(board_use)?;
        let chosen = args.chosen(machine.as_ref())?;
        let uri = args.with_record(&chosen.uri, machine.as_ref())?;
        // A verb that stops axes or switches them off uses no positions, so differing machine files must not delay it.
        let mut differing = match &machine {
            Some(machine) if board_use != BoardUse::Switches => note_differences(machine, &chosen.uri),
            _ => Vec::new(),
        };
        if args.machine.is_some() {
            differing.clear();
        }
        let slot = args.slot_size();
        let default = Options::default();
        let limit = |default| args.timeout.unwrap_or(default);
        let options = Options {
            slot,
            guard: args.lead_limit != Some(Guard::Off),
            state_limit: limit(default.state_limit),
            sdo_limit: limit(default.sdo_limit),
            servo_limit: limit(default.servo_limit),
            ..default
        };
        let close = args.close.unwrap_or(match board_use {
            BoardUse::Reads | BoardUse::Looks => Close::Leave,
            BoardUse::Switches | BoardUse::Moves => Close::Hold,
        });
        let options = Options { close, ..options };
        let link = match link::open(&uri.to_string(), Share::ByName) {
            // Another client is already the one that may write, so this verb opens the link as a reader.
            Err(LinkError::InUse { .. }) if board_use == BoardUse::Reads => {
                link::open(&as_reader(&uri).to_string(), Share::ByName)?
            }
            Err(error) => return Err(chosen.if_unnamed(&error).map_or(error.into(), BoardError::from)),
            Ok(link) => link,
        };
        let known = link.network();
        let config = args.network(&uri, known.as_ref(), machine.as_ref());
        let ecm = Ecm::over(Arc::clone(&link), options).map_err(|error| wrong_slot(error, slot))?;
        let mut adopted = false;
        if let Some(config) = &config {
            let size = ecm.slot_size()?;
            config.check(size).map_err(EcmError::from)?;
            // If the network is already running, it is assumed to have the configuration of the options.
            adopted = matches!(ecm.state()?.state(), Some(MasterState::SafeOp | MasterState::Op));
            if adopted {
                ecm.adopt(config)?;
            }
        }
        Ok(Self {
            ecm,
            reporter: Reporter::new(args.json, link.info().virtual_time),
            interrupt,
            config,
            uri,
            options,
            limit: args.timeout,
            guard: args.guard.unwrap_or(Guard::Off),
            scales: args.scales().cloned(),
            number_scales: args.number_scales(known.as_ref()),
            machine,
            differing,
            link,
            up: args.up,
            close,
            board_use,
            source,
            adopted: Cell::new(adopted),
            targets: RefCell::default(),
            outputs: RefCell::default(),
            limited: RefCell::default(),
        })
    }

    /// Texts for the axes that did not follow when they were stopped, since the last call of this method.
    pub fn held_back(&self) -> Vec<String> {
        let text = |axis: HeldBack| {
            let slave = axis.slave;
            if axis.is_second {
                return axis.to_string();
            }
            let away = axis.away.map_or_else(
                || "held back from its target".to_owned(),
                |away| format!("{} from its target", self.distance_in_units(slave, away)),
            );
            let at = self.in_units(slave, axis.position).0;
            format!("axis {} pushed, {away}: its target is now its actual position, {at}", self.label(slave))
        };
        // An error is ignored: if the board is lost, the next call of the board reports it.
        let held = self.ecm.take_held_back().unwrap_or_default();
        self.limited.replace(held.iter().filter(|axis| axis.is_limited).map(|axis| axis.slave).collect());
        held.into_iter().map(text).collect()
    }

    /// Whether the drive of a slave had an internal limit active when its axis was last stopped. The statusword may no
    /// longer show it after that.
    pub fn was_limited(&self, slave: u8) -> bool {
        self.limited.borrow().contains(&slave)
    }

    /// The counters of the link since it was opened: frames, errors and, for a simulated board, the board's own
    /// counters.
    pub fn link_stats(&self) -> link::LinkStats {
        self.link.stats()
    }

    /// Lets at least one cycle of a board on a virtual clock pass. On the real clock, cycles pass without this call.
    #[cfg(unix)]
    pub fn pass_cycle(&self) {
        let cycle_us = self.config.as_ref().map_or(Config::default().cycle_us, |config| config.cycle_us);
        // An error is ignored: if the board is lost, the next step reports it.
        let _ = self.link.pass(Duration::from_micros(cycle_us.max(Config::default().cycle_us).into()));
    }

    /// Why a state change has failed, as far as it is known, with the next step; `None` if no state change has failed.
    pub fn why_failed(&self, state: StateByte) -> Option<String> {
        StateFailure::explain(state, self.link_stats().state_failure.as_ref())
    }

    /// Closes the board and leaves the axes in the state that `--close` requests. `done` is the result of the steps.
    ///
    /// # Errors
    /// The error of the steps, else the error of closing.
    pub fn close(self, done: Result<(), BoardError>) -> Result<(), BoardError> {
        let Self { ecm, reporter, close, board_use, uri, .. } = self;
        reporter.clear();
        let had_axes =
            board_use.commands_axes() && ecm.state().is_ok_and(|state| state.state() == Some(MasterState::Op));
        let ends_board = ends_with_its_program(uri.scheme());
        let closed = ecm.close(close);
        if ends_board && had_axes && closed.is_ok() {
            reporter.note(OFF_WITH_THE_BOARD);
        }
        let done = if board_use.commands_axes() { done.map_err(may_go_on) } else { done };
        if let (Err(BoardError::Stopped { signal, .. }), Ok(())) = (&done, &closed) {
            let next = match close {
                _ if ends_board => "no axis moves, and the network is in PreOP; run it again to go on",
                Close::Hold => "no axis moves, those that were on stay on; run it again to go on",
                Close::ServoOff => "the axes are off; run it again to go on",
                Close::Leave => "the axes were left as they are; see what they do with `ecmsk info`",
            };
            return Err(BoardError::Stopped { signal: *signal, next: next.into() });
        }
        match (done, closed) {
            (Ok(()), closed) => {
                closed?;
                recording_end::not_whole(Some(&uri)).map_or(Ok(()), |lacks| Err(BoardError::NotRecorded { lacks }))
            }
            (Err(error), Err(also)) => {
                reporter.note(format_args!("closing the board failed too: {also}"));
                Err(error)
            }
            (failed, Ok(())) => failed,
        }
    }

    /// The configuration of the network, or [`BoardError::UnknownNetwork`] if it is not known.
    pub fn known_network(&self, what: &str) -> Result<&Config, BoardError> {
        self.config.as_ref().ok_or_else(|| BoardError::UnknownNetwork { what: what.to_owned() })
    }

    /// The configuration of a slave's axis, or the error if it has no axis.
    pub fn axis(&self, what: &str, slave: u8) -> Result<Axis, BoardError> {
        find_axis(self.known_network(what)?, what, slave).copied()
    }

    /// Adds the knowledge of the tool to an error of the library: what to type next, and why a state change has failed.
    pub fn explain(&self, error: EcmError) -> BoardError {
        match error {
            EcmError::TooFar { slave, target, actual, limit } => {
                let at = |counts| self.in_units(slave, counts).0;
                let way = |counts| self.distance_in_units(slave, counts);
                BoardError::TooFarAhead {
                    axis: self.label(slave),
                    actual: at(actual),
                    target: at(target),
                    away: way(target.wrapping_sub(actual).unsigned_abs()),
                    limit: way(limit),
                }
            }
            EcmError::Alarm { slave, code } => BoardError::Alarm {
                axis: self.label(slave),
                alarm: self.alarm_text(slave, code),
                next: self.clear_words(slave),
            },
            // A report does not show which slave has refused the state change, but the link may know it.
            EcmError::StateStuck { wanted, found, suspect: Suspect::Unknown } => {
                match self.link_stats().state_failure {
                    Some(why) => BoardError::StateStuck { wanted, found, why },
                    None => error.into(),
                }
            }
            error => match slave_of(&error).filter(|slave| self.units().axis(*slave).is_some()) {
                Some(slave) => BoardError::OfAxis { axis: self.label(slave), error: Box::new(error) },
                None if self.board_use.commands_axes() => may_go_on(error.into()),
                None => error.into(),
            },
        }
    }

    fn clear_words(&self, slave: u8) -> String {
        let axis = self.label(slave);
        match self.source {
            StepSource::CommandLine => format!("type: ecmsk servo clear {axis} (with the same options)"),
            StepSource::Lines => format!("`servo clear {axis}` and `servo on {axis}`"),
            StepSource::Page => format!("press Clear alarm and On of axis {axis}"),
        }
    }

    /// Fails if an axis has an alarm in the report `snapshot`.
    ///
    /// # Errors
    /// [`BoardError::Alarm`] with the error code, if bit 3 (fault) of the statusword is set.
    pub fn refuse_alarm(&self, snapshot: &Snapshot, slave: u8) -> Result<(), BoardError> {
        if self.statusword(snapshot, slave).0 & Statusword::FAULT == 0 {
            return Ok(());
        }
        let code = snapshot.drive(slave).map_or(0, |drive| drive.error_code);
        Err(self.explain(EcmError::Alarm { slave, code }))
    }

    /// The statusword of an axis in the report `snapshot`.
    pub fn statusword(&self, snapshot: &Snapshot, slave: u8) -> Statusword {
        match snapshot.slave(slave) {
            Some(SlaveView::Drive(drive)) => drive.statusword,
            Some(SlaveView::Hsp(hsp)) => hsp.statusword,
            _ => Statusword(0),
        }
    }

    /// The position at which a move of an axis begins: its last target if the axis is near it, otherwise its actual
    /// position.
    pub fn standing_position(&self, snapshot: &Snapshot, slave: u8) -> i32 {
        let actual = snapshot.position(slave).unwrap_or_default();
        let told = self.targets.borrow().get(&slave).copied();
        told.filter(|told| told.wrapping_sub(actual).unsigned_abs() <= NEAR_COUNTS).unwrap_or(actual)
    }

    /// Records that a move of the axis has ended at this target.
    pub fn note_target(&self, slave: u8, target: i32) {
        self.targets.borrow_mut().insert(slave, target);
    }

    /// The outputs of an IO slave if this process has set them; bit k is output k.
    pub fn outputs(&self, slave: u8) -> Option<u16> {
        self.outputs.borrow().get(&slave).copied()
    }

    /// Records that the outputs of an IO slave were set.
    pub fn note_outputs(&self, slave: u8, bits: u16) {
        self.outputs.borrow_mut().insert(slave, bits);
    }

    /// Forgets all targets, because the axes get new coordinates or are switched on or off.
    pub fn forget_targets(&self) {
        self.targets.borrow_mut().clear();
    }
}

/// A note that the axes of a verb do not stay enabled, see [`ends_with_its_program`].
const OFF_WITH_THE_BOARD: &str = "the axes are off, and the network is in PreOP: this program was the board; with `ecmsk serve tcp` \
                                  and --link tcp://localhost they stay on";

/// Whether this program itself is the board of a real network. If so, the axes are switched off when the program ends,
/// whatever `--close` requests.
const fn ends_with_its_program(scheme: Scheme) -> bool {
    matches!(scheme, Scheme::Nic | Scheme::XfSpi | Scheme::XfUsb)
}

/// If the board was lost while a verb commanded axes, and nothing is known to have stopped them, adds to the error that
/// they may go on.
fn may_go_on(error: BoardError) -> BoardError {
    let lost = match error {
        BoardError::Link(error) | BoardError::Ecm(EcmError::Link(error)) => error,
        error => return error,
    };
    match &lost {
        LinkError::Unsure { .. } => BoardError::MayGoOn(lost),
        // A server that is stopped, or that stops the axes for another client, brakes them first.
        LinkError::Lost { reason, .. } if !reason.contains("was stopped") && !reason.contains("stopped by another") => {
            BoardError::MayGoOn(lost)
        }
        _ => lost.into(),
    }
}

/// The slave to which an error refers; the error then names its axis.
const fn slave_of(error: &EcmError) -> Option<u8> {
    match error {
        EcmError::NotEnabled { slave, .. }
        | EcmError::SecondOff { slave }
        | EcmError::OutOfRange { slave, .. }
        | EcmError::IsHoming { slave }
        | EcmError::HomingFailed { slave, .. } => Some(*slave),
        EcmError::SlaveLost { slave, .. } => *slave,
        _ => None,
    }
}

/// Checks that an axis runs in this mode of operation; otherwise returns [`BoardError::Refused`]. `label` is the name
/// of the axis in the error.
pub fn in_mode(label: &str, what: &str, axis: &Axis, wanted: Mode) -> Result<(), BoardError> {
    if axis.mode == wanted {
        return Ok(());
    }
    Err(BoardError::Refused {
        what: what.to_owned(),
        why: format!("axis {label} runs in {}, not in {wanted}", axis.mode),
        next: "leave its mode out of --slaves, and configure the network again from PreOP".into(),
    })
}

/// A noun and slave numbers as text: `axis 1`, `axes 1, 2`.
pub fn numbered(one: &str, many: &str, slaves: &[u8]) -> String {
    let numbers = slaves.iter().map(u8::to_string).collect::<Vec<_>>().join(", ");
    format!("{} {numbers}", if slaves.len() == 1 { one } else { many })
}

/// The statusword as text: `Operation enabled (0x0637)`.
pub fn statusword_text(word: Statusword) -> String {
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

#[cfg(test)]
mod tests {
    use super::*;

    /// docs/SAFETY.md: if this program itself is the board of a real network, the axes go off when the program ends.
    #[test]
    fn some_boards_end_with_their_programs() {
        let ends: Vec<_> = Scheme::ALL.into_iter().filter(|scheme| ends_with_its_program(*scheme)).collect();
        assert_eq!(ends, [Scheme::XfSpi, Scheme::XfUsb, Scheme::Nic]);
    }

    /// If a board is lost while a verb commands axes, the error says that they may go on, unless a server is known to
    /// brake them.
    #[test]
    fn axes_of_a_lost_board_may_go_on() {
        let lost = |reason: &'static str| LinkError::Lost { name: "tcp://localhost".into(), reason: reason.into() };
        for (error, says) in [
            (lost("its server has closed the connection"), true),
            (lost("no USB device is there any more"), true),
            (LinkError::Unsure { name: "tcp://localhost".into(), reason: "its end".into() }, true),
            (lost("its server was stopped"), false),
            (lost("its server is stopped, and leaves axes as they are"), true),
            (lost("stopped by another client, ecmsk (PID 5), and its server brings the axes to a standstill"), false),
            (LinkError::Closed, false),
        ] {
            for error in [BoardError::Link(error.clone()), BoardError::Ecm(error.into())] {
                let text = may_go_on(may_go_on(error)).to_string();
                assert_eq!(text.ends_with("; axes may go on: use the emergency stop if they do"), says, "{text}");
            }
        }
    }
}

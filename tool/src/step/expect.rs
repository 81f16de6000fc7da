//! `expect`: fails if the board or its slaves are not in the expected state, so that a script can check its own effect.

use std::time::Duration;

use clap::Subcommand;
use ecmsk::cia402::Statusword;
use ecmsk::ecm::{Config, Snapshot};
use ecmsk::machine_file::MachineFile;
use ecmsk::sk::MasterState;

use super::io::{bits, input, io_slave, named};
use super::motion::{AxisTarget, Target};
use super::object::{Type, Value};
use super::sdo::{Which, read_raw};
use super::state;
use crate::board::{AxisWord, Board, BoardError, Needs, Units, duration, find_slave, not_negative, whole};

const WHAT: &str = "expect";

/// Fail if the board is not as expected
#[derive(Clone, Debug, clap::Args)]
#[command(disable_help_subcommand = true, arg_required_else_help = true)]
pub struct Args {
    #[command(subcommand)]
    verb: Verb,

    /// Wait so long for it, by the board's clock, e.g. 500ms [default: it has to be so at once]
    #[arg(long, value_name = "TIME", value_parser = duration, global = true)]
    wait: Option<Duration>,
}

#[derive(Clone, Debug, Subcommand)]
enum Verb {
    /// The network must be in this state
    State {
        #[arg(value_name = "init|preop|safeop|op", value_parser = state::parse)]
        state: MasterState,
    },
    /// Axes must be at these positions: counts, or units for axes with names or with --counts-per-unit
    Position {
        #[arg(value_name = "AXIS=POSITION", required = true, value_parser = Target::parse)]
        positions: Vec<Target>,
        /// Allowed deviation of each position, in the same units
        #[arg(long, value_name = "N", default_value = "0", value_parser = not_negative, allow_negative_numbers = true)]
        within: f64,
    },
    /// Axes must have these velocities, counts/s or units/s, over one cycle
    Velocity {
        #[arg(value_name = "AXIS=VELOCITY", required = true, value_parser = Target::parse)]
        velocities: Vec<Target>,
        /// Allowed deviation of each velocity, in the same units
        #[arg(long, value_name = "N", default_value = "0", value_parser = not_negative, allow_negative_numbers = true)]
        within: f64,
    },
    /// Axes must have these torques, percent of the rated torque
    Torque {
        #[arg(value_name = "AXIS=PERCENT", required = true, value_parser = torque)]
        torques: Vec<(AxisWord, f64)>,
        /// Allowed deviation of each torque, percent of the rated torque
        #[arg(long, value_name = "N", default_value = "0", value_parser = not_negative, allow_negative_numbers = true)]
        within: f64,
    },
    /// Axes must have an alarm with that error code, or any alarm, or none, e.g. 2=0x7500, 2=any, 1=none
    Alarm {
        #[arg(value_name = "AXIS=CODE|any|none", required = true, value_parser = alarm)]
        alarms: Vec<(AxisWord, Alarm)>,
    },
    /// The 16 inputs of an IO slave must be exactly these, bit k is input k, e.g. 3=0x0001; or an input with a name of the
    /// machine file must be on or off
    Inputs {
        #[arg(value_name = "SLAVE=BITS|NAME=on|off", value_parser = Inputs::parse)]
        inputs: Inputs,
    },
    /// An object of a slave must have this value (SDO)
    Sdo {
        #[command(flatten)]
        which: Which,
        /// The value, decimal or hexadecimal with 0x
        #[arg(value_name = "VALUE", allow_hyphen_values = true, value_parser = Value::parse)]
        value: Value,
    },
    /// So much of the board's time must have passed since it was opened
    Time {
        /// At least this long, e.g. 2s
        #[arg(long, value_name = "TIME", value_parser = duration, required_unless_present = "at_most")]
        at_least: Option<Duration>,
        /// At most this long
        #[arg(long, value_name = "TIME", value_parser = duration)]
        at_most: Option<Duration>,
    },
    /// Counters since the board was opened must have these values: reports_lost, reports_dropped, reports_bad_crc, fifo_losses,
    /// commands_rejected (simulated boards alone); error_byte and fifo_full_count as the board has them, e.g. reports_lost=0
    Counter {
        #[arg(value_name = "NAME=N", required = true, value_parser = counter)]
        counters: Vec<(Counter, u64)>,
    },
}

/// The alarm that an axis is expected to have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Alarm {
    Code(u16),
    Any,
    None,
}

/// A counter that `expect counter` can check, see [`Counter::ALL`] for the names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Counter {
    ReportsLost,
    ReportsDropped,
    ReportsBadCrc,
    FifoLosses,
    CommandsRejected,
    ErrorByte,
    FifoFullCount,
}

impl Counter {
    const ALL: [(&str, Self); 7] = [
        ("reports_lost", Self::ReportsLost),
        ("reports_dropped", Self::ReportsDropped),
        ("reports_bad_crc", Self::ReportsBadCrc),
        ("fifo_losses", Self::FifoLosses),
        ("commands_rejected", Self::CommandsRejected),
        ("error_byte", Self::ErrorByte),
        ("fifo_full_count", Self::FifoFullCount),
    ];

    fn name(self) -> &'static str {
        Self::ALL.into_iter().find(|(_, counter)| *counter == self).map_or("", |(name, _)| name)
    }

    /// The present value; `None` if this kind of board does not report it.
    fn value(self, board: &Board) -> Result<Option<u64>, BoardError> {
        let stats = board.ecm.stats()?;
        Ok(Some(match self {
            Self::ReportsLost => stats.reports_lost,
            Self::ReportsDropped => board.link_stats().reports_dropped,
            Self::ReportsBadCrc => stats.bad_crc,
            Self::FifoLosses => stats.losses,
            Self::CommandsRejected => {
                let Some(counters) = board.link_stats().board else { return Ok(None) };
                counters.rejected.iter().sum()
            }
            Self::ErrorByte => board.ecm.snapshot()?.board.error.into(),
            Self::FifoFullCount => board.ecm.snapshot()?.board.full_count.into(),
        }))
    }
}

/// Inputs that are expected to have a value.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Inputs {
    /// All 16 inputs of a slave, and their expected values.
    Slave(u8, u16),
    /// One input of the machine file, and whether it is expected to be on.
    Name(String, bool),
}

impl Inputs {
    fn parse(text: &str) -> Result<Self, String> {
        let (slave, inputs) =
            text.split_once('=').ok_or("allowed: SLAVE=BITS, e.g. 3=0x0001, or NAME=on or NAME=off")?;
        if slave.trim_start().chars().next().is_some_and(char::is_alphabetic) {
            let (name, on) = named(text)?;
            return Ok(Self::Name(name.to_owned(), on == Some(true)));
        }
        let slave = whole(slave).and_then(|slave| u8::try_from(slave).ok()).filter(|slave| (1..=40).contains(slave));
        Ok(Self::Slave(slave.ok_or("allowed: a slave from 1 to 40")?, bits(inputs)?))
    }

    /// The slave of the inputs, the mask of the inputs that are compared, and their expected values.
    ///
    /// # Errors
    /// There is no machine file, or it has no input with this name.
    fn of(&self, machine: Option<&MachineFile>) -> Result<(u8, u16, u16), BoardError> {
        match self {
            Self::Slave(slave, bits) => Ok((*slave, u16::MAX, *bits)),
            Self::Name(name, on) => {
                let line = input(machine, WHAT, name)?;
                Ok((line.slave, 1 << line.bit, u16::from(*on) << line.bit))
            }
        }
    }
}

fn torque(text: &str) -> Result<(AxisWord, f64), String> {
    let read = || {
        let (axis, percent) = text.split_once('=')?;
        let percent: f64 = percent.trim().trim_end_matches('%').trim_end().parse().ok()?;
        Some((AxisWord::parse(axis)?, percent)).filter(|(_, percent)| percent.is_finite())
    };
    read().ok_or_else(|| "allowed: AXIS=PERCENT, e.g. 1=12.5, with an axis from 1 to 40 and a number".into())
}

fn alarm(text: &str) -> Result<(AxisWord, Alarm), String> {
    let read = || {
        let (axis, alarm) = text.split_once('=')?;
        let alarm = match alarm.trim() {
            "none" => Alarm::None,
            "any" => Alarm::Any,
            code => Alarm::Code(whole(code).and_then(|code| u16::try_from(code).ok()).filter(|code| *code > 0)?),
        };
        Some((AxisWord::parse(axis)?, alarm))
    };
    read().ok_or_else(|| "allowed: AXIS=CODE, e.g. 2=0x7500, AXIS=any or AXIS=none".into())
}

fn counter(text: &str) -> Result<(Counter, u64), String> {
    let read = || {
        let (name, value) = text.split_once('=')?;
        let counter = Counter::ALL.into_iter().find(|(known, _)| *known == name.trim()).map(|(_, counter)| counter)?;
        Some((counter, whole(value.trim()).and_then(|value| u64::try_from(value).ok())?))
    };
    read().ok_or_else(|| {
        format!("allowed: NAME=N, e.g. reports_lost=0, of {}", Counter::ALL.map(|(name, _)| name).join(", "))
    })
}

fn refused(why: String, next: &str) -> BoardError {
    BoardError::Refused { what: WHAT.into(), why, next: next.into() }
}

impl Args {
    /// Checks the axes, slaves and values of the step before anything is sent.
    ///
    /// # Errors
    /// A slave does not exist or is of another kind, or a value does not fit its object.
    pub fn check(&self, network: &Config, units: Units<'_>) -> Result<(), BoardError> {
        let found = |slave: u8| find_slave(network, WHAT, slave).map(|_| ());
        let axis = |axis: &AxisWord| found(axis.slave(WHAT, units.machine)?);
        match &self.verb {
            Verb::State { .. } | Verb::Time { .. } | Verb::Counter { .. } => Ok(()),
            Verb::Position { positions: targets, .. } | Verb::Velocity { velocities: targets, .. } => {
                targets.iter().try_for_each(|target| found(target.resolve(WHAT, units)?.slave))
            }
            Verb::Torque { torques, .. } => torques.iter().try_for_each(|(word, _)| axis(word)),
            Verb::Alarm { alarms } => alarms.iter().try_for_each(|(word, _)| axis(word)),
            Verb::Inputs { inputs } => io_slave(network, WHAT, inputs.of(units.machine)?.0),
            Verb::Sdo { which, value } => {
                which.slave(WHAT, units.machine)?;
                match which.of().filter(|of| !of.takes(*value)) {
                    None => Ok(()),
                    Some(of) => Err(refused(
                        format!("{value} does not fit {}, {}", which.object, of.name()),
                        "correct the value, or --type",
                    )),
                }
            }
        }
    }

    /// Compares the board with the expectation; with `--wait` again and again until they agree or the time is over.
    ///
    /// # Errors
    /// [`BoardError`] if the board differs, if a slave does not exist or is of another kind, if the compared value
    /// needs OP and the network is not in OP, if the board does not answer, or if a signal stops the wait.
    pub fn run(&self, board: &Board) -> Result<(), BoardError> {
        let mut began = None;
        loop {
            let Err(why) = self.verb.compare(board)? else { return Ok(()) };
            let failed = || refused(why.clone(), "see what came before");
            let wait = self.wait.ok_or_else(failed)?;
            board.check_stop()?;
            let now = board.ecm.next_cycle(board.options.read_limit)?.meta.at.0;
            if Duration::from_nanos(now.saturating_sub(*began.get_or_insert(now))) >= wait {
                return Err(failed());
            }
        }
    }
}

/// The result of a comparison: `Err` says how the board differs.
type Compared = Result<(), String>;

fn compared(is_it: bool, why: impl FnOnce() -> String) -> Compared {
    if is_it { Ok(()) } else { Err(why()) }
}

impl Verb {
    fn compare(&self, board: &Board) -> Result<Compared, BoardError> {
        match self {
            Self::State { state } => {
                let found = board.ecm.state()?;
                let is_it = found.state() == Some(*state) && !found.is_failed();
                Ok(compared(is_it, || format!("the network is in {found}, not in {state}")))
            }
            Self::Position { positions, within } => {
                board.ready(WHAT, Needs::Op)?;
                let snapshot = board.ecm.next_cycle(board.options.read_limit)?;
                values(board, positions, *within, "at", |target| {
                    snapshot.position(target.slave).map(|position| target.scale.to_units(position))
                })
            }
            Self::Velocity { velocities, within } => {
                board.ready(WHAT, Needs::Op)?;
                let before = board.ecm.next_cycle(board.options.read_limit)?;
                let after = board.ecm.next_cycle(board.options.read_limit)?;
                let seconds = after.meta.at.0.saturating_sub(before.meta.at.0) as f64 / 1e9;
                values(board, velocities, *within, "moving with", |target| {
                    let counts = after.position(target.slave)?.wrapping_sub(before.position(target.slave)?);
                    Some(f64::from(counts) / target.scale.counts_per_unit / seconds)
                })
            }
            Self::Torque { torques, within } => {
                board.ready(WHAT, Needs::Op)?;
                let snapshot = board.ecm.next_cycle(board.options.read_limit)?;
                each(torques, |(word, wanted)| {
                    let slave = axis(board, word)?;
                    let Some(drive) = snapshot.drive(slave) else {
                        let label = board.label(slave);
                        return Err(refused(format!("axis {label} reports no torque"), "expect it of a drive"));
                    };
                    let found = f64::from(drive.torque) / 10.0;
                    // A torque is a multiple of 0.1 %, which has no exact binary value, so a rounding error is allowed.
                    let is_it = (found - wanted).abs() <= *within + 1e-9;
                    Ok(compared(is_it, || {
                        format!("axis {} has a torque of {found} %, not {wanted} % within {within}", board.label(slave))
                    }))
                })
            }
            Self::Alarm { alarms } => {
                board.ready(WHAT, Needs::Op)?;
                let snapshot = board.ecm.next_cycle(board.options.read_limit)?;
                each(alarms, |(word, wanted)| {
                    let slave = axis(board, word)?;
                    Ok(alarm_of(board, &snapshot, slave, *wanted))
                })
            }
            Self::Inputs { inputs } => {
                let (slave, mask, wanted) = inputs.of(board.machine.as_ref())?;
                board.ready(WHAT, Needs::Op)?;
                let found = board.run_interruptible("reading inputs", |ecm| ecm.inputs(slave))?;
                let word = |bits: u16| if bits == 0 { "off" } else { "on" };
                let why = || match inputs {
                    Inputs::Slave(..) => format!("inputs of slave {slave} are 0x{found:04X}, not 0x{wanted:04X}"),
                    Inputs::Name(name, _) => format!("input {name} is {}, not {}", word(found & mask), word(wanted)),
                };
                Ok(compared(found & mask == wanted, why))
            }
            Self::Sdo { which, value } => {
                let of = which.of().unwrap_or(Type::U32);
                let (found, wanted) = (of.number(read_raw(board, WHAT, which)?), of.number(value.number as u32));
                let slave = which.slave(WHAT, board.machine.as_ref())?;
                let why = || format!("{} of slave {slave} is {found}, not {value}", which.object);
                Ok(compared(found == wanted, why))
            }
            Self::Time { at_least, at_most } => {
                let now = board.ecm.snapshot()?.meta.at.0;
                let passed = Duration::from_nanos(now.saturating_sub(board.ecm.link_info().opened_at.0));
                let is_long = at_least.is_none_or(|least| passed >= least);
                let is_it = is_long && at_most.is_none_or(|most| passed <= most);
                let limit = if is_long { ("at most", at_most) } else { ("at least", at_least) };
                let (passed, seconds) = (passed.as_secs_f64(), limit.1.unwrap_or_default().as_secs_f64());
                Ok(compared(is_it, || {
                    format!("{passed:.3} s have passed since the board was opened, not {} {seconds} s", limit.0)
                }))
            }
            Self::Counter { counters } => each(counters, |(counter, wanted)| {
                let name = counter.name();
                let Some(found) = counter.value(board)? else {
                    return Err(refused(format!("this board does not tell {name}"), "expect it of a simulated board"));
                };
                Ok(compared(found == *wanted, || format!("{name} is {found}, not {wanted}")))
            }),
        }
    }
}

/// Compares the items in turn, up to the first one that differs.
fn each<T>(all: &[T], compare: impl Fn(&T) -> Result<Compared, BoardError>) -> Result<Compared, BoardError> {
    for one in all {
        let compared = compare(one)?;
        if compared.is_err() {
            return Ok(compared);
        }
    }
    Ok(Ok(()))
}

/// The slave of an axis.
fn axis(board: &Board, word: &AxisWord) -> Result<u8, BoardError> {
    let slave = word.slave(WHAT, board.machine.as_ref())?;
    board.axis(WHAT, slave)?;
    Ok(slave)
}

/// Compares one value of each axis with its target, in the unit of the target.
fn values(
    board: &Board,
    targets: &[Target],
    within: f64,
    is: &str,
    of: impl Fn(&AxisTarget) -> Option<f64>,
) -> Result<Compared, BoardError> {
    each(targets, |target| {
        let target = target.resolve(WHAT, board.units())?;
        board.axis(WHAT, target.slave)?;
        let (found, value) = (of(&target).unwrap_or(f64::NAN), target.value);
        let is_it = (found - value).abs() <= within;
        let label = board.label(target.slave);
        Ok(compared(is_it, || format!("axis {label} is {is} {found}, not {is} {value} within {within}")))
    })
}

fn alarm_of(board: &Board, snapshot: &Snapshot, slave: u8, wanted: Alarm) -> Compared {
    let has_alarm = board.statusword(snapshot, slave).0 & Statusword::FAULT != 0;
    // A pulse module (HSP) reports no error code.
    let code = snapshot.drive(slave).map_or(0, |drive| drive.error_code);
    let is_it = match wanted {
        Alarm::None => !has_alarm,
        Alarm::Any => has_alarm,
        Alarm::Code(wanted) => has_alarm && code == wanted,
    };
    compared(is_it, || {
        let found = if has_alarm { format!("alarm {}", board.alarm_text(slave, code)) } else { "no alarm".to_owned() };
        let wanted = match wanted {
            Alarm::None => "none".to_owned(),
            Alarm::Any => "any".to_owned(),
            Alarm::Code(code) => format!("0x{code:04X}"),
        };
        format!("axis {} has {found}, not {wanted}", board.label(slave))
    })
}

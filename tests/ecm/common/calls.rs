//! Every call of the native API, as a list: what tests of bad states and bad boards loop over.

use ecmsk::coe::ObjectAddress;
use ecmsk::ecm::{Axis, Config, CrcSwitches, Ecm, EcmError, Homing, Options, Slave};
use ecmsk::sk::MasterState;

use super::SECOND;

/// A drive in CSP, a drive in CSV and an IO slave.
pub const SLAVES: &str = "slaves=drive*2,io";

pub fn config() -> Config {
    Config { slaves: vec![Slave::Drive(Axis::CSP), Slave::Drive(Axis::CSV), Slave::Io], ..Config::default() }
}

/// The states a call is good in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Needs {
    /// It asks nothing of the board.
    Nothing,
    /// A board that talks.
    Board,
    /// It is that state or any.
    States(&'static [MasterState]),
    /// OP, whatever the axes do.
    Op,
    /// OP, and slave 1 has no alarm.
    NoAlarm,
    /// OP, and slave 1 is on and does not home.
    On,
}

pub struct Call {
    pub name: &'static str,
    pub needs: Needs,
    pub run: fn(&Ecm) -> Result<(), EcmError>,
}

const fn call(name: &'static str, needs: Needs, run: fn(&Ecm) -> Result<(), EcmError>) -> Call {
    Call { name, needs, run }
}

const NOT_INIT: Needs = Needs::States(&[MasterState::PreOp, MasterState::SafeOp, MasterState::Op]);
const PREOP: Needs = Needs::States(&[MasterState::PreOp]);
const NOT_OP: Needs = Needs::States(&[MasterState::Init, MasterState::PreOp, MasterState::SafeOp]);

/// 0x6065: following error window, which every drive here has.
const OBJECT: ObjectAddress = ObjectAddress::new(0x6065, 0);

pub const CALLS: &[Call] = &[
    call("slot_size", Needs::Nothing, |ecm| ecm.slot_size().map(drop)),
    call("stats", Needs::Nothing, |ecm| ecm.stats().map(drop)),
    call("take_news", Needs::Nothing, |ecm| ecm.take_news().map(drop)),
    call("adopt", Needs::Nothing, |ecm| ecm.adopt(&config())),
    call("snapshot", Needs::Board, |ecm| ecm.snapshot().map(drop)),
    call("state", Needs::Board, |ecm| ecm.state().map(drop)),
    call("next_cycle", Needs::Board, |ecm| ecm.next_cycle(SECOND).map(drop)),
    call("configure", PREOP, |ecm| ecm.configure(&config())),
    call("set_state to Init", Needs::Board, |ecm| ecm.set_state(MasterState::Init)),
    call("set_state to PreOP", Needs::Board, |ecm| ecm.set_state(MasterState::PreOp)),
    call("set_state to OP", NOT_INIT, |ecm| ecm.set_state(MasterState::Op)),
    call("sdo_read", NOT_INIT, |ecm| ecm.sdo_read::<u32>(1, OBJECT).map(drop)),
    call("sdo_write", NOT_INIT, |ecm| ecm.sdo_write(2, OBJECT, 4000_u32)),
    call("servo_on", Needs::NoAlarm, |ecm| ecm.servo_on(&[1])),
    call("servo_off", Needs::Op, |ecm| ecm.servo_off(&[1])),
    call("clear_alarm", Needs::Op, |ecm| ecm.clear_alarm(&[1])),
    call("home", Needs::On, |ecm| ecm.home(1, &Homing::method(35), |_| {})),
    call("home_all", Needs::On, |ecm| ecm.home_all(&[(1, Homing::method(35))], |_| {})),
    call("abort_homing", Needs::Op, Ecm::abort_homing),
    call("inputs", Needs::Op, |ecm| ecm.inputs(3).map(drop)),
    call("set_outputs", Needs::Op, |ecm| ecm.set_outputs(3, 0x1234)),
    call("local_inputs", Needs::Board, |ecm| ecm.local_inputs().map(drop)),
    call("set_local_outputs", Needs::Board, |ecm| ecm.set_local_outputs(0x15)),
    call("set_crc", NOT_OP, |ecm| ecm.set_crc(CrcSwitches { check_commands: true, fill_responses: true })),
    call("clear_fifo", Needs::Op, Ecm::clear_fifo),
    call("stream", Needs::Op, |ecm| ecm.stream(8)?.finish().map(drop)),
    call("stream, step", Needs::Op, |ecm| {
        let mut stream = ecm.stream(8)?;
        (0..20).try_for_each(|_| stream.step().map(drop))?;
        stream.finish().map(drop)
    }),
    call("stream, csp, step", Needs::On, |ecm| {
        let mut stream = ecm.stream(8)?;
        let start = stream.snapshot()?.position(1).unwrap_or_default();
        for n in 0..50 {
            stream.csp(1, start + n * 20)?;
            stream.step()?;
        }
        stream.finish().map(drop)
    }),
    call("stream, prefill, step", Needs::Op, |ecm| {
        let mut stream = ecm.stream(8)?;
        stream.prefill(8)?;
        (0..20).try_for_each(|_| stream.step().map(drop))?;
        stream.finish().map(drop)
    }),
];

/// The first word of an error's next step.
const DEEDS: &[&str] = &[
    "abort",
    "call",
    "change",
    "check",
    "close",
    "configure",
    "correct",
    "give",
    "list",
    "look",
    "open",
    "plug",
    "put",
    "read",
    "remove",
    "see",
    "set",
    "start",
    "switch",
    "use",
    "wait",
    "widen",
];

/// Whether an error says what happened, and then what to do: a part of it begins with an action.
pub fn has_next_step(error: &EcmError) -> bool {
    let text = error.to_string();
    let parts = text.split("; ").flat_map(|part| part.split(": ")).skip(1);
    parts.into_iter().any(|part| DEEDS.contains(&part.split_whitespace().next().unwrap_or_default()))
}

pub fn options() -> Options {
    Options { state_limit: 20 * SECOND, ..Options::default() }
}

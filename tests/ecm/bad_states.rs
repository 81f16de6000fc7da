//! Every call of the native API in every state: a valid call works, another one ends with a typed error that says what
//! to do, and no command is sent that the board would reject.

use std::sync::Arc;
use std::sync::mpsc;

use crate::common::calls::{CALLS, Call, Needs, SLAVES, config, has_next_step, options};
use crate::common::{SECOND, SIZE, Tap, in_op, script};
use ecmsk::ecm::{Ecm, EcmError, Homing};
use ecmsk::link::{Link, LinkError, Wait};
use ecmsk::sk::{Frame, MasterCommand, MasterState};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Init,
    PreOp,
    SafeOp,
    Off,
    On,
    Alarm,
    Homing,
    Lost,
    Closed,
}

impl State {
    fn network(self) -> Option<MasterState> {
        match self {
            Self::Init => Some(MasterState::Init),
            Self::PreOp => Some(MasterState::PreOp),
            Self::SafeOp => Some(MasterState::SafeOp),
            Self::Off | Self::On | Self::Alarm | Self::Homing => Some(MasterState::Op),
            Self::Lost | Self::Closed => None,
        }
    }
}

/// The expected result of a call in a state: `None`, it works; else the name of the error.
fn expected(call: &Call, state: State) -> Option<&'static str> {
    let Some(network) = state.network() else {
        let lost = if state == State::Lost { "Lost" } else { "Closed" };
        return (call.needs != Needs::Nothing).then_some(lost);
    };
    let in_op = network == MasterState::Op;
    match (call.needs, state) {
        (Needs::Nothing | Needs::Board, _) => None,
        (Needs::States(states), _) => (!states.contains(&network)).then_some("WrongState"),
        _ if !in_op => Some("WrongState"),
        (Needs::Op, _) => None,
        (Needs::NoAlarm, State::Alarm) | (Needs::On, State::Alarm) => Some("Alarm"),
        (Needs::NoAlarm, State::Homing) => Some("IsHoming"),
        (Needs::NoAlarm, _) => None,
        (Needs::On, State::Off) => Some("NotEnabled"),
        (Needs::On, State::Homing) => Some(if call.name.starts_with("stream") { "IsHoming" } else { "Busy" }),
        (Needs::On, _) => None,
    }
}

fn name(error: &EcmError) -> &'static str {
    match error {
        EcmError::Link(LinkError::Lost { .. }) => "Lost",
        EcmError::Link(LinkError::Closed) => "Closed",
        EcmError::WrongState { .. } => "WrongState",
        EcmError::Alarm { .. } => "Alarm",
        EcmError::NotEnabled { .. } => "NotEnabled",
        EcmError::IsHoming { .. } => "IsHoming",
        EcmError::Busy { .. } => "Busy",
        _ => "another",
    }
}

/// A board in that state, which only the call changes.
fn board_in(state: State) -> (Arc<Tap>, Ecm) {
    let keys = match state {
        State::Alarm => {
            let file = script("bad-states-alarm", "at 1s alarm 1 0x7500\n");
            format!("{SLAVES}&script={file}")
        }
        _ => SLAVES.to_owned(),
    };
    let tap = Tap::open(&keys);
    let ecm = tap.ecm(options()).unwrap();
    match state {
        State::Init => {
            ecm.adopt(&config()).unwrap();
            ecm.set_state(MasterState::Init).unwrap();
        }
        State::PreOp => ecm.configure(&config()).unwrap(),
        State::SafeOp => {
            ecm.configure(&config()).unwrap();
            ecm.set_state(MasterState::SafeOp).unwrap();
        }
        _ => in_op(&ecm, &config()),
    }
    match state {
        State::On | State::Alarm | State::Homing | State::Lost | State::Closed => ecm.servo_on(&[1, 2]).unwrap(),
        _ => {}
    }
    match state {
        State::Alarm => while ecm.next_cycle(SECOND).unwrap().drive(1).unwrap().error_code == 0 {},
        State::Lost => {
            let mut frame = Frame::new();
            frame.put_master(SIZE, &MasterCommand::SoftReset);
            tap.write(&frame, Wait::Now).unwrap();
        }
        State::Closed => tap.close(),
        _ => {}
    }
    (tap, ecm)
}

fn check(call: &Call, state: State, tap: &Tap, ecm: &Ecm) {
    let what = format!("{} in {state:?}", call.name);
    let before = tap.pass(std::time::Duration::ZERO).ok().flatten();
    let given = (call.run)(ecm);
    match (&given, expected(call, state)) {
        (Ok(()), None) => {}
        (Err(error), Some(wanted)) => {
            assert_eq!(name(error), wanted, "{what}: {error}");
            assert!(has_next_step(error), "{what}: {error}");
        }
        (given, wanted) => panic!("{what}: {given:?} instead of {wanted:?}"),
    }
    if let (Some(before), Ok(Some(after))) = (before, tap.pass(std::time::Duration::ZERO)) {
        let took = std::time::Duration::from_nanos(after.0 - before.0);
        assert!(took < 30 * SECOND, "{what} took {took:?}");
    }
    let board = tap.stats().board.unwrap();
    let silent = (board.rejected_total(), board.ignored_homing, board.discarded_before_enabled, board.full);
    assert_eq!(silent, (0, 0, 0, 0), "{what}: the board rejected something: {board:?}");
}

fn each_call(state: State) {
    for call in CALLS {
        let (tap, ecm) = board_in(state);
        check(call, state, &tap, &ecm);
    }
}

/// API-23 SK-4.63 Init: the board would reject a change to SafeOP or OP.
#[test]
fn every_call_in_init_works_or_says_why_not() {
    each_call(State::Init);
}

/// API-23 PreOP, configured.
#[test]
fn every_call_in_preop_works_or_says_why_not() {
    each_call(State::PreOp);
}

/// API-23 SafeOP.
#[test]
fn every_call_in_safeop_works_or_says_why_not() {
    each_call(State::SafeOp);
}

/// API-23 OP, all axes off.
#[test]
fn every_call_in_op_with_axes_off_works_or_says_why_not() {
    each_call(State::Off);
}

/// API-23 OP, all axes on: every call that does not need another state works.
#[test]
fn every_call_in_op_with_axes_on_works() {
    each_call(State::On);
}

/// API-23 OP, the axis has an alarm.
#[test]
fn every_call_on_an_axis_with_an_alarm_works_or_says_why_not() {
    each_call(State::Alarm);
}

/// API-17 API-23 The board was reset by somebody.
#[test]
fn every_call_on_a_lost_board_says_so() {
    each_call(State::Lost);
}

/// API-23 The link was closed by somebody.
#[test]
fn every_call_on_a_closed_link_says_so() {
    each_call(State::Closed);
}

/// API-23 The axis homes, in a call of another thread.
#[test]
fn every_call_while_an_axis_homes_works_or_says_why_not() {
    let slow = Homing { switch_speed: Some(1), limit: 60 * SECOND, ..Homing::method(17) };
    for call in CALLS {
        let (tap, ecm) = board_in(State::Homing);
        let (moving, is_moving) = mpsc::channel();
        std::thread::scope(|scope| {
            let homing = scope.spawn(|| {
                ecm.home(1, &slow, |progress| {
                    if progress.phase == ecmsk::ecm::HomingPhase::Moving {
                        moving.send(()).ok();
                    }
                })
            });
            is_moving.recv().unwrap();
            check(call, State::Homing, &tap, &ecm);
            let ended = if ecm.state().unwrap().state() == Some(MasterState::Op) { ecm.abort_homing() } else { Ok(()) };
            assert!(ended.is_ok() || homing.is_finished(), "{}: {ended:?}", call.name);
            let error = homing.join().unwrap().unwrap_err();
            assert!(has_next_step(&error), "{}: {error}", call.name);
        });
    }
}

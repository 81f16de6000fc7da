//! Waits that the program ends: which calls ask, and what they have undone when they return.

use std::sync::Arc;
use std::sync::atomic::{AtomicI32, Ordering};

use crate::common::{Tap, enabled, in_op, open};
use ecmsk::cia402::MODES_OF_OPERATION;
use ecmsk::coe::ObjectAddress;
use ecmsk::ecm::{Config, Ecm, EcmError, Homing, HomingPhase, Options};
use ecmsk::link::{Dir, LinkError};
use ecmsk::sk::{CommandId, MasterState};

/// A board whose waits are interrupted once, by the `n`-th question after the counter was set to `n`.
fn interrupted(ecm: Ecm) -> (Ecm, Arc<AtomicI32>) {
    let left = Arc::new(AtomicI32::new(0));
    let counter = Arc::clone(&left);
    (ecm.with_interrupt(move || counter.fetch_sub(1, Ordering::Relaxed) == 1), left)
}

/// A call that waits for more than a report ends, and the board is as usable as before.
#[test]
fn each_wait_ends_and_the_board_goes_on() {
    let (ecm, left) = interrupted(open("slaves=drive,io"));
    let device_type = ObjectAddress::new(0x1000, 0);
    let calls: [&dyn Fn() -> Result<(), EcmError>; 3] =
        [&|| ecm.sdo_read::<u32>(1, device_type).map(drop), &|| ecm.set_state(MasterState::Init), &|| {
            ecm.set_state(MasterState::PreOp)
        }];
    for call in calls {
        left.store(1, Ordering::Relaxed);
        assert_eq!(call(), Err(EcmError::Interrupted));
        assert_eq!(call(), Ok(()));
    }
}

/// An axis that was being switched on is off when the call returns, and does not come on by itself.
#[test]
fn an_interrupted_servo_on_leaves_the_axis_off() {
    let (tap, ecm) = Tap::enabled("slaves=drive*2", &Config::drives(2));
    let (ecm, left) = interrupted(ecm);
    ecm.servo_off(&[2]).unwrap();
    tap.take();
    left.store(3, Ordering::Relaxed);
    assert_eq!(ecm.servo_on(&[1, 2]), Err(EcmError::Interrupted));
    assert!(tap.take_slots(2).iter().any(|slot| slot.id == CommandId::ServoOff.code()));
    crate::common::cycles(&ecm, 500);
    let snapshot = ecm.snapshot().unwrap();
    let is_on = |slave| snapshot.drive(slave).unwrap().statusword.is_enabled();
    assert_eq!([is_on(1), is_on(2)], [true, false], "an axis that was on before stays on");
}

/// The same if another thread cancels the call on its link, which goes on working.
#[test]
fn a_cancelled_servo_on_leaves_the_axis_off() {
    let (tap, ecm) = Tap::enabled("slaves=drive*2", &Config::drives(2));
    ecm.servo_off(&[2]).unwrap();
    let left = Arc::new(AtomicI32::new(0));
    let (counter, cancelled) = (Arc::clone(&left), Arc::clone(&tap));
    let ecm = ecm.with_interrupt(move || {
        cancelled.cancel.fetch_or(counter.fetch_sub(1, Ordering::Relaxed) == 1, Ordering::Relaxed);
        false
    });
    tap.take();
    left.store(3, Ordering::Relaxed);
    assert_eq!(ecm.servo_on(&[1, 2]), Err(EcmError::Link(LinkError::Cancelled { dir: Dir::Read })));
    assert!(tap.take_slots(2).iter().any(|slot| slot.id == CommandId::ServoOff.code()));
    crate::common::cycles(&ecm, 500);
    let snapshot = ecm.snapshot().unwrap();
    let is_on = |slave| snapshot.drive(slave).unwrap().statusword.is_enabled();
    assert_eq!([is_on(1), is_on(2)], [true, false]);
}

/// An axis that looks for its home stands when the call returns, and takes targets again.
#[test]
fn an_interrupted_homing_is_aborted() {
    let (ecm, left) = interrupted(enabled("slaves=drive", &Config::drives(1)));
    let ended = ecm.home(1, &Homing::method(17), |progress| {
        if progress.phase == HomingPhase::Moving {
            left.store(1, Ordering::Relaxed);
        }
    });
    assert_eq!(ended, Err(EcmError::Interrupted));
    assert_eq!(ecm.sdo_read::<u8>(1, ObjectAddress::new(MODES_OF_OPERATION, 0)), Ok(8));
    let at = || ecm.snapshot().unwrap().position(1).unwrap();
    crate::common::cycles(&ecm, 500);
    let before = at();
    crate::common::cycles(&ecm, 100);
    assert!((at() - before).abs() < 50);
}

/// The end of a stream and the closing of a board are stops, which nothing interrupts.
#[test]
fn a_stop_is_not_interrupted() {
    let ecm = Ecm::open_with("sim:?slaves=drive&clock=virtual", Options::default()).unwrap();
    let (ecm, left) = interrupted(ecm);
    in_op(&ecm, &Config::drives(1));
    ecm.servo_on(&[1]).unwrap();
    let mut stream = ecm.stream(16).unwrap();
    for n in 0..200 {
        stream.csp(1, n * 50).unwrap();
        left.store(1, Ordering::Relaxed);
        stream.step().unwrap();
    }
    left.store(1, Ordering::Relaxed);
    assert_eq!(stream.finish().map(|stats| stats.underruns), Ok(0));
    assert_eq!(left.load(Ordering::Relaxed), 1, "a stream asked");
}

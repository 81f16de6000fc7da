//! Motions on the machine's clock. A busy machine may be late for its slaves, which then leave OP: that is reported,
//! and the motion is repeated. No axis ever leaves its path, and each reaches its end.

use ecmsk::ecm::{Ecm, EcmError, SlaveView, Snapshot};
use ecmsk::sk::MasterState;

/// How often a motion that was reported as failed is repeated: no machine is late so often.
const TRIES: usize = 20;
/// How far a simulated drive may be from its target, counts.
const NEAR: i32 = 4;
/// So many steps at the end hold the last targets, until late outputs have arrived.
const HELD: i32 = 50;

/// The position of an axis, for an HSP of its first one.
fn position(snapshot: &Snapshot, slave: u8) -> i32 {
    match snapshot.slave(slave) {
        Some(SlaveView::Hsp(hsp)) => hsp.first.position,
        _ => snapshot.position(slave).expect("an axis has a position"),
    }
}

/// Moves axes, each by that many counts per step, from their positions; calls `happens` before each step. Returns how
/// many attempts were reported as failed.
///
/// # Panics
/// An axis leaves its path, does not end at its target, or the motion never ends.
pub fn arrive(ecm: &Ecm, axes: &[(u8, i32)], steps: i32, mut happens: impl FnMut(i32)) -> usize {
    let mut told = Vec::new();
    while told.len() < TRIES {
        match once(ecm, axes, steps, &mut happens) {
            Ok(()) => return told.len(),
            Err(error) => told.push(error),
        }
        println!("told: {}", told[told.len() - 1]);
        switch_on(ecm, &axes.iter().map(|(slave, _)| *slave).collect::<Vec<_>>());
    }
    panic!("never at the end of the way: {told:?}");
}

fn once(ecm: &Ecm, axes: &[(u8, i32)], steps: i32, happens: &mut impl FnMut(i32)) -> Result<(), EcmError> {
    let snapshot = ecm.snapshot()?;
    let ways: Vec<(u8, i32, i32)> =
        axes.iter().map(|(slave, counts)| (*slave, position(&snapshot, *slave), *counts)).collect();
    let mut stream = ecm.stream(20)?;
    for n in 1..=steps + HELD {
        happens(n);
        for (slave, start, counts) in &ways {
            stream.csp(*slave, start + counts * n.min(steps))?;
        }
        stream.step()?;
        let snapshot = stream.snapshot()?;
        for (slave, start, counts) in &ways {
            let (at, gone) = (position(&snapshot, *slave) - start, counts * n.min(steps));
            // A motor that was stopped at once overshoots by less than a step.
            let over = at * counts.signum() - gone.abs();
            let is_on_its_way = at * counts.signum() >= -NEAR && over <= counts.abs() + NEAR;
            assert!(is_on_its_way, "slave {slave} is {at} counts from its start, and was sent no farther than {gone}");
        }
    }
    stream.finish()?;
    let snapshot = ecm.snapshot()?;
    for (slave, start, counts) in &ways {
        let left = position(&snapshot, *slave) - start - counts * steps;
        assert!(left.abs() <= NEAR, "slave {slave} is {left} counts from its end");
    }
    Ok(())
}

/// Brings the slaves to OP, and switches axes on.
///
/// # Panics
/// They never get there.
pub fn switch_on(ecm: &Ecm, axes: &[u8]) {
    let mut told = Vec::new();
    while told.len() < TRIES {
        match ecm.set_state(MasterState::Op).and_then(|()| ecm.servo_on(axes)) {
            Ok(()) => return,
            Err(error) => told.push(error),
        }
    }
    panic!("never on: {told:?}");
}

//! The watchdog of process data, which stops slaves when the master is gone.

use ecmsk::ethercat::registers::{WATCHDOG_DIVIDER, WATCHDOG_PROCESS_DATA};
use ecmsk::ethercat::{AlState, AlStatus, Command, DatagramHeader, FrameHeader, FrameWriter, Ns, each_datagram};
use ecmsk::master::{Pace, StateError, StateReason};
use ecmsk::sk::DriveSync;
use ecmsk::slave::esc::{Chain, EscSettings};

use super::rig::{CYCLE, MS, Rig, STEP, slave};

const KINDS: [&str; 2] = ["drive", "io"];

/// Another master writes registers of all slaves.
fn write_all(rig: &mut Rig, ado: u16, value: u16) {
    let mut buffer = [0; 60];
    let mut frame = FrameWriter::new(&mut buffer, FrameHeader::datagrams([0x20; 6])).expect("room");
    frame.push(DatagramHeader::register(Command::Bwr, 0, 0, ado), &value.to_le_bytes()).expect("room");
    frame.finish();
    let now = rig.net.now;
    rig.net.chain.process(&mut buffer, now);
}

/// The watchdog registers of a slave, counted from 0.
fn registers(rig: &Rig, slave: usize) -> [u16; 2] {
    [WATCHDOG_DIVIDER, WATCHDOG_PROCESS_DATA].map(|register| {
        let bytes = rig.net.chain.slave(slave).controller().peek(register, 2);
        u16::from_le_bytes([bytes[0], bytes[1]])
    })
}

/// Kills the program: no frame comes any more. Returns how long each slave stays in OP after the last frame.
pub fn killed(rig: &mut Rig) -> Vec<Ns> {
    let last_frame = rig.next_cycle.expect("there are cycles") - CYCLE;
    let mut left = vec![None; rig.net.chain.len()];
    while rig.net.now < last_frame + 2_000 * MS {
        rig.net.now += STEP;
        rig.net.chain.advance(rig.net.now);
        for (n, left) in left.iter_mut().enumerate() {
            if left.is_none() && rig.net.chain.slave(n).state() < AlState::Op {
                *left = Some(rig.net.now - last_frame);
            }
        }
    }
    left.into_iter().map(|left| left.unwrap_or(Ns::MAX)).collect()
}

fn paced(cycle_ms: u64) -> Option<Pace> {
    Some(Pace { cycle_ns: cycle_ms * MS, phase_ns: 0 })
}

/// MASTER-3.6 A slave leaves OP 100 ms after the last frame, or after three cycles if those are longer, whatever another program has left
/// in its registers since the scan.
#[test]
fn a_killed_master_is_missed_in_time() {
    for (cycle_ms, stays_ms) in [(1, 100), (33, 100), (34, 102), (200, 600)] {
        for (divider, units) in [(2498, 1000), (u16::MAX, 1000), (0, 1000), (2498, 0), (u16::MAX, u16::MAX), (0, 1)] {
            let mut rig = Rig::scanned(&KINDS);
            write_all(&mut rig, WATCHDOG_DIVIDER, divider);
            write_all(&mut rig, WATCHDOG_PROCESS_DATA, units);
            rig.master.set_pace(paced(cycle_ms));
            rig.bring_to_op(&KINDS);
            for after in killed(&mut rig) {
                assert!(
                    (stays_ms * MS..=stays_ms * MS + STEP).contains(&after),
                    "{cycle_ms} ms, {divider}, {units}: {after} ns"
                );
            }
        }
    }
}

/// MASTER-3.6 The scan sets the default watchdogs; if no cycle time is set, later values of a user stay.
#[test]
fn without_a_pace_watchdogs_are_those_of_the_scan() {
    let mut rig = Rig::line(&KINDS);
    write_all(&mut rig, WATCHDOG_DIVIDER, 0);
    write_all(&mut rig, WATCHDOG_PROCESS_DATA, 0);
    rig.scan();
    assert_eq!([0, 1].map(|slave| registers(&rig, slave)), [[2498, 1000]; 2]);
    write_all(&mut rig, WATCHDOG_PROCESS_DATA, 2500);
    rig.bring_to_op(&KINDS);
    assert_eq!(registers(&rig, 0), [2498, 2500]);
    assert!(killed(&mut rig).iter().all(|after| (250 * MS..=250 * MS + STEP).contains(after)));
}

/// MASTER-3.6 With a fixed divider, the time is the nearest possible one that is not longer; a time shorter than three
/// cycles is refused with the value as the only reason.
#[test]
fn a_divider_that_is_fixed_is_reckoned_with() {
    let fixed = |divider, cycle_ms| {
        let settings = EscSettings { fixed_watchdog_divider: Some(divider), ..EscSettings::default() };
        let mut rig = Rig::of(Chain::line([slave("drive", EscSettings::default()), slave("drive", settings)]));
        rig.scan();
        rig.master.set_pace(paced(cycle_ms));
        rig.reach(AlState::PreOp);
        (1..=2).for_each(|slave| rig.map(slave, "drive", DriveSync::FreeRun));
        rig
    };
    // Units of 100 us, 1 ms, 2.6 ms, 80 ns.
    for (divider, units) in [(2498, 1000), (24_998, 100), (u16::MAX, 38), (0, u16::MAX)] {
        let mut rig = fixed(divider, 1);
        rig.reach(AlState::SafeOp);
        rig.next_cycle = Some(rig.net.now);
        rig.reach(AlState::Op);
        assert_eq!([0, 1].map(|slave| registers(&rig, slave)), [[2498, 1000], [divider, units]]);
        rig.run_for(3 * CYCLE);
        let stays = Ns::from(units) * (Ns::from(divider) + 2) * 40;
        let after = killed(&mut rig)[1];
        assert!((stays..=stays + STEP).contains(&after) && stays <= 100 * MS, "{divider}: {after} ns");
    }
    let mut rig = fixed(0, 2);
    let reason = StateReason::Watchdog { is_ns: 5_242_800, wanted_ns: 100 * MS };
    assert_eq!(rig.request(rig.all(), AlState::SafeOp), Err(StateError { slave: 2, target: AlState::SafeOp, reason }));
    assert_eq!(reason.code(), AlStatus::INVALID_WATCHDOG);
    assert_eq!(rig.net.chain.slave(1).state(), AlState::PreOp);
    let told = StateError { slave: 2, target: AlState::SafeOp, reason }.to_string();
    assert!(told.contains("slave 2") && told.contains("0x0400") && told.contains("5242 us"), "{told}");
    assert!(!told.contains("cable"), "{told}");
}

/// MASTER-3.6 A slave whose controller has no such registers is used as it is; one that does not answer is reported as
/// silent.
#[test]
fn a_slave_without_a_watchdog_is_taken() {
    for is_gone in [false, true] {
        let mut rig = Rig::scanned(&["drive"]);
        rig.master.set_pace(paced(1));
        rig.reach(AlState::PreOp);
        rig.map(1, "drive", DriveSync::FreeRun);
        rig.net.hostile = Some(Box::new(move |frame| {
            let changed = each_datagram(frame, |mut datagram| {
                let ado = datagram.header().ado();
                if is_gone && ado >= 0x0400 || (0x0400..0x0440).contains(&ado) || is_gone && ado == 0 {
                    datagram.count(datagram.working_counter().wrapping_neg());
                }
            });
            assert!(changed.is_ok());
        }));
        let error = StateError { slave: 1, target: AlState::SafeOp, reason: StateReason::NoAnswer };
        let expected = if is_gone { Err(error) } else { Ok(()) };
        assert_eq!(rig.request(rig.all(), AlState::SafeOp), expected);
    }
}

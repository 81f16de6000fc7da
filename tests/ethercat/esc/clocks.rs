//! Distributed clocks.

use ecmsk::ethercat::registers::{self, SystemTimeDifference};
use ecmsk::ethercat::sii::{CategoryKind, Sii};
use ecmsk::ethercat::{AlState, AlStatus, Command, Ns};
use ecmsk::slave::esc::{EscSettings, EscSlave, HOP_NS, OP_WAIT_NS, SLEW_MAX_NS, eeprom_of};
use ecmsk::slave::{Io, IoConfig};

use super::rig::{FIRST, MS, Rig, US, drive, slave};

fn clock(local_time_ns: u64, drift_ppb: i32) -> EscSettings {
    EscSettings { local_time_ns, drift_ppb, ..EscSettings::default() }
}

/// Receive times of ports 0 and 1.
fn receive_times(rig: &mut Rig, station: u16) -> [u32; 2] {
    [0, 1].map(|port| rig.read_u32(station, registers::receive_time(port)))
}

/// ECAT-13.1 A write to 0x0900 keeps the local times at which its frame passed: at the processing unit and at each port; from
/// them a master computes the delays along the cable.
#[test]
fn s37_receive_times_tell_delays() {
    let mut rig =
        Rig::new([drive(clock(7_000_000_000, 0)), drive(clock(1, 0)), drive(clock(u64::from(u32::MAX) - 500, 0))]);
    rig.chain.set_hop(2, 450);
    rig.give_stations();
    assert_eq!(rig.one(Command::Bwr, 0, registers::RECEIVE_TIMES, &[0; 4]).wkc, 3);
    for (n, local) in [7_000_000_000, 1, u64::from(u32::MAX) - 500].into_iter().enumerate() {
        let arrival = [0, HOP_NS, HOP_NS + 450][n];
        let unit = rig.read_u64(FIRST + n as u16, registers::RECEIVE_TIME_UNIT);
        assert_eq!(unit, local + (MS + 4 * 100 * US) + arrival);
        assert_eq!(receive_times(&mut rig, FIRST + n as u16)[0], unit as u32);
    }
    let around = [0, 1].map(|n| {
        let [port0, port1] = receive_times(&mut rig, FIRST + n);
        port1.wrapping_sub(port0)
    });
    assert_eq!(around.map(u64::from), [2 * (HOP_NS + 450), 2 * 450]);
    // As masters compute the delay: half of the round trip minus the time behind the slave.
    assert_eq!((around[0] - around[1]) / 2, HOP_NS as u32);
    assert_eq!(rig.one(Command::Fprd, FIRST, registers::RECEIVE_TIMES, &[0; 16]).wkc, 1);
    // Reading and other writes leave the times.
    let before = receive_times(&mut rig, FIRST);
    rig.write(FIRST, registers::SYSTEM_TIME_DELAY, &[1, 0, 0, 0]);
    assert_eq!(receive_times(&mut rig, FIRST), before);
}

/// ECAT-13.1 In a tree each port has the time at which the frame came back from its branch.
#[test]
fn s37_receive_times_of_branches() {
    let settings = || EscSettings { ports: [3; 4], ..EscSettings::default() };
    let mut rig = Rig::new([drive(settings())]);
    for (port, hop_ns) in [(1, 100), (2, 200), (3, 300)] {
        let n = rig.chain.add(drive(settings()), 0, port);
        rig.chain.set_hop(n, hop_ns);
    }
    rig.one(Command::Bwr, 0, registers::RECEIVE_TIMES, &[0; 4]);
    let times = rig.one(Command::Aprd, 0, registers::RECEIVE_TIMES, &[0; 16]);
    let times: Vec<u32> = times.data.as_chunks().0.iter().map(|time| u32::from_le_bytes(*time)).collect();
    // Ports 3, 1, 2 in this order.
    assert_eq!([3, 1, 2].map(|port| times[port] - times[0]), [600, 800, 1200]);
}

/// Sets offsets and delays as masters do: all clocks show the time of the master.
fn synchronize(rig: &mut Rig, master: u64) {
    rig.one(Command::Bwr, 0, registers::RECEIVE_TIMES, &[0; 4]);
    for n in 0..rig.chain.len() as u16 {
        let unit = rig.read_u64(FIRST + n, registers::RECEIVE_TIME_UNIT);
        rig.write(FIRST + n, registers::SYSTEM_TIME_OFFSET, &master.wrapping_sub(unit).to_le_bytes());
        rig.write(FIRST + n, registers::SYSTEM_TIME_DELAY, &(u32::from(n) * HOP_NS as u32).to_le_bytes());
    }
}

/// The difference that a slave shows, ns.
fn difference(rig: &mut Rig, station: u16) -> i64 {
    SystemTimeDifference(rig.read_u32(station, registers::SYSTEM_TIME_DIFFERENCE)).ahead_ns()
}

/// ECAT-13.2 A received system time changes a clock by no more than the limit, whatever it is; clocks that drift by 100 ppm are
/// held within a microsecond by a time each millisecond.
#[test]
fn s38_clocks_are_slewed_and_never_jump() {
    let mut rig =
        Rig::with_stations([drive(clock(5_000, 0)), drive(clock(9_999_999, 100_000)), drive(clock(0, -100_000))]);
    rig.write(FIRST + 1, registers::TIME_DIFFERENCE_FILTER, &[0]);
    rig.write(FIRST + 2, registers::TIME_DIFFERENCE_FILTER, &[0]);
    synchronize(&mut rig, 800_000_000_000_000_000);
    // What masters write at their start.
    assert_eq!(rig.one(Command::Bwr, 0, registers::SYSTEM_TIME, &[0; 4]).wkc, 3);
    rig.now += MS;
    synchronize(&mut rig, 800_000_000_000_000_000);

    rig.pause = MS;
    let mut worst = [0; 2];
    for turn in 0..1000 {
        assert_eq!(rig.one(Command::Frmw, FIRST, registers::SYSTEM_TIME, &[0; 8]).wkc, 3);
        if turn % 100 == 99 {
            for (worst, n) in worst.iter_mut().zip(1..) {
                *worst = difference(&mut rig, FIRST + n).abs().max(*worst);
            }
        }
    }
    assert!(worst.iter().all(|worst| *worst < 1_000), "{worst:?}");
    assert!(worst.iter().all(|worst| *worst > 0), "they do drift: {worst:?}");
}

/// ECAT-13.2 One time, however wrong, moves a clock by the limit and not at once.
#[test]
fn s38_one_wrong_time_moves_a_clock_by_the_limit() {
    for wrong in [0u32, 1, u32::MAX, 0x8000_0000, 123_456_789] {
        let mut rig = Rig::with_stations([drive(clock(50_000_000, 0))]);
        let system = |rig: &mut Rig| {
            rig.chain.advance(rig.now);
            rig.chain.slave(0).controller().system_time_ns() as i64
        };
        let before = system(&mut rig);
        let begin = rig.now;
        rig.write(FIRST, registers::SYSTEM_TIME, &wrong.to_le_bytes());
        let mut last = before;
        for _ in 0..50 {
            rig.now += 10 * US;
            let now = system(&mut rig);
            assert!(now > last, "time never goes back");
            last = now;
            let moved = now - before - (rig.now - begin) as i64;
            assert!(moved.abs() <= SLEW_MAX_NS, "{moved} ns");
        }
        let moved = last - before - (rig.now - begin) as i64;
        assert_eq!(moved.abs(), SLEW_MAX_NS);
    }
}

/// ECAT-13.2 The difference is averaged according to the filter, and a write to the speed counter restarts it.
#[test]
fn the_difference_is_filtered() {
    let mut rig = Rig::drives(2);
    // 16 us ahead; each received time corrects at most 1 us.
    rig.write(FIRST, registers::SYSTEM_TIME_OFFSET, &16_000u64.to_le_bytes());
    rig.write(FIRST, registers::SYSTEM_TIME_DELAY, &(HOP_NS as u32).to_le_bytes());
    rig.write(FIRST, registers::SYSTEM_TIME_DELAY, &0u32.to_le_bytes());
    rig.write(FIRST, registers::TIME_DIFFERENCE_FILTER, &[4]);
    let time = |rig: &mut Rig| rig.read_u64(FIRST + 1, registers::SYSTEM_TIME);
    let ahead = time(&mut rig) as u32;
    rig.write(FIRST, registers::SYSTEM_TIME, &ahead.wrapping_add(100_000).to_le_bytes());
    let shown = difference(&mut rig, FIRST);
    assert!((900..1_100).contains(&shown), "a sixteenth of 16 us: {shown}");
    rig.write(FIRST, registers::SPEED_COUNTER_START, &[0, 0x10]);
    assert_eq!(difference(&mut rig, FIRST), 0);
}

/// The unit for SYNC0: a start time, a cycle, and the activation.
fn activate(rig: &mut Rig, start: u64, cycle_ns: u32, activation: u8) {
    rig.write(FIRST, registers::SYNC_ACTIVATION, &[0]);
    rig.write(FIRST, registers::SYNC0_START, &start.to_le_bytes());
    rig.write(FIRST, registers::SYNC0_CYCLE, &cycle_ns.to_le_bytes());
    rig.write(FIRST, registers::CYCLIC_UNIT_CONTROL, &[0, activation]);
}

/// The time at which the next frame comes, as slaves without drift and offset see it.
const fn soon(rig: &Rig, after: Ns) -> u64 {
    rig.now + after
}

/// ECAT-13.3 SYNC0 comes first at the start time and then with its cycle, until it is switched off; a start time in the past
/// gives none.
#[test]
fn s39_sync0_begins_at_its_start_time() {
    let mut rig = Rig::drives(1);
    let start = soon(&rig, 10 * MS);
    activate(&mut rig, start, 1_000_000, 3);
    assert_eq!(rig.read_u8(FIRST, registers::SYNC_ACTIVATION_STATUS), 1);
    assert_eq!(rig.read_u64(FIRST, registers::SYNC0_START), start);
    // The frame that comes a moment before the pulse, and the one that comes with it.
    rig.now = start - 100 * US - 1;
    assert_eq!((rig.read_u8(FIRST, registers::SYNC0_STATUS), rig.now), (0, start - 1));
    rig.now = start - 100 * US;
    assert_eq!((rig.read_u8(FIRST, registers::SYNC0_STATUS), rig.now), (1, start));
    assert_eq!(rig.read_u8(FIRST, registers::SYNC_ACTIVATION_STATUS), 0);
    assert_eq!(rig.read_u64(FIRST, registers::SYNC0_START), start + MS);
    rig.now = start + 20 * MS;
    assert_eq!(rig.read_u64(FIRST, registers::SYNC0_START), start + 21 * MS);
    assert_eq!(rig.read_u32(FIRST, registers::AL_EVENT) & 0b100, 0b100);
    rig.write(FIRST, registers::SYNC_ACTIVATION, &[0]);
    rig.now += 20 * MS;
    assert_eq!(rig.read_u8(FIRST, registers::SYNC_ACTIVATION_STATUS), 0);

    let mut rig = Rig::drives(1);
    let past = rig.now - 1;
    activate(&mut rig, past, 1_000_000, 3);
    rig.now += 100 * MS;
    assert_eq!(rig.read_u8(FIRST, registers::SYNC0_STATUS), 0);
    assert_eq!(
        rig.read_u8(FIRST, registers::SYNC_ACTIVATION_STATUS),
        4,
        "none is pending, and the start was in the past"
    );
}

/// ECAT-13.3 With a cycle of 0 there is one pulse; SYNC1 follows SYNC0 by its own time.
#[test]
fn s39_one_pulse_and_sync1() {
    let mut rig = Rig::drives(1);
    let start = soon(&rig, 10 * MS);
    activate(&mut rig, start, 0, 3);
    rig.now += 50 * MS;
    assert_eq!(rig.read_u8(FIRST, registers::SYNC0_STATUS), 1);
    assert_eq!(rig.read_u64(FIRST, registers::SYNC0_START), start, "none comes after it");

    let mut rig = Rig::drives(1);
    rig.write(FIRST, registers::SYNC1_CYCLE, &1_200_000u32.to_le_bytes());
    let start = soon(&rig, 10 * MS);
    activate(&mut rig, start, 1_000_000, 7);
    assert_eq!(rig.read_u8(FIRST, registers::SYNC_ACTIVATION_STATUS), 3);
    assert_eq!(rig.read_u64(FIRST, registers::SYNC1_NEXT), start + 1_200_000);
    rig.now = start + 1_200_000;
    // Its period is that of SYNC0, as often as it fits into the delay, and once more.
    assert_eq!(rig.read_u64(FIRST, registers::SYNC1_NEXT), start + 1_200_000 + 2 * MS);
    assert_eq!(rig.read_u8(FIRST, registers::SYNC1_STATUS), 1);
}

/// ECAT-13.9 The start time is checked: bit 2 of 0x0984 shows one that is not in the near future, which bit 6 of the
/// activation sets to 2.1 s; with bit 5 SYNC0 comes at once then.
#[test]
fn the_start_time_is_judged() {
    for (after, activation, out_of_range, comes_at_once) in [
        (MS as i64 * 10, 0x03, false, false),
        (MS as i64 * 10, 0x63, false, false),
        (-1, 0x03, true, false),
        (-1, 0x23, true, true),
        (MS as i64 * 5000, 0x03, false, false),
        (MS as i64 * 5000, 0x23, false, false),
        (MS as i64 * 5000, 0x43, true, false),
        (MS as i64 * 5000, 0x63, true, true),
        (MS as i64 * 2000, 0x63, false, false),
    ] {
        let mut rig = Rig::drives(1);
        let start = (rig.now + 4 * rig.pause).wrapping_add_signed(after);
        activate(&mut rig, start, 1_000_000, activation);
        rig.pause = 10;
        let status = rig.read_u8(FIRST, registers::SYNC_ACTIVATION_STATUS);
        assert_eq!(status & 4 != 0, out_of_range, "{after} {activation:02X}");
        let came = rig.read_u8(FIRST, registers::SYNC0_STATUS);
        assert_eq!(came == 1, comes_at_once, "{after} {activation:02X}");
    }
}

/// ECAT-13.9 Bit 3: the unit starts when the last byte of the start time was written. Bit 4: that is the fourth one,
/// and the upper four come from the clock. Bit 7: one pulse at once, and the bit reads 0.
#[test]
fn further_bits_of_the_activation() {
    let mut rig = Rig::with_stations([drive(EscSettings { local_time_ns: 7 << 32, ..EscSettings::default() })]);
    rig.write(FIRST, registers::SYNC0_CYCLE, &1_000_000_u32.to_le_bytes());
    rig.write(FIRST, registers::SYNC_ACTIVATION, &[0x0A]);
    let start = (7 << 32) + rig.now + 50 * MS;
    rig.write(FIRST, registers::SYNC0_START, &start.to_le_bytes()[..7]);
    assert_eq!(rig.read(FIRST, registers::SYNC_ACTIVATION, 1), [0x0A]);
    rig.write(FIRST, registers::SYNC0_START, &start.to_le_bytes());
    assert_eq!(rig.read(FIRST, registers::SYNC_ACTIVATION, 1), [0x0B]);
    assert_eq!(rig.read_u64(FIRST, registers::SYNC0_START), start);

    rig.write(FIRST, registers::SYNC_ACTIVATION, &[0x1A]);
    let start = start + 20 * MS;
    rig.write(FIRST, registers::SYNC0_START + 4, &[0xFF; 4]);
    rig.write(FIRST, registers::SYNC0_START, &start.to_le_bytes()[..4]);
    assert_eq!(rig.read(FIRST, registers::SYNC_ACTIVATION, 1), [0x1B]);
    assert_eq!(rig.read_u64(FIRST, registers::SYNC0_START), start);

    for (activation, statuses) in [(0x80, [0, 0]), (0x82, [1, 0]), (0x86, [1, 1])] {
        let mut rig = Rig::drives(1);
        rig.write(FIRST, registers::SYNC_ACTIVATION, &[activation]);
        assert_eq!(rig.read(FIRST, registers::SYNC_ACTIVATION, 1), [activation & 0x7F]);
        assert_eq!(rig.read(FIRST, registers::SYNC0_STATUS, 2), statuses);
    }
    // A controller that is not enhanced knows bits 0 to 2.
    let features = registers::Features::CLOCK | registers::Features::CLOCK_64_BITS;
    let mut rig = Rig::with_stations([drive(EscSettings { features, ..EscSettings::default() })]);
    rig.write(FIRST, registers::SYNC_ACTIVATION, &[0xFA]);
    assert_eq!(rig.read(FIRST, registers::SYNC_ACTIVATION, 1), [0x02]);
    assert_eq!(rig.read(FIRST, registers::SYNC0_STATUS, 2), [0, 0]);
}

/// ECAT-13.10 A clock of 32 bits shows no upper halves. Its SYNC0 starts when the lower half of the start time is reached.
#[test]
fn a_clock_of_32_bits() {
    let features = EscSettings::default().features.without(registers::Features::CLOCK_64_BITS);
    let settings = EscSettings { features, ..clock((7 << 32) - 3 * MS, 0) };
    let mut rig = Rig::with_stations([drive(settings)]);
    for _ in 0..2 {
        rig.one(Command::Bwr, 0, registers::RECEIVE_TIMES, &[0; 4]);
        for register in [registers::SYSTEM_TIME, registers::RECEIVE_TIME_UNIT] {
            assert!(rig.read_u64(FIRST, register) <= u32::MAX.into());
        }
        rig.now += 5 * MS;
    }
    let start = rig.read_u64(FIRST, registers::SYSTEM_TIME) + 10 * MS;
    rig.write(FIRST, registers::SYNC0_START, &(start | 0x1234 << 32).to_le_bytes());
    rig.write(FIRST, registers::SYNC0_CYCLE, &1_000_000_u32.to_le_bytes());
    rig.write(FIRST, registers::SYNC_ACTIVATION, &[3]);
    assert_eq!(rig.read_u64(FIRST, registers::SYNC0_START), start);
    rig.now += 12 * MS;
    let next = rig.read_u64(FIRST, registers::SYNC0_START);
    assert!((start + 2 * MS..start + 4 * MS).contains(&next) && (next - start).is_multiple_of(MS), "{start} {next}");
}

/// ECAT-13.9 With bit 0 of 0x0980 the unit belongs to the slave's own controller: the master cannot write its settings.
#[test]
fn a_unit_of_the_slaves_own_controller() {
    let mut rig = Rig::drives(1);
    rig.write(FIRST, registers::CYCLIC_UNIT_CONTROL, &[1]);
    let start = soon(&rig, 10 * MS);
    for (address, value) in
        [(registers::SYNC0_START, start), (registers::SYNC0_CYCLE, 1_000_000), (registers::SYNC_ACTIVATION, 3)]
    {
        let len = if address == registers::SYNC_ACTIVATION { 1 } else { 8 };
        rig.write(FIRST, address, &value.to_le_bytes()[..len]);
        assert_eq!(rig.read(FIRST, address, len), vec![0; len], "0x{address:04X}");
    }
}

/// An IO module behind a controller with clocks, which the module itself does not use.
fn io_with_clocks() -> Rig {
    let (mut io, settings) = (Io::new(IoConfig::default()), EscSettings::default());
    let eeprom = eeprom_of(&mut io, &settings).expect("it can be described");
    Rig::with_stations([EscSlave::new(Box::new(io), settings, eeprom, 0)])
}

/// ECAT-9.11 A device without clocks has a controller without them, and no mode of them in its EEPROM.
#[test]
fn a_device_without_clocks_has_none() {
    let mut rig = Rig::with_stations([slave(Box::new(Io::new(IoConfig::default())), EscSettings::default())]);
    assert_eq!(rig.one(Command::Fprd, FIRST, registers::SYSTEM_TIME, &[0; 8]).wkc, 0);
    assert_eq!(rig.read_u16(FIRST, registers::FEATURES) & 0b1100, 0);
    let sii = Sii::new(rig.chain.slave(0).controller().eeprom()).expect("an EEPROM");
    assert_eq!(sii.category(CategoryKind::DcModes), None);
}

/// An IO module on its way to OP with SYNC0.
fn synchronized_io() -> (Rig, usize, u64) {
    let mut rig = io_with_clocks();
    rig.bring_to_preop(FIRST);
    let len = rig.set_process_data(FIRST, 0);
    let start = soon(&rig, 10 * MS);
    activate(&mut rig, start, 1_000_000, 3);
    rig.reach(FIRST, AlState::SafeOp);
    (rig, len, start)
}

/// ECAT-13.4 With SYNC0 a device takes its outputs at the pulses and not on arrival.
#[test]
fn outputs_are_taken_at_pulses() {
    let (mut rig, len, start) = synchronized_io();
    let mut data = vec![0; len];
    rig.logical(Command::Lrw, 0, &data);
    assert_eq!(rig.request(FIRST, 0x08), (0x04, AlStatus::NONE), "no SYNC0 yet");
    rig.now = start;
    assert_eq!(rig.al_status(FIRST), (0x08, AlStatus::NONE));
    // Outputs of an IO module are wired to its inputs.
    rig.now = start + 5 * MS + 100 * US;
    data[0] = 0x5A;
    let inputs = |rig: &mut Rig, data: &[u8]| rig.logical(Command::Lrw, 0, data).data[2];
    assert_eq!(inputs(&mut rig, &data), 0);
    assert_eq!(inputs(&mut rig, &data), 0, "before the pulse");
    rig.now = start + 7 * MS;
    assert_eq!(inputs(&mut rig, &data), 0x5A, "after it");
}

/// ECAT-13.5 A slave with SYNC0 that is switched off in OP leaves OP with 0x2C; a slave whose SYNC0 does not come does
/// not reach OP, with 0x2D; a wrong setting of the unit is refused with 0x30 or 0x36.
#[test]
fn sync_that_is_missing_or_wrong() {
    let (mut rig, len, start) = synchronized_io();
    rig.logical(Command::Lrw, 0, &vec![0; len]);
    rig.now = start;
    rig.reach(FIRST, AlState::Op);
    rig.write(FIRST, registers::SYNC_ACTIVATION, &[0]);
    assert_eq!(rig.al_status(FIRST), (0x14, AlStatus::FATAL_SYNC));

    let mut rig = io_with_clocks();
    rig.bring_to_preop(FIRST);
    rig.set_process_data(FIRST, 0);
    for (cycle_ns, activation, code) in [
        (1_000_000, 5, AlStatus::INVALID_DC_SYNC),
        (99_999, 3, AlStatus::INVALID_SYNC0_CYCLE),
        (0, 3, AlStatus::INVALID_SYNC0_CYCLE),
    ] {
        let start = soon(&rig, 3_600_000 * MS);
        activate(&mut rig, start, cycle_ns, activation);
        assert_eq!(rig.request(FIRST, 0x14), (0x12, code));
    }
    let start = soon(&rig, 3_600_000 * MS);
    activate(&mut rig, start, 1_000_000, 3);
    assert_eq!(rig.request(FIRST, 0x14), (0x04, AlStatus::NONE));
    rig.write(FIRST, registers::WATCHDOG_PROCESS_DATA, &[0, 0]);
    rig.logical(Command::Lrw, 0, &vec![0; len]);
    assert_eq!(rig.request(FIRST, 0x08), (0x04, AlStatus::NONE));
    rig.now += OP_WAIT_NS;
    assert_eq!(rig.al_status(FIRST), (0x14, AlStatus::NO_SYNC));
}

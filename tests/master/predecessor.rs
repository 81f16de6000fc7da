//! Slaves as another master has left them: every writable register has a random value, by a seed.

use ecmsk::cia402::Controlword;
use ecmsk::ethercat::registers::{AL_STATUS, AlStatusRegister, RequestedState, SII_CONTROL};
use ecmsk::ethercat::{AlState, AlStatus, Command, DatagramHeader, FrameHeader, FrameWriter, Ns};
use ecmsk::fieldbus::{SlaveIn, SlaveOut};
use ecmsk::master::{Event, Pace, SiiError};
use ecmsk::sk::DriveSync;
use ecmsk::slave::esc::{Chain, EscSettings, Predecessor};
use support::dice::Dice;
use support::schedules::run_all;

use super::clocks::delays;
use super::rig::{CYCLE, MS, Rig, SECOND, STEP, US, device, kinds, process_data, slave};
use super::watchdog::killed;

/// Seeds of the test; `cargo xtask soak` asks for more.
const SEEDS: u64 = 200;
/// After that time without a frame a slave leaves OP, as docs/SAFETY.md says.
const WATCHDOG: Ns = 100 * MS;
/// The number of cycles in which axes move, and the distance in each.
const MOVES: i32 = 40;
const COUNTS: i32 = 5;

/// Slaves of these kinds in a line or with branches, some with a slow EEPROM.
fn network(kinds: &[&str], dice: &mut Dice) -> Rig {
    let mut chain = Chain::default();
    let has_branch = dice.one_in(2);
    for (n, kind) in kinds.iter().enumerate() {
        let eeprom_ns = dice.pick(&[0, 0, 2 * MS]);
        let state_change_ns = dice.pick(&[0, 0, 500 * US]);
        let slave = slave(kind, EscSettings { ports: [3; 4], eeprom_ns, state_change_ns, ..EscSettings::default() });
        match n.checked_sub(1) {
            None => chain = Chain::line([slave]),
            // A branch of one slave at the first one, which frames pass before the others.
            Some(0) if has_branch => {
                chain.add(slave, 0, 3);
            }
            Some(1) if has_branch => {
                chain.add(slave, 0, 1);
            }
            Some(before) => {
                chain.add(slave, before, 1);
            }
        }
    }
    Rig::of(chain)
}

/// Such slaves, which another master has left.
fn left(kinds: &[&str], dice: &mut Dice, seed: u64) -> Rig {
    let mut rig = network(kinds, dice);
    rig.net.now = SECOND;
    rig.net.chain.advance(rig.net.now);
    rig.net.chain.leave(&mut Predecessor::seeded(seed), rig.net.now);
    // The time to start another program.
    for _ in 0..dice.below(4) {
        rig.net.now += dice.below(600 * MS);
        rig.net.chain.advance(rig.net.now);
    }
    rig
}

/// Enables all axes and moves each by the same distance; returns their positions.
fn travel(rig: &mut Rig, kinds: &[&str]) {
    let (mut outputs, mut inputs) = ([SlaveOut::default(); 8], [SlaveIn::default(); 8]);
    let mut begin = [[0; 2]; 8];
    for turn in 0..60 + MOVES {
        for (n, kind) in kinds.iter().enumerate() {
            let (data, slave) = (process_data(kind), n as u8 + 1);
            data.take_inputs(rig.master.inputs(slave).expect("inputs"), &mut inputs[n]);
            for (axis, (output, input)) in outputs[n].iter_mut().zip(&inputs[n]).enumerate() {
                // The loss of the master was an alarm for some devices.
                let has_fault = input.statusword.0 & 0x4F == 0x08;
                let step = [0x06, 0x07, 0x0F][(turn as usize / 20).min(2)];
                output.controlword = Controlword(if has_fault && turn % 2 == 0 { 0x80 } else { step });
                if turn < 60 {
                    (output.target, begin[n][axis]) = (input.position, input.position);
                } else {
                    output.target += COUNTS;
                }
            }
            data.put_outputs(&outputs[n], rig.master.outputs_mut(slave).expect("outputs"));
        }
        rig.run_for(CYCLE);
    }
    rig.run_for(60 * CYCLE);
    for (n, kind) in kinds.iter().enumerate().filter(|(_, kind)| **kind != "io") {
        let data = process_data(kind);
        data.take_inputs(rig.master.inputs(n as u8 + 1).expect("inputs"), &mut inputs[n]);
        for axis in 0..data.axes() {
            let gone = inputs[n][axis].position - begin[n][axis];
            assert!(
                (gone - MOVES * COUNTS).abs() <= 5,
                "slave {} ({kind}) has gone {gone} counts: {:?}",
                n + 1,
                inputs[n][axis]
            );
        }
    }
}

/// MASTER-2.8, MASTER-3.6 Whatever another master has left in slaves that kept their power, all of them are found at
/// their places, come to OP, follow their targets, and leave OP 100 ms after the last frame.
#[test]
fn what_another_master_has_left_does_not_matter() {
    run_all("master", "what_another_master_has_left_does_not_matter", SEEDS, |seed| {
        let mut dice = Dice(seed);
        let kinds = kinds(1 + seed as usize % 5);
        let mut rig = left(&kinds, &mut dice, seed);
        assert_eq!(rig.scan(), kinds.len(), "slaves are found");
        for (info, kind) in rig.master.slaves().iter().zip(&kinds) {
            let (identity, serial) = device(kind).identity().map(|(one, serial)| (*one, serial)).expect("one");
            assert_eq!(
                (&*info.name, info.identity.product, info.identity.serial),
                (device(kind).name(), identity.product_code, serial)
            );
        }
        rig.master.set_pace(Some(Pace { cycle_ns: CYCLE, phase_ns: 0 }));
        rig.bring_to_op_with(&kinds, dice.pick(&[DriveSync::FreeRun, DriveSync::DcSync]));
        travel(&mut rig, &kinds);
        let expected = 3 * kinds.len() as u16;
        assert_eq!((rig.last.working_counter, rig.last.expected_working_counter), (expected, expected));
        assert_eq!((rig.last.present, rig.last.all_in_op), (Some(kinds.len() as u16), true));
        let events: Vec<Event> = std::iter::from_fn(|| rig.master.take_event()).collect();
        // Some devices have an alarm since the other master has gone.
        assert!(events.iter().all(|event| matches!(event, Event::Emergency { .. })), "{events:?}");
        for (n, after) in killed(&mut rig).into_iter().enumerate() {
            assert!((WATCHDOG..=WATCHDOG + STEP).contains(&after), "slave {} leaves OP after {after} ns", n + 1);
            let shown = rig.net.chain.slave(n).controller().peek(AL_STATUS, 6);
            let status = AlStatusRegister::of(RequestedState::State(AlState::SafeOp)).with(AlStatusRegister::ERROR);
            assert_eq!((shown[0], shown[4]), (status.0 as u8, AlStatus::WATCHDOG.0 as u8));
        }
        1_u64
    });
}

/// MASTER-2.8, MASTER-6.1 Whatever another master has left, propagation delays and the ports by which frames enter are
/// measured as in slaves that have just been switched on: receive times are those of the measuring frame, too, if they
/// were left in the mode of slaves that frames enter by another port (0x0936).
#[test]
fn delays_are_measured_whatever_another_master_has_left() {
    for seed in 0..20 {
        let kinds = kinds(1 + seed as usize % 5);
        let [mut rig, mut clean] = [left(&kinds, &mut Dice(seed), seed), network(&kinds, &mut Dice(seed))];
        assert_eq!((rig.scan(), clean.scan()), (kinds.len(), kinds.len()));
        assert_eq!(delays(&rig), delays(&clean), "seed {seed}");
        let ports = |rig: &Rig| rig.master.slaves().iter().map(|slave| slave.entry_port).collect::<Vec<_>>();
        assert_eq!(ports(&rig), ports(&clean), "seed {seed}");
    }
}

/// MASTER-2.8 A command for its EEPROM that another master has begun is not mistaken for the master's own: the slave's
/// identity is right.
#[test]
fn the_eeprom_answers_us_and_not_another_master() {
    for passed_ms in [0, 1, 2, 3, 4, 5] {
        let settings = EscSettings { eeprom_ns: 5 * MS, ..EscSettings::default() };
        let mut rig = Rig::of(Chain::line([slave("drive", settings)]));
        write(&mut rig, SII_CONTROL, &[0, 1, 0x20, 0, 0, 0]);
        rig.net.now += passed_ms * MS;
        assert_eq!(rig.scan(), 1);
        let clean = Rig::scanned(&["drive"]);
        assert_eq!(rig.master.slaves(), clean.master.slaves(), "{passed_ms} ms");
    }
}

/// MASTER-2.8 For a slave whose own controller keeps its EEPROM, the old content of the registers is not used.
#[test]
fn an_eeprom_that_is_kept_is_none() {
    let mut rig = Rig::line(&["drive"]);
    // The master takes the EEPROM back, and the slave's controller takes it again at once.
    rig.net.hostile = None;
    let scan = rig.master.scan();
    let keep = |rig: &mut Rig| rig.net.chain.slave_mut(0).controller_mut().take_eeprom(true);
    let done = loop {
        keep(&mut rig);
        rig.step();
        if let Some(done) = rig.master.take(scan) {
            break done;
        }
    };
    assert_eq!(done, Ok(1));
    assert_eq!(rig.master.slaves()[0].eeprom, Err(SiiError::Busy));
}

/// MASTER-2.8 Whatever counter a slave remembers over Init, each request is answered, at once, and each download done once.
#[test]
fn no_first_request_is_taken_for_a_repeat() {
    for seed in 0..64 {
        let mut rig = left(&["drive"], &mut Dice(seed), seed);
        rig.scan();
        rig.reach(AlState::PreOp);
        for n in 0..10_u8 {
            let begin = rig.net.now;
            assert_eq!(rig.download(1, 0x6065, 0, &[n, 1, 0, 0]), Ok(()), "seed {seed}, request {n}");
            assert_eq!(rig.upload(1, 0x6065, 0), Ok(vec![n, 1, 0, 0]));
            assert!(rig.net.now - begin < 25 * MS, "seed {seed}, request {n}");
        }
    }
}

/// Another master writes registers of all slaves.
pub fn write(rig: &mut Rig, ado: u16, data: &[u8]) {
    let mut buffer = [0; 60];
    let mut frame = FrameWriter::new(&mut buffer, FrameHeader::datagrams([0x20; 6])).expect("room");
    frame.push(DatagramHeader::register(Command::Bwr, 0, 0, ado), data).expect("room");
    frame.finish();
    let now = rig.net.now;
    rig.net.chain.process(&mut buffer, now);
}

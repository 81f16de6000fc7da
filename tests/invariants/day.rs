//! A long day: two axes go to and fro without an end, an SDO is read every second, and memory does not grow. On a
//! simulated network, and over slave controllers and the software master, as on a network card.

use std::time::{Duration, Instant};

use ecmsk::coe::ObjectAddress;
use ecmsk::engine::{Board, Counters, EngineConfig};
use ecmsk::fieldbus::Fieldbus;
use ecmsk::fieldbus::nic::{ChainWires, NicBus};
use ecmsk::fieldbus::sim::{SimBus, SimHandle};
use ecmsk::master::Settings;
use ecmsk::sk::{
    DriveResponse, FIFO_ENTRIES, Frame, MasterCommand, MasterResponse, MasterState, Motion, SdoCommand, SlaveCommand,
    SlaveKind, SlotSize, StateByte,
};
use ecmsk::slave::{Drive, DriveConfig, Slave};

use support::schedules::asked;

const SIZE: SlotSize = SlotSize::Bytes12;
/// Cycles of a virtual minute.
const MINUTE: u64 = 60_000;

/// Minutes of the tests; `cargo xtask soak` asks for a day.
const MINUTES: u64 = 3;
const MINUTES_ON_WIRES: u64 = 1;

struct Day {
    board: Board,
    report: Frame,
    target: i32,
    sent: u64,
}

impl Day {
    fn new(bus: impl FnOnce(Vec<Box<dyn Slave>>) -> Box<dyn Fieldbus>) -> Self {
        let drives = (0..2).map(|_| Box::new(Drive::new(DriveConfig::default())) as Box<dyn Slave>).collect();
        let mut board = Board::new(EngineConfig::default(), bus(drives));
        assert!(board.boot(10_000_000_000));
        let mut day = Self { board, report: Frame::new(), target: 0, sent: 0 };
        let kinds = [SlaveKind::Drive; 8];
        day.send(|frame| frame.put_master(SIZE, &MasterCommand::SetAxis { group: 0, kinds }));
        day.send(|frame| frame.put_master(SIZE, &MasterCommand::SetState(MasterState::Op)));
        day.until(|day| MasterResponse::decode(&day.report.slot(SIZE, 0)).state == StateByte::reached(MasterState::Op));
        day.send(|frame| (1..=2).for_each(|slave| frame.put_slave(SIZE, slave, &SlaveCommand::ServoOn.into())));
        day.until(|day| (1..=2).all(|slave| day.drive(slave).statusword.is_enabled()));
        day
    }

    fn send(&mut self, build: impl FnOnce(&mut Frame)) {
        let mut frame = Frame::new();
        build(&mut frame);
        self.board.host(&frame, self.board.now(), &mut |_, _| unreachable!());
        self.cycle();
    }

    fn cycle(&mut self) {
        let Self { board, report, .. } = self;
        board.cycle(&mut |frame, _| report.clone_from(frame));
    }

    fn until(&mut self, done: impl Fn(&Self) -> bool) {
        for _ in 0..MINUTE {
            if done(self) {
                return;
            }
            self.cycle();
        }
        panic!("the board does not come up");
    }

    fn drive(&self, slave: usize) -> DriveResponse {
        DriveResponse::decode(&self.report.slot(SIZE, slave))
    }

    /// Runs one minute, one target a cycle.
    fn minute(&mut self) {
        for cycle in 0..MINUTE {
            self.target = self.target.wrapping_add(if cycle % 2000 < 1000 { 200 } else { -200 });
            let (target, sent) = (self.target, self.sent);
            self.send(|frame| {
                (1..=2).for_each(|slave| frame.put_slave(SIZE, slave, &SlaveCommand::Csp(Motion::to(target)).into()));
                if sent % 1000 == 0 {
                    let slave = 1 + (sent / 1000 % 2) as u8;
                    frame.put_sdo(SIZE, &SdoCommand::Read { slave, object: ObjectAddress::new(0x6041, 0) });
                }
            });
            self.sent += 1;
        }
        for slave in 1..=2 {
            let behind = self.target.wrapping_sub(self.drive(slave).position);
            assert!(behind.abs() < 100_000, "axis {slave} is {behind} counts behind");
        }
        assert_eq!(MasterResponse::decode(&self.report.slot(SIZE, 0)).fifo_free, FIFO_ENTRIES);
    }
}

/// Runs that many minutes of one target per cycle, and checks that each entry was executed and none lost. `look` gets
/// the allocations of each minute.
fn live(mut day: Day, usual: u64, look: impl Fn(u64, &allocation_counter::AllocationInfo)) {
    let asked = asked("ECMSK_SOAK_MINUTES");
    let minutes = asked.unwrap_or(usual);
    day.minute();
    let before = *day.board.engine().counters();
    let mut told = Instant::now();
    for minute in 0..minutes {
        let allocated = allocation_counter::measure(|| day.minute());
        look(minute, &allocated);
        if asked.is_some() && told.elapsed() > Duration::from_secs(5) {
            told = Instant::now();
            println!("{minute} of {minutes} virtual minutes");
        }
    }
    let after = *day.board.engine().counters();
    let cycles = minutes * MINUTE;
    let expected = Counters {
        frames: before.frames + cycles,
        executed: before.executed + cycles,
        reports: before.reports + cycles,
        ..before
    };
    assert_eq!(after, expected);
    println!("{minutes} virtual minutes, {cycles} cycles: nothing lost, nothing grown");
}

/// SK-4.44 SK-5.4: in hours of one target a cycle each entry is executed and none lost, and memory does not grow.
#[test]
fn a_long_day() {
    live(Day::new(|drives| Box::new(SimBus::new(drives))), MINUTES, |minute, allocated| {
        assert_eq!(allocated.count_total, 0, "minute {minute} allocates: {allocated:?}");
    });
}

/// The same over slave controllers and the software master. Memory that an SDO has allocated is freed.
#[test]
fn a_long_day_on_a_network_card() {
    let over_wires = |drives| -> Box<dyn Fieldbus> {
        let wires = ChainWires::new(drives, SimHandle::default()).expect("drives have an EEPROM");
        Box::new(NicBus::new(wires, Settings::default()))
    };
    live(Day::new(over_wires), MINUTES_ON_WIRES, |minute, allocated| {
        assert_eq!(allocated.bytes_current, 0, "memory grows in minute {minute}: {allocated:?}");
    });
}

//! `cycle_40_mixed`: a cycle with everything under way at once (16 drives homing, 8 in CSP, 6 steppers, 5 pulse modules,
//! 5 IO modules, an SDO) against the same with 40 drives in CSP. How the cost grows with the slaves, and whether it
//! grows with the board's age.

mod common;
#[path = "common/board.rs"]
mod host;

use std::hint::black_box;

use ecmsk::coe::{ObjectAddress, SdoSize};
use ecmsk::engine::Board;
use ecmsk::sk::{
    Frame, MasterResponse, MasterState, Motion, SdoCommand, SdoResponse, SlaveCommand, SlaveKind, StateByte,
};
use ecmsk::slave::{Channels, Drive, DriveConfig, HomeSwitch, Hsp, HspConfig, Io, Slave, Travel};
use host::{Path, SIZE, board_in_op, cycle_until, drives_in_op, send};

/// Cycles of a virtual day, 1 ms each.
const DAY: u64 = 24 * 3600 * 1000;

fn main() {
    let (mut mixed, mut drives) = (Mixed::new(), Csp::new(40));
    common::pair("cycle_40_mixed", 1.5, || mixed.cycle(), || drives.cycle());
    mixed.assert_busy();
    grows_with_slaves();
    does_not_grow_with_age();
}

/// Time per cycle with 10, 20 and 40 drives, and how well a straight line fits.
fn grows_with_slaves() {
    let points: Vec<(f64, f64)> = [10, 20, 40]
        .into_iter()
        .map(|drives| {
            let mut board = Csp::new(drives);
            (0..20_000).for_each(|_| board.cycle());
            let ns = common::median((0..21).map(|_| common::per_call_ns(2000, &mut || board.cycle())).collect());
            (drives as f64, ns)
        })
        .collect();
    for (drives, ns) in &points {
        common::fact(&format!("cycle_cost_{drives}_drives"), *ns, "ns");
    }
    let (per_slave, fixed, r_squared) = line(&points);
    common::fact("cycle_cost_per_drive", per_slave, "ns");
    common::fact("cycle_cost_without_drives", fixed, "ns");
    common::fact("cycle_cost_linear_fit", r_squared, "R2");
}

/// Least squares: slope, intercept, R².
fn line(points: &[(f64, f64)]) -> (f64, f64, f64) {
    let n = points.len() as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / n;
    let (x0, y0) = (mean(|p| p.0), mean(|p| p.1));
    let slope = points.iter().map(|(x, y)| (x - x0) * (y - y0)).sum::<f64>()
        / points.iter().map(|(x, _)| (x - x0) * (x - x0)).sum::<f64>();
    let intercept = y0 - slope * x0;
    let rest: f64 = points.iter().map(|(x, y)| (y - intercept - slope * x).powi(2)).sum();
    let total: f64 = points.iter().map(|(_, y)| (y - y0).powi(2)).sum();
    (slope, intercept, 1.0 - rest / total)
}

/// A board after 24 virtual hours against a new one.
fn does_not_grow_with_age() {
    let (mut old, mut new) = (Csp::new(2), Csp::new(2));
    (0..DAY).for_each(|_| old.cycle());
    common::pair("cycle_after_24_hours", 1.1, || old.cycle(), || new.cycle());
}

/// Drives on paths.
struct Csp {
    board: Board,
    drives: usize,
    path: Path,
    command: Frame,
    report: Frame,
}

impl Csp {
    fn new(drives: usize) -> Self {
        let board = drives_in_op(drives);
        Self { board, drives, path: Path::default(), command: Frame::new(), report: Frame::new() }
    }

    fn cycle(&mut self) {
        self.path.advance();
        for slave in 1..=self.drives {
            self.command.put_slave(SIZE, slave, &SlaveCommand::Csp(Motion::to(self.path.target)).into());
        }
        exchange(&mut self.board, &mut self.command, &mut self.report);
    }
}

fn exchange(board: &mut Board, command: &mut Frame, report: &mut Frame) {
    command.fill_crc(SIZE);
    let at = board.next_cycle() - 1;
    board.host(black_box(command), at, &mut |_, _| {});
    board.cycle(&mut |frame, _| report.clone_from(frame));
    black_box(report);
}

/// A network of every kind of slave.
struct Mixed {
    board: Board,
    kinds: Vec<SlaveKind>,
    path: Path,
    command: Frame,
    report: Frame,
    cycles: u32,
}

/// Drives that home, the first slaves.
const HOMING: usize = 16;

impl Mixed {
    fn new() -> Self {
        // A search that does not end here: the switch is too far away.
        let far = Travel { home: Some(HomeSwitch::From(1 << 50)), ..Travel::NONE };
        let drive = |travel| Box::new(Drive::new(DriveConfig { travel, ..DriveConfig::default() })) as Box<dyn Slave>;
        let mut network: Vec<(SlaveKind, Box<dyn Slave>)> = Vec::new();
        network.extend((0..HOMING).map(|_| (SlaveKind::Drive, drive(far))));
        network.extend((0..8).map(|_| (SlaveKind::Drive, drive(Travel::default()))));
        network
            .extend((0..6).map(|_| (SlaveKind::Step, Box::new(Drive::new(DriveConfig::stepper())) as Box<dyn Slave>)));
        network.extend(
            (0..5).map(|_| (SlaveKind::Hsp, Box::new(Hsp::new(HspConfig::with(Channels::Two))) as Box<dyn Slave>)),
        );
        network.extend((0..5).map(|_| (SlaveKind::Io, Box::new(Io::default()) as Box<dyn Slave>)));
        let kinds = network.iter().map(|(kind, _)| *kind).collect();
        let mut board = board_in_op(network.into_iter());
        for slave in 1..=HOMING as u8 {
            for (index, value) in [(0x6060, 6), (0x6098, 19)] {
                write(&mut board, slave, index, value);
            }
        }
        send(&mut board, |frame| (1..=HOMING).for_each(|n| frame.put_slave(SIZE, n, &SlaveCommand::GoHome.into())));
        (0..1000).for_each(|_| board.cycle(&mut |_, _| {}));
        Self { board, kinds, path: Path::default(), command: Frame::new(), report: Frame::new(), cycles: 0 }
    }

    fn cycle(&mut self) {
        self.path.advance();
        let target = self.path.target;
        for (slave, kind) in (1..).zip(&self.kinds).skip(HOMING) {
            // Encoded as the 40 drives' targets are, each for itself: the board is what is measured.
            match kind {
                SlaveKind::Io => self.command.put_slave(SIZE, slave, &SlaveCommand::IoWrite(target as u16).into()),
                _ => self.command.put_slave(SIZE, slave, &SlaveCommand::Csp(Motion::to(target)).into()),
            }
        }
        // One after the other: there is always one under way.
        self.command.put_sdo(SIZE, &SdoCommand::Read { slave: 17, object: ObjectAddress::new(0x6041, 0) });
        self.cycles += 1;
        exchange(&mut self.board, &mut self.command, &mut self.report);
    }

    /// All that was to be under way was.
    fn assert_busy(&self) {
        let engine = self.board.engine();
        let homing =
            (1..=HOMING as u8).filter(|slave| engine.homing_phase(*slave) == ecmsk::engine::HomingPhase::Homing);
        assert_eq!(homing.count(), HOMING, "the drives still home");
        let answer = MasterResponse::decode(&self.report.slot(SIZE, 0));
        assert_eq!((answer.state, answer.full_count), (StateByte::reached(MasterState::Op), 0));
        assert!(matches!(SdoResponse::decode(&self.report.slot(SIZE, 41)), SdoResponse::Done { slave: 17, .. }));
        assert_eq!(engine.counters().discarded_before_enabled, 0, "all axes follow");
    }
}

/// Writes an object to its end.
fn write(board: &mut Board, slave: u8, index: u16, value: u32) {
    let object = ObjectAddress::new(index, 0);
    send(board, |frame| frame.put_sdo(SIZE, &SdoCommand::Write { slave, object, size: SdoSize::One, value }));
    cycle_until(
        board,
        |report| matches!(SdoResponse::decode(&report.slot(SIZE, 41)), SdoResponse::Done { slave: s, object: o, .. } if s == slave && o == object),
    );
}

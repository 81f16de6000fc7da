//! Boards in OP, with every axis on, for the benches of the cycle.

#![allow(dead_code, reason = "each bench takes what it needs")]

use std::hint::black_box;

use ecmsk::engine::{Board, EngineConfig};
use ecmsk::fieldbus::Fieldbus;
use ecmsk::fieldbus::nic::{ChainWires, NicBus};
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::fieldbus::xf::XfBusOptions;
use ecmsk::master::Settings;
use ecmsk::sk::{
    DriveResponse, Frame, MasterCommand, MasterResponse, MasterState, Motion, SlaveCommand, SlaveKind, SlotSize,
    StateByte,
};
use ecmsk::slave::{Drive, DriveConfig, Slave};
use support::ahead_bus::{Ahead, AheadBus};
use support::chip_line::xf_bus_reached_by;

pub const SIZE: SlotSize = SlotSize::Bytes12;
/// Counts in a cycle: the axes move all the time.
const STEP: i32 = 20;
/// They turn back after so many cycles.
const STROKE: i32 = 1000;

/// A target that goes to and fro.
#[derive(Default)]
pub struct Path {
    /// The target of this cycle.
    pub target: i32,
    n: i32,
}

impl Path {
    /// The next cycle.
    pub fn advance(&mut self) {
        self.target += if self.n % (2 * STROKE) < STROKE { STEP } else { -STEP };
        self.n += 1;
    }
}

/// A program that sends every drive a target in every cycle.
pub struct Program<'a> {
    board: &'a mut Board,
    drives: usize,
    command: Frame,
    report: Frame,
    path: Path,
}

impl<'a> Program<'a> {
    pub fn new(board: &'a mut Board, drives: usize) -> Self {
        Self { board, drives, command: Frame::new(), report: Frame::new(), path: Path::default() }
    }

    /// A frame with the next target arrives.
    pub fn send(&mut self) {
        self.path.advance();
        for slave in 1..=self.drives {
            self.command.put_slave(SIZE, slave, &SlaveCommand::Csp(Motion::to(self.path.target)).into());
        }
        self.command.fill_crc(SIZE);
        let at = self.board.next_cycle() - 1;
        self.board.host(black_box(&self.command), at, &mut |_, _| {});
    }

    /// A frame, and the next cycle.
    pub fn cycle(&mut self) {
        self.send();
        let Self { board, report, .. } = self;
        board.cycle(&mut |frame, _| report.clone_from(frame));
        black_box(&self.report);
    }

    /// The board is in OP, and had a target for every cycle.
    pub fn assert_well(&self) {
        let answer = MasterResponse::decode(&self.report.slot(SIZE, 0));
        let expected = (StateByte::reached(MasterState::Op), 0);
        assert_eq!((answer.state, answer.full_count), expected, "the bench's board ran well");
        let counters = self.board.engine().counters();
        assert!(counters.idle_cycles < 3000, "it had a target for every cycle: {counters:?}");
    }
}

fn drives(n: usize) -> impl Iterator<Item = (SlaveKind, Box<dyn Slave>)> {
    (0..n).map(|_| (SlaveKind::Drive, Box::new(Drive::new(DriveConfig::default())) as Box<dyn Slave>))
}

/// `n` servo drives in CSP.
pub fn drives_in_op(n: usize) -> Board {
    board_in_op(drives(n))
}

/// The same over another bus around the simulated one.
pub fn drives_in_op_over(n: usize, over: impl FnOnce(SimBus) -> Box<dyn Fieldbus>) -> Board {
    board_in_op_over(drives(n), over)
}

/// The same over a bus that takes outputs ahead.
pub fn drives_in_op_ahead(n: usize, how: Ahead) -> Board {
    board_in_op_over(drives(n), |bus| Box::new(AheadBus::new(bus, how)))
}

/// The same behind the model of an ECM-XF.
pub fn drives_in_op_behind_xf(n: usize) -> Board {
    board_in_op_over(drives(n), |bus| {
        let (slaves, handle) = bus.into_parts();
        Box::new(xf_bus_reached_by(slaves, handle, XfBusOptions::DEFAULT))
    })
}

/// The same behind slave controllers that our own master reaches, as on a network card.
pub fn drives_in_op_on_wires(n: usize) -> Board {
    board_in_op_over(drives(n), |bus| {
        let (slaves, handle) = bus.into_parts();
        let wires = ChainWires::new(slaves, handle).expect("drives have an EEPROM");
        Box::new(NicBus::new(wires, Settings::default()))
    })
}

/// A board with these slaves.
pub fn board_in_op(network: impl Iterator<Item = (SlaveKind, Box<dyn Slave>)>) -> Board {
    board_in_op_over(network, |bus| Box::new(bus))
}

fn board_in_op_over(
    network: impl Iterator<Item = (SlaveKind, Box<dyn Slave>)>,
    over: impl FnOnce(SimBus) -> Box<dyn Fieldbus>,
) -> Board {
    let (kinds, slaves): (Vec<_>, Vec<_>) = network.unzip();
    let mut board = Board::new(EngineConfig::default(), over(SimBus::new(slaves)));
    assert!(board.boot(60_000_000_000));
    for group in 0..5 {
        let mut of_group = [SlaveKind::None; 8];
        for (place, kind) in of_group.iter_mut().zip(kinds.iter().skip(usize::from(group) * 8)) {
            *place = *kind;
        }
        send(&mut board, |frame| frame.put_master(SIZE, &MasterCommand::SetAxis { group, kinds: of_group }));
    }
    send(&mut board, |frame| frame.put_master(SIZE, &MasterCommand::SetState(MasterState::Op)));
    cycle_until(&mut board, |report| {
        MasterResponse::decode(&report.slot(SIZE, 0)).state == StateByte::reached(MasterState::Op)
    });
    let with_axes = || (1..).zip(&kinds).filter(|(_, kind)| **kind != SlaveKind::Io).map(|(slave, _)| slave);
    send(&mut board, |frame| with_axes().for_each(|slave| frame.put_slave(SIZE, slave, &SlaveCommand::ServoOn.into())));
    cycle_until(&mut board, |report| {
        with_axes().all(|slave| DriveResponse::decode(&report.slot(SIZE, slave)).statusword.is_enabled())
    });
    board
}

/// Sends a frame that `build` fills.
pub fn send(board: &mut Board, build: impl FnOnce(&mut Frame)) {
    let mut frame = Frame::new();
    build(&mut frame);
    let at = board.now();
    board.host(&frame, at, &mut |_, _| {});
}

/// Lets cycles pass until a report is as wanted.
pub fn cycle_until(board: &mut Board, done: impl Fn(&Frame) -> bool) {
    for _ in 0..100_000 {
        let mut reached = false;
        board.cycle(&mut |report, _| reached = done(report));
        if reached {
            return;
        }
    }
    panic!("the bench's board does not come up");
}

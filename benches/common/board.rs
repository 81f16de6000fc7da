//! Boards in OP, with every axis on, for the benches of the cycle.

#![allow(dead_code, reason = "each bench takes what it needs")]

use ecmsk::engine::{Board, EngineConfig};
use ecmsk::fieldbus::Fieldbus;
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::sk::{
    DriveResponse, Frame, MasterCommand, MasterResponse, MasterState, SlaveCommand, SlaveKind, SlotSize, StateByte,
};
use ecmsk::slave::{Drive, DriveConfig, Slave};
use support::ahead_bus::{Ahead, AheadBus};

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

fn drives(n: usize) -> impl Iterator<Item = (SlaveKind, Box<dyn Slave>)> {
    (0..n).map(|_| (SlaveKind::Drive, Box::new(Drive::new(DriveConfig::default())) as Box<dyn Slave>))
}

/// `n` servo drives in CSP.
pub fn drives_in_op(n: usize) -> Board {
    board_in_op(drives(n))
}

/// The same over a bus that takes outputs ahead.
pub fn drives_in_op_ahead(n: usize, how: Ahead) -> Board {
    board_in_op_over(drives(n), |bus| Box::new(AheadBus::new(bus, how)))
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

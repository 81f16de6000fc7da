//! Frames of the tests' programs.

use ecmsk::cia402::DriveState;
use ecmsk::sk::{
    CommandId, CycleTime, DcShift, DriveResponse, Frame, MasterCommand, MasterResponse, MasterState, RawSlot,
    SlaveKind, SlotSize,
};

pub const SIZE: SlotSize = SlotSize::Bytes12;

pub fn board(command: &MasterCommand) -> Frame {
    let mut frame = Frame::new();
    frame.put_master(SIZE, command);
    frame.fill_crc(SIZE);
    frame
}

pub fn to(state: MasterState) -> Frame {
    board(&MasterCommand::SetState(state))
}

/// All slaves are drives.
pub fn axes() -> impl Iterator<Item = Frame> {
    (0..5).map(|group| board(&MasterCommand::SetAxis { group, kinds: [SlaveKind::Drive; 8] }))
}

pub fn cycle(us: u32) -> Frame {
    board(&MasterCommand::SetDc { cycle: CycleTime::from_us(us).unwrap(), shift: DcShift::Auto })
}

/// The same command for slaves 1 to `slaves`, with that index.
pub fn all(slaves: usize, id: CommandId, index: u8, data: i32) -> Frame {
    let mut frame = Frame::new();
    for slave in 1..=slaves {
        let slot = RawSlot { id: id.code(), index, data1: data as u32, ..RawSlot::ZERO };
        frame.put(SIZE, slave, &slot);
    }
    frame.fill_crc(SIZE);
    frame
}

/// Target number `n` of a path, identified by its index.
pub fn target(slaves: usize, n: u32) -> Frame {
    all(slaves, CommandId::Csp, index(n), n as i32 * 10)
}

pub fn index(n: u32) -> u8 {
    (n % 250 + 1) as u8
}

pub fn state(report: &Frame) -> Option<MasterState> {
    master(report).state.state()
}

pub fn master(report: &Frame) -> MasterResponse {
    MasterResponse::decode(&report.slot(SIZE, 0))
}

pub fn drive(report: &Frame, slave: usize) -> DriveResponse {
    DriveResponse::decode(&report.slot(SIZE, slave))
}

pub fn all_on(report: &Frame, slaves: usize) -> bool {
    (1..=slaves).all(|slave| drive(report, slave).statusword.state() == Some(DriveState::OperationEnabled))
}

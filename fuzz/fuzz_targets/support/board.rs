//! A modelled board with a small network that is quick about its changes, and the frames that bring it up.
#![allow(dead_code, reason = "each target uses a part of it")]

use ecmsk::cia402::Mode;
use ecmsk::engine::{Board, EngineConfig, Firmware};
use ecmsk::fieldbus::sim::{SimBus, SimHandle};
use ecmsk::sk::{DriveSync, Frame, MasterCommand, MasterState, SlaveCommand, SlaveKind, SlotSize};
use ecmsk::slave::{Channels, Drive, DriveConfig, Hsp, HspConfig, Io, Slave};
use support::swift::SWIFT;

/// Slaves with axes: 1 and 3 are drives, 2 is a pulse module of two channels. Slave 4 is an IO module.
pub const AXES: usize = 3;
pub const SLAVES: usize = 4;
/// How long a board may take to boot.
pub const BOOT_NS: u64 = 1_000_000_000;

/// A board that has booted, and what can befall its network.
pub fn board(size: SlotSize, firmware: Firmware) -> (Board, SimHandle) {
    let drive = || Box::new(Drive::new(DriveConfig::default())) as Box<dyn Slave>;
    let hsp = Box::new(Hsp::new(HspConfig::with(Channels::Two)));
    let bus = SimBus::new(vec![drive(), hsp, drive(), Box::new(Io::default())]).with_timing(SWIFT);
    let network = bus.handle();
    let config = EngineConfig { slot: size, firmware, state_timeout_ns: 200_000_000, ..EngineConfig::default() };
    let mut board = Board::new(config, Box::new(bus));
    assert!(board.boot(BOOT_NS));
    (board, network)
}

/// What a program sends in PreOP, and to switch axes on in OP. Bits of `modes` say how axes are run: CSP, CSV or CST.
pub fn set_up(size: SlotSize, modes: u8) -> [Frame; 3] {
    use Mode::{Csp, Cst, Csv};
    let mut kinds = [SlaveKind::None; 8];
    kinds[..SLAVES].copy_from_slice(&[SlaveKind::Drive, SlaveKind::Hsp, SlaveKind::Drive, SlaveKind::Io]);
    let modes = [[Csp, Csv, Cst, Csp][usize::from(modes & 3)], [Csp, Csv][usize::from(modes >> 2 & 1)], Csp];
    let mut frames = [Frame::new(), Frame::new(), Frame::new()];
    frames[0].put_master(size, &MasterCommand::SetAxis { group: 0, kinds });
    frames[1].put_master(size, &MasterCommand::SetState(MasterState::Op));
    for (slave, mode) in (1..=AXES).zip(modes) {
        frames[1].put_slave(size, slave, &SlaveCommand::DriveMode { mode, sync: DriveSync::DcSync }.into());
        frames[2].put_slave(size, slave, &SlaveCommand::ServoOn.into());
    }
    frames
}

//! A board with a random network: slave 1 is an IO module, which marks the entries, the others are drives.

use ecmsk::cia402::Mode;
use ecmsk::engine::{Board, EngineConfig};
use ecmsk::fieldbus::sim::{SimBus, SimHandle, Timing};
use ecmsk::sk::{
    CycleTime, DcShift, DriveSync, Frame, MasterCommand, MasterState, SlaveCommand, SlaveKind, SlotSize, StateByte,
};
use ecmsk::slave::{Drive, DriveConfig, Io, Slave};

use crate::dice::Dice;
use crate::tap::{Seen, Tap};

/// The IO module, whose IO_RD in every frame names the frame.
pub const MARKER: usize = 1;
/// Speed of the programs, counts/s: two turns.
pub const SPEED: i32 = 2 << 17;

/// Changes that are swift, so that a schedule sees many.
pub const SWIFT: Timing = Timing {
    scan_ns: 2_000_000,
    scan_slave_ns: 100_000,
    configure_slave_ns: 1_000_000,
    to_preop_ns: 3_000_000,
    to_safeop_ns: 10_000_000,
    to_op_ns: 3_000_000,
    down_ns: 2_000_000,
    change_slave_ns: 100_000,
    retry_ns: 5_000_000,
    sdo_ns: 3_000_000,
};

/// A drive.
pub struct Axis {
    pub slave: usize,
    /// DRIVE_MODE.
    pub mode: Mode,
    pub seen: Seen,
}

/// The board and both ends of its network.
pub struct Machine {
    pub board: Board,
    pub network: SimHandle,
    pub size: SlotSize,
    pub cycle: CycleTime,
    pub axes: Vec<Axis>,
}

impl Machine {
    /// The machine of a seed, in PreOP.
    pub fn new(seed: u64) -> Self {
        let mut dice = Dice(seed ^ 0x6D61_6368_696E_6521);
        let size = dice.pick(&[SlotSize::Bytes12, SlotSize::Bytes16]);
        let cycle = dice.pick(&[250, 500, 1000, 1000, 2000]);
        let cycle = CycleTime::from_us(cycle).expect("a cycle of the guide's");
        let mut slaves: Vec<Box<dyn Slave>> = vec![Box::new(Io::default())];
        let mut axes = Vec::new();
        for slave in MARKER + 1..=MARKER + 1 + dice.below(4) as usize {
            let position = dice.below(1 << 34) as i64 - (1 << 33);
            let (drive, seen) = Tap::on(Box::new(Drive::new(DriveConfig { position, ..DriveConfig::default() })));
            slaves.push(drive);
            axes.push(Axis { slave, mode: dice.pick(&[Mode::Csp, Mode::Csp, Mode::Csv, Mode::Cst]), seen });
        }
        let bus = SimBus::new(slaves).with_timing(SWIFT);
        let network = bus.handle();
        let config = EngineConfig { slot: size, state_timeout_ns: 200_000_000, ..EngineConfig::default() };
        let mut board = Board::new(config, Box::new(bus));
        assert!(board.boot(1_000_000_000));
        Self { board, network, size, cycle, axes }
    }

    /// The frames that a program sends in PreOP: axes, cycle, modes.
    pub fn set_up(&self) -> Vec<Frame> {
        let mut kinds = [SlaveKind::None; 8];
        kinds[MARKER - 1] = SlaveKind::Io;
        kinds[MARKER..MARKER + self.axes.len()].fill(SlaveKind::Drive);
        let mut frames = vec![Frame::new(), Frame::new(), Frame::new()];
        frames[0].put_master(self.size, &MasterCommand::SetAxis { group: 0, kinds });
        frames[1].put_master(self.size, &MasterCommand::SetDc { cycle: self.cycle, shift: DcShift::Auto });
        for axis in &self.axes {
            let command = SlaveCommand::DriveMode { mode: axis.mode, sync: DriveSync::DcSync };
            frames[2].put_slave(self.size, axis.slave, &command.into());
        }
        frames[2].put_master(self.size, &MasterCommand::SetState(MasterState::Op));
        frames
    }

    /// Byte 2 of slot 0 as it is now.
    pub fn in_op(&self) -> bool {
        self.board.engine().state().state() == Some(MasterState::Op)
    }

    pub fn state(&self) -> StateByte {
        self.board.engine().state()
    }
}

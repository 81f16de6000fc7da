//! A board with a random network: slave 1 is an IO module, which marks the entries, the others have axes.

use ecmsk::cia402::{Mode, Statusword};
use ecmsk::engine::{Board, EngineConfig};
use ecmsk::fieldbus::Fieldbus;
use ecmsk::fieldbus::sim::{SimBus, SimHandle};
use ecmsk::sk::{
    AxisTarget, CycleTime, DcShift, DriveSync, Frame, HspResponse, MasterCommand, MasterState, Motion, SlaveCommand,
    SlaveKind, SlotSize, StateByte,
};
use ecmsk::slave::{Channels, Drive, DriveConfig, HomeSwitch, Hsp, HspConfig, Io, Slave, Travel};

use crate::tap::{Seen, Tap, Track};
use support::dice::Dice;
use support::swift::SWIFT;

/// The IO module, whose IO_RD in every frame names the frame.
pub const MARKER: usize = 1;
/// Speed of the programs, counts/s: two turns.
pub const SPEED: i32 = 2 << 17;

/// A travel so short that homing on it ends within a schedule.
fn short_travel(turn: i64) -> Travel {
    Travel {
        negative_limit: Some(-turn / 4),
        positive_limit: Some(turn / 4),
        home: Some(HomeSwitch::Cam { first: -turn / 50, last: turn / 50 }),
        ..Travel::for_turn(DriveConfig::default().motor.counts_per_turn)
    }
}

/// A slave with axes.
pub struct Unit {
    pub slave: usize,
    pub kind: SlaveKind,
    /// DRIVE_MODE.
    pub mode: Mode,
    /// Axes whose targets and positions are on the wire.
    pub axes: usize,
    pub seen: Seen,
    pub track: Track,
}

impl Unit {
    fn random(slave: usize, size: SlotSize, dice: &mut Dice) -> (Box<dyn Slave>, Self) {
        const TURN: i64 = 1 << 17;
        let modes: &[Mode];
        let (kind, axes);
        let model: Box<dyn Slave>;
        match dice.below(6) {
            0 => {
                (kind, modes, axes) = (SlaveKind::Step, &[Mode::Csp], 1);
                model = Box::new(Drive::new(DriveConfig {
                    position: dice.below(1 << 30) as i64,
                    ..DriveConfig::stepper()
                }));
            }
            1 | 2 => {
                let channels = dice.pick(&[Channels::One, Channels::Two]);
                let both = channels == Channels::Two && size == SlotSize::Bytes16;
                (kind, modes, axes) = (SlaveKind::Hsp, &[Mode::Csp, Mode::Csp, Mode::Csv], if both { 2 } else { 1 });
                model = Box::new(Hsp::new(HspConfig::with(channels)));
            }
            _ => {
                (kind, modes, axes) = (SlaveKind::Drive, &[Mode::Csp, Mode::Csp, Mode::Csv, Mode::Cst], 1);
                let far = dice.below(1 << 34) as i64 - (1 << 33);
                let near = dice.below(TURN as u64) as i64 - TURN / 2;
                let position = if dice.one_in(4) { far } else { near };
                model = Box::new(Drive::new(DriveConfig {
                    position,
                    travel: short_travel(TURN),
                    ..DriveConfig::default()
                }));
            }
        }
        let (model, shown) = Tap::on(model);
        (model, Self { slave, kind, mode: dice.pick(modes), axes, seen: shown.seen, track: shown.track })
    }

    /// Statusword and the positions of the axes.
    pub fn answer(&self, report: &Frame, size: SlotSize) -> (Statusword, [i32; 2]) {
        let slot = report.slot(size, self.slave);
        // Statusword and first position are at the same place for every kind.
        let answer = HspResponse::decode(&slot, size);
        (answer.statusword, [answer.first.position, answer.second.position])
    }

    /// The motion command of the unit's mode.
    pub fn motion(&self, at: [i32; 2], speed: [i32; 2]) -> SlaveCommand {
        let both = |values: [i32; 2]| {
            let [first, second] = values.map(|target| AxisTarget { target, outputs: 0 });
            Motion { first, second: if self.axes == 2 { second } else { AxisTarget::default() } }
        };
        match self.mode {
            Mode::Csp => SlaveCommand::Csp(both(at)),
            Mode::Csv => SlaveCommand::Csv(both(speed)),
            // Less than friction: the speed that a torque gives an axis is not checked.
            Mode::Cst => SlaveCommand::Cst((speed[0] % 25) as i16),
            Mode::Homing => unreachable!("no DRIVE_MODE"),
        }
    }
}

/// The board and both ends of its network.
pub struct Machine {
    pub board: Board,
    pub network: SimHandle,
    pub size: SlotSize,
    pub cycle: CycleTime,
    pub units: Vec<Unit>,
    /// The delay of an answer beyond one cycle.
    pub late: u64,
    marker: Seen,
}

impl Machine {
    /// The machine of a seed, in PreOP.
    pub fn new(seed: u64) -> Self {
        Self::over(seed, |bus| Box::new(bus))
    }

    /// The same over a bus around its network.
    pub fn over(seed: u64, around: impl FnOnce(SimBus) -> Box<dyn Fieldbus>) -> Self {
        let mut dice = Dice(seed ^ 0x6D61_6368_696E_6521);
        let size = dice.pick(&[SlotSize::Bytes12, SlotSize::Bytes16]);
        let cycle = dice.pick(&[250, 500, 1000, 1000, 2000]);
        let cycle = CycleTime::from_us(cycle).expect("a cycle of the guide's");
        let (io, shown) = Tap::on(Box::new(Io::default()));
        let mut slaves = vec![io];
        let mut units = Vec::new();
        for slave in MARKER + 1..=MARKER + 1 + dice.below(4) as usize {
            let (model, unit) = Unit::random(slave, size, &mut dice);
            slaves.push(model);
            units.push(unit);
        }
        let bus = SimBus::new(slaves).with_timing(SWIFT);
        let network = bus.handle();
        let config = EngineConfig { slot: size, state_timeout_ns: 200_000_000, ..EngineConfig::default() };
        let mut board = Board::new(config, around(bus));
        assert!(board.boot(1_000_000_000));
        Self { board, network, size, cycle, units, late: 0, marker: shown.seen }
    }

    /// The board checks the CRC of command frames from now on.
    pub fn check_commands(&mut self) {
        for command in [MasterCommand::SetEx { check_commands: true, fill_responses: true }, MasterCommand::SoftReset] {
            let mut frame = Frame::new();
            frame.put_master(self.size, &command);
            self.board.host(&frame, self.board.now(), &mut |_, _| {});
        }
        assert!(self.board.boot(1_000_000_000));
    }

    /// The frames that a program sends in PreOP: axes, cycle, modes.
    pub fn set_up(&self) -> Vec<Frame> {
        let mut kinds = [SlaveKind::None; 8];
        kinds[MARKER - 1] = SlaveKind::Io;
        self.units.iter().for_each(|unit| kinds[unit.slave - 1] = unit.kind);
        let mut frames = vec![Frame::new(), Frame::new(), Frame::new()];
        frames[0].put_master(self.size, &MasterCommand::SetAxis { group: 0, kinds });
        frames[1].put_master(self.size, &MasterCommand::SetDc { cycle: self.cycle, shift: DcShift::Auto });
        for unit in &self.units {
            let command = SlaveCommand::DriveMode { mode: unit.mode, sync: DriveSync::DcSync };
            frames[2].put_slave(self.size, unit.slave, &command.into());
        }
        frames[2].put_master(self.size, &MasterCommand::SetState(MasterState::Op));
        frames
    }

    /// Whether byte 2 of slot 0 shows OP now.
    pub fn in_op(&self) -> bool {
        self.board.engine().state().state() == Some(MasterState::Op)
    }

    /// Whether outputs reach a slave, and its answers are up to date.
    pub fn is_heard(&self, slave: usize) -> bool {
        let unit = self.units.iter().find(|unit| unit.slave == slave);
        let seen = unit.map_or(&self.marker, |unit| &unit.seen);
        let in_op = seen.lock().expect("no panic").is_some();
        let found = slave <= self.board.engine().slaves_found().into();
        in_op && found && self.in_op() && !self.board.engine().lost().contains(slave as u8)
    }

    pub fn state(&self) -> StateByte {
        self.board.engine().state()
    }
}

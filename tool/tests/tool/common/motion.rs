//! A fake board in OP that is simpler than the model: the host sends targets, these wait in a queue, and the drives follow
//! them.

use std::collections::{BTreeMap, VecDeque};

use ecmsk::cia402::Statusword;
use ecmsk::sk::{
    DriveResponse, FifoAction, Frame, MASTER_CYCLIC, MasterCommand, MasterResponse, MasterState, Motion, RawSlot,
    SdoCommand, SlaveCommand, SlaveKind, SlaveResponse, SlotSize, StateByte,
};

use super::recordings::Script;

const MS: u64 = 1_000_000;
/// The time between two calls of the host that send a frame, in nanoseconds.
const CALL: u64 = MS / 8;
/// The statusword of a drive in Operation enabled that follows its target (bit 12).
pub const ENABLED: u16 = 0x1637;
/// Statuswords of a drive in homing mode: homing is under way, home is attained.
pub const UNDER_WAY: u16 = 0x0237;
pub const ATTAINED: u16 = 0x1637;
/// The statusword of a drive in Fault.
pub const FAULTED: u16 = 0x0218;
/// Ids of commands that a drive's slot answers.
pub const CSP: u8 = 0x15;
pub const GO_HOME: u8 = 0x18;

/// The fake board and its host, with a cycle of 1 ms, and the frames between them so far.
pub struct FakeBoard {
    pub script: Script,
    pub size: SlotSize,
    /// The time of the first frame, in nanoseconds.
    start_ns: u64,
    now_ns: u64,
    free: u16,
    full: u16,
    /// By how much the full count rises for a lost frame: 1, with firmware 1.5 the number of its 4-byte words.
    pub full_step: u16,
    waiting: VecDeque<Vec<i32>>,
    /// The target of each axis that was executed last, in counts.
    pub targets: Vec<i32>,
    pub positions: Vec<i32>,
    /// The values in the slot of each drive.
    pub drives: Vec<DriveSlot>,
    /// The slots of slaves that are not drives, by their numbers.
    pub slots: BTreeMap<usize, RawSlot>,
    /// The slots of drives in the last report; a lost drive keeps that of the report before it was lost.
    last: BTreeMap<usize, RawSlot>,
    /// The drives that are lost: the state is 0x18, and their slots keep their values.
    pub lost: Vec<usize>,
}

/// In each cycle moves axis 1 by 10 counts and axis 2 by 20 counts.
pub fn go(board: &mut FakeBoard, cycles: std::ops::Range<i32>) {
    for n in cycles {
        board.send(&[10 * n, 20 * n]);
        board.cycle();
    }
}

/// The values in a drive's slot besides position and torque.
#[derive(Clone, Copy)]
pub struct DriveSlot {
    /// The command that the slot answers.
    pub id: u8,
    pub statusword: u16,
    pub error_code: u16,
}

impl FakeBoard {
    /// A board with `axes` drives that is taken to OP.
    pub fn new(size: SlotSize, axes: usize) -> Self {
        Self::of_kind(size, axes, SlaveKind::Drive)
    }

    /// A board with `axes` slaves of this kind that is taken to OP.
    pub fn of_kind(size: SlotSize, axes: usize, kind: SlaveKind) -> Self {
        let mut run = Self::starting(size, axes, kind);
        run.report(MasterState::SafeOp);
        run.report(MasterState::Op);
        run
    }

    /// A board with `axes` slaves of this kind that was asked to go to OP and is not there yet.
    pub fn starting(size: SlotSize, axes: usize, kind: SlaveKind) -> Self {
        Self::starting_with(size, &vec![kind; axes])
    }

    /// A board with slaves of these kinds that is taken to OP.
    pub fn of_kinds(size: SlotSize, kinds: &[SlaveKind]) -> Self {
        let mut run = Self::starting_with(size, kinds);
        run.report(MasterState::SafeOp);
        run.report(MasterState::Op);
        run
    }

    fn starting_with(size: SlotSize, kinds: &[SlaveKind]) -> Self {
        let axes = kinds.len();
        let zeros = vec![0; axes];
        let now_ns = 5 * MS;
        let mut run = Self {
            script: Script::default(),
            size,
            start_ns: now_ns + CALL,
            now_ns,
            free: 160,
            full: 0,
            full_step: 1,
            waiting: VecDeque::new(),
            targets: zeros.clone(),
            positions: zeros,
            drives: vec![DriveSlot { id: 0x15, statusword: ENABLED, error_code: 0 }; axes],
            slots: BTreeMap::new(),
            last: BTreeMap::new(),
            lost: Vec::new(),
        };
        for group in 0..axes.div_ceil(8) {
            let kind = |k| kinds.get(group * 8 + k).copied().unwrap_or(SlaveKind::None);
            run.master(&MasterCommand::SetAxis { group: group as u8, kinds: std::array::from_fn(kind) });
        }
        run.master(&MasterCommand::SetState(MasterState::Op));
        run
    }

    /// The time of the last frame, seconds since the first one.
    pub fn seconds(&self) -> f64 {
        (self.now_ns - self.start_ns) as f64 / 1e9
    }

    /// How many commands wait in the FIFO.
    pub fn waiting(&self) -> u16 {
        self.waiting.len() as u16
    }

    /// The host sends SET_FIFO 1 (clear). The frame with this command is then the only entry of the FIFO.
    pub fn clear(&mut self) {
        self.master(&MasterCommand::SetFifo(FifoAction::Clear));
        self.waiting.clear();
        self.waiting.push_back(self.targets.clone());
        self.free = 159;
    }

    /// The host sends SET_FIFO 2 (threshold). Its frame is an entry of the FIFO, which changes no target.
    pub fn threshold(&mut self, free: u32) {
        self.master(&MasterCommand::SetFifo(FifoAction::Threshold(free)));
        self.waiting.push_back(self.waiting.back().unwrap_or(&self.targets).clone());
    }

    /// The host sends a command in slot 0.
    pub fn master(&mut self, command: &MasterCommand) {
        let mut frame = Frame::new();
        frame.put_master(self.size, command);
        frame.fill_crc(self.size);
        self.now_ns += CALL;
        self.script.command(self.now_ns, frame);
    }

    /// The host sends an SDO command.
    pub fn sdo(&mut self, command: &SdoCommand) {
        let mut frame = Frame::new();
        frame.put_sdo(self.size, command);
        frame.fill_crc(self.size);
        self.now_ns += CALL;
        self.script.command(self.now_ns, frame);
    }

    /// The host sends targets, one for each axis. If the FIFO is full, the targets are lost and the full count rises.
    pub fn send(&mut self, targets: &[i32]) {
        let mut frame = Frame::new();
        for (slave, target) in (1..).zip(targets) {
            frame.put_slave(self.size, slave, &SlaveCommand::Csp(Motion::to(*target)).into());
        }
        frame.fill_crc(self.size);
        self.now_ns += CALL;
        self.script.command(self.now_ns, frame);
        if self.waiting.len() == 160 {
            self.full += self.full_step;
        } else {
            self.waiting.push_back(targets.to_vec());
        }
    }

    /// The host sends a command for one slave, and nothing for the others.
    pub fn send_to(&mut self, slave: usize, command: &SlaveCommand) {
        let mut frame = Frame::new();
        frame.put_slave(self.size, slave, &(*command).into());
        frame.fill_crc(self.size);
        self.now_ns += CALL;
        self.script.command(self.now_ns, frame);
        self.waiting.push_back(self.targets.clone());
    }

    /// The host sends targets just when a cycle begins: they are sent before the report of the cycle, but the board puts them
    /// into the FIFO only after the cycle.
    pub fn send_across_a_cycle(&mut self, targets: &[i32]) {
        let waiting = self.waiting.clone();
        self.send(targets);
        self.waiting = waiting;
        self.cycle();
        self.waiting.push_back(targets.to_vec());
    }

    /// Runs a cycle: the next targets in the FIFO are executed, each drive goes a tenth of the distance to its target, and the
    /// host reads the report.
    pub fn cycle(&mut self) {
        if let Some(next) = self.waiting.pop_front() {
            self.targets = next;
        }
        for (n, (position, target)) in (1..).zip(self.positions.iter_mut().zip(&self.targets)) {
            if !self.lost.contains(&n) {
                *position = position.wrapping_add(target.wrapping_sub(*position) / 10);
            }
        }
        self.free = 160 - self.waiting.len() as u16;
        self.report(MasterState::Op);
    }

    /// The host reads a report with the state `state`, made at the next full millisecond.
    pub fn report(&mut self, state: MasterState) {
        self.now_ns = (self.now_ns / MS + 1) * MS;
        let mut frame = Frame::new();
        let op = state == MasterState::Op;
        let id = if op { MASTER_CYCLIC } else { 0 };
        let (fifo_free, full_count) = if op { (self.free, self.full) } else { (0, 0) };
        let state_byte = match self.lost.is_empty() {
            true => StateByte::reached(state),
            false => StateByte::failed(Some(state)),
        };
        let head = MasterResponse { id, state: state_byte, fifo_free, full_count, ..Default::default() };
        frame.put(self.size, 0, &head.encode());
        if op {
            for (i, (position, target)) in self.positions.iter().zip(&self.targets).enumerate() {
                let torque = (target.wrapping_sub(*position) / 4).clamp(-3000, 3000) as i16;
                let DriveSlot { id, statusword, error_code } = self.drives[i];
                let (head, statusword) = (SlaveResponse { id, index: 0 }, Statusword(statusword));
                let drive = DriveResponse { head, statusword, position: *position, torque, error_code };
                if !self.lost.contains(&(i + 1)) {
                    self.last.insert(i + 1, drive.encode());
                }
                frame.put(self.size, i + 1, &self.last[&(i + 1)]);
            }
            for (slave, slot) in &self.slots {
                frame.put(self.size, *slave, slot);
            }
        }
        frame.fill_crc(self.size);
        self.script.response(self.now_ns, frame);
    }
}

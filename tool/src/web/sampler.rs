//! Extracts points of channels from reports: states, positions, velocities, torques, inputs and the FIFO level.

use ecmsk::recording::Kinds;
use ecmsk::sk::dump::MAX_SLAVES;
use ecmsk::sk::{
    CommandId, DriveResponse, FIFO_ENTRIES, Frame, HspResponse, IoResponse, MasterResponse, MasterState, SlaveKind,
    SlotSize,
};

use super::channels::{Channels, Naming, Quantity};
use crate::plot::speed::Speed;

/// Extracts points of channels from reports. It keeps the last positions, to compute velocities, and which inputs and
/// outputs were ever 1.
pub struct Sampler {
    /// Whether positions, velocities, torques, inputs and the FIFO level are extracted, in addition to states. For the
    /// page of a recording they come from the plot.
    motion: bool,
    speeds: [Speed; MAX_SLAVES],
    /// For each slave, the bits of the inputs and of the outputs that were ever 1.
    used: [[u16; 2]; MAX_SLAVES],
}

impl Sampler {
    /// `motion`: extracts positions, velocities, torques, inputs and the FIFO level too, and not only states.
    pub fn new(motion: bool) -> Self {
        Self { motion, speeds: std::array::from_fn(|_| Speed::default()), used: [[0; 2]; MAX_SLAVES] }
    }

    /// Adds the points of a report to `channels`, for the board and each slave, at the time `at_ns`.
    pub fn report(
        &mut self,
        channels: &mut Channels,
        naming: &impl Naming,
        at_ns: i64,
        (frame, size): (&Frame, SlotSize),
        kinds: &Kinds,
    ) {
        let board = MasterResponse::decode(&frame.slot(size, 0));
        let mut put = |slave, quantity, bit, value: i64| {
            channels.push((slave, quantity, bit), naming, (at_ns, value));
        };
        put(0, Quantity::AlState, 0, board.state.0.into());
        if !matches!(board.state.state(), Some(MasterState::SafeOp | MasterState::Op)) {
            self.speeds.iter_mut().for_each(Speed::reset);
            return;
        }
        if self.motion {
            put(0, Quantity::FifoFree, 0, board.fifo_free.min(FIFO_ENTRIES).into());
        }
        put(0, Quantity::FullCount, 0, board.full_count.into());
        for slave in 1..=size.max_slaves() {
            let slot = frame.slot(size, slave);
            let number = slave as u8;
            let kind =
                kinds.of(slave).or_else(|| CommandId::from_code(slot.id).is_for_axes().then_some(SlaveKind::Drive));
            match kind {
                Some(SlaveKind::Drive | SlaveKind::Step) => {
                    let drive = DriveResponse::decode(&slot);
                    put(number, Quantity::Statusword, 0, drive.statusword.0.into());
                    put(number, Quantity::ErrorCode, 0, drive.error_code.into());
                    if self.motion {
                        put(number, Quantity::Torque, 0, drive.torque.into());
                        self.position(&mut put, number, at_ns, drive.position);
                    }
                }
                Some(SlaveKind::Hsp) => {
                    let hsp = HspResponse::decode(&slot, size);
                    put(number, Quantity::Statusword, 0, hsp.statusword.0.into());
                    if self.motion {
                        self.position(&mut put, number, at_ns, hsp.first.position);
                        self.bits(&mut put, number, Quantity::Input, hsp.first.inputs);
                    }
                }
                Some(SlaveKind::Io) if self.motion => {
                    let io = IoResponse::decode(&slot);
                    let is_output = CommandId::from_code(io.head.id) == CommandId::IoWrite;
                    let quantity = if is_output { Quantity::Output } else { Quantity::Input };
                    self.bits(&mut put, number, quantity, io.bits);
                }
                _ => {}
            }
        }
    }

    fn position(&mut self, put: &mut impl FnMut(u8, Quantity, u8, i64), slave: u8, at_ns: i64, position: i32) {
        put(slave, Quantity::Position, 0, position.into());
        if let Some((_, velocity)) = self.speeds[usize::from(slave) - 1].position(at_ns, position.into()) {
            put(slave, Quantity::Velocity, 0, (velocity / Quantity::Velocity.step()).round() as i64);
        }
    }

    /// Adds a point for each input or output that was ever 1. The other ones get no channel.
    fn bits(&mut self, put: &mut impl FnMut(u8, Quantity, u8, i64), slave: u8, quantity: Quantity, bits: u16) {
        let used = &mut self.used[usize::from(slave) - 1][usize::from(quantity == Quantity::Output)];
        *used |= bits;
        for bit in (0..16).filter(|bit| *used >> bit & 1 != 0) {
            put(slave, quantity, bit, i64::from(bits >> bit & 1));
        }
    }
}

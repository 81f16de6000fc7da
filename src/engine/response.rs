//! What the inputs of a cycle change: the state of the axes, and the response frame (SK-2, SK-3).

use super::axis::OutputIds;
use super::{Engine, SlotHead};
use crate::fieldbus::{CycleDone, Role};
use crate::sk::{
    CommandId, DriveResponse, HspAxis, HspResponse, IoResponse, MASTER_CYCLIC, MasterResponse, RawSlot, SlaveResponse,
};

impl Engine {
    /// Evaluates a cycle that the bus has completed: lost slaves, the answers of the axes, and the report. `self.inputs`
    /// has the inputs of the slaves in this cycle.
    pub(super) fn complete(&mut self, done: &CycleDone) {
        let carried = done.outputs.filter(|id| Some(*id) > self.newest_answered && *id < self.next_output_id);
        self.note_lost(done.at);
        self.count_unreached(carried);
        if let Some(id) = carried.filter(|id| *id >= self.op_from) {
            self.show_heads(id);
        }
        if self.network().in_op() {
            self.answer_axes();
            self.answer_homing(done);
            self.refresh_slave_slots();
            self.refresh_response();
            self.note_working_counter(done);
        }
        if carried.is_some() {
            (self.newest_answered, self.last_carried) = (carried, done.at);
        }
    }

    /// Refreshes the response frame, except the slots of slaves in OP, which only the inputs of a cycle change.
    pub(super) fn refresh_response(&mut self) {
        if !self.network().in_op() {
            self.refresh_heads();
        }
        let size = self.config.slot;
        let sdo = *self.volatile.sdo.answer();
        self.volatile.response.put(size, size.sdo_slot(), &sdo);
        self.volatile.response.put(size, 0, &self.master_response().encode());
        if self.volatile.switches.fill_responses {
            self.volatile.response.fill_crc(size);
        }
    }

    fn master_response(&self) -> MasterResponse {
        let op = self.network().in_op();
        MasterResponse {
            id: if op { MASTER_CYCLIC } else { self.volatile.master_id.code() },
            error: self.config.firmware.error_byte(self.volatile.crc_errors),
            state: self.network().state_byte(),
            result: self.volatile.master_result,
            fifo_free: if op { self.fifo_free() } else { 0 },
            full_count: if op { self.fifo.full_count() } else { 0 },
        }
    }

    /// All axes evaluate the inputs of the cycle, except those of lost slaves and of slaves whose inputs were kept from
    /// an earlier cycle: old inputs must not switch a drive on.
    pub(super) fn answer_axes(&mut self) {
        let unanswered = self.network().lost().union(self.inputs.held);
        for slave in 1..usize::from(self.network().found()) + 1 {
            if !unanswered.contains(slave as u8) {
                self.answer_slave(slave);
            }
        }
    }

    #[inline]
    pub(super) fn answer_slave(&mut self, slave: usize) {
        let Some(mode) = self.role(slave).mode() else { return };
        let (axes, at) = (self.axes(slave), self.last_passed);
        let n = slave - 1;
        let ids = OutputIds { sent_until: self.unconfirmed_from, next: self.next_output_id };
        let answers = self.inputs.slaves[n].iter().zip(self.volatile.modes_written[n]);
        for (axis, (input, written)) in self.axes[n].iter_mut().zip(answers).take(axes) {
            axis.answer(at, input, mode, written, ids);
        }
    }

    /// Refreshes the slots of all slaves in OP. This happens in every cycle, also for slaves without a command. The
    /// slots of lost slaves keep their values.
    fn refresh_slave_slots(&mut self) {
        let size = self.config.slot;
        let lost = self.network().lost();
        for slave in 1..size.max_slaves() + 1 {
            if !lost.contains(slave as u8) {
                let slot = self.slave_slot(slave);
                self.volatile.response.put(size, slave, &slot);
            }
        }
    }

    fn slave_slot(&self, slave: usize) -> RawSlot {
        let SlotHead { id, index, output_image } = self.shown_heads[slave - 1];
        let role = self.role(slave);
        let input = &self.inputs.slaves[slave - 1];
        let mode = match role {
            Role::Drive(_) | Role::Step(_) | Role::Hsp(_) => self.volatile.modes_written[slave - 1][0],
            Role::Io | Role::Unused => 0,
        };
        let index = self.config.firmware.byte_1(index, mode);
        let head = SlaveResponse { id, index };
        match role {
            Role::Unused => RawSlot { id, index, ..RawSlot::ZERO },
            Role::Drive(_) | Role::Step(_) => DriveResponse {
                head,
                statusword: input[0].statusword,
                position: input[0].position,
                torque: input[0].torque,
                error_code: input[0].error_code,
            }
            .encode(),
            Role::Hsp(_) => HspResponse {
                head,
                statusword: input[0].statusword,
                first: HspAxis { position: input[0].position, inputs: input[0].inputs },
                second: if self.carries_two_channels(slave) {
                    HspAxis { position: input[1].position, inputs: input[1].inputs }
                } else {
                    HspAxis::default()
                },
            }
            .encode(self.config.slot),
            Role::Io => IoResponse { head, bits: output_image.unwrap_or(input[0].inputs) }.encode(),
        }
    }

    /// Refreshes the slots of slaves outside OP: they show the id and index of the last command. The other bytes keep their
    /// values.
    fn refresh_heads(&mut self) {
        let size = self.config.slot;
        for slave in 1..=size.max_slaves() {
            let SlotHead { id, index, .. } = self.volatile.heads[slave - 1];
            let slot = self.volatile.response.slot(size, slave);
            let is_drive_mode = id == CommandId::DriveMode.code();
            let mode = if is_drive_mode { index } else { slot.index };
            let index = self.config.firmware.byte_1(index, mode);
            self.volatile.response.put(size, slave, &RawSlot { id, index, ..slot });
        }
    }
}

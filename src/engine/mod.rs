//! The EC01M: an exact model of the chip over any [`Fieldbus`]. Plain data and pure steps.
//!
//! [`Engine::host`] takes a command frame with the time of its arrival, [`Engine::cycle`] runs one EtherCAT cycle and
//! gives the report. The engine never sleeps, never asks for the time and allocates nothing after it was made. Two
//! runners drive it: [`Threaded`] on the real clock, [`Stepped`] on a virtual one.

mod axis;
mod board;
mod commands;
mod counters;
mod fault_reset;
mod fifo;
mod firmware;
mod go_home;
mod handle;
mod handover;
mod homing;
mod jobs;
mod lost;
mod network;
mod outputs;
mod outputs_record;
mod partial_frames;
mod realtime;
mod reports;
mod response;
mod restore;
mod sdo;
mod snapshot;
mod state_failure;
mod stepped;
mod sync;
mod test_mode;
mod threaded;
mod unexecuted;
mod volatile;

use std::collections::VecDeque;

pub use board::{Board, Script};
pub use counters::{Counters, Event, Reason, Rejection};
pub use firmware::Firmware;
pub use go_home::HomingPhase;
pub use handle::BoardHandle;
pub use homing::HomingEnd;
pub use partial_frames::{INCOMPLETE_CYCLES, PartialFrames};
pub use realtime::{Rate, RealTime};
pub use reports::Report;
pub use snapshot::{Leds, Snapshot};
pub use state_failure::StateFailure;
pub use stepped::{Stepped, Stop};
pub use test_mode::{ALL_ON_NS, ONE_ON_NS};
pub use threaded::{Lateness, Threaded};
pub use unexecuted::Unexecuted;

use crate::fieldbus::{Fieldbus, Inputs, MAX_SLAVES, Ns, Outputs, Pacing, Role, SlaveSet};
use crate::sk::{CommandId, CycleTime, Frame, SlotSize, StateByte};
use axis::Axis;
use counters::EventLog;
use fifo::CommandFifo;
use outputs_record::{OutputsHistory, OutputsRecord};
use volatile::{CrcSwitches, FACTORY_CRC, SlotHead, Volatile};

/// What a board is, apart from what programs tell it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EngineConfig {
    /// CONFIG2.
    pub slot: SlotSize,
    /// Firmware.
    pub firmware: Firmware,
    /// CONFIG1 high: test mode (SK-4). The board goes to OP by itself and walks the outputs of all IO slaves.
    pub test: bool,
    /// CONFIG3: what becomes of command frames that do not arrive completely.
    pub partial_frames: PartialFrames,
    /// How long a change of state may take. SK-4 \[OURS]: 10 s.
    pub state_timeout_ns: Ns,
    /// How long a slave may take for an SDO. SK-6 \[OURS]: 1 s.
    pub sdo_timeout_ns: Ns,
}

impl Default for EngineConfig {
    fn default() -> Self {
        Self {
            slot: SlotSize::Bytes12,
            firmware: Firmware::V17,
            test: false,
            partial_frames: PartialFrames::Dropped,
            state_timeout_ns: 10_000_000_000,
            sdo_timeout_ns: 1_000_000_000,
        }
    }
}

/// The EC01M.
pub struct Engine {
    config: EngineConfig,
    pacing: Pacing,
    /// Switches that the next boot takes over.
    remembered: CrcSwitches,
    volatile: Volatile,
    fifo: CommandFifo,
    /// What the bus does for the network; beside it a transfer may run.
    job: Option<jobs::NetworkJob>,
    sdo_owner: Option<jobs::SdoOwner>,
    cancel_job: bool,
    cancel_sdo: bool,
    clearing: outputs::Clearing,
    outputs: Outputs,
    /// The bus has not taken them, or they are not the newest that it has sent.
    outputs_left: bool,
    inputs: Inputs,
    next_output_id: u64,
    /// All outputs before these are known to be sent; what was cleared gives its ids back.
    unconfirmed_from: u64,
    /// The first outputs of this OP.
    op_from: u64,
    /// The newest outputs that a polled cycle carried.
    newest_answered: Option<u64>,
    /// Slaves that the cycle answered before this one named as lost.
    lost_before: SlaveSet,
    /// Slaves that were homing when the frame under execution began.
    homing_before: SlaveSet,
    /// What stood behind the outputs under way and behind the newest that were sent, by their id modulo the length.
    records: OutputsHistory,
    /// How OP began, for a clear before any outputs were sent.
    op_start: Box<OutputsRecord>,
    /// FIFO entries whose outputs are not known to be sent yet.
    entries_ahead: VecDeque<outputs::EntryAhead>,
    /// Sets of outputs not known to be sent that can be kept track of.
    unconfirmed_max: u64,
    /// Slaves that a command of the entries executed since the newest outputs is for.
    commanded: SlaveSet,
    /// Heads that the report shows: those of the newest outputs that were sent.
    shown_heads: [SlotHead; MAX_SLAVES],
    /// When the newest cycle of the bus passed.
    last_passed: Ns,
    /// When the bus would like the next cycle.
    next_deadline: Option<Ns>,
    /// Fewer slaves answered the newest cycle than should, and the bus names none that is lost.
    working_counter_short: bool,
    local_inputs: u8,
    /// The chip's outputs as the bus was told them last.
    local_outputs_told: u8,
    reports_suppressed: bool,
    boots: u64,
    counters: Counters,
    log: EventLog,
}

impl Engine {
    /// A board that was just switched on, over a bus of that pacing.
    pub fn new(config: EngineConfig, pacing: Pacing) -> Self {
        // A cycle that we run is answered at once. Else some outputs are held, some were sent since the newest look, and
        // some wait for their answer. A loss may be known as much later than an answer.
        let (unconfirmed_max, answered) = match pacing {
            Pacing::Runner => (1, 0),
            Pacing::Bus { depth, answer_delay } => {
                (2 * usize::from(depth) + usize::from(answer_delay), usize::from(answer_delay))
            }
        };
        Self {
            config,
            pacing,
            remembered: FACTORY_CRC,
            volatile: Volatile::new(FACTORY_CRC),
            fifo: CommandFifo::new(),
            job: None,
            sdo_owner: None,
            cancel_job: false,
            cancel_sdo: false,
            clearing: outputs::Clearing::Idle,
            outputs: Outputs::default(),
            outputs_left: false,
            inputs: Inputs::default(),
            next_output_id: 0,
            unconfirmed_from: 0,
            op_from: 0,
            newest_answered: None,
            lost_before: SlaveSet::EMPTY,
            homing_before: SlaveSet::EMPTY,
            records: OutputsHistory::new(unconfirmed_max + answered + 1),
            op_start: Box::new(OutputsRecord::new()),
            entries_ahead: VecDeque::with_capacity(unconfirmed_max + 1),
            unconfirmed_max: unconfirmed_max as u64,
            commanded: SlaveSet::EMPTY,
            shown_heads: [SlotHead::default(); MAX_SLAVES],
            last_passed: 0,
            next_deadline: None,
            working_counter_short: false,
            local_inputs: 0,
            local_outputs_told: 0,
            reports_suppressed: false,
            boots: 1,
            counters: Counters::default(),
            log: EventLog::new(),
        }
    }

    /// What the board is.
    pub const fn config(&self) -> &EngineConfig {
        &self.config
    }

    /// Whether the host interface talks: PreOP was reached since the board booted.
    pub const fn talks(&self) -> bool {
        self.volatile.network.talks()
    }

    /// How often the board has booted: 1, and one more with every SW_RESET. A host interface that was open before a
    /// boot is dead.
    pub const fn boots(&self) -> u64 {
        self.boots
    }

    /// Byte 2 of slot 0.
    pub const fn state(&self) -> StateByte {
        self.volatile.network.state_byte()
    }

    /// Why the state has failed; `None`: it has not.
    pub fn state_failure(&self) -> Option<StateFailure> {
        self.volatile.failure.filter(|_| self.state().is_failed())
    }

    /// The LEDs that show the state.
    pub const fn leds(&self) -> Leds {
        Leds::in_state(self.state())
    }

    /// Slaves that are lost: they fell from SafeOP or OP, and no SET_STATE has brought them back (SK-4).
    pub const fn lost(&self) -> SlaveSet {
        self.volatile.network.lost()
    }

    /// Slaves found at boot.
    pub const fn slaves_found(&self) -> u8 {
        self.volatile.network.found()
    }

    /// Time between two reports: the EtherCAT cycle in OP, the default cycle before (SK-9).
    pub const fn period_ns(&self) -> Ns {
        if self.volatile.network.in_op() { self.volatile.cycle_in_op.ns() } else { CycleTime::DEFAULT.ns() }
    }

    /// The longer one of the cycles in OP and before it.
    pub(crate) fn longest_period_ns(&self) -> Ns {
        self.volatile.cycle.max(CycleTime::DEFAULT).ns()
    }

    /// Free entries of the command FIFO, wherever the entries lie.
    pub fn fifo_free(&self) -> u16 {
        self.fifo.free(self.entries_ahead.len() as u16)
    }

    /// Counters since the board was switched on; SW_RESET does not touch them.
    pub const fn counters(&self) -> &Counters {
        &self.counters
    }

    /// Events so far: rejections and other things that the wire does not show.
    pub const fn events_total(&self) -> u64 {
        self.log.total()
    }

    /// Events from number `from` on, oldest first; only the last 32 are kept.
    pub fn events_since(&self, from: u64) -> impl Iterator<Item = Event> {
        self.log.since(from)
    }

    /// The chip's six inputs, bit k is input k (SK-8).
    pub const fn set_local_inputs(&mut self, bits: u8) {
        self.local_inputs = bits & 0x3F;
    }

    /// The chip's six outputs as LIO_WR wrote them.
    pub const fn local_outputs(&self) -> u8 {
        self.volatile.local_outputs
    }

    /// Makes no reports any more, while everything else goes on; or makes them again. A fault on demand.
    pub(super) const fn suppress_reports(&mut self, reports_suppressed: bool) {
        self.reports_suppressed = reports_suppressed;
    }

    /// Takes nothing out of the FIFO any more, so that it fills; or goes on. A fault on demand: SW_RESET does not end it.
    pub(super) const fn hold_fifo(&mut self, held: bool) {
        self.fifo.hold(held);
    }

    /// Puts down something that the wire does not show.
    pub(crate) fn note(&mut self, event: Event) {
        self.log.push(event);
    }

    /// A command frame has arrived completely.
    pub fn host(&mut self, frame: &Frame, at: Ns) {
        if !self.talks() {
            self.counters.while_booting += 1;
            return;
        }
        let size = self.config.slot;
        self.counters.frames += 1;
        if self.volatile.switches.check_commands && frame.crc(size) != frame.crc_byte() {
            self.volatile.crc_errors = self.volatile.crc_errors.wrapping_add(1);
            self.counters.crc += 1;
            return;
        }
        if !self.volatile.network.in_op() {
            return self.execute(frame, at);
        }
        // SK-5 [OURS]: these three act on arrival, before queueing and also when the FIFO is full.
        let boots = self.boots;
        let slot = frame.slot(size, 0);
        if CommandId::from_code(slot.id).acts_on_arrival() {
            self.execute_master(&slot, at);
        }
        if self.boots != boots {
            return;
        }
        let ahead = self.entries_ahead.len() as u16;
        if !self.fifo.push(frame, ahead, self.config.firmware, size) {
            self.counters.full += 1;
        }
    }

    /// Of a command frame only the first `bytes` bytes came, and no more are waited for.
    fn frame_incomplete(&mut self, bytes: usize, at: Ns) {
        self.counters.incomplete += 1;
        self.log.push(Event::Incomplete { at, bytes: bytes as u16 });
    }

    /// A boot has cut off a command frame on its way.
    fn frame_cut_off(&mut self) {
        self.counters.incomplete += 1;
    }

    /// Runs one cycle at `now`: the bus's jobs, FIFO entries, process data, and the report, which goes to `report` with
    /// the time it belongs to. Says whether a cycle of the bus passed at all: with the cable cut before the first
    /// slave none does. In OP there is no report then; before OP the board makes its reports by its own cycle, whatever
    /// the bus does (SK-9).
    pub fn cycle(&mut self, now: Ns, bus: &mut dyn Fieldbus, report: &mut dyn FnMut(&Frame, Ns)) -> bool {
        if let Some(bits) = bus.local_inputs() {
            self.set_local_inputs(bits);
        }
        self.run_jobs(now, bus);
        self.run_clear(now, bus);
        if self.config.test {
            self.run_test(now);
        }
        if self.volatile.network.in_op() {
            self.push_outputs(now, bus);
        }
        let (in_op, mut passed) = (self.volatile.network.in_op(), false);
        while let Some(done) = bus.poll(now, &mut self.inputs) {
            passed = true;
            self.note_confirmed(&done);
            self.last_passed = done.at;
            self.next_deadline = done.next_deadline;
            self.complete(&done);
            if in_op {
                self.give_report(done.at, report);
            }
            if self.pacing == Pacing::Runner {
                break;
            }
        }
        if !in_op {
            if self.is_bus_silent(now) {
                self.note_silence(now);
            }
            // A board that boots has nobody to read it: a boot is hundreds of cycles.
            if self.talks() {
                self.refresh_response();
            }
            self.give_report(now, report);
        }
        if self.volatile.local_outputs != self.local_outputs_told {
            self.local_outputs_told = self.volatile.local_outputs;
            bus.set_local_outputs(self.volatile.local_outputs);
        }
        passed
    }

    /// When the cycle after the one at `now` is due: a period later, or when the bus has asked for it, half a period
    /// sooner or later at most \[OURS].
    pub(super) fn next_cycle(&mut self, now: Ns) -> Ns {
        let period = self.period_ns();
        let planned = now + period;
        let asked = self.next_deadline.take().unwrap_or(planned);
        asked.clamp(planned - period / 2, planned + period / 2)
    }

    fn give_report(&mut self, at: Ns, report: &mut dyn FnMut(&Frame, Ns)) {
        if self.talks() && !self.reports_suppressed {
            self.counters.reports += 1;
            report(&self.volatile.response, at);
        }
    }

    /// Time without a cycle of the bus that is no silence. A bus that owns its cycle passes none in some of ours: by its
    /// phase, by jitter, and when the cycle changes \[OURS: two of its longest cycles], and answers come later still.
    pub(crate) fn silence_tolerance_ns(&self) -> Ns {
        match self.pacing {
            Pacing::Runner => 0,
            Pacing::Bus { answer_delay, .. } => (2 + Ns::from(answer_delay)) * self.longest_period_ns(),
        }
    }

    /// Whether the cable before the first slave seems to be cut.
    fn is_bus_silent(&self, now: Ns) -> bool {
        now - self.last_passed > self.silence_tolerance_ns()
    }

    /// SW_RESET: all variables but the switches of SET_EX, which take effect now. The interface talks again when the
    /// boot has reached PreOP.
    fn reset(&mut self) {
        self.counters.cleared += u64::from(self.fifo.reset());
        self.clear_ahead();
        self.drop_deferred();
        self.set_second_axes(SlaveSet::EMPTY);
        self.volatile = Volatile::new(self.remembered);
        (self.cancel_job, self.cancel_sdo) = (true, true);
        self.drop_commanded();
        self.shown_heads = [SlotHead::default(); MAX_SLAVES];
        self.boots += 1;
    }

    fn clear_fifo(&mut self) {
        self.counters.cleared += u64::from(self.fifo.clear());
        self.clear_ahead();
    }

    /// How many axes a slave has in its role: those that SV_ON, SV_OFF and ALM_CLR act on, whatever the size of a slot
    /// \[OURS].
    fn axes(&self, slave: usize) -> usize {
        match self.role(slave) {
            Role::Io | Role::Unused => 0,
            Role::Drive(_) | Role::Step(_) => 1,
            Role::Hsp(_) => 1 + usize::from(self.volatile.second_axes.contains(slave as u8)),
        }
    }

    /// Whether a slave's slot carries two channels (SK-3): in 12-byte mode a module of two moves axis 1 only \[OURS].
    fn carries_two_channels(&self, slave: usize) -> bool {
        self.config.slot == SlotSize::Bytes16 && self.volatile.second_axes.contains(slave as u8)
    }

    /// Whether commands for that slave's slot have somebody to go to.
    fn role(&self, slave: usize) -> Role {
        if slave <= usize::from(self.volatile.network.found()) { self.volatile.roles[slave - 1] } else { Role::Unused }
    }
}

#[cfg(test)]
mod handover_tests;

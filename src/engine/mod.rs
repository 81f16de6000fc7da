//! The EC01M: an exact model of the chip over any [`Fieldbus`](crate::fieldbus::Fieldbus). Plain data and pure steps.
//!
//! [`Engine::host`] takes a command frame with the time of its arrival, and [`Engine::cycle`] runs one EtherCAT cycle
//! and makes the report. The engine never sleeps, never reads a clock, and allocates nothing after it was made. Two
//! runners drive it: [`Threaded`] on the real clock, [`Stepped`] on a virtual one.
//!
//! | file | what it has |
//! | --- | --- |
//! | `mod.rs`, `config.rs` | the engine: its state, the handling of a command frame; its pins and its firmware |
//! | `cycle.rs` | what happens in one cycle, and when the next one is due |
//! | `commands.rs` | the effect of each command of the board, and the reasons for rejecting one |
//! | `fifo.rs`, `partial_frames.rs` | the FIFO in which frames wait for their cycle; frames that arrive in pieces |
//! | `sdo.rs` | the SDO slot |
//! | `outputs.rs` | the way of commands into process data, which outputs were sent, what SET_FIFO takes back |
//! | `outputs_record.rs` | the history of outputs, for that |
//! | `response.rs` | the way of inputs into the response frame |
//! | `axis.rs`, `fault_reset.rs` | SV_ON, SV_OFF, ALM_CLR and the targets of one axis |
//! | `go_home.rs`, `homing.rs`, `restore.rs` | GO_HOME and ABORT_HOME; homing of one axis; its mode of operation after it |
//! | `network.rs`, `jobs.rs` | SET_STATE: the steps from state to state, and the jobs of the bus for them |
//! | `lost.rs`, `state_failure.rs` | lost slaves; why a change of state has failed |
//! | `volatile.rs`, `firmware.rs` | the state that SW_RESET resets; the differences of firmware 1.5 from 1.7 |
//! | `test_mode.rs`, `switch_off.rs` | test mode; switching a board off |
//! | `counters.rs`, `event.rs`, `unexecuted.rs`, `snapshot.rs` | the state of a board that the wire does not show |
//! | `board.rs`, `handle.rs` | the engine with its bus and its time; faults that scripts and tests cause |
//! | `stepped.rs`, `threaded.rs`, `realtime.rs`, `lateness.rs` | the runners: how time passes, and how late cycles are |
//! | `handover.rs`, `reports.rs` | the queues of frames and reports between host and board |
//!
//! To add a command of the board: its id and arguments in `sk/command_table.rs` and `sk/command`, its effect in `commands.rs`.

mod arrivals;
mod axis;
mod board;
mod commands;
mod config;
mod counters;
mod cycle;
mod event;
mod fault_reset;
mod fifo;
mod firmware;
mod go_home;
mod handle;
mod handover;
mod homing;
mod jobs;
mod lateness;
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
mod switch_off;
mod test_mode;
mod threaded;
mod unexecuted;
mod volatile;

use std::collections::VecDeque;

pub use board::{Board, Script};
pub use config::EngineConfig;
pub use counters::{Counters, Reason};
pub use event::{Event, EventKind, Rejection};
pub use firmware::Firmware;
pub use go_home::HomingPhase;
pub use handle::BoardHandle;
pub use homing::HomingEnd;
pub use lateness::{LATENESS_BOUNDS_NS, Lateness};
pub use partial_frames::{INCOMPLETE_CYCLES, PartialFrames};
pub use realtime::{Rate, RealTime};
pub use reports::Report;
pub use snapshot::{Leds, Snapshot};
pub use state_failure::{SlaveFall, StateFailure};
pub use stepped::{Stepped, Stop};
pub use test_mode::{ALL_ON_NS, ONE_ON_NS};
pub use threaded::Threaded;
pub use unexecuted::Unexecuted;

use crate::fieldbus::{Inputs, MAX_AXES, MAX_SLAVES, Ns, Outputs, Pacing, Role, SlaveSet};
use crate::sk::{CommandId, CycleTime, Frame, SlotSize, StateByte};
use crate::threads::sync;
use axis::{AllAxes, Axis};
use event::EventLog;
use fifo::CommandFifo;
use outputs_record::{COMMANDED_SETS, History, OutputsRecord};
use volatile::{CrcSwitches, FACTORY_CRC, SlotHead, Volatile};

/// The model of the EC01M, the chip of the board.
pub struct Engine {
    config: EngineConfig,
    pacing: Pacing,
    /// The CRC switches that SET_EX has set. They take effect at the next boot.
    remembered: CrcSwitches,
    volatile: Volatile,
    /// The axes, which SW_RESET resets, too. They are not a field of [`Volatile`]: a reset makes a new value of it on the stack
    /// of a program's thread, and with the axes this would take 8 kB (LIB-73).
    axes: AllAxes,
    fifo: CommandFifo,
    /// The running job of the bus, such as a change of state; SDO transfers are not in it.
    job: Option<jobs::NetworkJob>,
    /// Which side requested the running SDO transfer: the host, or the board. It may run during a change of state.
    sdo_owner: Option<restore::SdoOwner>,
    /// Whether the SDO transfer that ended last was one of the host. Then it is the board's turn.
    host_had_turn: bool,
    cancel_job: bool,
    cancel_sdo: bool,
    clearing: outputs::Clearing,
    outputs: Outputs,
    /// Whether the newest outputs have to be pushed again, because the bus has refused them, or has dropped them in a
    /// clear.
    outputs_left: bool,
    inputs: Inputs,
    next_output_id: u64,
    /// All outputs with a lower id are known to be sent. Ids of cleared outputs are reused.
    unconfirmed_from: u64,
    /// The id of the first outputs since OP was reached. Reports show no commands of earlier outputs, and a clear does
    /// not return the axes to their state at earlier outputs.
    op_from: u64,
    /// The id of the newest outputs that an answered cycle has reported as sent; `None`: none yet.
    newest_answered: Option<u64>,
    /// The slaves that the bus named as lost in the previous answered cycle, to find those that are named for the first
    /// time.
    lost_before: SlaveSet,
    /// The slaves that were homing before the frame whose slots are being executed. `homing_elsewhere`: whether they
    /// exclude every GO_HOME in the frame. Both are determined before the first slot is executed, so that the order of
    /// the slots makes no difference. Slaves that start homing by one frame do not exclude each other.
    homing_before: SlaveSet,
    homing_elsewhere: bool,
    /// The slaves with a GO_HOME in the frame that is being executed. `aborts_homing`: whether that frame has an
    /// ABORT_HOME.
    go_homes: SlaveSet,
    aborts_homing: bool,
    /// For each set of outputs that is not known to be sent, and for the newest one that was sent: the state from which
    /// the set was made.
    records: History<OutputsRecord>,
    /// For each set of outputs in `records`, and for many earlier ones: the slaves for which the set carries a command.
    commanded_by: History<SlaveSet>,
    /// The state when OP was reached. A clear returns to it if no outputs were sent since then.
    op_start: Box<OutputsRecord>,
    /// FIFO entries that were taken out of the FIFO and whose outputs are not known to be sent.
    entries_ahead: VecDeque<outputs::EntryAhead>,
    /// The maximum number of sets of outputs that are not known to be sent, because `records` has room for no more.
    unconfirmed_max: u64,
    /// The slaves for which the next outputs carry an executed command.
    commanded: SlaveSet,
    /// The commands that the slaves' slots in reports show (id, index, output image): the commands of the newest
    /// outputs that were sent.
    shown_heads: [SlotHead; MAX_SLAVES],
    /// When the newest cycle of the bus ran, board time.
    last_passed: Ns,
    /// When the newest cycle that carried new outputs ran, board time.
    last_carried: Ns,
    /// When the next cycle should run to stay in step with the slaves' distributed clocks, as the bus requests; `None`:
    /// one period after the last one.
    next_deadline: Option<Ns>,
    /// Whether, in the newest cycle, the working counter was too low while the bus named no lost slave, or was too high. This
    /// is logged only when it begins.
    working_counter_wrong: bool,
    /// Whether the hardware that runs the bus did not answer in the previous cycle.
    bus_down: bool,
    /// Whether a frame of another master was seen and logged.
    has_told_other_master: bool,
    local_inputs: u8,
    /// The local outputs that were passed to the bus last: a chip that runs the bus has output pins for them. They are
    /// passed again only when LIO_WR has changed them.
    local_outputs_told: u8,
    reports_suppressed: bool,
    boots: u64,
    counters: Counters,
    log: EventLog,
}

impl Engine {
    /// Creates the engine of a board at power-on. `pacing` says whether the bus or the runner decides when a cycle
    /// runs.
    pub fn new(config: EngineConfig, pacing: Pacing) -> Self {
        // `unconfirmed_max`: how many sets of outputs may be pushed and not known to be sent. If the runner decides when a
        // cycle runs, each cycle is answered at once. A bus that runs its own cycle has some sets in its queue, has sent some
        // since the last poll, and some are not answered yet. `answered`: how many sets before these the history keeps, because
        // the bus may name a lost slave as late as an answer can come.
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
            axes: [[Axis::default(); MAX_AXES]; MAX_SLAVES],
            fifo: CommandFifo::new(),
            job: None,
            sdo_owner: None,
            host_had_turn: false,
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
            homing_elsewhere: false,
            go_homes: SlaveSet::EMPTY,
            aborts_homing: false,
            records: History::new(unconfirmed_max + answered + 1, OutputsRecord::new()),
            commanded_by: History::new(unconfirmed_max + answered + 1 + COMMANDED_SETS, SlaveSet::EMPTY),
            op_start: Box::new(OutputsRecord::new()),
            entries_ahead: VecDeque::with_capacity(unconfirmed_max + 1),
            unconfirmed_max: unconfirmed_max as u64,
            commanded: SlaveSet::EMPTY,
            shown_heads: [SlotHead::default(); MAX_SLAVES],
            last_passed: 0,
            last_carried: 0,
            next_deadline: None,
            working_counter_wrong: false,
            bus_down: false,
            has_told_other_master: false,
            local_inputs: 0,
            local_outputs_told: 0,
            reports_suppressed: false,
            boots: 1,
            counters: Counters::default(),
            log: EventLog::new(),
        }
    }

    /// The configuration of the board.
    pub const fn config(&self) -> &EngineConfig {
        &self.config
    }

    /// Whether the host interface answers: PreOP was reached since the board booted.
    pub const fn talks(&self) -> bool {
        self.network().talks()
    }

    /// How often the board has booted: 1 at power-on, and one more with every SW_RESET. A host interface that was
    /// opened before a boot has to be opened again.
    pub const fn boots(&self) -> u64 {
        self.boots
    }

    /// The state of the network as byte 2 of slot 0 shows it.
    pub const fn state(&self) -> StateByte {
        self.network().state_byte()
    }

    /// Whether a boot, a change of state or an SDO transfer is in progress.
    pub fn is_busy(&self) -> bool {
        self.job.is_some() || self.sdo_owner.is_some() || self.network().next_step().is_some()
    }

    /// If a change to a higher state is in progress: its target, and for how long it has been in progress at `now`, ns.
    /// `None`: no change is in progress, or its target is a lower state.
    pub fn going_up(&self, now: Ns) -> Option<(crate::sk::MasterState, Ns)> {
        let (state, target, deadline) = (self.network().state()?, self.network().target()?, self.network().deadline()?);
        let since = deadline.saturating_sub(self.config.state_timeout_ns);
        (target > state).then(|| (target, now.saturating_sub(since)))
    }

    /// Why the last change of state has failed; `None`: no failure.
    pub fn state_failure(&self) -> Option<StateFailure> {
        self.volatile.failure.filter(|_| self.state().is_failed())
    }

    /// The LEDs of the board that show the state of the network.
    pub const fn leds(&self) -> Leds {
        Leds::in_state(self.state())
    }

    /// The lost slaves: they have left SafeOP or OP, and no SET_STATE has brought them back yet (SK-4).
    pub const fn lost(&self) -> SlaveSet {
        self.network().lost()
    }

    /// How many slaves were found at boot.
    pub const fn slaves_found(&self) -> u8 {
        self.network().found()
    }

    /// The time between two reports: the EtherCAT cycle in OP, the default cycle before (SK-9).
    pub const fn period_ns(&self) -> Ns {
        if self.network().in_op() { self.volatile.cycle_in_op.ns() } else { CycleTime::DEFAULT.ns() }
    }

    /// The longer of the cycle time in OP and the default cycle time before OP.
    pub(crate) fn longest_period_ns(&self) -> Ns {
        self.volatile.cycle.max(CycleTime::DEFAULT).ns()
    }

    /// The free entries of the command FIFO. Entries whose outputs a bus has queued and not sent still count as used.
    pub fn fifo_free(&self) -> u16 {
        self.fifo.free(self.entries_ahead.len() as u16)
    }

    /// The counters since the board was switched on; SW_RESET does not reset them.
    pub const fn counters(&self) -> &Counters {
        &self.counters
    }

    /// The number of events so far: rejected commands and everything else in [`EventKind`].
    pub const fn events_total(&self) -> u64 {
        self.log.total()
    }

    /// The events from event number `from` on (counted from 0), oldest first. Only the last 32 are kept.
    pub fn events_since(&self, from: u64) -> impl Iterator<Item = Event> {
        self.log.since(from)
    }

    /// Sets the six local inputs of the chip, as LIO_RD reads them: bit k is input k (SK-8).
    pub const fn set_local_inputs(&mut self, bits: u8) {
        self.local_inputs = bits & 0x3F;
    }

    /// The six local outputs of the chip, as LIO_WR has written them: bit k is output k.
    pub const fn local_outputs(&self) -> u8 {
        self.volatile.local_outputs
    }

    /// With `true` the board makes no reports, with `false` it makes them again. Everything else continues. A fault for
    /// scripts and tests.
    pub(super) const fn suppress_reports(&mut self, suppressed: bool) {
        self.reports_suppressed = suppressed;
    }

    /// With `true` the board takes no entries out of the FIFO, so that it fills up; with `false` it takes them again. A
    /// fault for scripts and tests, which SW_RESET does not end.
    pub(super) const fn hold_fifo(&mut self, held: bool) {
        self.fifo.hold(held);
    }

    /// Adds an event to the log, which keeps the newest 32.
    pub(crate) fn note(&mut self, event: Event) {
        self.log.push(event);
    }

    /// Handles a command frame that has arrived completely at the board time `at`.
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
        if !self.network().in_op() {
            return self.execute(frame, at);
        }
        // SK-5 [OURS]: SET_STATE, SET_FIFO and SW_RESET act on arrival, before the frame is queued and also when the FIFO
        // is full.
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

    /// Counts a command frame that was dropped because only its first `bytes` bytes arrived in time.
    fn frame_incomplete(&mut self, bytes: usize, at: Ns) {
        self.counters.incomplete += 1;
        self.log.push(Event { at, kind: EventKind::Incomplete { bytes: bytes as u16 } });
    }

    /// Counts a command frame as incomplete that a boot of the board has cut off. This is not logged: the SW_RESET
    /// explains the loss.
    fn frame_cut_off(&mut self) {
        self.counters.incomplete += 1;
    }

    /// SW_RESET: resets all variables except the CRC switches of SET_EX, which take effect now. The host interface
    /// answers again when the boot has reached PreOP.
    // Not inlined: otherwise the caller would need the stack for this at every command.
    #[inline(never)]
    fn reset(&mut self) {
        self.counters.cleared += u64::from(self.fifo.reset());
        self.clear_ahead();
        self.drop_deferred();
        self.set_second_axes(SlaveSet::EMPTY);
        self.volatile = Volatile::new(self.remembered);
        axis::reset(&mut self.axes);
        (self.cancel_job, self.cancel_sdo) = (true, true);
        self.drop_commanded();
        self.shown_heads = [SlotHead::default(); MAX_SLAVES];
        self.boots += 1;
    }

    fn clear_fifo(&mut self) {
        self.counters.cleared += u64::from(self.fifo.clear());
        self.clear_ahead();
    }

    /// The number of axes of a slave that SV_ON, SV_OFF and ALM_CLR act on: all axes that the slave has in its role,
    /// whatever the slot size \[OURS].
    fn axes(&self, slave: usize) -> usize {
        match self.role(slave) {
            Role::Io | Role::Unused => 0,
            Role::Drive(_) | Role::Step(_) => 1,
            Role::Hsp(_) => 1 + usize::from(self.volatile.second_axes.contains(slave as u8)),
        }
    }

    /// Whether the slot of a slave carries two channels (SK-3). With 12-byte slots a module of two channels moves axis
    /// 1 only \[OURS].
    fn carries_two_channels(&self, slave: usize) -> bool {
        self.config.slot == SlotSize::Bytes16 && self.volatile.second_axes.contains(slave as u8)
    }

    /// The state of the network as the board sees it.
    const fn network(&self) -> &network::Network {
        &self.volatile.network
    }

    /// Whether, by the newest inputs of a slave, the motor of one of its axes has torque, or SV_ON has enabled the axis.
    fn has_torque(&self, slave: u8) -> bool {
        use crate::ethercat::cia402::DriveState::{FaultReactionActive, OperationEnabled, QuickStopActive};
        let n = usize::from(slave) - 1;
        let axes = self.axes[n].iter().zip(&self.inputs.slaves[n]).take(self.axes(slave.into()));
        axes.into_iter().any(|(axis, input)| {
            let moves = [OperationEnabled, QuickStopActive, FaultReactionActive];
            axis.is_on() || input.statusword.state().is_some_and(|state| moves.contains(&state))
        })
    }

    /// The role of a slave (from 1) in the present configuration of the network; unused for a number without a slave.
    fn role(&self, slave: usize) -> Role {
        if slave <= usize::from(self.network().found()) { self.volatile.roles[slave - 1] } else { Role::Unused }
    }
}

#[cfg(test)]
mod handover_tests;

//! The chip's knowledge of its network: slaves, their states as last read, the layout of process data, the working
//! counter.

use super::network::{IMAGE_MAX, ImageRanges, SLAVES_MAX, SlaveNetwork};
use crate::ethercat::{AlState, AlStatus, Ns};
use crate::xf::request::{DcTiming, SlaveBits, SlaveNumber, WkcErrorLimit};
use crate::xf::{EtherCatState, NetworkState};

/// `[OURS]` Process data travel in LRW until ECAT_INIT_OP or ENABLE_LRW selects otherwise. Firmware that has no such selection
/// always uses LRW.
const LRW_AT_START: bool = true;

/// The state and the clock settings of a slave in the chip's memory, from which the chip answers ECAT_STATE_GET and
/// ECAT_SLV_INFO_GET.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SlaveMemory {
    /// The state as ECAT_STATE_GET reports it: 0 before it was read, and only the error bit if the slave did not answer.
    pub state: NetworkState,
    pub al_status: u16,
    /// The SYNC cycle times and the shift of the slave's clock, as set by ECAT_DCSYNC or ECAT_INIT_OP.
    pub dc: DcTiming,
    /// Whether the last initialisation of the clocks has activated this slave's distributed clock.
    pub dc_active: bool,
}

/// The lengths of a slave's process data that the host has set by commands, in bytes. Index 0 is outputs, index 1 is inputs.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SetLengths {
    /// The lengths of outputs and inputs that CONFIG_SM has set; `None` for a direction that it has not set.
    pub of_managers: [Option<u16>; 2],
    /// The lengths of outputs and inputs that DIRECT_ASSIGN has set; `None` for a direction that it has not set.
    pub assigned: [Option<u16>; 2],
    /// Whether DIRECT_ASSIGN has switched its lengths on. Otherwise the lengths of CONFIG_SM apply or, if it has set
    /// none, the lengths of the slave's mapping objects.
    pub is_assigned: bool,
}

/// What the chip knows of its network: the slaves with their states as last read, process data, and working counter.
pub(super) struct KnownNetwork {
    /// Whether ECAT_INIT_OP has succeeded.
    pub initialised: bool,
    /// Number of slaves that ECAT_INIT_OP has found.
    pub count: u8,
    pub known: [SlaveMemory; SLAVES_MAX],
    pub places: [ImageRanges; SLAVES_MAX],
    pub lengths: [SetLengths; SLAVES_MAX],
    /// The slaves whose mailboxes the host has selected for polling by MBX_STAT. ECAT_RECONFIG_OP and CONFIG_MAP copy
    /// this set to `polls`.
    pub wants_polled: SlaveBits,
    /// The slaves whose mailboxes are polled now.
    pub polls: SlaveBits,
    /// Whether process data are configured and exchanged.
    pub mapped: bool,
    pub rx_bytes: u16,
    pub tx_bytes: u16,
    /// The newest outputs, which are repeated while the RxFIFO is empty.
    pub outputs: [u8; IMAGE_MAX],
    pub inputs: [u8; IMAGE_MAX],
    pub lrw: bool,
    pub working_counter: u16,
    /// Number of all working counter errors, up to 255.
    pub wkc_errors: u8,
    /// Number of working counter errors in a row, up to 255.
    pub wkc_errors_in_a_row: u8,
    pub wkc_limit: WkcErrorLimit,
    /// The time from which on the clocks count as synchronised and the status bit DC_STABLE is set; `None` if no slave
    /// has a clock, or if the clocks are not initialised.
    pub dc_stable_at: Option<Ns>,
    pub cycle_ns: Ns,
}

impl KnownNetwork {
    pub fn new(cycle_ns: Ns) -> Self {
        Self {
            initialised: false,
            count: 0,
            known: [SlaveMemory::default(); SLAVES_MAX],
            places: [ImageRanges::default(); SLAVES_MAX],
            lengths: [SetLengths::default(); SLAVES_MAX],
            wants_polled: SlaveBits::default(),
            polls: SlaveBits::default(),
            mapped: false,
            rx_bytes: 0,
            tx_bytes: 0,
            outputs: [0; IMAGE_MAX],
            inputs: [0; IMAGE_MAX],
            lrw: LRW_AT_START,
            working_counter: 0,
            wkc_errors: 0,
            wkc_errors_in_a_row: 0,
            wkc_limit: WkcErrorLimit::NONE,
            dc_stable_at: None,
            cycle_ns,
        }
    }

    pub fn places(&self) -> &[ImageRanges] {
        &self.places[..self.count.into()]
    }

    pub fn slaves(&self) -> std::ops::Range<u8> {
        0..self.count
    }

    /// The number of slaves with inputs and the number of slaves with outputs.
    pub fn slaves_with(&self) -> (u32, u32) {
        let count = |has: fn(&ImageRanges) -> bool| self.places().iter().filter(|place| has(place)).count() as u32;
        (count(|place| place.input_bytes > 0), count(|place| place.output_bytes > 0))
    }

    /// Whether the host has brought any slave to `state` or to a higher AL state.
    pub fn any_commanded(&self, state: AlState) -> bool {
        self.places().iter().any(|place| place.commanded >= state)
    }

    /// The working counter that a cycle should have. A slave's outputs count only if the chip has brought the slave to
    /// the state `outputs_from` or a higher one.
    pub fn expected_working_counter(&self, outputs_from: AlState) -> u16 {
        self.places().iter().map(|place| place.counts(place.commanded, outputs_from)).sum()
    }

    /// Reads a slave's state and AL status code into the chip's memory. `[OURS]` The error bit is set while the slave
    /// is below the state to which the chip has brought it, or has refused a change. Slave models have no AL status
    /// code: if such a slave is below that state, the chip assumes a watchdog failure, code 0x1B.
    pub fn update(&mut self, network: &impl SlaveNetwork, slave: u8) {
        let (known, place) = (&mut self.known[usize::from(slave)], self.places[usize::from(slave)]);
        let Some(state) = network.state(slave) else {
            known.state = NetworkState(NetworkState::ERROR);
            return;
        };
        let is_below = state < place.commanded;
        match network.al_status(slave) {
            Some(status) => known.al_status = status.0,
            None if is_below => known.al_status = AlStatus::WATCHDOG.0,
            None => {}
        }
        let error = if known.al_status == 0 && !is_below { 0 } else { NetworkState::ERROR };
        known.state = NetworkState(EtherCatState::from(state).code() | error);
    }

    /// Whether the chip polls the slave's mailbox.
    pub fn is_polled(&self, slave: u8) -> bool {
        SlaveNumber::new(slave).is_some_and(|slave| self.polls.contains(slave))
    }

    /// The lengths of a slave's outputs and inputs that the host has set, in bytes; `None` where the slave's mapping objects
    /// decide. `[OURS]` DIRECT_ASSIGN has priority over CONFIG_SM.
    pub fn assigned_lengths(&self, slave: u8) -> [Option<u16>; 2] {
        let set = &self.lengths[usize::from(slave)];
        let direction = |n: usize| set.assigned[n].filter(|_| set.is_assigned).or(set.of_managers[n]);
        [direction(0), direction(1)]
    }

    /// The state of the network: the lowest state of all slaves, with the error bit if any slave has it.
    pub fn state_of_all(&self) -> NetworkState {
        let known = &self.known[..self.count.into()];
        let lowest = known.iter().map(|known| known.state.0 & 0x0F).min().unwrap_or(0);
        let error = known.iter().any(|known| known.state.has_error());
        if self.initialised {
            NetworkState(lowest | if error { NetworkState::ERROR } else { 0 })
        } else {
            NetworkState::NONE
        }
    }

    /// Lays out the process data from the lengths of outputs and inputs of each slave. The caller has checked that they fit
    /// into the process images, [`IMAGE_MAX`] bytes each.
    pub fn lay_out(&mut self, lengths: &[[u16; 2]]) {
        let (mut outputs, mut inputs) = (0, 0);
        for (place, [output_bytes, input_bytes]) in self.places.iter_mut().zip(lengths.iter().copied()) {
            *place = ImageRanges { outputs_at: outputs, output_bytes, inputs_at: inputs, input_bytes, ..*place };
            (outputs, inputs) = (outputs + output_bytes, inputs + input_bytes);
        }
        (self.rx_bytes, self.tx_bytes) = (outputs, inputs);
        self.outputs.fill(0);
        self.inputs.fill(0);
        (self.wkc_errors_in_a_row, self.mapped) = (0, true);
    }

    /// Evaluates a cycle's working counter; returns false if it was wrong. `[OURS]` A working counter that is too high
    /// is not wrong: it comes from slaves that have just gone to a higher state.
    pub fn count(&mut self, working_counter: u16, outputs_from: AlState) -> bool {
        self.working_counter = working_counter;
        let right = working_counter >= self.expected_working_counter(outputs_from);
        if right {
            self.wkc_errors_in_a_row = 0;
        } else {
            self.wkc_errors = self.wkc_errors.saturating_add(1);
            self.wkc_errors_in_a_row = self.wkc_errors_in_a_row.saturating_add(1);
        }
        right
    }

    /// Whether there are more working counter errors in a row than the host's limit allows.
    pub fn is_over_limit(&self) -> bool {
        self.wkc_limit.most().is_some_and(|most| self.wkc_errors_in_a_row > most)
    }
}

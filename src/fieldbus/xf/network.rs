//! What the bus knows of the chip's network.

use crate::ethercat::{AlState, MAX_SLAVES, Ns, SlaveSet};
use crate::fieldbus::SlaveConfig;
use crate::fieldbus::pdo::{Download, MappedDirection, MappingImage, ProcessData};
use crate::sk::CycleTime;

/// What was seen of the objects of a slave that stays in PreOP holds so long; then they are read again. \[OURS] Somebody with a
/// cable at the drive may have changed them.
const SEEN_FOR_NS: Ns = 60_000_000_000;

/// Where the process data of a slave are in the images of the chip.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Place {
    pub outputs_at: usize,
    pub output_bytes: usize,
    pub inputs_at: usize,
    pub input_bytes: usize,
}

/// Which of the objects that a configuration writes a slave has as they are to be.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Mapped {
    /// The process data of its outputs: the mapping of each PDO, and the assignment.
    pub outputs: MappedObjects,
    /// Those of its inputs.
    pub inputs: MappedObjects,
    /// Its synchronization types.
    pub sync: bool,
}

/// Which of the objects that map one direction are as they are to be.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct MappedObjects {
    /// The mapping of each PDO. A drive has PDOs for each mode from the beginning, of which one alone is assigned.
    pub pdos: bool,
    /// The assignment of the PDOs.
    pub assignment: bool,
}

impl MappedObjects {
    const ALL: Self = Self { pdos: true, assignment: true };

    /// Whether nothing of that direction is to be written.
    pub(super) const fn is_whole(self) -> bool {
        self.pdos && self.assignment
    }
}

impl Mapped {
    pub(super) const ALL: Self = Self { outputs: MappedObjects::ALL, inputs: MappedObjects::ALL, sync: true };

    /// Whether the slave needs that download no more. A PDO is changed while it is not assigned, so that what is written to it
    /// takes its assignment along. The mode of operation is written in each configuration: a host may have written another one.
    pub(super) const fn has(&self, download: &Download) -> bool {
        match download.direction() {
            Some(direction) => {
                let objects = self.of(direction);
                objects.is_whole() || objects.pdos && !download.is_assignment()
            }
            None => self.sync && download.is_sync_type(),
        }
    }

    pub(super) const fn of(&self, direction: MappedDirection) -> MappedObjects {
        match direction {
            MappedDirection::Outputs => self.outputs,
            MappedDirection::Inputs => self.inputs,
        }
    }

    /// An object that maps is another one.
    pub(super) const fn differs(&mut self, image: &MappingImage) {
        let objects = match image.direction() {
            MappedDirection::Outputs => &mut self.outputs,
            MappedDirection::Inputs => &mut self.inputs,
        };
        if image.is_assignment() {
            objects.assignment = false;
        } else {
            objects.pdos = false;
        }
    }

    /// Nothing is known of the objects that map.
    pub(super) const fn is_not_mapped(&mut self) {
        self.outputs = MappedObjects { pdos: false, assignment: false };
        self.inputs = self.outputs;
    }
}

/// What is known of the objects of a slave that a configuration writes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    /// For which configuration they were looked at.
    pub config: SlaveConfig,
    pub data: ProcessData,
    pub mapped: Mapped,
    /// What it has mapped is as long as what it is to have: a layout of the one is one of the other.
    pub is_as_long: bool,
    /// When, in time of the wires.
    pub at: Ns,
}

impl Seen {
    /// A slave has all that a configuration writes.
    pub(super) const fn all(config: SlaveConfig, data: ProcessData) -> Self {
        Self { config, data, mapped: Mapped::ALL, is_as_long: true, at: 0 }
    }
}

/// The network. Slave n is at place n - 1 of each list.
#[derive(Clone, Debug)]
pub(super) struct Network {
    /// The chip has initialised it since its last start.
    pub initialised: bool,
    pub cycle: CycleTime,
    /// As the last scan found.
    pub found: u8,
    pub with_dc: SlaveSet,
    /// The state to which the newest job has brought a slave; it may have left it by itself.
    pub commanded: [AlState; MAX_SLAVES],
    /// What is mapped for the role of a slave; `None`: it has none.
    pub process_data: [Option<ProcessData>; MAX_SLAVES],
    pub places: [Place; MAX_SLAVES],
    /// Slaves that were configured since the network was started; whether the chip has their process data, says
    /// [`Self::with_process_data`].
    pub configured: SlaveSet,
    /// What was seen of the objects of a slave; `None`: nothing, or they may have changed since.
    pub seen: [Option<Seen>; MAX_SLAVES],
    /// The chip has laid out process data as the slaves have mapped them, and no slave has left PreOP and come back since.
    pub laid_out: bool,
    /// The chip has laid out process data, and the slaves are configured.
    pub mapped: bool,
    /// Bytes of one RxPDO of the chip: the outputs of all slaves.
    pub rx_bytes: usize,
    /// Bytes of one TxPDO of the chip: the inputs of all slaves.
    pub tx_bytes: usize,
    /// Entries of each FIFO.
    pub entries: u8,
    /// How many exchanges of process data may be under way, 1 or 2.
    pub in_flight: usize,
    /// How many sets of outputs the transport takes, beside those that bridge a stall.
    pub transport_sets: u16,
    pub lost: SlaveSet,
    /// Those of them that answer, and whose inputs were not believed for too long.
    pub stale: SlaveSet,
    /// The first outputs that a lost slave may not have got.
    pub lost_from: [Option<u64>; MAX_SLAVES],
}

impl Network {
    pub(super) const fn new() -> Self {
        Self {
            initialised: false,
            cycle: CycleTime::DEFAULT,
            found: 0,
            with_dc: SlaveSet::EMPTY,
            commanded: [AlState::Init; MAX_SLAVES],
            process_data: [None; MAX_SLAVES],
            places: [Place { outputs_at: 0, output_bytes: 0, inputs_at: 0, input_bytes: 0 }; MAX_SLAVES],
            configured: SlaveSet::EMPTY,
            seen: [None; MAX_SLAVES],
            laid_out: false,
            mapped: false,
            rx_bytes: 0,
            tx_bytes: 0,
            entries: 0,
            in_flight: 1,
            transport_sets: 0,
            lost: SlaveSet::EMPTY,
            stale: SlaveSet::EMPTY,
            lost_from: [None; MAX_SLAVES],
        }
    }

    /// The chip runs no network any more. How many slaves there are stays known: a scan alone counts them anew.
    pub(super) fn stop(&mut self) {
        let Self { cycle, found, with_dc, lost, stale, lost_from, .. } = *self;
        *self = Self { cycle, found, with_dc, lost, stale, lost_from, ..Self::new() };
    }

    /// The chip has found so many slaves, which are in Init.
    pub(super) fn start(&mut self, found: u8, cycle: CycleTime) {
        let Self { with_dc, lost, stale, lost_from, .. } = *self;
        *self = Self { initialised: true, cycle, found, with_dc, lost, stale, lost_from, ..Self::new() };
    }

    /// Whether it runs with that cycle.
    pub(super) fn is_known(&self, cycle: CycleTime) -> bool {
        self.initialised && self.cycle == cycle
    }

    /// The slaves that were brought at least to that state.
    pub(super) fn at_least(&self, state: AlState) -> SlaveSet {
        let mut slaves = SlaveSet::EMPTY;
        for (slave, commanded) in (1..=self.found).zip(self.commanded) {
            if commanded >= state {
                slaves.insert(slave);
            }
        }
        slaves
    }

    /// The slaves whose process data the chip has.
    pub(super) fn with_process_data(&self) -> SlaveSet {
        if self.mapped { self.configured } else { SlaveSet::EMPTY }
    }

    /// The slaves that were configured as ones that are not used.
    pub(super) fn unused(&self) -> SlaveSet {
        let is_unused = |slave: &u8| self.process_data[usize::from(*slave) - 1].is_none();
        self.configured.intersection(SlaveSet::first(self.found)).iter().filter(is_unused).collect()
    }

    /// What was seen of a slave's objects, if that was for this configuration and still holds.
    pub(super) fn seen(&self, slave: u8, config: &SlaveConfig, now: Ns) -> Option<Seen> {
        let holds = |seen: &Seen| seen.config == *config && now.saturating_sub(seen.at) < SEEN_FOR_NS;
        self.seen[usize::from(slave) - 1].filter(holds)
    }

    /// The objects of a slave, and with them the layout of the chip, may be other ones now.
    pub(super) const fn forget_objects(&mut self, slave: u8) {
        if let Some(n) = (slave as usize).checked_sub(1)
            && n < MAX_SLAVES
        {
            self.seen[n] = None;
            self.laid_out = false;
        }
    }

    /// A slave has what was to be written to it. The layout is what it was before, if it has the length of that.
    pub(super) fn written(&mut self, slave: u8, data: &ProcessData, was_laid_out: bool) {
        let Place { output_bytes, input_bytes, .. } = self.places[usize::from(slave) - 1];
        self.laid_out |= was_laid_out && (data.output_bytes(), data.input_bytes()) == (output_bytes, input_bytes);
    }

    /// A slave was read in that state. One in Init, or one that does not answer, may come up with other objects; from SafeOP on
    /// nobody changes them.
    pub(super) fn note_objects(&mut self, slave: u8, state: Option<AlState>, now: Ns) {
        match (state, &mut self.seen[usize::from(slave) - 1]) {
            (None | Some(AlState::Init), _) => self.forget_objects(slave),
            (Some(AlState::SafeOp | AlState::Op), Some(seen)) => seen.at = now,
            _ => {}
        }
    }

    pub(super) fn in_op(&self) -> SlaveSet {
        self.at_least(AlState::Op)
    }

    /// A slave is not lost any more.
    pub(super) const fn found_again(&mut self, slave: u8) {
        self.lost.remove(slave);
        self.stale.remove(slave);
    }

    /// Places a slave behind the one before it.
    pub(super) fn place(&mut self, slave: u8, output_bytes: usize, input_bytes: usize) {
        let n = usize::from(slave) - 1;
        let before = n.checked_sub(1).map_or(Place::default(), |before| self.places[before]);
        let outputs_at = before.outputs_at + before.output_bytes;
        let inputs_at = before.inputs_at + before.input_bytes;
        self.places[n] = Place { outputs_at, output_bytes, inputs_at, input_bytes };
        (self.rx_bytes, self.tx_bytes) = (outputs_at + output_bytes, inputs_at + input_bytes);
    }
}

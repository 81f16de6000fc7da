//! What the bus knows of the chip's network and its slaves.

use crate::ethercat::cia402::Mode;
use crate::ethercat::{AlState, MAX_SLAVES, Ns, SlaveSet};
use crate::fieldbus::SlaveConfig;
use crate::fieldbus::pdo::{Download, MappedDirection, MappingImage, ProcessData};
use crate::sk::CycleTime;

/// How long the bus relies on object values that it has read from a slave in PreOP, ns. After that they are read again.
/// \[OURS] A service tool that is connected to the drive may have changed them.
const SEEN_FOR_NS: Ns = 60_000_000_000;

/// Where the process data of a slave are in the chip's process images: offsets and lengths in bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Place {
    pub outputs_at: usize,
    pub output_bytes: usize,
    pub inputs_at: usize,
    pub input_bytes: usize,
}

/// Which of the objects that a configuration writes already have the wanted values in a slave.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Mapped {
    /// Whether the mapping and the assignment of the slave's outputs have the wanted values.
    pub outputs: MappedObjects,
    /// Whether the mapping and the assignment of the slave's inputs have the wanted values.
    pub inputs: MappedObjects,
    /// Whether the slave's synchronization types have the wanted values.
    pub sync: bool,
}

/// Which of the objects that map the process data of one direction already have the wanted values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct MappedObjects {
    /// Whether the mapping of each PDO has the wanted value. At power-on a drive has PDOs for each mode, of which only
    /// one is assigned.
    pub pdos: bool,
    /// Whether the assignment of the PDOs has the wanted value.
    pub assignment: bool,
}

impl MappedObjects {
    const ALL: Self = Self { pdos: true, assignment: true };

    /// Whether no object of this direction has to be written.
    pub(super) const fn is_whole(self) -> bool {
        self.pdos && self.assignment
    }
}

impl Mapped {
    pub(super) const ALL: Self = Self { outputs: MappedObjects::ALL, inputs: MappedObjects::ALL, sync: true };

    /// Whether the slave already has the value of this download, so that it is left out. A PDO can be changed only
    /// while it is not assigned, so if a PDO is written, the assignment is written, too. The mode of operation is
    /// written in each configuration, because a host may have written another one.
    pub(super) const fn has(&self, download: &Download) -> bool {
        match download.direction() {
            Some(direction) => {
                let objects = self.of(direction);
                objects.is_whole() || objects.pdos && !download.is_assignment()
            }
            None => self.sync && download.is_sync_type(),
        }
    }

    /// Whether no object of the mapping has to be written.
    pub(super) const fn is_whole(&self) -> bool {
        self.outputs.is_whole() && self.inputs.is_whole()
    }

    pub(super) const fn of(&self, direction: MappedDirection) -> MappedObjects {
        match direction {
            MappedDirection::Outputs => self.outputs,
            MappedDirection::Inputs => self.inputs,
        }
    }

    /// Records that a mapping or assignment object was read and does not have the content `image`.
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

    /// Records that the objects of the mapping are unknown, so that all of them are written.
    pub(super) const fn is_not_mapped(&mut self) {
        self.outputs = MappedObjects { pdos: false, assignment: false };
        self.inputs = self.outputs;
    }
}

/// What is known of the objects that a configuration writes, in one slave.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    /// The configuration for which the objects were read or written.
    pub config: SlaveConfig,
    pub data: ProcessData,
    pub mapped: Mapped,
    /// Whether the present mapping has the lengths of the wanted one, so that the chip's layout fits both.
    pub is_as_long: bool,
    /// When the objects were read or written, on the clock of the wires to the chip.
    pub at: Ns,
}

impl Seen {
    /// What is known of a slave whose objects all have the values that a configuration writes.
    pub(super) const fn all(config: SlaveConfig, data: ProcessData) -> Self {
        Self { config, data, mapped: Mapped::ALL, is_as_long: true, at: 0 }
    }
}

/// The state of the chip's network. In each list, slave n is at index n - 1.
#[derive(Clone, Debug)]
pub(super) struct Network {
    /// Whether the chip has initialised the network since the chip's last start.
    pub initialised: bool,
    pub cycle: CycleTime,
    /// The number of slaves that the last scan has found.
    pub found: u8,
    pub with_dc: SlaveSet,
    /// The slaves with distributed clocks for which SYNC0 is switched off, because they run free. The initialisation of
    /// the network switches SYNC0 on for all slaves.
    pub free_running: SlaveSet,
    /// The state to which the newest job has brought each slave. The slave may have left it by itself.
    pub commanded: [AlState; MAX_SLAVES],
    /// The process data that are mapped for the role of each slave; `None`: the slave is unused, or is not configured.
    pub process_data: [Option<ProcessData>; MAX_SLAVES],
    pub places: [Place; MAX_SLAVES],
    /// Slaves that were configured since the network was started. [`Self::with_process_data`] returns those whose process
    /// data the chip has.
    pub configured: SlaveSet,
    /// What is known of the objects of each slave; `None`: nothing is known, or the objects may have changed since they
    /// were read.
    pub seen: [Option<Seen>; MAX_SLAVES],
    /// The slaves in which an object of the mapping was written. A restart of the chip's network does not change these
    /// objects, so it does not clear this set.
    pub remapped: SlaveSet,
    /// Whether a slave has fallen back to its default process data when the chip laid them out by RECONFIG. From then on
    /// CONFIG_MAP lays them out (XF ZH 410).
    pub falls_back: bool,
    /// Whether the chip's layout of process data matches the mapping of the slaves, and no change of state to PreOP or
    /// below was requested since: after such a change the chip makes a new layout.
    pub laid_out: bool,
    /// Whether a requested configuration has mapped the slaves, and the chip has laid out their process data. A
    /// preparation alone sets only `laid_out`.
    pub mapped: bool,
    /// The number of bytes in one RxPDO of the chip: the outputs of all slaves.
    pub rx_bytes: usize,
    /// The number of bytes in one TxPDO of the chip: the inputs of all slaves.
    pub tx_bytes: usize,
    /// The number of entries that each of the chip's FIFOs has.
    pub entries: u8,
    /// How many exchanges of process data may be in flight, 1 or 2.
    pub in_flight: usize,
    /// How many sets of outputs have to be on the way to the slaves so that none is late. The sets that bridge a stall
    /// of the host ([`XfBusOptions::ahead`](super::XfBusOptions::ahead)) come in addition.
    pub transport_sets: u16,
    pub lost: SlaveSet,
    /// The slaves in `lost` that answer, but whose inputs were not used for too long, because the working counter was
    /// wrong.
    pub stale: SlaveSet,
    /// For each lost slave, the id of the first outputs that may not have reached it.
    pub lost_from: [Option<u64>; MAX_SLAVES],
}

impl Network {
    pub(super) const fn new() -> Self {
        Self {
            initialised: false,
            cycle: CycleTime::DEFAULT,
            found: 0,
            with_dc: SlaveSet::EMPTY,
            free_running: SlaveSet::EMPTY,
            commanded: [AlState::Init; MAX_SLAVES],
            process_data: [None; MAX_SLAVES],
            places: [Place { outputs_at: 0, output_bytes: 0, inputs_at: 0, input_bytes: 0 }; MAX_SLAVES],
            configured: SlaveSet::EMPTY,
            seen: [None; MAX_SLAVES],
            remapped: SlaveSet::EMPTY,
            falls_back: false,
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

    /// Called when the chip's network has stopped. The number of slaves stays known, because only a scan counts them
    /// again. Lost slaves stay lost, because only a change of state brings them back.
    pub(super) fn stop(&mut self) {
        let Self { cycle, found, with_dc, remapped, falls_back, lost, stale, lost_from, .. } = *self;
        *self = Self { cycle, found, with_dc, remapped, falls_back, lost, stale, lost_from, ..Self::new() };
    }

    /// Called when the chip has initialised its network and found `found` slaves, which are in Init.
    pub(super) fn start(&mut self, found: u8, cycle: CycleTime) {
        self.stop();
        (self.initialised, self.cycle, self.found) = (true, cycle, found);
    }

    /// Whether the network is initialised with this cycle time.
    pub(super) fn is_known(&self, cycle: CycleTime) -> bool {
        self.initialised && self.cycle == cycle
    }

    /// The slaves that jobs have brought to at least this state.
    pub(super) fn at_least(&self, state: AlState) -> SlaveSet {
        let mut slaves = SlaveSet::EMPTY;
        for (slave, commanded) in (1..=self.found).zip(self.commanded) {
            if commanded >= state {
                slaves.insert(slave);
            }
        }
        slaves
    }

    /// The slaves whose process data are in the chip's present layout.
    pub(super) fn with_process_data(&self) -> SlaveSet {
        if self.mapped { self.configured } else { SlaveSet::EMPTY }
    }

    /// The configured slaves whose role is [`Role::Unused`](crate::fieldbus::Role::Unused).
    pub(super) fn unused(&self) -> SlaveSet {
        let is_unused = |slave: &u8| self.process_data[usize::from(*slave) - 1].is_none();
        self.configured.intersection(SlaveSet::first(self.found)).iter().filter(is_unused).collect()
    }

    /// What is known of a slave's objects, if they were read or written for this configuration and not longer ago than
    /// [`SEEN_FOR_NS`].
    pub(super) fn seen(&self, slave: u8, config: &SlaveConfig, now: Ns) -> Option<Seen> {
        let holds = |seen: &Seen| seen.config == *config && now.saturating_sub(seen.at) < SEEN_FOR_NS;
        self.seen[usize::from(slave) - 1].filter(holds)
    }

    /// The slaves that may have lost the wanted mapping when the chip laid out the process data: a slave may fall back
    /// to its default mapping (XF ZH 410). Slaves that had the mapping for CSP, or for an IO slave, without any write
    /// are left out \[OURS]: that mapping is most likely their default.
    pub(super) fn may_have_fallen_back(&self) -> SlaveSet {
        let may_fall = |slave: &u8| {
            self.seen[usize::from(*slave) - 1].is_some_and(|Seen { config, mapped, .. }| {
                let is_chosen = config.role.mode().is_some_and(|mode| mode != Mode::Csp);
                self.remapped.contains(*slave) || is_chosen && mapped.is_whole()
            })
        };
        SlaveSet::first(self.found).iter().filter(may_fall).collect()
    }

    /// Forgets the objects of a slave, because they may have changed. The chip's layout counts as invalid, because it
    /// may not match the new objects.
    pub(super) const fn forget_objects(&mut self, slave: u8) {
        if let Some(n) = (slave as usize).checked_sub(1)
            && n < MAX_SLAVES
        {
            self.seen[n] = None;
            self.laid_out = false;
        }
    }

    /// Records that all objects of a slave were written. \[OURS] The chip's layout stays valid if the process data have the
    /// same lengths as before.
    pub(super) fn written(&mut self, slave: u8, data: &ProcessData, was_laid_out: bool) {
        let Place { output_bytes, input_bytes, .. } = self.places[usize::from(slave) - 1];
        self.laid_out |= was_laid_out && (data.output_bytes(), data.input_bytes()) == (output_bytes, input_bytes);
    }

    /// Updates the record of a slave's objects after the slave's AL state was read. A slave in Init, or one that does
    /// not answer, may come back with other objects. In SafeOP and OP the objects do not change, so the recorded values
    /// count as read now.
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

    /// Removes a slave from the lost and the stale slaves.
    pub(super) const fn found_again(&mut self, slave: u8) {
        self.lost.remove(slave);
        self.stale.remove(slave);
    }

    /// Assigns the place of a slave's process data in the chip's process images, after those of the previous slave.
    pub(super) fn place(&mut self, slave: u8, output_bytes: usize, input_bytes: usize) {
        let n = usize::from(slave) - 1;
        let before = n.checked_sub(1).map_or(Place::default(), |before| self.places[before]);
        let outputs_at = before.outputs_at + before.output_bytes;
        let inputs_at = before.inputs_at + before.input_bytes;
        self.places[n] = Place { outputs_at, output_bytes, inputs_at, input_bytes };
        (self.rx_bytes, self.tx_bytes) = (outputs_at + output_bytes, inputs_at + input_bytes);
    }
}

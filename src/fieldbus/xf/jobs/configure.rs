//! A configuration: process data are mapped by SDO, and the chip lays them out.

use super::state::TOLD_LATE;
use super::{Kind, Running, Stage, Todo, abort_code, no_answer};
use crate::ethercat::coe::{AbortCode, ObjectAddress};
use crate::ethercat::{AlState, AlStatus, Ns, SlaveSet};
use crate::fieldbus::pdo::{self, Download, Downloads, ProcessData};
use crate::fieldbus::xf::XfBus;
use crate::fieldbus::xf::ask::{Ask, Reply};
use crate::fieldbus::xf::fifo_entries;
use crate::fieldbus::xf::network::{Mapped, Network, Place, Seen};
use crate::fieldbus::xf::plan::{CycleDemand, CyclePlan};
use crate::fieldbus::{BusConfig, Configured, HardwareLimit, JobDone, Refusal, Role};
use crate::xf::host::{HostError, Wires};

/// How long a slave may take for an SDO of a configuration. \[OURS]
const SDO_NS: Ns = 1_000_000_000;

/// Whether a slave has not answered at all.
fn is_silent(error: &HostError) -> bool {
    !matches!(error, HostError::Failed { .. }) || abort_code(error) == AbortCode::TIMEOUT
}

impl<W: Wires> XfBus<W> {
    /// Process data are laid out with all slaves in PreOP. One that does not answer would make that fail when the others
    /// have left OP for it already.
    pub(super) fn check_before_leaving(&mut self, job: &mut Running, now: Ns) -> Todo {
        let Kind::Configure(config) = &job.kind else { return self.configured(job) };
        let unused = self.network.unused();
        if !SlaveSet::first(self.network.found).difference(config.selected).is_empty() {
            // Slaves that were lost are looked at anew (SK-4.73).
            config.selected.iter().for_each(|slave| self.network.forget_objects(slave));
        }
        self.network.configured = self.network.configured.difference(config.selected);
        job.keeps_layout = self.keeps_layout(config);
        for slave in 1..=self.network.found {
            let selected = config.selected.contains(slave);
            match job.state(slave) {
                Some(AlState::PreOp) => {}
                Some(AlState::SafeOp | AlState::Op) if !selected => {}
                // The change of state with which it went along was cut short.
                Some(AlState::SafeOp) if unused.contains(slave) => {}
                Some(_) if selected => {
                    let AlStatus(al_status) = AlStatus::INVALID_CHANGE;
                    return job.failed(Refusal { slave, al_status, abort: None });
                }
                _ if !selected && job.keeps_layout => {}
                _ => return job.failed(no_answer(slave)),
            }
        }
        if job.keeps_layout { self.map_from(job, 1) } else { self.leave(job, 1, now) }
    }

    /// Whether the selected slaves fit into the layout that the chip has, so that the others may stay in SafeOP and OP.
    ///
    /// \[OURS] The chip then configures a slave for that layout when it goes to SafeOP. If it does not, the slave
    /// refuses SafeOP, or the working counter is wrong.
    pub(super) fn keeps_layout(&self, config: &BusConfig) -> bool {
        let network = &self.network;
        let others = network.at_least(AlState::SafeOp).difference(config.selected);
        let fits = |slave: u8| {
            let n = usize::from(slave) - 1;
            let Place { output_bytes, input_bytes, .. } = network.places[n];
            let role = config.slaves[n].role;
            let mut mapped = [false, true].into_iter().filter_map(|second| ProcessData::of(role, second));
            role == Role::Unused
                || mapped.any(|data| (data.output_bytes(), data.input_bytes()) == (output_bytes, input_bytes))
        };
        let found = SlaveSet::first(network.found);
        network.mapped && !others.is_empty() && config.selected.intersection(found).iter().all(fits)
    }

    pub(super) fn leave(&mut self, job: &mut Running, from: u8, now: Ns) -> Todo {
        let above = |slave: &u8| self.network.commanded[usize::from(*slave) - 1] > AlState::PreOp;
        match (from..=self.network.found).find(above) {
            Some(slave) => {
                if self.network.in_op().contains(slave) {
                    job.disturbed.insert(slave);
                }
                job.ask(Stage::Leave(slave), Ask::Enter(Some(slave), AlState::PreOp))
            }
            None if self.runs && self.network.in_op().is_empty() => {
                job.stage = Stage::Left;
                Todo::Wait(now.saturating_add(TOLD_LATE * self.network.cycle.ns()))
            }
            None => self.map_from(job, 1),
        }
    }

    /// Nobody is in OP, and its last cycles were told: laying out process data empties the chip's FIFO, in which nothing is
    /// sent any more.
    pub(super) fn left(&mut self, job: &mut Running) -> Todo {
        self.leave_op();
        self.map_from(job, 1)
    }

    /// The downloads of a slave.
    fn downloads(&self, job: &Running, slave: u8) -> Option<Downloads> {
        let Kind::Configure(config) = &job.kind else { return None };
        Some(job.mapping?.downloads(config.slaves[usize::from(slave) - 1].sync))
    }

    pub(super) fn map_from(&mut self, job: &mut Running, from: u8) -> Todo {
        let Kind::Configure(config) = &job.kind else { return self.configured(job) };
        let found = self.network.found;
        let Some(slave) = (from..=found).find(|slave| config.selected.contains(*slave)) else {
            return self.all_mapped(job);
        };
        let n = usize::from(slave) - 1;
        let wanted = config.slaves[n];
        if !job.is_ahead {
            self.network.process_data[n] = None;
        }
        match (wanted.role, self.network.seen(slave, &wanted, self.wires.now())) {
            (Role::Unused, _) => self.map_from(job, slave + 1),
            // Ahead nothing is written.
            (_, Some(_)) if job.is_ahead => self.map_from(job, slave + 1),
            (_, Some(seen)) => {
                (job.mapping, job.mapped) = (Some(seen.data), seen.mapped);
                self.download(job, slave, 0)
            }
            (Role::Hsp(_), None) => {
                let object: ObjectAddress = pdo::SECOND_CONTROLWORD;
                job.ask(Stage::SecondAxis(slave), Ask::Upload { slave, object, timeout_ns: SDO_NS })
            }
            (_, None) => self.map(job, slave, false),
        }
    }

    pub(super) fn map(&mut self, job: &mut Running, slave: u8, has_second_axis: bool) -> Todo {
        let Kind::Configure(config) = &job.kind else { return self.configured(job) };
        let role = config.slaves[usize::from(slave) - 1].role;
        let Some(data) = ProcessData::of(role, has_second_axis) else {
            return job.failed(Refusal { slave, ..pdo::NO_SUCH_MODE });
        };
        (job.mapping, job.mapped) = (Some(data), Mapped::ALL);
        self.look(job, slave, 0)
    }

    /// The objects of the mapping are read before any of them is written \[OURS]: one upload shows what takes a download for each
    /// entry, and most slaves have what the board maps, by default or since it was mapped before.
    fn look(&mut self, job: &mut Running, slave: u8, from: usize) -> Todo {
        let Some(downloads) = self.downloads(job, slave) else { return self.configured(job) };
        let mut images = downloads.mapping_images().enumerate().skip(from);
        match images.find(|(_, image)| job.mapped.is_mapped(image.direction())) {
            Some((place, image)) => {
                job.ask(Stage::Look(slave, place), Ask::Compare { slave, image, timeout_ns: SDO_NS })
            }
            None if job.is_ahead => self.look_at_sync_type(job, slave, 0),
            None => {
                job.mapped.sync = false;
                self.download(job, slave, 0)
            }
        }
    }

    pub(super) fn looked(&mut self, job: &mut Running, slave: u8, place: usize, reply: Reply) -> Todo {
        let image = self.downloads(job, slave).and_then(|downloads| downloads.mapping_images().nth(place));
        match (reply, image) {
            (Ok(0), Some(image)) => job.mapped.differs(image.direction()),
            (Ok(_), _) => {}
            (Err(error), _) if is_silent(&error) => return job.failed(no_answer(slave)),
            // A slave without complete access, or without the object: its downloads tell.
            (Err(_), _) => (job.mapped.outputs, job.mapped.inputs) = (false, false),
        }
        self.look(job, slave, place + 1)
    }

    fn look_at_sync_type(&mut self, job: &mut Running, slave: u8, place: usize) -> Todo {
        match self.sync_type(job, slave, place) {
            Some(Download { object, .. }) => {
                job.ask(Stage::LookAtSyncType(slave, place), Ask::Upload { slave, object, timeout_ns: SDO_NS })
            }
            None => {
                self.note_seen(job, slave);
                self.map_from(job, slave + 1)
            }
        }
    }

    pub(super) fn looked_at_sync_type(&mut self, job: &mut Running, slave: u8, place: usize, reply: Reply) -> Todo {
        let wanted = self.sync_type(job, slave, place);
        let is_right = match &reply {
            Ok(value) => wanted.is_some_and(|download| download.value == *value),
            Err(error) if is_silent(error) => return job.failed(no_answer(slave)),
            Err(error) => wanted.is_some_and(|download| download.may_fail_with(abort_code(error))),
        };
        job.mapped.sync &= is_right;
        self.look_at_sync_type(job, slave, place + 1)
    }

    fn sync_type(&self, job: &Running, slave: u8, place: usize) -> Option<Download> {
        self.downloads(job, slave)?.into_iter().filter(Download::is_sync_type).nth(place)
    }

    /// What was seen of the objects of a slave, or was written to them.
    fn note_seen(&mut self, job: &mut Running, slave: u8) {
        let Kind::Configure(config) = &job.kind else { return };
        let n = usize::from(slave) - 1;
        let seen = |data| Seen { config: config.slaves[n], data, mapped: job.mapped, at: self.wires.now() };
        self.network.seen[n] = job.mapping.map(seen);
    }

    fn download(&mut self, job: &mut Running, slave: u8, from: usize) -> Todo {
        let mut downloads = self.downloads(job, slave).into_iter().flatten().enumerate().skip(from);
        match downloads.find(|(_, download)| !job.mapped.has(download)) {
            Some((place, download)) => {
                if download.direction().is_some() {
                    self.network.forget_objects(slave);
                }
                let Download { object, size, value, .. } = download;
                let ask = Ask::Download { slave, object, size, value, timeout_ns: SDO_NS };
                job.ask(Stage::Download(slave, place), ask)
            }
            None => {
                job.mapped = Mapped::ALL;
                self.note_seen(job, slave);
                let data = job.mapping.take();
                if data.is_some_and(|data| data.axes() > 1) {
                    job.second_axes.insert(slave);
                }
                self.network.process_data[usize::from(slave) - 1] = data;
                self.map_from(job, slave + 1)
            }
        }
    }

    pub(super) fn downloaded(&mut self, job: &mut Running, slave: u8, place: usize, reply: Reply) -> Todo {
        let download = self.downloads(job, slave).and_then(|downloads| downloads.into_iter().nth(place));
        if let (Err(error), Some(download)) = (reply, download) {
            if is_silent(&error) {
                return job.failed(no_answer(slave));
            }
            let code = abort_code(&error);
            if !download.may_fail_with(code) {
                return job.failed(Refusal { slave, ..download.refused(code) });
            }
        }
        self.download(job, slave, place + 1)
    }

    /// All slaves have their mapping. Process data are laid out, unless they are already as the slaves have mapped them.
    fn all_mapped(&mut self, job: &mut Running) -> Todo {
        match self.wrong_layout() {
            _ if job.is_ahead && !self.all_are_seen(job) => self.configured(job),
            Some(refusal) if job.keeps_layout => job.failed(refusal),
            None if job.keeps_layout => self.configured(job),
            None if self.network.laid_out => self.choose_size(job),
            _ => {
                (self.network.mapped, self.network.laid_out) = (false, false);
                job.ask(Stage::Reconfig, Ask::Reconfig)
            }
        }
    }

    /// Whether no slave needs a download that changes its process data.
    fn all_are_seen(&self, job: &Running) -> bool {
        let Kind::Configure(config) = &job.kind else { return false };
        let now = self.wires.now();
        let selected = config.selected.intersection(SlaveSet::first(self.network.found));
        selected.iter().all(|slave| {
            let wanted = &config.slaves[usize::from(slave) - 1];
            let seen = self.network.seen(slave, wanted, now);
            wanted.role == Role::Unused || seen.is_some_and(|seen| seen.mapped.outputs && seen.mapped.inputs)
        })
    }

    /// The entries of each FIFO with the present process data.
    pub(super) fn entries(&self) -> u8 {
        fifo_entries(self.network.rx_bytes + self.network.tx_bytes)
    }

    pub(super) fn laid_out(&mut self, job: &mut Running) -> Todo {
        match self.wrong_layout() {
            Some(refusal) if !job.is_ahead => job.failed(refusal),
            _ => job.ask(Stage::RxEntries, Ask::RxEntries(self.entries())),
        }
    }

    /// The first slave whose process data have other lengths in the chip's layout than were mapped; `None`: all are right.
    fn wrong_layout(&self) -> Option<Refusal> {
        let is_wrong = |slave: &u8| {
            let n = usize::from(*slave) - 1;
            let Place { output_bytes, input_bytes, .. } = self.network.places[n];
            let data = &self.network.process_data[n];
            data.is_some_and(|data| (data.output_bytes(), data.input_bytes()) != (output_bytes, input_bytes))
        };
        let AlStatus(al_status) = AlStatus::INVALID_OUTPUTS;
        let slave = (1..=self.network.found).find(is_wrong)?;
        Some(Refusal { slave, al_status, abort: None })
    }

    /// The FIFOs are built for the present layout.
    pub(super) fn fifos_built(&mut self, job: &mut Running) -> Todo {
        self.network.laid_out = true;
        self.choose_size(job)
    }

    /// The packets hold the process data and the exchanges the cycle, or the chip is set to an n with which they do.
    pub(super) fn choose_size(&mut self, job: &mut Running) -> Todo {
        self.network.entries = self.entries();
        match self.plan_cycle() {
            Ok(CyclePlan { size, in_flight, transport_sets, .. }) => {
                (self.network.in_flight, self.network.transport_sets) = (in_flight, transport_sets);
                if size == self.host.size() {
                    return self.configured(job);
                }
                job.stage = Stage::Resize;
                Todo::Resize(size)
            }
            Err(limit) => Todo::Done(JobDone::Beyond(limit)),
        }
    }

    fn plan_cycle(&self) -> Result<CyclePlan, HardwareLimit> {
        let Network { rx_bytes, tx_bytes, cycle, .. } = self.network;
        let demand = CycleDemand {
            process_bytes: rx_bytes.max(tx_bytes),
            fifo_entries: self.network.entries,
            cycle_ns: cycle.ns(),
            clock_hz: self.options.clock_hz,
            idle_ns: self.host.config().idle_ns,
            present: self.host.size(),
            size_is_fixed: self.options.size_is_fixed,
        };
        demand.plan()
    }

    pub(super) fn configured(&mut self, job: &mut Running) -> Todo {
        if let Kind::Configure(config) = &job.kind
            && !job.is_ahead
        {
            self.network.mapped = true;
            self.network.configured = self.network.configured.union(config.selected);
        }
        let Running { second_axes, disturbed, .. } = *job;
        Todo::Done(JobDone::Configure(Ok(Configured { second_axes, disturbed })))
    }
}

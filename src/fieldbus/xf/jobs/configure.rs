//! A configuration: process data are mapped by SDO, and the chip lays them out.

use super::state::TOLD_LATE;
use super::{Kind, Running, Stage, Todo, abort_code, no_answer};
use crate::coe::{AbortCode, ObjectAddress};
use crate::ethercat::{AlState, AlStatus, Ns, SlaveSet};
use crate::fieldbus::pdo::{self, Download, ProcessData};
use crate::fieldbus::xf::XfBus;
use crate::fieldbus::xf::ask::{Ask, Reply};
use crate::fieldbus::xf::fifo_entries;
use crate::fieldbus::xf::network::{Network, Place};
use crate::fieldbus::xf::plan::{CycleDemand, CyclePlan};
use crate::fieldbus::{BusConfig, Configured, HardwareLimit, JobDone, Refusal, Role};
use crate::xf::host::{HostError, Wires};

/// How long a slave may take for an SDO of a configuration. \[OURS]
const SDO_NS: Ns = 1_000_000_000;

impl<W: Wires> XfBus<W> {
    /// Process data are laid out with all slaves in PreOP. One that does not answer would make that fail when the others
    /// have left OP for it already.
    pub(super) fn check_before_leaving(&mut self, job: &mut Running, now: Ns) -> Todo {
        let Kind::Configure(config) = &job.kind else { return self.configured(job) };
        self.network.configured = self.network.configured.difference(config.selected);
        job.keeps_layout = self.keeps_layout(config);
        for slave in 1..=self.network.found {
            let selected = config.selected.contains(slave);
            match job.state(slave) {
                Some(AlState::PreOp) => {}
                Some(AlState::SafeOp | AlState::Op) if !selected => {}
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

    pub(super) fn map_from(&mut self, job: &mut Running, from: u8) -> Todo {
        let Kind::Configure(config) = &job.kind else { return self.configured(job) };
        let found = self.network.found;
        let Some(slave) = (from..=found).find(|slave| config.selected.contains(*slave)) else {
            if job.keeps_layout {
                return self.check_layout(job);
            }
            self.network.mapped = false;
            return job.ask(Stage::Reconfig, Ask::Reconfig);
        };
        let role = config.slaves[usize::from(slave) - 1].role;
        self.network.process_data[usize::from(slave) - 1] = None;
        match role {
            Role::Unused => self.map_from(job, slave + 1),
            Role::Hsp(_) => {
                let object: ObjectAddress = pdo::SECOND_CONTROLWORD;
                job.ask(Stage::SecondAxis(slave), Ask::Upload { slave, object, timeout_ns: SDO_NS })
            }
            _ => self.map(job, slave, false),
        }
    }

    pub(super) fn map(&mut self, job: &mut Running, slave: u8, has_second_axis: bool) -> Todo {
        let Kind::Configure(config) = &job.kind else { return self.configured(job) };
        let role = config.slaves[usize::from(slave) - 1].role;
        let Some(data) = ProcessData::of(role, has_second_axis) else {
            return job.failed(Refusal { slave, ..pdo::NO_SUCH_MODE });
        };
        if data.axes() > 1 {
            job.second_axes.insert(slave);
        }
        job.mapping = Some(data);
        self.download(job, slave, 0)
    }

    pub(super) fn download_at(&self, job: &Running, slave: u8, place: usize) -> Option<Download> {
        let Kind::Configure(config) = &job.kind else { return None };
        let sync = config.slaves[usize::from(slave) - 1].sync;
        job.mapping?.downloads(sync).into_iter().nth(place)
    }

    pub(super) fn download(&mut self, job: &mut Running, slave: u8, place: usize) -> Todo {
        match self.download_at(job, slave, place) {
            Some(Download { object, size, value, .. }) => {
                let ask = Ask::Download { slave, object, size, value, timeout_ns: SDO_NS };
                job.ask(Stage::Download(slave, place), ask)
            }
            None => {
                self.network.process_data[usize::from(slave) - 1] = job.mapping.take();
                self.map_from(job, slave + 1)
            }
        }
    }

    pub(super) fn downloaded(&mut self, job: &mut Running, slave: u8, place: usize, reply: Reply) -> Todo {
        if let Err(error) = reply
            && let Some(download) = self.download_at(job, slave, place)
        {
            let code = abort_code(&error);
            if !matches!(error, HostError::Failed { .. }) || code == AbortCode::TIMEOUT {
                return job.failed(no_answer(slave));
            }
            if !download.may_fail_with(code) {
                return job.failed(Refusal { slave, ..download.refused(code) });
            }
        }
        self.download(job, slave, place + 1)
    }

    /// The entries of each FIFO with the present process data.
    pub(super) fn entries(&self) -> u8 {
        fifo_entries(self.network.rx_bytes + self.network.tx_bytes)
    }

    pub(super) fn laid_out(&mut self, job: &mut Running) -> Todo {
        match self.check_layout(job) {
            Todo::Done(JobDone::Configure(Ok(_))) => job.ask(Stage::RxEntries, Ask::RxEntries(self.entries())),
            refused => refused,
        }
    }

    /// The configuration has ended, if the chip's layout has the lengths that were mapped.
    pub(super) fn check_layout(&mut self, job: &mut Running) -> Todo {
        for slave in 1..=self.network.found {
            let place = self.network.places[usize::from(slave) - 1];
            let Some(data) = &self.network.process_data[usize::from(slave) - 1] else { continue };
            if (place.output_bytes, place.input_bytes) != (data.output_bytes(), data.input_bytes()) {
                let AlStatus(al_status) = AlStatus::INVALID_OUTPUTS;
                return job.failed(Refusal { slave, al_status, abort: None });
            }
        }
        self.configured(job)
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
        self.network.mapped = true;
        if let Kind::Configure(config) = &job.kind {
            self.network.configured = self.network.configured.union(config.selected);
        }
        let Running { second_axes, disturbed, .. } = *job;
        Todo::Done(JobDone::Configure(Ok(Configured { second_axes, disturbed })))
    }
}

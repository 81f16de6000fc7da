//! The job of a configuration: maps the process data by SDO, and makes the chip lay them out in its process image.

use super::{Failure, Part, Steps, TOLD_LATE, abort_code};
use crate::ethercat::coe::AbortCode;
use crate::ethercat::{AlState, AlStatus, Ns, SlaveSet};
use crate::fieldbus::pdo::{self, Download, Downloads, MappedDirection, ProcessData};
use crate::fieldbus::xf::ask::{Ask, Reply};
use crate::fieldbus::xf::chip_bus::ChipBus;
use crate::fieldbus::xf::fifo_entries;
use crate::fieldbus::xf::network::{Mapped, Network, Place, Seen};
use crate::fieldbus::xf::plan::{CycleDemand, CyclePlan};
use crate::fieldbus::{BusConfig, Configured, HardwareLimit, Refusal, Role, SlaveConfig};
use crate::sk::DriveSync;
use crate::xf::DataSize;
use crate::xf::host::{HostError, Wires};
use crate::xf::request::SlaveInfoItem;

/// The timeout for an SDO of a configuration, ns. \[OURS]
const SDO_NS: Ns = 1_000_000_000;

/// Whether an error means that the slave has not answered: the chip reports a timeout, or has not answered the command
/// itself.
fn is_silent(error: &HostError) -> bool {
    !matches!(error, HostError::Failed { .. }) || abort_code(error) == AbortCode::TIMEOUT
}

impl<W: Wires> Steps<W> {
    /// Configures the selected slaves. `is_ahead`: only prepares the configuration; no object of a slave is written.
    pub(super) async fn configure(&mut self, config: &BusConfig, is_ahead: bool) -> Result<Configured, Failure> {
        let mut configured = Configured::default();
        let mut keeps_layout = false;
        let (is_started, is_known) = self.with(|bus| (bus.network.initialised, bus.network.is_known(config.cycle)));
        if is_ahead && !is_started {
            // The network of a chip that was reset is not started for a preparation, only for a requested job.
            return Ok(configured);
        }
        if !(is_ahead && is_known) {
            self.start_unless_known(config.cycle).await?;
            self.read_states().await?;
            keeps_layout = self.with(|bus| bus.check_before_leaving(config))?;
            if !keeps_layout {
                configured.disturbed = self.leave().await;
            }
        }
        let selected = config.selected.intersection(SlaveSet::first(self.with(|bus| bus.network.found)));
        for slave in selected.iter() {
            let data = self.map(slave, &config.slaves[usize::from(slave) - 1], is_ahead).await?;
            if data.is_some_and(|data| data.axes() > 1) {
                configured.second_axes.insert(slave);
            }
        }
        if !is_ahead {
            self.set_sync(config).await?;
        }
        self.lay_out(config, keeps_layout, is_ahead).await?;
        if !is_ahead {
            self.with(|bus| {
                bus.network.mapped = true;
                bus.network.configured = bus.network.configured.union(config.selected);
            });
        }
        Ok(configured)
    }

    /// Brings all slaves from OP and SafeOP to PreOP. Returns the slaves that were in OP.
    async fn leave(&self) -> SlaveSet {
        let mut disturbed = SlaveSet::EMPTY;
        let above = self.with(|bus| bus.network.at_least(AlState::SafeOp));
        for slave in above.iter() {
            if self.with(|bus| bus.network.in_op().contains(slave)) {
                disturbed.insert(slave);
            }
            if self.ask(Ask::Enter(Some(slave), AlState::PreOp)).await.is_ok() {
                self.with(|bus| bus.network.commanded[usize::from(slave) - 1] = AlState::PreOp);
            }
        }
        if self.with(|bus| bus.runs && bus.network.in_op().is_empty()) {
            // Waits until the engine has polled the last cycles in OP. Then the process data may be laid out, which
            // empties the chip's FIFOs.
            self.wait_cycles(TOLD_LATE).await;
            self.with(ChipBus::leave_op);
        }
        disturbed
    }

    /// Maps the process data of a slave, as far as the slave does not have them already, and returns them. With `is_ahead`
    /// nothing is written, and the result is `None`.
    async fn map(&self, slave: u8, config: &SlaveConfig, is_ahead: bool) -> Result<Option<ProcessData>, Refusal> {
        let seen = self.with(|bus| {
            if !is_ahead {
                bus.network.process_data[usize::from(slave) - 1] = None;
            }
            bus.network.seen(slave, config, bus.wires.now())
        });
        let (data, mapped) = match seen {
            _ if config.role == Role::Unused => return Ok(None),
            Some(_) if is_ahead => return Ok(None),
            Some(Seen { data, mapped, .. }) => (data, mapped),
            None => {
                let data = self.process_data(slave, config.role).await?;
                let downloads = data.downloads(config.sync);
                let mut mapped = self.look(slave, &downloads).await?;
                mapped.sync = is_ahead && self.has_sync_types(slave, downloads).await?;
                (data, mapped)
            }
        };
        if is_ahead {
            let is_as_long = self.is_as_long(slave, &data, mapped).await?;
            self.with(|bus| bus.note_seen(slave, Seen { mapped, is_as_long, ..Seen::all(*config, data) }));
            return Ok(None);
        }
        let was_laid_out = self.with(|bus| bus.network.laid_out);
        self.write(slave, data.downloads(config.sync), mapped).await?;
        self.with(|bus| {
            bus.network.written(slave, &data, was_laid_out);
            bus.note_seen(slave, Seen::all(*config, data));
            bus.network.process_data[usize::from(slave) - 1] = Some(data);
        });
        Ok(Some(data))
    }

    /// The process data that a slave needs for its role; for some roles an object of the slave decides.
    async fn process_data(&self, slave: u8, role: Role) -> Result<ProcessData, Refusal> {
        let is_there = match ProcessData::probe(role) {
            Some(object) => self.ask(Ask::Upload { slave, object, timeout_ns: SDO_NS }).await.is_ok(),
            None => false,
        };
        ProcessData::of(role, is_there).ok_or(Refusal { slave, ..pdo::NO_SUCH_MODE })
    }

    /// Reads the mapping and assignment objects before any of them is written \[OURS]. One upload with complete access
    /// shows a whole object, but writing it takes a download for each entry. Most slaves already have the mapping of
    /// the board, by default or from an earlier configuration.
    async fn look(&self, slave: u8, downloads: &Downloads) -> Result<Mapped, Refusal> {
        let mut mapped = Mapped::ALL;
        for image in downloads.mapping_images() {
            if !mapped.of(image.direction()).pdos {
                // A PDO of this direction differs, so all objects of this direction are written, and comparing the
                // others would be wasted.
                continue;
            }
            match self.ask(Ask::Compare { slave, image, timeout_ns: SDO_NS }).await {
                Ok(0) => mapped.differs(&image),
                Ok(_) => {}
                Err(error) if is_silent(&error) => return Err(Refusal::no_answer(slave)),
                // The slave supports no complete access or has no such object: all objects are written by downloads.
                Err(_) => mapped.is_not_mapped(),
            }
        }
        Ok(mapped)
    }

    /// Whether the present process data of a slave are as long as the wanted ones. If so, the layout that the chip
    /// makes now still fits when the wanted mapping is written later. Most drives have a PDO for each mode and assign
    /// the first one at power-on; the PDO for CSV is often as long as the PDO for CSP.
    async fn is_as_long(&self, slave: u8, data: &ProcessData, mapped: Mapped) -> Result<bool, Refusal> {
        for (direction, bytes) in
            [(MappedDirection::Outputs, data.output_bytes()), (MappedDirection::Inputs, data.input_bytes())]
        {
            if !mapped.of(direction).is_whole() && self.assigned_bits(slave, direction).await? != bytes as u32 * 8 {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// The length in bits of the only PDO that is assigned in this direction; 0 if there are several, or if it cannot be read.
    async fn assigned_bits(&self, slave: u8, direction: MappedDirection) -> Result<u32, Refusal> {
        let told = |reply: Reply| match reply {
            Err(error) if is_silent(&error) => Err(Refusal::no_answer(slave)),
            other => Ok(other.unwrap_or(0)),
        };
        let [count, pdo] =
            [0, 1].map(|sub| Ask::Upload { slave, object: direction.assignment(sub), timeout_ns: SDO_NS });
        if told(self.ask(count).await)? != 1 {
            return Ok(0);
        }
        let pdo = told(self.ask(pdo).await)? as u16;
        told(self.ask(Ask::MappedBits { slave, pdo, timeout_ns: SDO_NS }).await)
    }

    async fn has_sync_types(&self, slave: u8, downloads: Downloads) -> Result<bool, Refusal> {
        let mut has_all = true;
        for wanted in downloads.into_iter().filter(Download::is_sync_type) {
            has_all &= match self.ask(Ask::Upload { slave, object: wanted.object, timeout_ns: SDO_NS }).await {
                Ok(value) => wanted.value == value,
                Err(error) if is_silent(&error) => return Err(Refusal::no_answer(slave)),
                Err(error) => wanted.may_fail_with(abort_code(&error)),
            };
        }
        Ok(has_all)
    }

    /// Writes the objects of a slave that do not have the wanted values.
    async fn write(&self, slave: u8, downloads: Downloads, mapped: Mapped) -> Result<(), Refusal> {
        for download in downloads.into_iter().filter(|download| !mapped.has(download)) {
            if download.direction().is_some() {
                self.with(|bus| {
                    bus.network.forget_objects(slave);
                    bus.network.remapped.insert(slave);
                });
            }
            let Download { object, size, value, .. } = download;
            let Err(error) = self.ask(Ask::Download { slave, object, size, value, timeout_ns: SDO_NS }).await else {
                continue;
            };
            let code = abort_code(&error);
            if is_silent(&error) {
                return Err(Refusal::no_answer(slave));
            }
            if !download.may_fail_with(code) {
                return Err(Refusal { slave, ..download.refused(code) });
            }
        }
        Ok(())
    }

    /// Switches SYNC0 off for the slaves with distributed clocks that DRIVE_MODE has declared as free run, and on for the
    /// others. The initialisation of the network has switched SYNC0 on for all slaves with distributed clocks.
    async fn set_sync(&self, config: &BusConfig) -> Result<(), Refusal> {
        let (with_dc, before) = self.with(|bus| {
            let found = SlaveSet::first(bus.network.found);
            (bus.network.with_dc.intersection(found), bus.network.free_running)
        });
        let (mut free_running, mut first) = (before, None);
        for slave in config.selected.intersection(with_dc).iter() {
            let SlaveConfig { role, sync } = config.slaves[usize::from(slave) - 1];
            let is_free = sync == DriveSync::FreeRun;
            if role == Role::Unused || is_free == before.contains(slave) {
                continue;
            }
            let set = Ask::DcSync { slave, sync0_ns: config.cycle.ns() as u32, is_active: !is_free };
            self.ask(set).await.map_err(|_| Refusal::of(slave, AlStatus::INVALID_DC_SYNC))?;
            if is_free {
                free_running.insert(slave)
            } else {
                free_running.remove(slave)
            };
            first.get_or_insert(slave);
        }
        let Some(slave) = first else { return Ok(()) };
        self.ask(Ask::InitDc).await.map_err(|_| Refusal::of(slave, AlStatus::INVALID_DC_SYNC))?;
        self.with(|bus| bus.network.free_running = free_running);
        Ok(())
    }

    /// Lays out the process data after all slaves were mapped, unless the layout already matches the mapping.
    async fn lay_out(&self, config: &BusConfig, keeps_layout: bool, is_ahead: bool) -> Result<(), Failure> {
        if is_ahead && !self.with(|bus| bus.all_are_seen(config)) {
            return Ok(());
        }
        let wrong = self.with(|bus| bus.wrong_layout());
        if keeps_layout {
            return wrong.map_or(Ok(()), |refusal| Err(refusal.into()));
        }
        if wrong.is_some() || !self.with(|bus| bus.network.laid_out) {
            self.lay_out_anew(config, is_ahead).await?;
        }
        // If the present packets cannot hold the process data, or their exchanges take longer than the cycle, the chip
        // gets another data segment size.
        if let Some(size) = self.with(ChipBus::choose_size)? {
            self.with(|bus| {
                bus.part = Part::LaysOut;
                bus.host.resize(bus.wires.now(), size);
            });
            self.wait(0).await;
        }
        Ok(())
    }

    async fn lay_out_anew(&self, config: &BusConfig, is_ahead: bool) -> Result<(), Refusal> {
        let found = self.with(|bus| {
            (bus.network.mapped, bus.network.laid_out) = (false, false);
            bus.part = Part::LaysOut;
            bus.network.found
        });
        loop {
            let falls_back = self.with(|bus| bus.network.falls_back);
            if self.ask(if falls_back { Ask::ConfigMap } else { Ask::Reconfig }).await.is_err() {
                let slave = config.selected.iter().next().unwrap_or(1);
                return Err(Refusal::of(slave, AlStatus::INVALID_OUTPUTS));
            }
            let Some(slave) = self.map_again(is_ahead).await? else { break };
            self.with(|bus| bus.network.falls_back = true);
            if is_ahead {
                break;
            }
            if falls_back {
                // The slave has fallen back with CONFIG_MAP, too: it would use its outputs as values of other objects.
                return Err(Refusal::of(slave, AlStatus::INVALID_OUTPUT_MAPPING));
            }
        }
        for slave in 1..=found {
            let outputs = self.ask(Ask::Info(slave, SlaveInfoItem::OutputBytes)).await.unwrap_or(0) as usize;
            let inputs = self.ask(Ask::Info(slave, SlaveInfoItem::InputBytes)).await.unwrap_or(0) as usize;
            self.with(|bus| bus.network.place(slave, outputs, inputs));
        }
        if let Some(refusal) = self.with(|bus| bus.wrong_layout().filter(|_| !is_ahead)) {
            return Err(refusal);
        }
        let entries = self.with(|bus| bus.entries());
        let _ = self.ask(Ask::RxEntries(entries)).await;
        let _ = self.ask(Ask::TxEntries(entries)).await;
        let _ = self.ask(Ask::BuildFifos).await;
        self.with(|bus| bus.network.laid_out = true);
        Ok(())
    }
}

impl<W: Wires> Steps<W> {
    /// Called when the chip has laid out the process data, which may have made slaves fall back to another mapping
    /// (XF ZH 410). \[OURS] The objects of a slave show whether it has. Writes the wanted mapping of each such slave
    /// again. With `is_ahead` nothing is written, and the record of the slave's objects is deleted instead. Returns the
    /// first slave that has fallen back; `None`: all have their mapping.
    async fn map_again(&self, is_ahead: bool) -> Result<Option<u8>, Refusal> {
        let mut first = None;
        for slave in self.with(|bus| bus.network.may_have_fallen_back()).iter() {
            let n = usize::from(slave) - 1;
            let Some(Seen { config, data, mapped, .. }) = self.with(|bus| bus.network.seen[n]) else { continue };
            let downloads = data.downloads(config.sync);
            if mapped.is_whole() {
                if self.keeps_mapping(slave, &downloads).await? {
                    continue;
                }
                first.get_or_insert(slave);
            }
            if is_ahead {
                self.with(|bus| bus.network.seen[n] = None);
            } else if mapped.is_whole() {
                self.write(slave, downloads, Mapped::default()).await?;
                self.with(|bus| bus.note_seen(slave, Seen::all(config, data)));
            }
        }
        Ok(first)
    }

    /// Whether a slave has the mapping of these downloads. If an upload with complete access differs or is refused, the
    /// object is read entry by entry. Its number of entries is not read, because a wrong number shows as a wrong length
    /// of the process data. \[OURS] An entry that cannot be read counts as right, since it was written before.
    async fn keeps_mapping(&self, slave: u8, downloads: &Downloads) -> Result<bool, Refusal> {
        let mut has_complete_access = true;
        for image in downloads.mapping_images() {
            if has_complete_access {
                match self.ask(Ask::Compare { slave, image, timeout_ns: SDO_NS }).await {
                    Ok(0) => {}
                    Ok(_) => continue,
                    Err(error) if is_silent(&error) => return Err(Refusal::no_answer(slave)),
                    Err(_) => has_complete_access = false,
                }
            }
            for Download { object, size, value, .. } in downloads.entries(&image) {
                match self.ask(Ask::Upload { slave, object, timeout_ns: SDO_NS }).await {
                    Ok(read) if read & size.mask() != value => return Ok(false),
                    Err(error) if is_silent(&error) => return Err(Refusal::no_answer(slave)),
                    _ => {}
                }
            }
        }
        Ok(true)
    }
}

impl<W: Wires> ChipBus<W> {
    /// Checks the states of all slaves before unselected slaves leave OP. The chip lays out process data with all
    /// slaves in PreOP. A slave that does not answer would make the layout fail after the unselected slaves have left
    /// OP. Returns whether the unselected slaves may stay in their states.
    fn check_before_leaving(&mut self, config: &BusConfig) -> Result<bool, Refusal> {
        let unused = self.network.unused();
        if !SlaveSet::first(self.network.found).difference(config.selected).is_empty() {
            // Slaves that were lost may have changed, so their objects are read again (SK-4.73).
            config.selected.iter().for_each(|slave| self.network.forget_objects(slave));
        }
        self.network.configured = self.network.configured.difference(config.selected);
        let keeps_layout = self.keeps_layout(config);
        for slave in 1..=self.network.found {
            let selected = config.selected.contains(slave);
            match self.state(slave) {
                Some(AlState::PreOp) => {}
                Some(AlState::SafeOp | AlState::Op) if !selected => {}
                // An unused slave may still be in SafeOP: a change of state took it there together with others, and was
                // cancelled before it had sent the slave back to PreOP.
                Some(AlState::SafeOp) if unused.contains(slave) => {}
                Some(_) if selected => return Err(Refusal::of(slave, AlStatus::INVALID_CHANGE)),
                _ if !selected && keeps_layout => {}
                _ => return Err(Refusal::no_answer(slave)),
            }
        }
        Ok(keeps_layout)
    }

    /// Whether the selected slaves fit into the chip's present layout, so that unselected slaves may stay in SafeOP and
    /// OP.
    ///
    /// \[OURS] The chip then configures a slave for that layout when the slave goes to SafeOP. If the slave does not
    /// fit, it refuses SafeOP, or the working counter is wrong.
    fn keeps_layout(&self, config: &BusConfig) -> bool {
        let network = &self.network;
        let others = network.at_least(AlState::SafeOp).difference(config.selected);
        let fits = |slave: u8| {
            let n = usize::from(slave) - 1;
            let Place { output_bytes, input_bytes, .. } = network.places[n];
            let role = config.slaves[n].role;
            let mut mapped = [false, true].into_iter().filter_map(|is_there| ProcessData::of(role, is_there));
            role == Role::Unused
                || mapped.any(|data| (data.output_bytes(), data.input_bytes()) == (output_bytes, input_bytes))
        };
        let found = SlaveSet::first(network.found);
        network.mapped && !others.is_empty() && config.selected.intersection(found).iter().all(fits)
    }

    /// Records what is known of a slave's objects after they were read or written.
    fn note_seen(&mut self, slave: u8, seen: Seen) {
        self.network.seen[usize::from(slave) - 1] = Some(Seen { at: self.wires.now(), ..seen });
    }

    /// Whether all selected slaves are known to have process data of the wanted length, so that no later download
    /// changes the layout.
    fn all_are_seen(&self, config: &BusConfig) -> bool {
        let now = self.wires.now();
        let selected = config.selected.intersection(SlaveSet::first(self.network.found));
        selected.iter().all(|slave| {
            let wanted = &config.slaves[usize::from(slave) - 1];
            let seen = self.network.seen(slave, wanted, now);
            wanted.role == Role::Unused || seen.is_some_and(|seen| seen.is_as_long)
        })
    }

    /// The number of entries that each FIFO of the chip has with the present process data.
    fn entries(&self) -> u8 {
        fifo_entries(self.network.rx_bytes + self.network.tx_bytes)
    }

    /// The refusal for the first slave whose process data have other lengths in the chip's layout than in the mapping
    /// that was written to the slave; `None`: all lengths match.
    fn wrong_layout(&self) -> Option<Refusal> {
        let is_wrong = |slave: &u8| {
            let n = usize::from(*slave) - 1;
            let Place { output_bytes, input_bytes, .. } = self.network.places[n];
            let data = &self.network.process_data[n];
            data.is_some_and(|data| (data.output_bytes(), data.input_bytes()) != (output_bytes, input_bytes))
        };
        let slave = (1..=self.network.found).find(is_wrong)?;
        Some(Refusal::of(slave, AlStatus::INVALID_OUTPUTS))
    }

    /// The data segment size n that the chip has to be set to for these process data and this cycle time; `None`: the
    /// present size is sufficient.
    fn choose_size(&mut self) -> Result<Option<DataSize>, HardwareLimit> {
        self.network.entries = self.entries();
        let CyclePlan { size, in_flight, transport_sets, .. } = self.plan_cycle()?;
        (self.network.in_flight, self.network.transport_sets) = (in_flight, transport_sets);
        Ok(Some(size).filter(|size| *size != self.host.size()))
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
}

//! Which process data each slave has, and their bytes.

use super::{ConfigureError, Master, Pace, ProcessManager, ReferenceClock, SyncSignals, process_data};
use crate::ethercat::registers::SyncManager;
use crate::ethercat::sii::SiiSmType;

impl Master {
    /// Sets how long the process data of a slave are, bytes, as they were mapped: they lie in the first sync manager that the
    /// slave describes for each direction. They take effect when the slave goes from PreOP to SafeOP. Outputs are 0 then,
    /// unless nothing has changed.
    ///
    /// # Errors
    /// [`ConfigureError`].
    pub fn configure(&mut self, slave: u8, output_bytes: u16, input_bytes: u16) -> Result<(), ConfigureError> {
        let info = self.slave(slave).ok_or(ConfigureError::NoSlave(slave))?;
        if info.outputs.is_empty() && output_bytes > 0 || info.inputs.is_empty() && input_bytes > 0 {
            return Err(ConfigureError::NoManager(slave));
        }
        let first_takes = |bytes| move |n, _: &ProcessManager| if n == 0 { bytes } else { 0 };
        self.configure_managers(slave, first_takes(output_bytes), first_takes(input_bytes))
    }

    /// Configures the process data of a slave as its EEPROM describes them.
    ///
    /// # Errors
    /// [`ConfigureError`].
    pub fn configure_as_described(&mut self, slave: u8) -> Result<(), ConfigureError> {
        let described = |_, one: &ProcessManager| one.registers.len;
        self.configure_managers(slave, described, described)
    }

    /// Configures a slave whose sync managers for outputs and for inputs have these lengths, the first one with number 0.
    fn configure_managers(
        &mut self,
        slave: u8,
        output_len: impl Fn(usize, &ProcessManager) -> u16 + Copy,
        input_len: impl Fn(usize, &ProcessManager) -> u16 + Copy,
    ) -> Result<(), ConfigureError> {
        let info = usize::from(slave).checked_sub(1).and_then(|n| self.slaves.get(n));
        let info = info.ok_or(ConfigureError::NoSlave(slave))?;
        let outputs = info.outputs.iter().enumerate().map(|(n, one)| with_len(one, output_len(n, one)));
        let inputs = info.inputs.iter().enumerate().map(|(n, one)| with_len(one, input_len(n, one)));
        let (has, lacks_lrw) = (info.fmmus, info.lacks_lrw);
        let needs = outputs.clone().chain(inputs.clone()).filter(|(_, manager)| manager.len > 0).count();
        if needs > usize::from(has) {
            return Err(ConfigureError::TooFewFmmus { slave, needs, has });
        }
        let active = self.bus.with(|shared| shared.active);
        if active.contains(slave) {
            return Err(ConfigureError::Active(slave));
        }
        self.process.configure(slave, outputs, inputs, lacks_lrw, active)?;
        // Those of other slaves may be elsewhere now.
        let Self { bus, process, .. } = self;
        bus.with(|shared| {
            (1..).zip(&mut shared.live).for_each(|(slave, live)| live.inputs_at = process.inputs_at(slave))
        });
        Ok(())
    }

    /// Sets where a sync manager lies, and its control byte, other than the EEPROM describes it, from the slave's next way to PreOP
    /// (the mailbox, 0 and 1) or to SafeOP (process data) on. One of process data that the EEPROM does not describe is that of
    /// the direction in its control byte. Another scan forgets it.
    ///
    /// The length of process data is that of [`Self::configure`]; a mailbox has no other control bytes than the usual ones.
    ///
    /// # Errors
    /// [`ConfigureError::NoSlave`]; [`ConfigureError::NoManager`]: the slave has no such sync manager, or a mailbox without bytes.
    pub fn set_manager(&mut self, slave: u8, number: u8, registers: SyncManager) -> Result<(), ConfigureError> {
        let place = usize::from(slave).checked_sub(1).and_then(|n| self.slaves.get_mut(n));
        let info = place.ok_or(ConfigureError::NoSlave(slave))?;
        let is_set = number < info.sync_managers && info.set_manager(number, registers);
        if is_set { Ok(()) } else { Err(ConfigureError::NoManager(slave)) }
    }

    /// Sets what the sync managers of a slave are for, number 0 first, as its object 0x1C00 says it, where its EEPROM says nothing of it
    /// ([`assumes_managers`](super::SlaveInfo::assumes_managers)). They take effect with the next [`Self::configure`]. Another scan forgets it.
    ///
    /// # Errors
    /// [`ConfigureError::NoSlave`]; [`ConfigureError::NoManager`]: its EEPROM says what they are.
    pub fn assume_managers(&mut self, slave: u8, uses: &[SiiSmType]) -> Result<(), ConfigureError> {
        let place = usize::from(slave).checked_sub(1).and_then(|n| self.slaves.get_mut(n));
        let info = place.ok_or(ConfigureError::NoSlave(slave))?;
        if !info.assumes_managers() {
            return Err(ConfigureError::NoManager(slave));
        }
        info.assume_managers(&uses[..uses.len().min(info.sync_managers.into())]);
        Ok(())
    }

    /// Sets whether what a slave sends unasked stays in its mailbox until [`Self::receive_mail`], or another request to that
    /// mailbox, takes it. At first the master takes it by itself. Another scan forgets it.
    pub fn keep_mail(&mut self, slave: u8, keeps: bool) {
        self.bus.with(|shared| {
            if let Some(live) = shared.live_mut(slave) {
                (live.keeps_mail, live.has_mail) = (keeps, live.has_mail && keeps);
            }
        });
    }

    /// Whether there was mail in a slave's mailbox when it was looked at last, which is done for those of [`Self::keep_mail`].
    pub fn has_mail(&self, slave: u8) -> bool {
        self.bus.with(|shared| shared.live_mut(slave).is_some_and(|live| live.has_mail))
    }

    /// Sets which SYNC signals a slave with distributed clocks gets from its way to SafeOP on; `None`: none.
    ///
    /// # Errors
    /// [`ConfigureError::NoSlave`].
    pub fn set_sync(&mut self, slave: u8, sync: Option<SyncSignals>) -> Result<(), ConfigureError> {
        if self.process.set_sync(slave, sync) { Ok(()) } else { Err(ConfigureError::NoSlave(slave)) }
    }

    /// Sets whose time all clocks follow, from the next cycle on. With the master's no reference clock answers, so that a pace
    /// has no effect.
    pub fn set_reference(&mut self, reference: ReferenceClock) {
        self.bus.with(|shared| shared.reference = reference);
    }

    /// Sets whether process data travel in LRW, as they do at first, or in an LWR and an LRD, from the next cycle on. Slaves without
    /// LRW never get one.
    pub const fn set_lrw(&mut self, is_used: bool) {
        self.process.set_lrw(is_used);
    }

    /// Sets how long cycles are, by which slaves' watchdogs go, and how they follow the reference clock, which
    /// [`CycleDone::next_deadline`](super::CycleDone::next_deadline) then says; `None`: nothing is said, and watchdogs stay as they
    /// are.
    pub fn set_pace(&mut self, pace: Option<Pace>) {
        self.bus.with(|shared| (shared.pace, shared.pacer) = (pace, super::pace::Pacer::default()));
    }

    /// The outputs of a slave, which every cycle sends; `None`: there is no slave with that number.
    pub fn outputs_mut(&mut self, slave: u8) -> Option<&mut [u8]> {
        self.process.outputs_mut(slave)
    }

    /// The inputs of a slave as they came last; `None`: there is no slave with that number.
    pub fn inputs(&self, slave: u8) -> Option<&[u8]> {
        self.process.inputs(slave)
    }
}

fn with_len(manager: &ProcessManager, len: u16) -> (u8, SyncManager) {
    (manager.number, process_data::with_len(manager.registers, len))
}

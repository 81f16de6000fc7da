//! What a user configures before slaves go to SafeOP: the process data of each slave, its sync managers, and the
//! distributed clocks.

use super::{ConfigureError, Master, Pace, ProcessManager, ReferenceClock, SyncSignals, process_data};
use crate::ethercat::registers::SyncManager;
use crate::ethercat::sii::SiiSmType;

impl Master {
    /// Sets the lengths of a slave's process data, bytes, as its PDOs are mapped. The data of each direction use the
    /// first sync manager that the slave describes for it. The lengths take effect when the slave goes from PreOP to
    /// SafeOP. If a length changes, the slave's outputs become 0; otherwise they stay.
    ///
    /// # Errors
    /// [`ConfigureError::NoSlave`]; [`ConfigureError::NoManager`] for data without a sync manager;
    /// [`ConfigureError::TooFewFmmus`]; [`ConfigureError::Active`] if the slave is in SafeOP or OP;
    /// [`ConfigureError::TooLong`].
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
    /// Those of [`Self::configure`].
    pub fn configure_as_described(&mut self, slave: u8) -> Result<(), ConfigureError> {
        let described = |_, one: &ProcessManager| one.registers.len;
        self.configure_managers(slave, described, described)
    }

    /// Configures the process data sync managers of a slave. `output_len` and `input_len` give the length in bytes of
    /// the n-th sync manager (from 0) for outputs and for inputs.
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
        // The layout of the process image may have changed, so the address at which the watch reads a slave's inputs is
        // set anew for all slaves.
        let Self { bus, process, .. } = self;
        bus.with(|shared| {
            (1..).zip(&mut shared.live).for_each(|(slave, live)| live.inputs_at = process.inputs_at(slave))
        });
        Ok(())
    }

    /// Sets the start address and control byte of a sync manager, in place of those in the EEPROM. They take effect at
    /// the slave's next change to PreOP for sync managers 0 and 1, the mailbox, and at its next change to SafeOP for
    /// process data. For process data that the EEPROM does not describe, the control byte gives the direction. Another
    /// scan resets this.
    ///
    /// The length of process data comes from [`Self::configure`], not from `registers`. A mailbox keeps the usual
    /// control byte.
    ///
    /// # Errors
    /// [`ConfigureError::NoSlave`]; [`ConfigureError::NoManager`]: the slave has no such sync manager, or it belongs to
    /// a mailbox that the slave does not have, or that would be shorter than
    /// [`MAILBOX_BYTES_MIN`](super::MAILBOX_BYTES_MIN) or longer than
    /// [`MAILBOX_BYTES_MAX`](super::MAILBOX_BYTES_MAX).
    pub fn set_manager(&mut self, slave: u8, number: u8, registers: SyncManager) -> Result<(), ConfigureError> {
        let place = usize::from(slave).checked_sub(1).and_then(|n| self.slaves.get_mut(n));
        let info = place.ok_or(ConfigureError::NoSlave(slave))?;
        let is_set = number < info.sync_managers && info.set_manager(number, registers);
        if is_set { Ok(()) } else { Err(ConfigureError::NoManager(slave)) }
    }

    /// Sets the purpose of each sync manager of a slave, number 0 first, as its object 0x1C00 gives it. Only for a
    /// slave whose EEPROM does not give it ([`assumes_managers`](super::SlaveInfo::assumes_managers)). It takes effect
    /// with the next [`Self::configure`]. Another scan resets this.
    ///
    /// # Errors
    /// [`ConfigureError::NoSlave`]; [`ConfigureError::NoManager`]: the EEPROM gives the purposes.
    pub fn assume_managers(&mut self, slave: u8, uses: &[SiiSmType]) -> Result<(), ConfigureError> {
        let place = usize::from(slave).checked_sub(1).and_then(|n| self.slaves.get_mut(n));
        let info = place.ok_or(ConfigureError::NoSlave(slave))?;
        if !info.assumes_managers() {
            return Err(ConfigureError::NoManager(slave));
        }
        info.assume_managers(&uses[..uses.len().min(info.sync_managers.into())]);
        Ok(())
    }

    /// Sets whether unsolicited messages of a slave stay in its mailbox until [`Self::receive_mail`], or a request to
    /// that mailbox, reads them. By default the master reads and drops them. Another scan resets this.
    pub fn keep_mail(&mut self, slave: u8, keeps: bool) {
        self.bus.with(|shared| {
            if let Some(live) = shared.live_mut(slave) {
                (live.keeps_mail, live.has_mail) = (keeps, live.has_mail && keeps);
            }
        });
    }

    /// Whether the watch found a message in a slave's mailbox at its last check; only for slaves with [`Self::keep_mail`].
    pub fn has_mail(&self, slave: u8) -> bool {
        self.bus.with(|shared| shared.live_mut(slave).is_some_and(|live| live.has_mail))
    }

    /// Sets the SYNC signals that a slave with distributed clocks gets on its way to SafeOP; `None`: no signals.
    ///
    /// # Errors
    /// [`ConfigureError::NoSlave`].
    pub fn set_sync(&mut self, slave: u8, sync: Option<SyncSignals>) -> Result<(), ConfigureError> {
        if self.process.set_sync(slave, sync) { Ok(()) } else { Err(ConfigureError::NoSlave(slave)) }
    }

    /// Sets the reference for all clocks, from the next cycle on. With [`ReferenceClock::Master`] no slave sends a
    /// reference time, so that [`Self::set_pace`] has no effect on deadlines.
    pub fn set_reference(&mut self, reference: ReferenceClock) {
        self.bus.with(|shared| shared.reference = reference);
    }

    /// Sets whether process data use LRW, the default, or an LWR and an LRD, from the next cycle on. Slaves without LRW
    /// always use LWR and LRD.
    pub const fn set_lrw(&mut self, is_used: bool) {
        self.process.set_lrw(is_used);
    }

    /// Sets the cycle time, from which the watchdogs of slaves follow, and the phase of cycles to the reference clock,
    /// from which [`CycleDone::next_deadline`](super::CycleDone::next_deadline) follows. `None`: there are no
    /// deadlines, and watchdogs are not written.
    pub fn set_pace(&mut self, pace: Option<Pace>) {
        self.bus.with(|shared| (shared.pace, shared.pacer) = (pace, super::pace::Pacer::default()));
    }

    /// The outputs of a slave, which every cycle sends; `None`: there is no slave with that number.
    pub fn outputs_mut(&mut self, slave: u8) -> Option<&mut [u8]> {
        self.process.outputs_mut(slave)
    }

    /// The newest inputs of a slave; `None`: there is no slave with that number.
    pub fn inputs(&self, slave: u8) -> Option<&[u8]> {
        self.process.inputs(slave)
    }
}

fn with_len(manager: &ProcessManager, len: u16) -> (u8, SyncManager) {
    (manager.number, process_data::with_len(manager.registers, len))
}

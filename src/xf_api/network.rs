//! The chip's network: its start, its states, and the description of its slaves.

use super::{Xf, XfError};
use crate::link::chip_link::ChipLink;
use crate::xf::host::HostError;
use crate::xf::request::{
    DcTiming, EcatInit, FifoClear, FifoEnable, Fifos, ReferenceClock, SlaveCountGet, SlaveInfoGet, SlaveInfoItem,
    SlaveNumber, Slaves, StateGet, StateSet, StateUpdate,
};
use crate::xf::{EtherCatState, NetworkState};

/// Settings with which a network is started.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NetworkConfig {
    /// The times of the distributed clocks. SYNC0 is also the EtherCAT cycle: 1 ms by default, with AssignActivate
    /// 0x0300.
    pub dc: DcTiming,
    /// The source of the reference clock; by default the chip's own clock.
    pub reference_clock: ReferenceClock,
    /// Whether process data travel in one LRW datagram, if all slaves support it; true by default.
    pub lrw: bool,
}

impl Default for NetworkConfig {
    fn default() -> Self {
        let dc = DcTiming { assign_activate: 0x0300, sync0_ns: 1_000_000, ..DcTiming::default() };
        Self { dc, reference_clock: ReferenceClock::Chip, lrw: true }
    }
}

/// Description of a slave, from its EEPROM and from the chip.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SlaveDescription {
    /// The slave's position on the network, 0 for the first one.
    pub slave: u8,
    /// The slave's name.
    pub name: String,
    /// Vendor id from the EEPROM.
    pub vendor: u32,
    /// Product code from the EEPROM.
    pub product: u32,
    /// Revision number from the EEPROM.
    pub revision: u32,
    /// The slave's EtherCAT state, with the error bit.
    pub state: NetworkState,
    /// The slave's AL status code.
    pub al_status: u16,
    /// The slave's configured station address.
    pub station_address: u16,
    /// The slave's station alias.
    pub alias: u16,
    /// Whether the slave has distributed clocks; `None` if the firmware does not report it.
    pub has_dc: Option<bool>,
    /// Size of the slave's outputs in the chip's layout of the RxPDO, in bytes.
    pub output_bytes: u32,
    /// Size of the slave's inputs in the chip's layout of the TxPDO, in bytes.
    pub input_bytes: u32,
}

impl<L: ChipLink> Xf<L> {
    /// Initialises the network and returns the number of its slaves. Afterwards the FIFO is off and empty, and the
    /// slaves are in Init or PreOP. Axes that may be on are stopped first, as by [`Self::close`], and a network that
    /// was running is brought to Init. Axes have to be added again ([`Self::add_axis`]).
    ///
    /// # Errors
    /// [`XfError::Chip`] if the initialisation fails, for example because there is no slave; otherwise as with
    /// [`Xf::run`].
    pub fn start_network(&mut self, config: &NetworkConfig) -> Result<u8, XfError> {
        self.stop_before_init();
        self.run(&FifoEnable { on: false })?;
        self.run(&FifoClear { fifos: Fifos::Both })?;
        if !matches!(self.header().state.state(), None | Some(EtherCatState::Init)) {
            self.run(&StateSet { slaves: Slaves::All, state: EtherCatState::Init })?;
        }
        let NetworkConfig { dc, reference_clock, lrw } = *config;
        self.run(&EcatInit { special_slaves: false, reference_clock, lrw, fifo_on: false, dc })?;
        self.forget_axes();
        self.cycle_ns = Some(dc.sync0_ns.into()).filter(|cycle| *cycle > 0);
        self.count_slaves()
    }

    /// The number of slaves that the chip found when the network was initialised.
    ///
    /// # Errors
    /// As with [`Xf::run`].
    pub fn count_slaves(&mut self) -> Result<u8, XfError> {
        self.slaves = self.run(&SlaveCountGet)?;
        Ok(self.slaves)
    }

    /// Brings slaves to a state, and checks that all of them have reached it.
    ///
    /// # Errors
    /// [`XfError::StateStuck`] names the slaves that have not reached it, [`XfError::NoSuchSlave`] if the network has
    /// no slave with this number; otherwise as with [`Xf::run`].
    pub fn set_state(&mut self, slaves: Slaves, state: EtherCatState) -> Result<(), XfError> {
        // The chip's answer to the change of state does not show which slave has refused it.
        let changed = self.run(&StateSet { slaves, state });
        match changed {
            Ok(()) | Err(XfError::Chip(HostError::Failed { .. })) => {}
            Err(error) => return Err(error),
        }
        let all = 0..self.slaves;
        let concerned: Vec<u8> = match slaves {
            Slaves::All => all.collect(),
            Slaves::One(slave) => vec![slave.get()],
        };
        self.run(&StateUpdate)?;
        let mut elsewhere = Vec::new();
        for slave in concerned {
            let found = self.run(&StateGet { slaves: Slaves::One(self.slave(slave)?) })?;
            if found.state() != Some(state) || found.has_error() {
                let al_status = self.item(slave, SlaveInfoItem::AlStatus)?;
                elsewhere.push((slave, found.state(), al_status as u16));
            }
        }
        if elsewhere.is_empty() { Ok(()) } else { Err(XfError::StateStuck { wanted: state, slaves: elsewhere }) }
    }

    /// The state of the network: the lowest state of all slaves, read from them now.
    ///
    /// # Errors
    /// As with [`Xf::run`].
    pub fn state(&mut self) -> Result<NetworkState, XfError> {
        self.run(&StateUpdate)?;
        self.run(&StateGet { slaves: Slaves::All })
    }

    /// Describes a slave. Its state is as read by the last [`Self::state`] or [`Self::set_state`].
    ///
    /// # Errors
    /// [`XfError::NoSuchSlave`] if the network has no slave with this number; otherwise as with [`Xf::run`].
    pub fn slave_description(&mut self, slave: u8) -> Result<SlaveDescription, XfError> {
        let number = self.slave(slave)?;
        let name = self.run(&SlaveInfoGet { slave: number, item: SlaveInfoItem::Name })?;
        let name = match name {
            crate::xf::response::SlaveInfo::Text(text) => {
                String::from_utf8_lossy(text).trim_end_matches(['\0', ' ']).to_owned()
            }
            _ => String::new(),
        };
        Ok(SlaveDescription {
            slave,
            name,
            vendor: self.item(slave, SlaveInfoItem::Vendor)?,
            product: self.item(slave, SlaveInfoItem::Product)?,
            revision: self.item(slave, SlaveInfoItem::Revision)?,
            state: NetworkState(self.item(slave, SlaveInfoItem::State)? as u8),
            al_status: self.item(slave, SlaveInfoItem::AlStatus)? as u16,
            station_address: self.item(slave, SlaveInfoItem::StationAddress)? as u16,
            alias: self.item(slave, SlaveInfoItem::Alias)? as u16,
            has_dc: self.has_dc(slave)?,
            output_bytes: self.item(slave, SlaveInfoItem::OutputBytes)?,
            input_bytes: self.item(slave, SlaveInfoItem::InputBytes)?,
        })
    }

    /// Whether a slave has distributed clocks; `None` with older firmware, which refuses to report this.
    fn has_dc(&mut self, slave: u8) -> Result<Option<bool>, XfError> {
        match self.item(slave, SlaveInfoItem::HasDc) {
            Ok(has_dc) => Ok(Some(has_dc != 0)),
            Err(XfError::Chip(HostError::Refused { .. })) => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Checks that a slave with this number is on the network.
    pub(super) fn slave(&self, slave: u8) -> Result<SlaveNumber, XfError> {
        let number = SlaveNumber::new(slave).filter(|_| slave < self.slaves);
        number.ok_or(XfError::NoSuchSlave { slave, found: self.slaves })
    }

    pub(super) fn item(&mut self, slave: u8, item: SlaveInfoItem) -> Result<u32, XfError> {
        let slave = self.slave(slave)?;
        Ok(self.run(&SlaveInfoGet { slave, item })?.number().unwrap_or(0))
    }
}

//! Commands for states, slaves and the working counter, and for results of SDO transfers.

use super::{CommandOutcome, CommandRefused, answered, done_if};
use crate::xf::chip::Chip;
use crate::xf::chip::network::SlaveNetwork;
use crate::xf::request::{PdoWorkingCounterGet, SlaveInfoGet, SlaveInfoItem, Slaves, StateGet, WorkingCounterItem};
use crate::xf::response::{Answer, SlaveInfo};

/// The station address of the first slave; further slaves have consecutive addresses. `[OURS]`
const FIRST_STATION_ADDRESS: u16 = 0x1001;

impl<N: SlaveNetwork> Chip<N> {
    pub(super) fn working_counter_item(&self, request: &PdoWorkingCounterGet, data: &mut [u8]) -> CommandOutcome {
        let (inputs, outputs) = self.bus.slaves_with();
        let number = match request.which {
            WorkingCounterItem::Inputs => inputs,
            WorkingCounterItem::Outputs => outputs,
            WorkingCounterItem::Counter => self.bus.working_counter.into(),
        };
        Ok(number.encode(data)?)
    }

    /// ECAT_STATE_GET, from the chip's memory. `[OURS]` For all slaves together it returns the lowest state.
    pub(super) fn state_get(&self, request: &StateGet, data: &mut [u8]) -> CommandOutcome {
        let state = match request.slaves {
            Slaves::All => Some(self.bus.state_of_all()),
            Slaves::One(slave) => self.found(request.slaves).then(|| self.bus.known[usize::from(slave.get())].state),
        };
        answered(state, data)
    }

    /// ECAT_SLV_INFO_GET. `[OURS]` The items about distributed clocks have one byte (10, has a clock; 13, clock is active) or
    /// four (11, cycle time; 12, shift). Items above 13, which are in the vendor's header up to 40 (OBS) without a description,
    /// are refused.
    pub(super) fn slave_info(&self, request: &SlaveInfoGet, data: &mut [u8]) -> CommandOutcome {
        let slave = request.slave.get();
        if !self.found(request.slave.into()) {
            return Err(CommandRefused);
        }
        let (known, place) = (&self.bus.known[usize::from(slave)], &self.bus.places[usize::from(slave)]);
        let identity = self.network.identity(slave).ok_or(CommandRefused)?;
        let item = match request.item {
            SlaveInfoItem::Vendor => SlaveInfo::U32(identity.vendor),
            SlaveInfoItem::Product => SlaveInfo::U32(identity.product),
            SlaveInfoItem::Revision => SlaveInfo::U32(identity.revision),
            SlaveInfoItem::Name => {
                let name = identity.name.as_bytes();
                SlaveInfo::Text(&name[..name.len().min(data.len())])
            }
            SlaveInfoItem::StationAddress => SlaveInfo::U16(FIRST_STATION_ADDRESS + u16::from(slave)),
            SlaveInfoItem::Alias => SlaveInfo::U16(identity.alias),
            SlaveInfoItem::State => SlaveInfo::U16(known.state.0.into()),
            SlaveInfoItem::AlStatus => SlaveInfo::U16(known.al_status),
            SlaveInfoItem::OutputBytes => SlaveInfo::U32(place.output_bytes.into()),
            SlaveInfoItem::InputBytes => SlaveInfo::U32(place.input_bytes.into()),
            SlaveInfoItem::HasDc => SlaveInfo::U8(self.network.has_dc(slave).into()),
            SlaveInfoItem::DcCycle => SlaveInfo::U32(known.dc.sync0_ns),
            SlaveInfoItem::DcShift => SlaveInfo::U32(known.dc.shift_ns as u32),
            SlaveInfoItem::DcActive => SlaveInfo::U8(known.dc_active.into()),
        };
        Ok(item.encode(data)?)
    }

    /// ENABLE_LRW: selects LRW, or LRD and LWR, for process data. `[OURS]` Firmware before 0x22 refuses it.
    pub(super) fn enable_lrw(&mut self, lrw: bool) -> CommandOutcome {
        if self.profile.is_newer() {
            self.bus.lrw = lrw;
        }
        done_if(self.profile.is_newer())
    }

    /// ECAT_SDO_GET, with as many bytes as were read and fit into the data segment; none if the last read failed.
    /// `[OURS]` It is refused before the first read.
    pub(super) fn sdo_get(&self, data: &mut [u8]) -> CommandOutcome {
        let read = self.sdo.len.map(|len| &self.sdo.data[..len.min(data.len())]);
        answered(read, data)
    }
}

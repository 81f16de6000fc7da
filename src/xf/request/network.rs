//! Requests for initialisation, states, slaves and clocks.

use super::{SlaveNumber, Slaves};
use crate::xf::fields::Names;
use crate::xf::layout::{FieldDecl, FieldLayout, FieldList, FieldReader, FieldWriter, at, layout, par, reserve};
use crate::xf::response::{Answer as _, Returned, SlaveInfo};
use crate::xf::value::choices;
use crate::xf::{EtherCatState, Malformed, Reserve};

layout! {
    /// INFO_UPDATE_OP, command code 0: requests a new header and nothing else (XF EN 369).
    pub struct InfoUpdate;

    /// ECAT_RECONFIG_OP, command code 2: the chip allocates its memory again after a change of process data
    /// (XF EN 402).
    pub struct Reconfig;

    /// ECAT_INIT_DC_OP, command code 3: initialises the distributed clocks, which is needed after [`DcSync`]
    /// (XF EN 413).
    pub struct InitDc;

    /// ECAT_SLV_CNT_GET, command code 16: reads the number of slaves from the return byte (XF EN 661).
    pub struct SlaveCountGet;

    /// ECAT_STATE_UPDATE, command code 57: the chip reads the states of the slaves into its memory (XF EN 1304).
    pub struct StateUpdate;

    /// ECAT_CONFIG_MAP, command code 73: like [`Reconfig`], for slaves that would fall back to their default process
    /// data with it (XF EN 1421, XF ZH 410).
    pub struct ConfigMap;

    /// ECAT_STATE_SET, command code 12: brings slaves to a state. Parameter byte: slaves; information byte `i0`: state.
    /// Bit 4 may be added to the state, as one application does to acknowledge an error (XF EN 619; OBS).
    pub struct StateSet {
        /// The slaves to bring to the state.
        pub slaves: Slaves = par(),
        /// The state that the slaves have to reach.
        pub state: EtherCatState = info(0),
    }

    /// ECAT_STATE_CHECK, command code 41: combines [`StateSet`], [`StateUpdate`] and [`StateGet`] (XF EN 1187).
    pub struct StateCheck {
        /// The slaves to bring to the state.
        pub slaves: Slaves = par(),
        /// The state that the slaves have to reach.
        pub state: EtherCatState = info(0),
    }

    /// ECAT_STATE_GET, command code 13: reads the state stored in the chip, which [`StateUpdate`] renews, from the
    /// return byte. Parameter byte: slaves (XF EN 627).
    pub struct StateGet {
        /// The slaves whose state is read.
        pub slaves: Slaves = par(),
    }

    /// ECAT_PDO_WC_GET, command code 4: reads the working counter of the last cycle, or the number of slaves with
    /// inputs or with outputs, from which the expected working counter follows. The parameter byte selects one of these
    /// numbers (XF EN 421). Answer: u32 at byte 0 of the data.
    pub struct PdoWorkingCounterGet {
        /// Whether to read the working counter, the number of slaves with inputs, or the number of slaves with outputs.
        pub which: WorkingCounterItem = par(),
    }

    /// ENABLE_LRW, command code 142: sets whether process data travel in one LRW datagram, if the slaves support it, or
    /// in LRD and LWR. The parameter byte is 1 for LRW, 0 for LRD and LWR (XF EN 1635).
    pub struct EnableLrw {
        /// True for LRW, false for LRD and LWR.
        pub lrw: bool = par(),
    }

    /// ECAT_SLV_INFO_GET, command code 15: reads a property of a slave. Parameter byte: slave; information byte `i0`:
    /// number of the property (XF EN 643).
    pub struct SlaveInfoGet {
        /// The slave whose property is read.
        pub slave: SlaveNumber = par(),
        /// The property of the slave to read, such as its name or its AL status code.
        pub item: SlaveInfoItem = info(0),
    }

    /// The cycle and shift times of the distributed clocks.
    #[derive(Default)]
    pub struct DcTiming {
        /// The word AssignActivate from the slave's ESI file, such as 0x0300 for SYNC0.
        pub assign_activate: u16 = at(2).hex().or(0),
        /// Cycle time of SYNC0 in nanoseconds.
        pub sync0_ns: u32 = at(4),
        /// Cycle time of SYNC1 in nanoseconds.
        pub sync1_ns: u32 = at(8).or(0),
        /// Shift time of SYNC0 in nanoseconds.
        // The manuals' text gives the offset 0x12, their drawing 12.
        pub shift_ns: i32 = at(12).or(0),
    }

    /// ECAT_DCSYNC, command code 50: sets other cycle and shift times for one slave, after [`EcatInit`] and before
    /// [`InitDc`] (XF EN 1201, XF ZH 1136). Data, 16 bytes as in [`EcatInit`], except @0 slave and @1 reserved.
    pub struct DcSync {
        /// The slave to set. `[OURS]` 0xFF means all slaves, as in other requests.
        pub slaves: Slaves = at(0),
        /// The times of the distributed clock.
        pub dc: DcTiming,
    }
}

choices! {
    /// The number that [`PdoWorkingCounterGet`] reads. The expected working counter is inputs + 2 * outputs.
    pub WorkingCounterItem(u8), "PDO_WC_GET item", "1 slaves with inputs, 2 slaves with outputs, 3 working counter" {
        /// 1: number of slaves with inputs.
        Inputs = 1,
        /// 2: number of slaves with outputs.
        Outputs = 2,
        /// 3: working counter of the last cycle.
        Counter = 3,
    }

    /// The property of a slave that [`SlaveInfoGet`] reads.
    pub SlaveInfoItem(u8), "SLV_INFO_GET item", "0 to 13" {
        /// 0: vendor id.
        Vendor = 0,
        /// 1: product code.
        Product = 1,
        /// 2: revision number.
        Revision = 2,
        /// 3: name, as a text.
        Name = 3,
        /// 4: configured station address.
        StationAddress = 4,
        /// 5: station alias.
        Alias = 5,
        /// 6: EtherCAT state.
        State = 6,
        /// 7: AL status code.
        AlStatus = 7,
        /// 8: size of the outputs, the RxPDO, in bytes.
        OutputBytes = 8,
        /// 9: size of the inputs, the TxPDO, in bytes.
        InputBytes = 9,
        /// 10: whether the slave has distributed clocks (OBS, like all further items).
        HasDc = 10,
        /// 11: cycle time of the distributed clock; the modelled chip returns the cycle time of SYNC0 in nanoseconds.
        DcCycle = 11,
        /// 12: shift time of the distributed clock; the modelled chip returns the shift time of SYNC0 in nanoseconds.
        DcShift = 12,
        /// 13: whether the distributed clock is active.
        DcActive = 13,
    }

    /// The reference clock of the distributed clocks: reserve bit 12 of [`EcatInit`], from firmware 0x22 on. The two
    /// manuals contradict each other; the names here are those of the vendor's header.
    pub ReferenceClock(u8), "reference clock", "0 bus shift, 1 master shift" {
        /// 0: bus shift; the chip's own clock is the reference.
        Chip = 0,
        /// 1: master shift; the clock of the first slave with distributed clocks is the reference.
        FirstSlave = 1,
    }
}

impl SlaveInfoGet {
    /// Decodes the answer. Its length decides the type of the value, except for the name, which is always a text.
    pub(super) fn info<'a>(&self, returned: Returned, data: &'a [u8]) -> Result<SlaveInfo<'a>, Malformed> {
        match self.item {
            SlaveInfoItem::Name => Ok(SlaveInfo::Text(returned.valid(data)?)),
            _ => SlaveInfo::decode(returned, data),
        }
    }
}

/// ECAT_INIT_OP, command code 1: initialises the network (XF EN 375, XF ZH 384). Parameter byte: 48 for special slaves;
/// reserve bits 12 and 11. Data, 16 bytes (@offset): @0 0xFF, @1 0x81 for a FIFO that is off at start, @2 u16
/// AssignActivate, @4 u32 SYNC0, @8 u32 SYNC1, @12 i32 shift, times in nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct EcatInit {
    /// Sends 48 instead of 0 as the parameter. The manuals require it for "special slaves" and do not say which these are.
    pub special_slaves: bool,
    /// The reference clock, from firmware 0x22 on.
    pub reference_clock: ReferenceClock,
    /// Whether LRW is used if all slaves support it, from firmware 0x22 on; see [`EnableLrw`].
    pub lrw: bool,
    /// Whether the chip takes RxPDOs out of the RxFIFO from the start; otherwise [`FifoEnable`](super::FifoEnable)
    /// enables it later.
    pub fifo_on: bool,
    /// The times of the distributed clocks.
    pub dc: DcTiming,
}

impl EcatInit {
    /// The parameter that the manuals require for "special slaves"; they do not say which slaves these are.
    const SPECIAL_SLAVES: u8 = 48;
    const SPECIAL: FieldDecl =
        par().one_of(&[("no", 0), ("yes", Self::SPECIAL_SLAVES as u32)]).or(0).of::<u8>("special_slaves");
    /// The two reserve bits that this command uses: reference clock and LRW.
    const RESERVE: FieldDecl = reserve().bits(Self::BITS).or(0).of::<u16>("reserve");
    const BITS: Names = &[("master_shift", Reserve::MASTER_SHIFT.0 as u32), ("lrw", Reserve::LRW.0 as u32)];
    /// Byte 0 of the data, which is fixed: all slaves.
    const ALL_SLAVES: FieldDecl = at(0).of::<u8>("slaves");
    /// Byte 1 of the data: the FIFO is off at start.
    const FIFO_OFF: u8 = 0x81;
    /// Byte 1 of the data: the FIFO is on at start. `[OURS]` The manuals list only 0x81 and call it fixed; any other
    /// value counts as on.
    const FIFO_ON: u8 = 0;
    const FIFO: FieldDecl = at(1)
        .one_of(&[("on", Self::FIFO_ON as u32), ("off", Self::FIFO_OFF as u32)])
        .or(Self::FIFO_OFF as u32)
        .of::<u8>("fifo");
}

impl FieldLayout<'_> for EcatInit {
    const FIELDS: FieldList = FieldList::of(Self::SPECIAL)
        .and(FieldList::of(Self::RESERVE))
        .and(FieldList::of(Self::FIFO))
        .and(<DcTiming as FieldLayout<'_>>::FIELDS);

    fn put(&self, to: &mut FieldWriter<'_>) -> Result<(), Malformed> {
        let clock = match self.reference_clock {
            ReferenceClock::Chip => Reserve::NONE,
            ReferenceClock::FirstSlave => Reserve::MASTER_SHIFT,
        };
        let lrw = if self.lrw { Reserve::LRW } else { Reserve::NONE };
        Self::SPECIAL.put(if self.special_slaves { &Self::SPECIAL_SLAVES } else { &0 }, to)?;
        Self::RESERVE.put(&(clock | lrw).0, to)?;
        Self::ALL_SLAVES.put(&0xFF_u8, to)?;
        Self::FIFO.put(if self.fifo_on { &Self::FIFO_ON } else { &Self::FIFO_OFF }, to)?;
        self.dc.put(to)
    }

    fn take(from: &FieldReader<'_>) -> Result<Self, Malformed> {
        let reserve = from.arguments.reserve;
        let is_chip = !reserve.contains(Reserve::MASTER_SHIFT);
        Ok(Self {
            special_slaves: Self::SPECIAL.take::<u8>(from)? == Self::SPECIAL_SLAVES,
            reference_clock: if is_chip { ReferenceClock::Chip } else { ReferenceClock::FirstSlave },
            lrw: reserve.contains(Reserve::LRW),
            fifo_on: Self::FIFO.take::<u8>(from)? != Self::FIFO_OFF,
            dc: DcTiming::take(from)?,
        })
    }
}

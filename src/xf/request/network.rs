//! Initialisation, states, slaves and clocks.

use bytemuck::{Pod, Zeroable};

use super::{Arguments, Call, SlaveNumber, Slaves, Switch, plain, short};
use crate::ethercat::{I32Le, U16Le, U32Le};
use crate::xf::response::{Answer as _, Returned, SlaveInfo};
use crate::xf::value::choices;
use crate::xf::{CommandCode, EtherCatState, Malformed, NetworkState, Reserve, segment};

plain! {
    /// INFO_UPDATE_OP, code 0: asks for a new header and nothing else (XF EN 369).
    InfoUpdate, InfoUpdate -> ();
    /// ECAT_RECONFIG_OP, code 2: the chip lays out its memory anew after a change of process data (XF EN 402).
    Reconfig, Reconfig -> ();
    /// ECAT_INIT_DC_OP, code 3: initialises the distributed clocks, as is needed after [`DcSync`] (XF EN 413).
    InitDc, InitDc -> ();
    /// ECAT_SLV_CNT_GET, code 16: how many slaves there are, in `ret` (XF EN 661).
    SlaveCountGet, SlaveCountGet -> u8;
    /// ECAT_STATE_UPDATE, code 57: the chip reads the states of the slaves into its memory (XF EN 1304).
    StateUpdate, StateUpdate -> ();
    /// ECAT_CONFIG_MAP, code 73: as [`Reconfig`], for slaves that fall back to their default process data with that
    /// (XF EN 1421, XF ZH 410).
    ConfigMap, ConfigMap -> ();
}

/// The state that a code asks for. Bit 4 may stand beside it, which acknowledges an error as in a slave's AL control: an application
/// sends 0x12 after one (OBS). `[OURS]` It is left out: an error is acknowledged on the way to any state.
fn requested_state(code: u8) -> Result<EtherCatState, Malformed> {
    EtherCatState::decode(code & !NetworkState::ERROR)
}

short! {
    /// ECAT_STATE_SET, code 12: brings slaves to a state. `par` slaves, `i0` state, to which bit 4 may be added (XF EN 619; OBS).
    StateSet {
        /// Which slaves.
        pub slaves: Slaves,
        /// The state they shall reach.
        pub state: EtherCatState,
    }, StateSet -> (),
        |request| Arguments::NONE.parameter(request.slaves.code()).info([request.state.code(), 0, 0, 0]),
        |a| Self { slaves: Slaves::decode(a.parameter)?, state: requested_state(a.info[0])? };

    /// ECAT_STATE_CHECK, code 41: what [`StateSet`], [`StateUpdate`] and [`StateGet`] do, in one (XF EN 1187).
    StateCheck {
        /// Which slaves.
        pub slaves: Slaves,
        /// The state they shall reach.
        pub state: EtherCatState,
    }, StateCheck -> (),
        |request| Arguments::NONE.parameter(request.slaves.code()).info([request.state.code(), 0, 0, 0]),
        |a| Self { slaves: Slaves::decode(a.parameter)?, state: requested_state(a.info[0])? };

    /// ECAT_STATE_GET, code 13: the state in the chip's memory, which [`StateUpdate`] renews. `par` slaves; `ret` the
    /// state (XF EN 627).
    StateGet {
        /// Which slaves.
        pub slaves: Slaves,
    }, StateGet -> NetworkState,
        |request| Arguments::NONE.parameter(request.slaves.code()),
        |a| Self { slaves: Slaves::decode(a.parameter)? };

    /// ECAT_PDO_WC_GET, code 4: numbers about the working counter. `par` which; the answer @0 u32 (XF EN 421).
    PdoWorkingCounterGet {
        /// Which number.
        pub which: WorkingCounterItem,
    }, PdoWorkingCounterGet -> u32,
        |request| Arguments::NONE.parameter(request.which.code()),
        |a| Self { which: WorkingCounterItem::decode(a.parameter)? };

    /// ENABLE_LRW, code 142: whether process data travel in one LRW datagram, if the slaves can, or in LRD and LWR.
    /// `par` the switch (XF EN 1635).
    EnableLrw {
        /// LRW; otherwise LRD and LWR.
        pub lrw: bool,
    }, EnableLrw -> (),
        |request| Arguments::NONE.parameter(request.lrw.into()),
        |a| Self { lrw: Switch::decode(a.parameter)? == Switch::On };
}

choices! {
    /// Which number [`PdoWorkingCounterGet`] asks for. In theory the counter is inputs + 2 * outputs.
    pub WorkingCounterItem(u8), "PDO_WC_GET item", "1 slaves with inputs, 2 slaves with outputs, 3 working counter" {
        /// 1: how many slaves have inputs.
        Inputs = 1,
        /// 2: how many slaves have outputs.
        Outputs = 2,
        /// 3: the working counter of the last cycle.
        Counter = 3,
    }

    /// What [`SlaveInfoGet`] asks for.
    pub SlaveInfoItem(u8), "SLV_INFO_GET item", "0 to 13" {
        /// 0: vendor id.
        Vendor = 0,
        /// 1: product code.
        Product = 1,
        /// 2: revision.
        Revision = 2,
        /// 3: name, a text.
        Name = 3,
        /// 4: configured station address.
        StationAddress = 4,
        /// 5: station alias.
        Alias = 5,
        /// 6: EtherCAT state.
        State = 6,
        /// 7: AL status code.
        AlStatus = 7,
        /// 8: bytes of outputs, the RxPDO.
        OutputBytes = 8,
        /// 9: bytes of inputs, the TxPDO.
        InputBytes = 9,
        /// 10: whether the slave has distributed clocks (OBS, as those below).
        HasDc = 10,
        /// 11: cycle of the distributed clock.
        DcCycle = 11,
        /// 12: shift of the distributed clock.
        DcShift = 12,
        /// 13: whether the distributed clock is active.
        DcActive = 13,
    }

    /// Whose clock leads the distributed clocks: reserve bit 12 of [`EcatInit`], from firmware 0x22 on. The two manuals
    /// contradict each other; the vendor's header names the bit as it is here.
    pub ReferenceClock(u8), "reference clock", "0 bus shift, 1 master shift" {
        /// 0: bus shift, the chip's own clock.
        Chip = 0,
        /// 1: master shift, the clock of the first slave that has one.
        FirstSlave = 1,
    }
}

/// ECAT_SLV_INFO_GET, code 15: an item about a slave. `par` slave, `i0` item (XF EN 643).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SlaveInfoGet {
    /// Which slave.
    pub slave: SlaveNumber,
    /// Which item.
    pub item: SlaveInfoItem,
}

impl Call<'_> for SlaveInfoGet {
    const CODE: CommandCode = CommandCode::SlaveInfoGet;
    type Answer<'a> = SlaveInfo<'a>;

    fn encode(&self, _: &mut [u8]) -> Result<Arguments, Malformed> {
        Ok(Arguments::NONE.parameter(self.slave.get()).info([self.item.code(), 0, 0, 0]))
    }

    fn decode(arguments: &Arguments, _: &[u8]) -> Result<Self, Malformed> {
        let slave = SlaveNumber::decode(arguments.parameter)?;
        Ok(Self { slave, item: SlaveInfoItem::decode(arguments.info[0])? })
    }

    fn answer<'a>(&self, returned: Returned, data: &'a [u8]) -> Result<SlaveInfo<'a>, Malformed> {
        match self.item {
            SlaveInfoItem::Name => Ok(SlaveInfo::Text(returned.valid(data)?)),
            _ => SlaveInfo::decode(returned, data),
        }
    }
}

/// The times of the distributed clocks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct DcTiming {
    /// The word AssignActivate of the slave's description, such as 0x0300 for SYNC0.
    pub assign_activate: u16,
    /// Cycle of SYNC0 in nanoseconds.
    pub sync0_ns: u32,
    /// Cycle of SYNC1 in nanoseconds.
    pub sync1_ns: u32,
    /// Shift of SYNC0 in nanoseconds.
    pub shift_ns: i32,
}

/// The data segment of [`EcatInit`] and [`DcSync`].
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct DcLayout {
    /// @0: the slave's number in [`DcSync`], 0xFF in [`EcatInit`].
    slave: u8,
    /// @1: 0x81 in [`EcatInit`] if the FIFO is off at start.
    fifo: u8,
    /// @2.
    assign_activate: U16Le,
    /// @4.
    sync0_ns: U32Le,
    /// @8.
    sync1_ns: U32Le,
    /// @12: the manuals print 0x12 and draw 12.
    shift_ns: I32Le,
}

const _: () = assert!(size_of::<DcLayout>() == 16 && align_of::<DcLayout>() == 1);

impl DcLayout {
    fn new(slave: u8, fifo: u8, dc: DcTiming) -> Self {
        Self {
            slave,
            fifo,
            assign_activate: dc.assign_activate.into(),
            sync0_ns: dc.sync0_ns.into(),
            sync1_ns: dc.sync1_ns.into(),
            shift_ns: dc.shift_ns.into(),
        }
    }

    fn timing(&self) -> DcTiming {
        DcTiming {
            assign_activate: self.assign_activate.get(),
            sync0_ns: self.sync0_ns.get(),
            sync1_ns: self.sync1_ns.get(),
            shift_ns: self.shift_ns.get(),
        }
    }
}

/// ECAT_INIT_OP, code 1: initialises the network (XF EN 375, XF ZH 384). `par` 48 for special slaves; reserve bits 12
/// and 11; 16 bytes: @0 0xFF, @1 0x81 for a FIFO that is off at start, @2 u16 AssignActivate, @4 u32 SYNC0, @8 u32
/// SYNC1, @12 i32 shift, in nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct EcatInit {
    /// `par` is 48: the manuals call the slaves special and say no more.
    pub special_slaves: bool,
    /// Whose clock leads, from firmware 0x22 on.
    pub reference_clock: ReferenceClock,
    /// LRW is used if all slaves can, from firmware 0x22 on; see [`EnableLrw`].
    pub lrw: bool,
    /// The RxFIFO is put out from the start; otherwise [`FifoEnable`](super::FifoEnable) switches it on.
    pub fifo_on: bool,
    /// The times of the distributed clocks.
    pub dc: DcTiming,
}

impl EcatInit {
    /// `par` for special slaves.
    const SPECIAL: u8 = 48;
    /// @0, a fixed value.
    const ALL_SLAVES: u8 = 0xFF;
    /// @1: the FIFO is off at start.
    const FIFO_OFF: u8 = 0x81;
    /// @1: the FIFO is on. `[OURS]` The manuals know 0x81 alone and call it fixed; any other value is taken for on.
    const FIFO_ON: u8 = 0;
}

impl Call<'_> for EcatInit {
    const CODE: CommandCode = CommandCode::EcatInit;
    type Answer<'a> = ();

    fn encode(&self, data: &mut [u8]) -> Result<Arguments, Malformed> {
        let fifo = if self.fifo_on { Self::FIFO_ON } else { Self::FIFO_OFF };
        let len = segment::put(data, &DcLayout::new(Self::ALL_SLAVES, fifo, self.dc))?;
        let clock = match self.reference_clock {
            ReferenceClock::Chip => Reserve::NONE,
            ReferenceClock::FirstSlave => Reserve::MASTER_SHIFT,
        };
        let lrw = if self.lrw { Reserve::LRW } else { Reserve::NONE };
        let parameter = if self.special_slaves { Self::SPECIAL } else { 0 };
        Ok(Arguments { parameter, info: [0; 4], reserve: clock | lrw, len })
    }

    fn decode(arguments: &Arguments, data: &[u8]) -> Result<Self, Malformed> {
        let layout: DcLayout = segment::get(data)?;
        let master_shift = arguments.reserve.contains(Reserve::MASTER_SHIFT);
        Ok(Self {
            special_slaves: arguments.parameter == Self::SPECIAL,
            reference_clock: if master_shift { ReferenceClock::FirstSlave } else { ReferenceClock::Chip },
            lrw: arguments.reserve.contains(Reserve::LRW),
            fifo_on: layout.fifo != Self::FIFO_OFF,
            dc: layout.timing(),
        })
    }
}

/// ECAT_DCSYNC, code 50: other times for one slave, after [`EcatInit`] and before [`InitDc`] (XF EN 1201, XF ZH 1136).
/// 16 bytes as with [`EcatInit`], but @0 is the slave, and @1 is reserved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct DcSync {
    /// Which slave. `[OURS]` 0xFF is all of them, as elsewhere.
    pub slaves: Slaves,
    /// The times of the distributed clock.
    pub dc: DcTiming,
}

impl Call<'_> for DcSync {
    const CODE: CommandCode = CommandCode::DcSync;
    type Answer<'a> = ();

    fn encode(&self, data: &mut [u8]) -> Result<Arguments, Malformed> {
        let len = segment::put(data, &DcLayout::new(self.slaves.code(), 0, self.dc))?;
        Ok(Arguments::NONE.len(len))
    }

    fn decode(_: &Arguments, data: &[u8]) -> Result<Self, Malformed> {
        let layout: DcLayout = segment::get(data)?;
        Ok(Self { slaves: Slaves::decode(layout.slave)?, dc: layout.timing() })
    }
}

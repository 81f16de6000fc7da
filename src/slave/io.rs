//! A digital IO module: 16 outputs and 16 inputs (SK-7, table).
//!
//! Its outputs are wired to its inputs, see [`lines`](super::lines). \[OURS] Outside OP the outputs are off.

use std::slice;

use super::device::{Base, Identity, Model, VENDOR_ID, identity, not_of_this_kind};
use super::dictionary::{Object, Values, check, join, rows};
use super::lines::Lines;
use crate::ethercat::Ns;
use crate::fieldbus::{AxisIn, Refusal, Role, SlaveIn, SlaveOut};

/// 0x1018:2. \[OURS] "IO16".
pub const PRODUCT_CODE: u32 = 0x494F_3136;
/// 0x1018:3.
pub const REVISION: u32 = 0x0001_0000;

const IDENTITY: Identity = Identity {
    // Device profile 401, digital inputs and outputs.
    device_type: 0x0003_0191,
    name: "IO16 simulated digital IO",
    vendor_id: VENDOR_ID,
    product_code: PRODUCT_CODE,
    revision: REVISION,
};

/// How an [`Io`] differs from the one it is by default.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IoConfig {
    /// Its name for people.
    pub name: String,
    /// Serial number, 0x1018:4.
    pub serial: u32,
}

impl Default for IoConfig {
    fn default() -> Self {
        Self { name: "io".into(), serial: 0 }
    }
}

/// The module.
#[derive(Clone, Debug)]
pub struct Io {
    base: Base,
    lines: Lines,
}

impl Io {
    /// A module that is switched on now.
    pub fn new(config: IoConfig) -> Self {
        let IoConfig { name, serial } = config;
        Self { base: Base::new(name, serial, &IDENTITY, Values::new(OBJECTS)), lines: Lines::default() }
    }

    /// The outputs as they are, bit k is output k.
    pub const fn outputs(&self) -> u16 {
        self.lines.outputs()
    }
}

impl Default for Io {
    fn default() -> Self {
        Self::new(IoConfig::default())
    }
}

impl Model for Io {
    fn objects() -> &'static [Object<Self>] {
        OBJECTS
    }

    fn base(&self) -> &Base {
        &self.base
    }

    fn base_mut(&mut self) -> &mut Base {
        &mut self.base
    }

    /// Its synchronisation makes no difference: a module without a clock of its own takes outputs when they come.
    fn take_role(&mut self, role: Role) -> Result<(), Refusal> {
        if role == Role::Io { Ok(()) } else { Err(not_of_this_kind()) }
    }

    fn put_inputs(&self, inputs: &mut SlaveIn) {
        inputs[0] = AxisIn { inputs: self.lines.inputs(), ..AxisIn::default() };
    }

    fn has_dc(&self) -> bool {
        false
    }

    fn take_outputs(&mut self, [out, ..]: &SlaveOut) {
        self.lines.set_outputs(out.outputs);
    }

    fn lines_mut(&mut self) -> &mut [Lines] {
        slice::from_mut(&mut self.lines)
    }

    fn pass(&mut self, dt_ns: Ns) {
        self.lines.pass(dt_ns);
    }

    fn lose_outputs(&mut self) {
        self.lines.set_outputs(0);
    }
}

type Row = Object<Io>;

/// Every object. \[OURS] The modular profile's areas (ETG.5001): inputs at 0x6000, outputs at 0x7000; outputs are written
/// by process data alone.
const OBJECTS: &[Row] = &join::<_, { rows(&PARTS) }>(&PARTS);
const _: () = check(OBJECTS);
const PARTS: [&[Row]; 2] = [&identity(), OWN];

const OWN: &[Row] = &[
    Row::u8(0x1600, 0, "RxPDO").default(1),
    Row::u32(0x1600, 1, "Outputs").default(0x7000_0110),
    Row::u8(0x1A00, 0, "TxPDO").default(1),
    Row::u32(0x1A00, 1, "Inputs").default(0x6000_0110),
    Row::u8(0x1C12, 0, "RxPDO assign").live(|io| io.base.mapped().is_some().into()),
    Row::u16(0x1C12, 1, "RxPDO").live(|io| if io.base.mapped().is_some() { 0x1600 } else { 0 }),
    Row::u8(0x1C13, 0, "TxPDO assign").live(|io| io.base.mapped().is_some().into()),
    Row::u16(0x1C13, 1, "TxPDO").live(|io| if io.base.mapped().is_some() { 0x1A00 } else { 0 }),
    Row::u8(0x6000, 0, "Digital inputs").default(1),
    Row::u16(0x6000, 1, "Inputs").tx().live(|io| io.lines.inputs().into()),
    Row::u8(0x7000, 0, "Digital outputs").default(1),
    Row::u16(0x7000, 1, "Outputs").rx().live(|io| io.lines.outputs().into()),
];

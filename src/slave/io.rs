//! A digital IO module with 16 outputs and 16 inputs.
//!
//! The outputs are wired to the inputs, see [`lines`](super::lines). \[OURS] Outside OP the outputs are off.

use std::slice;

use super::device::{Base, Identity, Model, VENDOR_ID, description, free_run, identity};
use super::dictionary::{Object, Values, check, join, rows};
use super::lines::Lines;
use super::process_data::{Pdo, rx_pdo, tx_pdo};
use crate::ethercat::Ns;

/// Product code, 0x1018:2. \[OURS] "IO16".
pub const PRODUCT_CODE: u32 = 0x494F_3136;
/// Revision, 0x1018:3.
pub const REVISION: u32 = 0x0001_0000;

const IDENTITY: Identity = Identity {
    // The device profile is 401 (0x0191); 0x0003 stands for digital inputs and outputs.
    device_type: 0x0003_0191,
    name: "IO16 simulated digital IO",
    vendor_id: VENDOR_ID,
    product_code: PRODUCT_CODE,
    revision: REVISION,
};

/// The configuration of an [`Io`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IoConfig {
    /// The display name of the module.
    pub name: String,
    /// Serial number, 0x1018:4.
    pub serial: u32,
}

impl Default for IoConfig {
    fn default() -> Self {
        Self { name: "io".into(), serial: 0 }
    }
}

/// A simulated IO module.
#[derive(Clone, Debug)]
pub struct Io {
    base: Base<Io>,
    lines: Lines,
}

impl Io {
    /// A module in its power-on state.
    pub fn new(config: IoConfig) -> Self {
        let IoConfig { name, serial } = config;
        Self { base: Base::new(name, serial, &IDENTITY, Values::new(OBJECTS), PDOS), lines: Lines::default() }
    }

    /// The present outputs; bit k is output k.
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

    fn pdos() -> &'static [Pdo<Self>] {
        PDOS
    }

    fn base(&self) -> &Base<Self> {
        &self.base
    }

    fn base_mut(&mut self) -> &mut Base<Self> {
        &mut self.base
    }

    fn has_dc(&self) -> bool {
        false
    }

    fn waits_for_outputs(&self) -> bool {
        false
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

/// The object dictionary. \[OURS] It uses the index ranges of the modular device profile (ETG.5001): inputs at 0x6000,
/// outputs at 0x7000. Only process data can write the outputs.
const OBJECTS: &[Row] = &join::<_, { rows(&PARTS) }>(&PARTS);
const _: () = check(OBJECTS);
const PARTS: [&[Row]; 4] = [&description(), &identity(), &free_run(), OWN];

const OWN: &[Row] = &[
    Row::u8(0x6000, 0, "Digital inputs").default(1),
    Row::u16(0x6000, 1, "Inputs").tx().live(|io| io.lines.inputs().into()),
    Row::u8(0x7000, 0, "Digital outputs").default(1),
    Row::u16(0x7000, 1, "Outputs")
        .rx_by(|io, bits| io.lines.set_outputs(bits as u16))
        .live(|io| io.lines.outputs().into()),
];

/// The PDOs at power-on.
const PDOS: &[Pdo<Io>] =
    &[rx_pdo!(OBJECTS, 0x1600, true, [0x7000_0110]), tx_pdo!(OBJECTS, 0x1A00, true, [0x6000_0110])];

//! A digital IO module: 16 outputs and 16 inputs (SK-7, table).
//!
//! \[OURS] Output k is wired to input k of the same module: what is written is read back a cycle later. Outside OP the
//! outputs are off.

use super::al::ApplicationLayer;
use super::dictionary::{self, Device, Object, Values, check};
use super::drive::VENDOR_ID;
use super::{AlStatus, SdoValue, Slave};
use crate::coe::{AbortCode, ObjectAddress, SdoSize};
use crate::fieldbus::{AlState, AxisIn, Ns, Refusal, Role, SlaveConfig, SlaveIn, SlaveOut};

/// 0x1018:2. \[OURS] "IO16".
pub const PRODUCT_CODE: u32 = 0x494F_3136;
/// 0x1018:3.
pub const REVISION: u32 = 0x0001_0000;

/// 0x1000: device profile 401, digital inputs and outputs.
const DEVICE_TYPE: i64 = 0x0003_0191;

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
    name: String,
    serial: u32,
    al: ApplicationLayer,
    values: Values,
    /// Process data are mapped.
    mapped: bool,
    outputs: u16,
    inputs: u16,
}

impl Io {
    /// A module that is switched on now.
    pub fn new(config: IoConfig) -> Self {
        let IoConfig { name, serial } = config;
        let (al, values) = (ApplicationLayer::default(), Values::new(OBJECTS));
        Self { name, serial, al, values, mapped: false, outputs: 0, inputs: 0 }
    }

    /// The outputs as they are, bit k is output k.
    pub const fn outputs(&self) -> u16 {
        self.outputs
    }

    /// Without a mailbox nothing answers, and the master's transfer times out.
    fn mailbox(&self) -> Result<(), AbortCode> {
        if self.al.state() == AlState::Init { Err(AbortCode::TIMEOUT) } else { Ok(()) }
    }
}

impl Default for Io {
    fn default() -> Self {
        Self::new(IoConfig::default())
    }
}

impl Slave for Io {
    fn name(&self) -> &str {
        &self.name
    }

    fn state(&self) -> AlState {
        self.al.state()
    }

    fn enter(&mut self, target: AlState) -> Result<(), AlStatus> {
        let ready = if self.mapped { Ok(()) } else { Err(AlStatus::INVALID_OUTPUTS) };
        self.al.enter(target, ready)?;
        if target != AlState::Op {
            self.outputs = 0;
        }
        if target == AlState::Init {
            self.mapped = false;
        }
        Ok(())
    }

    /// Its synchronisation makes no difference: a module without a clock of its own takes outputs when they come.
    fn configure(&mut self, config: &SlaveConfig) -> Result<(), Refusal> {
        let refusal = |AlStatus(al_status)| Err(Refusal { slave: 0, al_status, abort: None });
        if self.al.state() != AlState::PreOp {
            return refusal(AlStatus::INVALID_CHANGE);
        }
        match config.role {
            Role::Unused => self.mapped = false,
            Role::Io => self.mapped = true,
            // [OURS] Sync manager 2 is looked at first, and no other role has the outputs of an IO module.
            Role::Drive(_) | Role::Step(_) | Role::Hsp(_) => return refusal(AlStatus::INVALID_OUTPUTS),
        }
        Ok(())
    }

    fn upload(&mut self, object: ObjectAddress) -> Result<SdoValue, AbortCode> {
        self.mailbox()?;
        dictionary::upload(self, object)
    }

    fn download(&mut self, object: ObjectAddress, size: SdoSize, value: u32) -> Result<(), AbortCode> {
        self.mailbox()?;
        dictionary::download(self, object, size, value)
    }

    fn exchange(&mut self, outputs: Option<&SlaveOut>, inputs: &mut SlaveIn) {
        inputs[0] = AxisIn { inputs: self.inputs, ..AxisIn::default() };
        if let (Some([out, ..]), AlState::Op) = (outputs, self.al.state()) {
            self.al.feed();
            self.outputs = out.outputs;
        }
    }

    fn step(&mut self, dt_ns: Ns) {
        if self.al.step(dt_ns) {
            self.outputs = 0;
        }
        self.inputs = self.outputs;
    }
}

type Row = Object<Io>;

/// Every object. \[OURS] The modular profile's areas (ETG.5001): inputs at 0x6000, outputs at 0x7000; outputs are written
/// by process data alone.
const OBJECTS: &[Row] = &[
    Row::u32(0x1000, 0, "Device type").default(DEVICE_TYPE),
    Row::u8(0x1001, 0, "Error register"),
    Row::text(0x1008, 0, "Device name", "IO16 simulated digital IO"),
    Row::u8(0x1018, 0, "Identity").default(4),
    Row::u32(0x1018, 1, "Vendor ID").default(VENDOR_ID as i64),
    Row::u32(0x1018, 2, "Product code").default(PRODUCT_CODE as i64),
    Row::u32(0x1018, 3, "Revision").default(REVISION as i64),
    Row::u32(0x1018, 4, "Serial number").live(|io| io.serial.into()),
    Row::u8(0x1600, 0, "RxPDO").default(1),
    Row::u32(0x1600, 1, "Outputs").default(0x7000_0110),
    Row::u8(0x1A00, 0, "TxPDO").default(1),
    Row::u32(0x1A00, 1, "Inputs").default(0x6000_0110),
    Row::u8(0x1C12, 0, "RxPDO assign").live(|io| io.mapped.into()),
    Row::u16(0x1C12, 1, "RxPDO").live(|io| if io.mapped { 0x1600 } else { 0 }),
    Row::u8(0x1C13, 0, "TxPDO assign").live(|io| io.mapped.into()),
    Row::u16(0x1C13, 1, "TxPDO").live(|io| if io.mapped { 0x1A00 } else { 0 }),
    Row::u8(0x6000, 0, "Digital inputs").default(1),
    Row::u16(0x6000, 1, "Inputs").tx().live(|io| io.inputs.into()),
    Row::u8(0x7000, 0, "Digital outputs").default(1),
    Row::u16(0x7000, 1, "Outputs").rx().live(|io| io.outputs.into()),
];
const _: () = check(OBJECTS);

impl Device for Io {
    fn objects() -> &'static [Object<Self>] {
        OBJECTS
    }

    fn values(&self) -> &Values {
        &self.values
    }

    fn values_mut(&mut self) -> &mut Values {
        &mut self.values
    }

    fn al_state(&self) -> AlState {
        self.al.state()
    }
}

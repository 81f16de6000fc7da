//! The process data that the board maps for each kind of slave (SK-7, table of process data): the SDOs that a bus
//! writes in PreOP, and the layout of [`AxisOut`] and [`AxisIn`] in the process image of a slave.
//!
//! To map other process data for a kind of slave, add their objects, a row of `tables!`, and an arm of
//! [`ProcessData::of`]. If an object of the slave decides between two mappings, also add an arm of
//! [`ProcessData::probe`]. No bus has to be changed.
//!
//! All buses use the same mapping: they write [`ProcessData::downloads`] by SDO, and convert process images with
//! [`ProcessData::put_outputs`] and [`ProcessData::take_inputs`]. [`ProcessData::take_outputs`] and
//! [`ProcessData::put_inputs`] are the slave's side, for models of slaves without an object dictionary.

mod downloads;

use super::{AxisIn, AxisOut, MAX_AXES, Role, SlaveIn, SlaveOut};
use crate::ethercat::cia402::{CONTROLWORD, Controlword, ERROR_CODE, Mode, SECOND_AXIS_OFFSET, STATUSWORD, Statusword};
use crate::ethercat::coe::ObjectAddress;
use crate::sk::DriveSync;

pub use downloads::{Download, Downloads, MappedDirection, MappingImage, NO_SUCH_MODE};

/// The maximum length of a slave's process image in one direction, bytes. A pulse module with two channels needs it.
pub const IMAGE_BYTES_MAX: usize = MAX_AXES * longest(Table::LENGTHS);

/// The object that shows whether a pulse module has a second axis: it can be read only if there is one \[OURS].
pub const SECOND_CONTROLWORD: ObjectAddress = ObjectAddress::new(CONTROLWORD + SECOND_AXIS_OFFSET, 0);

/// A field of [`AxisOut`] to which an object can be mapped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum OutWord {
    Controlword,
    Target,
    Outputs,
}

/// A field of [`AxisIn`] to which an object can be mapped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum InWord {
    Statusword,
    Position,
    Torque,
    ErrorCode,
    Inputs,
}

/// A mapped object, and the field of [`AxisOut`] or [`AxisIn`] that it carries. The object is that of the first axis;
/// the second axis has the same objects, higher by [`SECOND_AXIS_OFFSET`].
#[derive(Clone, Copy, Debug)]
struct Mapped<W> {
    object: ObjectAddress,
    /// The size of the object in bytes, 2 or 4.
    bytes: usize,
    word: W,
}

const fn mapped<W: Copy>(index: u16, sub: u8, bytes: usize, word: W) -> Mapped<W> {
    Mapped { object: ObjectAddress::new(index, sub), bytes, word }
}

impl<W> Mapped<W> {
    /// The mapping entry (index, sub-index, bit length) of this object for axis `axis`, counted from 0.
    const fn entry(&self, axis: usize) -> u32 {
        let index = self.object.index + SECOND_AXIS_OFFSET * axis as u16;
        let bits = self.bytes as u32 * 8;
        (index as u32) << 16 | (self.object.sub as u32) << 8 | bits
    }
}

type Out = Mapped<OutWord>;
type In = Mapped<InWord>;

const DRIVE_CSP: [Out; 2] = [mapped(CONTROLWORD, 0, 2, OutWord::Controlword), mapped(0x607A, 0, 4, OutWord::Target)];
const DRIVE_CSV: [Out; 2] = [mapped(CONTROLWORD, 0, 2, OutWord::Controlword), mapped(0x60FF, 0, 4, OutWord::Target)];
const DRIVE_CST: [Out; 2] = [mapped(CONTROLWORD, 0, 2, OutWord::Controlword), mapped(0x6071, 0, 2, OutWord::Target)];
const DRIVE_IN: [In; 4] = [
    mapped(STATUSWORD, 0, 2, InWord::Statusword),
    mapped(0x6064, 0, 4, InWord::Position),
    mapped(0x6077, 0, 2, InWord::Torque),
    mapped(ERROR_CODE, 0, 2, InWord::ErrorCode),
];
/// The objects that are mapped for a channel of the pulse module (HSP): in CSP, in CSV, and its inputs. The digital
/// inputs and outputs are objects of 32 bits, of which the low 16 are used.
const HSP_CSP: [Out; 3] = [
    mapped(CONTROLWORD, 0, 2, OutWord::Controlword),
    mapped(0x607A, 0, 4, OutWord::Target),
    mapped(0x60FE, 1, 4, OutWord::Outputs),
];
const HSP_CSV: [Out; 3] = [
    mapped(CONTROLWORD, 0, 2, OutWord::Controlword),
    mapped(0x60FF, 0, 4, OutWord::Target),
    mapped(0x60FE, 1, 4, OutWord::Outputs),
];
const HSP_IN: [In; 3] = [
    mapped(STATUSWORD, 0, 2, InWord::Statusword),
    mapped(0x6064, 0, 4, InWord::Position),
    mapped(0x60FD, 0, 4, InWord::Inputs),
];
/// \[OURS] The object areas of the modular device profile (ETG.5001): inputs at 0x6000, outputs at 0x7000.
const IO_OUT: [Out; 1] = [mapped(0x7000, 1, 2, OutWord::Outputs)];
const IO_IN: [In; 1] = [mapped(0x6000, 1, 2, InWord::Inputs)];

/// Defines `Table`, an enum with one variant for each pair of tables (outputs, inputs). Its methods pass these constant
/// tables to the functions at the end of this file. The compiler then generates separate code for each table, which is
/// faster than code that reads a table at run time.
macro_rules! tables {
    ($($table:ident: $outputs:ident, $inputs:ident;)*) => {
        /// The tables of mapped objects, outputs and inputs, that an axis uses.
        #[derive(Clone, Copy, Debug)]
        enum Table {
            $($table),*
        }

        impl Table {
            /// The lengths of all process images of one axis, bytes.
            const LENGTHS: &[usize] = &[$(length(&$outputs), length(&$inputs)),*];

            const fn outputs(self) -> &'static [Out] {
                match self { $(Self::$table => &$outputs),* }
            }

            const fn inputs(self) -> &'static [In] {
                match self { $(Self::$table => &$inputs),* }
            }

            #[inline]
            fn put_outputs(self, outputs: &SlaveOut, image: &mut [u8]) {
                match self { $(Self::$table => put_outputs(&$outputs, outputs, image)),* }
            }

            #[inline]
            fn take_outputs(self, image: &[u8], outputs: &mut SlaveOut) {
                match self { $(Self::$table => take_outputs(&$outputs, image, outputs)),* }
            }

            #[inline]
            fn put_inputs(self, inputs: &SlaveIn, image: &mut [u8]) {
                match self { $(Self::$table => put_inputs(&$inputs, inputs, image)),* }
            }

            #[inline]
            fn take_inputs(self, image: &[u8], inputs: &mut SlaveIn) {
                match self { $(Self::$table => take_inputs(&$inputs, image, inputs)),* }
            }
        }
    };
}

tables! {
    DriveCsp: DRIVE_CSP, DRIVE_IN;
    DriveCsv: DRIVE_CSV, DRIVE_IN;
    DriveCst: DRIVE_CST, DRIVE_IN;
    HspCsp: HSP_CSP, HSP_IN;
    HspCsv: HSP_CSV, HSP_IN;
    Io: IO_OUT, IO_IN;
}

/// The process data of one slave: the mapped objects of its axes, their lengths, and its mode of operation.
#[derive(Clone, Copy, Debug)]
pub struct ProcessData {
    /// The table of mapped objects, the same for each axis.
    table: Table,
    axes: u8,
    output_bytes: u8,
    input_bytes: u8,
    mode: Option<Mode>,
}

impl ProcessData {
    /// The object whose presence decides which process data a slave in this role has. The bus tries to read it by SDO
    /// in PreOP, and passes the result to [`Self::of`] as `is_there`. `None`: the role alone decides.
    pub const fn probe(role: Role) -> Option<ObjectAddress> {
        match role {
            Role::Hsp(_) => Some(SECOND_CONTROLWORD),
            Role::Drive(_) | Role::Step(_) | Role::Io | Role::Unused => None,
        }
    }

    /// Whether a slave in this role that cannot map the process data of the board may keep the process data that its
    /// EEPROM describes. The board then uses the first bits of these. Only a bus that reads EEPROMs does so. \[OURS]
    pub const fn may_keep_its_own(role: Role) -> bool {
        matches!(role, Role::Io)
    }

    /// The process data of a slave that is used as `role`. `is_there`: the slave has the object of [`Self::probe`]. `None`: the
    /// slave is not used, or the role has no process data, see [`Role::has_process_data`].
    pub fn of(role: Role, is_there: bool) -> Option<Self> {
        let channels = if is_there { MAX_AXES as u8 } else { 1 };
        let (table, axes) = match role {
            Role::Drive(Mode::Csp) | Role::Step(Mode::Csp) => (Table::DriveCsp, 1),
            Role::Drive(Mode::Csv) => (Table::DriveCsv, 1),
            Role::Drive(Mode::Cst) => (Table::DriveCst, 1),
            Role::Hsp(Mode::Csp) => (Table::HspCsp, channels),
            Role::Hsp(Mode::Csv) => (Table::HspCsv, channels),
            Role::Io => (Table::Io, 1),
            Role::Unused | Role::Drive(_) | Role::Step(_) | Role::Hsp(_) => return None,
        };
        Some(Self {
            table,
            axes,
            output_bytes: axes * length(table.outputs()) as u8,
            input_bytes: axes * length(table.inputs()) as u8,
            mode: role.mode(),
        })
    }

    /// The length of the output image in bytes, at most [`IMAGE_BYTES_MAX`].
    pub const fn output_bytes(&self) -> usize {
        self.output_bytes as usize
    }

    /// The length of the input image in bytes, at most [`IMAGE_BYTES_MAX`].
    pub const fn input_bytes(&self) -> usize {
        self.input_bytes as usize
    }

    /// The number of axes, 1 or 2; an IO slave counts as 1.
    pub const fn axes(&self) -> usize {
        self.axes as usize
    }

    /// The SDO downloads in PreOP that map the process data and set the mode. [`Downloads`] explains their order.
    pub fn downloads(&self, sync: DriveSync) -> Downloads {
        Downloads::of(self, sync)
    }

    /// The mapping entries of the RxPDO of an axis (from 0).
    fn output_entries(&self, axis: usize) -> impl ExactSizeIterator<Item = u32> + use<> {
        self.table.outputs().iter().map(move |mapped| mapped.entry(axis))
    }

    /// The mapping entries of the TxPDO of an axis (from 0).
    fn input_entries(&self, axis: usize) -> impl ExactSizeIterator<Item = u32> + use<> {
        self.table.inputs().iter().map(move |mapped| mapped.entry(axis))
    }

    /// Master's side: writes the outputs to the beginning of `image` and returns that part of it.
    ///
    /// # Panics
    /// If `image` is shorter than [`Self::output_bytes`].
    #[inline]
    pub fn put_outputs<'a>(&self, outputs: &SlaveOut, image: &'a mut [u8]) -> &'a [u8] {
        let image = &mut image[..self.output_bytes()];
        self.table.put_outputs(outputs, image);
        image
    }

    /// Master's side: reads the inputs that the slave has sent from `image`. Fields that are not mapped become 0. Fields of
    /// an axis that the slave does not have stay unchanged.
    ///
    /// # Panics
    /// If `image` is shorter than [`Self::input_bytes`].
    #[inline]
    pub fn take_inputs(&self, image: &[u8], inputs: &mut SlaveIn) {
        self.table.take_inputs(&image[..self.input_bytes()], inputs);
    }

    /// Outputs that keep the axes at a standstill: every motor is off. The target is the actual position in CSP, and 0
    /// in other modes.
    pub fn holding(&self, inputs: &SlaveIn) -> SlaveOut {
        let target = |axis: &AxisIn| if self.mode == Some(Mode::Csp) { axis.position } else { 0 };
        inputs.map(|axis| AxisOut { target: target(&axis), ..AxisOut::default() })
    }

    /// Outputs for a slave whose inputs are stale: its axes brake on their quick-stop ramps and are then off.
    pub fn stopping(&self, inputs: &SlaveIn) -> SlaveOut {
        self.holding(inputs).map(|axis| AxisOut { controlword: Controlword::QUICK_STOP, ..axis })
    }

    /// Slave's side of [`Self::put_outputs`]: returns the outputs that the master has sent. Fields that are not mapped are
    /// 0.
    ///
    /// # Panics
    /// If `image` is shorter than [`Self::output_bytes`].
    pub fn take_outputs(&self, image: &[u8]) -> SlaveOut {
        let mut outputs = SlaveOut::default();
        self.table.take_outputs(&image[..self.output_bytes()], &mut outputs);
        outputs
    }

    /// Slave's side of [`Self::take_inputs`]: writes the inputs to the beginning of `image`.
    ///
    /// # Panics
    /// If `image` is shorter than [`Self::input_bytes`].
    pub fn put_inputs(&self, inputs: &SlaveIn, image: &mut [u8]) {
        self.table.put_inputs(inputs, &mut image[..self.input_bytes()]);
    }
}

/// The length of the process image of one axis in one direction, bytes.
const fn length<W>(mapped: &[Mapped<W>]) -> usize {
    let (mut n, mut bytes) = (0, 0);
    while n < mapped.len() {
        bytes += mapped[n].bytes;
        n += 1;
    }
    bytes
}

const fn longest(lengths: &[usize]) -> usize {
    let (mut n, mut longest) = (0, 0);
    while n < lengths.len() {
        if lengths[n] > longest {
            longest = lengths[n];
        }
        n += 1;
    }
    longest
}

/// Writes the outputs of as many axes as the image has room for. `take_outputs`, `put_inputs` and `take_inputs` read
/// outputs, write inputs and read inputs in the same way.
#[inline(always)]
fn put_outputs<const N: usize>(mapped: &[Out; N], outputs: &SlaveOut, image: &mut [u8]) {
    for (axis, mut image) in outputs.iter().zip(image.chunks_exact_mut(length(mapped))) {
        for Mapped { bytes, word, .. } in mapped {
            let number = match word {
                OutWord::Controlword => axis.controlword.0.into(),
                OutWord::Target => axis.target as u32,
                OutWord::Outputs => axis.outputs.into(),
            };
            image = put(image, *bytes, number);
        }
    }
}

#[inline(always)]
fn take_outputs<const N: usize>(mapped: &[Out; N], image: &[u8], outputs: &mut SlaveOut) {
    for (axis, mut image) in outputs.iter_mut().zip(image.chunks_exact(length(mapped))) {
        for Mapped { bytes, word, .. } in mapped {
            let number;
            (number, image) = take(image, *bytes);
            match word {
                OutWord::Controlword => axis.controlword = Controlword(number as u16),
                OutWord::Target if *bytes == 2 => axis.target = i32::from(number as i16),
                OutWord::Target => axis.target = number as i32,
                OutWord::Outputs => axis.outputs = number as u16,
            }
        }
    }
}

#[inline(always)]
fn put_inputs<const N: usize>(mapped: &[In; N], inputs: &SlaveIn, image: &mut [u8]) {
    for (axis, mut image) in inputs.iter().zip(image.chunks_exact_mut(length(mapped))) {
        for Mapped { bytes, word, .. } in mapped {
            let number = match word {
                InWord::Statusword => axis.statusword.0.into(),
                InWord::Position => axis.position as u32,
                InWord::Torque => axis.torque as u32,
                InWord::ErrorCode => axis.error_code.into(),
                InWord::Inputs => axis.inputs.into(),
            };
            image = put(image, *bytes, number);
        }
    }
}

#[inline(always)]
fn take_inputs<const N: usize>(mapped: &[In; N], image: &[u8], inputs: &mut SlaveIn) {
    for (axis, mut image) in inputs.iter_mut().zip(image.chunks_exact(length(mapped))) {
        *axis = AxisIn::default();
        for Mapped { bytes, word, .. } in mapped {
            let number;
            (number, image) = take(image, *bytes);
            match word {
                InWord::Statusword => axis.statusword = Statusword(number as u16),
                InWord::Position => axis.position = number as i32,
                InWord::Torque => axis.torque = number as i16,
                InWord::ErrorCode => axis.error_code = number as u16,
                InWord::Inputs => axis.inputs = number as u16,
            }
        }
    }
}

/// Writes a number of 2 or 4 bytes to the beginning of an image, and returns the rest of the image.
#[inline(always)]
fn put(image: &mut [u8], bytes: usize, number: u32) -> &mut [u8] {
    let (here, rest) = image.split_at_mut(bytes);
    match here {
        [a, b] => [*a, *b] = (number as u16).to_le_bytes(),
        here => here.copy_from_slice(&number.to_le_bytes()),
    }
    rest
}

/// Reads a number of 2 or 4 bytes from the beginning of an image, and returns it with the rest of the image.
#[inline(always)]
fn take(image: &[u8], bytes: usize) -> (u32, &[u8]) {
    let (here, rest) = image.split_at(bytes);
    let number = match *here {
        [a, b, c, d] => u32::from_le_bytes([a, b, c, d]),
        [a, b] => u16::from_le_bytes([a, b]).into(),
        _ => 0,
    };
    (number, rest)
}

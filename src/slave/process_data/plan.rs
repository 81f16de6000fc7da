//! The plan of a device's process data: the list of the copies between a process image and the device's objects, made from the
//! PDO mapping and carried out in each cycle.
//!
//! In an image the mapped entries follow each other without gaps other than padding, the lowest bit first; the image is
//! extended to a whole byte (ETG.1000.6 5.6.7.4.7).

use std::fmt;

use super::mapping::{Mapping, Mover};
use crate::ethercat::AlStatus;
use crate::ethercat::coe::{AbortCode, ObjectAddress};
use crate::slave::device::Model;
use crate::slave::dictionary::{Device, Object, PdoDirection, Place, find, number, take_output};

/// The maximum number of mapped objects per direction, in all PDOs together \[OURS].
pub const MAPPED_MAX: usize = 32;

/// How a cycle copies one object between the process image and the device.
#[derive(Clone, Copy, Debug)]
pub(in crate::slave) struct EntryCopy {
    /// The row of the object in the dictionary's table, and its cell among the stored values, see [`Place`].
    row: u16,
    cell: u16,
    /// The position of the object in the image, bits.
    bit: u16,
    /// The length of the object, bits.
    bits: u8,
}

/// One step of a plan: what it copies.
enum Step<D> {
    Object(EntryCopy),
    /// A manufacturer-specific object. It has no row in the dictionary's table, so `row` and `cell` hold the upper and the
    /// lower 16 bits of its index in [`ManufacturerObjects`](crate::slave::ManufacturerObjects) instead.
    Manufacturer(EntryCopy),
    /// A whole PDO that begins at this byte of the image. Its entries are the same as in a power-on PDO or in a PDO of
    /// [`Model::often_mapped`], for which one function copies the whole PDO.
    Inputs(usize, fn(&D, &mut [u8])),
    Outputs(usize, fn(&mut D, &[u8])),
}

// Written by hand, because a derived implementation would require `D: Copy`.
impl<D> Clone for Step<D> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<D> Copy for Step<D> {}

/// The compiled PDO mapping: the steps that copy the process data of a cycle. Only compiling a mapping allocates.
pub(in crate::slave) struct Plan<D> {
    /// The steps that copy the inputs, followed by those that copy the outputs.
    steps: Vec<Step<D>>,
    /// The number of steps for the inputs.
    inputs: usize,
    input_bytes: usize,
    output_bytes: usize,
    /// Whether some bits of the input image belong to no object. They have to be 0, so the image is cleared first.
    has_padding: bool,
    /// If all inputs are a single PDO that one function copies, that function; the same for all outputs. Otherwise
    /// `None`.
    all_inputs: Option<fn(&D, &mut [u8])>,
    all_outputs: Option<fn(&mut D, &[u8])>,
}

impl<D> Clone for Plan<D> {
    fn clone(&self) -> Self {
        let mut steps = Vec::with_capacity(2 * MAPPED_MAX);
        steps.extend_from_slice(&self.steps);
        Self { steps, ..*self }
    }
}

impl<D> fmt::Debug for Plan<D> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Plan").field("steps", &self.steps.len()).field("lengths", &self.lengths()).finish()
    }
}

impl<D> Default for Plan<D> {
    fn default() -> Self {
        Self {
            steps: Vec::new(),
            inputs: 0,
            input_bytes: 0,
            output_bytes: 0,
            has_padding: false,
            all_inputs: None,
            all_outputs: None,
        }
    }
}

/// What a mapping entry maps into the image.
enum Entry {
    Padding,
    Object(Place),
    /// The index of a manufacturer-specific object in [`ManufacturerObjects`](crate::slave::ManufacturerObjects).
    Manufacturer(usize),
}

/// Finds what a mapping entry in a PDO of this direction maps.
///
/// # Errors
/// [`AbortCode::NO_OBJECT`] or [`AbortCode::NO_SUB_INDEX`] if the object does not exist; [`AbortCode::NOT_MAPPABLE`] if it
/// cannot be mapped in this direction, or if the entry has another length than the object (CiA 301 7.4.9.4).
fn entry<D: Model>(device: &D, direction: PdoDirection, entry: u32) -> Result<Entry, AbortCode> {
    let (at, bits) = parts(entry);
    if bits == 0 {
        return Err(AbortCode::NOT_MAPPABLE);
    }
    if at.index == 0 && at.sub == 0 {
        return Ok(Entry::Padding);
    }
    let place = match (find(device, at), &device.base().manufacturer) {
        (Ok(place), _) => place,
        (Err(code), Some(objects)) => return objects.mapped(at, direction, bits, code).map(Entry::Manufacturer),
        (Err(code), None) => return Err(code),
    };
    let object = &<D as Model>::objects()[place.row];
    let fits = object.pdo() == Some(direction) && object.data_type().bits() == bits;
    if fits { Ok(Entry::Object(place)) } else { Err(AbortCode::NOT_MAPPABLE) }
}

/// The object address in a mapping entry, and the length of the entry in bits.
const fn parts(entry: u32) -> (ObjectAddress, u8) {
    let [bits, sub, low, high] = entry.to_le_bytes();
    (ObjectAddress::new(u16::from_le_bytes([low, high]), sub), bits)
}

/// Checks whether a mapping entry is allowed in a PDO of this direction.
///
/// # Errors
/// As [`entry`]: the object does not exist, cannot be mapped in this direction, or has another length.
pub(in crate::slave) fn may_map<D: Model>(device: &D, direction: PdoDirection, wanted: u32) -> Result<(), AbortCode> {
    entry(device, direction, wanted).map(|_| ())
}

impl<D> Plan<D> {
    /// An empty plan with capacity for the steps of any mapping.
    pub(in crate::slave) fn with_room() -> Self {
        Self { steps: Vec::with_capacity(2 * MAPPED_MAX), ..Self::default() }
    }

    /// The lengths of the output image and of the input image, bytes.
    pub(in crate::slave) const fn lengths(&self) -> (u16, u16) {
        (self.output_bytes as u16, self.input_bytes as u16)
    }
}

impl<D: Model> Plan<D> {
    /// Compiles a mapping into this plan.
    ///
    /// # Errors
    /// [`AlStatus::INVALID_INPUT_MAPPING`], [`AlStatus::INVALID_OUTPUT_MAPPING`]: an entry cannot be mapped, or the mapping
    /// exceeds the limits of the device or [`MAPPED_MAX`]. The plan is empty then.
    pub(in crate::slave) fn compile(&mut self, device: &D, mapping: &Mapping) -> Result<(), AlStatus> {
        let mut steps = std::mem::take(&mut self.steps);
        steps.clear();
        *self = Self { steps, ..Self::default() };
        let compiled = self.compile_both(device, mapping);
        if compiled.is_err() {
            self.steps.clear();
            (self.inputs, self.input_bytes, self.output_bytes) = (0, 0, 0);
        }
        compiled
    }

    fn compile_both(&mut self, device: &D, mapping: &Mapping) -> Result<(), AlStatus> {
        let inputs = self.add(device, PdoDirection::Tx, mapping).ok_or(AlStatus::INVALID_INPUT_MAPPING)?;
        self.inputs = self.steps.len();
        self.has_padding = inputs.bits % 8 != 0 || inputs.padding;
        let outputs = self.add(device, PdoDirection::Rx, mapping).ok_or(AlStatus::INVALID_OUTPUT_MAPPING)?;
        (self.input_bytes, self.output_bytes) = (inputs.bits.div_ceil(8), outputs.bits.div_ceil(8));
        if let [Step::Inputs(0, put)] = self.steps[..self.inputs] {
            self.all_inputs = Some(put);
        }
        if let [Step::Outputs(0, take)] = self.steps[self.inputs..] {
            self.all_outputs = Some(take);
        }
        Ok(())
    }

    /// Adds the steps of one direction. Returns the size of that direction's image, with its padding; `None` if the mapping is
    /// invalid.
    fn add(&mut self, device: &D, direction: PdoDirection, mapping: &Mapping) -> Option<Image> {
        let mut image = Image::default();
        for (index, entries) in mapping.assigned(direction) {
            let (first, begin) = (self.steps.len(), image.bits);
            for wanted in entries {
                let (_, bits) = parts(*wanted);
                match entry(device, direction, *wanted).ok()? {
                    Entry::Padding => image.padding = true,
                    Entry::Object(Place { row, cell }) => {
                        image.objects += 1;
                        let (row, cell, bit) = (row as u16, cell as u16, image.bits as u16);
                        self.steps.push(Step::Object(EntryCopy { row, cell, bit, bits }));
                    }
                    Entry::Manufacturer(place) => {
                        image.objects += 1;
                        let (row, cell, bit) = ((place >> 16) as u16, place as u16, image.bits as u16);
                        self.steps.push(Step::Manufacturer(EntryCopy { row, cell, bit, bits }));
                    }
                }
                image.bits += usize::from(bits);
                if image.objects > MAPPED_MAX || image.bits > mapping.limits().image_bytes * 8 {
                    return None;
                }
            }
            if let Some(whole) = whole_pdo(index, entries, begin) {
                self.steps.truncate(first);
                self.steps.push(whole);
            }
        }
        Some(image)
    }
}

/// A single step for a whole PDO, if the PDO has the same entries as a power-on PDO or as a PDO in
/// [`Model::often_mapped`]. The PDO has to begin at a byte boundary, because the function of the step copies whole
/// bytes. Otherwise `None`.
fn whole_pdo<D: Model>(index: u16, entries: &[u32], bit: usize) -> Option<Step<D>> {
    let of_power_on = D::pdos().iter().find(|pdo| pdo.index == index && pdo.entries == entries);
    let pdo = of_power_on.or_else(|| D::often_mapped().iter().find(|pdo| pdo.entries == entries))?;
    let step = match pdo.mover {
        Mover::Inputs(put) => Step::Inputs(bit / 8, put),
        Mover::Outputs(take) => Step::Outputs(bit / 8, take),
    };
    bit.is_multiple_of(8).then_some(step)
}

/// The size of one direction's image while its plan is compiled.
#[derive(Default)]
struct Image {
    bits: usize,
    objects: usize,
    padding: bool,
}

/// Copies the inputs of the device into an image. An image that is shorter than the mapped inputs is left unchanged.
#[inline]
pub(in crate::slave) fn put_inputs<D: Model>(device: &D, image: &mut [u8]) {
    let plan = &device.base().plan;
    if image.len() < plan.input_bytes {
        return;
    }
    match plan.all_inputs {
        Some(put) => put(device, image),
        None => put_each_input(device, image),
    }
}

#[inline(never)]
fn put_each_input<D: Model>(device: &D, image: &mut [u8]) {
    let plan = &device.base().plan;
    if plan.has_padding {
        image[..plan.input_bytes].fill(0);
    }
    for step in &plan.steps[..plan.inputs] {
        match *step {
            Step::Inputs(at, put) => put(device, &mut image[at..]),
            Step::Object(step) => put_object(device, step, image),
            Step::Manufacturer(step) => {
                let bits =
                    device.base().manufacturer.as_ref().map_or(0, |objects| objects.bits(place_of_manufacturer(step)));
                put(image, step, bits);
            }
            Step::Outputs(..) => {}
        }
    }
}

/// Copies the outputs in an image to the device. An image that is shorter than the mapped outputs is ignored.
#[inline]
pub(in crate::slave) fn take_outputs<D: Model>(device: &mut D, image: &[u8]) {
    let plan = &device.base().plan;
    if image.len() < plan.output_bytes {
        return;
    }
    match plan.all_outputs {
        Some(take) => take(device, image),
        None => take_each_output(device, image),
    }
}

#[inline(never)]
fn take_each_output<D: Model>(device: &mut D, image: &[u8]) {
    let plan = &device.base().plan;
    for n in plan.inputs..plan.steps.len() {
        match device.base().plan.steps[n] {
            Step::Outputs(at, take) => take(device, &image[at..]),
            Step::Object(step) => take_object(device, step, image),
            Step::Manufacturer(step) => {
                let bits = take(image, step);
                if let Some(objects) = &mut device.base_mut().manufacturer {
                    objects.take_bits(place_of_manufacturer(step), bits);
                }
            }
            Step::Inputs(..) => {}
        }
    }
}

/// The [`EntryCopy`] for a mapping entry of whole bytes that begins at `bit` of its image, evaluated at compile time.
///
/// # Panics
/// If there is no such object, or the entry has another length than the object. In a constant this is a compile-time error.
pub(in crate::slave) const fn fixed<D>(objects: &[Object<D>], entry: u32, bit: u32) -> EntryCopy {
    let (at, bits) = parts(entry);
    let (mut row, mut cell) = (0, 0);
    while !objects[row].has(at) {
        cell += objects[row].count() as u16;
        row += 1;
    }
    cell += (at.sub - objects[row].address().sub) as u16;
    assert!(objects[row].data_type().bits() == bits && bits % 8 == 0, "the entry has not the object's length");
    EntryCopy { row: row as u16, cell, bit: bit as u16, bits }
}

/// Defines a power-on RxPDO: `rx_pdo!(OBJECTS, 0x1600, true, [0x6040_0010, 0x607A_0020])`, where `true` means that the PDO is
/// assigned. Its [`Mover`] is straight-line code, because the compiler knows the objects.
macro_rules! rx_pdo {
    ($objects:expr, $index:literal, $assigned:literal, [$($entry:literal),*]) => {
        $crate::slave::process_data::Pdo {
            index: $index,
            entries: &[$($entry),*],
            assigned: $assigned,
            mover: $crate::slave::process_data::Mover::Outputs(|device, image| {
                let Some(image) = image.get(..(0 $(+ ($entry & 0xFF))*) / 8) else { return };
                $crate::slave::process_data::each_entry!(take_object, device, image, $objects, 0, $($entry)*);
            }),
        }
    };
}

/// Defines a power-on TxPDO, with the same arguments as `rx_pdo!`.
macro_rules! tx_pdo {
    ($objects:expr, $index:literal, $assigned:literal, [$($entry:literal),*]) => {
        $crate::slave::process_data::Pdo {
            index: $index,
            entries: &[$($entry),*],
            assigned: $assigned,
            mover: $crate::slave::process_data::Mover::Inputs(|device, image| {
                let Some(image) = image.get_mut(..(0 $(+ ($entry & 0xFF))*) / 8) else { return };
                $crate::slave::process_data::each_entry!(put_object, device, image, $objects, 0, $($entry)*);
            }),
        }
    };
}

/// Expands to one call of `put_object` or `take_object` per mapping entry, with the bit position of the entry in the image.
macro_rules! each_entry {
    ($move:ident, $device:ident, $image:ident, $objects:expr, $bit:expr,) => {};
    ($move:ident, $device:ident, $image:ident, $objects:expr, $bit:expr, $entry:literal $($rest:literal)*) => {
        let step = const { $crate::slave::process_data::fixed($objects, $entry, $bit) };
        $crate::slave::process_data::$move($device, step, $image);
        $crate::slave::process_data::each_entry!(
            $move, $device, $image, $objects, $bit + ($entry & 0xFF), $($rest)*
        );
    };
}

pub(in crate::slave) use {each_entry, rx_pdo, tx_pdo};

#[inline(always)]
pub(in crate::slave) fn put_object<D: Device>(device: &D, step: EntryCopy, image: &mut [u8]) {
    let object = &D::objects()[usize::from(step.row)];
    put(image, step, number(device, object, step.cell.into()) as u64);
}

#[inline(always)]
pub(in crate::slave) fn take_object<D: Device>(device: &mut D, step: EntryCopy, image: &[u8]) {
    let object = &D::objects()[usize::from(step.row)];
    let number = object.data_type().decode(take(image, step));
    take_output(device, object, step.cell.into(), number);
}

/// The index in [`ManufacturerObjects`](crate::slave::ManufacturerObjects) of the object that a step copies.
fn place_of_manufacturer(EntryCopy { row, cell, .. }: EntryCopy) -> usize {
    usize::from(row) << 16 | usize::from(cell)
}

/// Writes the low bits of a number to the position of an entry in an image.
#[inline(always)]
fn put(image: &mut [u8], EntryCopy { bit, bits, .. }: EntryCopy, number: u64) {
    let at = usize::from(bit / 8);
    match (bit % 8, bits) {
        (0, 16) => image[at..at + 2].copy_from_slice(&(number as u16).to_le_bytes()),
        (0, 32) => image[at..at + 4].copy_from_slice(&(number as u32).to_le_bytes()),
        _ => put_bits(image, bit.into(), bits, number),
    }
}

fn put_bits(image: &mut [u8], bit: usize, bits: u8, number: u64) {
    for n in 0..usize::from(bits) {
        let (byte, mask) = place_of(bit + n);
        let is_set = number >> n & 1 != 0;
        image[byte] = if is_set { image[byte] | mask } else { image[byte] & !mask };
    }
}

/// Reads the bits of an entry from an image, as a number.
#[inline(always)]
fn take(image: &[u8], EntryCopy { bit, bits, .. }: EntryCopy) -> u64 {
    let at = usize::from(bit / 8);
    match (bit % 8, bits) {
        (0, 16) => u16::from_le_bytes([image[at], image[at + 1]]).into(),
        (0, 32) => u32::from_le_bytes([image[at], image[at + 1], image[at + 2], image[at + 3]]).into(),
        _ => take_bits(image, bit.into(), bits),
    }
}

fn take_bits(image: &[u8], bit: usize, bits: u8) -> u64 {
    (0..usize::from(bits)).fold(0, |number, n| {
        let (byte, mask) = place_of(bit + n);
        number | u64::from(image[byte] & mask != 0) << n
    })
}

const fn place_of(bit: usize) -> (usize, u8) {
    (bit / 8, 1 << (bit % 8))
}

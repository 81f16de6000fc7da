//! The exported functions for machine files: axes with their names, units and limits, inputs and outputs with their names, the
//! link. They read a file and change nothing.

use std::ffi::c_char;
use std::path::Path;
use std::sync::Arc;

use ecmsk::ecm::Ecm;
use ecmsk::link::LinkError;
use ecmsk::machine_file::{IoLine, MachineAxis, MachineFile};

use crate::buffer::{TextBuffer, Versioned, copy_out, put, text_from};
use crate::error::CallError;
use crate::exported::boards::{EcmskResult, code};
use crate::exported::entry::entry;
use crate::handles::{Handles, OF_MACHINES};
use crate::memory;

/// A handle of an open machine file. It is not an address: a handle that was closed or made up gives `ECMSK_ERROR_HANDLE`.
pub struct EcmskMachine {
    _private: [u8; 0],
}

/// An axis of a machine file. `size` is used as in `ecmsk_stats`. The limits can be compared as they are: one that the file
/// does not give is infinite, or the end of the 32 bits of a position.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct EcmskAxis {
    /// The size of this structure in bytes.
    pub size: u32,
    /// The number of the slave that moves the axis, 1 to 40. It is the number of the axis and of the slot of its commands, too.
    pub slave: u32,
    /// The number of counts in one unit; not 0. It is negative if the unit counts in the opposite direction.
    pub counts_per_unit: f64,
    /// The lowest position that a target may have, in units: the nearest count. Without a limit it is -INFINITY.
    pub min_units: f64,
    /// The highest position that a target may have, in units: the nearest count. Without a limit it is INFINITY.
    pub max_units: f64,
    /// The highest speed of a move, in units per second. Without a limit it is INFINITY.
    pub max_velocity: f64,
    /// The highest acceleration of a move, in units per second squared. Without a limit it is INFINITY.
    pub max_acceleration: f64,
    /// The lowest target in counts. Without a limit it is INT32_MIN. It is the end `max_units` if `counts_per_unit` is negative.
    pub min_counts: i32,
    /// The highest target in counts. Without a limit it is INT32_MAX. It is the end `min_units` if `counts_per_unit` is negative.
    pub max_counts: i32,
}

// SAFETY: declared as u32, u32, then f64, and two i32 at the end. `size` is set where a value is made.
unsafe impl Versioned for EcmskAxis {}

impl From<&MachineAxis> for EcmskAxis {
    fn from(axis: &MachineAxis) -> Self {
        let limits = axis.limits;
        let ends = [(limits.min, i32::MIN), (limits.max, i32::MAX)];
        let [low, high] = ends.map(|(counts, none)| (counts != none).then(|| axis.scale.to_units(counts) + 0.0));
        let (min, max) = if axis.scale.counts_per_unit < 0.0 { (high, low) } else { (low, high) };
        Self {
            size: size_of::<Self>() as u32,
            slave: axis.slave.into(),
            counts_per_unit: axis.scale.counts_per_unit,
            min_units: min.unwrap_or(f64::NEG_INFINITY),
            max_units: max.unwrap_or(f64::INFINITY),
            max_velocity: axis.max_velocity.unwrap_or(f64::INFINITY),
            max_acceleration: axis.max_acceleration.unwrap_or(f64::INFINITY),
            min_counts: limits.min,
            max_counts: limits.max,
        }
    }
}

/// A machine file that a program has opened.
struct OpenMachine {
    file: MachineFile,
    /// The URI of its board, as `ecmsk_machine_get_link` has it. It is made when the file is opened, for a program that changes its
    /// working directory later.
    link: Result<String, LinkError>,
}

impl OpenMachine {
    fn load(path: &str) -> Result<Self, Box<CallError>> {
        let file = MachineFile::load(Path::new(path)).map_err(CallError::Machine)?;
        let link = Ecm::machine_link(&file, None).map(|link| link.map_or_else(String::new, |link| link.to_string()));
        Ok(Self { file, link })
    }

    fn axis(&self, index: u32) -> Result<&MachineAxis, Box<CallError>> {
        let axes = &self.file.axes;
        axes.get(index as usize).ok_or_else(|| {
            let last = axes.len().checked_sub(1);
            let there = last.map_or_else(|| "none".to_owned(), |last| format!("those with the indexes 0 to {last}"));
            self.has_no(format!("axis with the index {index}"), there)
        })
    }

    /// The error for what the file does not have.
    fn has_no(&self, what: String, there: String) -> Box<CallError> {
        CallError::NotInMachine { file: self.file.path.display().to_string(), what, there }.into()
    }

    /// The error for an axis, an input or an output that the file does not have. The file has those with these names.
    fn has_no_name<'a>(&self, kind: &str, name: &str, names: impl Iterator<Item = &'a str>) -> Box<CallError> {
        let names: Vec<&str> = names.collect();
        let there = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
        self.has_no(format!("{kind} `{}`", name.escape_debug()), there)
    }
}

/// The machine files that `ecmsk_machine_open` has opened, by handle.
static MACHINES: Handles<OpenMachine> = Handles::new(OF_MACHINES);

fn find(handle: usize) -> Result<Arc<OpenMachine>, Box<CallError>> {
    MACHINES.get(handle).ok_or_else(|| CallError::MachineHandle { handle }.into())
}

/// Reads the machine file at the path `file`, such as `machine.toml`, and checks all of it. Writes its handle to `*machine`,
/// or NULL if the call fails. The result is `ECMSK_ERROR_IO` if the file cannot be read, and `ECMSK_ERROR_ARGUMENT` if it is
/// wrong; the error text then has the line, the field and what to do. The file is read in this call alone, and no board is
/// opened.
///
/// # Safety
/// `file` is NULL or a text in UTF-8 that ends with 0. `machine` is NULL or points to room for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecmsk_machine_open(file: *const c_char, machine: *mut *mut EcmskMachine) -> EcmskResult {
    if !machine.is_null() {
        // As in `ecmsk_open`, before anything else.
        // SAFETY: not NULL, and the caller vouches for room; nothing is read from it.
        unsafe { machine.write(std::ptr::null_mut()) };
    }
    code(entry!(ecmsk_machine_open(), {
        if machine.is_null() {
            return Err(CallError::Null { argument: "machine", expected: "a pointer for the handle" }.into());
        }
        // SAFETY: the caller's promise for `file`; the text is not kept.
        let file = unsafe { text_from(file, "file") }?;
        memory::check(memory::OPEN_BYTES)?;
        let handle = MACHINES.insert(Arc::new(OpenMachine::load(file)?));
        // SAFETY: `machine` is not NULL, and the caller vouches for room for a pointer.
        unsafe { machine.write(std::ptr::without_provenance_mut(handle)) };
        Ok(handle)
    }))
}

/// Closes a machine file. The handle is invalid afterwards. A board that was opened with its link stays open.
///
/// # Safety
/// None: any value may be passed.
#[unsafe(no_mangle)]
pub extern "C" fn ecmsk_machine_close(machine: *mut EcmskMachine) -> EcmskResult {
    let handle = machine.addr();
    code(entry!(ecmsk_machine_close(handle), {
        MACHINES.remove(handle).map(|_| ()).ok_or_else(|| CallError::MachineHandle { handle }.into())
    }))
}

/// Copies the URI of the machine's board, for `ecmsk_open`, to the `length` bytes at `buffer`, as `ecmsk_get_link_name` does.
/// It is the link of the environment variable `ECMSK_LINK`, which `ecmsk exec` sets, otherwise that of the file. With the key
/// `axes=` a target beyond the soft limits is reported in the log, and not sent if the file says so. A simulated board has
/// the slaves of the file. If neither names a link the text is empty. If `ECMSK_LINK` is no URI of a link the result is
/// `ECMSK_ERROR_ARGUMENT`.
///
/// # Safety
/// As for `ecmsk_get_link_name`. `machine` may be any value.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecmsk_machine_get_link(
    machine: *mut EcmskMachine,
    buffer: *mut c_char,
    length: usize,
    needed: *mut usize,
) -> EcmskResult {
    let handle = machine.addr();
    code(entry!(ecmsk_machine_get_link(handle, length), {
        // SAFETY: the caller's promise for `buffer` and `needed`.
        let buffer = unsafe { TextBuffer::new(buffer, length, needed) }?;
        let machine = find(handle)?;
        buffer.fill(machine.link.as_ref().map_err(LinkError::clone)?);
        Ok(())
    }))
}

/// Writes the number of axes to `*count`. Their indexes are 0 to the number minus 1, in the order of their slaves.
///
/// # Safety
/// `count` is NULL or points to room for a `uint32_t`. `machine` may be any value.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecmsk_machine_get_axis_count(machine: *mut EcmskMachine, count: *mut u32) -> EcmskResult {
    let handle = machine.addr();
    code(entry!(ecmsk_machine_get_axis_count(handle), {
        // SAFETY: the caller's promise for `count`.
        unsafe { put(find(handle)?.file.axes.len() as u32, count, "count") }
    }))
}

/// Writes the index of the axis with this name to `*index`. Upper and lower case are the same. Without such an axis the
/// result is `ECMSK_ERROR_ARGUMENT`.
///
/// # Safety
/// `name` is NULL or a text in UTF-8 that ends with 0. `index` is NULL or points to room for a `uint32_t`. `machine` may be
/// any value.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecmsk_machine_find_axis(
    machine: *mut EcmskMachine,
    name: *const c_char,
    index: *mut u32,
) -> EcmskResult {
    let handle = machine.addr();
    code(entry!(ecmsk_machine_find_axis(handle), {
        // SAFETY: the caller's promise for `name`; the text is not kept.
        let name = unsafe { text_from(name, "name") }?;
        let machine = find(handle)?;
        let axes = &machine.file.axes;
        let found = machine.file.axis(name).and_then(|axis| axes.iter().position(|other| other.slave == axis.slave));
        let found = found.ok_or_else(|| machine.has_no_name("axis", name, axes.iter().map(|axis| &*axis.name)))?;
        // SAFETY: the caller's promise for `index`.
        unsafe { put(found as u32, index, "index") }
    }))
}

/// Gets the axis with this index. Its name and its unit are `ecmsk_machine_get_axis_name` and `ecmsk_machine_get_axis_unit`.
///
/// # Safety
/// `axis` is NULL or points to `axis->size` writable bytes. `machine` may be any value.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecmsk_machine_get_axis(
    machine: *mut EcmskMachine,
    index: u32,
    axis: *mut EcmskAxis,
) -> EcmskResult {
    let handle = machine.addr();
    code(entry!(ecmsk_machine_get_axis(handle, index), {
        let value = EcmskAxis::from(find(handle)?.axis(index)?);
        // SAFETY: the caller's promise for `axis`.
        unsafe { copy_out(value, axis, "axis") }
    }))
}

/// Copies the name of an axis to the `length` bytes at `buffer`, as `ecmsk_get_link_name` does. A name has at most 32
/// characters, which are 128 bytes of UTF-8, and the terminating 0.
///
/// # Safety
/// As for `ecmsk_get_link_name`. `machine` may be any value.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecmsk_machine_get_axis_name(
    machine: *mut EcmskMachine,
    index: u32,
    buffer: *mut c_char,
    length: usize,
    needed: *mut usize,
) -> EcmskResult {
    let handle = machine.addr();
    code(entry!(ecmsk_machine_get_axis_name(handle, index, length), {
        // SAFETY: the caller's promise for `buffer` and `needed`.
        let buffer = unsafe { TextBuffer::new(buffer, length, needed) }?;
        buffer.fill(&find(handle)?.axis(index)?.name);
        Ok(())
    }))
}

/// Copies the unit of an axis to the `length` bytes at `buffer`, as `ecmsk_get_link_name` does: `mm`, `um`, `m`, `in`, `deg`,
/// `rad`, `turn` or `counts`.
///
/// # Safety
/// As for `ecmsk_get_link_name`. `machine` may be any value.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecmsk_machine_get_axis_unit(
    machine: *mut EcmskMachine,
    index: u32,
    buffer: *mut c_char,
    length: usize,
    needed: *mut usize,
) -> EcmskResult {
    let handle = machine.addr();
    code(entry!(ecmsk_machine_get_axis_unit(handle, index, length), {
        // SAFETY: the caller's promise for `buffer` and `needed`.
        let buffer = unsafe { TextBuffer::new(buffer, length, needed) }?;
        buffer.fill(find(handle)?.axis(index)?.unit.word());
        Ok(())
    }))
}

/// Converts a position of an axis in units to the nearest count and writes that to `*counts`. What is beyond the 64 bits
/// becomes their end. A target of the board has 32 bits: compare with `min_counts` and `max_counts` of the axis before. The
/// result is `ECMSK_ERROR_ARGUMENT` if `units` is NaN.
///
/// # Safety
/// `counts` is NULL or points to room for an `int64_t`. `machine` may be any value.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecmsk_machine_to_counts(
    machine: *mut EcmskMachine,
    index: u32,
    units: f64,
    counts: *mut i64,
) -> EcmskResult {
    let handle = machine.addr();
    code(entry!(ecmsk_machine_to_counts(handle, index, units), {
        if units.is_nan() {
            return Err(CallError::NotANumber { argument: "units" }.into());
        }
        let exact = units * find(handle)?.axis(index)?.scale.counts_per_unit;
        // The conversion `as` saturates.
        // SAFETY: the caller's promise for `counts`.
        unsafe { put(exact.round() as i64, counts, "counts") }
    }))
}

/// Converts a position of an axis in counts to units and writes that to `*units`, a finite number.
///
/// # Safety
/// `units` is NULL or points to room for a `double`. `machine` may be any value.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecmsk_machine_to_units(
    machine: *mut EcmskMachine,
    index: u32,
    counts: i64,
    units: *mut f64,
) -> EcmskResult {
    let handle = machine.addr();
    code(entry!(ecmsk_machine_to_units(handle, index, counts), {
        // The sum makes 0 of the -0 that a unit in the opposite direction has.
        let found = counts as f64 / find(handle)?.axis(index)?.scale.counts_per_unit + 0.0;
        // SAFETY: the caller's promise for `units`.
        unsafe { put(found.clamp(-f64::MAX, f64::MAX), units, "units") }
    }))
}

/// Writes the slave, from 1, and the bit, from 0, of the input with this name to `*slave` and `*bit`. Upper and lower case
/// are the same. Without such an input the result is `ECMSK_ERROR_ARGUMENT`.
///
/// # Safety
/// `name` is NULL or a text in UTF-8 that ends with 0. `slave` and `bit` are NULL or point to room for a `uint32_t`.
/// `machine` may be any value.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecmsk_machine_find_input(
    machine: *mut EcmskMachine,
    name: *const c_char,
    slave: *mut u32,
    bit: *mut u32,
) -> EcmskResult {
    let handle = machine.addr();
    code(entry!(ecmsk_machine_find_input(handle), {
        // SAFETY: the caller's promises for `name`, `slave` and `bit`.
        unsafe { find_line(handle, "input", MachineFile::input, |file| &file.inputs, name, slave, bit) }
    }))
}

/// Writes the slave, from 1, and the bit, from 0, of the output with this name to `*slave` and `*bit`, as
/// `ecmsk_machine_find_input` does.
///
/// # Safety
/// As for `ecmsk_machine_find_input`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecmsk_machine_find_output(
    machine: *mut EcmskMachine,
    name: *const c_char,
    slave: *mut u32,
    bit: *mut u32,
) -> EcmskResult {
    let handle = machine.addr();
    code(entry!(ecmsk_machine_find_output(handle), {
        // SAFETY: the caller's promises for `name`, `slave` and `bit`.
        unsafe { find_line(handle, "output", MachineFile::output, |file| &file.outputs, name, slave, bit) }
    }))
}

/// Writes slave and bit of an input or output with this name to the caller's memory. `of_name` finds it among `all`.
///
/// # Safety
/// `name` is NULL or a text in UTF-8 that ends with 0. `slave` and `bit` are NULL or point to room for a `u32`.
unsafe fn find_line(
    handle: usize,
    kind: &str,
    of_name: for<'a> fn(&'a MachineFile, &str) -> Option<&'a IoLine>,
    all: fn(&MachineFile) -> &[IoLine],
    name: *const c_char,
    slave: *mut u32,
    bit: *mut u32,
) -> Result<(), Box<CallError>> {
    // SAFETY: the caller's promise; the text is not kept.
    let name = unsafe { text_from(name, "name") }?;
    let machine = find(handle)?;
    let line = of_name(&machine.file, name)
        .ok_or_else(|| machine.has_no_name(kind, name, all(&machine.file).iter().map(|line| &*line.name)))?;
    // SAFETY: the caller's promise.
    unsafe {
        // If one of the two is NULL, nothing is written to the other one.
        if !slave.is_null() {
            put(line.bit.into(), bit, "bit")?;
        }
        put(line.slave.into(), slave, "slave")
    }
}

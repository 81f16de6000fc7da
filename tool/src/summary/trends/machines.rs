//! Manages the machine files of the recordings: each recording is evaluated in the units of the machine file that it
//! contains.

use std::path::Path;
use std::rc::Rc;
use std::sync::Arc;

use ecmsk::machine_file::{MachineAxis, MachineFile, MachineFileError, Unit};
use ecmsk::recording::CarriedFile;

use crate::machine_option;

/// The machine files of the recordings that were read so far.
pub struct Machines<'a> {
    /// The path of `--machine`, which applies to all recordings.
    given: Option<&'a Path>,
    /// The machine file of the option or of the working directory. It is loaded when a recording needs it first.
    loaded: Option<Option<Rc<MachineFile>>>,
    /// The machine file that was parsed last, with its text from the recording. It is kept because all segments of a
    /// flight recorder contain the same file.
    parsed: Option<(Arc<CarriedFile>, Option<Rc<MachineFile>>)>,
    /// The machine file of the last recording; `None` if no recording was read yet.
    last: Option<Option<Rc<MachineFile>>>,
    /// Whether two recordings have axes in different units.
    differ: bool,
}

impl<'a> Machines<'a> {
    /// Starts without recordings. `given`: the path of `--machine`.
    ///
    /// # Errors
    /// The file of the option cannot be read or is invalid.
    pub fn new(given: Option<&'a Path>) -> Result<Self, MachineFileError> {
        let mut machines = Self { given, loaded: None, parsed: None, last: None, differ: false };
        if given.is_some() {
            machines.load()?;
        }
        Ok(machines)
    }

    /// The machine file for the next recording: that of the option, else the one in the recording (`carried`), else the
    /// one in the working directory.
    ///
    /// # Errors
    /// The file in the working directory cannot be read or is invalid.
    pub fn of(&mut self, carried: Option<Arc<CarriedFile>>) -> Result<Option<Rc<MachineFile>>, MachineFileError> {
        let machine = match carried.filter(|_| self.given.is_none()) {
            None => self.load()?,
            Some(carried) => match &self.parsed {
                Some((parsed, machine)) if *parsed == carried => machine.clone(),
                _ => {
                    let machine = machine_option::of_recording(None, Some(&carried))?.map(Rc::new);
                    self.parsed = Some((carried, machine.clone()));
                    machine
                }
            },
        };
        let is_other = self.last.as_ref().is_some_and(|last| !units(last.as_deref()).eq(units(machine.as_deref())));
        self.differ |= is_other;
        self.last = Some(machine.clone());
        Ok(machine)
    }

    /// The machine file for the tables of all recordings: that of the last recording. `None` if there is no machine
    /// file, or if the recordings have different units, so that only counts can be compared.
    pub fn common(&self) -> Option<&MachineFile> {
        self.last.as_ref().filter(|_| !self.differ)?.as_deref()
    }

    /// Whether two recordings have axes in different units.
    pub const fn differ(&self) -> bool {
        self.differ
    }

    fn load(&mut self) -> Result<Option<Rc<MachineFile>>, MachineFileError> {
        if self.loaded.is_none() {
            self.loaded = Some(machine_option::load(self.given)?.map(Rc::new));
        }
        Ok(self.loaded.clone().flatten())
    }
}

/// For each axis: the number of its slave, its unit, and its counts per unit.
fn units(machine: Option<&MachineFile>) -> impl Iterator<Item = (u8, Unit, f64)> {
    let unit = |axis: &MachineAxis| (axis.slave, axis.unit, axis.scale.counts_per_unit);
    machine.map(|machine| &*machine.axes).unwrap_or_default().iter().map(unit)
}

//! The machine files of the recordings: each recording is judged in the units of the file that it carries.

use std::path::Path;
use std::rc::Rc;
use std::sync::Arc;

use ecmsk::machine_file::{MachineAxis, MachineFile, MachineFileError, Unit};
use ecmsk::recording::CarriedFile;

use crate::machine_option;

/// The machine files of the recordings that were read so far.
pub struct Machines<'a> {
    /// The file of the option, which counts for all recordings.
    given: Option<&'a Path>,
    /// The file of the option or of the working directory, once a recording needed it.
    loaded: Option<Option<Rc<MachineFile>>>,
    /// The carried file that was parsed last: segments of a flight recorder carry the same one.
    parsed: Option<(Arc<CarriedFile>, Option<Rc<MachineFile>>)>,
    /// The file of the last recording; `None`: no recording was read.
    last: Option<Option<Rc<MachineFile>>>,
    /// Whether two recordings have axes in different units.
    differ: bool,
}

impl<'a> Machines<'a> {
    /// Starts without recordings. `given`: the file of the option.
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

    /// The file for the next recording: that of the option, otherwise the one that the recording carries, otherwise the one in
    /// the working directory.
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

    /// The file for the tables, in which all recordings stand: the newest one. `None`: there is none, or the recordings have
    /// different units, so that only counts can be compared.
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

/// The unit of each axis, and how many counts it has.
fn units(machine: Option<&MachineFile>) -> impl Iterator<Item = (u8, Unit, f64)> {
    let unit = |axis: &MachineAxis| (axis.slave, axis.unit, axis.scale.counts_per_unit);
    machine.map(|machine| &*machine.axes).unwrap_or_default().iter().map(unit)
}

//! Manufacturer-specific objects of simulated slaves, read from the file named in a link: `slaves=drive:objects@FILE`.

use std::path::Path;

use crate::address::slaves::{ManufacturerObjectsSpec, SlaveSpec};
use crate::files::read_small;
pub use crate::link::machine_error::ManufacturerObjectsError;
use crate::slave::{MANUFACTURER_FILE_BYTES_MAX, ManufacturerObjects};

/// Reads a file of manufacturer-specific objects.
///
/// # Errors
/// [`ManufacturerObjectsError`] if the file cannot be read or a line is invalid.
pub fn load(file: &Path) -> Result<ManufacturerObjects, ManufacturerObjectsError> {
    let text = read_text(file, MANUFACTURER_FILE_BYTES_MAX)?;
    ManufacturerObjects::parse(&text).map_err(|error| wrong(file, error))
}

/// Reads a regular file of UTF-8 text of at most `size_max` bytes.
///
/// # Errors
/// [`ManufacturerObjectsError`] if the file cannot be read, is too large or is not UTF-8.
pub fn read_text(file: &Path, size_max: u64) -> Result<String, ManufacturerObjectsError> {
    let bytes = read_bytes(file, size_max)?;
    String::from_utf8(bytes).map_err(|_| wrong(file, "it is no text in UTF-8; save it as UTF-8"))
}

/// Reads a regular file of at most `size_max` bytes.
///
/// # Errors
/// [`ManufacturerObjectsError`] if the file cannot be read, is too large or is not a regular file.
pub fn read_bytes(file: &Path, size_max: u64) -> Result<Vec<u8>, ManufacturerObjectsError> {
    Ok(read_small(file, size_max).map_err(|error| wrong(file, error))?.bytes)
}

fn wrong(file: &Path, message: impl ToString) -> ManufacturerObjectsError {
    ManufacturerObjectsError { file: file.display().to_string(), message: message.to_string() }
}

/// The manufacturer-specific objects of each slave in network order; `None` for a slave without any. A file that several slaves
/// name is read once. Logs which slaves have such objects, because a real slave may lack them.
pub(crate) fn of_slaves(slaves: &[SlaveSpec]) -> Result<Vec<Option<ManufacturerObjects>>, ManufacturerObjectsError> {
    let mut read: Vec<(&str, ManufacturerObjects)> = Vec::new();
    let mut of_slaves = Vec::with_capacity(slaves.len());
    for (slave, spec) in (1..).zip(slaves) {
        of_slaves.push(match &spec.manufacturer_objects {
            None => None,
            Some(ManufacturerObjectsSpec::Any) => {
                log::info!(
                    "slave {slave} has objects@any: it stores what it is told in 0x2000..0x5FFF and 0x6000..0x9FFF, \
                     where a real drive may answer with an abort code"
                );
                Some(ManufacturerObjects::any())
            }
            Some(ManufacturerObjectsSpec::File(file)) => {
                let known = read.iter().find(|(name, _)| *name == &**file).map(|(_, objects)| objects.clone());
                let objects = match known {
                    Some(objects) => objects,
                    None => {
                        let objects = load(Path::new(&**file))?;
                        read.push((file, objects.clone()));
                        objects
                    }
                };
                let count = objects.objects().len();
                log::info!("slave {slave} has {count} objects of {file}: they store values and have no effect");
                Some(objects)
            }
        });
    }
    Ok(of_slaves)
}

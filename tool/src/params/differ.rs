//! `params diff`: compares a file with a drive, or with another file.

use std::path::Path;

use ecmsk::slave::{ManufacturerObject, ManufacturerObjects};
use serde_json::json;

use super::file::{Device, ParameterFile};
use super::place::{Opened, Place, progress};
use super::restore::{self, Compared, Difference};
use super::show::{answer_shown, object_json, put_answer, shown, summarise};
use super::{Other, ParamsError};
use crate::board::{AxisWord, Reporter};
use crate::hex::hex;

const VERB: &str = "params diff";

/// Compares a file with a drive or another file, and prints the differences. Returns whether there are any.
///
/// # Errors
/// A file cannot be read, the link does not open, or the drive does not answer.
pub fn diff(path: &Path, with: &Other, place: &Place) -> Result<bool, ParamsError> {
    let file = ParameterFile::read(path)?;
    let drive_of = |word: &AxisWord| {
        let (mut opened, slave) = place.open_for(word)?;
        drive(&mut opened, slave, &file)
    };
    match with {
        Other::Slave(word) => drive_of(word),
        Other::File(other) => match axis(other, place)? {
            Some(word) => drive_of(&word),
            None => {
                let reporter = Reporter::new(place.json, false);
                Ok(files(&reporter, &file.objects, &ParameterFile::read(other)?.objects)?)
            }
        },
    }
}

/// The axis that `word` names, if it is no file and the machine file has an axis with that name. `word` may name a file
/// or an axis.
fn axis(word: &Path, place: &Place) -> Result<Option<AxisWord>, ParamsError> {
    let name = word.to_str().filter(|_| !word.exists()).and_then(AxisWord::parse).filter(AxisWord::is_name);
    name.map_or(Ok(None), |name| Ok(place.has_axis(&name)?.then_some(name)))
}

/// Prints the parameters in which a drive differs from a file. Returns whether there are any.
///
/// # Errors
/// The drive does not answer, or standard output cannot be written to.
pub fn drive(opened: &mut Opened, slave: u8, file: &ParameterFile) -> Result<bool, ParamsError> {
    let compared = compare_with(opened, slave, file, true)?;
    for Difference { wanted, present } in &compared.different {
        let (from, to) = (shown(wanted, wanted.value.bytes()), answer_shown(wanted, present));
        let text = format!("{:<10}  file {from} | drive {to}  {}", wanted.address.to_string(), wanted.name);
        let mut json = object_json(VERB, slave, wanted);
        json["file"] = hex(wanted.value.bytes()).into();
        put_answer(&mut json, "drive", present);
        opened.reporter.result(text.trim_end(), &json)?;
    }
    summarise(opened, VERB, slave, &compared)?;
    Ok(!compared.different.is_empty())
}

/// Prints the objects in which two files differ. Returns whether there are any.
fn files(reporter: &Reporter, first: &ManufacturerObjects, second: &ManufacturerObjects) -> std::io::Result<bool> {
    let find = |objects: &ManufacturerObjects, wanted: &ManufacturerObject| {
        objects.objects().iter().find(|object| object.address == wanted.address).cloned()
    };
    let only_second = second.objects().iter().filter(|object| find(first, object).is_none());
    let pairs = first.objects().iter().map(|object| (Some(object.clone()), find(second, object)));
    let mut pairs: Vec<_> = pairs.chain(only_second.map(|object| (None, Some(object.clone())))).collect();
    pairs.sort_by_key(|(first, second)| first.as_ref().or(second.as_ref()).map(|object| object.address));
    let mut differ = false;
    for (first, second) in pairs {
        let value = |object: &Option<ManufacturerObject>| object.as_ref().map(|object| object.value.clone());
        if value(&first) == value(&second) {
            continue;
        }
        differ = true;
        let Some(object) = first.as_ref().or(second.as_ref()) else { continue };
        let side = |of: &Option<ManufacturerObject>| {
            of.as_ref().map_or_else(|| "-".to_owned(), |of| shown(of, of.value.bytes()))
        };
        let [first_value, second_value] = [side(&first), side(&second)];
        let text =
            format!("{:<10}  file {first_value} | other {second_value}  {}", object.address.to_string(), object.name);
        let bytes = |of: &Option<ManufacturerObject>| of.as_ref().map(|of| hex(of.value.bytes()));
        let json = json!({
            "verb": VERB, "index": object.address.index, "sub": object.address.sub, "name": object.name,
            "file": bytes(&first), "other": bytes(&second),
        });
        reporter.result(text.trim_end(), &json)?;
    }
    Ok(differ)
}

/// Compares a drive with a file. `is_allowed`: whether the file may be of another product than the drive. If it may
/// not, a file of another product is an error.
///
/// # Errors
/// [`ParamsError::OtherProduct`], or the drive does not answer.
pub fn compare_with(
    opened: &mut Opened,
    slave: u8,
    file: &ParameterFile,
    is_allowed: bool,
) -> Result<Compared, ParamsError> {
    let reporter = Reporter::new(false, false);
    let mut at = progress(&reporter, slave);
    let drive = opened.drive(slave)?;
    let found = drive.device()?;
    let same = file.device.as_ref().is_some_and(|device| device.is_same_product(&found));
    let note = other_device(file.device.as_ref(), &found);
    if !same && !is_allowed {
        return Err(ParamsError::OtherProduct { what: note.unwrap_or_default() });
    }
    let compared = restore::compare(drive, file.objects.objects(), &mut at)?;
    reporter.clear();
    if let Some(note) = note {
        opened.reporter.note(note);
    }
    if file.not_kept > 0 {
        let count = super::show::parameters(file.not_kept);
        opened
            .reporter
            .note(format_args!("the file does not have {count} of the drive that it was read from; it names them"));
    }
    Ok(compared)
}

/// The difference between the device that the file names and the drive that was found, as text; `None` if they agree.
fn other_device(of_file: Option<&Device>, found: &Device) -> Option<String> {
    let Some(device) = of_file else {
        return Some(format!("the file does not say of which device it is; the drive is {found}"));
    };
    if !device.is_same_product(found) {
        return Some(format!("the file is of {device}, the drive is {found}"));
    }
    let firmware = [device.firmware(), found.firmware()];
    if device.revision != found.revision {
        return Some(format!(
            "the file is of revision 0x{:08X}, the drive has 0x{:08X}: their parameters may differ",
            device.revision, found.revision
        ));
    }
    let differs = firmware[0] != firmware[1] && firmware.iter().all(|version| !version.is_empty());
    differs.then(|| {
        format!("the file is of firmware {}, the drive has {}: their parameters may differ", firmware[0], firmware[1])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_of_another_product_or_version_is_named() {
        let device = |product, revision, firmware: &str| Device {
            vendor: 1,
            product,
            revision,
            serial: 1,
            texts: [String::new(), String::new(), firmware.to_owned()],
        };
        let said = |file: Option<Device>, found: Device| other_device(file.as_ref(), &found).unwrap_or_default();
        assert_eq!(said(Some(device(2, 3, "1.0")), device(2, 3, "")), "");
        assert!(said(Some(device(2, 3, "1.0")), device(2, 3, "1.1")).contains("firmware 1.0, the drive has 1.1"));
        assert!(
            said(Some(device(2, 3, "")), device(2, 4, "")).contains("revision 0x00000003, the drive has 0x00000004")
        );
        assert!(said(Some(device(2, 3, "")), device(5, 3, "")).contains("product 0x00000002, the drive is vendor"));
        assert!(said(None, device(2, 3, "")).contains("does not say of which device"));
    }
}

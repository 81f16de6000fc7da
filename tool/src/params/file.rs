//! A parameter file: a list of objects in the format of `ecmsk objects`. Comments at its top identify the drive from
//! which it was read.

use std::fmt::{self, Write as _};
use std::path::Path;

use ecmsk::coe::ObjectAddress;
use ecmsk::link::manufacturer_objects;
use ecmsk::slave::{MANUFACTURER_FILE_BYTES_MAX, ManufacturerObjects};

use super::ParamsError;
use super::kept::Kept;

/// The identity of the drive from which parameters were read: the numbers of object 0x1018, and the texts 0x1008 to
/// 0x100A.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Device {
    pub vendor: u32,
    pub product: u32,
    pub revision: u32,
    pub serial: u32,
    /// Name, hardware version and software version, if the device has them.
    pub texts: [String; 3],
}

/// The identity object. Its sub-indexes 1 to 4 are vendor, product, revision and serial number.
pub const IDENTITY: u16 = 0x1018;
/// For each entry of [`Device::texts`]: its key in the comments of a parameter file, and the object from which it is
/// read.
pub const TEXTS: [(&str, ObjectAddress); 3] = [
    ("device", ObjectAddress::new(0x1008, 0)),
    ("hardware", ObjectAddress::new(0x1009, 0)),
    ("firmware", ObjectAddress::new(0x100A, 0)),
];

/// The beginning of the comment for a parameter that the backup has left out.
const NOT_KEPT: &str = "# not kept: ";

impl Device {
    /// The numbers of the identity, each with its key in the comments of a parameter file.
    const fn numbers(&self) -> [(&'static str, u32); 4] {
        [("vendor", self.vendor), ("product", self.product), ("revision", self.revision), ("serial", self.serial)]
    }

    /// Whether parameters of one device may be written to the other: both have the same vendor and product.
    pub const fn is_same_product(&self, other: &Self) -> bool {
        self.vendor == other.vendor && self.product == other.product
    }

    /// The software version of the drive (0x100A); other versions may have other parameters. Empty if it is unknown.
    pub fn firmware(&self) -> &str {
        &self.texts[2]
    }
}

impl fmt::Display for Device {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [name, ..] = &self.texts;
        write!(f, "vendor 0x{:08X} product 0x{:08X}", self.vendor, self.product)?;
        if name.is_empty() { Ok(()) } else { write!(f, " ({name})") }
    }
}

/// The content of a parameter file: the identity of the drive, and the objects.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ParameterFile {
    /// The drive from which the parameters were read; `None` if the file does not name it, such as a file of `ecmsk
    /// objects`.
    pub device: Option<Device>,
    pub objects: ManufacturerObjects,
    /// The number of parameters that the backup has left out, according to the comments of the file.
    pub not_kept: usize,
}

impl ParameterFile {
    /// Reads a parameter file, or any other list of objects.
    ///
    /// # Errors
    /// [`ParamsError::File`] if the file cannot be read. [`ParamsError::Content`] if it is not UTF-8, has an invalid line,
    /// or lists no object.
    pub fn read(path: &Path) -> Result<Self, ParamsError> {
        let bytes = manufacturer_objects::read_bytes(path, MANUFACTURER_FILE_BYTES_MAX)?;
        let wrong = |reason: String| ParamsError::Content { file: path.to_owned(), reason };
        let text = String::from_utf8(bytes).map_err(|_| wrong("it is not a text in UTF-8".to_owned()))?;
        let objects = ManufacturerObjects::parse(&text).map_err(|error| wrong(error.to_string()))?;
        if objects.objects().is_empty() {
            return Err(wrong("it has no object".to_owned()));
        }
        let not_kept = text.lines().filter(|line| line.starts_with(NOT_KEPT)).count();
        Ok(Self { device: device(&text), objects, not_kept })
    }

    /// Makes the text of a parameter file. `source` is the slave and its link, `time` the time of reading.
    pub fn text(device: &Device, kept: &Kept, source: &str, time: &str) -> String {
        let line = |text: &str| text.replace(|c: char| c.is_control(), " ");
        let mut text = format!("# parameters of {}, read {time}\n#", line(source));
        // Writing to a String does not fail.
        for (word, number) in device.numbers() {
            let _ = write!(text, " {word} 0x{number:08X}");
        }
        text.push('\n');
        for ((word, _), value) in TEXTS.iter().zip(&device.texts).filter(|(_, value)| !value.is_empty()) {
            let _ = writeln!(text, "# {word}: {}", line(value));
        }
        text += "# a line is INDEX:SUB TYPE ACCESS VALUE NAME; `ecmsk params restore` writes the values back\n";
        for left in &kept.left_out {
            let _ = writeln!(text, "{NOT_KEPT}{}: {}", line(left.to_string().trim()), left.why);
        }
        for object in &kept.objects {
            let _ = writeln!(text, "{object}");
        }
        text
    }
}

/// The identity of the drive from the comments of a parameter file; `None` if there is none.
fn device(text: &str) -> Option<Device> {
    let comments = || text.lines().filter_map(|line| line.trim_start_matches('\u{FEFF}').strip_prefix("# "));
    let words: Vec<&str> = comments().find(|line| line.starts_with("vendor "))?.split_whitespace().collect();
    let number = |word: &str| {
        let at = words.iter().position(|other| *other == word)?;
        u32::from_str_radix(words.get(at + 1)?.strip_prefix("0x")?, 16).ok()
    };
    let text = |word: &str| {
        let found = comments().find_map(|line| line.strip_prefix(word)?.strip_prefix(": "));
        found.unwrap_or_default().trim().to_owned()
    };
    Some(Device {
        vendor: number("vendor")?,
        product: number("product")?,
        revision: number("revision")?,
        serial: number("serial")?,
        texts: TEXTS.map(|(word, _)| text(word)),
    })
}

#[cfg(test)]
mod tests {
    use super::super::kept::{LeftOut, Why};
    use super::*;

    fn a_device() -> Device {
        Device {
            vendor: 0x66F,
            product: 0x6038_0004,
            revision: 0x1_0000,
            serial: 7,
            texts: ["MADLN05BE".to_owned(), String::new(), "V1.10".to_owned()],
        }
    }

    /// A written file is read back with the same device and objects, and a simulated drive can load it.
    #[test]
    fn a_file_is_read_as_it_was_written() {
        let objects =
            ManufacturerObjects::parse("0x2000:0 u16 rw 0x10 Gain\n0x3000:1 text rw \"a\\x00\" Name\n").unwrap();
        let left_out = LeftOut { address: ObjectAddress::new(0x2001, 0), name: "Long".to_owned(), why: Why::Text };
        let kept = Kept { objects: objects.objects().to_vec(), left_out: vec![left_out] };
        let text = ParameterFile::text(&a_device(), &kept, "slave 1 of nic:eth1", "2026-11-28T10:00:00Z");
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.params");
        std::fs::write(&file, &text).unwrap();
        let read = ParameterFile::read(&file).unwrap();
        assert_eq!(read, ParameterFile { device: Some(a_device()), objects, not_kept: 1 });
        assert!(
            text.starts_with("# parameters of slave 1 of nic:eth1, read 2026-11-28T10:00:00Z\n# vendor 0x0000066F "),
            "{text}"
        );
        assert!(text.contains("\n# not kept: 0x2001:0 Long: a board transfers no texts\n"), "{text}");
    }

    #[test]
    fn a_file_without_a_device_or_without_objects() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a");
        std::fs::write(&file, "# vendor 0x1 product ten\n0x2000:0 u8 rw 1\n").unwrap();
        assert_eq!(ParameterFile::read(&file).unwrap().device, None);
        for (content, said) in [(&b"# nothing\n"[..], "no object"), (b"0x2000 u8\n", "line 1"), (b"\xFF\n", "UTF-8")] {
            std::fs::write(&file, content).unwrap();
            let error = ParameterFile::read(&file).unwrap_err().to_string();
            assert!(error.contains(said), "{error}");
        }
    }
}

//! A gadget in configfs, as a list of steps that make folders, write small texts and make links, in the order that the
//! kernel requires.

use std::fs;
use std::io;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

/// The folder with all gadgets of this machine.
pub const CONFIGFS: &str = "/sys/kernel/config/usb_gadget";

/// The language of the device's texts (manufacturer, product, serial number): English (United States).
const LANGUAGE: &str = "0x409";
/// The folder of the gadget's only configuration. The number in its name is bConfigurationValue.
const CONFIGURATION: &str = "c.1";
/// bcdUSB of the device: USB 2.0.
const USB_VERSION: u16 = 0x0200;
/// File and text that limit a faster controller to high speed, since the function has descriptors for high speed only.
/// Kernels before 5.11 do not have this file.
const MAX_SPEED: (&str, &str) = ("max_speed", "high-speed");

/// The values of a gadget in its device descriptor, strings and configuration descriptor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeviceIds {
    /// idVendor of the device descriptor.
    pub vendor: u16,
    /// idProduct of the device descriptor.
    pub product: u16,
    /// bcdDevice of the device descriptor: the release number of the device.
    pub release: u16,
    /// bmAttributes of the configuration.
    pub attributes: u8,
    /// The largest current from the bus, in mA.
    pub power_ma: u16,
    /// The texts of iManufacturer, iProduct and iSerialNumber, in this order.
    pub texts: [String; 3],
}

/// One change in configfs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Step {
    /// Makes a folder; the kernel puts files into it.
    Make(PathBuf),
    /// Writes a text into a file that the kernel has made.
    Write(PathBuf, String),
    /// Like [`Step::Write`], but does nothing if the file does not exist, as with older kernels.
    WriteIfThere(PathBuf, String),
    /// Makes a symbolic link. The first path is its target, the second one is the link.
    Link(PathBuf, PathBuf),
    /// Removes a link.
    RemoveLink(PathBuf),
    /// Removes a folder; the kernel removes its files.
    Remove(PathBuf),
}

/// A step of setting up the gadget that the kernel refused.
#[derive(Debug, thiserror::Error)]
#[error("cannot {what} {}: {source}", path.display())]
pub struct StepError {
    /// The action, such as `make`.
    pub what: &'static str,
    /// The file or folder.
    pub path: PathBuf,
    /// The kernel's error.
    pub source: io::Error,
}

impl Step {
    /// Carries out the step.
    ///
    /// # Errors
    /// [`StepError`]: the kernel has refused the step.
    pub fn apply(&self) -> Result<(), StepError> {
        let (what, path, done) = match self {
            Self::Make(path) => ("make", path, fs::create_dir(path)),
            Self::Write(path, text) => ("write to", path, write(path, text)),
            Self::WriteIfThere(path, text) => {
                ("write to", path, if path.exists() { write(path, text) } else { Ok(()) })
            }
            Self::Link(target, path) => ("make the link", path, symlink(target, path)),
            Self::RemoveLink(path) => ("remove the link", path, fs::remove_file(path)),
            Self::Remove(path) => ("remove", path, fs::remove_dir(path)),
        };
        done.map_err(|source| StepError { what, path: path.clone(), source })
    }
}

/// Writes a text into a file that the kernel has made, by one call: the kernel takes each call as a whole value. Fails
/// if the file does not exist.
fn write(path: &Path, text: &str) -> io::Result<()> {
    use std::io::Write;

    let mut file = fs::OpenOptions::new().write(true).open(path)?;
    let written = file.write(text.as_bytes())?;
    if written == text.len() { Ok(()) } else { Err(io::ErrorKind::WriteZero.into()) }
}

/// The steps that make the gadget in the folder `gadget`, with a FunctionFS function of the name `function`. They do
/// not bind the gadget to a controller.
pub fn steps(gadget: &Path, function: &str, ids: &DeviceIds) -> Vec<Step> {
    let number = |file: &str, value: u16| Step::Write(gadget.join(file), format!("{value:#06x}"));
    let configuration = gadget.join("configs").join(CONFIGURATION);
    let function = format!("ffs.{function}");
    let mut steps = vec![
        Step::Make(gadget.to_owned()),
        number("idVendor", ids.vendor),
        number("idProduct", ids.product),
        number("bcdDevice", ids.release),
        number("bcdUSB", USB_VERSION),
        Step::WriteIfThere(gadget.join(MAX_SPEED.0), MAX_SPEED.1.to_owned()),
    ];
    if ids.texts.iter().any(|text| !text.is_empty()) {
        let texts = gadget.join("strings").join(LANGUAGE);
        steps.push(Step::Make(texts.clone()));
        for (file, text) in ["manufacturer", "product", "serialnumber"].into_iter().zip(&ids.texts) {
            // An empty text is written as a line feed: the kernel ignores a write without bytes, and removes one line
            // feed at the end. It has to be written, because the kernel's list of texts ends at the first one that was
            // never written.
            let text = if text.is_empty() { "\n" } else { text };
            steps.push(Step::Write(texts.join(file), text.to_owned()));
        }
    }
    steps.extend([
        Step::Make(configuration.clone()),
        Step::Write(configuration.join("bmAttributes"), format!("{:#04x}", ids.attributes)),
        Step::Write(configuration.join("MaxPower"), ids.power_ma.to_string()),
        Step::Make(gadget.join("functions").join(&function)),
        Step::Link(gadget.join("functions").join(&function), configuration.join(&function)),
    ]);
    steps
}

/// The steps that remove the gadget in the folder `gadget` with all that the folder contains. The gadget must not be
/// bound to a controller.
pub fn removal(gadget: &Path) -> Vec<Step> {
    let below = |folder: &Path, is_link: bool| {
        let entries = fs::read_dir(folder).into_iter().flatten().flatten();
        let kind = |entry: &fs::DirEntry| {
            entry.file_type().is_ok_and(|kind| if is_link { kind.is_symlink() } else { kind.is_dir() })
        };
        let mut paths: Vec<PathBuf> = entries.filter(kind).map(|entry| entry.path()).collect();
        paths.sort();
        paths
    };
    let mut steps = Vec::new();
    for configuration in below(&gadget.join("configs"), false) {
        steps.extend(below(&configuration, true).into_iter().map(Step::RemoveLink));
        steps.extend(below(&configuration.join("strings"), false).into_iter().map(Step::Remove));
        steps.push(Step::Remove(configuration));
    }
    for folder in ["functions", "strings"] {
        steps.extend(below(&gadget.join(folder), false).into_iter().map(Step::Remove));
    }
    steps.push(Step::Remove(gadget.to_owned()));
    steps
}

/// A gadget that this process has made. It is removed when this value is dropped.
#[derive(Debug)]
pub struct Gadget {
    folder: PathBuf,
}

impl Gadget {
    /// Makes the gadget `name` below the folder `gadgets`. If a gadget of this name exists already, it is removed
    /// first. The caller makes sure, by a [`Claim`](super::Claim), that it is the leftover of a process that has ended.
    ///
    /// # Errors
    /// [`StepError`]; nothing is left of the new gadget then.
    pub fn make(gadgets: &Path, name: &str, ids: &DeviceIds) -> Result<Self, StepError> {
        let folder = gadgets.join(name);
        if folder.exists() {
            unbind(&folder);
            removal(&folder).iter().try_for_each(Step::apply)?;
        }
        let gadget = Self { folder };
        steps(&gadget.folder, name, ids).iter().try_for_each(Step::apply)?;
        Ok(gadget)
    }

    /// Binds the gadget to a controller: from now on a host at the controller's port sees the device.
    ///
    /// # Errors
    /// [`StepError`]: EBUSY if another gadget has the controller.
    pub fn bind(&self, controller: &str) -> Result<(), StepError> {
        Step::Write(self.folder.join("UDC"), controller.to_owned()).apply()
    }

    /// Unbinds the gadget from its controller. For a host this looks as if the device was unplugged.
    pub fn unbind(&self) {
        unbind(&self.folder);
    }
}

impl Drop for Gadget {
    fn drop(&mut self) {
        self.unbind();
        for step in removal(&self.folder) {
            // An error is ignored: anything that cannot be removed now is a leftover, which the next run removes.
            let _ = step.apply();
        }
    }
}

/// Unbinds a gadget from its controller. The kernel's error is ignored: it means that the gadget has no controller.
fn unbind(gadget: &Path) {
    let _ = write(&gadget.join("UDC"), "\n");
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ids() -> DeviceIds {
        DeviceIds {
            vendor: 0x16C0,
            product: 0x05DF,
            release: 0x0100,
            attributes: 0x80,
            power_ma: 500,
            texts: ["ecmsk".into(), String::new(), "7".into()],
        }
    }

    fn write_to(path: &str, text: &str) -> Step {
        Step::Write(path.into(), text.to_owned())
    }

    /// SK-9.1 The steps, in the order of gadget_configfs.rst.
    #[test]
    fn a_gadget_is_a_list_of_steps() {
        let expected = [
            Step::Make("/g/e".into()),
            write_to("/g/e/idVendor", "0x16c0"),
            write_to("/g/e/idProduct", "0x05df"),
            write_to("/g/e/bcdDevice", "0x0100"),
            write_to("/g/e/bcdUSB", "0x0200"),
            Step::WriteIfThere("/g/e/max_speed".into(), "high-speed".into()),
            Step::Make("/g/e/strings/0x409".into()),
            write_to("/g/e/strings/0x409/manufacturer", "ecmsk"),
            write_to("/g/e/strings/0x409/product", "\n"),
            write_to("/g/e/strings/0x409/serialnumber", "7"),
            Step::Make("/g/e/configs/c.1".into()),
            write_to("/g/e/configs/c.1/bmAttributes", "0x80"),
            write_to("/g/e/configs/c.1/MaxPower", "500"),
            Step::Make("/g/e/functions/ffs.e".into()),
            Step::Link("/g/e/functions/ffs.e".into(), "/g/e/configs/c.1/ffs.e".into()),
        ];
        assert_eq!(steps(Path::new("/g/e"), "e", &ids()), expected);
        let nameless = DeviceIds { texts: Default::default(), ..ids() };
        let steps = steps(Path::new("/g/e"), "e", &nameless);
        assert!(!steps.contains(&Step::Make("/g/e/strings/0x409".into())), "without texts there is no language");
    }

    /// The files that the kernel creates in a new folder of configfs.
    fn as_the_kernel(gadget: &Path) {
        for folder in ["configs", "functions", "strings"] {
            fs::create_dir_all(gadget.join(folder)).expect("a folder");
        }
        for file in ["idVendor", "idProduct", "bcdDevice", "bcdUSB", "UDC"] {
            fs::write(gadget.join(file), "").expect("a file");
        }
    }

    /// The steps make the folders, files and links that they name. If a file does not exist, the step fails with the
    /// path of the file, unless the file is optional.
    #[test]
    fn steps_are_carried_out() {
        let folder = tempfile::tempdir().expect("a folder");
        let gadget = folder.path().join("e");
        for step in steps(&gadget, "e", &ids()) {
            if let Step::Write(path, _) = &step
                && !path.exists()
            {
                let error = step.apply().expect_err("nobody has made the file");
                assert!(error.to_string().contains(&format!("cannot write to {}", path.display())), "{error}");
                fs::write(path, "").expect("a file");
            }
            step.apply().expect("it can be done");
            if step == Step::Make(gadget.clone()) {
                as_the_kernel(&gadget);
            }
        }
        let says = |file: &str| fs::read_to_string(gadget.join(file)).expect("it was written");
        assert_eq!((says("idVendor"), says("strings/0x409/serialnumber")), ("0x16c0".into(), "7".into()));
        assert!(!gadget.join("max_speed").exists());
        let link = fs::read_link(gadget.join("configs/c.1/ffs.e")).expect("a link");
        assert_eq!(link, gadget.join("functions/ffs.e"));
    }

    /// A leftover is removed from the inside out: first its links, at last its own folder. Folders that do not exist
    /// are skipped.
    #[test]
    fn a_leftover_is_removed_in_order() {
        let folder = tempfile::tempdir().expect("a folder");
        let gadget = folder.path().join("e");
        assert_eq!(removal(&gadget), [Step::Remove(gadget.clone())]);
        for below in ["configs/c.1/strings/0x409", "functions/ffs.e", "strings/0x409"] {
            fs::create_dir_all(gadget.join(below)).expect("a folder");
        }
        symlink(gadget.join("functions/ffs.e"), gadget.join("configs/c.1/ffs.e")).expect("a link");
        let steps = removal(&gadget);
        let remove = |below: &str| Step::Remove(gadget.join(below));
        let expected = [
            Step::RemoveLink(gadget.join("configs/c.1/ffs.e")),
            remove("configs/c.1/strings/0x409"),
            remove("configs/c.1"),
            remove("functions/ffs.e"),
            remove("strings/0x409"),
            Step::Remove(gadget.clone()),
        ];
        assert_eq!(steps, expected);
        // The kernel removes the folders that it has made together with their parent folder.
        for step in &steps {
            for own in ["configs/c.1/strings", "configs", "functions", "strings"] {
                let _ = fs::remove_dir(gadget.join(own));
            }
            step.apply().expect("what it contains is gone");
        }
        assert!(!gadget.exists());
    }
}

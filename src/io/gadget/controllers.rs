//! The USB device controllers of this machine (UDC), and the claim of one program of this project on one of them.

use std::fs;
use std::io;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixListener};
use std::path::{Path, PathBuf};

/// Where the kernel lists the controllers.
pub const UDC_CLASS: &str = "/sys/class/udc";

/// Why no device controller can be used.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the message of a variant explains its fields")]
pub enum ControllerError {
    /// The machine has no USB device controller.
    #[error(
        "this machine has no USB device controller ({} lists none); on a Raspberry Pi write dtoverlay=dwc2,dr_mode=peripheral into \
         config.txt and start it again; for a trial without a cable `sudo modprobe dummy_hcd`",
        class.display()
    )]
    None { class: PathBuf },
    /// The machine has no USB device controller with the name that was given.
    #[error("there is no USB device controller {wanted}; there is: {}; name one with --udc", there.join(", "))]
    Unknown { wanted: String, there: Vec<String> },
    /// The machine has several USB device controllers, and no name was given.
    #[error("this machine has several USB device controllers; name one with --udc: {}", there.join(", "))]
    Several { there: Vec<String> },
    /// Another process of this project uses the controller.
    #[error("the USB device controller {name} is served by another program of ecmsk; end that one first")]
    InUse { name: String },
    /// The system did not provide the socket that stands for the claim.
    #[error("cannot claim the USB device controller {name}: {source}; free some files, then start it again")]
    System { name: String, source: io::Error },
}

/// The name of the controller to use: `wanted`, or the only controller of the machine. `class`: the folder in which the
/// kernel lists the controllers ([`UDC_CLASS`]).
///
/// # Errors
/// [`ControllerError::None`], [`ControllerError::Unknown`] if there is no controller of that name,
/// [`ControllerError::Several`] if no name was given.
pub fn choose(class: &Path, wanted: Option<&str>) -> Result<String, ControllerError> {
    let entries = fs::read_dir(class).into_iter().flatten().flatten();
    let mut there: Vec<String> = entries.filter_map(|entry| entry.file_name().into_string().ok()).collect();
    there.sort();
    if there.is_empty() {
        return Err(ControllerError::None { class: class.to_owned() });
    }
    match wanted {
        Some(wanted) if there.iter().any(|name| name == wanted) => Ok(wanted.to_owned()),
        Some(wanted) => Err(ControllerError::Unknown { wanted: wanted.to_owned(), there }),
        None if there.len() == 1 => Ok(there.swap_remove(0)),
        None => Err(ControllerError::Several { there }),
    }
}

/// A claim on a controller, held until it is dropped or the process ends. While the process holds it, no other process
/// of this project has a gadget for that controller, so a gadget that already exists in configfs is a leftover.
pub struct Claim {
    _listener: UnixListener,
}

impl Claim {
    /// Claims a controller.
    ///
    /// # Errors
    /// [`ControllerError::InUse`] if another claim exists; [`ControllerError::System`] if the system refuses the
    /// socket.
    pub fn new(controller: &str) -> Result<Self, ControllerError> {
        let name = || controller.to_owned();
        let address = SocketAddr::from_abstract_name(format!("ecmsk/udc/{controller}"));
        match address.and_then(|address| UnixListener::bind_addr(&address)) {
            Ok(listener) => Ok(Self { _listener: listener }),
            Err(source) if source.kind() == io::ErrorKind::AddrInUse => Err(ControllerError::InUse { name: name() }),
            Err(source) => Err(ControllerError::System { name: name(), source }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn class(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("a folder");
        for name in names {
            fs::create_dir(folder.path().join(name)).expect("a folder below it");
        }
        folder
    }

    /// If there is only one controller, no name is needed. If there are several, a name is needed, and the error text
    /// lists the controllers.
    #[test]
    fn a_controller_is_chosen() {
        let choose = |names: &[&str], wanted| choose(class(names).path(), wanted);
        assert_eq!(choose(&["fe980000.usb"], None).expect("the only one"), "fe980000.usb");
        assert_eq!(choose(&["b", "a"], Some("b")).expect("it is there"), "b");
        let several = choose(&["b", "a"], None).expect_err("which one?").to_string();
        assert!(several.ends_with("--udc: a, b"), "{several}");
        let unknown = choose(&["b", "a"], Some("c")).expect_err("there is none").to_string();
        assert!(unknown.contains("controller c; there is: a, b; "), "{unknown}");
        for wanted in [None, Some("a")] {
            let none = choose(&[], wanted).expect_err("there is none").to_string();
            assert!(none.contains("dr_mode=peripheral") && none.contains("modprobe dummy_hcd"), "{none}");
        }
        assert!(matches!(super::choose(Path::new("/nowhere"), None), Err(ControllerError::None { .. })));
    }

    #[test]
    fn a_controller_is_claimed_once() {
        let first = Claim::new("no_such_udc.7").expect("it is free");
        let refused = Claim::new("no_such_udc.7").err().expect("it is in use").to_string();
        assert!(refused.contains("another program of ecmsk"), "{refused}");
        drop(first);
        assert!(Claim::new("no_such_udc.7").is_ok());
    }
}

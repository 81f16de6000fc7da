//! SPI devices that a program may use: spidev.

use super::{Access, Machine};

/// The SPI devices.
const CLASS: &str = "/sys/class/spidev";
/// The kernel's module.
const MODULE: &str = "/sys/module/spidev";

/// Bytes of the longest frame: one exchange moves it whole (SK-10).
pub const FRAME_LEN: i64 = 512;

/// An SPI device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SpiDevice {
    /// `/dev/spidev0.0`.
    pub file: String,
    /// Whether this user may open it.
    pub access: Access,
}

impl SpiDevice {
    /// The link that opens it.
    pub fn link(&self) -> String {
        format!("spi:{}", self.file)
    }
}

/// The longest exchange that the kernel's module allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bufsiz {
    /// Bytes.
    pub bytes: i64,
    /// The module is a part of the kernel, and takes its parameters from the kernel's command line.
    pub is_built_in: bool,
}

impl Machine {
    /// All SPI devices.
    pub fn spi_devices(&self) -> Vec<SpiDevice> {
        let names = self.names(CLASS).into_iter().filter(|name| is_device(name));
        let files = names.map(|name| format!("/dev/{name}"));
        files.map(|file| SpiDevice { access: self.access(&file), file }).collect()
    }

    /// `None`: there is no such module, or it does not say.
    pub fn bufsiz(&self) -> Option<Bufsiz> {
        let bytes = self.number(&format!("{MODULE}/parameters/bufsiz"))?;
        // Modules alone have a state of their loading.
        Some(Bufsiz { bytes, is_built_in: !self.has(&format!("{MODULE}/initstate")) })
    }
}

/// `spidev0.0`.
fn is_device(name: &str) -> bool {
    let numbers = name.strip_prefix("spidev").and_then(|rest| rest.split_once('.'));
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    numbers.is_some_and(|(bus, select)| is_number(bus) && is_number(select))
}

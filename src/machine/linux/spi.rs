//! SPI devices that programs can open: those of the kernel's driver spidev.

use super::{Access, Machine};

/// The folder of all spidev devices.
const CLASS: &str = "/sys/class/spidev";
/// The folder of the kernel module spidev.
const MODULE: &str = "/sys/module/spidev";

/// The length of the longest frame in bytes, which the board needs in one exchange (SK-10).
pub const FRAME_LEN: i64 = 512;

/// The length of the longest packet of an ECM-XF in bytes, which the chip needs in one exchange (XF EN 174).
pub const PACKET_LEN: i64 = 1440;

/// A spidev device of the machine, which the links `spi:` and `xf-spi:` can open.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SpiDevice {
    /// The device file, such as `/dev/spidev0.0`.
    pub file: String,
    /// Whether this user may open the device file.
    pub access: Access,
}

impl SpiDevice {
    /// The URI of the link that opens this device.
    pub fn link(&self) -> String {
        format!("spi:{}", self.file)
    }
}

/// The parameter `bufsiz` of spidev: the longest exchange that the driver allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bufsiz {
    /// The longest exchange in bytes.
    pub bytes: i64,
    /// Whether spidev is built into the kernel, so that the parameter has to be set on the kernel's command line.
    pub is_built_in: bool,
}

impl Machine {
    /// All spidev devices.
    pub fn spi_devices(&self) -> Vec<SpiDevice> {
        let names = self.names(CLASS).into_iter().filter(|name| is_device(name));
        let files = names.map(|name| format!("/dev/{name}"));
        files.map(|file| SpiDevice { access: self.access(&file), file }).collect()
    }

    /// The longest exchange that spidev allows; `None` if the driver is not loaded.
    pub fn bufsiz(&self) -> Option<Bufsiz> {
        let bytes = self.number(&format!("{MODULE}/parameters/bufsiz"))?;
        // Only a loadable module has the attribute `initstate`.
        Some(Bufsiz { bytes, is_built_in: !self.has(&format!("{MODULE}/initstate")) })
    }
}

/// Whether a name is that of a device, such as `spidev0.0`.
fn is_device(name: &str) -> bool {
    let numbers = name.strip_prefix("spidev").and_then(|rest| rest.split_once('.'));
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    numbers.is_some_and(|(bus, select)| is_number(bus) && is_number(select))
}

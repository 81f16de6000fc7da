//! The HID devices of this machine.

use std::sync::Arc;

use super::api::Api;

/// Why the HID devices of this machine cannot be used.
#[cfg(windows)]
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BusError {
    /// Windows lists no devices.
    #[error("Windows does not list its HID devices ({0}); start it anew")]
    Usb(#[from] super::UsbError),
}

/// Windows' HID driver.
pub struct Bus {
    api: Api,
}

impl Bus {
    /// Windows' HID driver, which every Windows has.
    ///
    /// # Errors
    /// None. [`BusError`] is used where its devices cannot be listed.
    #[cfg(windows)]
    pub fn open() -> Result<Arc<Self>, BusError> {
        Ok(Arc::new(Self { api: Api::WINDOWS }))
    }

    /// The driver that these functions reach.
    #[cfg(test)]
    pub(super) fn over(api: Api) -> Arc<Self> {
        Arc::new(Self { api })
    }

    pub(super) const fn api(&self) -> &Api {
        &self.api
    }

    /// The error code of this thread's last call of Windows.
    pub(super) fn last_error(&self) -> u32 {
        // SAFETY: the function has no conditions.
        unsafe { (self.api.last_error)() }
    }
}

/// A device of the HID driver.
pub struct Device {
    pub(super) bus: Arc<Bus>,
    /// The device path, terminated by a zero.
    pub(super) path: Vec<u16>,
    /// The serial number, if Windows' name of the USB device contains it.
    pub(super) serial: Option<String>,
}

//! The HID devices of this machine, as Windows' HID driver provides them.

use std::sync::Arc;

use super::api::Api;

/// The reason why the HID devices of this machine cannot be used.
#[cfg(windows)]
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum UsbBusError {
    /// Windows reports an error when it lists the devices.
    #[error("Windows does not list its HID devices ({0}); restart Windows")]
    Usb(#[from] super::UsbError),
}

/// Access to the HID driver through Windows' functions.
pub struct Bus {
    api: Api,
}

impl Bus {
    /// Opens Windows' HID driver, which exists in every Windows.
    ///
    /// # Errors
    /// None here. [`UsbBusError`] is the error of listing the devices.
    #[cfg(windows)]
    pub fn open() -> Result<Arc<Self>, UsbBusError> {
        Ok(Arc::new(Self { api: Api::WINDOWS }))
    }

    /// Creates the access to a simulated driver through the functions in `api`.
    #[cfg(test)]
    pub(super) fn over(api: Api) -> Arc<Self> {
        Arc::new(Self { api })
    }

    pub(super) const fn api(&self) -> &Api {
        &self.api
    }

    /// The error code of this thread's last call of a Windows function.
    pub(super) fn last_error(&self) -> u32 {
        // SAFETY: the function has no conditions.
        unsafe { (self.api.last_error)() }
    }
}

/// A HID device that Windows lists.
pub struct Device {
    pub(super) bus: Arc<Bus>,
    /// The device path, in UTF-16 with a terminating zero.
    pub(super) path: Vec<u16>,
    /// The serial number of the device, if Windows' name of the USB device contains it.
    pub(super) serial: Option<String>,
}

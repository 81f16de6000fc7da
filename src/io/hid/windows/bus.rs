//! The HID devices of this machine.

use std::sync::Arc;

use super::api::Api;

/// Why the HID devices of this machine cannot be used.
#[cfg(windows)]
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoBus {
    /// Windows lists no devices.
    #[error("Windows does not list its HID devices ({0}); start it anew")]
    Usb(#[from] super::UsbError),
}

/// Windows' HID driver.
pub struct Bus {
    api: Api,
}

impl Bus {
    /// Windows' HID driver, which is always there.
    ///
    /// # Errors
    /// None; [`NoBus`] is why its devices cannot be listed.
    #[cfg(windows)]
    pub fn open() -> Result<Arc<Self>, NoBus> {
        Ok(Arc::new(Self { api: Api::WINDOWS }))
    }

    /// The driver behind these functions.
    #[cfg(test)]
    pub(super) fn over(api: Api) -> Arc<Self> {
        Arc::new(Self { api })
    }

    pub(super) const fn api(&self) -> &Api {
        &self.api
    }

    /// What the last call of this thread failed by.
    pub(super) fn last_error(&self) -> u32 {
        // SAFETY: it has no conditions.
        unsafe { (self.api.last_error)() }
    }
}

/// A device of the HID driver.
pub struct Device {
    pub(super) bus: Arc<Bus>,
    /// With a zero at its end.
    pub(super) path: Vec<u16>,
    /// The serial number, if Windows' name of the device says it.
    pub(super) serial: Option<String>,
}

//! libusb's functions, looked up by name when the first `usb:` link is opened. So neither the build of this crate nor a
//! program that uses another link needs the library (docs/decisions/libusb-is-loaded-at-run-time.md).
//!
//! Names and layouts are those of `libusb.h` of libusb 1.0.

use std::ffi::{c_int, c_short, c_uchar, c_uint, c_void};
use std::marker::{PhantomData, PhantomPinned};
use std::sync::OnceLock;

use libloading::Library;

use super::UsbError;

/// The file name of the library libusb 1.0 on this system.
const LIBRARY_NAME: &str = if cfg!(target_os = "macos") { "libusb-1.0.0.dylib" } else { "libusb-1.0.so.0" };

/// libusb cannot be loaded, for example because it is not installed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("libusb cannot be loaded ({message}); install it: `sudo apt-get install libusb-1.0-0`")]
pub struct LibusbMissing {
    message: String,
}

/// The type of a structure of libusb that is used only behind pointers, because its header does not define it. `Kind`
/// is a different empty type for each structure, so that their pointers cannot be mixed up.
#[repr(C)]
pub(super) struct Opaque<Kind> {
    nothing: [u8; 0],
    kind: PhantomData<(*mut u8, PhantomPinned, Kind)>,
}

pub(super) enum OfContext {}
pub(super) enum OfDevice {}
pub(super) enum OfHandle {}
pub(super) type RawContext = Opaque<OfContext>;
pub(super) type RawDevice = Opaque<OfDevice>;
pub(super) type RawHandle = Opaque<OfHandle>;

/// The C layout of `struct libusb_device_descriptor`.
#[repr(C)]
#[derive(Default)]
pub(super) struct DeviceDescriptor {
    pub length: u8,
    pub kind: u8,
    pub usb: u16,
    pub class: u8,
    pub subclass: u8,
    pub protocol: u8,
    pub packet: u8,
    pub vendor: u16,
    pub product: u16,
    pub release: u16,
    pub texts: [u8; 3],
    pub configurations: u8,
}

/// The C layout of `struct libusb_config_descriptor`.
#[repr(C)]
pub(super) struct ConfigurationDescriptor {
    pub length: u8,
    pub kind: u8,
    pub total: u16,
    pub interface_count: u8,
    pub value: u8,
    pub text: u8,
    pub attributes: u8,
    pub power: u8,
    pub interfaces: *const InterfaceSettings,
    pub extra: *const c_uchar,
    pub extra_length: c_int,
}

/// The C layout of `struct libusb_interface`.
#[repr(C)]
pub(super) struct InterfaceSettings {
    pub settings: *const InterfaceDescriptor,
    pub count: c_int,
}

/// The C layout of `struct libusb_interface_descriptor`.
#[repr(C)]
pub(super) struct InterfaceDescriptor {
    pub length: u8,
    pub kind: u8,
    pub number: u8,
    pub alternate: u8,
    pub endpoint_count: u8,
    pub class: u8,
    pub subclass: u8,
    pub protocol: u8,
    pub text: u8,
    pub endpoints: *const EndpointDescriptor,
    pub extra: *const c_uchar,
    pub extra_length: c_int,
}

/// The C layout of `struct libusb_endpoint_descriptor`.
#[repr(C)]
pub(super) struct EndpointDescriptor {
    pub length: u8,
    pub kind: u8,
    pub address: u8,
    pub attributes: u8,
    pub packet: u16,
    pub interval: u8,
    pub refresh: u8,
    pub synch: u8,
    pub extra: *const c_uchar,
    pub extra_length: c_int,
}

/// The C layout of `struct libusb_transfer`, without isochronous packets.
#[repr(C)]
pub(super) struct RawTransfer {
    pub handle: *mut RawHandle,
    pub flags: u8,
    pub endpoint: c_uchar,
    pub kind: c_uchar,
    pub timeout: c_uint,
    pub status: c_int,
    pub length: c_int,
    pub moved: c_int,
    pub callback: extern "C" fn(*mut RawTransfer),
    pub user_data: *mut c_void,
    pub buffer: *mut c_uchar,
    pub packets: c_int,
}

/// The C layout of `struct libusb_pollfd`.
#[repr(C)]
pub(super) struct PollDescriptor {
    pub descriptor: c_int,
    pub events: c_short,
}

/// `LIBUSB_TRANSFER_TYPE_BULK`: the type of a bulk transfer.
pub(super) const BULK: u8 = 2;
/// `LIBUSB_TRANSFER_TYPE_INTERRUPT`: the type of an interrupt transfer.
pub(super) const INTERRUPT: u8 = 3;
/// `LIBUSB_SPEED_HIGH`: 480 Mbit/s.
pub(super) const HIGH_SPEED: c_int = 3;

/// The values of `enum libusb_transfer_status`.
pub(in crate::io::hid) mod status {
    use super::c_int;

    pub const COMPLETED: c_int = 0;
    pub const CANCELLED: c_int = 3;
    pub const STALL: c_int = 4;
    pub const NO_DEVICE: c_int = 5;
}

/// `LIBUSB_ERROR_TIMEOUT`: the transfer has timed out.
pub(super) const TIMEOUT: c_int = -7;
/// `LIBUSB_ERROR_INTERRUPTED`: a signal has ended the wait.
pub(super) const INTERRUPTED: c_int = -10;

impl UsbError {
    /// Converts a return value of libusb: an error if it is an error code, otherwise the value.
    pub(in crate::io::hid) const fn check(code: c_int) -> Result<c_int, Self> {
        Err(match code {
            0.. => return Ok(code),
            -1 => Self::Io,
            -2 => Self::Invalid,
            -3 => Self::Access,
            -4 => Self::NoDevice,
            -5 => Self::NotFound,
            -6 => Self::Busy,
            -11 => Self::NoMemory,
            -12 => Self::NotSupported,
            other => Self::Other(other),
        })
    }
}

macro_rules! functions {
    ($($field:ident = $name:ident ($($argument:ty),*) $(-> $result:ty)?;)*) => {
        /// The functions of libusb that this crate uses.
        #[derive(Clone, Copy)]
        pub(super) struct Api {
            $(pub $field: unsafe extern "C" fn($($argument),*) $(-> $result)?,)*
        }

        impl Api {
            /// Looks up all functions in the library. Fails if the library lacks one of them.
            ///
            /// # Safety
            /// The library is libusb 1.0, and stays loaded as long as one of its functions may be called.
            unsafe fn of(library: &Library) -> Result<Self, libloading::Error> {
                // SAFETY: the library is libusb by the caller's promise, so the functions are those that `libusb.h` declares.
                Ok(unsafe { Self { $($field: *library.get(concat!(stringify!($name), "\0"))?,)* } })
            }
        }
    };
}

functions! {
    init = libusb_init(*mut *mut RawContext) -> c_int;
    exit = libusb_exit(*mut RawContext);
    devices = libusb_get_device_list(*mut RawContext, *mut *mut *mut RawDevice) -> isize;
    free_devices = libusb_free_device_list(*mut *mut RawDevice, c_int);
    unref_device = libusb_unref_device(*mut RawDevice);
    device_descriptor = libusb_get_device_descriptor(*mut RawDevice, *mut DeviceDescriptor) -> c_int;
    configuration = libusb_get_active_config_descriptor(*mut RawDevice, *mut *mut ConfigurationDescriptor) -> c_int;
    free_configuration = libusb_free_config_descriptor(*mut ConfigurationDescriptor);
    bus_number = libusb_get_bus_number(*mut RawDevice) -> u8;
    address = libusb_get_device_address(*mut RawDevice) -> u8;
    ports = libusb_get_port_numbers(*mut RawDevice, *mut u8, c_int) -> c_int;
    speed = libusb_get_device_speed(*mut RawDevice) -> c_int;
    open = libusb_open(*mut RawDevice, *mut *mut RawHandle) -> c_int;
    close = libusb_close(*mut RawHandle);
    detach_driver_by_itself = libusb_set_auto_detach_kernel_driver(*mut RawHandle, c_int) -> c_int;
    claim = libusb_claim_interface(*mut RawHandle, c_int) -> c_int;
    release = libusb_release_interface(*mut RawHandle, c_int) -> c_int;
    clear_halt = libusb_clear_halt(*mut RawHandle, c_uchar) -> c_int;
    new_transfer = libusb_alloc_transfer(c_int) -> *mut RawTransfer;
    free_transfer = libusb_free_transfer(*mut RawTransfer);
    submit = libusb_submit_transfer(*mut RawTransfer) -> c_int;
    cancel = libusb_cancel_transfer(*mut RawTransfer) -> c_int;
    handle_events = libusb_handle_events_timeout_completed(*mut RawContext, *mut libc::timeval, *mut c_int) -> c_int;
    interrupt = libusb_interrupt_event_handler(*mut RawContext);
    descriptors = libusb_get_pollfds(*mut RawContext) -> *const *const PollDescriptor;
    free_descriptors = libusb_free_pollfds(*const *const PollDescriptor);
    bulk_transfer = libusb_bulk_transfer(*mut RawHandle, c_uchar, *mut c_uchar, c_int, *mut c_int, c_uint) -> c_int;
    interrupt_transfer = libusb_interrupt_transfer(*mut RawHandle, c_uchar, *mut c_uchar, c_int, *mut c_int, c_uint) -> c_int;
}

/// Loads the system's libusb, which then stays loaded until the process ends.
pub(super) fn load() -> Result<&'static Api, LibusbMissing> {
    static LOADED: OnceLock<(Api, Library)> = OnceLock::new();
    if LOADED.get().is_none() {
        let loaded = open().map_err(|error| LibusbMissing { message: with_sources(&error) })?;
        LOADED.get_or_init(|| loaded);
    }
    // `LOADED` is set here, so the empty error below is never returned. A failure of `open` is not stored: the next
    // call tries again, because the library may be installed meanwhile.
    LOADED.get().map(|(api, _)| api).ok_or_else(|| LibusbMissing { message: String::new() })
}

/// An error followed by its sources. The last one is the dynamic linker's own message.
fn with_sources(error: &libloading::Error) -> String {
    let mut message = error.to_string();
    let mut next = std::error::Error::source(error);
    while let Some(source) = next {
        message = format!("{message}: {source}");
        next = source.source();
    }
    message
}

fn open() -> Result<(Api, Library), libloading::Error> {
    // SAFETY: libusb's initialisers have no conditions, and a library of that name is libusb. It is kept in a static beside
    // its functions and never unloaded.
    unsafe {
        let library = Library::new(LIBRARY_NAME)?;
        Ok((Api::of(&library)?, library))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The sizes match those of the C compiler on 64-bit machines (`sizeof` of the types in `libusb.h`).
    #[test]
    #[cfg(target_pointer_width = "64")]
    fn layouts_are_those_of_the_header() {
        assert_eq!(size_of::<DeviceDescriptor>(), 18);
        assert_eq!(size_of::<ConfigurationDescriptor>(), 40);
        assert_eq!(size_of::<InterfaceSettings>(), 16);
        assert_eq!(size_of::<InterfaceDescriptor>(), 40);
        assert_eq!(size_of::<EndpointDescriptor>(), 32);
        assert_eq!(std::mem::offset_of!(RawTransfer, callback), 32);
        assert_eq!(std::mem::offset_of!(RawTransfer, packets), 56);
    }

    #[test]
    fn codes_below_zero_are_errors() {
        assert_eq!(UsbError::check(0), Ok(0));
        assert_eq!(UsbError::check(7), Ok(7));
        assert_eq!(UsbError::check(-3), Err(UsbError::Access));
        assert_eq!(UsbError::check(-6), Err(UsbError::Busy));
        assert_eq!(UsbError::check(-99), Err(UsbError::Other(-99)));
    }
}

//! A bare loop on libusb's synchronous functions, as its manual has it: one transfer after the other, one thread.

use std::ffi::{c_int, c_uchar, c_uint, c_void};
use std::ptr;

use libloading::Library;

/// What the link loads too.
const NAME: &str = "libusb-1.0.so.0";
const OUT: c_uchar = 0x02;
const IN: c_uchar = 0x81;
/// No transfer takes longer.
const LIMIT_MS: c_uint = 10_000;

type Context = *mut c_void;
type Handle = *mut c_void;
type Transfer = unsafe extern "C" fn(Handle, c_uchar, *mut c_uchar, c_int, *mut c_int, c_uint) -> c_int;

/// An open device.
pub struct Bare {
    handle: Handle,
    transfer: Transfer,
    /// Its functions are called until this is dropped.
    _library: Library,
}

impl Bare {
    /// Opens the device with these ids and takes it from the kernel's driver; the process keeps it.
    pub fn open(vendor: u16, product: u16) -> Self {
        // SAFETY: the names and signatures are those of libusb.h (libusb 1.0), and the library is kept.
        unsafe {
            let library = Library::new(NAME).expect("the guest has it");
            let init: unsafe extern "C" fn(*mut Context) -> c_int = *library.get(c"libusb_init").expect("it has it");
            let open: unsafe extern "C" fn(Context, u16, u16) -> Handle =
                *library.get(c"libusb_open_device_with_vid_pid").expect("it has it");
            let detach: unsafe extern "C" fn(Handle, c_int) -> c_int =
                *library.get(c"libusb_set_auto_detach_kernel_driver").expect("it has it");
            let claim: unsafe extern "C" fn(Handle, c_int) -> c_int =
                *library.get(c"libusb_claim_interface").expect("it has it");
            let transfer: Transfer = *library.get(c"libusb_interrupt_transfer").expect("it has it");
            let mut context = ptr::null_mut();
            assert_eq!(init(&raw mut context), 0);
            let handle = open(context, vendor, product);
            assert!(!handle.is_null(), "the device opens");
            assert_eq!((detach(handle, 1), claim(handle, 0)), (0, 0));
            Self { handle, transfer, _library: library }
        }
    }

    /// Sends it.
    pub fn write(&mut self, frame: &mut [u8; 512]) {
        self.transfer(OUT, frame);
    }

    /// Waits for a report.
    pub fn read(&mut self, report: &mut [u8; 512]) {
        self.transfer(IN, report);
    }

    fn transfer(&mut self, endpoint: c_uchar, bytes: &mut [u8; 512]) {
        let mut moved = 0;
        // SAFETY: the handle is open, and the buffer is there for as long as the call lasts.
        let code = unsafe { (self.transfer)(self.handle, endpoint, bytes.as_mut_ptr(), 512, &raw mut moved, LIMIT_MS) };
        assert_eq!((code, moved), (0, 512), "endpoint {endpoint:#04x}");
    }
}

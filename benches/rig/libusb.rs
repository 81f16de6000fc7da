//! Bare loops on libusb, one thread each: on its synchronous functions, one transfer after the other, as its manual has it;
//! and on its asynchronous ones, with reads under way all the time.

use std::collections::VecDeque;
use std::ffi::{c_int, c_uchar, c_uint, c_void};
use std::ptr;

use libloading::Library;

/// What the link loads too.
const NAME: &str = "libusb-1.0.so.0";
const OUT: c_uchar = 0x02;
const IN: c_uchar = 0x81;
/// `LIBUSB_TRANSFER_TYPE_INTERRUPT`
const INTERRUPT: c_uchar = 3;
/// No transfer takes longer.
const LIMIT_MS: c_uint = 10_000;
/// Reads under way, as many as the link has.
const READS: usize = 8;

type Context = *mut c_void;
type Handle = *mut c_void;

/// A loop: a frame out, a report in.
pub trait Bare {
    /// Sends it.
    fn write(&mut self, frame: &mut [u8; 512]);
    /// Waits for a report.
    fn read(&mut self, report: &mut [u8; 512]);
}

/// An open device.
struct Device {
    context: Context,
    handle: Handle,
    library: Library,
}

impl Device {
    /// Opens the device with these ids and takes it from the kernel's driver; the process keeps it.
    fn open(vendor: u16, product: u16) -> Self {
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
            let mut context = ptr::null_mut();
            assert_eq!(init(&raw mut context), 0);
            let handle = open(context, vendor, product);
            assert!(!handle.is_null(), "the device opens");
            assert_eq!((detach(handle, 1), claim(handle, 0)), (0, 0));
            Self { context, handle, library }
        }
    }
}

type Move = unsafe extern "C" fn(Handle, c_uchar, *mut c_uchar, c_int, *mut c_int, c_uint) -> c_int;

/// On `libusb_interrupt_transfer`: a read begins when the write before it has ended.
pub struct Synchronous {
    device: Device,
    transfer: Move,
}

impl Synchronous {
    /// Opens the device with these ids; the process keeps it.
    pub fn open(vendor: u16, product: u16) -> Self {
        let device = Device::open(vendor, product);
        // SAFETY: as in `Device::open`.
        let transfer = unsafe { *device.library.get::<Move>(c"libusb_interrupt_transfer").expect("it has it") };
        Self { device, transfer }
    }

    fn transfer(&mut self, endpoint: c_uchar, bytes: &mut [u8; 512]) {
        let (mut moved, bytes) = (0, bytes.as_mut_ptr());
        // SAFETY: the handle is open, and the buffer is there for as long as the call lasts.
        let code = unsafe { (self.transfer)(self.device.handle, endpoint, bytes, 512, &raw mut moved, LIMIT_MS) };
        assert_eq!((code, moved), (0, 512), "endpoint {endpoint:#04x}");
    }
}

impl Bare for Synchronous {
    fn write(&mut self, frame: &mut [u8; 512]) {
        self.transfer(OUT, frame);
    }

    fn read(&mut self, report: &mut [u8; 512]) {
        self.transfer(IN, report);
    }
}

/// `struct libusb_transfer`, without isochronous packets.
#[repr(C)]
struct Transfer {
    handle: Handle,
    flags: u8,
    endpoint: c_uchar,
    kind: c_uchar,
    timeout: c_uint,
    status: c_int,
    length: c_int,
    moved: c_int,
    callback: extern "C" fn(*mut Transfer),
    user_data: *mut c_void,
    buffer: *mut c_uchar,
    packets: c_int,
}

type Submit = unsafe extern "C" fn(*mut Transfer) -> c_int;
type HandleEvents = unsafe extern "C" fn(Context) -> c_int;

/// What has ended.
struct Ended {
    submit: Submit,
    reports: VecDeque<[u8; 512]>,
    written: bool,
}

/// On `libusb_submit_transfer`: eight reads are under way all the time.
pub struct Queued {
    device: Device,
    handle_events: HandleEvents,
    output: *mut Transfer,
    /// libusb knows its address: from a box, which the process keeps.
    ended: *mut Ended,
}

impl Queued {
    /// Opens the device with these ids; the process keeps it.
    pub fn open(vendor: u16, product: u16) -> Self {
        let device = Device::open(vendor, product);
        // SAFETY: as in `Device::open`. A transfer and its buffer of 512 bytes are never freed, and neither is what its user
        // data point to.
        unsafe {
            let new: unsafe extern "C" fn(c_int) -> *mut Transfer =
                *device.library.get(c"libusb_alloc_transfer").expect("it has it");
            let submit: Submit = *device.library.get(c"libusb_submit_transfer").expect("it has it");
            let handle_events: HandleEvents = *device.library.get(c"libusb_handle_events").expect("it has it");
            let ended = Ended { submit, reports: VecDeque::with_capacity(64), written: false };
            let ended = Box::into_raw(Box::new(ended));
            let transfer = |endpoint| {
                let transfer = new(0);
                assert!(!transfer.is_null(), "there is memory");
                let fields = Transfer {
                    handle: device.handle,
                    flags: 0,
                    endpoint,
                    kind: INTERRUPT,
                    timeout: 0,
                    status: 0,
                    length: 512,
                    moved: 0,
                    callback: told,
                    user_data: ended.cast(),
                    buffer: Box::into_raw(Box::new([0_u8; 512])).cast(),
                    packets: 0,
                };
                transfer.write(fields);
                transfer
            };
            let output = transfer(OUT);
            for _ in 0..READS {
                assert_eq!(submit(transfer(IN)), 0, "it begins");
            }
            Self { device, handle_events, output, ended }
        }
    }

    fn until(&mut self, done: impl Fn(&Ended) -> bool) {
        // SAFETY: callbacks run in `libusb_handle_events` alone, and no reference is kept meanwhile.
        while !done(unsafe { &*self.ended }) {
            // SAFETY: the context is there as long as the process.
            assert_eq!(unsafe { (self.handle_events)(self.device.context) }, 0);
        }
    }
}

impl Bare for Queued {
    fn write(&mut self, frame: &mut [u8; 512]) {
        // SAFETY: libusb has given the transfer back when a write before has ended; no callback runs here.
        unsafe {
            (*self.ended).written = false;
            (*self.output).buffer.copy_from_nonoverlapping(frame.as_ptr(), frame.len());
            assert_eq!(((*self.ended).submit)(self.output), 0, "it begins");
        }
        self.until(|ended| ended.written);
    }

    fn read(&mut self, report: &mut [u8; 512]) {
        self.until(|ended| !ended.reports.is_empty());
        // SAFETY: no callback runs here.
        let next = unsafe { (*self.ended).reports.pop_front() };
        *report = next.expect("there is one");
    }
}

/// libusb's call when a transfer has ended.
extern "C" fn told(transfer: *mut Transfer) {
    // SAFETY: the transfer and its user data are those of `Queued::open`, and the loop's one thread is here.
    unsafe {
        let ended = &mut *(*transfer).user_data.cast::<Ended>();
        assert_eq!(((*transfer).status, (*transfer).moved), (0, 512), "endpoint {:#04x}", (*transfer).endpoint);
        if (*transfer).endpoint == OUT {
            ended.written = true;
            return;
        }
        ended.reports.push_back(*(*transfer).buffer.cast::<[u8; 512]>());
        assert_eq!((ended.submit)(transfer), 0, "it begins again");
    }
}

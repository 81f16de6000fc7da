//! libusb's asynchronous transfers. This is the only file that gives libusb memory which libusb uses after the call has
//! returned.

use std::cell::UnsafeCell;
use std::ffi::{c_int, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr::NonNull;
use std::sync::Arc;

use super::api::{INTERRUPT, RawTransfer, status};
use super::bus::Handle;
use super::{Outcome, REPORT_LEN, TransferListener, UsbError};

impl Outcome {
    const fn of(status: c_int) -> Self {
        match status {
            status::COMPLETED => Self::Done,
            status::CANCELLED => Self::Cancelled,
            status::NO_DEVICE => Self::Gone,
            status::STALL => Self::Stalled,
            _ => Self::Failed,
        }
    }
}

/// A transfer of one report on an interrupt endpoint. While it is submitted, libusb owns its buffer.
pub(super) struct UsbTransfer {
    /// A leaked box: its address must not change, since libusb keeps the address as the user data of the transfer.
    inner: NonNull<Inner>,
}

struct Inner {
    raw: NonNull<RawTransfer>,
    buffer: UnsafeCell<[u8; REPORT_LEN]>,
    to_host: bool,
    /// The number of this transfer, which the listener gets when the transfer ends.
    number: usize,
    listener: Arc<dyn TransferListener>,
    /// libusb's transfer refers to the device handle, so this keeps the handle open.
    handle: Arc<Handle>,
}

// SAFETY: libusb's functions on transfers may be called from any thread. The buffer is accessed by libusb while the transfer
// is submitted, otherwise in `fill` and `ended` only.
unsafe impl Send for UsbTransfer {}
// SAFETY: libusb's functions on transfers may be called from any thread, and by the promise of `fill`'s caller no two threads
// are in `fill`.
unsafe impl Sync for UsbTransfer {}

impl UsbTransfer {
    /// Creates a transfer for the endpoint with this address; `None` if there is no memory.
    pub fn new(handle: &Arc<Handle>, endpoint: u8, number: usize, listener: Arc<dyn TransferListener>) -> Option<Self> {
        // SAFETY: the function has no conditions. 0 is the number of isochronous packets.
        let raw = NonNull::new(unsafe { (handle.bus().api().new_transfer)(0) })?;
        let inner = NonNull::from(Box::leak(Box::new(Inner {
            raw,
            buffer: UnsafeCell::new([0; REPORT_LEN]),
            to_host: endpoint & 0x80 != 0,
            number,
            listener,
            handle: handle.clone(),
        })));
        // SAFETY: `raw` is a new transfer that nothing else refers to. What its fields point to lives until `drop`, and the
        // owner drops a transfer only after it has ended.
        unsafe {
            let fields = raw.as_ptr();
            (*fields).handle = handle.raw();
            (*fields).endpoint = endpoint;
            (*fields).kind = INTERRUPT;
            (*fields).timeout = 0;
            (*fields).buffer = inner.as_ref().buffer.get().cast();
            (*fields).length = REPORT_LEN as c_int;
            (*fields).user_data = inner.as_ptr().cast::<c_void>();
            (*fields).callback = ended;
        }
        Some(Self { inner })
    }

    fn inner(&self) -> &Inner {
        // SAFETY: the box is freed in `drop` only, and no other code makes unique references to it.
        unsafe { self.inner.as_ref() }
    }

    /// Sets the report to send to the device.
    ///
    /// # Safety
    /// The transfer is not submitted, and no other thread calls this function.
    pub unsafe fn fill(&self, report: &[u8; REPORT_LEN]) {
        // SAFETY: by the caller's promise nobody else accesses the buffer.
        unsafe { (*self.inner().buffer.get()).copy_from_slice(report) };
    }

    /// Submits the transfer. At its end the thread that handles events calls the listener.
    pub fn submit(&self) -> Result<(), UsbError> {
        self.inner().submit()
    }

    /// Cancels the transfer, which then ends soon. Has no effect if the transfer is not submitted.
    pub fn cancel(&self) {
        let inner = self.inner();
        // SAFETY: the transfer is valid until `drop`.
        unsafe { (inner.handle.bus().api().cancel)(inner.raw.as_ptr()) };
    }
}

impl Drop for UsbTransfer {
    fn drop(&mut self) {
        // SAFETY: the pointer came from a box, and the owner drops a transfer only after it has ended.
        let inner = unsafe { Box::from_raw(self.inner.as_ptr()) };
        // SAFETY: no flag is set that makes libusb free the buffer as well.
        unsafe { (inner.handle.bus().api().free_transfer)(inner.raw.as_ptr()) };
    }
}

impl Inner {
    fn submit(&self) -> Result<(), UsbError> {
        // SAFETY: `new` has set all fields; libusb refuses a transfer that is submitted already.
        UsbError::check(unsafe { (self.handle.bus().api().submit)(self.raw.as_ptr()) }).map(drop)
    }
}

/// The callback that libusb calls at the end of a transfer. It catches panics: an uncaught one would abort the program,
/// whose axes may be moving.
extern "C" fn ended(raw: *mut RawTransfer) {
    if catch_unwind(|| call_listener(raw)).is_ok() {
        return;
    }
    // SAFETY: libusb passes the transfer with the user data that `UsbTransfer::new` has set.
    let transfer = unsafe { &*(*raw).user_data.cast::<Inner>() };
    let lost = catch_unwind(AssertUnwindSafe(|| transfer.listener.panicked()));
    let also = if lost.is_err() { ", and so has what was to end the link" } else { "" };
    log::error!("a defect of this library: what takes reports from libusb has panicked{also}; open the board again");
}

/// Calls the listener with the result of the transfer.
fn call_listener(raw: *mut RawTransfer) {
    // SAFETY: libusb passes the transfer with the user data that `UsbTransfer::new` has set, which live until after this call.
    let (transfer, status, moved) = unsafe { (&*(*raw).user_data.cast::<Inner>(), (*raw).status, (*raw).moved) };
    let outcome = Outcome::of(status);
    let moved = usize::try_from(moved).unwrap_or(0).min(REPORT_LEN);
    if !transfer.to_host {
        return transfer.listener.output_ended(outcome, moved);
    }
    // SAFETY: the transfer has ended, and nobody else accesses the buffer of a transfer to the host. The bytes are copied,
    // since the listener may submit the transfer again while it uses them.
    let bytes = unsafe { *transfer.buffer.get() };
    transfer.listener.input_ended(transfer.number, outcome, &bytes[..moved], &|| transfer.submit());
}

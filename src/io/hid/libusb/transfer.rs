//! libusb's asynchronous transfers: the one file that hands it memory.

use std::cell::UnsafeCell;
use std::ffi::{c_int, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr::NonNull;
use std::sync::Arc;

use super::api::{INTERRUPT, RawTransfer, status};
use super::bus::Handle;
use super::{Ended, Outcome, REPORT_LEN, UsbError};

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

/// A transfer of one report on an interrupt endpoint. While libusb has it, its buffer is libusb's.
pub(super) struct Transfer {
    /// From a box, which has to stay where it is: libusb knows its address.
    inner: NonNull<Inner>,
}

struct Inner {
    raw: NonNull<RawTransfer>,
    buffer: UnsafeCell<[u8; REPORT_LEN]>,
    to_host: bool,
    /// Its number, to the host.
    number: usize,
    listener: Arc<dyn Ended>,
    /// The transfer names the handle.
    handle: Arc<Handle>,
}

// SAFETY: libusb's functions on transfers may be called from any thread; the buffer is touched by whoever has the
// transfer, see `fill` and `ended`.
unsafe impl Send for Transfer {}
// SAFETY: as above; `fill` asks its caller to be alone.
unsafe impl Sync for Transfer {}

impl Transfer {
    /// A transfer for the endpoint of that address; `None`: there is no memory.
    pub fn new(handle: &Arc<Handle>, endpoint: u8, number: usize, listener: Arc<dyn Ended>) -> Option<Self> {
        // SAFETY: a transfer without isochronous packets.
        let raw = NonNull::new(unsafe { (handle.bus().api().new_transfer)(0) })?;
        let inner = NonNull::from(Box::leak(Box::new(Inner {
            raw,
            buffer: UnsafeCell::new([0; REPORT_LEN]),
            to_host: endpoint & 0x80 != 0,
            number,
            listener,
            handle: handle.clone(),
        })));
        // SAFETY: `raw` is a fresh transfer of ours alone; what it points to stays until `drop`, before which the owner
        // sees to it that libusb does not have it.
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
        // SAFETY: it is there until `drop`, and only shared references to it are made.
        unsafe { self.inner.as_ref() }
    }

    /// Sets what goes to the device.
    ///
    /// # Safety
    /// libusb does not have the transfer, and no other thread is here.
    pub unsafe fn fill(&self, report: &[u8; REPORT_LEN]) {
        // SAFETY: by the caller's promise nobody else touches the buffer.
        unsafe { (*self.inner().buffer.get()).copy_from_slice(report) };
    }

    /// Hands the transfer to libusb; its end is told to the listener, by the thread that handles events.
    pub fn hand_over(&self) -> Result<(), UsbError> {
        self.inner().hand_over()
    }

    /// Asks libusb to end it soon; without effect on one that it has not.
    pub fn cancel(&self) {
        let inner = self.inner();
        // SAFETY: the transfer is valid until `drop`.
        unsafe { (inner.handle.bus().api().cancel)(inner.raw.as_ptr()) };
    }
}

impl Drop for Transfer {
    fn drop(&mut self) {
        // SAFETY: it came from a box, and the owner waits for the end of a transfer before it drops it.
        let inner = unsafe { Box::from_raw(self.inner.as_ptr()) };
        // SAFETY: without flags libusb frees neither buffer nor user data.
        unsafe { (inner.handle.bus().api().free_transfer)(inner.raw.as_ptr()) };
    }
}

impl Inner {
    fn hand_over(&self) -> Result<(), UsbError> {
        // SAFETY: the transfer is filled; libusb refuses one that it has already.
        UsbError::check(unsafe { (self.handle.bus().api().submit)(self.raw.as_ptr()) }).map(drop)
    }
}

/// libusb's call when a transfer has ended. A panic that left it would end the program, whose axes may be moving.
extern "C" fn ended(raw: *mut RawTransfer) {
    if catch_unwind(|| tell(raw)).is_ok() {
        return;
    }
    // SAFETY: as in `tell`.
    let transfer = unsafe { &*(*raw).user_data.cast::<Inner>() };
    let lost = catch_unwind(AssertUnwindSafe(|| transfer.listener.defective()));
    let also = if lost.is_err() { ", and so has what was to end the link" } else { "" };
    log::error!("a defect of this library: what takes reports from libusb has panicked{also}; open the board again");
}

/// Tells the listener how the transfer ended.
fn tell(raw: *mut RawTransfer) {
    // SAFETY: libusb gives the transfer back, with the user data of `Transfer::new`, which live until after this call.
    let (transfer, status, moved) = unsafe { (&*(*raw).user_data.cast::<Inner>(), (*raw).status, (*raw).moved) };
    let outcome = Outcome::of(status);
    let moved = usize::try_from(moved).unwrap_or(0).min(REPORT_LEN);
    if !transfer.to_host {
        return transfer.listener.output(outcome, moved);
    }
    // SAFETY: libusb does not have the transfer now, and nobody else touches the buffer of one to the host. It is copied,
    // since the listener may hand the transfer over again while it has the bytes.
    let bytes = unsafe { *transfer.buffer.get() };
    transfer.listener.input(transfer.number, outcome, &bytes[..moved], &|| transfer.hand_over());
}

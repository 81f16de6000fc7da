//! libusb's asynchronous transfers: the one file that hands it memory.

use std::cell::UnsafeCell;
use std::ffi::{c_int, c_uchar, c_void};
use std::ptr::NonNull;
use std::sync::Arc;

use rusb::constants::{
    LIBUSB_ERROR_NO_DEVICE, LIBUSB_TRANSFER_CANCELLED, LIBUSB_TRANSFER_COMPLETED, LIBUSB_TRANSFER_NO_DEVICE,
    LIBUSB_TRANSFER_STALL, LIBUSB_TRANSFER_TYPE_INTERRUPT,
};
use rusb::{Context, DeviceHandle, ffi};

use super::REPORT_LEN;

/// How a transfer ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outcome {
    /// As it should, or with fewer bytes.
    Done,
    /// It was cancelled; some bytes may have moved.
    Cancelled,
    /// The device is gone.
    Gone,
    /// The endpoint refuses.
    Stalled,
    /// Something else went wrong on the wire.
    Failed,
}

impl Outcome {
    const fn of(status: c_int) -> Self {
        match status {
            LIBUSB_TRANSFER_COMPLETED => Self::Done,
            LIBUSB_TRANSFER_CANCELLED => Self::Cancelled,
            LIBUSB_TRANSFER_NO_DEVICE => Self::Gone,
            LIBUSB_TRANSFER_STALL => Self::Stalled,
            _ => Self::Failed,
        }
    }
}

/// Who is told when a transfer has ended.
pub(super) trait Ended: Send + Sync {
    /// The transfer to the host has ended; whether to hand it over again.
    fn input(&self, outcome: Outcome, bytes: &[u8]) -> bool;
    /// It could not be handed over again.
    fn not_resubmitted(&self);
    /// The transfer to the device has ended; so many bytes were moved.
    fn output(&self, outcome: Outcome, moved: usize);
}

/// A transfer of one report on an interrupt endpoint. While libusb has it, its buffer is libusb's.
pub(super) struct Transfer {
    /// From a box, which has to stay where it is: libusb knows its address.
    inner: NonNull<Inner>,
}

struct Inner {
    raw: NonNull<ffi::libusb_transfer>,
    buffer: UnsafeCell<[u8; REPORT_LEN]>,
    to_host: bool,
    listener: Arc<dyn Ended>,
    /// The transfer names the handle.
    _handle: Arc<DeviceHandle<Context>>,
}

// SAFETY: libusb's functions on transfers may be called from any thread; the buffer is touched by whoever has the
// transfer, see `fill` and `ended`.
unsafe impl Send for Transfer {}
// SAFETY: as above; `fill` asks its caller to be alone.
unsafe impl Sync for Transfer {}

impl Transfer {
    /// A transfer for the endpoint of that address; `None`: there is no memory.
    pub fn new(handle: &Arc<DeviceHandle<Context>>, endpoint: u8, listener: Arc<dyn Ended>) -> Option<Self> {
        // SAFETY: a transfer without isochronous packets.
        let raw = NonNull::new(unsafe { ffi::libusb_alloc_transfer(0) })?;
        let inner = NonNull::from(Box::leak(Box::new(Inner {
            raw,
            buffer: UnsafeCell::new([0; REPORT_LEN]),
            to_host: endpoint & 0x80 != 0,
            listener,
            _handle: handle.clone(),
        })));
        // SAFETY: `raw` is a fresh transfer of ours alone; what it points to stays until `drop`, before which the owner
        // sees to it that libusb does not have it.
        unsafe {
            let fields = raw.as_ptr();
            (*fields).dev_handle = handle.as_raw();
            (*fields).endpoint = endpoint as c_uchar;
            (*fields).transfer_type = LIBUSB_TRANSFER_TYPE_INTERRUPT;
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
    pub fn hand_over(&self) -> Result<(), Outcome> {
        self.inner().hand_over()
    }

    /// Asks libusb to end it soon; without effect on one that it has not.
    pub fn cancel(&self) {
        // SAFETY: the transfer is valid until `drop`.
        unsafe { ffi::libusb_cancel_transfer(self.inner().raw.as_ptr()) };
    }
}

impl Drop for Transfer {
    fn drop(&mut self) {
        // SAFETY: it came from a box, and the owner waits for the end of a transfer before it drops it.
        let inner = unsafe { Box::from_raw(self.inner.as_ptr()) };
        // SAFETY: without flags libusb frees neither buffer nor user data.
        unsafe { ffi::libusb_free_transfer(inner.raw.as_ptr()) };
    }
}

impl Inner {
    fn hand_over(&self) -> Result<(), Outcome> {
        // SAFETY: the transfer is filled; libusb refuses one that it has already.
        match unsafe { ffi::libusb_submit_transfer(self.raw.as_ptr()) } {
            0 => Ok(()),
            LIBUSB_ERROR_NO_DEVICE => Err(Outcome::Gone),
            _ => Err(Outcome::Failed),
        }
    }
}

/// libusb's call when a transfer has ended.
extern "system" fn ended(raw: *mut ffi::libusb_transfer) {
    // SAFETY: libusb gives the transfer back, with the user data of `Transfer::new`, which live until after this call.
    let (transfer, status, moved) =
        unsafe { (&*(*raw).user_data.cast::<Inner>(), (*raw).status, (*raw).actual_length) };
    let outcome = Outcome::of(status);
    let moved = usize::try_from(moved).unwrap_or(0).min(REPORT_LEN);
    if !transfer.to_host {
        return transfer.listener.output(outcome, moved);
    }
    // SAFETY: libusb does not have the transfer now, and nobody else touches the buffer of one to the host.
    let bytes = unsafe { &(&*transfer.buffer.get())[..moved] };
    if transfer.listener.input(outcome, bytes) && transfer.hand_over().is_err() {
        transfer.listener.not_resubmitted();
    }
}

//! The interface between a pipe and the system that transfers its reports: libusb or Windows' HID driver.

use std::time::Duration;

use super::REPORT_LEN;
use super::error::UsbError;

/// How a transfer ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outcome {
    /// It is complete, possibly with fewer bytes than asked for.
    Done,
    /// It was cancelled; some bytes may have been transferred.
    Cancelled,
    /// The device was unplugged.
    Gone,
    /// The endpoint has stalled.
    #[cfg_attr(windows, allow(dead_code, reason = "Windows does not tell a stall from other errors"))]
    Stalled,
    /// It failed on the wire in another way.
    Failed,
}

/// Receives the end of each transfer from the backend. The pipe's state implements it.
pub(super) trait TransferListener: Send + Sync {
    /// Transfer `number` to the host has ended with `bytes`. `resubmit` submits it again, which is allowed within this call
    /// only.
    fn input_ended(&self, number: usize, outcome: Outcome, bytes: &[u8], resubmit: &dyn Fn() -> Result<(), UsbError>);
    /// The transfer to the device has ended after `moved` bytes.
    fn output_ended(&self, outcome: Outcome, moved: usize);
    /// One of the functions above has panicked, so that it is not known whether that transfer was counted as ended.
    #[cfg_attr(windows, allow(dead_code, reason = "there a thread of this crate calls, and no foreign code"))]
    fn panicked(&self);
}

/// Transfers the reports of an open device. Every transfer that is submitted ends, and the listener is called then, by the
/// thread in [`Backend::handle_events`] or in [`Backend::await_output`]. A backend is dropped after all its transfers have
/// ended.
pub(super) trait Backend: Send + Sync {
    /// The number of transfers to the host.
    fn inputs(&self) -> usize;

    /// Submits transfer `number` to the host.
    fn submit_input(&self, number: usize) -> Result<(), UsbError>;

    /// Whether a call that waits may be in [`Self::handle_events`] itself, which saves a change of threads. Where programs end
    /// threads by force, as on Windows, the pipe's thread alone handles events: a thread that ends there takes a transfer with it.
    fn lets_calls_handle_events(&self) -> bool {
        true
    }

    /// Sets how many reports, the newest ones, the system queues while no transfer to the host is submitted; `None` for as
    /// many as it can. Returns `false` if the system queues none, or not as many. The caller sees to it that the system's
    /// queue is empty during the call.
    fn set_system_queue(&self, reports: Option<usize>) -> bool;

    /// Whether the device is still there, for a caller that has no transfer to the host submitted. Does not wait for the device.
    fn is_there(&self) -> bool {
        true
    }

    /// Submits the transfer of a report to the device.
    ///
    /// # Safety
    /// An earlier transfer to the device has ended, and no other thread calls this function at the same time.
    unsafe fn submit_output(&self, report: &[u8; REPORT_LEN]) -> Result<(), UsbError>;

    /// Cancels the transfers to the host; they end soon.
    fn cancel_inputs(&self);

    /// Cancels the transfer to the device, which ends soon; without effect if none is submitted.
    fn cancel_output(&self);

    /// Calls the listener for transfers that have ended; waits for one for at most `limit`, or until [`Self::interrupt`].
    fn handle_events(&self, limit: Duration) -> Result<(), UsbError>;

    /// Ends the wait in [`Backend::handle_events`].
    fn interrupt(&self);

    /// Whether [`Self::handle_events`] does not report the end of the transfer to the device, so that the thread that writes
    /// has to wait for it in [`Backend::await_output`].
    fn waits_for_output_apart(&self) -> bool {
        false
    }

    /// Waits for the end of the transfer to the device for at most the limit, or until [`Self::interrupt_output`], and calls
    /// the listener.
    fn await_output(&self, _limit: Duration) -> Result<(), UsbError> {
        Ok(())
    }

    /// Ends the wait in [`Backend::await_output`]; if there is none, the next wait ends at once.
    fn interrupt_output(&self) {}

    /// Clears the halt of the endpoint to the host after a stall. None of its transfers is submitted.
    fn clear_input_halt(&self);

    /// Clears the halt of the endpoint to the device after a stall. Its transfer is not submitted.
    fn clear_output_halt(&self);

    /// Releases the device to the system. No transfer is submitted any more.
    fn release(&self);
}

//! The interface between a [`Pipe`](super::Pipe), which is an open device with its queue of reports, and the system
//! that transfers the reports: libusb or Windows' HID driver.

use std::time::Duration;

use super::REPORT_LEN;
use super::error::UsbError;

/// How a transfer has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outcome {
    /// The transfer is complete, possibly with fewer bytes than requested.
    Done,
    /// The transfer was cancelled; some bytes may have been transferred.
    Cancelled,
    /// The device was unplugged.
    Gone,
    /// The endpoint has stalled.
    #[cfg_attr(windows, allow(dead_code, reason = "Windows does not tell a stall from other errors"))]
    Stalled,
    /// The transfer failed on the wire for another reason.
    Failed,
}

/// Receives the end of each transfer from the backend. The pipe's state implements it.
pub(super) trait TransferListener: Send + Sync {
    /// Transfer `number` to the host ([`Backend::submit_input`]) has ended and has transferred `bytes`. `resubmit`
    /// submits this transfer again. The listener may call `resubmit` only before it returns, because the backend reuses
    /// the transfer's memory.
    fn input_ended(&self, number: usize, outcome: Outcome, bytes: &[u8], resubmit: &dyn Fn() -> Result<(), UsbError>);
    /// The transfer to the device has ended. `moved` is the number of bytes transferred.
    fn output_ended(&self, outcome: Outcome, moved: usize);
    /// A call of [`Self::input_ended`] or [`Self::output_ended`] has panicked. So it is unknown whether the pipe has
    /// counted that transfer as ended, and no thread may wait for its end any more.
    #[cfg_attr(windows, allow(dead_code, reason = "there a thread of this crate calls, and no foreign code"))]
    fn panicked(&self);
}

/// Transfers the reports of an open device. Every submitted transfer ends. Its end is reported to the listener in a
/// call of [`Backend::handle_events`] or [`Backend::await_output`], by the thread that makes this call. A backend is
/// dropped only after all its transfers have ended.
pub(super) trait Backend: Send + Sync {
    /// The number of transfers to the host that are submitted at the same time.
    fn inputs(&self) -> usize;

    /// Submits transfer `number` to the host.
    fn submit_input(&self, number: usize) -> Result<(), UsbError>;

    /// Whether a waiting call may run [`Self::handle_events`] itself, which saves a context switch. On Windows only the
    /// pipe's own thread handles events, because programs may end their threads by force. The result of a transfer
    /// would be lost with a thread that ends while it handles events.
    fn lets_calls_handle_events(&self) -> bool {
        true
    }

    /// Sets the length of the queue in which the system keeps the newest reports while no transfer to the host is
    /// submitted; `None`: the maximum. Returns `false` if the system does not allow that length. The caller makes sure
    /// that the queue is empty during the call, so that the change of its length drops no report.
    fn set_system_queue(&self, reports: Option<usize>) -> bool;

    /// Whether the device is still connected, for a caller that would not notice the loss because no transfer to the
    /// host is submitted. Does not wait for the device.
    fn is_there(&self) -> bool {
        true
    }

    /// Submits the transfer of a report to the device.
    ///
    /// # Safety
    /// An earlier transfer to the device has ended, and no other thread calls this function at the same time.
    unsafe fn submit_output(&self, report: &[u8; REPORT_LEN]) -> Result<(), UsbError>;

    /// Cancels all transfers to the host. Each of them ends soon, and the listener is called for it.
    fn cancel_inputs(&self);

    /// Cancels the transfer to the device, which then ends soon. Has no effect if none is submitted.
    fn cancel_output(&self);

    /// Calls the listener for transfers that have ended. If none has ended, waits for the end of a transfer for at most
    /// `limit`, or until [`Self::interrupt`].
    fn handle_events(&self, limit: Duration) -> Result<(), UsbError>;

    /// Ends the wait in [`Backend::handle_events`], from another thread.
    fn interrupt(&self);

    /// Whether [`Self::handle_events`] does not report the end of the transfer to the device. The thread of the program
    /// that writes then has to wait for it in [`Backend::await_output`].
    fn waits_for_output_apart(&self) -> bool {
        false
    }

    /// Waits for the end of the transfer to the device for at most the limit, or until [`Self::interrupt_output`], and
    /// calls the listener.
    fn await_output(&self, _limit: Duration) -> Result<(), UsbError> {
        Ok(())
    }

    /// Ends the wait in [`Backend::await_output`]; if there is none, the next wait ends at once.
    fn interrupt_output(&self) {}

    /// Clears the halt of the endpoint to the host after a stall. The endpoint has no submitted transfer.
    fn clear_input_halt(&self);

    /// Clears the halt of the endpoint to the device after a stall. The endpoint has no submitted transfer.
    fn clear_output_halt(&self);

    /// Releases the device, so that other programs can use it. No transfer is submitted afterwards.
    fn release(&self);
}

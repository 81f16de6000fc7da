//! The seam between a pipe and the system that moves its reports.

use std::time::Duration;

use super::REPORT_LEN;
use super::error::UsbError;

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
    #[cfg_attr(windows, allow(dead_code, reason = "Windows does not say so"))]
    Stalled,
    /// Something else went wrong on the wire.
    Failed,
}

/// Who is told when a transfer has ended.
pub(super) trait Ended: Send + Sync {
    /// The transfer to the host of that number has ended; `again` hands it over once more, within this call or not at all.
    fn input(&self, number: usize, outcome: Outcome, bytes: &[u8], again: &dyn Fn() -> Result<(), UsbError>);
    /// The transfer to the device has ended; so many bytes were moved.
    fn output(&self, outcome: Outcome, moved: usize);
    /// It has panicked while it was told something: whether that transfer counts as ended is not known.
    #[cfg_attr(windows, allow(dead_code, reason = "there it is told by a thread of ours"))]
    fn defective(&self);
}

/// What moves the reports of an open device. Every transfer that is handed over ends, which the listener is told by the
/// thread in [`Line::handle_events`], or in [`Line::await_output`]; a line is dropped after all have.
pub(super) trait Line: Send + Sync {
    /// How many transfers to the host it has.
    fn inputs(&self) -> usize;

    /// Hands over the transfer to the host of that number.
    fn begin_input(&self, number: usize) -> Result<(), UsbError>;

    /// Says how many reports the system is to keep itself, the newest, while no transfer to the host is handed over; `None`:
    /// as many as it can. False: it keeps none, or not so many. No report lies with it meanwhile.
    fn keep(&self, reports: Option<usize>) -> bool;

    /// Hands over a report to the device.
    ///
    /// # Safety
    /// The transfer to the device has ended, if it was handed over before, and no other thread is here.
    unsafe fn begin_output(&self, report: &[u8; REPORT_LEN]) -> Result<(), UsbError>;

    /// Asks for the transfers to the host to end soon.
    fn cancel_inputs(&self);

    /// Asks for the transfer to the device to end soon; without effect if it is not under way.
    fn cancel_output(&self);

    /// Tells the listener what has ended; waits for that so long, or until it is interrupted.
    fn handle_events(&self, limit: Duration) -> Result<(), UsbError>;

    /// Ends the wait in [`Line::handle_events`].
    fn interrupt(&self);

    /// Whether the end of the transfer to the device is no event: whoever writes waits for it, in [`Line::await_output`].
    fn has_output_apart(&self) -> bool {
        false
    }

    /// Waits for the end of the transfer to the device so long, or until it is interrupted, and tells the listener.
    fn await_output(&self, _limit: Duration) -> Result<(), UsbError> {
        Ok(())
    }

    /// Ends the wait in [`Line::await_output`], or the next one.
    fn interrupt_output(&self) {}

    /// The endpoint to the host, which has stalled and has no transfer, is to send again.
    fn unstall_input(&self);

    /// The same of the endpoint to the device.
    fn unstall_output(&self);

    /// Gives the device back; none of its transfers is handed over any more.
    fn release(&self);
}

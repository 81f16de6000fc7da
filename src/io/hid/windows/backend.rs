//! The backend over Windows' HID driver, with overlapped reads and writes. This is the only file that gives Windows
//! memory which Windows uses after the call has returned.

use std::cell::UnsafeCell;
use std::ptr::{self, NonNull};
use std::sync::Arc;
use std::time::Duration;

use super::api::{Handle, Overlapped};
use super::bus::Device;
use super::find::ReportInterface;
use super::handle::OwnedHandle;
use super::{Backend, NUMBERED_LEN, Outcome, REPORT_LEN, TransferListener, UsbError, codes};

/// The longest queue of reports that the driver keeps for a handle without a pending read (HidD_SetNumInputBuffers);
/// its default is 32. The driver does not count the reports that it drops, so the queue is set to this maximum. \[OURS]
const DRIVER_QUEUE_MAX: usize = 512;
/// The shortest queue of reports that the driver accepts.
const DRIVER_QUEUE_MIN: usize = 2;

struct OverlappedBackend {
    inputs: Vec<Transfer>,
    output: Transfer,
    /// The completion port at which the ends of transfers to the host are reported.
    port: OwnedHandle,
    /// The event that is set at the end of the transfer to the device. The completion port is not used for this,
    /// because it would take two more system calls, which under Wine cost a good part of the time of a write.
    output_ended: OwnedHandle,
    /// The event that ends the wait for `output_ended` early.
    output_interrupted: OwnedHandle,
    handle: Arc<OwnedHandle>,
    listener: Arc<dyn TransferListener>,
}

impl Device {
    /// Opens the device in shared mode: other programs may open it too, and every handle gets every report.
    pub fn open_backend(
        &self,
        _interface: ReportInterface,
        transfers: usize,
        listener: &Arc<impl TransferListener + 'static>,
    ) -> Result<Arc<dyn Backend>, UsbError> {
        let handle = Arc::new(OwnedHandle::open(&self.bus, &self.path, true)?);
        let port = handle.port()?;
        let [output_ended, output_interrupted] = [OwnedHandle::event(&self.bus)?, OwnedHandle::event(&self.bus)?];
        let inputs = (0..transfers).map(|_| Transfer::new(ptr::null_mut())).collect();
        // The lowest bit of the event handle tells Windows not to report the end of this transfer at the completion
        // port.
        let output = Transfer::new(output_ended.raw().map_addr(|address| address | 1));
        let backend = OverlappedBackend {
            inputs,
            output,
            port,
            output_ended,
            output_interrupted,
            handle,
            listener: listener.clone(),
        };
        // A failure is ignored: the device also works with the driver's default queue, which holds fewer reports.
        backend.set_system_queue(None);
        Ok(Arc::new(backend))
    }
}

/// A transfer of one report. While it is submitted, Windows owns its buffer.
struct Transfer {
    /// A leaked box: its address must not change, since Windows keeps it.
    inner: NonNull<Inner>,
}

/// The memory of a transfer. `overlapped` is the first field, whose address Windows returns at the end of the transfer.
#[repr(C)]
struct Inner {
    overlapped: UnsafeCell<Overlapped>,
    buffer: UnsafeCell<[u8; NUMBERED_LEN]>,
}

// SAFETY: Windows accesses the overlapped structure and the buffer while the transfer is submitted, otherwise only
// `submit_output` and `ended` do.
unsafe impl Send for Transfer {}
// SAFETY: Windows accesses the overlapped structure and the buffer while the transfer is submitted, otherwise only
// `submit_output` and `ended` do.
unsafe impl Sync for Transfer {}

impl Transfer {
    /// Creates a transfer. `event` is set at the end of the transfer; null for none.
    fn new(event: Handle) -> Self {
        let overlapped = Overlapped { internal: 0, internal_high: 0, offset: 0, offset_high: 0, event };
        let inner = Inner { overlapped: overlapped.into(), buffer: [0; NUMBERED_LEN].into() };
        Self { inner: NonNull::from(Box::leak(Box::new(inner))) }
    }

    fn inner(&self) -> &Inner {
        // SAFETY: the box is freed in `drop` only, and no other code makes unique references to it.
        unsafe { self.inner.as_ref() }
    }

    fn overlapped(&self) -> *mut Overlapped {
        self.inner().overlapped.get()
    }

    fn buffer(&self) -> *mut u8 {
        self.inner().buffer.get().cast()
    }
}

impl Drop for Transfer {
    fn drop(&mut self) {
        // SAFETY: the pointer came from a box, and a backend is dropped after all its transfers have ended.
        drop(unsafe { Box::from_raw(self.inner.as_ptr()) });
    }
}

impl OverlappedBackend {
    /// Evaluates the return value of ReadFile or WriteFile: whether the transfer was submitted.
    fn submitted(&self, done: i32) -> Result<(), UsbError> {
        // If the transfer has completed at once, its end is still reported like the end of any other transfer.
        if done != 0 {
            return Ok(());
        }
        match self.handle.bus().last_error() {
            codes::PENDING => Ok(()),
            code => Err(codes::submit_error(code)),
        }
    }

    fn read(&self, transfer: &Transfer) -> Result<(), UsbError> {
        let read = self.handle.bus().api().read_file;
        // SAFETY: the transfer is not submitted; it lives until `drop`, which is after its end is reported.
        let done = unsafe {
            read(self.handle.raw(), transfer.buffer(), NUMBERED_LEN as u32, ptr::null_mut(), transfer.overlapped())
        };
        self.submitted(done)
    }

    /// Waits for the end of a transfer to the host for at most `limit_ms` and calls the listener. Returns `false` if
    /// none has ended.
    fn next_event(&self, limit_ms: u32) -> Result<bool, UsbError> {
        let (mut moved, mut key, mut overlapped) = (0, 0, ptr::null_mut());
        let next = self.handle.bus().api().next_completion;
        // SAFETY: the port is open until `drop`; the other arguments receive the result.
        let good = unsafe { next(self.port.raw(), &raw mut moved, &raw mut key, &raw mut overlapped, limit_ms) } != 0;
        let code = if good { 0 } else { self.handle.bus().last_error() };
        if overlapped.is_null() {
            // The wait was interrupted, no transfer has ended yet, or the completion port has failed.
            return if good || code == codes::NOTHING_YET { Ok(false) } else { Err(codes::open_error(code)) };
        }
        self.ended(overlapped, codes::outcome(code), moved as usize);
        Ok(true)
    }

    fn cancel(&self, transfer: &Transfer) {
        // SAFETY: handle and transfer are valid until `drop`. Windows ignores the call if the transfer is not under
        // way.
        unsafe { (self.handle.bus().api().cancel)(self.handle.raw(), transfer.overlapped()) };
    }

    /// Handles the end of the transfer to the host whose first field is at `overlapped`: calls the listener.
    fn ended(&self, overlapped: *mut Overlapped, outcome: Outcome, moved: usize) {
        let moved = moved.min(NUMBERED_LEN);
        let Some(number) = self.inputs.iter().position(|input| input.overlapped() == overlapped) else { return };
        let input = &self.inputs[number];
        // SAFETY: the transfer has ended, and no other thread handles events meanwhile. The bytes are copied, since the
        // listener may submit the transfer again while it uses them.
        let bytes = unsafe { *input.inner().buffer.get() };
        // The board uses no report ids, so a report with an id does not come from it.
        let report = if bytes[0] == 0 { bytes.get(1..moved).unwrap_or_default() } else { &[] };
        self.listener.input_ended(number, outcome, report, &|| self.read(input));
    }
}

/// Converts a limit to whole milliseconds, Windows' unit for waits, rounded up.
fn milliseconds(limit: Duration) -> u32 {
    u32::try_from(limit.as_micros().div_ceil(1000)).unwrap_or(u32::MAX - 1)
}

impl Backend for OverlappedBackend {
    fn inputs(&self) -> usize {
        self.inputs.len()
    }

    fn submit_input(&self, number: usize) -> Result<(), UsbError> {
        self.read(self.inputs.get(number).ok_or(UsbError::Invalid)?)
    }

    fn lets_calls_handle_events(&self) -> bool {
        false
    }

    fn set_system_queue(&self, reports: Option<usize>) -> bool {
        let reports = reports.unwrap_or(DRIVER_QUEUE_MAX);
        let set = self.handle.bus().api().set_input_buffers;
        // SAFETY: the handle is open until `drop`.
        (DRIVER_QUEUE_MIN..=DRIVER_QUEUE_MAX).contains(&reports)
            && unsafe { set(self.handle.raw(), reports as u32) } != 0
    }

    fn is_there(&self) -> bool {
        let (api, mut preparsed) = (self.handle.bus().api(), ptr::null_mut());
        // SAFETY: the handle is open until `drop`; the preparsed data that Windows allocates are freed once.
        unsafe {
            let there = (api.preparsed)(self.handle.raw(), &raw mut preparsed) != 0;
            if there {
                (api.free_preparsed)(preparsed);
            }
            there
        }
    }

    unsafe fn submit_output(&self, report: &[u8; REPORT_LEN]) -> Result<(), UsbError> {
        let write = self.handle.bus().api().write_file;
        // SAFETY: by the caller's promise the transfer is not submitted, and no other thread calls this function. The first
        // byte, the report id, stays 0.
        let done = unsafe {
            let (buffer, overlapped) = (self.output.buffer(), self.output.overlapped());
            buffer.add(1).copy_from_nonoverlapping(report.as_ptr(), REPORT_LEN);
            write(self.handle.raw(), buffer, NUMBERED_LEN as u32, ptr::null_mut(), overlapped)
        };
        self.submitted(done)
    }

    fn cancel_inputs(&self) {
        self.inputs.iter().for_each(|input| self.cancel(input));
    }

    fn cancel_output(&self) {
        self.cancel(&self.output);
    }

    fn handle_events(&self, limit: Duration) -> Result<(), UsbError> {
        let mut limit = milliseconds(limit);
        // Handles all transfers that have ended. The number of rounds is limited, because the listener may submit a
        // transfer again, which may end during the loop.
        for _ in 0..=self.inputs.len() {
            if !self.next_event(limit)? {
                break;
            }
            limit = 0;
        }
        Ok(())
    }

    fn interrupt(&self) {
        // SAFETY: the port is open until `drop`.
        unsafe { (self.handle.bus().api().post_completion)(self.port.raw(), 0, 0, ptr::null_mut()) };
    }

    fn waits_for_output_apart(&self) -> bool {
        true
    }

    fn await_output(&self, limit: Duration) -> Result<(), UsbError> {
        let api = self.handle.bus().api();
        let events = [self.output_ended.raw(), self.output_interrupted.raw()];
        // SAFETY: both events are open until `drop`.
        match unsafe { (api.wait_any)(events.len() as u32, events.as_ptr(), 0, milliseconds(limit)) } {
            0 => {}
            1 | codes::NOTHING_YET => return Ok(()),
            _ => return Err(codes::open_error(self.handle.bus().last_error())),
        }
        let mut moved = 0;
        // SAFETY: handle and transfer are valid until `drop`, and the transfer has ended.
        let good =
            unsafe { (api.transfer_result)(self.handle.raw(), self.output.overlapped(), &raw mut moved, 0) } != 0;
        let code = if good { 0 } else { self.handle.bus().last_error() };
        // The transferred bytes begin with the report id, which does not count as part of the report.
        let moved = (moved as usize).min(NUMBERED_LEN).saturating_sub(1);
        self.listener.output_ended(codes::outcome(code), moved);
        Ok(())
    }

    fn interrupt_output(&self) {
        // SAFETY: the event is open until `drop`.
        unsafe { (self.handle.bus().api().set_event)(self.output_interrupted.raw()) };
    }

    // Nothing to do: Windows' driver clears the halt of a stalled endpoint itself.
    fn clear_input_halt(&self) {}

    fn clear_output_halt(&self) {}

    // The handle is closed when the backend is dropped, since other threads may still be in a call with it.
    fn release(&self) {}
}

//! Windows' overlapped transfers: the one file that hands it memory.

use std::cell::UnsafeCell;
use std::ptr::{self, NonNull};
use std::sync::Arc;
use std::time::Duration;

use super::api::{Handle, Overlapped};
use super::bus::Device;
use super::find::Shape;
use super::handle::Owned;
use super::{Ended, Line, NUMBERED_LEN, Outcome, REPORT_LEN, UsbError, codes};

/// The most reports that the driver keeps for a handle that has no read under way (HidD_SetNumInputBuffers); its default
/// is 32. What it drops nobody counts, so it is to keep as much as it can. \[OURS]
const DRIVER_KEEPS: usize = 512;
/// The fewest that it may be told to keep.
const DRIVER_KEEPS_AT_LEAST: usize = 2;

/// A line by Windows' HID driver.
struct Overlapping {
    inputs: Vec<Transfer>,
    output: Transfer,
    /// Where the ends of transfers to the host are told.
    port: Owned,
    /// Set at the end of the transfer to the device. To wait for it at the port would ask the system two times more, and under
    /// Wine each of them takes a good part of the time of a write.
    written: Owned,
    /// Set to interrupt that wait.
    woken: Owned,
    handle: Arc<Owned>,
    listener: Arc<dyn Ended>,
}

impl Device {
    /// Opens it, shared: every handle gets every report.
    pub fn line(
        &self,
        _shape: Shape,
        transfers: usize,
        listener: &Arc<impl Ended + 'static>,
    ) -> Result<Arc<dyn Line>, UsbError> {
        let handle = Arc::new(Owned::open(&self.bus, &self.path, true)?);
        let port = handle.port()?;
        let [written, woken] = [Owned::event(&self.bus)?, Owned::event(&self.bus)?];
        let inputs = (0..transfers).map(|_| Transfer::new(ptr::null_mut())).collect();
        // With the lowest bit set the port is told nothing.
        let output = Transfer::new(written.raw().map_addr(|address| address | 1));
        let line = Overlapping { inputs, output, port, written, woken, handle, listener: listener.clone() };
        // A driver that keeps fewer is no reason not to open it.
        line.keep(None);
        Ok(Arc::new(line))
    }
}

/// A transfer of one report. While Windows has it, its buffer is Windows'.
struct Transfer {
    /// From a box, which has to stay where it is: Windows knows its address.
    inner: NonNull<Inner>,
}

/// Windows gives the address of the first field back.
#[repr(C)]
struct Inner {
    overlapped: UnsafeCell<Overlapped>,
    buffer: UnsafeCell<[u8; NUMBERED_LEN]>,
}

// SAFETY: overlapped structure and buffer are touched by whoever has the transfer: see `begin_output` and `ended`.
unsafe impl Send for Transfer {}
// SAFETY: as above.
unsafe impl Sync for Transfer {}

impl Transfer {
    /// `event`: what is told of its end besides the port, or instead.
    fn new(event: Handle) -> Self {
        let overlapped = Overlapped { internal: 0, internal_high: 0, offset: 0, offset_high: 0, event };
        let inner = Inner { overlapped: overlapped.into(), buffer: [0; NUMBERED_LEN].into() };
        Self { inner: NonNull::from(Box::leak(Box::new(inner))) }
    }

    fn inner(&self) -> &Inner {
        // SAFETY: it is there until `drop`, and only shared references to it are made.
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
        // SAFETY: it came from a box; a line is dropped after all its transfers have ended.
        drop(unsafe { Box::from_raw(self.inner.as_ptr()) });
    }
}

impl Overlapping {
    /// Whether a transfer was handed over, by what the function for it gave back.
    fn handed_over(&self, done: i32) -> Result<(), UsbError> {
        // One that is done at once is told at the port too.
        if done != 0 {
            return Ok(());
        }
        match self.handle.bus().last_error() {
            codes::PENDING => Ok(()),
            code => Err(codes::refused(code)),
        }
    }

    fn read(&self, transfer: &Transfer) -> Result<(), UsbError> {
        let read = self.handle.bus().api().read_file;
        // SAFETY: Windows does not have the transfer, and then has it until its end is told; it stays until `drop`.
        let done = unsafe {
            read(self.handle.raw(), transfer.buffer(), NUMBERED_LEN as u32, ptr::null_mut(), transfer.overlapped())
        };
        self.handed_over(done)
    }

    /// Waits for the end of a transfer, in milliseconds, and tells the listener. False: there was none.
    fn next_event(&self, limit_ms: u32) -> Result<bool, UsbError> {
        let (mut moved, mut key, mut overlapped) = (0, 0, ptr::null_mut());
        let next = self.handle.bus().api().next_completion;
        // SAFETY: the port is open until `drop`; the others take what is said.
        let good = unsafe { next(self.port.raw(), &raw mut moved, &raw mut key, &raw mut overlapped, limit_ms) } != 0;
        let code = if good { 0 } else { self.handle.bus().last_error() };
        if overlapped.is_null() {
            // Interrupted, nothing yet, or the port is no good.
            return if good || code == codes::NOTHING_YET { Ok(false) } else { Err(codes::error(code)) };
        }
        self.ended(overlapped, codes::outcome(code), moved as usize);
        Ok(true)
    }

    fn cancel(&self, transfer: &Transfer) {
        // SAFETY: the handle is open and the transfer there until `drop`. One that is not under way is not found.
        unsafe { (self.handle.bus().api().cancel)(self.handle.raw(), transfer.overlapped()) };
    }

    /// Tells the listener that the transfer to the host has ended which begins with `overlapped`.
    fn ended(&self, overlapped: *mut Overlapped, outcome: Outcome, moved: usize) {
        let moved = moved.min(NUMBERED_LEN);
        let Some(number) = self.inputs.iter().position(|input| input.overlapped() == overlapped) else { return };
        let input = &self.inputs[number];
        // SAFETY: Windows has given the transfer back, and no other thread takes one meanwhile. It is copied, since the
        // listener may hand the transfer over again while it has the bytes.
        let bytes = unsafe { *input.inner().buffer.get() };
        // A report of another number is none of the board's.
        let report = if bytes[0] == 0 { bytes.get(1..moved).unwrap_or_default() } else { &[] };
        self.listener.input(number, outcome, report, &|| self.read(input));
    }
}

/// Windows waits for whole milliseconds.
fn milliseconds(limit: Duration) -> u32 {
    u32::try_from(limit.as_micros().div_ceil(1000)).unwrap_or(u32::MAX - 1)
}

impl Line for Overlapping {
    fn inputs(&self) -> usize {
        self.inputs.len()
    }

    fn begin_input(&self, number: usize) -> Result<(), UsbError> {
        self.read(self.inputs.get(number).ok_or(UsbError::Invalid)?)
    }

    fn keep(&self, reports: Option<usize>) -> bool {
        let reports = reports.unwrap_or(DRIVER_KEEPS);
        let set = self.handle.bus().api().set_input_buffers;
        // SAFETY: the handle is open until `drop`.
        (DRIVER_KEEPS_AT_LEAST..=DRIVER_KEEPS).contains(&reports)
            && unsafe { set(self.handle.raw(), reports as u32) } != 0
    }

    unsafe fn begin_output(&self, report: &[u8; REPORT_LEN]) -> Result<(), UsbError> {
        let write = self.handle.bus().api().write_file;
        // SAFETY: by the caller's promise Windows does not have the transfer, and this thread is alone. The number of the
        // report is 0 from the start.
        let done = unsafe {
            let (buffer, overlapped) = (self.output.buffer(), self.output.overlapped());
            buffer.add(1).copy_from_nonoverlapping(report.as_ptr(), REPORT_LEN);
            write(self.handle.raw(), buffer, NUMBERED_LEN as u32, ptr::null_mut(), overlapped)
        };
        self.handed_over(done)
    }

    fn cancel_inputs(&self) {
        self.inputs.iter().for_each(|input| self.cancel(input));
    }

    fn cancel_output(&self) {
        self.cancel(&self.output);
    }

    fn handle_events(&self, limit: Duration) -> Result<(), UsbError> {
        let mut limit = milliseconds(limit);
        // All that have ended, each transfer once at most.
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

    fn has_output_apart(&self) -> bool {
        true
    }

    fn await_output(&self, limit: Duration) -> Result<(), UsbError> {
        let api = self.handle.bus().api();
        let events = [self.written.raw(), self.woken.raw()];
        // SAFETY: both are open until `drop`.
        match unsafe { (api.wait_any)(events.len() as u32, events.as_ptr(), 0, milliseconds(limit)) } {
            0 => {}
            1 | codes::NOTHING_YET => return Ok(()),
            _ => return Err(codes::error(self.handle.bus().last_error())),
        }
        let mut moved = 0;
        // SAFETY: the handle is open and the transfer there until `drop`; its end has been told.
        let good =
            unsafe { (api.transfer_result)(self.handle.raw(), self.output.overlapped(), &raw mut moved, 0) } != 0;
        let code = if good { 0 } else { self.handle.bus().last_error() };
        // The number is no part of the report.
        let moved = (moved as usize).min(NUMBERED_LEN).saturating_sub(1);
        self.listener.output(codes::outcome(code), moved);
        Ok(())
    }

    fn interrupt_output(&self) {
        // SAFETY: it is open until `drop`.
        unsafe { (self.handle.bus().api().set_event)(self.woken.raw()) };
    }

    // The driver sees to stalls by itself.
    fn unstall_input(&self) {}

    fn unstall_output(&self) {}

    // The handle is closed when the line is dropped: other threads may be in a call with it.
    fn release(&self) {}
}

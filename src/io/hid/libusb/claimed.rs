//! An interface that this process has taken, with its transfers.

use std::sync::Arc;
use std::time::Duration;

use parking_lot::Mutex;

use super::bus::{Device, Handle};
use super::transfer::Transfer;
use super::{Ended, Line, REPORT_LEN, Shape, UsbError};

/// A line by libusb.
struct Claimed {
    inputs: Vec<Transfer>,
    output: Transfer,
    claim: Mutex<Option<Claim>>,
    handle: Arc<Handle>,
    shape: Shape,
}

impl Device {
    /// Opens it and takes it from the kernel's driver, which has it again when it is released.
    pub(in crate::io::hid) fn line(
        &self,
        shape: Shape,
        transfers: usize,
        listener: &Arc<impl Ended + 'static>,
    ) -> Result<Arc<dyn Line>, UsbError> {
        let handle = Arc::new(self.open()?);
        match handle.detach_driver_by_itself() {
            // Where the kernel has no driver there is nothing to detach.
            Ok(()) | Err(UsbError::NotSupported) => {}
            Err(error) => return Err(error),
        }
        let claim = Mutex::new(Some(Claim::new(&handle, shape.interface)?));
        let transfer =
            |endpoint, number| Transfer::new(&handle, endpoint, number, listener.clone()).ok_or(UsbError::NoMemory);
        let inputs = (0..transfers).map(|number| transfer(shape.input, number)).collect::<Result<Vec<_>, _>>()?;
        let output = transfer(shape.output, 0)?;
        Ok(Arc::new(Claimed { inputs, output, claim, handle, shape }))
    }
}

impl Line for Claimed {
    fn inputs(&self) -> usize {
        self.inputs.len()
    }

    fn begin_input(&self, number: usize) -> Result<(), UsbError> {
        self.inputs.get(number).ok_or(UsbError::Invalid)?.hand_over()
    }

    // What is on the wire while no transfer waits for it is lost.
    fn keep(&self, _reports: Option<usize>) -> bool {
        false
    }

    unsafe fn begin_output(&self, report: &[u8; REPORT_LEN]) -> Result<(), UsbError> {
        // SAFETY: by the caller's promise libusb does not have it, and this thread is alone.
        unsafe { self.output.fill(report) };
        self.output.hand_over()
    }

    fn cancel_inputs(&self) {
        self.inputs.iter().for_each(Transfer::cancel);
    }

    fn cancel_output(&self) {
        self.output.cancel();
    }

    fn handle_events(&self, limit: Duration) -> Result<(), UsbError> {
        self.handle.bus().handle_events(limit)
    }

    fn interrupt(&self) {
        self.handle.bus().interrupt();
    }

    fn unstall_input(&self) {
        // If it stalls for good whoever waits next is told so.
        let _ = self.handle.clear_halt(self.shape.input);
    }

    fn unstall_output(&self) {
        // If it stalls for good the next report says so again.
        let _ = self.handle.clear_halt(self.shape.output);
    }

    fn release(&self) {
        drop(self.claim.lock().take());
    }
}

/// An interface that this process has.
struct Claim {
    handle: Arc<Handle>,
    interface: u8,
}

impl Claim {
    fn new(handle: &Arc<Handle>, interface: u8) -> Result<Self, UsbError> {
        handle.claim(interface)?;
        Ok(Self { handle: handle.clone(), interface })
    }
}

impl Drop for Claim {
    fn drop(&mut self) {
        // A device that is gone has nothing to release.
        let _ = self.handle.release(self.interface);
    }
}

//! Implements [`Backend`] over libusb: one claimed interface of a device, with the transfers of its two endpoints.

use std::sync::Arc;
use std::time::Duration;

use parking_lot::Mutex;

use super::bus::{Device, Handle};
use super::transfer::UsbTransfer;
use super::{Backend, REPORT_LEN, ReportInterface, TransferListener, UsbError};

struct LibusbBackend {
    inputs: Vec<UsbTransfer>,
    output: UsbTransfer,
    claim: Mutex<Option<InterfaceClaim>>,
    handle: Arc<Handle>,
    interface: ReportInterface,
}

impl Device {
    /// Opens the device and claims its interface. The kernel's driver is detached from the interface until the backend
    /// releases it.
    pub(in crate::io::hid) fn open_backend(
        &self,
        interface: ReportInterface,
        transfers: usize,
        listener: &Arc<impl TransferListener + 'static>,
    ) -> Result<Arc<dyn Backend>, UsbError> {
        let handle = Arc::new(self.open()?);
        match handle.detach_driver_by_itself() {
            // libusb cannot detach drivers on this system: here no kernel driver keeps a program from claiming the
            // interface.
            Ok(()) | Err(UsbError::NotSupported) => {}
            Err(error) => return Err(error),
        }
        let claim = Mutex::new(Some(InterfaceClaim::new(&handle, interface.number)?));
        let transfer =
            |endpoint, number| UsbTransfer::new(&handle, endpoint, number, listener.clone()).ok_or(UsbError::NoMemory);
        let inputs = (0..transfers).map(|number| transfer(interface.input, number)).collect::<Result<Vec<_>, _>>()?;
        let output = transfer(interface.output, 0)?;
        Ok(Arc::new(LibusbBackend { inputs, output, claim, handle, interface }))
    }
}

impl Backend for LibusbBackend {
    fn inputs(&self) -> usize {
        self.inputs.len()
    }

    fn submit_input(&self, number: usize) -> Result<(), UsbError> {
        self.inputs.get(number).ok_or(UsbError::Invalid)?.submit()
    }

    // libusb has no queue of reports in the system: a report that comes while no transfer is submitted is lost.
    fn set_system_queue(&self, _reports: Option<usize>) -> bool {
        false
    }

    unsafe fn submit_output(&self, report: &[u8; REPORT_LEN]) -> Result<(), UsbError> {
        // SAFETY: by the caller's promise the transfer is not submitted, and no other thread calls this function.
        unsafe { self.output.fill(report) };
        self.output.submit()
    }

    fn cancel_inputs(&self) {
        self.inputs.iter().for_each(UsbTransfer::cancel);
    }

    fn cancel_output(&self) {
        self.output.cancel();
    }

    fn handle_events(&self, limit: Duration) -> Result<(), UsbError> {
        self.handle.handle_events(limit)
    }

    fn interrupt(&self) {
        self.handle.bus().interrupt();
    }

    fn clear_input_halt(&self) {
        // An error is ignored: if the endpoint still stalls, the next transfer reports it.
        let _ = self.handle.clear_halt(self.interface.input);
    }

    fn clear_output_halt(&self) {
        // An error is ignored: if the endpoint still stalls, the next transfer reports it.
        let _ = self.handle.clear_halt(self.interface.output);
    }

    fn release(&self) {
        drop(self.claim.lock().take());
    }
}

/// An interface that this process has claimed. It is released when this value is dropped.
pub(super) struct InterfaceClaim {
    handle: Arc<Handle>,
    interface: u8,
}

impl InterfaceClaim {
    pub const fn handle(&self) -> &Arc<Handle> {
        &self.handle
    }

    pub fn new(handle: &Arc<Handle>, interface: u8) -> Result<Self, UsbError> {
        handle.claim(interface)?;
        Ok(Self { handle: handle.clone(), interface })
    }
}

impl Drop for InterfaceClaim {
    fn drop(&mut self) {
        // An error is ignored: if the device was unplugged, there is nothing to release.
        let _ = self.handle.release(self.interface);
    }
}

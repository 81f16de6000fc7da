//! Endpoint 0: the standard requests and those of a HID device.

use super::{Device, TooMany};
use crate::port::usb_board::descriptors::{CONFIGURATION_VALUE, IN, OUT};
use crate::port::usb_board::setup::{Request, Setup, report};
use crate::port::usb_board::transfer::{Direction, Ends, Status, Transfer};
use crate::sk::FRAME_LEN;

/// The answer to GET_STATUS of a halted endpoint: bit 0, Halt, is set.
const HALTED: u8 = 1;
/// bAlternateSetting of the only setting of the interface, which GET_INTERFACE returns.
const ALTERNATE: u8 = 0;
/// The report id in requests about reports, which must be 0: the board's reports are not numbered (SK-9).
const NO_ID: u8 = 0;

impl<E: Ends> Device<E> {
    pub(super) fn control(&mut self, transfer: &Transfer, data: &[u8]) -> Result<(), TooMany> {
        let setup = Setup::parse(transfer.setup);
        // A request without a data stage is an OUT transfer, whatever its direction bit says.
        let to_host = setup.to_host && setup.length > 0;
        if to_host != (transfer.direction == Direction::In) {
            self.refuse(transfer);
            return Ok(());
        }
        let room = usize::from(setup.length).min(transfer.length as usize);
        match setup.request {
            Request::GetDescriptor { kind, index } => match self.descriptors.get(kind, index) {
                Some(descriptor) => answer(&mut self.ends, transfer, room, descriptor),
                None => self.refuse(transfer),
            },
            // The status word 0: the device is not self-powered and has no remote wake-up.
            Request::GetStatus => answer(&mut self.ends, transfer, room, &[0, 0]),
            Request::GetEndpointStatus(endpoint) => match self.halt_of(endpoint) {
                Some(halted) => {
                    let status = if *halted { HALTED } else { 0 };
                    answer(&mut self.ends, transfer, room, &[status, 0]);
                }
                None => self.refuse(transfer),
            },
            Request::SetHalt { endpoint, halted } => match self.halt_of(endpoint) {
                Some(halt) => {
                    *halt = halted;
                    self.done(transfer);
                }
                None => self.refuse(transfer),
            },
            // The address was assigned before: by the host's controller (USB/IP), or by this machine's device
            // controller. This request changes nothing.
            Request::SetAddress => self.done(transfer),
            Request::GetConfiguration => {
                let value = if self.configured { CONFIGURATION_VALUE } else { 0 };
                answer(&mut self.ends, transfer, room, &[value]);
            }
            Request::SetConfiguration(value @ (0 | CONFIGURATION_VALUE)) => {
                self.configured = value == CONFIGURATION_VALUE;
                self.halted = super::Halted::default();
                self.done(transfer);
            }
            Request::GetInterface => answer(&mut self.ends, transfer, room, &[ALTERNATE]),
            Request::SetInterface(0) => self.done(transfer),
            Request::GetIdle => answer(&mut self.ends, transfer, room, &[self.idle]),
            // The idle rate is stored without effect, because the board makes a report in every cycle. [OURS]
            Request::SetIdle(idle) => {
                self.idle = idle;
                self.done(transfer);
            }
            // [OURS] The answer is the newest report that was read for the host.
            Request::GetReport { kind: report::INPUT, id: NO_ID } => {
                answer(&mut self.ends, transfer, room, self.report.bytes());
            }
            // [OURS] A whole report is a command frame as on the OUT endpoint; any other length is refused.
            Request::SetReport { kind: report::OUTPUT, id: NO_ID } if data.len() == FRAME_LEN && self.configured => {
                return self.submit_write(transfer.sequence, data);
            }
            Request::SetConfiguration(_)
            | Request::SetInterface(_)
            | Request::GetReport { .. }
            | Request::SetReport { .. }
            | Request::Unknown => self.refuse(transfer),
        }
        Ok(())
    }

    fn done(&mut self, transfer: &Transfer) {
        answer(&mut self.ends, transfer, 0, &[]);
    }

    fn refuse(&mut self, transfer: &Transfer) {
        self.counters.refused += 1;
        self.stall(transfer.sequence);
    }

    fn halt_of(&mut self, endpoint: u8) -> Option<&mut bool> {
        match endpoint {
            IN => Some(&mut self.halted.reads),
            OUT => Some(&mut self.halted.writes),
            _ => None,
        }
    }
}

/// Answers a request with as many of these bytes as the host has room for.
fn answer(ends: &mut impl Ends, transfer: &Transfer, room: usize, bytes: &[u8]) {
    let bytes = &bytes[..bytes.len().min(room)];
    ends.ended(transfer.sequence, Status::Done, bytes.len() as u32, bytes);
}

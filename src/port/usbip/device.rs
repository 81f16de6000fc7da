//! The virtual board as a host sees it over USB/IP. It is the same [`Device`](crate::port::usb_board::device::Device)
//! as on a device controller; here the results of transfers become USB/IP messages to the host.

use super::descriptors::Descriptors;
use super::wire::{self, Status, Submit};
use crate::port::usb_board::device::Device as AnyDevice;
use crate::port::usb_board::transfer::{Ends, Transfer};

pub use crate::port::usb_board::device::{Counters, TRANSFERS_AT_ONCE, TooMany};

/// The USB/IP messages that are waiting for the host, encoded one after the other.
#[derive(Debug, Default)]
pub struct Messages(Vec<u8>);

impl Ends for Messages {
    fn ended(&mut self, sequence: u32, status: Status, moved: u32, data: &[u8]) {
        wire::ret_submit(&mut self.0, sequence, status, moved, data);
    }

    fn unlinked(&mut self, sequence: u32, status: Status) {
        wire::ret_unlink(&mut self.0, sequence, status);
    }
}

/// An attached virtual board.
pub type Device = AnyDevice<Messages>;

impl AnyDevice<Messages> {
    /// Creates the device of a board that a host has just attached.
    pub fn new(descriptors: Descriptors) -> Self {
        Self::over(descriptors, Messages::default())
    }

    /// The host submits a transfer; `data` are the bytes of an OUT transfer.
    ///
    /// # Errors
    /// [`TooMany`]: the host already has too many transfers pending in this direction.
    pub fn submit(&mut self, submit: &Submit, data: &[u8]) -> Result<(), TooMany> {
        let Submit { sequence, direction, endpoint, length, setup, .. } = *submit;
        self.transfer(&Transfer { sequence, direction, endpoint, length, setup }, data)
    }

    /// Whether answers for the host are waiting to be sent.
    pub fn has_replies(&self) -> bool {
        !self.ends().0.is_empty()
    }

    /// Moves the waiting answers for the host into `to`, replacing its content.
    pub fn take_replies(&mut self, to: &mut Vec<u8>) {
        to.clear();
        std::mem::swap(to, &mut self.ends_mut().0);
    }
}

//! Processing of a datagram in a slave controller: the 15 commands.

use super::Controller;
use crate::ethercat::registers::{DL_CONTROL, DlControl, PHYSICAL_OFFSET, STATION_ADDRESS, STATION_ALIAS};
use crate::ethercat::{Addressing, Command, DatagramHeader};

/// Whether a command has read memory, and whether it has written memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Done {
    pub(super) read: bool,
    pub(super) written: bool,
}

impl Done {
    /// The increment of the working counter for a command that only reads or only writes.
    const fn single(self) -> u16 {
        (self.read || self.written) as u16
    }

    /// The increment of the working counter for a command that reads and writes.
    const fn both(self) -> u16 {
        self.read as u16 + 2 * self.written as u16
    }
}

impl Controller {
    /// Processes a datagram of a frame. Returns the increment of its working counter.
    #[inline]
    pub(super) fn pass(&mut self, header: &mut DatagramHeader, data: &mut [u8]) -> u16 {
        let command = header.command;
        let counts = match command {
            Command::Nop | Command::Unknown(_) => 0,
            Command::Lrd | Command::Lwr | Command::Lrw => self.pass_logical(header, data),
            _ => self.pass_register(header, data),
        };
        header.irq |= self.masked_events();
        counts
    }

    fn pass_register(&mut self, header: &mut DatagramHeader, data: &mut [u8]) -> u16 {
        let is_addressed = self.is_addressed(header);
        let address = usize::from(header.ado());
        if matches!(header.command.addressing(), Addressing::Position | Addressing::Broadcast) {
            *header = header.with_adp(header.adp().wrapping_add(1));
        }
        match header.command {
            Command::Armw | Command::Frmw if is_addressed => u16::from(self.read(address, data)),
            Command::Armw | Command::Frmw => u16::from(self.write(address, data)),
            _ if !is_addressed => 0,
            Command::Aprd | Command::Fprd => u16::from(self.read(address, data)),
            Command::Apwr | Command::Fpwr | Command::Bwr => u16::from(self.write(address, data)),
            Command::Aprw | Command::Fprw => {
                let offset = usize::from(self.memory.u16(PHYSICAL_OFFSET));
                self.swap(address, address + offset, data, false).both()
            }
            Command::Brd => self.read_combined(address, data),
            Command::Brw => self.swap(address, address, data, true).both(),
            _ => 0,
        }
    }

    fn is_addressed(&self, header: &DatagramHeader) -> bool {
        match header.command.addressing() {
            Addressing::None | Addressing::Logical => false,
            Addressing::Broadcast => true,
            Addressing::Position => header.adp() == 0,
            Addressing::Node => {
                header.adp() == self.memory.u16(STATION_ADDRESS)
                    || DlControl(self.memory.u32(DL_CONTROL)).uses_alias()
                        && header.adp() == self.memory.u16(STATION_ALIAS)
            }
        }
    }

    /// Takes the reusable buffer `scratch` out of the controller, filled with `len` bytes of 0. The caller puts it back after
    /// use.
    pub(super) fn take_scratch(&mut self, len: usize) -> Vec<u8> {
        let mut scratch = std::mem::take(&mut self.scratch);
        scratch.clear();
        scratch.resize(len, 0);
        scratch
    }

    /// Reads memory and ORs it into the data of the datagram (command BRD). Returns the increment of the working counter.
    fn read_combined(&mut self, address: usize, data: &mut [u8]) -> u16 {
        let mut own = self.take_scratch(data.len());
        let done = self.read(address, &mut own);
        data.iter_mut().zip(&own).for_each(|(byte, own)| *byte |= own);
        self.scratch = own;
        done.into()
    }

    /// Exchanges data: the memory at `from` goes into the datagram (`combined`: is ORed into it), and the original data are
    /// written at `to`.
    fn swap(&mut self, from: usize, to: usize, data: &mut [u8], combined: bool) -> Done {
        let mut brought = self.take_scratch(data.len());
        brought.copy_from_slice(data);
        let read = self.read(from, data);
        if combined {
            data.iter_mut().zip(&brought).for_each(|(byte, brought)| *byte |= brought);
        }
        let written = self.write(to, &brought);
        self.scratch = brought;
        Done { read, written }
    }

    #[inline]
    fn pass_logical(&mut self, header: &DatagramHeader, data: &mut [u8]) -> u16 {
        let command = header.command;
        // LRW: write before reading. If outputs and inputs share logical bytes, reading first would replace the outputs.
        let written = command != Command::Lrd && self.write_mapped(header.address, data);
        let read = command != Command::Lwr && self.read_mapped(header.address, data);
        let done = Done { read, written };
        if command == Command::Lrw { done.both() } else { done.single() }
    }
}

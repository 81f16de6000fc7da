//! What a controller does with a datagram that passes it: the 15 commands.

use super::Controller;
use super::controller::Passage;
use crate::ethercat::registers::{DL_CONTROL, DlControl, PHYSICAL_OFFSET, STATION_ADDRESS, STATION_ALIAS};
use crate::ethercat::{Addressing, Command, DatagramHeader, DatagramMut};

/// Which parts of an access were done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Done {
    pub(super) read: bool,
    pub(super) written: bool,
}

impl Done {
    /// What the working counter of a command that only reads or only writes counts.
    const fn single(self) -> u16 {
        (self.read || self.written) as u16
    }

    /// What the working counter of a command that does both counts.
    const fn both(self) -> u16 {
        self.read as u16 + 2 * self.written as u16
    }
}

impl Controller {
    /// A frame comes to the controller.
    pub fn begin_frame(&mut self, passage: Passage) {
        self.passage = passage;
        self.advance(passage.arrival);
    }

    /// A datagram of the frame passes the controller.
    pub fn pass(&mut self, datagram: &mut DatagramMut<'_>) {
        let header = datagram.header();
        let is_addressed = self.is_addressed(&header);
        let address = usize::from(header.ado());
        let counts = match header.command {
            Command::Nop | Command::Unknown(_) => 0,
            Command::Lrd | Command::Lwr | Command::Lrw => self.pass_logical(&header, datagram.data),
            Command::Armw | Command::Frmw if is_addressed => u16::from(self.read(address, datagram.data)),
            Command::Armw | Command::Frmw => u16::from(self.write(address, datagram.data)),
            _ if !is_addressed => 0,
            Command::Aprd | Command::Fprd => u16::from(self.read(address, datagram.data)),
            Command::Apwr | Command::Fpwr | Command::Bwr => u16::from(self.write(address, datagram.data)),
            Command::Aprw | Command::Fprw => {
                let offset = usize::from(self.memory.u16(PHYSICAL_OFFSET));
                self.swap(address, address + offset, datagram.data, false).both()
            }
            Command::Brd => self.read_combined(address, datagram.data),
            Command::Brw => self.swap(address, address, datagram.data, true).both(),
        };
        if counts != 0 {
            datagram.count(counts);
        }
        if matches!(header.command.addressing(), Addressing::Position | Addressing::Broadcast) {
            datagram.set_adp(header.adp().wrapping_add(1));
        }
        datagram.add_events(self.masked_events());
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

    /// Own bytes for a datagram of that length, filled with 0.
    pub(super) fn take_scratch(&mut self, len: usize) -> Vec<u8> {
        let mut scratch = std::mem::take(&mut self.scratch);
        scratch.clear();
        scratch.resize(len, 0);
        scratch
    }

    /// Reads, and combines what was read with what came by OR.
    fn read_combined(&mut self, address: usize, data: &mut [u8]) -> u16 {
        let mut own = self.take_scratch(data.len());
        let done = self.read(address, &mut own);
        data.iter_mut().zip(&own).for_each(|(byte, own)| *byte |= own);
        self.scratch = own;
        done.into()
    }

    /// Reads and writes: the datagram takes away what was there, and leaves what it brought.
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

    fn pass_logical(&mut self, header: &DatagramHeader, data: &mut [u8]) -> u16 {
        let command = header.command;
        // Outputs are taken before inputs replace them, if both have the same logical bytes.
        let written = command != Command::Lrd && self.write_mapped(header.address, data);
        let read = command != Command::Lwr && self.read_mapped(header.address, data);
        let done = Done { read, written };
        if command == Command::Lrw { done.both() } else { done.single() }
    }
}

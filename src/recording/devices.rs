//! The USB devices in a capture, and which of them is the board.

use std::collections::{BTreeMap, HashMap};
use std::fmt;

use super::address::Address;
use super::file_formats::transfer::{Stage, TransferKind, UsbEvent};
use super::pending::PendingFrames;
use super::recorded::Recorded;
use crate::sk::{BOARD_IDS, Dir, FRAME_LEN, Frame, SlotSize};

/// Length in bytes of a frame that follows a report id of 0. Hosts send frames in this form if the device has no
/// interrupt OUT endpoint.
const WITH_REPORT_ID: usize = 1 + FRAME_LEN;
/// Length in bytes of a frame with 12-byte slots, sent without padding to 512.
const NARROW: usize = SlotSize::Bytes12.frame_len();

/// HID's SET_REPORT (HID 1.11, 7.2.2): `bmRequestType` and `bRequest`, and the upper byte of `wValue` for an output
/// report.
const SET_REPORT: (u8, u8) = (0x21, 0x09);
const OUTPUT_REPORT: u8 = 2;
/// GET_DESCRIPTOR (USB 2.0, 9.4.3): `bmRequestType` and `bRequest`, and the upper byte of `wValue` for a device
/// descriptor.
const GET_DESCRIPTOR: (u8, u8) = (0x80, 0x06);
const DEVICE_DESCRIPTOR: u8 = 1;
/// In a device descriptor (USB 2.0, 9.6.1), bytes: the offset of idVendor, which idProduct follows, and the length of
/// the descriptor.
const VENDOR_AT: usize = 8;
const DEVICE_DESCRIPTOR_LEN: usize = 18;

/// The most setup packets of control transfers in flight that are remembered; at this number all are forgotten, since a
/// capture may lack the ends of transfers. \[OURS]
const MOST_SETUPS: usize = 1024;

/// A USB device in a capture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CapturedDevice {
    /// The bus and the device number, by which the capture tells devices apart.
    pub address: Address,
    /// Vendor and product id; `None` if the capture does not have the device descriptor.
    pub ids: Option<(u16, u16)>,
    /// The number of frames to the device.
    pub written: u64,
    /// The number of frames from the device.
    pub read: u64,
    /// Counts of the packets of this device that are not frames.
    others: Skipped,
}

impl CapturedDevice {
    /// How much the device looks like a board: 0 without frames or with other ids than the board's, 1 with frames in
    /// one direction, 2 with frames in both directions, 3 with frames in both directions and the board's ids. The ids
    /// alone count nothing: they are those of a hobby project, which other devices share. \[OURS]
    fn board_score(&self) -> u8 {
        match (self.ids, self.written.min(1) + self.read.min(1)) {
            (Some(ids), _) if ids != BOARD_IDS => 0,
            (Some(_), 2) => 3,
            (_, ways) => ways as u8,
        }
    }
}

/// Writes `1.5 (16c0:05df; 12 frames to it, 40 from it)`: the address, the ids, and the frames in both directions.
impl fmt::Display for CapturedDevice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} (", self.address)?;
        if let Some((vendor, product)) = self.ids {
            write!(f, "{vendor:04x}:{product:04x}; ")?;
        }
        write!(f, "{} frames to it, {} from it)", self.written, self.read)
    }
}

/// Numbers of packets in a capture that are not frames of a board. For a device with frames each reason has a count of
/// its own; the packets of all other devices are counted together in [`Self::other_devices`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Skipped {
    /// The number of frames that the board did not get, because the host cancelled the transfer or the transfer failed.
    pub taken_back: u64,
    /// The number of reads that ended without a report: cancelled, failed or empty. A program that closes its board
    /// cancels its pending reads, so a few are normal.
    pub without_report: u64,
    /// The number of interrupt transfers whose length is not that of a frame.
    pub other_lengths: u64,
    /// The number of packets of control, bulk and isochronous transfers that carry no frame.
    pub other_transfers: u64,
    /// Packets of other devices: those without frames, those whose descriptor shows that they are no board, and those
    /// that were not selected.
    pub other_devices: u64,
}

impl Skipped {
    /// The counts that may concern a user, as text: frames that the board did not get, and interrupt transfers of
    /// another length. `None` if both are 0.
    pub fn words(&self) -> Option<String> {
        let parts = [
            (self.taken_back, "frames that the board did not take"),
            (self.other_lengths, "transfers as long as no frame"),
        ];
        let parts: Vec<String> = parts.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{n} {what}")).collect();
        (!parts.is_empty()).then(|| parts.join(" and "))
    }
}

/// The devices in a capture, as far as its packets were read.
#[derive(Default)]
pub(super) struct Devices {
    devices: BTreeMap<Address, CapturedDevice>,
    /// Setup packets of control transfers in flight.
    setups: HashMap<u64, [u8; 8]>,
    /// The only device whose frames are returned; `None`: the frames of every device that may be a board are returned.
    only: Option<Address>,
}

/// The error that the capture has cut off bytes of a frame (snap length): of the `length` bytes of the transfer it has
/// only the first `captured`.
pub(super) struct Cut {
    pub captured: usize,
    pub length: u32,
}

impl Devices {
    pub fn only(&mut self, address: Address) {
        self.only = Some(address);
    }

    /// The devices, sorted by address.
    pub fn seen(&self) -> Vec<CapturedDevice> {
        self.devices.values().copied().collect()
    }

    /// The counts of packets skipped so far.
    pub fn skipped(&self) -> Skipped {
        let mut skipped = Skipped::default();
        for CapturedDevice { written, read, others, .. } in self.devices.values() {
            let Skipped { taken_back, without_report, other_lengths, other_transfers, other_devices } = *others;
            if written + read + taken_back > 0 {
                skipped.taken_back += taken_back;
                skipped.without_report += without_report;
                skipped.other_lengths += other_lengths;
                skipped.other_transfers += other_transfers;
            } else {
                skipped.other_devices += without_report + other_lengths + other_transfers + other_devices;
            }
        }
        skipped
    }

    /// Processes a packet of the capture. A frame is added to `pending`. With `waits` a frame to the board stays there
    /// until its transfer has ended, which shows whether the board got it; recordings of this crate have no ends of
    /// transfers. Fails if the capture has only a part of the bytes of a frame.
    pub fn take(
        &mut self,
        event: &UsbEvent<'_>,
        at_ns: u64,
        waits: bool,
        pending: &mut PendingFrames,
    ) -> Result<(), Cut> {
        self.device(event.at);
        match (event.kind, event.to_host, event.stage) {
            (TransferKind::Control, ..) => return self.control(event, at_ns, waits, pending),
            (TransferKind::Interrupt, false, Stage::Submitted) => {
                return self.frame(event, Dir::Write, at_ns, waits.then_some(event.id), pending);
            }
            (TransferKind::Interrupt, false, Stage::Ended { done }) => self.ended(event, done, pending),
            (TransferKind::Interrupt, true, Stage::Ended { .. }) if event.length == 0 => {
                self.others(event.at).without_report += 1
            }
            (TransferKind::Interrupt, true, Stage::Ended { .. }) => {
                return self.frame(event, Dir::Read, at_ns, None, pending);
            }
            (TransferKind::Interrupt, true, Stage::Submitted) => {}
            (TransferKind::Other, ..) => self.others(event.at).other_transfers += 1,
        }
        Ok(())
    }

    fn device(&mut self, address: Address) -> &mut CapturedDevice {
        let new = CapturedDevice { address, ids: None, written: 0, read: 0, others: Skipped::default() };
        self.devices.entry(address).or_insert(new)
    }

    fn others(&mut self, address: Address) -> &mut Skipped {
        &mut self.device(address).others
    }

    /// Processes the end of a transfer to the board. The board got the bytes if the transfer succeeded. It also got
    /// them if a cancelled transfer has a transferred length of a whole frame.
    fn ended(&mut self, event: &UsbEvent<'_>, done: bool, pending: &mut PendingFrames) {
        let moved = done || event.length as usize >= NARROW;
        if pending.ended(event.id, moved) {
            let seen = self.device(event.at);
            seen.written = seen.written.saturating_sub(1);
            seen.others.taken_back += 1;
        }
    }

    fn control(
        &mut self,
        event: &UsbEvent<'_>,
        at_ns: u64,
        waits: bool,
        pending: &mut PendingFrames,
    ) -> Result<(), Cut> {
        if let Some(setup) = event.setup {
            if self.setups.len() >= MOST_SETUPS {
                self.setups.clear();
            }
            self.setups.insert(event.id, setup);
        }
        let setup = self.setups.get(&event.id).copied();
        if let Stage::Ended { done } = event.stage {
            self.setups.remove(&event.id);
            self.ended(event, done, pending);
        }
        let Some([kind, request, _, of, ..]) = setup else {
            self.others(event.at).other_transfers += 1;
            return Ok(());
        };
        match ((kind, request), of, event.stage) {
            (SET_REPORT, OUTPUT_REPORT, Stage::Submitted) if event.length > 0 && is_frame(event) => {
                self.frame(event, Dir::Write, at_ns, waits.then_some(event.id), pending)
            }
            (GET_DESCRIPTOR, DEVICE_DESCRIPTOR, _) if event.data.len() >= DEVICE_DESCRIPTOR_LEN => {
                let number = |at: usize| u16::from_le_bytes([event.data[at], event.data[at + 1]]);
                self.device(event.at).ids = Some((number(VENDOR_AT), number(VENDOR_AT + 2)));
                Ok(())
            }
            _ => {
                self.others(event.at).other_transfers += 1;
                Ok(())
            }
        }
    }

    fn frame(
        &mut self,
        event: &UsbEvent<'_>,
        dir: Dir,
        at_ns: u64,
        until: Option<u64>,
        pending: &mut PendingFrames,
    ) -> Result<(), Cut> {
        if !is_frame(event) {
            self.others(event.at).other_lengths += 1;
            return Ok(());
        }
        let wanted = match self.only {
            Some(only) => only == event.at,
            None => self.device(event.at).ids.is_none_or(|ids| ids == BOARD_IDS),
        };
        if !wanted {
            self.others(event.at).other_devices += 1;
            return Ok(());
        }
        let Some(data) = event.data.get(..event.length as usize) else {
            return Err(Cut { captured: event.data.len(), length: event.length });
        };
        let data = if data.len() == WITH_REPORT_ID { &data[1..] } else { data };
        let seen = self.device(event.at);
        *match dir {
            Dir::Write => &mut seen.written,
            Dir::Read => &mut seen.read,
        } += 1;
        let Address { bus, device } = event.at;
        pending.push(
            Recorded { at_ns, dir, frame: Box::new(Frame::from_prefix(data)), bus, device, damage_before: 0 },
            until,
        );
        Ok(())
    }
}

/// Whether a transfer has the length of a frame: 512 or 504 bytes, or 513 with a report id of 0.
fn is_frame(event: &UsbEvent<'_>) -> bool {
    match event.length as usize {
        WITH_REPORT_ID => event.data.first().is_none_or(|id| *id == 0),
        length => length == FRAME_LEN || length == NARROW,
    }
}

/// The devices of a capture that have the highest score as a board; none if no device has frames.
pub(super) fn candidates(seen: &[CapturedDevice]) -> Vec<CapturedDevice> {
    let most = seen.iter().map(CapturedDevice::board_score).max().unwrap_or_default();
    seen.iter().filter(|seen| most > 0 && seen.board_score() == most).copied().collect()
}

/// The devices as a list for a message, shortened if it is long.
pub(super) fn list(seen: &[CapturedDevice]) -> String {
    const MOST: usize = 8;
    let mut text: Vec<String> = seen.iter().take(MOST).map(CapturedDevice::to_string).collect();
    if seen.len() > MOST {
        text.push(format!("{} more", seen.len() - MOST));
    }
    text.join(", ")
}

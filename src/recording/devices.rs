//! The devices of a capture, and which of them is the board.

use std::collections::{BTreeMap, HashMap};
use std::fmt;

use super::address::Address;
use super::formats::transfer::{Event, Kind, Stage};
use super::held::Held;
use super::recorded::Recorded;
use crate::sk::{BOARD_IDS, Dir, FRAME_LEN, Frame, SlotSize};

/// Bytes of a frame behind a report id of 0, as hosts without an interrupt OUT endpoint send it.
const WITH_REPORT_ID: usize = 1 + FRAME_LEN;
/// Bytes of a frame without filler.
const NARROW: usize = SlotSize::Bytes12.frame_len();

/// `bmRequestType` and `bRequest` of HID's SET_REPORT, and the kind of report in `wValue`'s upper byte: output (HID 1.11,
/// 7.2.2).
const SET_REPORT: (u8, u8) = (0x21, 0x09);
const OUTPUT_REPORT: u8 = 2;
/// `bmRequestType` and `bRequest` of GET_DESCRIPTOR, and the kind of descriptor: device (USB 2.0, 9.4.3).
const GET_DESCRIPTOR: (u8, u8) = (0x80, 0x06);
const DEVICE_DESCRIPTOR: u8 = 1;
/// Where a device descriptor has vendor and product, and how long it is (USB 2.0, 9.6.1).
const VENDOR_AT: usize = 8;
const DEVICE_DESCRIPTOR_LEN: usize = 18;

/// Control transfers under way that are kept: a capture may lack their ends. \[OURS]
const MOST_SETUPS: usize = 1024;

/// A device of a capture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Seen {
    /// Where it is.
    pub address: Address,
    /// Vendor and product, if the capture has its descriptor.
    pub ids: Option<(u16, u16)>,
    /// Frames to it.
    pub written: u64,
    /// Frames from it.
    pub read: u64,
    /// What else it did.
    others: Skipped,
}

impl Seen {
    /// How much it is like a board: nothing, frames one way, frames both ways, and the board's ids on top, which hobby
    /// devices share, so that frames count for more. \[OURS] A device whose descriptor says something else is none.
    fn likeness(&self) -> u8 {
        match (self.ids, self.written.min(1) + self.read.min(1)) {
            (Some(ids), _) if ids != BOARD_IDS => 0,
            (Some(_), 2) => 3,
            (_, ways) => ways as u8,
        }
    }
}

/// `1.5 (16c0:05df; 12 frames to it, 40 from it)`
impl fmt::Display for Seen {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} (", self.address)?;
        if let Some((vendor, product)) = self.ids {
            write!(f, "{vendor:04x}:{product:04x}; ")?;
        }
        write!(f, "{} frames to it, {} from it)", self.written, self.read)
    }
}

/// What of a capture was left out, and why: of devices that moved frames all, of others together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Skipped {
    /// Frames that the host took back, or that failed: the board did not get them.
    pub taken_back: u64,
    /// Reads that ended without a report: cancelled, failed or empty. Each program that closes its board leaves some.
    pub without_report: u64,
    /// Interrupt transfers that are as long as no frame is.
    pub other_lengths: u64,
    /// Control, bulk and isochronous transfers that move no frame, by their packets.
    pub other_transfers: u64,
    /// What passed to and from other devices, by its packets: those without frames, and those that are no board by their
    /// descriptor or not the one asked for.
    pub other_devices: u64,
}

impl Skipped {
    /// What a user may want to know, in words; `None` if it is nothing.
    pub fn words(&self) -> Option<String> {
        let parts = [
            (self.taken_back, "frames that the board did not take"),
            (self.other_lengths, "transfers as long as no frame"),
        ];
        let parts: Vec<String> = parts.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{n} {what}")).collect();
        (!parts.is_empty()).then(|| parts.join(" and "))
    }
}

/// What is known of the devices so far.
#[derive(Default)]
pub(super) struct Devices {
    devices: BTreeMap<Address, Seen>,
    /// Setup packets of control transfers under way.
    setups: HashMap<u64, [u8; 8]>,
    /// The device asked for.
    only: Option<Address>,
}

/// A packet holds less than the frame that passed.
pub(super) struct Cut {
    pub captured: usize,
    pub length: u32,
}

impl Devices {
    pub fn only(&mut self, address: Address) {
        self.only = Some(address);
    }

    /// In the order of their addresses.
    pub fn seen(&self) -> Vec<Seen> {
        self.devices.values().copied().collect()
    }

    /// What was left out so far.
    pub fn skipped(&self) -> Skipped {
        let mut skipped = Skipped::default();
        for Seen { written, read, others, .. } in self.devices.values() {
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

    /// A packet goes by; a frame in it goes to `held`, with its end if `waits`.
    pub fn take(&mut self, event: &Event<'_>, at_ns: u64, waits: bool, held: &mut Held) -> Result<(), Cut> {
        self.device(event.at);
        match (event.kind, event.to_host, event.stage) {
            (Kind::Control, ..) => return self.control(event, at_ns, waits, held),
            (Kind::Interrupt, false, Stage::Submitted) => {
                return self.frame(event, Dir::Write, at_ns, waits.then_some(event.id), held);
            }
            (Kind::Interrupt, false, Stage::Ended { done }) => self.ended(event, done, held),
            (Kind::Interrupt, true, Stage::Ended { .. }) if event.length == 0 => {
                self.others(event.at).without_report += 1
            }
            (Kind::Interrupt, true, Stage::Ended { .. }) => return self.frame(event, Dir::Read, at_ns, None, held),
            (Kind::Interrupt, true, Stage::Submitted) => {}
            (Kind::Other, ..) => self.others(event.at).other_transfers += 1,
        }
        Ok(())
    }

    fn device(&mut self, address: Address) -> &mut Seen {
        let new = Seen { address, ids: None, written: 0, read: 0, others: Skipped::default() };
        self.devices.entry(address).or_insert(new)
    }

    fn others(&mut self, address: Address) -> &mut Skipped {
        &mut self.device(address).others
    }

    /// A transfer to the board has ended: its bytes were moved if it was carried out, or if the capture says so.
    fn ended(&mut self, event: &Event<'_>, done: bool, held: &mut Held) {
        let moved = done || event.length as usize >= NARROW;
        if held.ended(event.id, moved) {
            let seen = self.device(event.at);
            seen.written = seen.written.saturating_sub(1);
            seen.others.taken_back += 1;
        }
    }

    fn control(&mut self, event: &Event<'_>, at_ns: u64, waits: bool, held: &mut Held) -> Result<(), Cut> {
        if let Some(setup) = event.setup {
            if self.setups.len() >= MOST_SETUPS {
                self.setups.clear();
            }
            self.setups.insert(event.id, setup);
        }
        let setup = self.setups.get(&event.id).copied();
        if let Stage::Ended { done } = event.stage {
            self.setups.remove(&event.id);
            self.ended(event, done, held);
        }
        let Some([kind, request, _, of, ..]) = setup else {
            self.others(event.at).other_transfers += 1;
            return Ok(());
        };
        match ((kind, request), of, event.stage) {
            (SET_REPORT, OUTPUT_REPORT, Stage::Submitted) if event.length > 0 && is_frame(event) => {
                self.frame(event, Dir::Write, at_ns, waits.then_some(event.id), held)
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
        event: &Event<'_>,
        dir: Dir,
        at_ns: u64,
        until: Option<u64>,
        held: &mut Held,
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
        held.push(Recorded { at_ns, dir, frame: Frame::from_prefix(data), bus, device }, until);
        Ok(())
    }
}

/// Whether a transfer is as long as a frame: 512 bytes, 504, or 513 behind a report id of 0.
fn is_frame(event: &Event<'_>) -> bool {
    match event.length as usize {
        WITH_REPORT_ID => event.data.first().is_none_or(|id| *id == 0),
        length => length == FRAME_LEN || length == NARROW,
    }
}

/// The devices that are the most like a board, of those of a capture.
pub(super) fn candidates(seen: &[Seen]) -> Vec<Seen> {
    let most = seen.iter().map(Seen::likeness).max().unwrap_or_default();
    seen.iter().filter(|seen| most > 0 && seen.likeness() == most).copied().collect()
}

/// A list for a message; of a long one the beginning.
pub(super) fn list(seen: &[Seen]) -> String {
    const MOST: usize = 8;
    let mut text: Vec<String> = seen.iter().take(MOST).map(Seen::to_string).collect();
    if seen.len() > MOST {
        text.push(format!("{} more", seen.len() - MOST));
    }
    text.join(", ")
}

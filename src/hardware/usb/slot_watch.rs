//! Checks whether the slots in a board's reports have the size that the link was given (`slot=`). The board does not
//! report which size its jumper CONFIG2 selects, so the content of the reports has to show it.

use crate::sk::{Frame, SlotForm, SlotSize};

/// How many reports in a row prove a slot size by their CRC. \[OURS] One is not enough: a report that was damaged in
/// transit may fit only the wrong size by chance.
const REPORTS_WITH_CRC_MIN: u32 = 3;
/// How many reports in a row prove a slot size by the form of their slots, if the board sends no CRC. The form proves
/// less than a CRC, so more reports are needed. \[OURS]
const REPORTS_WITHOUT_CRC_MIN: u32 = 32;

/// Finds out from the reports whether the board's slot size is the one that the link was given.
#[derive(Debug)]
pub(crate) struct SlotWatch {
    given: SlotSize,
    state: State,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// The reports have proven neither size yet.
    Open {
        /// How many reports in a row fit only the given size. A report that fits both sizes or neither is ignored.
        given: u32,
        /// How many reports in a row fit only the other size: `other[0]` by their CRC, `other[1]` by the form of their
        /// slots. A report that fits both sizes or neither is ignored.
        other: [u32; 2],
    },
    /// The reports have proven the given size.
    Right,
    /// The reports have proven the other size.
    Wrong,
}

impl SlotWatch {
    pub const fn new(given: SlotSize) -> Self {
        Self { given, state: State::Open { given: 0, other: [0; 2] } }
    }

    /// The slot size that the link was given.
    pub const fn given(&self) -> SlotSize {
        self.given
    }

    /// Evaluates a report. Returns the board's slot size once it is proven to differ from the given one.
    pub fn check_report(&mut self, report: &Frame) -> Option<SlotSize> {
        if let State::Open { given, other } = &mut self.state {
            let wanted = if report.crc_byte() == 0 { REPORTS_WITHOUT_CRC_MIN } else { REPORTS_WITH_CRC_MIN };
            let row = &mut other[usize::from(report.crc_byte() == 0)];
            match fitting_size(report) {
                Some(size) if size == self.given => {
                    (*given, *other) = (*given + 1, [0; 2]);
                    // The form of the slots alone does not prove the given size, because a report may fit it by chance.
                    if *given >= REPORTS_WITH_CRC_MIN && report.crc_byte() != 0 {
                        self.state = State::Right;
                    }
                }
                Some(_) => {
                    (*given, *row) = (0, *row + 1);
                    if *row >= wanted {
                        self.state = State::Wrong;
                    }
                }
                None => {}
            }
        }
        self.found()
    }

    /// The board's slot size, once it is proven to differ from the given one.
    pub fn found(&self) -> Option<SlotSize> {
        (self.state == State::Wrong).then(|| self.given.other())
    }
}

/// The only size that the report fits; `None` if it fits both or neither.
fn fitting_size(report: &Frame) -> Option<SlotSize> {
    if report.crc_byte() == 0 { report.size_by_slots(SlotForm::Report) } else { report.size_by_crc() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sk::{CommandId, RawSlot};

    const SIZES: [(SlotSize, SlotSize); 2] =
        [(SlotSize::Bytes12, SlotSize::Bytes16), (SlotSize::Bytes16, SlotSize::Bytes12)];

    /// A report of a board in OP with two drives.
    fn report(size: SlotSize, position: u32) -> Frame {
        let mut frame = Frame::new();
        frame.put(size, 0, &RawSlot { id: 0xBF, parm: 8, data2: 0x00A0, ..RawSlot::ZERO });
        for slave in [1, 2] {
            let id = CommandId::Csp.code();
            frame.put(size, slave, &RawSlot { id, parm: 0x1637, data1: position, data2: 12, ..RawSlot::ZERO });
        }
        frame
    }

    fn with_crc(size: SlotSize, position: u32) -> Frame {
        let mut frame = report(size, position);
        frame.fill_crc(size);
        frame
    }

    /// Evaluates the reports that `report` makes for the numbers 1, 2 and so on. Returns the number of the report with
    /// which the other slot size is proven, and that size.
    fn proven_at(given: SlotSize, mut report: impl FnMut(u32) -> Frame) -> Option<(u32, SlotSize)> {
        let mut watch = SlotWatch::new(given);
        (1..1000).find_map(|number| Some((number, watch.check_report(&report(number))?)))
    }

    /// WIRE-81 With CRCs, three reports prove another slot size.
    #[test]
    fn another_slot_size_is_known_by_the_crc() {
        for (given, of_board) in SIZES {
            let (number, found) = proven_at(given, |number| with_crc(of_board, number)).unwrap();
            // If a valid CRC is 0, the report counts as one without a CRC and proves nothing. So a few more reports may
            // be needed.
            assert!((3..=5).contains(&number) && found == of_board, "{number}: {found:?}");
            assert_eq!(proven_at(of_board, |number| with_crc(of_board, number)), None);
        }
    }

    /// WIRE-81 Without a CRC, 32 reports prove another slot size by the form of their slots.
    #[test]
    fn another_slot_size_is_known_by_structure() {
        for (given, of_board) in SIZES {
            let found = proven_at(given, |number| report(of_board, number << 8));
            assert_eq!(found, Some((REPORTS_WITHOUT_CRC_MIN, of_board)));
            assert_eq!(proven_at(of_board, |number| report(of_board, number << 8)), None);
        }
        assert_eq!(proven_at(SlotSize::Bytes12, |_| Frame::new()), None, "before anything is set up nothing shows");
    }

    /// WIRE-81 A report that was damaged in transit does not make the link refuse the board.
    #[test]
    fn damaged_reports_prove_nothing() {
        let given = SlotSize::Bytes12;
        let damaged = |number: u32| {
            let mut frame = with_crc(given, number);
            frame.bytes_mut()[20 + number as usize % 400] ^= 0x10;
            frame
        };
        assert_eq!(proven_at(given, damaged), None);
        // Two reports of the other size, then one of the given size, over and over: only reports in a row count.
        let mixed = |number: u32| with_crc(if number.is_multiple_of(3) { given } else { SlotSize::Bytes16 }, 1);
        assert_eq!(proven_at(given, mixed), None);
    }

    /// WIRE-81 Once another slot size is proven, it is reported again for every report.
    #[test]
    fn a_proven_slot_size_stays() {
        let mut watch = SlotWatch::new(SlotSize::Bytes12);
        let wide = with_crc(SlotSize::Bytes16, 1);
        assert_ne!(wide.crc_byte(), 0);
        let said: Vec<_> = (0..5).map(|_| watch.check_report(&wide)).collect();
        let wrong = Some(SlotSize::Bytes16);
        assert_eq!(said, [None, None, wrong, wrong, wrong]);
        assert_eq!(watch.check_report(&with_crc(SlotSize::Bytes12, 1)), wrong);
    }
}

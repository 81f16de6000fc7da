//! The frame type of `ecmsk dump`, and the selection of the slots that are shown.

use ecmsk::engine::Firmware;
use ecmsk::link::Dir;
use ecmsk::recording::Kinds;
use ecmsk::sk::dump::{CommandDump, MAX_SLAVES, ResponseDump, SlotLine, SlotRole};
use ecmsk::sk::{CrcStatus, Frame, RawSlot, SlaveKind, SlotSize};

use super::place::Place;
use crate::filter::{Command, Slots};

/// A frame, its position in the input, and its slot size.
#[derive(Clone, Debug)]
pub struct Shown {
    /// The number, time and direction of the frame.
    pub place: Place,
    /// The slot size of the frame.
    pub size: SlotSize,
    /// The bytes of the frame.
    pub frame: Frame,
}

impl Shown {
    /// The direction as a word: `command` or `response`.
    pub const fn direction_name(&self) -> &'static str {
        match self.place.direction {
            Dir::Write => "command",
            Dir::Read => "response",
        }
    }

    /// Passes the frame to `kinds`, which determines the kinds of the slaves from commands and reports.
    pub fn tell(&self, kinds: &mut Kinds) {
        match self.place.direction {
            Dir::Write => kinds.command(&self.frame, self.size),
            Dir::Read => kinds.response(&self.frame, self.size),
        }
    }

    /// Whether the CRC in byte 3 is right, wrong or absent.
    pub fn crc(&self) -> CrcStatus {
        self.frame.crc_status(self.size)
    }
}

/// Which slots of a frame are shown, and how they are decoded.
#[derive(Clone, Debug)]
pub struct View {
    /// The slots to show. If empty, slot 0 and all slots that are not idle are shown; an idle slot has only zero bytes.
    pub slots: Vec<Slots>,
    /// Whether all slots are shown, including idle ones.
    pub all: bool,
    /// Whether only slots are shown that differ from the same slot of the previous frame.
    pub changes: bool,
    /// Only slots with one of these commands, or with the answer to one, are shown; if empty, all slots.
    pub commands: Vec<Command>,
    /// The firmware version of the board, which decides the meaning of byte 1 of a slave's slot in a response.
    pub firmware: Firmware,
}

impl View {
    /// The lines to print for a frame, in the order of its slots. [`Shown::tell`] must have passed this frame to
    /// `kinds` before. `before` is the previous frame in the same direction, if there is one.
    pub fn lines(&self, shown: &Shown, before: Option<&Shown>, kinds: &Kinds) -> Vec<(usize, SlotLine)> {
        let (frame, size) = (&shown.frame, shown.size);
        match shown.place.direction {
            Dir::Write => {
                let dump = CommandDump::new(frame, size);
                self.pick(shown, before, |i| dump.line(i))
            }
            Dir::Read => {
                let unknown = match self.firmware {
                    Firmware::V17 => ResponseDump::new(frame, size),
                    Firmware::V15 => ResponseDump::new(frame, size).mode_in_byte_1(),
                };
                // For a slave of unknown kind this list has the default kind. It is not used, because the slot of such
                // a slave is decoded by `unknown` and not by `given`.
                let known: [SlaveKind; MAX_SLAVES] = std::array::from_fn(|i| kinds.of(i + 1).unwrap_or_default());
                let given = unknown.kinds(&known);
                self.pick(shown, before, |i| if kinds.of(i).is_some() { given.line(i) } else { unknown.line(i) })
            }
        }
    }

    fn pick(
        &self,
        shown: &Shown,
        before: Option<&Shown>,
        line: impl Fn(usize) -> Option<SlotLine>,
    ) -> Vec<(usize, SlotLine)> {
        let size = shown.size;
        let before = before.filter(|before| self.changes && before.size == size);
        let wanted = |i: usize, line: &SlotLine| match (self.slots.is_empty(), before) {
            (true, Some(_)) => true,
            (true, None) => self.all || !line.is_idle(),
            (false, _) => self.slots.iter().any(|slots| slots.contains(i, size)),
        };
        let changed = |i: usize, line: &SlotLine| {
            before.is_none_or(|before| {
                let content = |raw| self.content(raw, line.role, shown.place.direction);
                let is_damaged = matches!(line.crc, Some(CrcStatus::Wrong(_)));
                is_damaged || content(line.raw) != content(before.frame.slot(size, i))
            })
        };
        let asked =
            |line: &SlotLine| self.commands.is_empty() || self.commands.iter().any(|command| command.is_in(line));
        let lines = (0..size.slots()).filter_map(|i| Some((i, line(i)?)));
        lines.filter(|(i, line)| wanted(*i, line) && asked(line) && changed(*i, line)).collect()
    }

    /// The slot without the values that change in every frame: the command index of a slave and the CRC.
    fn content(&self, raw: RawSlot, role: SlotRole, direction: Dir) -> RawSlot {
        match role {
            SlotRole::Master => RawSlot { parm: raw.parm & 0x00FF, ..raw },
            SlotRole::Slave(_) if direction == Dir::Write || self.firmware == Firmware::V17 => {
                RawSlot { index: 0, ..raw }
            }
            SlotRole::Slave(_) | SlotRole::Sdo => raw,
        }
    }
}

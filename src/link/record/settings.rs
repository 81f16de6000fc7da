//! The settings of a board that later frames are understood with: the kinds of its slaves and its cycle time.

use super::writer::FrameEntry;
use crate::link::Dir;
use crate::sk::{MasterCommand, MasterResponse, MasterState, SlotSize};

/// The newest command for each setting: SET_AXIS for each group of slaves, and SET_DC.
#[derive(Default)]
pub(super) struct Settings {
    size: SlotSize,
    state: Option<MasterState>,
    commands: Vec<(Setting, FrameEntry)>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Setting {
    Axes(u8),
    Cycle,
}

impl Settings {
    pub fn new(size: Option<SlotSize>) -> Self {
        Self { size: size.unwrap_or_default(), ..Self::default() }
    }

    /// Looks at the next frame.
    pub fn look(&mut self, entry: &FrameEntry) {
        let slot = entry.frame.slot(self.size, 0);
        if entry.dir == Dir::Read {
            self.state = MasterResponse::decode(&slot).state.state();
            return;
        }
        let setting = match MasterCommand::decode(&slot, self.size) {
            Ok(MasterCommand::SoftReset) => {
                (self.commands, self.state) = (Vec::new(), None);
                return;
            }
            // A board takes settings in Init and PreOP (SK-4).
            _ if matches!(self.state, Some(MasterState::SafeOp | MasterState::Op)) => return,
            Ok(MasterCommand::SetAxis { group, .. }) => Setting::Axes(group),
            Ok(MasterCommand::SetDc { .. }) => Setting::Cycle,
            _ => return,
        };
        self.commands.retain(|(other, _)| *other != setting);
        self.commands.push((setting, entry.clone()));
    }

    /// How many commands there are.
    pub fn len(&self) -> u32 {
        self.commands.len() as u32
    }

    /// The commands, oldest first, as if they had been sent at `at_ns`. \[OURS] With their own times a recording would
    /// begin hours before its other frames.
    pub fn at(&self, at_ns: u64) -> impl Iterator<Item = FrameEntry> + '_ {
        self.commands.iter().map(move |(_, entry)| FrameEntry { at_ns, ..entry.clone() })
    }
}

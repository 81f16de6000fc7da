//! The settings of a board without which later frames cannot be understood: the kinds of its slaves and its cycle time.

use super::writer::FrameEntry;
use crate::link::Dir;
use crate::sk::{CycleTime, MasterCommand, MasterResponse, MasterState, SlotSize};

/// How many cycles before the first frame of a recording the commands are placed. So reports that are read late, with
/// older times, come after the commands, too: by default a link keeps 32 unread reports (`queue=`). \[OURS]
const CYCLES_BEFORE: u64 = 64;

/// The newest command for each setting: SET_AXIS for each group of slaves, and SET_DC.
#[derive(Default)]
pub(super) struct Settings {
    size: SlotSize,
    state: Option<MasterState>,
    cycle: Option<CycleTime>,
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
                *self = Self::new(Some(self.size));
                return;
            }
            // A board takes settings only in Init and PreOP (SK-4).
            _ if matches!(self.state, Some(MasterState::SafeOp | MasterState::Op)) => return,
            Ok(MasterCommand::SetAxis { group, .. }) => Setting::Axes(group),
            Ok(MasterCommand::SetDc { cycle, .. }) => {
                self.cycle = Some(cycle);
                Setting::Cycle
            }
            _ => return,
        };
        self.commands.retain(|(other, _)| *other != setting);
        self.commands.push((setting, entry.clone()));
    }

    /// The number of stored commands.
    pub fn len(&self) -> u32 {
        self.commands.len() as u32
    }

    /// The commands, oldest first, as if they had been sent shortly before the frame of `at_ns`. \[OURS] With the
    /// commands' own times a recording could begin hours before its other frames.
    pub fn before(&self, at_ns: u64) -> impl Iterator<Item = FrameEntry> + '_ {
        let at_ns = at_ns.saturating_sub(CYCLES_BEFORE * self.cycle.unwrap_or(CycleTime::DEFAULT).ns());
        self.commands.iter().map(move |(_, entry)| FrameEntry { at_ns, ..entry.clone() })
    }
}

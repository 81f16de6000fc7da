//! The kinds of the slaves, which reports do not contain. The user gives them, or they are read from SET_AXIS.

use crate::sk::dump::MAX_SLAVES;
use crate::sk::{Frame, MasterCommand, MasterResponse, MasterState, SlaveKind, SlotSize};

/// The kinds of the slaves as known at the present frame of a recording.
#[derive(Clone, Debug)]
pub struct Kinds {
    kinds: [Option<SlaveKind>; MAX_SLAVES],
    /// Whether the kinds follow the SET_AXIS commands. If the user gave a list, it is false, and these commands are
    /// ignored.
    follow: bool,
    state: Option<MasterState>,
}

impl Kinds {
    /// `given` is the user's list, slave 1 first; slaves that are not in it do not exist. Without a list all kinds are
    /// unknown until a SET_AXIS command is read.
    pub fn new(given: Option<&[SlaveKind]>) -> Self {
        let kinds = match given {
            Some(list) => std::array::from_fn(|i| Some(list.get(i).copied().unwrap_or(SlaveKind::None))),
            None => [None; MAX_SLAVES],
        };
        Self { kinds, follow: given.is_none(), state: None }
    }

    /// The kind of slave `n`, 1..=40; `None` if it is not known.
    pub fn of(&self, n: usize) -> Option<SlaveKind> {
        self.kinds.get(n.checked_sub(1)?).copied().flatten()
    }

    /// Reads a command frame. SET_AXIS counts in Init and PreOP, where a board accepts it; SW_RESET makes all kinds
    /// unknown (SK-4).
    pub fn command(&mut self, frame: &Frame, size: SlotSize) {
        if !self.follow {
            return;
        }
        match MasterCommand::decode(&frame.slot(size, 0), size) {
            Ok(MasterCommand::SetAxis { group, kinds })
                if !matches!(self.state, Some(MasterState::SafeOp | MasterState::Op)) =>
            {
                // The five groups of SET_AXIS have 8 slaves each, 40 in all. A board with 16-byte slots has 30, so the
                // kinds of slaves 31 to 40 are ignored.
                let slaves = self.kinds.iter_mut().take(size.max_slaves()).skip(usize::from(group) * 8);
                slaves.zip(kinds).for_each(|(slave, kind)| *slave = Some(kind));
            }
            Ok(MasterCommand::SoftReset) => self.kinds = [None; MAX_SLAVES],
            _ => {}
        }
    }

    /// Notes the state of the network in a report, which decides whether SET_AXIS counts.
    pub fn response(&mut self, frame: &Frame, size: SlotSize) {
        self.state = MasterResponse::decode(&frame.slot(size, 0)).state.state();
    }
}

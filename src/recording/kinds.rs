//! What slaves are, which responses do not say: what somebody said, else as SET_AXIS goes by.

use crate::sk::dump::MAX_SLAVES;
use crate::sk::{Frame, MasterCommand, MasterResponse, MasterState, SlaveKind, SlotSize};

/// The kinds known at one point of a sequence of frames.
#[derive(Clone, Debug)]
pub struct Kinds {
    kinds: [Option<SlaveKind>; MAX_SLAVES],
    /// Whether SET_AXIS tells: the user has not.
    follow: bool,
    state: Option<MasterState>,
}

impl Kinds {
    /// The user's list, slave 1 first, slaves beyond it being none; without one, nothing is known until SET_AXIS tells.
    pub fn new(given: Option<&[SlaveKind]>) -> Self {
        let kinds = match given {
            Some(list) => std::array::from_fn(|i| Some(list.get(i).copied().unwrap_or(SlaveKind::None))),
            None => [None; MAX_SLAVES],
        };
        Self { kinds, follow: given.is_none(), state: None }
    }

    /// What slave `n`, 1..=40, is.
    pub fn of(&self, n: usize) -> Option<SlaveKind> {
        self.kinds.get(n.checked_sub(1)?).copied().flatten()
    }

    /// A command frame goes by. SET_AXIS counts where a board takes it, in Init and PreOP; SW_RESET undoes it (SK-4).
    pub fn command(&mut self, frame: &Frame, size: SlotSize) {
        if !self.follow {
            return;
        }
        match MasterCommand::decode(&frame.slot(size, 0), size) {
            Ok(MasterCommand::SetAxis { group, kinds })
                if !matches!(self.state, Some(MasterState::SafeOp | MasterState::Op)) =>
            {
                // The groups name more slaves than a board of wide slots has.
                let slaves = self.kinds.iter_mut().take(size.max_slaves()).skip(usize::from(group) * 8);
                slaves.zip(kinds).for_each(|(slave, kind)| *slave = Some(kind));
            }
            Ok(MasterCommand::SoftReset) => self.kinds = [None; MAX_SLAVES],
            _ => {}
        }
    }

    /// A response frame goes by.
    pub fn response(&mut self, frame: &Frame, size: SlotSize) {
        self.state = MasterResponse::decode(&frame.slot(size, 0)).state.state();
    }
}

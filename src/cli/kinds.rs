//! What the slaves of a dump are, which responses do not say: from `--kinds`, else as SET_AXIS goes by.

use ecmsk::sk::dump::MAX_SLAVES;
use ecmsk::sk::{Frame, MasterCommand, MasterResponse, MasterState, SlaveKind, SlotSize};

/// Kinds of slaves in the order of the network, as `--kinds` has them: `drive*2,io`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct KindList(Vec<SlaveKind>);

/// The words of a list. Those of a link's `slaves` are among them, so that a list can be used for both.
const WORDS: [(&str, SlaveKind); 6] = [
    ("drive", SlaveKind::Drive),
    ("io", SlaveKind::Io),
    ("hsp", SlaveKind::Hsp),
    ("hsp2", SlaveKind::Hsp),
    ("step", SlaveKind::Step),
    ("none", SlaveKind::None),
];

/// The word for a kind.
pub fn word(kind: SlaveKind) -> &'static str {
    // Every kind has its word above.
    WORDS.into_iter().find(|(_, known)| *known == kind).map_or("none", |(word, _)| word)
}

impl KindList {
    /// Reads a comma list of kinds, each with `*N` if there are N in a row.
    ///
    /// # Errors
    /// What is wrong and what is allowed.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut kinds = Vec::new();
        for item in text.split(',') {
            let (word, count) = item.split_once('*').map_or((item, Some(1)), |(word, n)| (word, n.parse().ok()));
            let kind = WORDS.into_iter().find(|(name, _)| name.eq_ignore_ascii_case(word.trim()));
            let Some((_, kind)) = kind else {
                return Err(format!("kind `{word}` is unknown; allowed: {}", WORDS.map(|(name, _)| name).join(", ")));
            };
            let Some(count @ 1..=MAX_SLAVES) = count else {
                return Err(format!("in `{item}` a number from 1 to {MAX_SLAVES} belongs after the *"));
            };
            kinds.extend(std::iter::repeat_n(kind, count));
        }
        if kinds.len() > MAX_SLAVES {
            return Err(format!("{} slaves, allowed: at most {MAX_SLAVES}", kinds.len()));
        }
        Ok(Self(kinds))
    }
}

/// The kinds known at one point of a sequence of frames.
#[derive(Debug)]
pub struct Kinds {
    kinds: [Option<SlaveKind>; MAX_SLAVES],
    /// Whether SET_AXIS tells: the user has not.
    follow: bool,
    state: Option<MasterState>,
}

impl Kinds {
    /// The user's list, slaves beyond it being none; without one, nothing is known until SET_AXIS tells.
    pub fn new(given: Option<&KindList>) -> Self {
        let kinds = match given {
            Some(list) => std::array::from_fn(|i| Some(list.0.get(i).copied().unwrap_or(SlaveKind::None))),
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
                let slaves = self.kinds.iter_mut().skip(usize::from(group) * 8);
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

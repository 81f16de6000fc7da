//! The first reading of a recording: finds when the board was in OP, and which axes were moved.

use ecmsk::link::Dir;
use ecmsk::recording::Kinds;
use ecmsk::sk::dump::{MAX_SLAVES, ResponseDump, SlotMeaning};
use ecmsk::sk::{CommandId, Frame, IoResponse, MasterResponse, MasterState, SlaveKind, SlotSize};

use super::Window;
use crate::recording::{self, Framed};

/// What the first reading of a recording has found so far. If a capture has several boards, the board that is in OP
/// first is used and the others are ignored.
pub struct Survey {
    board: Option<(u16, u8)>,
    size: SlotSize,
    link: Option<String>,
    op: Option<Window>,
    in_op: bool,
    kinds: Kinds,
    /// Slaves that were sent a drive command such as CSP or SV_ON in OP.
    moved: [bool; MAX_SLAVES],
    /// Slaves whose slot in OP belongs to a drive (Drive, STEP or HSP).
    drives: [bool; MAX_SLAVES],
    /// Slaves that are IO slaves. The next field marks the IO slaves with an input or output that was ever 1.
    ios: [bool; MAX_SLAVES],
    lively_ios: [bool; MAX_SLAVES],
    /// Slaves whose slot had a value other than zero in OP, apart from its index byte. For any other slave there is
    /// nothing to draw.
    seen: [bool; MAX_SLAVES],
    /// The intervals between the first reports in OP.
    intervals_ns: Vec<i64>,
}

/// The cycle time is determined from the first intervals between reports in OP, at most this many.
const INTERVALS_KEPT: usize = 1000;

impl Default for Survey {
    fn default() -> Self {
        Self {
            board: None,
            size: SlotSize::default(),
            link: None,
            op: None,
            in_op: false,
            kinds: Kinds::new(None),
            moved: [false; MAX_SLAVES],
            drives: [false; MAX_SLAVES],
            ios: [false; MAX_SLAVES],
            lively_ios: [false; MAX_SLAVES],
            seen: [false; MAX_SLAVES],
            intervals_ns: Vec::new(),
        }
    }
}

impl Survey {
    /// Adds the next frame; frames are sorted by time.
    pub fn frame(&mut self, framed: &Framed) {
        if self.board.is_some_and(|board| board != framed.board()) {
            return;
        }
        match framed.recorded.dir {
            Dir::Write => self.command(framed),
            Dir::Read => self.response(framed),
        }
    }

    /// The time in OP, from the first response that reports it to the last.
    pub const fn op(&self) -> Option<Window> {
        self.op
    }

    /// The EtherCAT cycle time in nanoseconds. It is the median interval between reports, since some reports may be
    /// missing or late.
    pub fn cycle_ns(&self) -> i64 {
        let mut intervals = self.intervals_ns.clone();
        intervals.sort_unstable();
        intervals.get(intervals.len() / 2).copied().unwrap_or_default()
    }

    /// The address of the board whose frames are drawn; `None` before a report in OP.
    pub fn board(&self) -> Option<(u16, u8)> {
        self.board
    }

    /// The slot size of the board.
    pub const fn size(&self) -> SlotSize {
        self.size
    }

    /// The name of the link in the recording, as text for users; `None` for a capture.
    pub fn link(&self) -> Option<String> {
        self.link.clone()
    }

    /// The slaves that were moved; if no slave was moved, all drives.
    pub fn axes(&self) -> Vec<u8> {
        let chosen = if self.moved.contains(&true) { &self.moved } else { &self.drives };
        (1..).zip(chosen).filter(|(n, chosen)| **chosen && !self.is_io(*n)).map(|(n, _)| n).collect()
    }

    /// All slaves that a plot can show: drives, slaves that were moved, and IO slaves.
    pub fn known(&self) -> Vec<u8> {
        let known = |n: &usize| self.moved[*n] || self.drives[*n] || self.ios[*n];
        (0..MAX_SLAVES).filter(known).map(|n| n as u8 + 1).collect()
    }

    /// Whether the slave with this number (from 1) is IO, which has no position.
    pub fn is_io(&self, slave: u8) -> bool {
        let io = usize::from(slave).checked_sub(1).and_then(|n| self.ios.get(n));
        io.copied().unwrap_or_default()
    }

    /// The IO slaves with an input or output that was ever 1.
    pub fn lively_ios(&self) -> Vec<u8> {
        (1..).zip(&self.lively_ios).filter(|(_, lively)| **lively).map(|(n, _)| n).collect()
    }

    /// Whether a plot of the slave with this number (from 1) would show nothing: its slot was always empty in OP.
    pub fn is_empty(&self, slave: u8) -> bool {
        let known = usize::from(slave).checked_sub(1).and_then(|n| self.seen.get(n));
        !known.copied().unwrap_or_default()
    }

    fn see(&mut self, framed: &Framed) {
        for (n, seen) in (1..=framed.size.max_slaves()).zip(&mut self.seen) {
            *seen = *seen || !is_empty(&framed.recorded.frame, framed.size, n);
        }
    }

    fn command(&mut self, framed: &Framed) {
        let (frame, size) = (&framed.recorded.frame, framed.size);
        self.kinds.command(frame, size);
        if !self.in_op {
            return;
        }
        self.see(framed);
        for (n, moved) in (1..=size.max_slaves()).zip(&mut self.moved) {
            if is_empty(frame, size, n) {
                continue;
            }
            let slot = frame.slot(size, n);
            let id = CommandId::from_code(slot.id);
            self.lively_ios[n - 1] |= id == CommandId::IoWrite && slot.data1 != 0;
            *moved |= id.is_motion() || matches!(id, CommandId::ServoOn | CommandId::GoHome);
        }
    }

    fn response(&mut self, framed: &Framed) {
        let (frame, size) = (&framed.recorded.frame, framed.size);
        self.kinds.response(frame, size);
        self.in_op = is_op(framed);
        if !self.in_op {
            return;
        }
        self.see(framed);
        self.board.get_or_insert(framed.board());
        self.size = size;
        if self.link.is_none() {
            self.link = framed.meta.as_deref().map(recording::link_name);
        }
        let at_ns = framed.time_ns;
        let op = self.op.get_or_insert(Window { from_ns: at_ns, to_ns: at_ns });
        if self.intervals_ns.len() < INTERVALS_KEPT {
            self.intervals_ns.push(at_ns.saturating_sub(op.to_ns));
        }
        op.to_ns = at_ns;
        let dump = ResponseDump::new(frame, size);
        for n in 1..=size.max_slaves() {
            if self.kinds.of(n).is_none() && is_empty(frame, size, n) {
                // An empty slot shows neither a kind nor a value, and a frame may have 40 of them. Skipping them saves time.
                continue;
            }
            let guessed = || match dump.line(n)?.meaning {
                SlotMeaning::SlaveResponse(reading) => reading.kind.kind(),
                _ => None,
            };
            let kind = self.kinds.of(n).or_else(guessed);
            self.drives[n - 1] |= matches!(kind, Some(SlaveKind::Drive | SlaveKind::Step | SlaveKind::Hsp));
            self.ios[n - 1] |= kind == Some(SlaveKind::Io);
            self.lively_ios[n - 1] |= kind == Some(SlaveKind::Io) && IoResponse::decode(&frame.slot(size, n)).bits != 0;
        }
    }
}

/// Whether slot `n` is empty except for its index byte, which a board also returns for slaves that do not exist. The bytes are
/// compared without decoding, because most of the 40 slots of a frame are empty.
fn is_empty(frame: &Frame, size: SlotSize, n: usize) -> bool {
    let slot = &frame.bytes()[n * size.bytes()..][..size.bytes()];
    slot[0] == 0 && slot[2..] == [0; 14][..slot.len() - 2]
}

/// Whether the frame is a response in OP, with or without a lost slave (state 0x18).
pub fn is_op(framed: &Framed) -> bool {
    MasterResponse::decode(&framed.recorded.frame.slot(framed.size, 0)).state.state() == Some(MasterState::Op)
}

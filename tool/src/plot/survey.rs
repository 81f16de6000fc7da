//! The first look at a recording: when its board was in OP, and which axes were moved there.

use ecmsk::link::Dir;
use ecmsk::recording::Kinds;
use ecmsk::sk::dump::{MAX_SLAVES, ResponseDump, SlotMeaning};
use ecmsk::sk::{CommandId, IoResponse, MasterResponse, MasterState, RawSlot, SlaveKind, SlotSize};

use super::Window;
use crate::recording::{self, Framed};

/// What was found so far. Of a capture with several boards the one is looked at that is in OP first.
pub struct Survey {
    board: Option<(u16, u8)>,
    size: SlotSize,
    link: Option<String>,
    op: Option<Window>,
    in_op: bool,
    kinds: Kinds,
    /// Slaves that got a command for a drive in OP.
    moved: [bool; MAX_SLAVES],
    /// Slaves whose slot is a drive's in OP.
    drives: [bool; MAX_SLAVES],
    /// Slaves that are IO in OP, and those of them that said or were told more than zeros.
    ios: [bool; MAX_SLAVES],
    lively_ios: [bool; MAX_SLAVES],
    /// Slaves that anything is known of: their slot of a frame in OP held something.
    seen: [bool; MAX_SLAVES],
    /// Times between the first reports in OP.
    intervals_ns: Vec<i64>,
}

/// Times between reports that are kept to find the cycle.
const INTERVALS: usize = 1000;

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
    /// The next frame, in the order of time.
    pub fn frame(&mut self, framed: &Framed) {
        if self.board.is_some_and(|board| board != framed.board()) {
            return;
        }
        match framed.recorded.dir {
            Dir::Write => self.command(framed),
            Dir::Read => self.response(framed),
        }
    }

    /// When the board was in OP, from the first response that says so to the last.
    pub const fn op(&self) -> Option<Window> {
        self.op
    }

    /// The EtherCAT cycle, nanoseconds: the median time between reports, as some may be missing and some come late.
    pub fn cycle_ns(&self) -> i64 {
        let mut intervals = self.intervals_ns.clone();
        intervals.sort_unstable();
        intervals.get(intervals.len() / 2).copied().unwrap_or_default()
    }

    /// The board looked at.
    pub fn board(&self) -> Option<(u16, u8)> {
        self.board
    }

    /// Bytes of its slots.
    pub const fn size(&self) -> SlotSize {
        self.size
    }

    /// The link that was recorded first.
    pub fn link(&self) -> Option<String> {
        self.link.clone()
    }

    /// The slaves that were moved; if none was, those that are drives.
    pub fn axes(&self) -> Vec<u8> {
        let chosen = if self.moved.contains(&true) { &self.moved } else { &self.drives };
        (1..).zip(chosen).filter(|(n, chosen)| **chosen && !self.is_io(*n)).map(|(n, _)| n).collect()
    }

    /// The slaves that can be asked for: drives, what was moved, and IO.
    pub fn known(&self) -> Vec<u8> {
        let known = |n: &usize| self.moved[*n] || self.drives[*n] || self.ios[*n];
        (0..MAX_SLAVES).filter(known).map(|n| n as u8 + 1).collect()
    }

    /// Whether that slave (from 1) is IO, which has no position.
    pub fn is_io(&self, slave: u8) -> bool {
        let io = usize::from(slave).checked_sub(1).and_then(|n| self.ios.get(n));
        io.copied().unwrap_or_default()
    }

    /// The IO slaves of which an input or an output was ever 1.
    pub fn lively_ios(&self) -> Vec<u8> {
        (1..).zip(&self.lively_ios).filter(|(_, lively)| **lively).map(|(n, _)| n).collect()
    }

    /// Whether a plot of that slave (from 1) would show nothing.
    pub fn is_empty(&self, slave: u8) -> bool {
        let known = usize::from(slave).checked_sub(1).and_then(|n| self.seen.get(n));
        !known.copied().unwrap_or_default()
    }

    fn see(&mut self, framed: &Framed) {
        for (n, seen) in (1..=framed.size.max_slaves()).zip(&mut self.seen) {
            // Boards repeat the index of commands for slaves that are not there.
            let slot = RawSlot { index: 0, ..framed.recorded.frame.slot(framed.size, n) };
            *seen |= slot != RawSlot::ZERO;
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
            let slot = frame.slot(size, n);
            let id = CommandId::from_code(slot.id);
            self.lively_ios[n - 1] |= id == CommandId::IoWrite && slot.data1 != 0;
            *moved |=
                matches!(id, CommandId::ServoOn | CommandId::Csp | CommandId::Csv | CommandId::Cst | CommandId::GoHome);
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
        if self.intervals_ns.len() < INTERVALS {
            self.intervals_ns.push(at_ns.saturating_sub(op.to_ns));
        }
        op.to_ns = at_ns;
        let dump = ResponseDump::new(frame, size);
        for n in 1..=size.max_slaves() {
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

/// Whether a response says that the network runs, a failed slave or not.
pub fn is_op(framed: &Framed) -> bool {
    MasterResponse::decode(&framed.recorded.frame.slot(framed.size, 0)).state.state() == Some(MasterState::Op)
}

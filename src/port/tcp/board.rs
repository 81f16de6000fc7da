//! The board that a server has open, and what the passing frames show of it.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use parking_lot::Mutex;

use crate::ecm::Watch;
use crate::link::limits::taken;
use crate::link::{KnownNetwork, Link, LinkError, LinkInfo, ReadMeta, Stamp, Wait};
use crate::port::passing_frames::PassingFrames;
use crate::sk::{Frame, MasterState, SlotSize};
use crate::span::Seconds;
use crate::summary::{Alarm, FrameEvent, FrameWatch, HeldBack};
use crate::tcp::wire::{Counts, TEXT_MAX};

/// How long the server waits for a report that shows the slot size after it has opened a board. After that, clients are
/// served without a known slot size. \[OURS]
const SIZE_WAIT: Duration = Duration::from_millis(200);

/// A board that the server has open.
pub(super) struct Board {
    /// The link of the clients, with the limits of the server's machine file.
    pub(super) link: Arc<dyn Link>,
    /// The same link without these limits, over which the server itself stops axes. A limit must not interrupt the
    /// deceleration: the axes would have to hold their position at once from full speed.
    own: Arc<dyn Link>,
    pub(super) info: LinkInfo,
    /// The slaves and the counts per unit of their axes that the board's link knows; empty if it knows none.
    known: KnownNetwork,
    /// The slot size, and the state of the network as the passing frames show it.
    passing: Mutex<PassingFrames>,
    /// Detects alarms and failed changes of state for the log. `None`: the slot size is unknown yet, so reports cannot be
    /// decoded.
    troubles: Mutex<Option<FrameWatch>>,
    /// The board's time in the newest report.
    newest: AtomicU64,
    /// How many reports the board's link has dropped.
    dropped: AtomicU64,
    /// On virtual time: the newest known time of the board.
    clock: AtomicU64,
}

impl Board {
    /// Creates the state of an opened board. `lost`: the state from before its link was lost; `None`: the board was not
    /// open before. Waits until a report has shown the slot size, if the link does not know it. `limited` puts the
    /// limits of the server's machine file around the link.
    pub(super) fn new(
        own: Arc<dyn Link>,
        limited: impl FnOnce(Arc<dyn Link>) -> Arc<dyn Link>,
        lost: Option<&Self>,
    ) -> Self {
        let link = limited(Arc::clone(&own));
        let info = link.info();
        let passing = match lost {
            Some(lost) => lost.passing.lock().reopened(info.slot),
            None => PassingFrames::new(info.slot),
        };
        let board = Self {
            known: link.network().unwrap_or_default().or(KnownNetwork::of_sim(&info.name)),
            newest: AtomicU64::new(info.opened_at.0),
            clock: AtomicU64::new(info.opened_at.0),
            dropped: AtomicU64::new(0),
            passing: Mutex::new(passing),
            troubles: Mutex::default(),
            info,
            link,
            own,
        };
        board.find_size();
        *board.troubles.lock() = board.size().map(FrameWatch::new);
        board
    }

    /// Writes a command frame of the writer to the board, and updates the observed state of the network.
    pub(super) fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        self.note_write(frame, self.link.write(frame, wait))
    }

    /// As [`write`](Self::write), for a frame with which the server itself stops axes.
    pub(super) fn write_own(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        self.note_write(frame, self.own.write(frame, wait))
    }

    fn note_write(&self, frame: &Frame, written: Result<Stamp, LinkError>) -> Result<Stamp, LinkError> {
        if let Some((frame, at)) = taken(frame, &written, || self.size()) {
            self.passing.lock().command(&frame, at);
            if let Some(troubles) = &mut *self.troubles.lock() {
                troubles.command(at.nanoseconds(), &frame);
            }
        }
        written
    }

    /// Reads the next report of a board that no client uses yet. Returns the newest known state of the network; `None`: no
    /// report came, or the state is not known.
    pub(super) fn first_state(&self) -> Option<MasterState> {
        let mut frame = Frame::new();
        let meta = self.link.read(&mut frame, Wait::For(SIZE_WAIT)).ok()?;
        self.note_report(&frame, meta);
        self.watch().state()
    }

    /// Whether the last writer has commanded SW_RESET, and no report has shown its effect.
    pub(super) fn is_being_reset(&self) -> bool {
        self.passing.lock().watch().is_being_reset()
    }

    /// The slot size, from the board's link or from a report; `None`: it is not known yet.
    pub(super) fn size(&self) -> Option<SlotSize> {
        self.passing.lock().size()
    }

    /// Waits until a report has shown the slot size, if the board's link does not know it.
    fn find_size(&self) {
        let until = Instant::now() + SIZE_WAIT;
        let mut frame = Frame::new();
        // On virtual time only the calls of a client may advance the board's time.
        while self.size().is_none() && !self.info.virtual_time {
            let left = until.saturating_duration_since(Instant::now());
            match self.link.read(&mut frame, Wait::For(left)) {
                Ok(meta) if !left.is_zero() => self.note_report(&frame, meta),
                _ => return,
            }
        }
    }

    /// The board's time on virtual time; `None` on the real clock, and if it is unknown. The call uses the link, so the
    /// caller must not hold a lock that other threads need.
    pub(super) fn now(&self) -> Option<Stamp> {
        if !self.info.virtual_time {
            return None;
        }
        let now = self.link.pass(Duration::ZERO).ok().flatten();
        if let Some(now) = now {
            self.clock.store(now.0, Ordering::Relaxed);
        }
        now
    }

    /// The latest known time of the board, without a call to the link; on the real clock the time of the newest report.
    pub(super) fn known_now(&self) -> Stamp {
        let known = if self.info.virtual_time { &self.clock } else { &self.newest };
        Stamp(known.load(Ordering::Relaxed))
    }

    pub(super) fn watch(&self) -> Watch {
        self.passing.lock().watch().clone()
    }

    /// The slaves and the counts per unit of their axes for a Welcome: those in `said` (the server's setting
    /// [`ServeOptions::network`](super::ServeOptions::network)), or else those that passing frames have shown, or else those
    /// that the board's link knows.
    pub(super) fn network(&self, said: &KnownNetwork) -> KnownNetwork {
        let shown = self
            .passing
            .lock()
            .watch()
            .config()
            .map(|config| KnownNetwork::of_slaves(config.slaves.iter().map(ToString::to_string)));
        let known = said.clone().or(shown.unwrap_or_default()).or(self.known.clone());
        // A list that does not fit into the Welcome (`TEXT_MAX`) is left out, because a part of it would be a wrong
        // list.
        let whole = |text: String| if text.len() > TEXT_MAX { String::new() } else { text };
        KnownNetwork { slaves: whole(known.slaves), counts_per_unit: whole(known.counts_per_unit) }
    }

    pub(super) fn counts(&self) -> Counts {
        let stats = self.link.stats();
        Counts { reports_dropped: stats.reports_dropped, board: stats.board }
    }

    pub(super) fn note_report(&self, frame: &Frame, meta: ReadMeta) {
        self.passing.lock().report(frame, meta);
        self.newest.store(meta.at.0, Ordering::Relaxed);
        self.dropped.store(meta.dropped, Ordering::Relaxed);
    }

    /// How many reports the board's link has dropped, as of the newest report.
    pub(super) fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }

    /// The slot size, and the sequence number that the board's link will give to the next report.
    pub(super) fn size_and_sequence(&self) -> (Option<SlotSize>, u64) {
        let passing = self.passing.lock();
        (passing.size(), passing.next_sequence())
    }

    /// Calls `found` with a log line for each event that a report shows: an alarm, an axis that is held back, or a
    /// failed change of state. The times in these lines count from the opening of the board, as in a recording.
    pub(super) fn find_troubles(&self, frame: &Frame, at: Stamp, found: &mut dyn FnMut(String)) {
        let Some(size) = self.size() else { return };
        let mut troubles = self.troubles.lock();
        troubles.get_or_insert_with(|| FrameWatch::new(size)).report(at.nanoseconds(), frame, &mut |event| {
            let at = Seconds(at.0.saturating_sub(self.info.opened_at.0));
            found(match event {
                FrameEvent::Alarm(alarm) => format!("at {at}: {}", Alarm { at_ns: None, ..alarm }),
                FrameEvent::HeldBack(held) => format!("at {at}: {}", HeldBack { at_ns: None, ..held }),
                FrameEvent::StateFailed(failed) => format!("at {at}: {failed}"),
            });
        });
    }
}

//! A cyclic stream of targets, paced by credit: it never overfills the board's FIFO and counts when it runs dry.

use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use super::aim::Aim;
use super::leftover::Left;
use super::servo::{declared, require_op};
use super::session::{Pacer, Session};
use super::snapshot::Snapshot;
use super::{CLOSE_LIMIT, Ecm, EcmError, ramp};
use crate::cia402::Mode;
use crate::sk::{AxisTarget, FIFO_ENTRIES, FifoAction, MasterCommand, Motion, RawSlot, SlaveCommand};

/// \[OURS] Entries of the FIFO that a stream leaves free: commands of other programs and the ramp find room.
const SPARE: u16 = 10;
/// \[OURS] A stream asks for the second channels of HSPs with every so many frames, once the last answer is there.
const ASK_SECOND: u64 = 8;

/// What a stream did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StreamStats {
    /// Frames that steps have written.
    pub frames: u64,
    /// Cycles that found the FIFO empty since the first frame: each is a gap in the motion.
    pub underruns: u64,
    /// Times the board's FIFO-full count was seen increased: any is a loss (SK-5.10).
    pub losses: u64,
}

/// A stream of targets for all axes, one frame a step. There is one at a time.
///
/// Set targets with [`csp`](Stream::csp), [`csv`](Stream::csv) or [`cst`](Stream::cst), then [`step`](Stream::step), with
/// which they go out. A target is repeated in each frame until there is another one. [`finish`](Stream::finish) and dropping ramp what moves
/// to a standstill; the axes stay enabled.
///
/// Calls of [`Ecm`] by other threads ride in the frames of steps. One by the thread that steps writes frames of its own,
/// which repeat the last targets: between two steps of a motion it costs a cycle of standstill each.
pub struct Stream<'a> {
    ecm: &'a Ecm,
    depth: u16,
    aim: Aim,
    /// Frames that the board collects before it begins; 0: none.
    prefill: u16,
    frames: u64,
    /// It has stepped, and taken no target since.
    stepped: bool,
    underruns_before: u64,
    losses_before: u64,
    done: bool,
}

impl Ecm {
    /// Begins a stream that keeps up to `depth` frames ahead of the board: 1 to 150. That many cycles may the program
    /// be late, and that many cycles pass until a target acts. What is ahead runs when the stream ends too: with long cycles
    /// the depth is limited, so that closing ends within its 2 s.
    ///
    /// # Errors
    /// [`EcmError::Setting`], [`EcmError::TooDeep`], [`EcmError::WrongState`], [`EcmError::NoSuchSlave`] if nothing is configured,
    /// [`EcmError::Busy`] while there is another stream, [`EcmError::Link`].
    pub fn stream(&self, depth: u16) -> Result<Stream<'_>, EcmError> {
        if depth == 0 || depth > FIFO_ENTRIES - SPARE {
            return Err(EcmError::Setting { what: "depth", found: depth.to_string(), allowed: "1 to 150 frames" });
        }
        self.learn_seconds()?;
        let mut session = self.core.lock()?;
        self.core.catch_up(&mut session)?;
        require_op(&session, "a stream")?;
        declared(&session, 1)?;
        if session.pacer.is_some() {
            return Err(EcmError::Busy { what: "the stream" });
        }
        let cycle = session.plan.cycle();
        let max = deepest(cycle, self.core.options.ramp);
        if depth > max {
            return Err(EcmError::TooDeep { found: depth, max, cycle });
        }
        session.pacer = Some(pacer());
        session.credit.watch(true);
        let (underruns_before, losses_before) = (session.stats.underruns, session.stats.losses);
        let aim = Aim::new(&mut session, self.core.changes());
        Ok(Stream {
            ecm: self,
            depth,
            aim,
            prefill: 0,
            frames: 0,
            stepped: false,
            underruns_before,
            losses_before,
            done: false,
        })
    }
}

/// Frames that can be ahead of a board whose axes have to stand within the limit of closing.
fn deepest(cycle: Duration, ramp: Duration) -> u16 {
    let ramp = ramp.max(cycle * ramp::MIN_FRAMES);
    let left = CLOSE_LIMIT.saturating_sub(ramp + ramp::settle(cycle)).as_nanos();
    let frames = left / cycle.as_nanos().max(1);
    frames.clamp(1, (FIFO_ENTRIES - SPARE).into()) as u16
}

fn pacer() -> Pacer {
    Pacer { thread: thread::current().id(), last_step: Instant::now() }
}

impl Stream<'_> {
    /// Lets the board collect that many frames, 2 to the stream's depth, before it executes the first one (SET_FIFO's
    /// threshold): the motion begins with a full reserve. Before the first step. A stream that ends earlier drops them.
    /// Until then the board executes no command of other calls either: they wait.
    ///
    /// # Errors
    /// [`EcmError::Setting`] for another number, or once frames were written; [`EcmError::WrongState`],
    /// [`EcmError::Busy`], [`EcmError::Link`].
    pub fn prefill(&mut self, frames: u16) -> Result<(), EcmError> {
        if frames < 2 || frames > self.depth {
            let found = frames.to_string();
            return Err(EcmError::Setting { what: "prefill", found, allowed: "2 to the depth of the stream" });
        }
        if self.frames > 0 {
            let found = format!("set after {} frames", self.frames);
            return Err(EcmError::Setting { what: "prefill", found, allowed: "it before the first step" });
        }
        require_op(&*self.ecm.core.lock()?, "prefill")?;
        self.prefill = frames;
        Ok(())
    }

    /// The next target position of an axis in CSP, counts. The guard of the axis refuses one that is too far from the
    /// actual position of the newest report; nothing changes then.
    ///
    /// An HSP keeps its outputs. Its second axis goes on with its last target, without one it stays where it is.
    ///
    /// # Errors
    /// [`EcmError::TooFar`], [`EcmError::NotEnabled`], [`EcmError::Alarm`], [`EcmError::IsHoming`],
    /// [`EcmError::WrongMode`], [`EcmError::WrongKind`], [`EcmError::NoSuchSlave`], [`EcmError::WrongState`],
    /// [`EcmError::SlaveLost`], [`EcmError::SecondOff`], [`EcmError::Cleared`], [`EcmError::Link`].
    pub fn csp(&mut self, slave: u8, target: i32) -> Result<(), EcmError> {
        self.look()?;
        self.aim.first_at(slave, target, Mode::Csp, self.ecm.core.options.guard)
    }

    /// As [`csp`](Stream::csp), in the axis's units.
    ///
    /// # Errors
    /// As [`csp`](Stream::csp), and [`EcmError::OutOfRange`].
    pub fn csp_units(&mut self, slave: u8, units: f64) -> Result<(), EcmError> {
        self.look()?;
        let scale = self.aim.axis(slave)?.scale;
        self.csp(slave, scale.to_counts(units).ok_or(EcmError::OutOfRange { slave, units })?)
    }

    /// The next targets and outputs of an HSP in CSP, both channels. The guard looks at both.
    ///
    /// # Errors
    /// As [`csp`](Stream::csp).
    pub fn csp_hsp(&mut self, slave: u8, first: AxisTarget, second: AxisTarget) -> Result<(), EcmError> {
        self.aim(slave, SlaveCommand::Csp(Motion { first, second }))
    }

    /// The next target velocity of an axis in CSV, in the drive's units (0x60FF). It goes on until there is another. An HSP
    /// keeps its outputs, and its second axis its velocity.
    ///
    /// # Errors
    /// As [`csp`](Stream::csp), but for the guard.
    pub fn csv(&mut self, slave: u8, velocity: i32) -> Result<(), EcmError> {
        self.look()?;
        self.aim.first_at(slave, velocity, Mode::Csv, self.ecm.core.options.guard)
    }

    /// The next target velocities and outputs of an HSP in CSV, both channels.
    ///
    /// # Errors
    /// As [`csp`](Stream::csp), but for the guard.
    pub fn csv_hsp(&mut self, slave: u8, first: AxisTarget, second: AxisTarget) -> Result<(), EcmError> {
        self.aim(slave, SlaveCommand::Csv(Motion { first, second }))
    }

    /// The next target torque of an axis in CST, 0.1 % of rated. It goes on until there is another.
    ///
    /// # Errors
    /// As [`csp`](Stream::csp), but for the guard.
    pub fn cst(&mut self, slave: u8, torque: i16) -> Result<(), EcmError> {
        self.aim(slave, SlaveCommand::Cst(torque))
    }

    fn aim(&mut self, slave: u8, command: SlaveCommand) -> Result<(), EcmError> {
        self.look()?;
        self.aim.at(slave, command, self.ecm.core.options.guard)
    }

    /// Looks at the session again, if anything has changed: targets are checked by the newest report, and 40 of them in a
    /// row take no lock.
    fn look(&mut self) -> Result<(), EcmError> {
        let stepped = std::mem::take(&mut self.stepped);
        if stepped || self.aim.changes != self.ecm.core.changes() {
            let mut session = self.ecm.core.lock()?;
            // The program may have been away since the last step.
            if stepped {
                self.ecm.core.catch_up(&mut session)?;
            }
            self.aim.look(&mut session, self.ecm.core.changes());
        }
        Ok(())
    }

    /// Writes the next frame as soon as the board has room for it, and waits until there is room for another one: at
    /// most `depth` frames are ahead. So a loop of steps keeps the pace of the board, at least one frame a cycle, and
    /// several after a delay (SK-5.11). It does not allocate, waits for a report at most [`Options::read_limit`], and for
    /// room as long and 160 cycles.
    ///
    /// [`Options::read_limit`]: super::Options::read_limit
    ///
    /// # Errors
    /// [`EcmError::NoReport`], [`EcmError::Timeout`], [`EcmError::WrongState`] when the network has left OP,
    /// [`EcmError::Cleared`] after [`Ecm::clear_fifo`], [`EcmError::Link`]. Nothing is written then. What one axis does is no error here: the next target for it is refused.
    pub fn step(&mut self) -> Result<StreamStats, EcmError> {
        self.look()?;
        self.aim.leads_on()?;
        let core = &self.ecm.core;
        let mut session = core.lock()?;
        session.pacer = Some(pacer());
        core.catch_up(&mut session)?;
        self.ecm.pace(&mut session, self.depth, None)?;
        let threshold = [(0, threshold(self.prefill))];
        let prefills = self.frames == 0 && self.prefill > 0;
        if prefills && !session.post(&threshold) {
            return Err(EcmError::Busy { what: "the slot of the board" });
        }
        let asks = self.ask_second(&mut session);
        self.aim.go(&mut session);
        if let Err(error) = core.write_within(&mut session, core.options.write_limit) {
            if prefills {
                session.withdraw(&threshold);
            }
            if let Some(slot) = asks {
                session.withdraw(&[(slot, RawSlot::ZERO)]);
                session.second.not_asked();
            }
            return Err(error);
        }
        let hsps = session.plan.hsps;
        session.targets.stepped(hsps);
        self.frames += 1;
        self.stepped = true;
        // On virtual time the stamp of the frame is the time.
        let now = core.info.virtual_time.then(|| Duration::from_nanos(session.flushed_at.0));
        self.ecm.pace(&mut session, self.depth, now)?;
        self.aim.look(&mut session, core.changes());
        Ok(self.stats_of(&session))
    }

    /// Asks for the second channels in the SDO slot of the next frame, if nobody else uses that; gives the slot.
    fn ask_second(&self, session: &mut Session) -> Option<usize> {
        if !self.frames.is_multiple_of(ASK_SECOND) {
            return None;
        }
        let _turn = self.ecm.core.sdo_turn.try_lock()?;
        let plan = Arc::clone(&session.plan);
        let request = session.second.request(&plan, session.flushes)?;
        let slot = session.size.sdo_slot();
        if session.post(&[(slot, request.encode())]) {
            return Some(slot);
        }
        session.second.not_asked();
        None
    }

    /// The newest report, without waiting.
    ///
    /// # Errors
    /// [`EcmError::Busy`], [`EcmError::Link`].
    pub fn snapshot(&self) -> Result<Snapshot, EcmError> {
        self.ecm.snapshot()
    }

    /// What it did so far.
    ///
    /// # Errors
    /// [`EcmError::Busy`], [`EcmError::Link`].
    pub fn stats(&self) -> Result<StreamStats, EcmError> {
        Ok(self.stats_of(&*self.ecm.core.lock()?))
    }

    const fn stats_of(&self, session: &Session) -> StreamStats {
        StreamStats {
            frames: self.frames,
            underruns: session.stats.underruns - self.underruns_before,
            losses: session.stats.losses - self.losses_before,
        }
    }

    /// Ends it: axes that move are ramped to a standstill, within 2 s, and stay enabled.
    ///
    /// # Errors
    /// [`EcmError::Timeout`] if they still move then, [`EcmError::NoReport`], [`EcmError::Link`].
    pub fn finish(mut self) -> Result<StreamStats, EcmError> {
        self.end()
    }

    fn end(&mut self) -> Result<StreamStats, EcmError> {
        let core = &self.ecm.core;
        let mut session = core.lock()?;
        self.done = true;
        session.credit.watch(false);
        let stats = self.stats_of(&session);
        let deadline = core.now() + super::CLOSE_LIMIT;
        let dropped = if (1..u64::from(self.prefill)).contains(&self.frames) {
            self.ecm.drop_prefill(&mut session, deadline)
        } else {
            Ok(())
        };
        let stopped =
            dropped.and_then(|()| ramp::to_standstill(self.ecm, &mut session, deadline, &mut Left::default()));
        session.end_stream();
        stopped.map(|()| stats)
    }
}

impl Drop for Stream<'_> {
    fn drop(&mut self) {
        if !self.done
            && let Err(error) = self.end()
        {
            if !self.done {
                self.ecm.core.abandon();
            }
            log::warn!("a stream ended while axes may move: {error}");
        }
    }
}

/// The threshold that `frames` entries reach: it acts on arrival, before its frame is queued.
fn threshold(frames: u16) -> RawSlot {
    let threshold = FIFO_ENTRIES + 1 - frames;
    MasterCommand::SetFifo(FifoAction::Threshold(threshold.into())).encode()
}

impl Ecm {
    /// Nothing of what the board collects has run, and nothing shall.
    fn drop_prefill(&self, session: &mut Session, deadline: Duration) -> Result<(), EcmError> {
        if !session.in_op() {
            return Ok(());
        }
        session.targets.clear();
        // Whatever another thread has in that slot comes after it.
        let command = MasterCommand::SetFifo(FifoAction::Clear).encode();
        if !session.post(&[(0, command)]) {
            self.core.write(session, deadline)?;
            session.post(&[(0, command)]);
        }
        self.core.write(session, deadline)
    }

    /// Reads until fewer than `depth` frames are ahead of the board; `now`, if it is known.
    fn pace(&self, session: &mut Session, depth: u16, now: Option<Duration>) -> Result<(), EcmError> {
        require_op(session, "a stream")?;
        if session.credit.ahead() < depth {
            return Ok(());
        }
        let began = now.unwrap_or_else(|| self.core.now());
        // A board that runs has taken all out by then.
        let limit = self.core.patience(session) + session.plan.cycle() * FIFO_ENTRIES.into();
        let mut now = began;
        loop {
            if !self.core.read_at(session, now, began + limit)? {
                self.core.check_silence(session, began, "a stream")?;
            }
            require_op(session, "a stream")?;
            if session.credit.ahead() < depth {
                return Ok(());
            }
            now = self.core.now();
            let waited = now.saturating_sub(began);
            if waited >= limit {
                return Err(EcmError::Timeout {
                    what: "room in the FIFO",
                    waited,
                    seen: format!("{} entries are ahead of the board", session.credit.ahead()),
                    hint: "see what else writes to the board, or leave OP and enter it again",
                });
            }
        }
    }
}

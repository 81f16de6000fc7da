//! A cyclic stream of targets, paced by the board's FIFO: a stream writes a frame only if the FIFO has room for it, and
//! counts the cycles that find the FIFO empty. `checked_targets.rs` has the checks of targets.

mod checked_targets;

use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use checked_targets::CheckedTargets;

use super::exchange::session::StreamPacer;
use super::exchange::{Session, Stats, ahead_of_the_board};
use super::snapshot::Snapshot;
use super::standstill::{self, LeftBehind};
use super::{CLOSE_LIMIT, Ecm, EcmError};
use crate::ethercat::cia402::Mode;
use crate::link::LinkError;
use crate::sk::{AxisTarget, FIFO_ENTRIES, FifoAction, MasterCommand, Motion, RawSlot, SlaveCommand};

/// \[OURS] How many FIFO entries a stream leaves free, for commands of other calls and for the ramp to a standstill.
const SPARE_ENTRIES: u16 = 10;
/// \[OURS] How often a stream reads the statusword of a second channel by SDO: with every frame whose number is a
/// multiple of this, unless the previous request has no answer yet.
const SECOND_CHANNEL_FRAMES: u64 = 8;

/// Counters of a stream.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StreamStats {
    /// Frames written by the stream's steps.
    pub frames: u64,
    /// Cycles that found the FIFO empty since the first frame; each is a gap in the motion.
    pub underruns: u64,
    /// How often the board's FIFO-full count has risen; each rise means that the board has lost commands (SK-5.10).
    pub losses: u64,
}

/// A stream of targets for all axes, with one frame for each step. Only one stream can be open at a time.
///
/// Set targets with [`csp`](Stream::csp), [`csv`](Stream::csv) or [`cst`](Stream::cst), then call
/// [`step`](Stream::step), which sends them. Each frame repeats the target of an axis until the program sets another
/// one. [`finish`](Stream::finish) and dropping the stream bring the axes to a standstill: in CSP they hold their last
/// targets, or their actual positions if they are stationary far from these ([`Ecm::take_held_back`]); velocities and
/// torques are ramped to 0. The axes stay enabled.
///
/// Calls of [`Ecm`] in other threads send their commands in the frames of steps. A call in the thread that steps the
/// stream writes frames of its own, which repeat the last targets. Between two steps of a motion each such frame stops
/// the axes for a cycle.
pub struct Stream<'a> {
    ecm: &'a Ecm,
    depth: u16,
    targets: CheckedTargets,
    /// The number of frames that the board collects before it executes the first one; 0 if it executes each at once.
    prefill: u16,
    /// Frames written by the stream's steps.
    frames: u64,
    /// Whether no target was set since the last `step`. The next target is then checked against the reports that have
    /// come meanwhile.
    stepped: bool,
    /// The counters of the board when the stream began. The stream's own counters are the differences from them.
    before: Stats,
    done: bool,
}

impl Ecm {
    /// Begins a stream that keeps up to `depth` frames (1 to 150) waiting in the board's FIFO. The program may be late
    /// by `depth` cycles, and a target takes effect `depth` cycles after its step. Waiting frames are still executed
    /// when the stream ends: with long cycles the depth is limited, so that closing ends within 2 s.
    ///
    /// # Errors
    /// [`EcmError::Setting`] if `depth` is not 1 to 150, [`EcmError::TooDeep`] if it is too large for this cycle time,
    /// [`EcmError::WrongState`] outside OP, [`EcmError::NoSuchSlave`] if nothing is configured, [`EcmError::Busy`] while there
    /// is another stream, [`EcmError::Link`] if the link fails.
    pub fn stream(&self, depth: u16) -> Result<Stream<'_>, EcmError> {
        if depth == 0 || depth > FIFO_ENTRIES - SPARE_ENTRIES {
            return Err(EcmError::Setting { what: "depth", found: depth.to_string(), allowed: "1 to 150 frames" });
        }
        self.learn_second_channels()?;
        let mut session = self.exchange.lock_in_op("a stream")?;
        session.network.declared(1)?;
        if session.pacer.is_some() {
            return Err(EcmError::Busy { what: "the stream" });
        }
        let cycle = session.network.cycle();
        let max = depth_max(cycle, self.exchange.options.ramp);
        if depth > max {
            return Err(EcmError::TooDeep { found: depth, max, cycle });
        }
        session.pacer = Some(pacer());
        session.credit.count_underruns(true);
        let before = session.stats;
        let targets = CheckedTargets::new(&mut session, self.exchange.changes());
        Ok(Stream { ecm: self, depth, targets, prefill: 0, frames: 0, stepped: false, before, done: false })
    }
}

/// The largest depth with which all axes can come to a standstill within the time limit of closing.
fn depth_max(cycle: Duration, ramp: Duration) -> u16 {
    let ramp = ramp.max(cycle * standstill::RAMP_FRAMES_MIN);
    let left = CLOSE_LIMIT.saturating_sub(ramp + standstill::settling_time(cycle)).as_nanos();
    let frames = left / cycle.as_nanos().max(1);
    frames.clamp(1, (FIFO_ENTRIES - SPARE_ENTRIES).into()) as u16
}

fn pacer() -> StreamPacer {
    StreamPacer { thread: thread::current().id(), last_step: Instant::now() }
}

impl Stream<'_> {
    /// Prefill: the board collects `frames` frames (2 up to the stream's depth) before it executes the first one
    /// (SET_FIFO's threshold), so that the motion begins with a full reserve. Call it before the first step. If the
    /// stream ends before the board has collected them, they are discarded. While the board collects, it executes no
    /// commands of other calls either.
    ///
    /// # Errors
    /// [`EcmError::Setting`] for another number, or after frames were written; [`EcmError::WrongState`] outside OP,
    /// [`EcmError::Busy`] if another thread uses the board for too long, [`EcmError::Link`] once the board is closed.
    pub fn prefill(&mut self, frames: u16) -> Result<(), EcmError> {
        if frames < 2 || frames > self.depth {
            let found = frames.to_string();
            return Err(EcmError::Setting { what: "prefill", found, allowed: "2 to the depth of the stream" });
        }
        if self.frames > 0 {
            let found = format!("set after {} frames", self.frames);
            return Err(EcmError::Setting { what: "prefill", found, allowed: "it before the first step" });
        }
        self.ecm.exchange.lock()?.require_op("prefill")?;
        self.prefill = frames;
        Ok(())
    }

    /// Sets the next target position of an axis in CSP, counts. The guard of the axis refuses a target that is too far
    /// from the actual position in the newest report, and its soft limits refuse one that leads beyond them or further out.
    /// The axis then keeps its last target.
    ///
    /// An HSP keeps its outputs. Its second axis keeps its last target, or its actual position if it has had no target.
    ///
    /// # Errors
    /// [`EcmError::TooFar`] if the guard refuses the target, [`EcmError::SoftLimit`] if the limits do,
    /// [`EcmError::NotEnabled`] if the axis is off, [`EcmError::Alarm`] if it has an alarm, [`EcmError::IsHoming`] if it is
    /// homing, [`EcmError::SecondOff`] if the second channel of an HSP is off, [`EcmError::WrongMode`] if the axis is
    /// configured for another mode, [`EcmError::WrongKind`] and [`EcmError::NoSuchSlave`] for a slave that has no axis or
    /// is not configured, [`EcmError::SlaveLost`] if the slave is lost, [`EcmError::WrongState`] outside OP,
    /// [`EcmError::Cleared`] after [`Ecm::clear_fifo`], [`EcmError::Link`] if the link fails.
    pub fn csp(&mut self, slave: u8, target: i32) -> Result<(), EcmError> {
        self.refresh()?;
        self.targets.set_first(slave, target, Mode::Csp, self.ecm.exchange.options.guard)
    }

    /// As [`csp`](Stream::csp), in the units of the axis ([`Scale`](super::Scale)).
    ///
    /// # Errors
    /// As [`csp`](Stream::csp), and [`EcmError::OutOfRange`].
    pub fn csp_units(&mut self, slave: u8, units: f64) -> Result<(), EcmError> {
        self.refresh()?;
        let scale = self.targets.axis(slave)?.scale;
        self.csp(slave, scale.to_counts(units).ok_or(EcmError::OutOfRange { slave, units })?)
    }

    /// Sets the next targets and outputs of both channels of an HSP in CSP. The guard checks both targets.
    ///
    /// # Errors
    /// As [`csp`](Stream::csp).
    pub fn csp_hsp(&mut self, slave: u8, first: AxisTarget, second: AxisTarget) -> Result<(), EcmError> {
        self.set(slave, SlaveCommand::Csp(Motion { first, second }))
    }

    /// Sets the next target velocity of an axis in CSV, in the drive's units (0x60FF). The velocity stays until the
    /// program sets another one. An HSP keeps its outputs and the velocity of its second axis.
    ///
    /// # Errors
    /// As [`csp`](Stream::csp), except for the guard.
    pub fn csv(&mut self, slave: u8, velocity: i32) -> Result<(), EcmError> {
        self.refresh()?;
        self.targets.set_first(slave, velocity, Mode::Csv, self.ecm.exchange.options.guard)
    }

    /// Sets the next target velocities and outputs of both channels of an HSP in CSV.
    ///
    /// # Errors
    /// As [`csp`](Stream::csp), except for the guard.
    pub fn csv_hsp(&mut self, slave: u8, first: AxisTarget, second: AxisTarget) -> Result<(), EcmError> {
        self.set(slave, SlaveCommand::Csv(Motion { first, second }))
    }

    /// Sets the next target torque of an axis in CST, 0.1 % of the rated torque. The torque stays until the program
    /// sets another one.
    ///
    /// # Errors
    /// As [`csp`](Stream::csp), except for the guard.
    pub fn cst(&mut self, slave: u8, torque: i16) -> Result<(), EcmError> {
        self.set(slave, SlaveCommand::Cst(torque))
    }

    fn set(&mut self, slave: u8, command: SlaveCommand) -> Result<(), EcmError> {
        self.refresh()?;
        self.targets.set(slave, command, self.ecm.exchange.options.guard)
    }

    /// Copies the state of the session for the checks, if it has changed since the last copy. So targets are checked
    /// against the newest report, and setting 40 targets between two steps normally locks the session only once.
    fn refresh(&mut self) -> Result<(), EcmError> {
        let stepped = std::mem::take(&mut self.stepped);
        if stepped || self.targets.changes != self.ecm.exchange.changes() {
            let mut session = self.ecm.exchange.lock()?;
            // This is the first target after a step. The program may have waited long, so reports are read, and the
            // target is checked against the newest one.
            if stepped {
                self.ecm.exchange.catch_up(&mut session)?;
            }
            self.targets.refresh(&mut session, self.ecm.exchange.changes());
        }
        Ok(())
    }

    /// Writes the next frame as soon as fewer than `depth` frames wait in the FIFO, and then waits until fewer than
    /// `depth` frames wait again. So a loop of steps writes one frame per cycle, at the pace of the board, and several
    /// after a delay (SK-5.11). A step does not allocate. It waits for a report up to [`Options::read_limit`], and for
    /// room in the FIFO up to that time plus 160 cycles.
    ///
    /// [`Options::read_limit`]: super::Options::read_limit
    ///
    /// # Errors
    /// [`EcmError::NoReport`] if the board is silent, [`EcmError::Timeout`] if the FIFO has no room in time,
    /// [`EcmError::WrongState`] when the network has left OP, [`EcmError::Link`] if the link fails: these may also
    /// occur in the wait after the frame was written. [`EcmError::Cleared`] after [`Ecm::clear_fifo`],
    /// [`EcmError::Busy`] if another thread uses the board: then no frame was written. After [`LinkError::BeyondLimit`]
    /// the frame was written without its CSP targets. An axis that is switched off or lost is no error of this call:
    /// setting its next target is.
    pub fn step(&mut self) -> Result<StreamStats, EcmError> {
        self.refresh()?;
        self.targets.require_uncleared()?;
        let exchange = &self.ecm.exchange;
        let mut session = exchange.lock()?;
        session.pacer = Some(pacer());
        exchange.catch_up(&mut session)?;
        self.ecm.pace(&mut session, self.depth, None)?;
        let threshold = [(0, threshold(self.prefill))];
        let prefills = self.frames == 0 && self.prefill > 0;
        if prefills && !session.posts.post(&threshold) {
            return Err(EcmError::Busy { what: "the slot of the board" });
        }
        let asks = self.ask_second_channel(&mut session);
        self.targets.hand_over(&mut session);
        let written = exchange.write_within(&mut session, exchange.options.write_limit);
        // After BeyondLimit the board has got the frame as well, but without its CSP targets.
        if matches!(&written, Ok(()) | Err(EcmError::Link(LinkError::BeyondLimit { .. }))) {
            self.frames += 1;
            self.stepped = true;
        } else {
            if prefills {
                session.posts.withdraw(&threshold);
            }
            if let Some(slot) = asks {
                session.posts.withdraw(&[(slot, RawSlot::ZERO)]);
                session.second_channels.not_asked();
            }
        }
        written?;
        let hsps = session.network.hsps;
        session.targets.stepped(hsps);
        // In virtual time only calls let time pass, so the write time of the frame is the present time. Passing it on
        // saves a call of the link.
        let now = exchange.info.virtual_time.then(|| exchange.now_at(Duration::from_nanos(session.outgoing.last.at.0)));
        self.ecm.pace(&mut session, self.depth, now)?;
        self.targets.refresh(&mut session, exchange.changes());
        Ok(self.stats_of(&session))
    }

    /// Requests the statusword of a second channel in the SDO slot of the next frame, unless another call uses the SDO
    /// slot. Returns the number of the SDO slot, or `None` if nothing was requested.
    fn ask_second_channel(&self, session: &mut Session) -> Option<usize> {
        if !self.frames.is_multiple_of(SECOND_CHANNEL_FRAMES) {
            return None;
        }
        let _turn = self.ecm.exchange.sdo_turn.try_lock()?;
        let network = Arc::clone(&session.network);
        let frames = session.outgoing.written;
        let request = session.second_channels.request(&network, frames)?;
        let slot = session.size.sdo_slot();
        if session.posts.post(&[(slot, request.encode())]) {
            return Some(slot);
        }
        session.second_channels.not_asked();
        None
    }

    /// The newest report, without waiting for another one.
    ///
    /// # Errors
    /// [`EcmError::Busy`] if another thread uses the board for too long, [`EcmError::Link`] if the link has failed.
    pub fn snapshot(&self) -> Result<Snapshot, EcmError> {
        self.ecm.snapshot()
    }

    /// The counters of the stream so far.
    ///
    /// # Errors
    /// [`EcmError::Busy`] if another thread uses the board for too long, [`EcmError::Link`] once the board is closed.
    pub fn stats(&self) -> Result<StreamStats, EcmError> {
        Ok(self.stats_of(&*self.ecm.exchange.lock()?))
    }

    const fn stats_of(&self, session: &Session) -> StreamStats {
        StreamStats {
            frames: self.frames,
            underruns: session.stats.underruns - self.before.underruns,
            losses: session.stats.losses - self.before.losses,
        }
    }

    /// Ends the stream within 2 s. The axes stay enabled: in CSP they hold their last targets, in CSV and CST the
    /// velocities and torques are ramped to 0.
    ///
    /// An axis in CSP that is stationary more than 1000 counts from its last target is held at its actual position
    /// instead: as a rule it is jammed. [`Ecm::take_held_back`] returns these axes. So the next stream has to begin at
    /// the actual position of an axis, and not at the last target of this stream.
    ///
    /// # Errors
    /// [`EcmError::Timeout`] if axes still move after that, [`EcmError::NoReport`] if the board is silent, [`EcmError::Link`]
    /// if the link fails.
    pub fn finish(mut self) -> Result<StreamStats, EcmError> {
        self.end()
    }

    fn end(&mut self) -> Result<StreamStats, EcmError> {
        let exchange = &self.ecm.exchange;
        let mut session = exchange.lock()?;
        self.done = true;
        session.credit.count_underruns(false);
        let stats = self.stats_of(&session);
        let deadline = exchange.now() + CLOSE_LIMIT;
        let discarded = if (1..u64::from(self.prefill)).contains(&self.frames) {
            self.ecm.discard_prefill(&mut session, deadline)
        } else {
            Ok(())
        };
        let stopped = discarded
            .and_then(|()| standstill::to_standstill(self.ecm, &mut session, deadline, &mut LeftBehind::default()));
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
                self.ecm.exchange.abandon();
            }
            log::warn!("a stream ended while axes may move: {error}");
        }
    }
}

/// The SET_FIFO command for a threshold that is reached when the FIFO has `frames` entries. The board executes the
/// command on arrival, before the frame that carries it becomes an entry.
fn threshold(frames: u16) -> RawSlot {
    let threshold = FIFO_ENTRIES + 1 - frames;
    MasterCommand::SetFifo(FifoAction::Threshold(threshold.into())).encode()
}

impl Ecm {
    /// Discards the frames that the board has collected for a prefill. None was executed yet. If they stayed, they would
    /// begin a motion later that no program commands any more.
    fn discard_prefill(&self, session: &mut Session, deadline: Duration) -> Result<(), EcmError> {
        if !session.in_op() {
            return Ok(());
        }
        session.targets.clear();
        let clear = [(0, MasterCommand::SetFifo(FifoAction::Clear).encode())];
        self.exchange.write_commands(session, &clear, deadline)
    }

    /// Reads reports until fewer than `depth` frames are waiting. `now`: the present time, if known.
    fn pace(&self, session: &mut Session, depth: u16, mut now: Option<Duration>) -> Result<(), EcmError> {
        let mut began = None;
        loop {
            session.require_op("a stream")?;
            if session.credit.ahead() < depth {
                return Ok(());
            }
            let now = now.take().unwrap_or_else(|| self.exchange.now());
            let began = *began.get_or_insert(now);
            // Within this time a board in OP executes every entry, even if its FIFO was full, and a silent board is
            // noticed.
            let limit = self.exchange.silence_max(session) + session.network.cycle() * FIFO_ENTRIES.into();
            let waited = now.saturating_sub(began);
            if waited >= limit {
                return Err(EcmError::Timeout {
                    what: "room in the FIFO",
                    waited,
                    seen: ahead_of_the_board(session),
                    hint: "see what else writes to the board, or leave OP and enter it again",
                });
            }
            if !self.exchange.read_at(session, now, began + limit)? {
                self.exchange.check_silence(session, began, "a stream")?;
            }
        }
    }
}

//! Reads a run frame by frame: which features the program uses, in which circumstances, and when the host was late.

use super::network::Network;
use super::start::WayToOp;
use super::timing::{Clockwork, Write};
use super::usage::{Subject, Usage};
use super::{HostTiming, Place, Stretch};
use crate::compare::TimedFrame;
use crate::ethercat::cia402::Mode;
use crate::link::Dir;
use crate::recording::Kinds;
use crate::sk::{
    CommandId, CycleTime, FIFO_ENTRIES, Frame, MasterCommand, MasterResponse, MasterState, SdoCommand, SlaveCommand,
    SlaveKind, SlotCommand, SlotSize, StateByte,
};
use crate::summary::GapFinder;

const SLAVES: usize = crate::fieldbus::MAX_SLAVES;
/// A program works in a closed loop, from report to command, if at most this many command frames wait in the FIFO when
/// it writes. \[OURS]
const CLOSED_LOOP_SETS: u16 = 1;
/// A command counts as part of a closed loop only if the program also wrote the same command within this many cycles
/// before. \[OURS] For a rarer command a few more cycles of latency do not matter.
const CLOSED_LOOP_CYCLES: i64 = 10;
/// An axis counts as moving if its target changed within this many cycles. \[OURS]
const MOVING_CYCLES: i64 = 10;

/// Values that one frame shows, for a plot over time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Seen {
    /// For a report in OP: the number of command frames that wait in the board's FIFO. Otherwise `None`.
    pub level: Option<u16>,
    /// For a command in OP: the pause before it, if the motion was not over. Otherwise `None`.
    pub pause: Option<Stretch>,
    /// For a command in OP: the time for which the FIFO was empty during a motion. Otherwise `None`.
    pub gap: Option<Stretch>,
}

/// Reads a run frame by frame, to find the features that the program uses and the stalls of its host. The frames have
/// to be sorted by time.
#[derive(Debug)]
pub struct Survey {
    size: SlotSize,
    kinds: Kinds,
    pub(super) usage: Usage,
    clockwork: Clockwork,
    pub(super) network: Network,
    /// The network with the most process data per time, of those that have reached SafeOP. `None`: no network has
    /// reached SafeOP yet.
    pub(super) largest: Option<Network>,
    /// The interval from the first to the last frame of OP. `None`: there was no frame of OP yet.
    pub(super) op: Option<Stretch>,
    state: StateByte,
    /// The state of the last SET_STATE, until a report shows that it is reached or failed. Otherwise `None`.
    changing_to: Option<MasterState>,
    pub(super) way: WayToOp,
    full_count: Option<u16>,
    /// The number of command frames that waited in the FIFO at the newest report, and of those written since then.
    waiting: u16,
    sent_since: u16,
    /// For each command code: the time of the newest frame with it, and whether the program wrote it in a closed loop.
    newest_uses: [(i64, bool); 256],
    /// For each slave: its target, and when the target changed last.
    targets: [Option<(i32, i64)>; SLAVES],
    gaps: [GapFinder; SLAVES],
    /// The number of reports with an empty FIFO since the newest command.
    idle_reports: u32,
    sent_ns: i64,
    pub(super) commands: u64,
    pub(super) polls: u64,
    pub(super) reports: u64,
    pub(super) last_ns: i64,
}

impl Survey {
    /// A survey of frames with slots of this size.
    pub fn new(size: SlotSize) -> Self {
        Self {
            size,
            kinds: Kinds::new(None),
            usage: Usage::default(),
            clockwork: Clockwork::default(),
            network: Network::default(),
            largest: None,
            op: None,
            state: StateByte::default(),
            changing_to: None,
            way: WayToOp::default(),
            full_count: None,
            waiting: 0,
            sent_since: 0,
            newest_uses: [(i64::MIN, false); 256],
            targets: [None; SLAVES],
            gaps: std::array::from_fn(|_| GapFinder::default()),
            idle_reports: 0,
            sent_ns: i64::MIN,
            commands: 0,
            polls: 0,
            reports: 0,
            last_ns: 0,
        }
    }

    /// The timing of the host so far.
    pub const fn timing(&self) -> &HostTiming {
        &self.clockwork.timing
    }

    /// Processes the next frame of the run. Returns the values that the frame shows, for a plot.
    pub fn frame(&mut self, observed: &TimedFrame) -> Seen {
        let place = Place { frame: observed.number, at_ns: observed.at_ns };
        self.last_ns = observed.at_ns;
        match observed.dir {
            Dir::Write => self.command(place, &observed.frame),
            Dir::Read => self.report(place, &observed.frame),
        }
    }

    fn is_op(&self) -> bool {
        self.state.state() == Some(MasterState::Op)
    }

    fn is_in_op_at(&mut self, place: Place) {
        let op = self.op.get_or_insert(Stretch { from_ns: place.at_ns, to_ns: place.at_ns });
        op.to_ns = place.at_ns;
    }

    fn cycle_ns(&self) -> i64 {
        i64::from(self.network.cycle.us()) * 1000
    }

    fn command(&mut self, place: Place, frame: &Frame) -> Seen {
        let moved = self.any_moves(self.sent_ns);
        self.kinds.command(frame, self.size);
        let waiting = self.waiting.saturating_add(self.sent_since).min(FIFO_ENTRIES);
        let mut asks = self.board(place, frame);
        let mut gap_since_ns = None;
        for slave in 1..=self.size.max_slaves() {
            let slot = frame.slot(self.size, slave);
            let id = CommandId::from_code(slot.id);
            if id != CommandId::GetStatus {
                asks = true;
                self.slave(place, slave, id, frame, waiting);
            }
            if self.is_op() {
                match id {
                    CommandId::Csp => {
                        let since = self.gaps[slave - 1].target(place.at_ns, slot.data1 as i32);
                        gap_since_ns = gap_since_ns.max(since);
                    }
                    CommandId::GetStatus => {}
                    _ => self.gaps[slave - 1].reset(),
                }
            }
        }
        asks |= self.sdo(place, frame);
        *(if asks { &mut self.commands } else { &mut self.polls }) += 1;
        if !asks {
            self.usage.add(Subject::Command(CommandId::GetStatus), 1, place, false);
        }
        let mut seen = Seen::default();
        if self.is_op() {
            self.is_in_op_at(place);
            let cycle_ns = self.cycle_ns();
            let sets = waiting.saturating_add(1).min(FIFO_ENTRIES);
            seen.pause =
                self.clockwork.command(place, Write { waiting: self.waiting, sets, moved, gap_since_ns }, cycle_ns);
            seen.gap = gap_since_ns.map(|from_ns| Stretch { from_ns, to_ns: place.at_ns });
            self.sent_since = self.sent_since.saturating_add(1);
        }
        (self.sent_ns, self.idle_reports) = (place.at_ns, 0);
        seen
    }

    /// Processes slot 0 of a command frame. Returns whether it requests something.
    fn board(&mut self, place: Place, frame: &Frame) -> bool {
        let slot = frame.slot(self.size, 0);
        let id = CommandId::from_code(slot.id);
        if id == CommandId::GetStatus {
            return false;
        }
        let below_safe_op = !matches!(self.state.state(), Some(MasterState::SafeOp | MasterState::Op));
        match MasterCommand::decode(&slot, self.size) {
            Ok(MasterCommand::SetState(state)) => {
                // From a state below SafeOP, the change to SafeOP includes the whole configuration. So it takes longer
                // over a chip, as a change to OP does.
                self.usage.add(Subject::State(state), 1, place, state == MasterState::SafeOp && below_safe_op);
                self.gives_up(state, place);
                self.way.asks(self.state.state(), state, place);
                if state == MasterState::Op && self.is_op() && self.state.is_failed() {
                    self.usage.add(Subject::Return, 1, place, true);
                }
                if matches!(state, MasterState::SafeOp | MasterState::Op) {
                    self.leaves_pre_op(place);
                }
                self.changing_to = Some(state);
                return true;
            }
            Ok(MasterCommand::SetDc { cycle, .. }) => {
                self.usage.add(Subject::Cycle(cycle), 1, place, false);
                if below_safe_op {
                    self.network.cycle = cycle;
                }
            }
            Ok(MasterCommand::SoftReset) => {
                self.network = Network::default();
                self.way.ends();
            }
            _ => {}
        }
        let is_clear = id == CommandId::SetFifo && slot.parm & 0xFF == 1;
        self.usage.add(Subject::Command(id), 1, place, is_clear && self.is_op());
        true
    }

    /// Notes a request for a lower state before the requested higher state is reached: the program gave up waiting.
    fn gives_up(&mut self, state: MasterState, place: Place) {
        if let Some(awaited) = self.changing_to
            && state < awaited
            && self.state.state().is_none_or(|present| present < awaited)
        {
            self.usage.expose(Subject::State(awaited), place);
        }
    }

    /// Counts the declared slaves of each kind as features. Called when the program leaves PreOP, since all slaves are
    /// declared then.
    fn leaves_pre_op(&mut self, place: Place) {
        for slave in 1..=SLAVES {
            self.network.kinds[slave - 1] = self.kinds.of(slave);
        }
        let network = self.network;
        for kind in [SlaveKind::Drive, SlaveKind::Io, SlaveKind::Hsp, SlaveKind::Step] {
            self.usage.at_most(Subject::Kind(kind), network.count_of(kind) as u64, place);
        }
        for slave in network.slaves() {
            let mode = network.role(slave).mode();
            if let (Some(kind), Some(mode)) = (network.kinds[slave - 1], mode) {
                let same = |other: &usize| {
                    network.kinds[*other - 1] == Some(kind) && network.role(*other).mode() == Some(mode)
                };
                let count = network.slaves().filter(same).count() as u64;
                self.usage.at_most(Subject::Mode(kind, mode), count, place);
            }
        }
    }

    fn slave(&mut self, place: Place, slave: usize, id: CommandId, frame: &Frame, waiting: u16) {
        let slot = frame.slot(self.size, slave);
        let command = SlotCommand::decode(&slot, self.size).map(|slot| slot.command);
        let in_op = self.is_op();
        let exposed = match command {
            Ok(SlaveCommand::DriveMode { mode, .. }) if !in_op => {
                self.network.modes[slave - 1] = mode;
                false
            }
            Ok(SlaveCommand::Csp(motion) | SlaveCommand::Csv(motion)) => {
                self.network.second_channels[slave - 1] |= motion.second != Default::default();
                self.note_target(place, slave, motion.first.target, matches!(command, Ok(SlaveCommand::Csv(_))));
                self.is_closed_loop(place, id, waiting)
            }
            Ok(SlaveCommand::Cst(torque)) => {
                self.note_target(place, slave, torque.into(), true);
                self.is_closed_loop(place, id, waiting)
            }
            Ok(SlaveCommand::IoRead | SlaveCommand::IoWrite(_)) => self.is_closed_loop(place, id, waiting),
            Ok(SlaveCommand::ServoOn) => {
                let rises = self.network.modes[slave - 1] == Mode::Csp;
                rises && (1..=SLAVES).any(|other| other != slave && self.moves(other, place.at_ns))
            }
            _ => false,
        };
        self.usage.add(Subject::Command(id), 1, place, exposed && in_op);
    }

    fn is_closed_loop(&mut self, place: Place, id: CommandId, waiting: u16) -> bool {
        let recent_ns = CLOSED_LOOP_CYCLES * self.cycle_ns();
        let newest = &mut self.newest_uses[usize::from(id.code())];
        // The same command in several slots of one frame counts as one use.
        if newest.0 != place.at_ns {
            let is_recent = place.at_ns.saturating_sub(newest.0) <= recent_ns;
            *newest = (place.at_ns, is_recent && waiting <= CLOSED_LOOP_SETS);
        }
        newest.1
    }

    /// Notes the target of a slave. `goes_by_itself`: the target is a velocity or a torque, which keeps the axis moving
    /// unless it is 0.
    fn note_target(&mut self, place: Place, slave: usize, target: i32, goes_by_itself: bool) {
        let known = &mut self.targets[slave - 1];
        let goes_on = if goes_by_itself { target != 0 } else { known.is_some_and(|(before, _)| before != target) };
        let changed_ns = if goes_on { place.at_ns } else { known.map_or(i64::MIN, |(_, changed_ns)| changed_ns) };
        *known = Some((target, changed_ns));
    }

    fn moves(&self, slave: usize, at_ns: i64) -> bool {
        let recent_ns = MOVING_CYCLES * self.cycle_ns();
        self.targets[slave - 1].is_some_and(|(_, changed_ns)| at_ns.saturating_sub(changed_ns) <= recent_ns)
    }

    fn any_moves(&self, at_ns: i64) -> bool {
        (1..=SLAVES).any(|slave| self.moves(slave, at_ns))
    }

    /// Processes the SDO slot of a command frame. Returns whether it requests something.
    fn sdo(&mut self, place: Place, frame: &Frame) -> bool {
        let slot = frame.slot(self.size, self.size.sdo_slot());
        let during_change = self.changing_to.is_some();
        let (subject, id) = match SdoCommand::decode(&slot, self.size) {
            Ok(SdoCommand::GetStatus) => return false,
            Ok(SdoCommand::Read { object, .. }) => (Some(Subject::Read(object)), CommandId::SdoRead),
            Ok(SdoCommand::Write { object, .. }) => (Some(Subject::Write(object)), CommandId::SdoWrite),
            Ok(SdoCommand::Other(_)) | Err(_) => (None, CommandId::from_code(slot.id)),
        };
        self.usage.add(Subject::Command(id), 1, place, during_change);
        if let Some(subject) = subject {
            self.usage.add(subject, 1, place, during_change);
        }
        true
    }

    fn report(&mut self, place: Place, frame: &Frame) -> Seen {
        self.reports += 1;
        self.kinds.response(frame, self.size);
        let board = MasterResponse::decode(&frame.slot(self.size, 0));
        let before = std::mem::replace(&mut self.state, board.state);
        let has_failed = board.state.is_failed() && before != board.state;
        let is_reached = !board.state.is_failed() && board.state.state() == self.changing_to;
        if CommandId::from_code(board.id) == CommandId::SetAxis {
            self.network.found = self.network.found.max(board.result.min(SLAVES as u32) as usize);
        }
        self.way.shows(before, board.state, place);
        if has_failed || is_reached {
            self.changing_to = None;
        }
        let is_up = |state: StateByte| matches!(state.state(), Some(MasterState::SafeOp | MasterState::Op));
        if is_up(board.state) && !is_up(before) {
            self.came_up();
        }
        if !self.is_op() {
            self.leave_op();
            return Seen::default();
        }
        if before.state() == Some(MasterState::Op) && board.state.is_failed() && !before.is_failed() {
            self.usage.add(Subject::Lost, 1, place, true);
        }
        if self.op.is_none() && !self.usage.has(Subject::Cycle(self.network.cycle)) {
            self.usage.add(Subject::Cycle(self.network.cycle), 1, place, false);
        }
        self.is_in_op_at(place);
        let full = self.full_count.replace(board.full_count).unwrap_or(board.full_count);
        let lost = board.full_count.wrapping_sub(full);
        if lost > 0 {
            self.usage.add(Subject::FifoFull, lost.into(), place, false);
        }
        (self.waiting, self.sent_since) = (FIFO_ENTRIES.saturating_sub(board.fifo_free), 0);
        self.clockwork.report(place, self.waiting);
        if self.waiting == 0 && place.at_ns > self.sent_ns {
            self.idle_reports = self.idle_reports.saturating_add(1);
            // The first report with an empty FIFO only shows that the newest target was executed.
            if self.idle_reports > 1 {
                self.gaps.iter_mut().for_each(|gaps| gaps.idle(place.at_ns));
            }
        }
        Seen { level: Some(self.waiting), ..Seen::default() }
    }

    fn came_up(&mut self) {
        let needs = |network: &Network| {
            (network.output_bytes().max(network.input_bytes()) as u64 * 1_000_000) / u64::from(network.cycle.us())
        };
        if self.network.count() > 0 && self.largest.is_none_or(|largest| needs(&self.network) >= needs(&largest)) {
            self.largest = Some(self.network);
        }
    }

    fn leave_op(&mut self) {
        self.clockwork.left_op();
        self.gaps.iter_mut().for_each(GapFinder::reset);
        self.targets = [None; SLAVES];
        (self.waiting, self.sent_since, self.full_count) = (0, 0, None);
    }

    /// The cycle time of the largest network, or of the present one if none reached SafeOP.
    pub(super) fn cycle(&self) -> CycleTime {
        self.largest.map_or(self.network.cycle, |network| network.cycle)
    }
}

//! Extracts values for the metrics from the frames between a server and its board: states, positions, following errors,
//! alarms and gaps.

use ecmsk::link::uri::LinkUri;
use ecmsk::link::{Dir, KnownNetwork};
use ecmsk::recording::SizeFinder;
use ecmsk::sk::dump::MAX_SLAVES;
use ecmsk::sk::{
    CommandId, DriveResponse, FRAME_LEN, Frame, HspResponse, MasterResponse, MasterState, SlaveKind, SlotSize,
};
use ecmsk::summary::{FrameCounts, FrameEvent, FrameWatch};

use crate::monitor;
use crate::motion::{Axes, Quantity};
use crate::recording::Framed;

/// Processes the frames of a board.
pub struct Frames {
    finder: SizeFinder,
    size: SlotSize,
    watch: FrameWatch,
    axes: Axes,
    /// The kinds of the slaves, slave 1 first, as reported by the link or its server; empty if they are unknown.
    known: Vec<SlaveKind>,
    /// The number of alarms of each slave.
    alarms: [u64; MAX_SLAVES],
    /// The counts from before the last restart of `watch`: after the board was opened again, or another slot size was
    /// found.
    before: FrameCounts,
    /// The following error of each axis, from the latest report that has it, in counts.
    following: [Option<i64>; MAX_SLAVES],
}

/// The values of the latest report, and the counts so far.
#[derive(Clone, Default)]
pub struct Shown {
    /// Slot 0 of the report: the state of the board itself; `None` before the first report.
    pub board: Option<MasterResponse>,
    /// The number of gaps in motions (the FIFO was empty while an axis moved).
    pub gaps: u64,
    /// The number of command frames that found the FIFO full, from the count in slot 0.
    pub full: u64,
    /// The number of command frames with a wrong CRC, from the count in slot 0.
    pub bad_crc: u64,
    /// The known slaves, in network order.
    pub slaves: Vec<SlaveShown>,
}

/// The values of a slave in the latest report.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlaveShown {
    /// The number of the slave, from 1.
    pub number: u8,
    /// Its values as an axis; `None` if it has no axis, or the network is below SafeOP, where slots have no process
    /// data.
    pub axis: Option<AxisShown>,
    /// The number of its alarms since the server was started.
    pub alarms: u64,
}

/// The values of an axis in the latest report.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AxisShown {
    /// The statusword (0x6041), the actual position in counts and the error code (0x603F).
    pub drive: DriveResponse,
    /// The target in force minus the actual position, in counts; `None` if no target is in force.
    pub following_error: Option<i64>,
}

impl Default for Frames {
    fn default() -> Self {
        let size = SlotSize::default();
        Self {
            finder: SizeFinder::new(None),
            size,
            watch: FrameWatch::new(size),
            axes: Axes::new(),
            known: Vec::new(),
            alarms: [0; MAX_SLAVES],
            before: FrameCounts::default(),
            following: [None; MAX_SLAVES],
        }
    }
}

impl Frames {
    /// Must be called when the board was opened, for the first time or again. The counts continue.
    pub fn begin(&mut self, slot: Option<SlotSize>, uri: &LinkUri, network: Option<KnownNetwork>) {
        self.finder = SizeFinder::new(slot);
        self.known = monitor::known_kinds(None, uri, None, network).unwrap_or_default();
        self.begin_with(slot.unwrap_or_default());
    }

    fn begin_with(&mut self, size: SlotSize) {
        let FrameCounts { full, crc, gaps, .. } = self.counts();
        self.before = FrameCounts { full, crc, gaps, ..FrameCounts::default() };
        self.size = size;
        self.watch = FrameWatch::new(size);
        self.axes = Axes::new();
        self.following = [None; MAX_SLAVES];
    }

    fn counts(&self) -> FrameCounts {
        let (before, now) = (self.before, self.watch.counts());
        FrameCounts {
            full: before.full + now.full,
            crc: before.crc + now.crc,
            gaps: before.gaps + now.gaps,
            ..FrameCounts::default()
        }
    }

    /// Determines the slot size if the link does not know it. If it differs from the assumed size, processing starts
    /// anew.
    fn look_at_size(&mut self, frame: &Frame) {
        if self.finder.is_sure() {
            return;
        }
        self.finder.look(frame, FRAME_LEN);
        let (size, _) = self.finder.size();
        if size != self.size {
            self.begin_with(size);
        }
    }

    /// Processes a command frame that the board has accepted.
    pub fn command(&mut self, at_ns: i64, frame: &Frame) {
        self.look_at_size(frame);
        self.watch.command(at_ns, frame);
        self.axes.frame(&Framed::live(at_ns, Dir::Write, frame.clone(), self.size), &mut |_| {});
    }

    /// Processes a report of the board.
    pub fn report(&mut self, at_ns: i64, frame: &Frame) {
        self.look_at_size(frame);
        let alarms = &mut self.alarms;
        self.watch.report(at_ns, frame, &mut |event| {
            if let FrameEvent::Alarm(alarm) = event
                && let Some(count) = usize::from(alarm.slave).checked_sub(1).and_then(|place| alarms.get_mut(place))
            {
                *count += 1;
            }
        });
        let following = &mut self.following;
        self.axes.frame(&Framed::live(at_ns, Dir::Read, frame.clone(), self.size), &mut |value| {
            if value.quantity == Quantity::FollowingError
                && let Some(error) = value.slave.checked_sub(1).and_then(|place| following.get_mut(place))
            {
                *error = Some(value.value);
            }
        });
        for (slave, error) in (1..).zip(&mut self.following) {
            if self.axes.target(slave).is_none() {
                *error = None;
            }
        }
    }

    /// Copies the values of the latest report, which is `frame`, and the counts so far to `shown`.
    pub fn show(&self, frame: &Frame, shown: &mut Shown) {
        let board = MasterResponse::decode(&frame.slot(self.size, 0));
        let FrameCounts { full, crc, gaps, .. } = self.counts();
        (shown.full, shown.bad_crc, shown.gaps) = (full, crc, gaps);
        let has_data = matches!(board.state.state(), Some(MasterState::SafeOp | MasterState::Op));
        shown.board = Some(board);
        shown.slaves.clear();
        for slave in 1..=self.size.max_slaves() {
            let slot = frame.slot(self.size, slave);
            let kind = self.axes.kind(slave).or_else(|| self.known.get(slave - 1).copied());
            // If the host has declared its slaves before the server was started, their kinds are unknown. A slot with a
            // command for axes then counts as a drive.
            let kind = kind.or_else(|| CommandId::from_code(slot.id).is_for_axes().then_some(SlaveKind::Drive));
            let drive = match kind {
                None | Some(SlaveKind::None) => continue,
                Some(SlaveKind::Drive | SlaveKind::Step) => Some(DriveResponse::decode(&slot)),
                Some(SlaveKind::Hsp) => {
                    let hsp = HspResponse::decode(&slot, self.size);
                    Some(DriveResponse {
                        head: hsp.head,
                        statusword: hsp.statusword,
                        position: hsp.first.position,
                        ..DriveResponse::default()
                    })
                }
                Some(SlaveKind::Io) => None,
            };
            let axis = drive.filter(|_| has_data);
            let axis = axis.map(|drive| AxisShown { drive, following_error: self.following[slave - 1] });
            shown.slaves.push(SlaveShown { number: slave as u8, axis, alarms: self.alarms[slave - 1] });
        }
    }
}

//! Collects the state of a board from its frames, and makes the views that the monitor shows.

use std::sync::Arc;
use std::time::{Duration, Instant};

use ecmsk::engine::{Counters, Firmware};
use ecmsk::machine_file::{MachineAxis, MachineFile};
use ecmsk::recording::Kinds;
use ecmsk::sk::dump::{MAX_SLAVES, ResponseDump, SlotLine};
use ecmsk::sk::{Frame, MasterResponse, SlaveKind, SlotSize};

use crate::machine_option::alarm_words;

/// A board that has sent no report for longer than this is shown as silent. \[OURS]
const SILENT: Duration = Duration::from_secs(1);

/// A report with its time, its slot size, and the number of reports read so far.
#[derive(Clone, Debug)]
struct Sample {
    at_ns: i64,
    frame: Frame,
    size: SlotSize,
    reports: u64,
}

/// Counters since the monitor was started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// The number of reports that were read from the source.
    pub reports: u64,
    /// The number of reports that were lost before they were read.
    pub lost: u64,
    /// The number of reports with a wrong CRC.
    pub bad_crc: u64,
}

/// The state of a board, from all of its frames so far.
pub struct Watched {
    name: String,
    kinds: Kinds,
    newest: Option<Sample>,
    /// The latest report at the time of the previous view. Rates and velocities are computed from the change since
    /// then.
    shown: Option<Sample>,
    heard: Instant,
    /// The firmware version of the board, which decides the meaning of byte 1 of a slave's slot.
    pub firmware: Firmware,
    /// The numbers of reports that were read, lost or damaged.
    pub counts: Counts,
    /// The board's own counters; `None` if the link does not know them.
    pub counters: Option<Counters>,
    /// Why the source has ended, for example at the end of the recording; `None` while it delivers reports.
    pub end: Option<String>,
    /// The machine file with the names of axes and the texts of alarms.
    pub machine: Option<Arc<MachineFile>>,
    /// Whether the source is a board. Only then missing reports are shown as silence.
    pub live: bool,
}

/// The state of the board at one moment, to be displayed.
#[derive(Clone, Debug)]
pub struct View {
    /// The URI of the link, or the name of the recording.
    pub name: String,
    /// Slot 0 of the latest report, with state and FIFO; `None` before the first report.
    pub board: Option<MasterResponse>,
    /// The time of the latest report in nanoseconds, on the board's clock or in the recording's time.
    pub at_ns: i64,
    /// The number of reports per second since the previous view, on the clock of [`Self::at_ns`]; `None` in the first
    /// view.
    pub rate: Option<f64>,
    /// The numbers of reports that were read, lost or damaged.
    pub counts: Counts,
    /// The board's own counters.
    pub counters: Option<Counters>,
    /// A problem to show: why the source has ended, or that the board is silent.
    pub trouble: Option<String>,
    /// The slots to show, each with its number, slot 0 first.
    pub lines: Vec<(usize, SlotLine)>,
    /// The velocity of each slot's position since the previous view, in counts per second. The index is the slot
    /// number.
    pub velocities: Vec<Option<f64>>,
    /// The machine file, with the names of axes and the texts of alarms; `None` if there is none.
    pub machine: Option<Arc<MachineFile>>,
}

impl View {
    /// The axis in the machine file for the slave of a slot; `None` if there is no machine file, or no such axis in it.
    pub fn axis(&self, slot: usize) -> Option<&MachineAxis> {
        self.machine.as_ref()?.axis_of(u8::try_from(slot).ok()?)
    }

    /// The meaning of an error code of a slot's slave, from the machine file or else from CiA 402.
    pub fn alarm_text(&self, slot: usize, code: u16) -> &str {
        alarm_words(self.machine.as_deref(), u8::try_from(slot).unwrap_or(u8::MAX), code)
    }
}

impl Watched {
    /// Creates the state before the first frame. `kinds`: the kinds of the slaves, if they are known.
    pub fn new(name: String, kinds: Option<&[SlaveKind]>) -> Self {
        Self {
            name,
            kinds: Kinds::new(kinds),
            newest: None,
            shown: None,
            heard: Instant::now(),
            firmware: Firmware::default(),
            counts: Counts::default(),
            counters: None,
            end: None,
            machine: None,
            live: false,
        }
    }

    /// Processes a command frame that another program has sent.
    pub fn command(&mut self, frame: &Frame, size: SlotSize) {
        self.kinds.command(frame, size);
    }

    /// Processes a report. `at_ns` is its time, on the board's clock or since the first frame of the recording.
    pub fn report(&mut self, at_ns: i64, frame: &Frame, size: SlotSize) {
        self.kinds.response(frame, size);
        self.counts.reports += 1;
        self.heard = Instant::now();
        self.newest = Some(Sample { at_ns, frame: frame.clone(), size, reports: self.counts.reports });
    }

    /// Makes a view. The rates of the next view refer to the time since this one.
    pub fn view(&mut self) -> View {
        let silent = self.live && self.heard.elapsed() > SILENT;
        let silence = || format!("no report for {:.1} s", self.heard.elapsed().as_secs_f64());
        let trouble = self.end.clone().or_else(|| silent.then(silence));
        let mut view = View {
            name: self.name.clone(),
            board: None,
            at_ns: 0,
            rate: None,
            counts: self.counts,
            counters: self.counters,
            trouble,
            lines: Vec::new(),
            velocities: Vec::new(),
            machine: self.machine.clone(),
        };
        let Some(newest) = &self.newest else { return view };
        view.board = Some(MasterResponse::decode(&newest.frame.slot(newest.size, 0)));
        view.at_ns = newest.at_ns;
        view.lines = self.lines(newest);
        view.velocities = vec![None; newest.size.slots()];
        if let Some(shown) = &self.shown {
            let seconds = (newest.at_ns - shown.at_ns) as f64 / 1e9;
            if silent {
                view.rate = Some(0.0);
            } else if seconds > 0.0 {
                view.rate = Some((newest.reports - shown.reports) as f64 / seconds);
                for (i, velocity) in view.velocities.iter_mut().enumerate().skip(1) {
                    let position = |sample: &Sample| sample.frame.slot(sample.size, i).data1 as i32;
                    *velocity = Some((f64::from(position(newest)) - f64::from(position(shown))) / seconds);
                }
            }
        }
        self.shown = Some(newest.clone());
        view
    }

    fn lines(&self, sample: &Sample) -> Vec<(usize, SlotLine)> {
        let unknown = ResponseDump::new(&sample.frame, sample.size);
        let unknown = if self.firmware == Firmware::V15 { unknown.mode_in_byte_1() } else { unknown };
        let known: [SlaveKind; MAX_SLAVES] = std::array::from_fn(|i| self.kinds.of(i + 1).unwrap_or_default());
        let given = unknown.kinds(&known);
        let sdo = sample.size.sdo_slot();
        let line = |i: usize| {
            let line = if self.kinds.of(i).is_some() { given.line(i) } else { unknown.line(i) }?;
            // A slave of known kind is shown even if its slot is empty. A slave of kind "none" is never shown.
            let shown = match self.kinds.of(i) {
                Some(SlaveKind::None) => i == 0 || i == sdo,
                Some(_) => true,
                None => !line.is_idle() || i == 0,
            };
            (shown && (i != sdo || !line.is_idle())).then_some((i, line))
        };
        (0..sample.size.slots()).filter_map(line).collect()
    }
}

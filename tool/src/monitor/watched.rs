//! What was seen of a board up to now, and what of it is shown at a time.

use std::time::{Duration, Instant};

use ecmsk::engine::{Counters, Firmware};
use ecmsk::recording::Kinds;
use ecmsk::sk::dump::{MAX_SLAVES, ResponseDump, SlotLine};
use ecmsk::sk::{Frame, MasterResponse, SlaveKind, SlotSize};

/// A board may be silent for that long before it is said. \[OURS]
const SILENT: Duration = Duration::from_secs(1);

/// A report.
#[derive(Clone, Debug)]
struct Sample {
    at_ns: i64,
    frame: Frame,
    size: SlotSize,
    reports: u64,
}

/// Counts since the monitor began.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Reports read.
    pub reports: u64,
    /// Reports that were lost before they were read.
    pub lost: u64,
    /// Reports with a wrong CRC.
    pub bad_crc: u64,
}

/// All that was seen.
pub struct Watched {
    name: String,
    kinds: Kinds,
    newest: Option<Sample>,
    /// What was shown last: rates and speeds are since then.
    shown: Option<Sample>,
    heard: Instant,
    /// What byte 1 of a slave's slot is.
    pub firmware: Firmware,
    /// Reports.
    pub counts: Counts,
    /// The board's own counters, where the link can see them.
    pub counters: Option<Counters>,
    /// Why there is no more, if there is not.
    pub end: Option<String>,
    /// Whether silence is worth a word: not after a recording's end.
    pub live: bool,
}

/// What is shown at a time.
#[derive(Clone, Debug)]
pub struct View {
    /// The link or the recording.
    pub name: String,
    /// Slot 0; `None` before the first report.
    pub board: Option<MasterResponse>,
    /// When the report was made: nanoseconds of the board or since the recording's first frame.
    pub at_ns: i64,
    /// Reports in a second of that time, since the view before.
    pub rate: Option<f64>,
    /// Reports.
    pub counts: Counts,
    /// The board's own counters.
    pub counters: Option<Counters>,
    /// What is wrong.
    pub trouble: Option<String>,
    /// The slots to show, each with its number; slot 0 first.
    pub lines: Vec<(usize, SlotLine)>,
    /// How fast positions change, by slot: counts in a second.
    pub velocities: Vec<Option<f64>>,
}

impl Watched {
    /// Nothing yet. `kinds`: what slaves are, if it is known.
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
            live: false,
        }
    }

    /// A command frame went by, of somebody else.
    pub fn command(&mut self, frame: &Frame, size: SlotSize) {
        self.kinds.command(frame, size);
    }

    /// A report.
    pub fn report(&mut self, at_ns: i64, frame: &Frame, size: SlotSize) {
        self.kinds.response(frame, size);
        self.counts.reports += 1;
        self.heard = Instant::now();
        self.newest = Some(Sample { at_ns, frame: frame.clone(), size, reports: self.counts.reports });
    }

    /// What there is to show now. The next one's rates count from here.
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
            // A slave that is known is shown though it says nothing; one that is not there never is.
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

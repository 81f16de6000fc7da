//! Reduces a curve to the resolution of a picture. In each pixel column, only the first, the smallest, the largest and
//! the last sample are kept. So the drawn curve looks the same, and its size does not grow with the recording.

use super::Window;

/// A curve as a list of pieces, with interruptions between the pieces; each point is a time in seconds and a value.
pub type Pieces = Vec<Vec<(f64, f64)>>;

/// A sample: its time in nanoseconds, and its value.
type Sample = (i64, f64);

/// Builds a thinned curve from samples that are added one by one.
#[derive(Debug)]
pub struct Line {
    window: Window,
    columns: i64,
    /// Whether the value holds until the next sample, so that the line has steps instead of slopes.
    hold: bool,
    segments: Vec<Vec<Sample>>,
    column: Option<Column>,
    /// The last sample of a line with steps, whose value is still valid; `None` for other lines and after an interruption.
    held: Option<Sample>,
    /// The time of the last sample or interruption.
    latest_ns: i64,
    broken: bool,
}

/// The samples of a pixel column that are kept.
#[derive(Clone, Copy, Debug)]
struct Column {
    number: i64,
    first: Sample,
    least: Sample,
    greatest: Sample,
    last: Sample,
}

impl Line {
    /// An empty curve over the range `window`, which is drawn `columns` pixels wide.
    pub fn new(window: Window, columns: u32) -> Self {
        let columns = i64::from(columns.max(1));
        Self {
            window,
            columns,
            hold: false,
            segments: Vec::new(),
            column: None,
            held: None,
            latest_ns: i64::MIN,
            broken: true,
        }
    }

    /// An empty curve with steps: each value stays until the next sample.
    pub fn holding(window: Window, columns: u32) -> Self {
        Self { hold: true, ..Self::new(window, columns) }
    }

    /// Adds a sample. A time `at_ns` earlier than the last sample or interruption is replaced by the time of the
    /// latter. Samples outside the window are not drawn.
    pub fn push(&mut self, at_ns: i64, value: f64) {
        let at_ns = at_ns.max(self.latest_ns);
        self.latest_ns = at_ns;
        if self.hold {
            self.hold_until(at_ns);
            self.held = Some((at_ns, value));
        }
        self.add((at_ns, value));
    }

    /// Interrupts the curve until the next sample. An interruption within one pixel column is not drawn.
    pub fn interrupt(&mut self, at_ns: i64) {
        self.latest_ns = self.latest_ns.max(at_ns);
        self.hold_until(at_ns);
        self.held = None;
        self.broken = true;
    }

    /// Interrupts the curve even if the next sample is in the same pixel column. For a next sample that is unrelated to
    /// the previous one, such as a position relative to a new zero.
    pub fn break_off(&mut self, at_ns: i64) {
        self.interrupt(at_ns);
        self.close_column();
    }

    /// Completes the curve and returns its pieces, with times in seconds.
    pub fn finish(mut self) -> Vec<Vec<(f64, f64)>> {
        self.hold_until(self.window.to_ns);
        self.close_column();
        let seconds = |(at_ns, value): Sample| (super::seconds(at_ns), value);
        self.segments.into_iter().map(|segment| segment.into_iter().map(seconds).collect()).collect()
    }

    /// Extends a curve with steps to the time `at_ns`, by adding its present value there.
    fn hold_until(&mut self, at_ns: i64) {
        let Window { from_ns, to_ns } = self.window;
        let Some((since_ns, value)) = self.held.filter(|(since_ns, _)| *since_ns <= to_ns && at_ns >= from_ns) else {
            return;
        };
        self.add((since_ns.max(from_ns), value));
        self.add((at_ns.min(to_ns), value));
    }

    fn add(&mut self, sample: Sample) {
        if !self.window.contains(sample.0) {
            return;
        }
        let number = self.column_of(sample.0);
        match &mut self.column {
            // An interruption that begins and ends in the same pixel column cannot be seen, so it is ignored.
            Some(column) if column.number == number => {
                column.last = sample;
                if sample.1 < column.least.1 {
                    column.least = sample;
                }
                if sample.1 > column.greatest.1 {
                    column.greatest = sample;
                }
            }
            _ => {
                self.close_column();
                if self.broken || self.segments.is_empty() {
                    self.segments.push(Vec::new());
                }
                self.column = Some(Column { number, first: sample, least: sample, greatest: sample, last: sample });
            }
        }
        self.broken = false;
    }

    fn column_of(&self, at_ns: i64) -> i64 {
        let span = i128::from(self.window.to_ns) - i128::from(self.window.from_ns);
        let into = i128::from(at_ns) - i128::from(self.window.from_ns);
        // The cast loses nothing: `into` is at most `span`, so the number of the column is at most `columns`.
        (into * i128::from(self.columns) / span.max(1)) as i64
    }

    fn close_column(&mut self) {
        let (Some(column), Some(segment)) = (self.column.take(), self.segments.last_mut()) else { return };
        let mut samples = [column.first, column.least, column.greatest, column.last];
        samples[1..3].sort_by_key(|sample| sample.0);
        for sample in samples {
            if segment.last() != Some(&sample) {
                segment.push(sample);
            }
        }
    }
}

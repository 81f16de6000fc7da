//! Trends over the recordings of a folder: `ecmsk summary DIR`, and `ecmsk summary --by hour FILE`.
//!
//! Files:
//!
//! - `trends.rs`: reads the recordings one after the other; `trends/sources.rs`: finds and sorts the recordings
//! - `trends/machines.rs`: the units in which each recording is evaluated
//! - `trends/part.rs`: the results of a recording, an hour or a day; `trends/watch.rs`: collects them from frames
//! - `trends/motions.rs`: motions with the same start and end; `homings.rs`: positions of home; `reserve.rs`: the FIFO
//! - `trends/report.rs`: the trends as text and as JSON; `trends/page.rs`: the trends as an HTML page

mod homings;
mod machines;
mod motions;
mod page;
mod part;
mod report;
mod reserve;
mod sources;
mod watch;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

use clap::ValueEnum;
use ecmsk::machine_file::MachineFile;
use ecmsk::recording::{CarriedFile, RecordError};
use time::OffsetDateTime;

use super::fail_on::FailOn;
use super::{Args, SummaryError};
use crate::error::CliError;
use crate::filter::Times;
use crate::output;
use crate::recording::{Frames, Walked};
use crate::stderr::say;
use crate::visible::visible;
use machines::Machines;
use part::Part;
use report::Report;
use sources::{About, Source, Sources};
use watch::{Watch, Whole};

/// If there are more recordings than this, they are grouped by hours or days, unless `--by` is given. \[OURS] A longer
/// table is not useful.
const RECORDINGS_MAX: usize = 60;
/// Recordings of at most this many days are grouped by hours, of more days by days. \[OURS]
const HOURS_OF_DAYS_MAX: u64 = 3;
/// The largest number of skipped files that are named in notes. \[OURS]
const NAMED_MAX: usize = 20;

/// What a line of the trends is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum By {
    /// A recording
    Recording,
    /// An hour (UTC)
    Hour,
    /// A day (UTC)
    Day,
}

impl By {
    /// The length of a part of the time, ns; `None` if each part is a recording.
    const fn length_ns(self) -> Option<u64> {
        const HOUR_NS: u64 = 3_600_000_000_000;
        match self {
            Self::Recording => None,
            Self::Hour => Some(HOUR_NS),
            Self::Day => Some(24 * HOUR_NS),
        }
    }

    /// The word for a part of the time.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Recording => "recording",
            Self::Hour => "hour",
            Self::Day => "day",
        }
    }

    /// The default grouping for these recordings.
    fn usual(recordings: &[Source]) -> Self {
        if recordings.len() <= RECORDINGS_MAX || recordings.iter().any(|source| source.is_virtual) {
            return Self::Recording;
        }
        let days = |source: &Source| source.begin_ns / Self::Day.length_ns().unwrap_or(1);
        let (first, last) = (recordings.iter().map(days).min(), recordings.iter().map(days).max());
        match first.zip(last) {
            Some((first, last)) if last - first < HOURS_OF_DAYS_MAX => Self::Hour,
            _ => Self::Day,
        }
    }

    /// The number of the part to which a frame belongs. `recording` is the number of its recording, `at_ns` its time.
    fn part(self, recording: usize, at_ns: u64) -> u64 {
        self.length_ns().map_or(recording as u64, |length_ns| at_ns / length_ns)
    }

    fn name(self, file: &Path, at_ns: u64) -> String {
        let at = OffsetDateTime::from_unix_timestamp_nanos(at_ns.into()).unwrap_or(OffsetDateTime::UNIX_EPOCH);
        match self {
            Self::Recording => visible(&file.file_name().unwrap_or(file.as_os_str()).to_string_lossy()),
            Self::Hour => format!("{} {:02} h", at.date(), at.hour()),
            Self::Day => at.date().to_string(),
        }
    }
}

/// Runs `ecmsk summary` for a folder, or for a recording by hours or days.
///
/// # Errors
/// [`CliError`] if the folder or the machine file cannot be read, if there is no recording, if an output file cannot be written,
/// or if standard output cannot be written to.
pub fn run(args: &Args) -> Result<ExitCode, CliError> {
    if args.times.times() != Times::default() {
        return Err(SummaryError::TimesOfTrends.into());
    }
    let mut machines = Machines::new(args.machine.as_deref())?;
    let about = About { size: args.slot_size, device: args.device };
    let mut sources = if args.file.is_dir() {
        let failed = |source| SummaryError::Folder { folder: args.file.clone(), source };
        Sources::of(&args.file, about).map_err(failed)?
    } else {
        Sources::of_file(&args.file, about)?
    };
    let by = args.by.unwrap_or_else(|| By::usual(&sources.recordings));
    if by != By::Recording
        && let Some(source) = sources.recordings.iter().find(|source| source.is_virtual)
    {
        return Err(SummaryError::NoDays { file: source.file.clone() }.into());
    }
    let reasons = args.reasons();
    let mut trends = Trends { by, parts: BTreeMap::new(), is_clean: true, failures: vec![Vec::new(); reasons.len()] };
    let recordings = std::mem::take(&mut sources.recordings);
    for (number, source) in recordings.iter().enumerate() {
        match trends.read(number, source, about) {
            Ok((whole, is_whole, carried)) => {
                let machine = machines.of(carried)?;
                trends.judge(source, &whole, is_whole, &reasons, machine.as_deref());
            }
            Err(error) => sources.pass_over_unread(&source.file, error),
        }
    }
    trends.judge_damaged(&sources.damaged, &reasons);
    note_passed_over(&sources);
    if trends.parts.is_empty() {
        return Err(SummaryError::NoRecording { folder: args.file.clone() }.into());
    }
    if machines.differ() {
        say(
            "note",
            &"the recordings have different units, so the tables are in counts; --machine FILE shows all in its units",
        );
    }
    let machine = machines.common();
    let parts: Vec<(u64, Part)> = trends.parts.into_iter().collect();
    let report = Report { folder: &args.file, by, parts: &parts, sources: &sources, machine };
    output::print(if args.json { format!("{}\n", report.json()) } else { report.text() })?;
    if let Some(file) = &args.html {
        args.page(file).write(page::html(&report)?.as_bytes()).map_err(SummaryError::from)?;
    }
    args.end(&reasons, &trends.failures, trends.is_clean)
}

fn note_passed_over(sources: &Sources) {
    for (file, why) in sources.passed_over.iter().take(NAMED_MAX) {
        say("note", &format_args!("{}: passed over: {why}", file.display()));
    }
    if let Some(more @ 1..) = sources.passed_over.len().checked_sub(NAMED_MAX) {
        say("note", &format_args!("{more} more files are passed over; --json names all"));
    }
}

/// The trends that are collected while recordings are read.
struct Trends {
    by: By,
    parts: BTreeMap<u64, Part>,
    /// Whether nothing went wrong in any recording, and all recordings are complete.
    is_clean: bool,
    /// For each reason of `--fail-on`, the texts that say why runs have failed.
    failures: Vec<Vec<String>>,
}

impl Trends {
    /// Reads a recording. Returns its results, whether it is complete (up to the last written frame, if it is still
    /// being written), and the machine file in the recording.
    fn read(
        &mut self,
        number: usize,
        source: &Source,
        about: About,
    ) -> Result<(Whole, bool, Option<Arc<CarriedFile>>), RecordError> {
        let Self { by, parts, .. } = self;
        let mut frames = Frames::open(&source.file, about.size, source.device)?;
        let carried = frames.carried();
        let mut watch = Watch::new();
        let mut within: Vec<u64> = Vec::new();
        // The times of frames are relative to the opening of the board, but the times of parts are those of the
        // recording's clock.
        let mut zero_ns = None;
        let walked = frames.walk(i64::MAX, |framed| {
            let of_clock = |at_ns: u64| i128::from(at_ns) - i128::from(framed.time_ns);
            let zero_ns = *zero_ns.get_or_insert_with(|| of_clock(framed.recorded.at_ns));
            let at_ns = (zero_ns + i128::from(framed.time_ns)).clamp(0, u64::MAX.into()) as u64;
            let key = by.part(number, at_ns);
            let part = parts.entry(key).or_insert_with(|| Part::new(by.name(&source.file, at_ns), at_ns));
            if within.last() != Some(&key) && !within.contains(&key) {
                within.push(key);
                part.recordings += 1;
            }
            watch.frame(framed, i64::try_from(at_ns.saturating_sub(part.begin_ns)).unwrap_or(i64::MAX), part);
        })?;
        let is_growing = source.is_growing();
        let is_whole = is_whole(&frames, &walked, is_growing);
        if is_growing && is_whole {
            say("note", &format_args!("{}: it is being written; what came later is missing", source.file.display()));
        } else {
            frames.note_walked(&walked);
        }
        if !is_whole {
            for key in within {
                parts.entry(key).and_modify(|part| part.incomplete += 1);
            }
        }
        Ok((watch.finish(), is_whole, carried))
    }

    fn judge(
        &mut self,
        source: &Source,
        whole: &Whole,
        is_whole: bool,
        reasons: &[FailOn],
        machine: Option<&MachineFile>,
    ) {
        self.is_clean &= whole.summary.is_empty() && is_whole;
        let axes: Vec<_> = whole.axes.iter().map(|(slave, extremes)| (*slave, extremes)).collect();
        for (reason, failures) in reasons.iter().zip(&mut self.failures) {
            let found = reason.reason.failures(&whole.summary, is_whole, &axes, machine);
            failures.extend(found.into_iter().map(|why| format!("{}: {why}", source.file.display())));
        }
    }
}

impl Trends {
    /// Handles recordings that cannot be read at all. They count as incomplete.
    fn judge_damaged(&mut self, damaged: &[PathBuf], reasons: &[FailOn]) {
        self.is_clean &= damaged.is_empty();
        for (_, failures) in reasons.iter().zip(&mut self.failures).filter(|(reason, _)| reason.is_any()) {
            failures.extend(damaged.iter().map(|file| format!("{}: it cannot be read", file.display())));
        }
    }
}

/// Whether a recording is complete. While it is being written, it may end without an end mark or within a frame.
fn is_whole(frames: &Frames<Box<dyn std::io::Read + Send>>, walked: &Walked, is_growing: bool) -> bool {
    let is_as_written = |error: &RecordError| is_growing && matches!(error, RecordError::Truncated { .. });
    let lacks = frames.lacks().unwrap_or_default();
    walked.damage.as_ref().is_none_or(is_as_written)
        && lacks.missing == 0
        && lacks.damage.count == 0
        && (is_growing || lacks.not_ended == 0)
}

//! `ecmsk assert`: judges a recorded run by a file of rules.
//!
//! Files:
//!
//! - `assert.rs`: the verb, and the judgement of each rule
//! - `assert/rules.rs`: the file of rules
//! - `assert/events.rs`: the events of a run

mod events;
mod rules;

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use clap::ValueHint;
use ecmsk::cia402::ErrorCode;
use ecmsk::link::Dir;
use ecmsk::machine_file::MachineFile;
use ecmsk::recording::{Address, RecordError};
use ecmsk::sk::SlotSize;
use ecmsk::summary::{FrameWatch, Summary};
use serde_json::json;

use events::{Finder, Occurrence};
use rules::{Event, Limit, Rules, RulesError, What};

use super::error::CliError;
use super::filter::Times;
use super::junit::{self, Case};
use super::machine_option::label;
use super::output_file::{OutputFileError, OverwriteOption};
use super::recording::{Frames, parse_device};
use super::summary::extremes::{AxisExtremes, Extremes, named, seconds};
use super::{machine_option, output, slot_size};

/// Judge a recorded run by rules: limits of axes, the order of events, times
///
/// The rules are a TOML file. `fail_on` has conditions as `ecmsk summary --fail-on`; [axes.N] or [axes.NAME] limits, in
/// counts or with the units of the machine file; [[events]] what has to come in that order: a state, an alarm, homing that is
/// attained, with times; [[never]] what must not come. Standard output has a line for each rule. Times count from the opening
/// of the board, in a capture from the first frame.
#[derive(clap::Args)]
#[command(after_help = "\
Example of RULES:
  format = 1
  fail_on = [\"state\", \"gap\"]
  at_most = \"10s\"
  [axes.1]
  following_error = 5000
  torque = 80
  [[events]]
  state = \"op\"
  by = \"3s\"
  [[events]]
  homed = 1
  within = \"5s\"
  [[never]]
  alarm = \"any\"

Exit codes: 0 every rule is kept, 1 one is broken, 2 the run could not be judged, for example because the recording is not
whole.")]
pub struct Args {
    /// The recording or capture; - for standard input
    #[arg(value_name = "FILE", value_hint = ValueHint::FilePath)]
    file: PathBuf,

    /// The file of rules
    #[arg(value_name = "RULES", value_hint = ValueHint::FilePath)]
    rules: PathBuf,

    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, help = machine_option::HELP)]
    machine: Option<PathBuf>,

    /// Bytes of a slot, 12 or 16 [default: from the recording, else from its CRCs]
    #[arg(long, value_name = "12|16", value_parser = slot_size::parse)]
    slot_size: Option<SlotSize>,

    /// In a capture with several boards, use the one at BUS.DEVICE
    #[arg(long, value_name = "BUS.DEVICE", value_parser = parse_device)]
    device: Option<Address>,

    /// Print one JSON object
    #[arg(long)]
    json: bool,

    /// Write the result of each rule to this file, in the JUnit format
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    junit: Option<PathBuf>,

    #[command(flatten)]
    overwrite: OverwriteOption,
}

/// Why a run was not judged.
#[derive(Debug, thiserror::Error)]
pub enum AssertError {
    /// The recording cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordError),
    /// The machine file cannot be used.
    #[error(transparent)]
    Machine(#[from] ecmsk::machine_file::MachineFileError),
    /// The file of rules cannot be used.
    #[error(transparent)]
    Rules(#[from] RulesError),
    /// The file of `--junit` cannot be written.
    #[error(transparent)]
    Junit(#[from] OutputFileError),
    /// The recording has no frame.
    #[error("{0} holds no frame; record a program that opens a board")]
    NoFrame(String),
    /// The recording is not whole, and what it has breaks no rule.
    #[error("no rule is broken, but the recording is not whole: {0}; record the run again")]
    NotWhole(String),
}

/// The judgement of one rule.
struct Judged {
    /// The rule in words.
    rule: String,
    /// Whether the run keeps the rule.
    is_kept: bool,
    /// What the run did, as text.
    found: String,
    /// The time in the recording to which the judgement refers, ns; 0 for rules of the whole run.
    at_ns: i64,
}

/// What the recording of a run shows.
struct Run {
    summary: Summary,
    extremes: Extremes,
    found: Vec<Occurrence>,
    /// The times of the first frame and of the last one.
    times_ns: (i64, i64),
    /// What the recording lacks; `None`: it is whole.
    lacks: Option<String>,
}

/// Runs `ecmsk assert`: reads the rules and the recording, and prints the judgement of each rule.
///
/// # Errors
/// [`AssertError`] if the run could not be judged; [`CliError::Output`] if standard output cannot be written to.
pub fn run(args: &Args) -> Result<ExitCode, CliError> {
    let junit = args.junit.as_deref().map(|file| junit::output(file, args.overwrite.replace()));
    junit.map_or(Ok(()), |junit| junit.check()).map_err(AssertError::from)?;
    let (run, rules, machine) = read(args)?;
    let machine = machine.as_ref();
    let judged = judge(&rules, &run, machine);
    let broken = judged.iter().filter(|judged| !judged.is_kept).count();
    let text = if args.json { json_line(args, &judged, &run) } else { lines(&judged) };
    output::print(text)?;
    if let Some(junit) = &junit {
        junit::write(junit, &format!("ecmsk assert {}", args.file.display()), &cases(&judged, &run, broken))
            .map_err(AssertError::from)?;
    }
    match run.lacks {
        _ if broken > 0 => Ok(ExitCode::FAILURE),
        Some(lacks) => Err(AssertError::NotWhole(lacks).into()),
        None => Ok(ExitCode::SUCCESS),
    }
}

/// Reads the rules and the recording. Returns what the run did, the rules, and the machine file in whose units they are.
fn read(args: &Args) -> Result<(Run, Rules, Option<MachineFile>), AssertError> {
    let (from_stdin, carried) = machine_option::carried_by(&args.file, args.slot_size, args.device)?;
    let machine = machine_option::of_recording(args.machine.as_deref(), carried.as_deref())?;
    let rules = Rules::load(&args.rules, machine.as_ref())?;
    let mut frames = match from_stdin {
        Some(frames) => frames,
        None => Frames::open_board(&args.file, args.slot_size, args.device)?,
    };
    let (mut extremes, mut summary, mut finder) = (Extremes::new(Times::default()), Summary::default(), Finder::new());
    let (mut watch, mut times_ns) = (None, (0, 0));
    let walked = frames.walk(i64::MAX, |framed| {
        let (at_ns, frame) = (framed.time_ns, &framed.recorded.frame);
        extremes.frame(framed);
        let watch = watch.get_or_insert_with(|| {
            times_ns.0 = at_ns;
            FrameWatch::new(framed.size)
        });
        watch.damage(framed.recorded.damage_before);
        times_ns.1 = at_ns;
        match framed.recorded.dir {
            Dir::Write => watch.command(at_ns, frame),
            Dir::Read => watch.report(at_ns, frame, &mut |event| {
                summary.add_event(event);
                finder.event(at_ns, event);
            }),
        }
        finder.frame(framed);
    })?;
    frames.note_zero();
    frames.note_jumps(&walked);
    let Some(watch) = watch else { return Err(AssertError::NoFrame(args.file.display().to_string())) };
    summary.set_frame_counts(&watch.counts());
    // A damaged recording is judged too, because the frames before the damage may break rules.
    let lacks = walked.damage.map(|damage| damage.to_string()).or_else(|| Some(frames.lacks()?.to_string()));
    let run = Run { summary, extremes, found: finder.found, times_ns, lacks };
    Ok((run, rules, machine))
}

fn judge(rules: &Rules, run: &Run, machine: Option<&MachineFile>) -> Vec<Judged> {
    let axes: Vec<(usize, &AxisExtremes)> = run.extremes.axes().collect();
    let mut judged = Vec::new();
    for (text, reason) in &rules.fail_on {
        let failures = reason.failures(&run.summary, run.lacks.is_none(), &axes, machine);
        let found = if failures.is_empty() { "none".to_owned() } else { failures.join("; ") };
        judged.push(Judged { rule: format!("no {text}"), is_kept: failures.is_empty(), found, at_ns: 0 });
    }
    let (first_ns, last_ns) = run.times_ns;
    let lasts_ns = last_ns.saturating_sub(first_ns);
    let lasts = ns(lasts_ns);
    for (limit, words, is_kept) in [
        (rules.at_least, "at least", rules.at_least.is_none_or(|limit| lasts >= limit)),
        (rules.at_most, "at most", rules.at_most.is_none_or(|limit| lasts <= limit)),
    ] {
        if let Some(limit) = limit {
            let rule = format!("the run lasts {words} {}", words_of(limit));
            judged.push(Judged { rule, is_kept, found: seconds(lasts_ns), at_ns: 0 });
        }
    }
    judged.extend(rules.limits.iter().map(|limit| judge_limit(limit, run, &axes, machine)));
    judge_events(&rules.events, run, machine, &mut judged);
    for what in &rules.never {
        let came = run.found.iter().find(|seen| seen.what.is(*what));
        let found = came.map_or_else(|| "it did not come".to_owned(), |came| format!("at {}", seconds(came.at_ns)));
        let rule = format!("never: {}", words_of_event(*what, machine));
        judged.push(Judged { rule, is_kept: came.is_none(), found, at_ns: came.map_or(0, |came| came.at_ns) });
    }
    judged
}

fn judge_limit(limit: &Limit, run: &Run, axes: &[(usize, &AxisExtremes)], machine: Option<&MachineFile>) -> Judged {
    let name = limit.quantity.word().replace('-', " ");
    let meant: Vec<_> = axes
        .iter()
        .filter(|(slave, _)| limit.slave.is_none_or(|wanted| usize::from(wanted) == *slave))
        .copied()
        .collect();
    let whose = limit.slave.map_or_else(|| "all axes".to_owned(), |slave| format!("axis {}", label(machine, slave)));
    let rule = format!("{whose}: {name} at most {}", limit.text);
    if meant.is_empty() {
        // A limit for an axis without commands could never be exceeded, so it counts as broken.
        return Judged {
            rule,
            is_kept: false,
            found: "no command for such an axis is in the recording".into(),
            at_ns: 0,
        };
    }
    let failures = limit.above.failures(&run.summary, true, &meant, machine);
    let is_kept = failures.is_empty();
    let largest = meant.iter().max_by_key(|(_, extremes)| extremes.of(limit.quantity).value);
    let (slave, peak) = largest.map_or((0, Default::default()), |(slave, axis)| (*slave, axis.of(limit.quantity)));
    let found = match failures.is_empty() {
        true => format!("{} at {}", limit.quantity.shown(peak.value, named(slave, machine).0), seconds(peak.at_ns)),
        false => failures.join("; "),
    };
    Judged { rule, is_kept, found, at_ns: peak.at_ns }
}

/// Judges the events: each has to come after the one before. If an event did not come, the search for the next one
/// begins at the last event that came.
fn judge_events(events: &[Event], run: &Run, machine: Option<&MachineFile>, judged: &mut Vec<Judged>) {
    let (mut next, mut before_ns) = (0, 0);
    for (number, event) in (1..).zip(events) {
        let mut rule = format!("event {number}: {}", words_of_event(event.what, machine));
        let times = [("within", event.within), ("by", event.by), ("not before", event.not_before)];
        for (word, time) in times.into_iter().filter_map(|(word, time)| Some((word, time?))) {
            rule += &format!(", {word} {}", words_of(time));
        }
        let came = run.found[next..].iter().position(|seen| seen.what.is(event.what)).map(|at| next + at);
        let Some(at) = came else {
            let earlier = run.found[..next].iter().rfind(|seen| seen.what.is(event.what));
            let found = match earlier {
                Some(earlier) => {
                    format!("it came at {}, before the event before, and not again", seconds(earlier.at_ns))
                }
                None => "it did not come".to_owned(),
            };
            judged.push(Judged { rule, is_kept: false, found, at_ns: 0 });
            continue;
        };
        let at_ns = run.found[at].at_ns;
        let (after, since) = (ns(at_ns), ns(at_ns.saturating_sub(before_ns)));
        let is_kept = event.within.is_none_or(|within| since <= within)
            && event.by.is_none_or(|by| after <= by)
            && event.not_before.is_none_or(|earliest| after >= earliest);
        let since = if event.within.is_some() {
            format!(", after {}", seconds(at_ns.saturating_sub(before_ns)))
        } else {
            String::new()
        };
        judged.push(Judged { rule, is_kept, found: format!("at {}{since}", seconds(at_ns)), at_ns });
        (next, before_ns) = (at + 1, at_ns);
    }
}

fn ns(time_ns: i64) -> Duration {
    Duration::from_nanos(u64::try_from(time_ns).unwrap_or_default())
}

fn words_of(time: Duration) -> String {
    format!("{} s", time.as_secs_f64())
}

fn words_of_event(what: What, machine: Option<&MachineFile>) -> String {
    match what {
        What::State(state) => format!("{state} is reached"),
        What::Homed(slave) => format!("axis {} is homed", label(machine, slave)),
        What::Alarm { slave, code } => {
            let who = slave.map_or_else(|| "any axis".to_owned(), |slave| format!("axis {}", label(machine, slave)));
            let which = code.map_or_else(|| "an alarm".to_owned(), |code| format!("alarm {}", ErrorCode(code)));
            format!("{who} has {which}")
        }
    }
}

fn lines(judged: &[Judged]) -> String {
    let word = |judged: &Judged| if judged.is_kept { "kept" } else { "broken" };
    judged.iter().map(|judged| format!("{}: {}: {}\n", word(judged), judged.rule, judged.found)).collect()
}

fn json_line(args: &Args, judged: &[Judged], run: &Run) -> String {
    let rule = |judged: &Judged| {
        let Judged { rule, is_kept, found, at_ns } = judged;
        json!({"rule": rule, "kept": is_kept, "found": found, "at_s": *at_ns as f64 / 1e9})
    };
    let rules: Vec<_> = judged.iter().map(rule).collect();
    let broken = judged.iter().filter(|judged| !judged.is_kept).count();
    let file = args.file.display().to_string();
    format!("{}\n", json!({"verb": "assert", "file": file, "broken": broken, "lacks": run.lacks, "rules": rules}))
}

fn cases(judged: &[Judged], run: &Run, broken: usize) -> Vec<Case> {
    let case = |judged: &Judged| Case {
        name: judged.rule.clone(),
        failure: (!judged.is_kept).then(|| judged.found.clone()),
        time: Duration::ZERO,
    };
    let mut cases: Vec<_> = judged.iter().map(case).collect();
    if let Some(lacks) = run.lacks.as_ref().filter(|_| broken == 0) {
        let name = "the recording is whole".to_owned();
        cases.push(Case { name, failure: Some(lacks.clone()), time: Duration::ZERO });
    }
    cases
}

//! The result of a comparison as one JSON object.

use ecmsk::compare::{
    CompareOptions, Comparison, Context, Deviation, Difference, Gaps, LatencyStretch, RunCounts, Side,
};
use serde::Serialize;
use serde_json::{Value, json};

use super::Names;

#[derive(Serialize)]
struct Found<'a> {
    equal: bool,
    a: Run,
    b: Run,
    /// The number of commands that both runs have answered.
    answers: u64,
    differing_answers: u64,
    /// The number of answers that the other run shows some cycles earlier or later.
    shifted_answers: u64,
    /// How many of the board's cycles B answers later than A; null if no command shows it.
    latency: Option<Later>,
    /// The run that ends early: `a` or `b`.
    ends_early: Option<&'static str>,
    first: Option<First<'a>>,
    context: Vec<Before<'a>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    plot: Option<String>,
}

#[derive(Serialize)]
struct Run {
    file: String,
    commands: u64,
    polls: u64,
    repeats: u64,
    reports: u64,
    /// The gaps of this run: additional cycles in a motion that the other run does not have.
    gaps: Value,
    /// The time of the run's last frame, in nanoseconds since its first one.
    last_ns: i64,
    /// Whether the recording is complete, as far as it is known, and (next field) what it lacks if not.
    whole: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    lacks: Option<String>,
}

/// How many of the board's cycles the run B answers later than the run A; negative if it answers earlier.
#[derive(Serialize)]
struct Later {
    commands: u64,
    usual_cycles: i64,
    least_cycles: i64,
    most_cycles: i64,
    /// The latency over time, in stretches of commands with the same latency: the first command of each, and its
    /// latency in cycles.
    stretches: Vec<Value>,
}

impl Later {
    fn of(found: &Comparison) -> Option<Self> {
        let latency = &found.latency;
        let stretch = |LatencyStretch { from_command, cycles }: &LatencyStretch| json!({ "from_command": from_command, "cycles": cycles });
        (latency.commands > 0).then(|| Self {
            commands: latency.commands,
            usual_cycles: latency.usual,
            least_cycles: latency.least,
            most_cycles: latency.most,
            stretches: latency.stretches.iter().map(stretch).collect(),
        })
    }
}

/// The first difference. Pairs are the values of A and B, null where a run has ended.
#[derive(Serialize)]
struct First<'a> {
    command: u64,
    text: &'a str,
    frames: [Option<u64>; 2],
    at_ns: [Option<i64>; 2],
    what: Vec<Value>,
    message: String,
}

#[derive(Serialize)]
struct Before<'a> {
    command: u64,
    at_ns: [i64; 2],
    text: &'a str,
}

impl<'a> First<'a> {
    fn of(first: &'a Difference) -> Self {
        Self {
            command: first.command,
            text: &first.text,
            frames: first.frames,
            at_ns: first.at_ns,
            what: first.what.iter().map(value).collect(),
            message: first.to_string(),
        }
    }
}

/// The result of a comparison as one JSON object.
pub fn object(names: &Names, found: &Comparison, options: &CompareOptions) -> Value {
    let run = |i: usize| {
        let (file, lacks) = (names.runs[i].clone(), names.lacks[i].clone());
        let RunCounts { commands, polls, repeats, reports, last_ns } = found.counts[i];
        let Gaps { count, cycles, longest } = found.gaps[i];
        let gaps = json!({ "count": count, "cycles": cycles, "longest_cycles": longest });
        Run { file, commands, polls, repeats, reports, gaps, last_ns, whole: lacks.is_none(), lacks }
    };
    let context =
        found.context.iter().map(|Context { command, at_ns, text }| Before { command: *command, at_ns: *at_ns, text });
    let json = Found {
        equal: names.code(found, options) == 0,
        a: run(0),
        b: run(1),
        answers: found.answers,
        differing_answers: found.differing_answers,
        shifted_answers: found.shifted_answers,
        latency: Later::of(found),
        ends_early: found.ends_early.map(side),
        first: found.first.as_ref().map(First::of),
        context: context.collect(),
        plot: names.plot.as_ref().map(|file| file.display().to_string()),
    };
    json!(json)
}

const fn side(side: Side) -> &'static str {
    match side {
        Side::A => "a",
        Side::B => "b",
    }
}

/// One difference: its subject, the slave if it concerns one, both values if they are numbers, and a text.
fn value(what: &Deviation) -> Value {
    let (kind, values) = match what {
        Deviation::Command { .. } => ("command", None),
        Deviation::Ends { side: at } => ("ends", Some(json!(side(*at)))),
        Deviation::Lost { side: at } => ("lost_commands", Some(json!(side(*at)))),
        Deviation::Late { cycles, .. } => ("late", Some(json!(cycles))),
        Deviation::State { states } => ("state", Some(json!(states.map(|state| state.0)))),
        Deviation::Result { results } => ("result", Some(json!(results))),
        Deviation::Fault { side: at, .. } => ("fault", Some(json!(side(*at)))),
        Deviation::Statusword { words, .. } => ("statusword", Some(json!(words.map(|word| word.0)))),
        Deviation::ErrorCode { codes, .. } => ("error_code", Some(json!(codes))),
        Deviation::Position { counts, .. } => ("position_counts", Some(json!(counts))),
        Deviation::Inputs { bits, .. } => ("inputs", Some(json!(bits))),
        Deviation::Kind { .. } => ("kind", None),
        Deviation::Sdo { .. } => ("sdo", None),
        Deviation::NoSdoAnswer { side: at, .. } => ("sdo_without_answer", Some(json!(side(*at)))),
    };
    json!({ "of": kind, "slave": what.slave(), "values": values, "text": what.to_string() })
}

//! Formats the result of a comparison as a JSON object.

use ecmsk::compare::{
    CompareOptions, Comparison, Context, Deviation, Difference, Gaps, LatencyStretch, RunCounts, Side,
};
use serde_json::{Value, json};

use super::Names;

/// The result of a comparison as a JSON object. A pair has the values of the runs A and B, with null for a run that has
/// ended.
pub fn object(names: &Names, found: &Comparison, options: &CompareOptions) -> Value {
    let before =
        |Context { command, at_ns, text }: &Context| json!({ "command": command, "at_ns": at_ns, "text": text });
    let mut object = json!({
        "equal": names.code(found, options) == 0,
        "a": run(names, found, 0),
        "b": run(names, found, 1),
        // `answers`: the number of commands that both runs have answered. `shifted_answers`: how many of these answers
        // occur in the other run some cycles earlier or later.
        "answers": found.answers,
        "differing_answers": found.differing_answers,
        "shifted_answers": found.shifted_answers,
        "latency": later(found),
        "ends_early": found.ends_early.map(side),
        "first": found.first.as_ref().map(first),
        "context": found.context.iter().map(before).collect::<Vec<_>>(),
    });
    if let Some(plot) = &names.plot {
        object["plot"] = plot.display().to_string().into();
    }
    object
}

/// The data of one run. Its gaps are additional cycles in a motion that the other run does not have. Its last time is
/// relative to its first frame.
fn run(names: &Names, found: &Comparison, i: usize) -> Value {
    let RunCounts { commands, polls, repeats, reports, last_ns } = found.counts[i];
    let Gaps { count, cycles, longest } = found.gaps[i];
    let mut run = json!({
        "file": names.runs[i], "commands": commands, "polls": polls, "repeats": repeats, "reports": reports,
        "gaps": { "count": count, "cycles": cycles, "longest_cycles": longest },
        "last_ns": last_ns, "whole": names.lacks[i].is_none(),
    });
    if let Some(lacks) = &names.lacks[i] {
        run["lacks"] = lacks.clone().into();
    }
    run
}

/// By how many cycles of the board run B answers later than run A (negative: earlier). The stretches show how this
/// changes over time: each has consecutive commands with the same latency. `None` if no command shows a latency.
fn later(found: &Comparison) -> Option<Value> {
    let latency = &found.latency;
    let stretch = |LatencyStretch { from_command, cycles }: &LatencyStretch| json!({ "from_command": from_command, "cycles": cycles });
    (latency.commands > 0).then(|| {
        json!({
            "commands": latency.commands,
            "usual_cycles": latency.usual,
            "least_cycles": latency.least,
            "most_cycles": latency.most,
            "stretches": latency.stretches.iter().map(stretch).collect::<Vec<_>>(),
        })
    })
}

/// The first difference, as a JSON object.
fn first(first: &Difference) -> Value {
    json!({
        "command": first.command, "text": first.text, "frames": first.frames, "at_ns": first.at_ns,
        "what": first.what.iter().map(value).collect::<Vec<_>>(), "message": first.to_string(),
    })
}

const fn side(side: Side) -> &'static str {
    match side {
        Side::A => "a",
        Side::B => "b",
    }
}

/// One difference as a JSON object: its kind, the slave if it concerns one, both values if they are numbers, and a
/// text.
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

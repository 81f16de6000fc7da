//! The result of `ecmsk migrate` as a JSON object. Programs rely on its field names, so they must not change;
//! docs/TOOL-RECORDINGS.md lists them.

use ecmsk::migrate::{Ahead, HostTiming, Item, Needs, Packets, Place, Plan, Refused, SeenBy, Spread, Start, Verdict};
use serde_json::{Value, json};

use super::Report;

/// The result of `ecmsk migrate` as a JSON object.
pub fn object(report: &Report) -> Value {
    let found = report.found;
    let plan = found.plan.as_ref();
    let rows = found.rows();
    let mut object = json!({
        "file": report.file.display().to_string(),
        "link": report.link,
        "behind_chip": report.is_behind_chip,
        "commands": found.commands,
        "polls": found.polls,
        "reports": found.reports,
        "last_ns": found.last_ns,
        "in_op": found.op.is_some(),
        "whole": report.lacks.is_none(),
        "lacks": report.lacks,
        "runs": report.runs(),
        "uses": found.items.iter().map(item).collect::<Vec<_>>(),
        "rows": rows.iter().map(|row| json!({ "id": row.id(), "meaning": row.meaning() })).collect::<Vec<_>>(),
        "cycle_us": found.cycle.us(),
        "host": found.op.map(|_| host(&found.timing)),
        "start": plan.map(start),
        "ahead": plan.map(|plan| ahead(&plan.ahead)),
        "chip": plan.map(|plan| chip(&plan.needs)),
        "links": plan.map(|plan| json!({ "machine": plan.links.machine, "model": plan.links.model })),
    });
    if let (Some(plot), Value::Object(fields)) = (report.plot, &mut object) {
        fields.insert("plot".to_owned(), plot.display().to_string().into());
    }
    object
}

fn item(item: &Item) -> Value {
    let count = &item.count;
    json!({
        "group": count.subject.group(),
        "name": count.subject.to_string(),
        "times": count.times,
        "first": place(count.first),
        "exposed_times": count.exposed,
        "first_exposed": count.first_exposed.map(place),
        "verdict": verdict(&item.verdict),
    })
}

fn verdict(verdict: &Verdict) -> Value {
    let (reason, next) = match verdict {
        Verdict::No { reason, next, .. } => (Some(reason), Some(next)),
        Verdict::Yes | Verdict::Differs(_) => (None, None),
    };
    json!({ "runs": verdict.word(), "row": verdict.row().map(ecmsk::migrate::Row::id), "reason": reason, "next": next })
}

fn place(place: Place) -> Value {
    json!({ "frame": place.frame, "at_ns": place.at_ns })
}

fn host(timing: &HostTiming) -> Value {
    let sets = |per_cent| timing.levels.percentile(per_cent);
    let longest = |found: Option<(i64, Place)>| found.map(|(ns, ended)| json!({ "ns": ns, "ended": place(ended) }));
    json!({
        "op_ns": timing.op_ns,
        "fifo_sets": { "median": sets(50), "p99": sets(99), "most": sets(100) },
        "pause_ns": spread(&timing.pauses),
        "longest_pause_in_motion": longest(timing.longest_pause),
        "silence_ns": spread(&timing.silences),
        "repeated_cycles": timing.repeated_cycles,
        "gaps": timing.gaps,
        "longest_gap": longest(timing.longest_gap),
    })
}

fn spread(spread: &Spread) -> Value {
    json!({
        "count": spread.count(),
        "median": spread.percentile(50),
        "p99": spread.percentile(99),
        "longest": spread.longest_ns(),
    })
}

fn start(plan: &Plan) -> Value {
    let Start { recorded, chip_ns, timeout_ms } = plan.start;
    json!({
        "slaves": plan.network.length(),
        "recorded_ns": recorded.map(|(ns, _)| ns),
        "ended": recorded.map(|(_, ended)| place(ended)),
        "chip_ns": chip_ns,
        "state_timeout_ms": timeout_ms,
    })
}

fn ahead(ahead: &Ahead) -> Value {
    let stall = ahead.stall.map(|stall| {
        let seen_by = match stall.seen_by {
            SeenBy::Silence => "silence",
            SeenBy::LateWrite => "late write",
        };
        json!({
            "ns": stall.ns,
            "cycles": ahead.stall_cycles,
            "whole_ns": stall.whole_ns,
            "usual_ns": stall.usual_ns,
            "sets": stall.sets,
            "seen_by": seen_by,
            "ended": place(stall.ended),
        })
    });
    json!({
        "value": ahead.value,
        "stall_known": ahead.is_known,
        "stall": stall,
        "transport_sets": ahead.transport_sets,
        "verdict": verdict(&ahead.verdict),
    })
}

fn chip(needs: &Needs) -> Value {
    json!({
        "output_bytes": needs.output_bytes,
        "input_bytes": needs.input_bytes,
        "least_n": needs.least_size().map(|size| size.bytes()),
        "clock_hz": needs.clock_hz,
        "with_int0": packets(&needs.with_int0),
        "without_int0": packets(&needs.without_int0),
        "fifo_entries": needs.entries,
        "ahead_max": needs.ahead_max,
    })
}

fn packets(packets: &Result<Packets, Refused>) -> Value {
    match packets {
        Ok(packets) => json!({
            "holds": true,
            "n": packets.size.bytes(),
            "sets": packets.sets,
            "in_flight": packets.in_flight,
            "least_clock_hz": packets.least_clock_hz,
        }),
        Err(refused) => json!({
            "holds": false,
            "reason": refused.reason(),
            "next_cycle_us": refused.next_cycle.map(|cycle| cycle.us()),
        }),
    }
}

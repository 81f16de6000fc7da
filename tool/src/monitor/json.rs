//! Formats a view as a JSON object. Its slots have the same form as in `ecmsk dump --json`.

use ecmsk::engine::Counters;
use ecmsk::sk::dump::{SlaveData, SlotLine, SlotMeaning};
use serde_json::{Value, json};

use super::rows::has_position;
use super::watched::View;
use crate::dump::slot_json::SlotJson;

/// The JSON object, followed by a line feed. `reports_per_s` refers to the board's clock.
pub fn line(view: &View) -> String {
    let velocity = |(i, line): &(usize, SlotLine)| {
        let counts_per_s = view.velocities.get(*i).copied().flatten()?;
        has_position(line).then(|| json!({"slave": i, "counts_per_s": counts_per_s}))
    };
    let mut object = json!({
        "name": view.name,
        "time_ns": view.at_ns,
        "reports": view.counts.reports,
        "reports_lost": view.counts.lost,
        "reports_bad_crc": view.counts.bad_crc,
        "slots": view.lines.iter().map(|(i, line)| SlotJson::of(*i, line)).collect::<Vec<_>>(),
        "velocities": view.lines.iter().filter_map(velocity).collect::<Vec<_>>(),
    });
    let axes: Vec<Value> = view.lines.iter().filter_map(|(i, line)| axis_json(*i, line, view)).collect();
    let known = [
        ("reports_per_s", view.rate.map(Value::from)),
        ("counters", view.counters.as_ref().map(counters_json)),
        ("trouble", view.trouble.clone().map(Value::from)),
        ("axes", (!axes.is_empty()).then(|| axes.into())),
    ];
    for (name, value) in known {
        if let Some(value) = value {
            object[name] = value;
        }
    }
    format!("{object}\n")
}

/// The axis of a slot, with its position in the unit of the machine file. `None` if the machine file does not have the
/// axis, or the slot has no position.
fn axis_json(slot: usize, line: &SlotLine, view: &View) -> Option<Value> {
    let SlotMeaning::SlaveResponse(reading) = &line.meaning else { return None };
    let axis = view.axis(slot)?;
    let counts = match &reading.data {
        SlaveData::Drive(drive) => drive.position,
        SlaveData::Hsp(hsp) => hsp.first.position,
        _ => return None,
    };
    let position = axis.scale.to_units(counts);
    let mut json = json!({"slave": axis.slave, "name": axis.name, "unit": axis.unit.word(), "position": position});
    if let Some(velocity) = view.velocities.get(slot).copied().flatten() {
        json["units_per_s"] = (velocity / axis.scale.counts_per_unit).into();
    }
    Some(json)
}

fn counters_json(counters: &Counters) -> Value {
    json!({
        "frames": counters.frames,
        "executed": counters.executed,
        "full": counters.full,
        "crc": counters.crc,
        "incomplete": counters.incomplete,
        "rejected": counters.rejected_total(),
        "idle_cycles": counters.idle_cycles,
        "outputs_lost": counters.outputs_lost,
        "answers_lost": counters.answers_lost,
        "cycles_left_out": counters.cycles_left_out,
        "ring_broken": counters.ring_broken,
        "inputs_held": counters.inputs_held,
        "inputs_stale": counters.inputs_stale,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each counter is shown with its own value under its own name.
    #[test]
    fn each_counter_has_its_value() {
        let counters = Counters {
            frames: 1,
            executed: 2,
            full: 3,
            crc: 4,
            incomplete: 5,
            idle_cycles: 6,
            outputs_lost: 7,
            answers_lost: 8,
            cycles_left_out: 9,
            ring_broken: 10,
            inputs_held: 11,
            inputs_stale: 12,
            ..Counters::default()
        };
        let shown = counters_json(&counters);
        let names = ["frames", "executed", "full", "crc", "incomplete", "idle_cycles", "outputs_lost", "answers_lost"];
        let names = names.into_iter().chain(["cycles_left_out", "ring_broken", "inputs_held", "inputs_stale"]);
        for (value, name) in (1_u64..).zip(names) {
            assert_eq!(shown[name], value, "{name}");
        }
    }
}

//! Prints a view as one JSON object. Its slots have the form of `ecmsk dump --json`.

use ecmsk::engine::Counters;
use ecmsk::sk::dump::{SlaveData, SlotLine, SlotMeaning};
use serde::Serialize;

use super::watched::View;
use crate::dump::slot_json::SlotJson;

#[derive(Serialize)]
struct ViewJson<'a> {
    name: &'a str,
    time_ns: i64,
    reports: u64,
    /// Reports per second of the board's time.
    #[serde(skip_serializing_if = "Option::is_none")]
    reports_per_s: Option<f64>,
    reports_lost: u64,
    reports_bad_crc: u64,
    /// The board's own counters; `None` if the link does not know them.
    #[serde(skip_serializing_if = "Option::is_none")]
    counters: Option<CountersJson>,
    #[serde(skip_serializing_if = "Option::is_none")]
    trouble: Option<&'a str>,
    slots: Vec<SlotJson>,
    velocities: Vec<Velocity>,
    /// The axes of the machine file, in their units.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    axes: Vec<AxisJson<'a>>,
}

#[derive(Serialize)]
struct AxisJson<'a> {
    slave: u8,
    name: &'a str,
    unit: &'static str,
    position: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    units_per_s: Option<f64>,
}

impl<'a> AxisJson<'a> {
    /// The axis of a slot; `None` unless the machine file has it and the slot a position.
    fn of(slot: usize, line: &SlotLine, view: &'a View) -> Option<Self> {
        let SlotMeaning::SlaveResponse(reading) = &line.meaning else { return None };
        let axis = view.axis(slot)?;
        let counts = match &reading.data {
            SlaveData::Drive(drive) => drive.position,
            SlaveData::Hsp(hsp) => hsp.first.position,
            _ => return None,
        };
        let velocity = view.velocities.get(slot).copied().flatten();
        Some(Self {
            slave: axis.slave,
            name: &axis.name,
            unit: axis.unit.word(),
            position: axis.scale.to_units(counts),
            units_per_s: velocity.map(|counts| counts / axis.scale.counts_per_unit),
        })
    }
}

#[derive(Serialize)]
struct CountersJson {
    frames: u64,
    executed: u64,
    full: u64,
    crc: u64,
    incomplete: u64,
    rejected: u64,
    idle_cycles: u64,
    outputs_lost: u64,
    answers_lost: u64,
    cycles_left_out: u64,
    ring_broken: u64,
    inputs_held: u64,
    inputs_stale: u64,
}

impl From<&Counters> for CountersJson {
    fn from(counters: &Counters) -> Self {
        Self {
            frames: counters.frames,
            executed: counters.executed,
            full: counters.full,
            crc: counters.crc,
            incomplete: counters.incomplete,
            rejected: counters.rejected_total(),
            idle_cycles: counters.idle_cycles,
            outputs_lost: counters.outputs_lost,
            answers_lost: counters.answers_lost,
            cycles_left_out: counters.cycles_left_out,
            ring_broken: counters.ring_broken,
            inputs_held: counters.inputs_held,
            inputs_stale: counters.inputs_stale,
        }
    }
}

#[derive(Serialize)]
struct Velocity {
    slave: usize,
    counts_per_s: f64,
}

/// The JSON object with a line feed.
pub fn line(view: &View) -> String {
    let axis = |(i, line): &(usize, SlotLine)| {
        let position = super::rows::has_position(line);
        let counts_per_s = view.velocities.get(*i).copied().flatten()?;
        position.then_some(Velocity { slave: *i, counts_per_s })
    };
    let json = ViewJson {
        name: &view.name,
        time_ns: view.at_ns,
        reports: view.counts.reports,
        reports_per_s: view.rate,
        reports_lost: view.counts.lost,
        reports_bad_crc: view.counts.bad_crc,
        counters: view.counters.as_ref().map(CountersJson::from),
        trouble: view.trouble.as_deref(),
        slots: view.lines.iter().map(|(i, line)| SlotJson::of(*i, line)).collect(),
        velocities: view.lines.iter().filter_map(axis).collect(),
        axes: view.lines.iter().filter_map(|(i, line)| AxisJson::of(*i, line, view)).collect(),
    };
    serde_json::json!(json).to_string() + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each counter has its own value under its own name.
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
        let shown = serde_json::json!(CountersJson::from(&counters));
        let names = ["frames", "executed", "full", "crc", "incomplete", "idle_cycles", "outputs_lost", "answers_lost"];
        let names = names.into_iter().chain(["cycles_left_out", "ring_broken", "inputs_held", "inputs_stale"]);
        for (value, name) in (1_u64..).zip(names) {
            assert_eq!(shown[name], value, "{name}");
        }
    }
}

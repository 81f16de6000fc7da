//! Draws the positions of two runs. The horizontal axis is the command number, because both runs have the same
//! commands.

use std::collections::BTreeMap;

use ecmsk::compare::{BoardReport, Comparison, Deviation, Step};
use ecmsk::sk::{CommandId, SlotSize};

use super::{CompareVerbError, Names};
use crate::plot::chart::{Caption, Sheet};
use crate::plot::decimate::Line;
use crate::plot::panel::{Look, Panel, Stroke};
use crate::plot::{COLUMNS, MAX_AXES, Window, command_place, style};

/// Collects the curves of both runs while commands are processed.
pub struct Picture {
    window: Window,
    axes: BTreeMap<u8, Axis>,
}

struct Axis {
    runs: [Line; 2],
    difference: Line,
}

impl Picture {
    /// Creates a picture without curves. `commands` is the number of commands of the longer run.
    pub fn new(commands: u64) -> Self {
        Self { window: Window::of_commands(commands), axes: BTreeMap::new() }
    }

    /// Processes the next command of both runs; `None` for a run that has ended.
    pub fn step(&mut self, a: Option<&Step>, b: Option<&Step>) {
        let Some(step) = a.or(b) else { return };
        let place = command_place(step.number);
        let runs = [a, b];
        for slave in 1..=step.size.max_slaves() as u8 {
            if runs.iter().flatten().any(|step| moves(step, slave, step.size)) {
                let window = self.window;
                let line = || Line::new(window, COLUMNS);
                self.axes.entry(slave).or_insert_with(|| Axis { runs: [line(), line()], difference: line() });
            }
        }
        for (slave, axis) in &mut self.axes {
            let position =
                |step: Option<&Step>| step?.answer.as_ref().and_then(|answer: &BoardReport| answer.position(*slave));
            let positions = runs.map(position);
            for (line, position) in axis.runs.iter_mut().zip(positions) {
                if let Some(position) = position {
                    line.push(place, position.into());
                }
            }
            if let [Some(a), Some(b)] = positions {
                axis.difference.push(place, f64::from(b) - f64::from(a));
            }
        }
    }

    /// Draws the axes that were moved. If there are too many, the axis with the first difference is among those drawn.
    pub fn draw(mut self, names: &Names, found: &Comparison) -> Result<Sheet, CompareVerbError> {
        let differing = found.first.as_ref().and_then(|first| first.what.iter().find_map(Deviation::slave));
        let mut chosen: Vec<u8> = self.axes.keys().copied().collect();
        chosen.sort_by_key(|slave| (Some(*slave) != differing, *slave));
        chosen.truncate(MAX_AXES);
        chosen.sort_unstable();
        let mark = found.first.as_ref().map(|first| first.command);
        let mut panels = Vec::new();
        let mut differences = (Vec::new(), Vec::new());
        for (slave, colour) in chosen.iter().zip(style::colours(chosen.iter().copied())) {
            let Some(Axis { runs: [a, b], difference }) = self.axes.remove(slave) else { continue };
            let strokes = vec![
                Stroke { pieces: a.finish(), look: Look::Pale(colour) },
                Stroke { pieces: b.finish(), look: Look::Solid(colour) },
            ];
            let mut legend = vec![(Look::Pale(colour), "A".to_owned()), (Look::Solid(colour), "B".to_owned())];
            if let Some(command) = mark {
                legend.push((Look::Solid(style::ALARM), format!("first difference: command {command}")));
            }
            let height = if chosen.len() <= 2 { 190 } else { 110 };
            panels.extend(Panel::of(format!("Axis {slave}: position (counts)"), height, 1.0, strokes, legend));
            differences.0.push(Stroke { pieces: difference.finish(), look: Look::Solid(colour) });
            differences.1.push((Look::Solid(colour), format!("axis {slave}")));
        }
        panels.extend(Panel::of("Difference: B minus A (counts)".into(), 130, 1.0, differences.0, differences.1));
        if panels.is_empty() {
            return Err(CompareVerbError::NothingToPlot);
        }
        for panel in &mut panels {
            panel.marks = mark.map(|command| command as f64).into_iter().collect();
        }
        let caption = Caption {
            title: match &found.first {
                Some(first) => first.to_string(),
                None => format!("equal: {} commands", found.counts[0].commands),
            },
            about: format!("A: {}, B: {}", names.runs[0], names.runs[1]),
            range: self.window.range(),
            axis: "command",
        };
        Ok(Sheet { panels, caption })
    }
}

/// Whether a command moves the axis of this slave.
fn moves(step: &Step, slave: u8, size: SlotSize) -> bool {
    let id = CommandId::from_code(step.command.slot(size, slave.into()).id);
    id.is_motion() || id == CommandId::GoHome
}

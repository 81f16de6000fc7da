//! Draws two diagrams over time: the number of frames that wait in the board's FIFO, and the length of the host's
//! pauses in cycles. Both have a line for the value of `ahead=` that `ecmsk migrate` proposes for the chip's link. In
//! the first diagram it is the number of output sets that the chip would buffer, in the second the number of cycles for
//! which these would last.

use ecmsk::migrate::{Seen, Stretch};
use ecmsk::sk::{CycleTime, FIFO_ENTRIES};

use super::Report;
use crate::plot::chart::{Caption, Sheet};
use crate::plot::decimate::Line;
use crate::plot::panel::{Look, Panel, Stroke};
use crate::plot::states::{Span, State};
use crate::plot::{COLUMNS, Window, seconds, style};

/// The height of a diagram in pixels.
const HEIGHT: u32 = 190;

/// Collects the curves of the picture while frames are processed.
pub struct Picture {
    window: Window,
    cycle_ns: f64,
    level: Line,
    pauses: Line,
    gaps: Vec<Span>,
}

impl Picture {
    /// Creates a picture without curves, for the time in OP.
    pub fn new(op: Stretch, cycle: CycleTime) -> Self {
        let window = Window::of_times(op.from_ns, op.to_ns);
        Self {
            window,
            cycle_ns: cycle.ns() as f64,
            level: Line::holding(window, COLUMNS),
            pauses: Line::new(window, COLUMNS),
            gaps: Vec::new(),
        }
    }

    /// Processes the values of the next frame.
    pub fn frame(&mut self, at_ns: i64, seen: &Seen) {
        if let Some(level) = seen.level {
            self.level.push(at_ns, level.into());
        }
        if let Some(Stretch { from_ns, to_ns }) = seen.pause {
            self.pauses.interrupt(from_ns);
            self.pauses.push(from_ns, 0.0);
            self.pauses.push(to_ns, to_ns.saturating_sub(from_ns) as f64 / self.cycle_ns);
        }
        if let Some(Stretch { from_ns, to_ns }) = seen.gap {
            self.gaps.push(Span { state: State::Gap, from: seconds(from_ns), to: seconds(to_ns), note: None });
        }
    }

    /// Draws the picture; `None` if there is nothing to draw.
    pub fn draw(self, report: &Report) -> Option<Sheet> {
        let range = self.window.range();
        let ahead = report.found.plan.as_ref().map(|plan| &plan.ahead);
        let across = |value: f64| Stroke {
            pieces: vec![vec![(range.start, value), (range.end, value)]],
            look: Look::Solid(style::ALARM),
        };
        let mut strokes = vec![Stroke { pieces: self.level.finish(), look: Look::Solid(style::FIFO) }];
        let mut legend = vec![(Look::Solid(style::FIFO), "sets that wait".to_owned())];
        if let Some(ahead) = ahead {
            let lie = ahead.value + ahead.transport_sets;
            strokes.push(across(lie.into()));
            legend
                .push((Look::Solid(style::ALARM), format!("{lie}: what lies in the chip with ahead={}", ahead.value)));
        }
        if !self.gaps.is_empty() {
            legend.push((State::Gap.look(), State::Gap.name().to_owned()));
        }
        let name = format!("FIFO: sets of {FIFO_ENTRIES}");
        let mut panels: Vec<Panel> = Panel::of(name, HEIGHT, 1.0, strokes, legend).into_iter().collect();
        let pauses = self.pauses.finish();
        if !pauses.is_empty() {
            let mut strokes = vec![Stroke { pieces: pauses, look: Look::Solid(style::FIFO) }];
            let mut legend = vec![(Look::Solid(style::FIFO), "since the last write".to_owned())];
            if let Some(ahead) = ahead {
                strokes.push(across(ahead.value.into()));
                legend.push((Look::Solid(style::ALARM), format!("bridged by ahead={}", ahead.value)));
            }
            let name = "Pauses of the host in a motion (cycles)".to_owned();
            panels.extend(Panel::of(name, HEIGHT, 1.0, strokes, legend));
        }
        panels.iter_mut().for_each(|panel| panel.spans.clone_from(&self.gaps));
        let title = match ahead {
            Some(ahead) => format!("{}: ahead={}", report.file.display(), ahead.value),
            None => report.file.display().to_string(),
        };
        let about = report.link.clone().unwrap_or_else(|| "a capture".to_owned());
        let caption = Caption { title, about, range, axis: "time (s)" };
        (!panels.is_empty()).then_some(Sheet { panels, caption })
    }
}

//! The summary as an HTML page: what went wrong, the extreme values of the axes, the alarms, and a picture of each bad
//! moment.

use std::io::Read;

use ecmsk::machine_file::MachineFile;
use ecmsk::summary::Summary;

use super::events::{Events, Moment};
use super::extremes::{AxisExtremes, named, seconds};
use super::{Args, text};
use crate::error::CliError;
use crate::filter::{AROUND_SECONDS, nanoseconds};
use crate::machine_option::{alarm_words, label};
use crate::markup::{escaped, figure, page};
use crate::motion::Quantity;
use crate::plot::pictures::{Stretch, pictures};
use crate::plot::survey::Survey;
use crate::recording::Frames;

/// \[OURS] The largest number of pictures on a page; more would make a browser slow.
const PICTURES_MAX: usize = 30;
/// Pictures that overlap are merged, if the result is not longer than this, ns. \[OURS] Single cycles are still visible
/// in a picture of this length.
const STRETCH_MAX_NS: i64 = 1_000_000_000;

/// The data of the page.
pub struct Page<'a> {
    pub args: &'a Args,
    pub summary: &'a Summary,
    pub axes: &'a [(usize, &'a AxisExtremes)],
    pub events: &'a Events,
    pub machine: Option<&'a MachineFile>,
}

impl Page<'_> {
    /// The HTML text of the page. `frames` reads the recording again, and `survey` is the result of its first reading.
    ///
    /// # Errors
    /// [`CliError`] if the recording cannot be read, or a picture cannot be drawn.
    pub fn html(&self, frames: Frames<impl Read + Send>, survey: &Survey) -> Result<String, CliError> {
        let mut stretches = self.stretches();
        let left_out = stretches.len().saturating_sub(PICTURES_MAX);
        stretches.truncate(PICTURES_MAX);
        let drawn = pictures(&self.args.file, frames, survey, &stretches, self.machine)?;
        let shown = |svg: Option<String>| svg.unwrap_or_else(|| "<p>The network is not in OP then.</p>".to_owned());
        let pictures: String =
            stretches.iter().zip(drawn).map(|(stretch, svg)| figure(&stretch.title, &shown(svg))).collect();
        let more =
            if left_out > 0 { format!("<p>{left_out} later moments have no picture.</p>\n") } else { String::new() };
        let wrong = match text(self.summary, self.machine) {
            wrong if wrong.is_empty() => "Nothing went wrong.".to_owned(),
            wrong => wrong,
        };
        let link = survey.link().map(|link| format!(", recorded on {}", escaped(&link))).unwrap_or_default();
        let (axes, alarms) = (self.axes(), self.alarms());
        let below = format!(
            "<p>Summary by ecmsk {}{link}. Times are seconds since the board was opened, in a capture since its first frame.</p>\n\
             <h2>What went wrong</h2>\n<pre>{}</pre>\n{axes}{alarms}<h2>Moments</h2>\n{pictures}{more}",
            env!("CARGO_PKG_VERSION"),
            escaped(&wrong),
        );
        Ok(page(&self.args.file.display().to_string(), &below))
    }

    /// The table of the largest values of each axis.
    fn axes(&self) -> String {
        let heads = Quantity::ALL.map(|quantity| format!("<th>largest {}</th>", quantity.word().replace('-', " ")));
        let row = |(slave, extremes): &(usize, &AxisExtremes)| {
            let (axis, name) = named(*slave, self.machine);
            let cells = Quantity::ALL.map(|quantity| match extremes.of(quantity) {
                peak if peak.value == 0 => "<td></td>".to_owned(),
                peak => format!("<td>{} at {}</td>", quantity.shown(peak.value, axis), seconds(peak.at_ns)),
            });
            format!("<tr><td>{}</td>{}</tr>\n", escaped(&name), cells.concat())
        };
        let rows: String = self.axes.iter().map(row).collect();
        format!("<h2>Axes</h2>\n<table>\n<tr><th>axis</th>{}</tr>\n{rows}</table>\n", heads.concat())
    }

    /// The HTML table of alarms; empty if there is none.
    fn alarms(&self) -> String {
        let row = |Moment { at_ns, alarm }: &Moment| {
            let alarm = alarm.as_ref()?;
            let (axis, code) = (label(self.machine, alarm.slave), alarm.code);
            let words = escaped(alarm_words(self.machine, alarm.slave, code));
            let (at, axis) = (seconds(*at_ns), escaped(&axis));
            Some(format!("<tr><td>{at}</td><td>{axis}</td><td>0x{code:04X}</td><td>{words}</td></tr>\n"))
        };
        let rows: String = self.events.moments().iter().filter_map(row).collect();
        if rows.is_empty() {
            return rows;
        }
        format!(
            "<h2>Alarms</h2>\n<table>\n<tr><th>time</th><th>axis</th><th>code</th><th>meaning</th></tr>\n{rows}</table>\n"
        )
    }

    /// The sections of the recording around the bad moments, sorted by time. Sections that overlap are merged.
    fn stretches(&self) -> Vec<Stretch> {
        let mut moments: Vec<(i64, String, Vec<u8>)> = Vec::new();
        for (slave, extremes) in self.axes {
            let (axis, name) = named(*slave, self.machine);
            for quantity in [Quantity::FollowingError, Quantity::TargetStep] {
                let peak = extremes.of(quantity);
                if peak.value > 0 {
                    let value = quantity.shown(peak.value, axis);
                    let title = format!("axis {name}: largest {} {value}", quantity.word().replace('-', " "));
                    moments.push((peak.at_ns, title, vec![*slave as u8]));
                }
            }
        }
        for Moment { at_ns, alarm } in self.events.moments() {
            moments.push(match alarm {
                Some(alarm) => {
                    let words = alarm_words(self.machine, alarm.slave, alarm.code);
                    let axis = label(self.machine, alarm.slave);
                    (*at_ns, format!("axis {axis}: alarm 0x{:04X}: {words}", alarm.code), vec![alarm.slave])
                }
                None => {
                    let all = self.axes.iter().map(|(slave, _)| *slave as u8).collect();
                    (*at_ns, "gap in a motion".to_owned(), all)
                }
            });
        }
        moments.sort_by_key(|(at_ns, ..)| *at_ns);
        let mut stretches: Vec<Stretch> = Vec::new();
        for (at_ns, what, axes) in moments {
            let around_ns = nanoseconds(AROUND_SECONDS);
            let (from_ns, to_ns) = (at_ns.saturating_sub(around_ns), at_ns.saturating_add(around_ns));
            let title = format!("{what} at {}", seconds(at_ns));
            match stretches.last_mut() {
                Some(last) if from_ns <= last.to_ns && to_ns - last.from_ns <= STRETCH_MAX_NS => {
                    last.to_ns = to_ns;
                    last.title = format!("{}, {title}", last.title);
                    last.axes.extend(axes);
                    last.axes.sort_unstable();
                    last.axes.dedup();
                }
                _ => stretches.push(Stretch { title, from_ns, to_ns, axes }),
            }
        }
        stretches
    }
}

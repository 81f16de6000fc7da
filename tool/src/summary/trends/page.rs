//! The trends as an HTML page: tables, and a picture of each axis.

use ecmsk::machine_file::{MachineAxis, Unit};

use super::By;
use super::part::AxisPart;
use super::report::{AxisTrend, Report};
use crate::error::CliError;
use crate::markup::{escaped, figure, page};
use crate::motion::Quantity;
use crate::plot::trend::{Curve, Diagram, Picture};
use crate::summary::extremes::named;

/// The HTML text of the page.
///
/// # Errors
/// [`CliError`] if a picture cannot be drawn.
pub fn html(report: &Report) -> Result<String, CliError> {
    let mut pictures = figure("The FIFO", &board(report).svg()?);
    for trend in report.axes() {
        let (axis, name) = named(trend.slave, report.machine);
        let heading = format!("Axis {name}{}", report.way_text(&trend));
        pictures += &figure(&heading, &of_axis(report, &trend, axis, &name).svg()?);
    }
    let below = format!(
        "<p>Trends by ecmsk {}, a line for each {}. Times are UTC.</p>\n<pre>{}</pre>\n<h2>Pictures</h2>\n{pictures}",
        env!("CARGO_PKG_VERSION"),
        report.by.word(),
        escaped(&report.text()),
    );
    Ok(page(&report.folder.display().to_string(), &below))
}

/// The name of the horizontal axis.
const fn across(by: By) -> &'static str {
    match by {
        By::Recording => "recording, in the order of the table",
        By::Hour => "hours since the first",
        By::Day => "days since the first",
    }
}

impl Report<'_> {
    /// The horizontal coordinate of each part.
    fn places(&self) -> Vec<f64> {
        let first = self.parts.first().map_or(0, |(number, _)| *number);
        let from = if self.by == By::Recording { 1 } else { 0 };
        self.parts.iter().map(|(number, _)| (number - first + from) as f64).collect()
    }

    fn picture(&self, title: String, diagrams: Vec<Diagram>) -> Picture {
        Picture { title, about: self.folder.display().to_string(), across: across(self.by), diagrams }
    }

    /// The points of the parts that have a value.
    fn points(&self, values: impl Iterator<Item = Option<f64>>) -> Vec<(f64, f64)> {
        self.places().into_iter().zip(values).filter_map(|(place, value)| Some((place, value?))).collect()
    }
}

fn board(report: &Report) -> Picture {
    let parts = || report.parts.iter().map(|(_, part)| part);
    let reserve = report.points(parts().map(|part| part.reserve.map(f64::from)));
    let gaps = report.points(parts().map(|part| Some(part.gaps as f64)));
    let diagram = |name: &str, points| Diagram {
        name: name.to_owned(),
        curves: vec![Curve { name: String::new(), points }],
        least: 1.0,
    };
    let diagrams = vec![
        diagram("Reserve: the fewest commands that still waited in a motion", reserve),
        diagram("Gaps in motions", gaps),
    ];
    report.picture("FIFO".to_owned(), diagrams)
}

fn of_axis(report: &Report, trend: &AxisTrend, axis: Option<&MachineAxis>, name: &str) -> Picture {
    let axis = axis.filter(|axis| axis.unit != Unit::Counts);
    let per_unit = axis.map_or(1.0, |axis| axis.scale.counts_per_unit);
    let unit = axis.map_or("counts", |axis| axis.unit.word());
    let points =
        |value: &dyn Fn(&AxisPart) -> Option<f64>| report.points(trend.parts.iter().map(|found| value((*found)?)));
    let error = |value: Option<u64>| value.map(|value| value as f64 / per_unit.abs());
    let largest = points(&|found| error(found.largest(Quantity::FollowingError)));
    let same = points(&|found| error(trend.same_motion(found)));
    let torque = points(&|found| found.largest(Quantity::Torque).map(|value| value as f64 / 10.0));
    let home = points(&|found| trend.home_change(found).map(|change| change as f64 / per_unit));
    let curve = |name: &str, points| Curve { name: name.to_owned(), points };
    let least = 1.0 / per_unit.abs();
    let diagrams = vec![
        Diagram {
            name: format!("Following error ({unit})"),
            curves: vec![curve("largest", largest), curve("same motion", same)],
            least,
        },
        Diagram { name: "Torque (% of rated)".to_owned(), curves: vec![curve("largest", torque)], least: 0.1 },
        Diagram {
            name: format!("Home: change against the first homing ({unit})"),
            curves: vec![curve("last homing", home)],
            least,
        },
    ];
    report.picture(format!("Axis {name}"), diagrams)
}

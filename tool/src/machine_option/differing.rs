//! Compares the local machine file with that of the server of a link: the same command could mean different positions
//! there.

use ecmsk::link::keys::Scheme;
use ecmsk::link::uri::LinkUri;
use ecmsk::machine_file::{MachineAxis, MachineFile};

use super::served;
use crate::stderr::say;

/// Two scales are equal if their relative difference is at most this, so that a fraction equals its rounded decimal
/// number. \[OURS]
const SCALE_PART_MAX: f64 = 1e-9;

/// A difference between two machine files for one axis.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AxisDifference {
    /// The slave of the axis in the local machine file.
    pub slave: u8,
    /// The name of the axis, what differs, and the values of both files.
    pub text: String,
}

/// The axes for which the local machine file differs from that of the link's server, in slave, scale or limits. A
/// warning is printed for each. Empty if the link is not `tcp:`, if the server has no machine file, or if the file
/// cannot be read; opening the link then reports the reason.
pub fn note_differences(own: &MachineFile, link: &LinkUri) -> Vec<AxisDifference> {
    if link.scheme() != Scheme::Tcp {
        return Vec::new();
    }
    let Ok(Some(served)) = served(link) else { return Vec::new() };
    let differences = between(own, &served);
    for AxisDifference { text, .. } in &differences {
        say("warning", &format_args!("{text}"));
    }
    differences
}

fn between(own: &MachineFile, served: &MachineFile) -> Vec<AxisDifference> {
    let (here, there) = (own.path.display(), served.path.display());
    let mut found = Vec::new();
    for axis in &own.axes {
        let name = &axis.name;
        let mut differs = |what: String| {
            found.push(AxisDifference { slave: axis.slave, text: format!("axis {name}: {what}") });
        };
        let other = served.axis(name).or_else(|| served.axis_of(axis.slave));
        let Some(other) = other else { continue };
        if other.slave != axis.slave {
            differs(format!("it is on slave {} in {here}, on slave {} in {there}", axis.slave, other.slave));
        }
        if !is_same_scale(axis, other) {
            differs(format!("a count is {} in {here}, {} in {there}", count(axis), count(other)));
            // With different scales, equal limits in counts mean different positions, so the limits are not compared.
            continue;
        }
        for (word, limits) in [("min", [axis, other].map(min)), ("max", [axis, other].map(max))] {
            let [own, served] = limits;
            if own != served {
                let [own, served] = [(axis, own), (other, served)].map(|(axis, limit)| limit_text(axis, limit));
                differs(format!("{word} is {own} in {here}, {served} in {there}"));
            }
        }
    }
    found
}

fn is_same_scale(axis: &MachineAxis, other: &MachineAxis) -> bool {
    let [own, served] = [axis, other].map(|axis| axis.scale.counts_per_unit);
    axis.unit == other.unit && (own - served).abs() <= own.abs() * SCALE_PART_MAX
}

/// The length of a count as text, in the unit of the axis.
fn count(axis: &MachineAxis) -> String {
    format!("{} {}", 1.0 / axis.scale.counts_per_unit, axis.unit)
}

/// The limit that the file calls `min`, in counts; `None` if there is none. If the axis counts backwards, this is the
/// upper limit in counts.
fn min(axis: &MachineAxis) -> Option<i32> {
    if axis.scale.counts_per_unit < 0.0 { highest(axis) } else { lowest(axis) }
}

fn max(axis: &MachineAxis) -> Option<i32> {
    if axis.scale.counts_per_unit < 0.0 { lowest(axis) } else { highest(axis) }
}

fn lowest(axis: &MachineAxis) -> Option<i32> {
    Some(axis.limits.min).filter(|limit| *limit != i32::MIN)
}

fn highest(axis: &MachineAxis) -> Option<i32> {
    Some(axis.limits.max).filter(|limit| *limit != i32::MAX)
}

fn limit_text(axis: &MachineAxis, limit: Option<i32>) -> String {
    limit.map_or_else(|| "not there".to_owned(), |limit| format!("{} {}", axis.scale.to_units(limit), axis.unit))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_differ_in_slave_scale_and_limits() {
        let file = |name: &str, axes: &str| {
            let text =
                format!("format = 1\n[slaves.2]\nkind = \"drive\"\n[slaves.3]\nkind = \"drive\"\n[axes]\n{axes}\n");
            MachineFile::parse(name, &text).unwrap()
        };
        let own = "X = { slave = 1, unit = \"mm\", per = \"5/131072\", min = -10, max = 250 }\nY = { slave = 2 }";
        let said = |served: &str| {
            let found = between(&file("a.toml", own), &file("b.toml", served));
            found.into_iter().map(|found| (found.slave, found.text)).collect::<Vec<_>>()
        };
        let one = |slave, text: &str| vec![(slave, text.to_owned())];
        assert!(said(own).is_empty());
        let per =
            "X = { slave = 1, unit = \"mm\", per = 0.00003814697265625, min = -10, max = 250 }\nY = { slave = 2 }";
        assert!(said(per).is_empty(), "the same number");
        assert_eq!(said(&own.replace("-10", "-20")), one(1, "axis X: min is -10 mm in a.toml, -20 mm in b.toml"));
        assert_eq!(
            said(&own.replace(", max = 250", "")),
            one(1, "axis X: max is 250 mm in a.toml, not there in b.toml")
        );
        assert_eq!(
            said(&own.replace("\"5/131072\"", "0.5")),
            one(1, "axis X: a count is 0.00003814697265625 mm in a.toml, 0.5 mm in b.toml")
        );
        assert_eq!(
            said(&own.replace("slave = 2", "slave = 3").replace("X =", "x =")),
            one(2, "axis Y: it is on slave 2 in a.toml, on slave 3 in b.toml")
        );
        // An axis with another name on the same slave is compared too.
        assert_eq!(said(&own.replace("Y =", "Z =").replace("slave = 2", "slave = 2, max = 5")).len(), 1);
        assert!(said("Q = { slave = 3 }\n[slaves.1]\nkind = \"drive\"").is_empty());
    }
}

//! How a machine is drawn where it is shown in motion: which axes are rotary, and which together move one table or one
//! bridge.

use serde::Deserialize;

use super::check::{Fault, Source, fault};
use super::format::PictureFields;
use super::{MachineAxis, MachineFileError, same_name};
use crate::address::text::visible;

/// Whether an axis moves along a line or turns. \[OURS]
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "lowercase")]
pub enum AxisKind {
    /// The axis moves along a line.
    Linear,
    /// The axis turns; its unit is an angle.
    Rotary,
}

/// The axes that are drawn together. The others are drawn one by one. \[OURS]
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Picture {
    /// XY tables: the slaves of two linear axes with one unit, the axis across first.
    pub xy: Vec<[u8; 2]>,
    /// The gantries.
    pub gantries: Vec<Gantry>,
}

/// A gantry: a bridge whose two ends are moved by an axis each. The axes are linear and have one unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gantry {
    /// The slaves of the axes that move the ends of the bridge.
    pub sides: [u8; 2],
    /// The slave of the axis that moves along the bridge; `None` if there is none.
    pub bridge: Option<u8>,
}

/// Checks the table `picture`, and finds the slaves of the axes that it names. It is an error if an axis does not
/// exist, is named twice, is rotary, or has another unit than the axes drawn with it.
pub(super) fn picture(
    source: &Source<'_>,
    fields: &PictureFields,
    axes: &[MachineAxis],
) -> Result<Picture, MachineFileError> {
    let mut picture = Picture::default();
    let mut drawn = Vec::new();
    for (place, names) in (1_usize..).zip(&fields.xy) {
        let wrong = |fault| source.wrong(&["picture", "xy", &place.to_string()], fault);
        let [across, up] = names;
        let slaves = together(&[across, up], axes, &mut drawn).map_err(wrong)?;
        picture.xy.push([slaves[0], slaves[1]]);
    }
    for (place, gantry) in (1_usize..).zip(&fields.gantries) {
        let wrong = |fault| source.wrong(&["picture", "gantries", &place.to_string()], fault);
        let [one, other] = &gantry.sides;
        let names: Vec<&String> = [one, other].into_iter().chain(&gantry.bridge).collect();
        let slaves = together(&names, axes, &mut drawn).map_err(wrong)?;
        picture.gantries.push(Gantry { sides: [slaves[0], slaves[1]], bridge: slaves.get(2).copied() });
    }
    Ok(picture)
}

/// The slaves of axes that are drawn together. `drawn` has the slaves of all axes that the table has named so far.
fn together(names: &[&String], axes: &[MachineAxis], drawn: &mut Vec<u8>) -> Result<Vec<u8>, Fault> {
    let mut slaves = Vec::new();
    let mut first: Option<&MachineAxis> = None;
    for name in names {
        let axis = axes
            .iter()
            .find(|axis| same_name(&axis.name, name))
            .ok_or_else(|| fault(format!("there is no axis `{}`", visible(name)), "name axes of the table [axes]"))?;
        if axis.kind == AxisKind::Rotary {
            let next = "name a linear axis, or write kind = \"linear\" at this one";
            return Err(fault(format!("axis {} turns", axis.name), next));
        }
        if drawn.contains(&axis.slave) {
            return Err(fault(format!("axis {} is in the picture twice", axis.name), "name it once"));
        }
        let first = *first.get_or_insert(axis);
        if first.unit != axis.unit {
            let what = format!("axis {} is in {} and axis {} in {}", first.name, first.unit, axis.name, axis.unit);
            return Err(fault(what, "give them one unit"));
        }
        drawn.push(axis.slave);
        slaves.push(axis.slave);
    }
    Ok(slaves)
}

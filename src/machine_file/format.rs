//! The fields of a machine file, as they are written. `check.rs` checks their values. The doc comments become the
//! descriptions in the JSON schema, so they are written for users.

use std::collections::BTreeMap;

use serde::Deserialize;

use super::unit::Unit;
use super::{AxisKind, ProgramLimits};

/// A machine with an EtherCAT network: its link, slaves, axes, inputs and outputs.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(title = "Machine file of ecmsk"))]
#[serde(deny_unknown_fields)]
pub(super) struct Content {
    /// The version of the file's format: 1.
    #[cfg_attr(feature = "schema", schemars(range(min = 1, max = 1)))]
    #[allow(dead_code, reason = "it is checked before the other fields are read")]
    pub(super) format: i64,
    /// The name of the machine, for people.
    pub(super) name: Option<String>,
    /// The link to the machine's board or network, as the option --link takes it. sim: simulates the slaves of this
    /// file.
    pub(super) link: Option<String>,
    /// The EtherCAT cycle in microseconds: 250, 500, 1000 or another 250 * 2^n; default 1000.
    pub(super) cycle_us: Option<i64>,
    /// The slaves by their numbers, from 1 in the order of the cable.
    #[serde(default)]
    pub(super) slaves: BTreeMap<String, SlaveFields>,
    /// The axes by their names.
    #[serde(default)]
    pub(super) axes: BTreeMap<String, AxisFields>,
    /// The inputs by their names.
    #[serde(default)]
    pub(super) inputs: BTreeMap<String, LineFields>,
    /// The outputs by their names.
    #[serde(default)]
    pub(super) outputs: BTreeMap<String, LineFields>,
    /// The meanings of the drives' error codes, for all drives, for those of a vendor, or for one product.
    #[serde(default)]
    pub(super) alarms: Vec<AlarmFields>,
    /// What happens at the soft limits of the axes.
    #[serde(default)]
    pub(super) limits: LimitsFields,
    /// Which axes are drawn together where the machine is shown in motion.
    #[serde(default)]
    pub(super) picture: PictureFields,
}

/// What happens at the soft limits of the axes.
#[derive(Debug, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(super) struct LimitsFields {
    /// A program's own target beyond min or max of its axis: report, the default, says so once for each excursion; stop
    /// does not send it either, so that the axis holds its last target.
    #[serde(default)]
    pub(super) program: ProgramLimits,
}

/// Which axes are drawn together where the machine is shown in motion; the others are drawn one by one.
#[derive(Debug, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(super) struct PictureFields {
    /// XY tables: pairs of linear axes with one unit, the axis across first, e.g. [["X", "Y"]].
    #[serde(default)]
    pub(super) xy: Vec<[String; 2]>,
    /// Gantries: bridges whose two ends are moved by an axis each.
    #[serde(default)]
    pub(super) gantries: Vec<GantryFields>,
}

/// A bridge whose two ends are moved by an axis each.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(super) struct GantryFields {
    /// The two axes that move the ends of the bridge.
    pub(super) sides: [String; 2],
    /// The axis that moves along the bridge.
    pub(super) bridge: Option<String>,
}

/// A slave of the network, and which device it has to be.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(super) struct SlaveFields {
    /// The kind of the slave: drive, io, step, dp3cl, hsp or hsp2; none for a slave that is on the cable and not used.
    #[cfg_attr(feature = "schema", schemars(extend("enum" = super::kind_words())))]
    pub(super) kind: String,
    /// The mode of operation of the slave's axis: csp, csv or cst; default csp.
    pub(super) mode: Option<ModeWord>,
    /// The vendor id that the slave has to have, object 0x1018:1; machine check --link reports another one. Default:
    /// any.
    #[cfg_attr(feature = "schema", schemars(range(min = 0, max = 4294967295_i64)))]
    pub(super) vendor: Option<i64>,
    /// The product code that the slave has to have, object 0x1018:2; machine check --link reports another one. Default:
    /// any.
    #[cfg_attr(feature = "schema", schemars(range(min = 0, max = 4294967295_i64)))]
    pub(super) product: Option<i64>,
    /// The revision that the slave has to have, object 0x1018:3; machine check --link reports another one. Default:
    /// any.
    #[cfg_attr(feature = "schema", schemars(range(min = 0, max = 4294967295_i64)))]
    pub(super) revision: Option<i64>,
    /// How the slave is simulated, written as one slave of the key slaves= of a link, e.g.
    /// drive:limits@-200000..300000. Default: as its kind.
    pub(super) simulated: Option<String>,
}

/// The mode of operation of an axis: cyclic synchronous position, velocity or torque.
#[derive(Clone, Copy, Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "lowercase")]
pub(super) enum ModeWord {
    Csp,
    Csv,
    Cst,
}

/// An axis: positions in its unit, speeds in units per second.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(super) struct AxisFields {
    /// The number of the slave that moves the axis, from 1.
    #[cfg_attr(feature = "schema", schemars(range(min = 1, max = 40)))]
    pub(super) slave: i64,
    /// The unit of the axis's positions; default counts.
    pub(super) unit: Option<Unit>,
    /// Whether the axis moves along a line or turns, for its picture: linear or rotary. Default: rotary with the unit deg,
    /// rad or turn, otherwise linear.
    pub(super) kind: Option<AxisKind>,
    /// Units per count: a number, or a fraction as "360/131072". Negative: the unit counts in the opposite direction.
    pub(super) per: Option<Number>,
    /// The lowest position that a target may have, units.
    pub(super) min: Option<f64>,
    /// The highest position that a target may have, units.
    pub(super) max: Option<f64>,
    /// The highest speed of a move, units per second.
    #[cfg_attr(feature = "schema", schemars(extend("exclusiveMinimum" = 0)))]
    pub(super) max_velocity: Option<f64>,
    /// The highest acceleration of a move, units per second squared.
    #[cfg_attr(feature = "schema", schemars(extend("exclusiveMinimum" = 0)))]
    pub(super) max_acceleration: Option<f64>,
    /// How the axis finds its home position.
    pub(super) homing: Option<HomingFields>,
}

/// How an axis finds its home position. A setting that is left out stays as the drive has it.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(super) struct HomingFields {
    /// The homing method, object 0x6098.
    #[cfg_attr(feature = "schema", schemars(range(min = -128, max = 127)))]
    pub(super) method: Option<i64>,
    /// The speed while looking for the switch, object 0x6099:1, in the unit of the drive.
    #[cfg_attr(feature = "schema", schemars(range(min = 1, max = 4294967295_i64)))]
    pub(super) speed_switch: Option<i64>,
    /// The speed while looking for zero, object 0x6099:2, in the unit of the drive.
    #[cfg_attr(feature = "schema", schemars(range(min = 1, max = 4294967295_i64)))]
    pub(super) speed_zero: Option<i64>,
    /// The acceleration, object 0x609A, in the unit of the drive.
    #[cfg_attr(feature = "schema", schemars(range(min = 1, max = 4294967295_i64)))]
    pub(super) acceleration: Option<i64>,
    /// The home offset, object 0x607C, in the unit of the axis.
    pub(super) offset: Option<f64>,
}

/// A number, or a fraction in quotes.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(untagged, expecting = "a number, or a fraction in quotes such as \"360/131072\"")]
pub(super) enum Number {
    Value(f64),
    Fraction(String),
}

/// One of the 16 inputs or outputs of a slave.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(super) struct LineFields {
    /// The number of the slave, from 1.
    #[cfg_attr(feature = "schema", schemars(range(min = 1, max = 40)))]
    pub(super) slave: i64,
    /// The number of the input or output on the slave, from 0.
    #[cfg_attr(feature = "schema", schemars(range(min = 0, max = 15)))]
    pub(super) bit: i64,
}

/// The meanings of the error codes of some drives.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(super) struct AlarmFields {
    /// The vendor id of the drives; left out: the texts are for all drives.
    #[cfg_attr(feature = "schema", schemars(range(min = 0, max = 4294967295_i64)))]
    pub(super) vendor: Option<i64>,
    /// The product code of the drives; left out: the texts are for all drives of the vendor.
    #[cfg_attr(feature = "schema", schemars(range(min = 0, max = 4294967295_i64)))]
    pub(super) product: Option<i64>,
    /// The texts by error codes, object 0x603F, e.g. 0x7500 = "encoder cable".
    pub(super) texts: BTreeMap<String, String>,
}

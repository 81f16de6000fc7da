//! The fields of a machine file, as they are written. `check.rs` finds out whether their values make sense. The texts here
//! are also those of the JSON schema.

use std::collections::BTreeMap;

use serde::Deserialize;

use super::unit::Unit;

/// A machine with an EtherCAT network: its link, slaves, axes, inputs and outputs.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(title = "Machine file of ecmsk"))]
#[serde(deny_unknown_fields)]
pub(super) struct Content {
    /// The version of the format: 1.
    #[cfg_attr(feature = "schema", schemars(range(min = 1, max = 1)))]
    #[allow(dead_code, reason = "it is checked before the other fields are read")]
    pub(super) format: i64,
    /// The name of the machine, for people.
    pub(super) name: Option<String>,
    /// The link to its board or network, as `--link` takes it. `sim:` simulates the slaves of this file.
    pub(super) link: Option<String>,
    /// The EtherCAT cycle in microseconds: 250, 500, 1000, 2000, 4000 ...
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
    /// What the error codes of the drives mean, by their makers.
    #[serde(default)]
    pub(super) alarms: Vec<AlarmFields>,
}

/// A slave of the network, and which device it has to be.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(super) struct SlaveFields {
    /// The kind of slave; none: it is there and not used.
    #[cfg_attr(feature = "schema", schemars(extend("enum" = super::kind_words())))]
    pub(super) kind: String,
    /// The mode of its axis: csp, csv or cst. Without it csp.
    pub(super) mode: Option<ModeWord>,
    /// The vendor that it must have, object 0x1018:1.
    #[cfg_attr(feature = "schema", schemars(range(min = 0, max = 4294967295_i64)))]
    pub(super) vendor: Option<i64>,
    /// The product code that it must have, object 0x1018:2.
    #[cfg_attr(feature = "schema", schemars(range(min = 0, max = 4294967295_i64)))]
    pub(super) product: Option<i64>,
    /// The revision that it must have, object 0x1018:3.
    #[cfg_attr(feature = "schema", schemars(range(min = 0, max = 4294967295_i64)))]
    pub(super) revision: Option<i64>,
    /// How it is simulated, as `slaves=` of a link has it, e.g. drive:limits@-200000..300000. Without it as its kind is.
    pub(super) simulated: Option<String>,
}

/// The mode of an axis.
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
    /// The number of its slave, from 1.
    #[cfg_attr(feature = "schema", schemars(range(min = 1, max = 40)))]
    pub(super) slave: i64,
    /// The unit of its positions. Without it they are in counts.
    pub(super) unit: Option<Unit>,
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
    /// How its home is found.
    pub(super) homing: Option<HomingFields>,
}

/// How the home of an axis is found. Without a value the drive has its own.
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
    /// The bit, from 0.
    #[cfg_attr(feature = "schema", schemars(range(min = 0, max = 15)))]
    pub(super) bit: i64,
}

/// What the error codes of some drives mean.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(super) struct AlarmFields {
    /// The vendor of the drives; without it all.
    #[cfg_attr(feature = "schema", schemars(range(min = 0, max = 4294967295_i64)))]
    pub(super) vendor: Option<i64>,
    /// The product code of the drives; without it all of the vendor.
    #[cfg_attr(feature = "schema", schemars(range(min = 0, max = 4294967295_i64)))]
    pub(super) product: Option<i64>,
    /// The texts by error codes, object 0x603F, e.g. 0x7500 = "encoder cable".
    pub(super) texts: BTreeMap<String, String>,
}

//! The machine file, `machine.toml`: facts about a machine that a person knows and the network cannot report. It names
//! the axes, with unit, scale, soft limits and homing; the device that each slave has to be; inputs and outputs; the
//! meanings of a vendor's error codes; and the link.
//!
//! ```
//! use ecmsk::machine_file::MachineFile;
//!
//! let text = r#"
//! format = 1
//! link = "sim:"
//!
//! [axes]
//! X = { slave = 1, unit = "mm", per = 0.001, min = -10, max = 250 }
//! "#;
//! let machine = MachineFile::parse("machine.toml", text)?;
//! let x = machine.axis("X").expect("it has this axis");
//! assert_eq!((x.slave, x.scale.to_counts(12.5)), (1, Some(12_500)));
//! # Ok::<(), ecmsk::machine_file::MachineFileError>(())
//! ```
//!
//! - `format.rs`: the fields as they are written; `unit.rs`: the units
//! - `check.rs`, `axes.rs`, `picture.rs`: check the values and convert them; `places.rs`: the lines of the fields in the text
//! - `error.rs`: [`MachineFileError`]

mod axes;
mod check;
mod error;
mod format;
mod picture;
mod places;
#[cfg(test)]
mod tests;
mod unit;

use std::path::{Path, PathBuf};

use crate::address::scale::{Scale, SoftLimits};
use crate::address::slaves::{IdentitySpec, SlaveSpec};
use crate::address::uri::{LinkUri, UriError};
use crate::ethercat::cia402::Mode;
use crate::files::read_small;
use crate::sk::SlaveKind;
pub use error::MachineFileError;
pub use picture::{AxisKind, Gantry, Picture};
pub use unit::Unit;

/// The name of the file that the tool looks for in its working directory.
pub const FILE_NAME: &str = "machine.toml";
/// The version of the file format that this library reads. Files with another version are refused.
pub const FORMAT: i64 = 1;
/// The maximum length of a machine file, bytes. \[OURS]
const FILE_SIZE_MAX_BYTES: u64 = 1 << 20;

/// A machine, as its file describes it. All values are checked.
#[derive(Clone, Debug, PartialEq)]
pub struct MachineFile {
    /// The path of the file, as it was given.
    pub path: PathBuf,
    /// The name of the machine, for people; `None` if the file does not give it.
    pub name: Option<String>,
    /// The link to the machine's board or network; `None` if the file does not give it.
    pub link: Option<LinkUri>,
    /// The EtherCAT cycle, microseconds; `None` if the file does not give it.
    pub cycle_us: Option<u32>,
    /// The slaves in network order: slave 1 is the first; 1..=40.
    pub slaves: Vec<MachineSlave>,
    /// The axes, in the order of their slaves; at most one for each slave.
    pub axes: Vec<MachineAxis>,
    /// The inputs with names, in the order of the names.
    pub inputs: Vec<IoLine>,
    /// The outputs with names, in the order of the names.
    pub outputs: Vec<IoLine>,
    /// What happens if a program's target is beyond the limits of its axis.
    pub program_limits: ProgramLimits,
    /// The axes that are drawn together where the machine is shown in motion.
    pub picture: Picture,
    alarms: Vec<AlarmTexts>,
}

/// What happens if the target of a program is beyond the soft limits of its axis.
#[derive(Clone, Copy, Debug, Default, serde::Deserialize, PartialEq, Eq)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "lowercase")]
pub enum ProgramLimits {
    /// It is reported, once for each excursion.
    #[default]
    Report,
    /// It is reported and not sent. The axis holds its last target, and the program's write fails.
    Stop,
}

/// A slave of a machine: its kind, its mode of operation, and which device it has to be.
#[derive(Clone, Debug, PartialEq)]
pub struct MachineSlave {
    /// The kind of the slave, which a program declares to the board (SET_AXIS).
    pub kind: SlaveKind,
    /// The mode of operation of the slave's axis; CSP if the file does not give one.
    pub mode: Mode,
    /// Vendor, product code and revision that the slave has to have; `None` for a value that the file does not give.
    pub expected: IdentitySpec,
    /// How the slave is simulated, with the identity of [`Self::expected`].
    pub simulated: SlaveSpec,
}

/// An axis of a machine, with unit, scale, limits and homing.
#[derive(Clone, Debug, PartialEq)]
pub struct MachineAxis {
    /// The name of the axis.
    pub name: String,
    /// The number of the slave that moves the axis, 1..=40.
    pub slave: u8,
    /// The unit of the axis's positions.
    pub unit: Unit,
    /// Whether the axis moves along a line or turns, for its picture.
    pub kind: AxisKind,
    /// How many counts one unit has.
    pub scale: Scale,
    /// The range in which targets of the axis have to be, counts. The tool refuses other targets. If the link of a
    /// program names the file (`axes=`, `machine=`), [`MachineFile::program_limits`] applies to the program's targets.
    pub limits: SoftLimits,
    /// The highest speed of a move, units per second; above 0.
    pub max_velocity: Option<f64>,
    /// The highest acceleration of a move, units per second squared; above 0.
    pub max_acceleration: Option<f64>,
    /// How the axis finds its home position.
    pub homing: AxisHoming,
}

impl MachineAxis {
    /// What messages say of a position beyond the soft limits: the position, `min` or `max`, and the value of that limit, both
    /// in the unit of the axis. They have at most six decimals: more are of no use in any unit, and show the rounding errors of
    /// the division.
    pub fn beyond(&self, counts: i32) -> (f64, &'static str, f64) {
        let rounded = |units: f64| (units * 1e6).round() / 1e6;
        let [position, min, max] = [counts, self.limits.min, self.limits.max].map(|counts| self.scale.to_units(counts));
        let (word, limit) = if position > min.max(max) { ("max", min.max(max)) } else { ("min", min.min(max)) };
        (rounded(position), word, rounded(limit))
    }
}

/// How an axis finds its home position. For a value of `None` the drive keeps its own setting.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AxisHoming {
    /// The homing method, 0x6098.
    pub method: Option<i8>,
    /// The speed while looking for the switch, 0x6099:1, in the drive's unit.
    pub speed_switch: Option<u32>,
    /// The speed while looking for zero, 0x6099:2, in the drive's unit.
    pub speed_zero: Option<u32>,
    /// The acceleration, 0x609A, in the drive's unit.
    pub acceleration: Option<u32>,
    /// The home offset, 0x607C, counts.
    pub offset_counts: Option<i32>,
}

/// An input or output with a name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IoLine {
    /// The name of the input or output.
    pub name: String,
    /// The number of the slave with this input or output, 1..=40.
    pub slave: u8,
    /// The number of the input or output on the slave, 0..=15.
    pub bit: u8,
}

/// The meanings of the error codes of some drives.
#[derive(Clone, Debug, PartialEq, Eq)]
struct AlarmTexts {
    vendor: Option<u32>,
    product: Option<u32>,
    texts: Vec<(u16, String)>,
}

impl MachineFile {
    /// Reads a machine file.
    ///
    /// # Errors
    /// [`MachineFileError`] if the file cannot be read, is no TOML, has a newer format, or has a missing or wrong
    /// field.
    pub fn load(path: &Path) -> Result<Self, MachineFileError> {
        Self::load_with_text(path).map(|(machine, _)| machine)
    }

    /// Reads a machine file, and returns its text, too.
    ///
    /// # Errors
    /// The errors of [`Self::load`].
    pub fn load_with_text(path: &Path) -> Result<(Self, String), MachineFileError> {
        let file = path.display().to_string();
        let unreadable = |message: String| MachineFileError::Unreadable { file: file.clone(), message };
        let read = read_small(path, FILE_SIZE_MAX_BYTES).map_err(|error| unreadable(error.to_string()))?;
        let text = String::from_utf8(read.bytes)
            .map_err(|_| unreadable("it is no text in UTF-8; save it as UTF-8".to_owned()))?;
        let machine = Self::parse(&file, &text)?;
        Ok((Self { path: path.to_owned(), ..machine }, text))
    }

    /// Reads the text of a file; `file` is its path, for messages.
    ///
    /// # Errors
    /// [`MachineFileError`] for the first fault: the text is no TOML, has a newer format, or has a missing or wrong
    /// field.
    pub fn parse(file: &str, text: &str) -> Result<Self, MachineFileError> {
        check::machine(file, text)
    }

    /// The axis with this name. Case is ignored, since no two names in a file differ only in case.
    pub fn axis(&self, name: &str) -> Option<&MachineAxis> {
        self.axes.iter().find(|axis| same_name(&axis.name, name))
    }

    /// The axis of the slave with this number.
    pub fn axis_of(&self, slave: u8) -> Option<&MachineAxis> {
        self.axes.iter().find(|axis| axis.slave == slave)
    }

    /// The input with this name; case is ignored.
    pub fn input(&self, name: &str) -> Option<&IoLine> {
        self.inputs.iter().find(|line| same_name(&line.name, name))
    }

    /// The output with this name; case is ignored.
    pub fn output(&self, name: &str) -> Option<&IoLine> {
        self.outputs.iter().find(|line| same_name(&line.name, name))
    }

    /// The slave with this number, from 1.
    pub fn slave(&self, slave: u8) -> Option<&MachineSlave> {
        self.slaves.get(usize::from(slave).checked_sub(1)?)
    }

    /// The meaning of an error code of a slave; `None` if the file does not give one. A text for the slave's product
    /// takes precedence over one for its vendor, and that over one for all drives. The file also gives vendor and
    /// product of the slave.
    pub fn alarm_text(&self, slave: u8, code: u16) -> Option<&str> {
        let expected = self.slave(slave).map(|slave| slave.expected).unwrap_or_default();
        let fits = |wanted: Option<u32>, found: Option<u32>| wanted.is_none() || wanted == found;
        let of_slave = self
            .alarms
            .iter()
            .filter(|alarms| fits(alarms.vendor, expected.vendor) && fits(alarms.product, expected.product));
        let text = |alarms: &'_ &AlarmTexts| alarms.texts.iter().any(|(known, _)| *known == code);
        let best = of_slave.filter(text).max_by_key(|alarms| (alarms.product.is_some(), alarms.vendor.is_some()))?;
        best.texts.iter().find(|(known, _)| *known == code).map(|(_, text)| text.as_str())
    }

    /// The link to open: `link` if it is given, otherwise the link of the file. A simulated board (`sim:`, `xf-sim:`)
    /// whose link lists no slaves gets the slaves of this file.
    pub fn link(&self, link: Option<&LinkUri>) -> Option<LinkUri> {
        let link = link.or(self.link.as_ref())?;
        Some(link.with_machine(&self.path.display().to_string()).unwrap_or_else(|| link.clone()))
    }
}

impl MachineFile {
    /// The error for a file without a link.
    pub fn names_no_link(&self) -> MachineFileError {
        MachineFileError::Field {
            file: self.path.display().to_string(),
            line: 1,
            field: "link".to_owned(),
            what: "it is missing, and says which board to open".to_owned(),
            next: "add it, e.g. link = \"usb:\"".to_owned(),
        }
    }
}

/// Loads the machine file that the key `axes=` of a link names; returns the file's content and its text.
///
/// # Errors
/// [`UriError::BadValue`] if the file cannot be used.
pub(crate) fn axes_of_link(file: &Path) -> Result<(MachineFile, String), UriError> {
    MachineFile::load_with_text(file).map_err(|error| UriError::BadValue {
        key: "axes".to_owned(),
        value: file.display().to_string(),
        why: error.to_string(),
    })
}

/// The simulated slaves of a link: those that it lists, or those of its machine file.
///
/// # Errors
/// [`UriError::BadValue`] if the machine file cannot be used.
pub(crate) fn slaves_of_link(uri: &LinkUri) -> Result<Vec<SlaveSpec>, UriError> {
    let Some(file) = uri.value("machine") else { return uri.slaves() };
    let bad = |why: String| UriError::BadValue { key: "machine".to_owned(), value: file.to_owned(), why };
    let machine = MachineFile::load(Path::new(file)).map_err(|error| bad(error.to_string()))?;
    let slaves: Vec<SlaveSpec> = machine.slaves.into_iter().map(|slave| slave.simulated).collect();
    uri.check_count(slaves.len()).map_err(bad)?;
    Ok(slaves)
}

/// The JSON schema of machine files, for editors.
#[cfg(feature = "schema")]
pub fn schema() -> schemars::Schema {
    schemars::schema_for!(format::Content)
}

/// The values that the field `kind` of a slave may have in a machine file.
#[cfg(feature = "schema")]
fn kind_words() -> Vec<String> {
    crate::address::slaves::declared_words().split(", ").map(str::to_owned).collect()
}

fn same_name(one: &str, other: &str) -> bool {
    one.to_lowercase() == other.to_lowercase()
}

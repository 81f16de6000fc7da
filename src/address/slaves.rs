//! The list of simulated slaves in a link URI: `drive*3,io`, in network order. A kind may be followed by the switches and
//! stops along the travel of its axes, see [`travel`], and by its manufacturer-specific objects, see
//! [`ManufacturerObjectsSpec`]. [`parse_declared`] parses lists of the same syntax in which a program's slaves are
//! declared.

mod list;

use std::fmt;
use std::sync::Arc;

use list::Form;
pub(crate) use list::list;

use super::kinds::{NONE, names};
pub use super::kinds::{SlaveModel, declared_words, word};
use super::text::suggestion;
use super::travel::{self, TravelSpec};
use crate::sk::{SlaveKind, SlotSize};

/// The maximum number of slaves of a board, reached with 12-byte slots.
const SLAVES_MAX: usize = SlotSize::Bytes12.max_slaves();

/// The manufacturer-specific objects of a simulated slave, as a link gives them.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum ManufacturerObjectsSpec {
    /// The slave accepts every object in 0x2000..=0x9FFF and stores its value.
    Any,
    /// The slave has the objects that the file with this path lists.
    File(Arc<str>),
}

/// Writes the text that follows `objects@` in a link.
impl fmt::Display for ManufacturerObjectsSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Any => ANY,
            Self::File(file) => file,
        })
    }
}

/// The identity of a slave. A number that is `None` is that of the slave's model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct IdentitySpec {
    /// The vendor, 0x1018:1.
    pub vendor: Option<u32>,
    /// The product code, 0x1018:2.
    pub product: Option<u32>,
    /// The revision, 0x1018:3.
    pub revision: Option<u32>,
}

/// One simulated slave.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct SlaveSpec {
    /// The kind of slave.
    pub model: SlaveModel,
    /// The switches and stops along the travel of its axes; the default for a model without axes.
    pub travel: TravelSpec,
    /// The manufacturer-specific objects of the slave; `None` if it has none.
    pub manufacturer_objects: Option<ManufacturerObjectsSpec>,
    /// The numbers that replace those of the model's identity. Only a machine file gives any.
    pub identity: IdentitySpec,
}

/// The word before `@` in the part of a list that gives manufacturer-specific objects.
const OBJECTS: &str = "objects";
/// The word after `objects@` for [`ManufacturerObjectsSpec::Any`].
const ANY: &str = "any";

/// The section of `ecmsk link help` on manufacturer-specific objects.
pub(crate) fn manufacturer_objects_help() -> String {
    "Behind any kind may stand the objects of its maker, which programs write before they go on, e.g. drive:objects@sv2.objects*2:\n  \
     :objects@FILE\n      the objects of that file (a path without `,` `*` and `:`), one a line: INDEX:SUB TYPE ACCESS [MAPPING] \
     VALUE NAME;\n      `ecmsk objects from-esi` and `from-drive` make one\n  \
     :objects@any\n      whatever is written to 0x2000..0x9FFF is stored and read back, where a real drive may refuse it\n"
        .to_owned()
}

/// The syntax of the key `slaves`, for error messages.
pub(crate) fn form() -> String {
    format!(
        "a comma list of kinds, each with *N if there are N in a row and with its travel (:limits@N..P and so on, see below) \
         if it is not the usual one: {}; {NONE} for no slave; at most {SLAVES_MAX} slaves, {} with slot=16",
        names(|_| true),
        SlotSize::Bytes16.max_slaves()
    )
}

/// The section of `ecmsk link help` on the kinds of slaves.
pub(crate) fn kinds_help() -> String {
    let mut text = String::from("Kinds of slaves, each with what may stand behind it:\n");
    for model in SlaveModel::ALL {
        let parts: Vec<_> = travel::words_of(model).chain([OBJECTS]).collect();
        text.push_str(&format!("  {:<6} {} [{}]\n", model.name(), model.meaning(), parts.join(" ")));
    }
    text
}

/// Parses the list of a board's slaves; the result has one entry per slave.
///
/// # Errors
/// Why the list is invalid and what is allowed.
pub fn parse(list: &str) -> Result<Vec<SlaveSpec>, String> {
    parse_at_most(list, SLAVES_MAX)
}

/// Parses the list of slaves of a network without a board, which may have more slaves than a board can drive.
///
/// # Errors
/// As [`parse`].
#[cfg(feature = "sim")]
pub fn parse_for_network(list: &str) -> Result<Vec<SlaveSpec>, String> {
    parse_at_most(list, crate::slave::cable::SLAVES_MAX)
}

fn parse_at_most(list: &str, slaves_max: usize) -> Result<Vec<SlaveSpec>, String> {
    if list == NONE {
        return Ok(Vec::new());
    }
    if list.is_empty() {
        return Err(format!(
            "a list of slaves is not empty, a network without one is slaves={NONE}; allowed: {}",
            form()
        ));
    }
    list::read(list, Form::Strict, slaves_max, |entry| {
        let model = SlaveModel::ALL.into_iter().find(|model| model.name() == entry.kind);
        let model = model.ok_or_else(|| unknown_kind(entry.kind, &names(|_| true)))?;
        let in_entry = |why: String| entry.error(&why);
        let (travel, manufacturer_objects) = split_parts(&entry.parts).map_err(in_entry)?;
        let travel = travel_of(model, &travel).map_err(in_entry)?;
        Ok(SlaveSpec { model, travel, manufacturer_objects, identity: IdentitySpec::default() })
    })
}

/// Parses a list of slaves as a program declares them with SET_AXIS: `drive:csv*2,io,none`. All kinds of [`parse`] are
/// allowed, and `none` for an unused slave. Upper case and blanks are ignored. The parts may also follow the number of
/// slaves: `drive*2:csv`. `read` converts one entry, a kind with its parts, into a slave.
///
/// # Errors
/// Why the list is invalid and what is allowed.
pub fn parse_declared<T: Clone>(
    list: &str,
    read: impl Fn(SlaveKind, &[&str]) -> Result<T, String>,
) -> Result<Vec<T>, String> {
    list::read(list, Form::Loose, SLAVES_MAX, |entry| {
        let word = entry.kind;
        let model = SlaveModel::ALL.into_iter().find(|model| model.name().eq_ignore_ascii_case(word));
        let none = word.eq_ignore_ascii_case(NONE).then_some(SlaveKind::None);
        let kind = model.map(SlaveModel::kind).or(none).ok_or_else(|| unknown_kind(word, &declared_words()))?;
        read(kind, &entry.parts).map_err(|why| entry.error(&why))
    })
}

fn unknown_kind(kind: &str, allowed: &str) -> String {
    let near = suggestion(kind, SlaveModel::ALL.map(SlaveModel::name));
    format!("kind `{kind}` is unknown;{near} allowed: {allowed}")
}

/// The list in normal form, in which equal neighbours are written once with their number: `drive*2`.
pub(crate) fn normal(slaves: &[SlaveSpec]) -> String {
    if slaves.is_empty() {
        return NONE.to_owned();
    }
    // The texts of the slaves are compared, not their fields: a default that is written and one that is left out give the
    // same text.
    let name = |slave: &SlaveSpec| {
        let objects = slave.manufacturer_objects.as_ref().map(|spec| format!(":{OBJECTS}@{spec}")).unwrap_or_default();
        format!("{}{}{objects}", slave.model.name(), slave.travel)
    };
    list(slaves.iter().map(name))
}

/// The message for a list with too many slaves for this slot size.
pub(crate) fn too_many(slot: SlotSize) -> String {
    format!("allowed: at most {} slaves with slot={}", slot.max_slaves(), slot.bytes())
}

/// Splits the options that follow a kind, such as `home@-500..500`: those for the travel of the axes, and `objects@`,
/// which may be given once.
fn split_parts<'a>(parts: &[&'a str]) -> Result<(Vec<&'a str>, Option<ManufacturerObjectsSpec>), String> {
    let mut travel = Vec::new();
    let mut manufacturer_objects = None;
    let mut parts = parts.iter().copied().peekable();
    while let Some(part) = parts.next() {
        let Some(value) = part.strip_prefix(OBJECTS).and_then(|rest| rest.strip_prefix('@')) else {
            travel.push(part);
            continue;
        };
        // The list was split at every colon, also at the one after a drive letter of Windows (`C:\...`). That path is
        // joined again.
        let is_letter = value.len() == 1 && value.bytes().all(|byte| byte.is_ascii_alphabetic());
        let path = parts.next_if(|next| is_letter && next.starts_with(['/', '\\']));
        let value = path.map_or_else(|| value.to_owned(), |path| format!("{value}:{path}"));
        let spec = match value.as_str() {
            "" => return Err(format!("`{part}` names no file; allowed: {OBJECTS}@FILE, {OBJECTS}@{ANY}")),
            ANY => ManufacturerObjectsSpec::Any,
            file => ManufacturerObjectsSpec::File(file.into()),
        };
        if manufacturer_objects.replace(spec).is_some() {
            return Err(format!("`{OBJECTS}` is given twice; allowed: once"));
        }
    }
    Ok((travel, manufacturer_objects))
}

fn travel_of(model: SlaveModel, parts: &[&str]) -> Result<TravelSpec, String> {
    if model.axes() == 0 && !parts.is_empty() {
        return Err(format!("a slave of kind {} has no axis and no travel; allowed: {}", model.name(), model.name()));
    }
    let travel = TravelSpec::parse(parts)?;
    if travel.stops.is_some() && model.motors() == 0 {
        let with_motor = names(|model| model.motors() > 0);
        return Err(format!("the pulses of {} meet no stops; allowed: stops@ of {with_motor}", model.with_article()));
    }
    Ok(travel)
}

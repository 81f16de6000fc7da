//! The list of simulated slaves in a link URI: `drive*3,io`, in the order of the network. Behind a kind may stand the
//! switches and stops along the travel of its axes, see [`travel`](super::travel), and its manufacturer-specific objects,
//! see [`ManufacturerObjectsSpec`].

mod kinds;

use std::fmt;
use std::sync::Arc;

pub use kinds::SlaveModel;

use super::keys::decimal;
use super::travel::TravelSpec;
use super::uri::{LinkUri, UriError, suggestion};
use crate::sk::SlotSize;
#[cfg(feature = "sim")]
use crate::slave::cable;

/// The value for a network without slaves.
const NONE: &str = "none";

/// The largest number of slaves of a board, which is that with 12-byte slots.
const SLAVES_MAX: usize = SlotSize::Bytes12.max_slaves();

/// The manufacturer-specific objects of a simulated slave, as a link gives them.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum ManufacturerObjectsSpec {
    /// The slave accepts every object in 0x2000..=0x9FFF and stores its value.
    Any,
    /// The slave has the objects in this file.
    File(Arc<str>),
}

/// Writes the value as it stands behind `objects@` in a link.
impl fmt::Display for ManufacturerObjectsSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Any => ANY,
            Self::File(file) => file,
        })
    }
}

/// One simulated slave.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct SlaveSpec {
    /// The kind of slave.
    pub model: SlaveModel,
    /// The switches and stops along the travel of its axes; the default for a model without axes.
    pub travel: TravelSpec,
    /// Its manufacturer-specific objects; `None`: it has none.
    pub manufacturer_objects: Option<ManufacturerObjectsSpec>,
}

/// The word in front of `@` that introduces manufacturer-specific objects.
const OBJECTS: &str = "objects";
/// The value for [`ManufacturerObjectsSpec::Any`].
const ANY: &str = "any";

/// The section on manufacturer-specific objects of `ecmsk link help`.
pub(crate) fn manufacturer_objects_help() -> String {
    "Behind any kind may stand the objects of its maker, which programs write before they go on, e.g. drive:objects@sv2.objects*2:\n  \
     :objects@FILE\n      the objects of that file (a path without `,` `*` and `:`), one a line: INDEX:SUB TYPE ACCESS [MAPPING] \
     VALUE NAME;\n      `ecmsk objects from-esi` and `from-drive` make one\n  \
     :objects@any\n      whatever is written to 0x2000..0x9FFF is stored and read back, where a real drive may refuse it\n"
        .to_owned()
}

/// The syntax of the list, for messages.
pub(crate) fn form() -> String {
    format!(
        "a comma list of kinds, each with *N if there are N in a row and with its travel (:limits@N..P and so on, see below) \
         if it is not the usual one: {}; {NONE} for no slave; at most {SLAVES_MAX} slaves, {} with slot=16",
        kinds(),
        SlotSize::Bytes16.max_slaves()
    )
}

/// Parses the list of a board; the result has one entry for each slave.
///
/// # Errors
/// Why the list is invalid and what is allowed.
pub fn parse(list: &str) -> Result<Vec<SlaveSpec>, String> {
    parse_at_most(list, SLAVES_MAX)
}

/// The list in the URI of a link to a modelled network.
///
/// # Errors
/// [`UriError`]: links of that scheme have no such key.
pub(crate) fn of_uri(uri: &LinkUri) -> Result<Vec<SlaveSpec>, UriError> {
    uri.required("slaves", |value| parse(value).ok())
}

/// Parses the list of a network without a board, which may have more slaves.
///
/// # Errors
/// As [`parse`].
#[cfg(feature = "sim")]
pub fn parse_for_network(list: &str) -> Result<Vec<SlaveSpec>, String> {
    parse_at_most(list, cable::SLAVES_MAX)
}

fn parse_at_most(list: &str, slaves_max: usize) -> Result<Vec<SlaveSpec>, String> {
    let mut slaves = Vec::new();
    if list == NONE {
        return Ok(slaves);
    }
    if list.is_empty() {
        return Err(format!(
            "a list of slaves is not empty, a network without one is slaves={NONE}; allowed: {}",
            form()
        ));
    }
    for item in list.split(',') {
        let (kind, count) = match item.split_once('*') {
            Some((kind, count)) => (kind, parse_count(item, count, slaves_max)?),
            None => (item, 1),
        };
        let (kind, parts) = match kind.split_once(':') {
            Some((kind, parts)) => (kind, Some(parts)),
            None => (kind, None),
        };
        let model = SlaveModel::ALL.into_iter().find(|model| model.name() == kind).ok_or_else(|| {
            let near = suggestion(kind, SlaveModel::ALL.map(SlaveModel::name));
            format!("kind `{kind}` is unknown;{near} allowed: {}", kinds())
        })?;
        let in_item = |why| format!("in `{item}`, {why}");
        let (travel, manufacturer_objects) = parts.map_or(Ok((None, None)), split_parts).map_err(in_item)?;
        let travel = match travel {
            Some(travel) => travel_of(model, &travel).map_err(in_item)?,
            None => TravelSpec::default(),
        };
        slaves.extend(std::iter::repeat_n(SlaveSpec { model, travel, manufacturer_objects }, count));
        if slaves.len() > slaves_max {
            return Err(format!("allowed: at most {slaves_max} slaves"));
        }
    }
    Ok(slaves)
}

/// The list in its normal form: equal neighbours are written once with their number.
pub(crate) fn normal(slaves: &[SlaveSpec]) -> String {
    if slaves.is_empty() {
        return NONE.to_owned();
    }
    // Slaves are compared in their normal form, which leaves out defaults.
    let name = |slave: &SlaveSpec| {
        let objects = slave.manufacturer_objects.as_ref().map(|spec| format!(":{OBJECTS}@{spec}")).unwrap_or_default();
        format!("{}{}{objects}", slave.model.name(), slave.travel)
    };
    list(slaves.iter().map(name))
}

/// The words as a list in which equal neighbours are counted: `drive*2,io`.
pub(crate) fn list(words: impl Iterator<Item = String>) -> String {
    let words: Vec<String> = words.collect();
    let runs = words.chunk_by(|a, b| a == b).map(|run| match run.len() {
        1 => run[0].clone(),
        n => format!("{}*{n}", run[0]),
    });
    runs.collect::<Vec<_>>().join(",")
}

/// Why a list has too many slaves for a board with that slot size.
pub(crate) fn too_many(slot: SlotSize) -> String {
    format!("allowed: at most {} slaves with slot={}", slot.max_slaves(), slot.bytes())
}

/// Splits the parts behind a kind into those of the travel and the manufacturer-specific objects.
fn split_parts(parts: &str) -> Result<(Option<String>, Option<ManufacturerObjectsSpec>), String> {
    let mut travel: Vec<String> = Vec::new();
    let mut manufacturer_objects = None;
    let mut parts = parts.split(':').peekable();
    while let Some(part) = parts.next() {
        let Some(value) = part.strip_prefix(OBJECTS).and_then(|rest| rest.strip_prefix('@')) else {
            travel.push(part.to_owned());
            continue;
        };
        // A path on Windows contains a colon behind its drive letter: `C:\...`.
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
    Ok(((!travel.is_empty()).then(|| travel.join(":")), manufacturer_objects))
}

fn travel_of(model: SlaveModel, text: &str) -> Result<TravelSpec, String> {
    if model.axes() == 0 {
        return Err(format!("a slave of kind {} has no axis and no travel; allowed: {}", model.name(), model.name()));
    }
    let travel = TravelSpec::parse(text)?;
    if travel.stops.is_some() && model.motors() == 0 {
        return Err(format!("the pulses of an {} meet no stops; allowed: stops@ of drive and step", model.name()));
    }
    Ok(travel)
}

fn parse_count(item: &str, count: &str, slaves_max: usize) -> Result<usize, String> {
    let number = decimal(count).and_then(|n| usize::try_from(n).ok()).filter(|n| (1..=slaves_max).contains(n));
    number.ok_or_else(|| match count.split_once(':') {
        Some((count, parts)) => format!(
            "in `{item}`, the number stands last; allowed: {}:{parts}*{count}",
            item.split('*').next().unwrap_or_default()
        ),
        None => format!("in `{item}`, allowed: a whole number from 1 to {slaves_max} after the *"),
    })
}

fn kinds() -> String {
    SlaveModel::ALL.map(SlaveModel::name).join(", ")
}

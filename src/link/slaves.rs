//! The list of simulated slaves in a link URI: `drive*3,io`, in the order of the network. Behind a kind may stand what
//! is along the way of its axes, see [`travel`](super::travel), and the objects of its maker, see [`MakersSpec`].

use std::fmt;
use std::sync::Arc;

#[cfg(feature = "sim")]
use super::sim;
use super::travel::TravelSpec;
use super::uri::suggestion;
use crate::sk::{SlaveKind, SlotSize};
#[cfg(feature = "sim")]
use crate::slave::{Channels, DriveConfig, Io, Slave};

/// A model of a slave that this build has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SlaveModel {
    /// A CiA 402 servo drive.
    Drive,
    /// A CiA 402 stepper: CSP alone.
    Step,
    /// A pulse module of one channel.
    Hsp,
    /// A pulse module of two channels.
    Hsp2,
    /// 16 digital outputs and 16 digital inputs, output k wired to input k.
    Io,
}

impl SlaveModel {
    /// Every model of this build.
    pub const ALL: [Self; 5] = [Self::Drive, Self::Io, Self::Step, Self::Hsp, Self::Hsp2];

    /// Its name in a link.
    pub const fn name(self) -> &'static str {
        self.row().name
    }

    /// The name with its article, for messages.
    pub(super) const fn with_article(self) -> &'static str {
        self.row().with_article
    }

    /// What SET_AXIS calls it.
    pub const fn kind(self) -> SlaveKind {
        self.row().kind
    }

    /// Axes it has: 0..=2.
    pub const fn axes(self) -> usize {
        self.row().axes
    }

    /// Axes with a motor of their own, which can be jammed: 0..=1.
    pub const fn motors(self) -> usize {
        self.row().motors
    }

    /// Channels with 16 digital inputs and outputs: 0..=2.
    pub const fn channels(self) -> usize {
        self.row().channels
    }

    /// One with what a link says of its axes, just switched on.
    #[cfg(feature = "sim")]
    pub(super) fn build(self, travel: &TravelSpec) -> Box<dyn Slave> {
        (self.row().build)(travel)
    }

    /// All that is said of a model, one row each.
    const fn row(self) -> Row {
        match self {
            Self::Drive => Row {
                name: "drive",
                with_article: "a drive",
                kind: SlaveKind::Drive,
                axes: 1,
                motors: 1,
                channels: 0,
                #[cfg(feature = "sim")]
                build: |travel| sim::drive(DriveConfig::default(), travel),
            },
            Self::Step => Row {
                name: "step",
                with_article: "a step",
                kind: SlaveKind::Step,
                axes: 1,
                motors: 1,
                channels: 0,
                #[cfg(feature = "sim")]
                build: |travel| sim::drive(DriveConfig::stepper(), travel),
            },
            Self::Hsp => Row {
                name: "hsp",
                with_article: "an hsp",
                kind: SlaveKind::Hsp,
                axes: 1,
                motors: 0,
                channels: 1,
                #[cfg(feature = "sim")]
                build: |travel| sim::hsp(Channels::One, travel),
            },
            Self::Hsp2 => Row {
                name: "hsp2",
                with_article: "an hsp2",
                kind: SlaveKind::Hsp,
                axes: 2,
                motors: 0,
                channels: 2,
                #[cfg(feature = "sim")]
                build: |travel| sim::hsp(Channels::Two, travel),
            },
            Self::Io => Row {
                name: "io",
                with_article: "an io",
                kind: SlaveKind::Io,
                axes: 0,
                motors: 0,
                channels: 1,
                #[cfg(feature = "sim")]
                build: |_| Box::<Io>::default(),
            },
        }
    }
}

/// What follows from a model: keys of a link, words of scripts, what a host declares it as.
struct Row {
    name: &'static str,
    with_article: &'static str,
    kind: SlaveKind,
    axes: usize,
    motors: usize,
    channels: usize,
    #[cfg(feature = "sim")]
    build: fn(&TravelSpec) -> Box<dyn Slave>,
}

/// Kinds whose names are known, but which are in no build yet: Xinje DP3CL.
const LATER: [&str; 1] = ["dp3cl"];

/// The value for a network without slaves.
const NONE: &str = "none";

/// Slaves that a board can have at most: those of 12-byte slots.
const MAX: usize = SlotSize::Bytes12.max_slaves();

/// What a link says of the objects of a slave's maker.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum MakersSpec {
    /// The slave stores whatever it is told, in 0x2000..=0x9FFF.
    Any,
    /// It has those of this file.
    File(Arc<str>),
}

/// As it stands behind `objects@`.
impl fmt::Display for MakersSpec {
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
    /// What it is.
    pub model: SlaveModel,
    /// What is along the way of its axes; nothing is said of a model without axes.
    pub travel: TravelSpec,
    /// The objects of its maker; `None`: it has its own alone.
    pub makers: Option<MakersSpec>,
}

/// The word of the part that names the objects of the maker.
const OBJECTS: &str = "objects";
/// The word for [`MakersSpec::Any`].
const ANY: &str = "any";

/// What stands behind a kind for the objects of its maker, for the help.
pub(super) fn makers_help() -> String {
    "Behind any kind may stand the objects of its maker, which programs write before they go on, e.g. drive:objects@sv2.objects*2:\n  \
     :objects@FILE\n      the objects of that file (a path without `,` `*` and `:`), one a line: INDEX:SUB TYPE ACCESS VALUE \
     NAME;\n      `ecmsk objects from-esi` and `from-drive` make one\n  \
     :objects@any\n      whatever is written to 0x2000..0x9FFF is stored and read back, where a real drive may refuse it\n"
        .to_owned()
}

/// What a list looks like.
pub(super) fn form() -> String {
    format!(
        "a comma list of kinds, each with *N if there are N in a row and with its travel (:limits@N..P and so on, see below) \
         if it is not the usual one: {}; {NONE} for no slave; at most {MAX} slaves, {} with slot=16",
        kinds(),
        SlotSize::Bytes16.max_slaves()
    )
}

/// The slaves of a list, one entry for each.
///
/// # Errors
/// Why it is none and what is allowed.
pub(super) fn parse(list: &str) -> Result<Vec<SlaveSpec>, String> {
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
            Some((kind, count)) => (kind, parse_count(item, count)?),
            None => (item, 1),
        };
        let (kind, parts) = match kind.split_once(':') {
            Some((kind, parts)) => (kind, Some(parts)),
            None => (kind, None),
        };
        let model = SlaveModel::ALL.into_iter().find(|model| model.name() == kind).ok_or_else(|| {
            let (state, near) = if LATER.contains(&kind) {
                ("not in this build yet", String::new())
            } else {
                ("unknown", suggestion(kind, SlaveModel::ALL.map(SlaveModel::name)))
            };
            format!("kind `{kind}` is {state};{near} allowed: {}", kinds())
        })?;
        let in_item = |why| format!("in `{item}`, {why}");
        let (travel, makers) = parts.map_or(Ok((None, None)), makers_of).map_err(in_item)?;
        let travel = match travel {
            Some(travel) => travel_of(model, &travel).map_err(in_item)?,
            None => TravelSpec::default(),
        };
        slaves.extend(std::iter::repeat_n(SlaveSpec { model, travel, makers }, count));
        if slaves.len() > MAX {
            return Err(too_many(SlotSize::Bytes12));
        }
    }
    Ok(slaves)
}

/// A list in its normal form: neighbours of one kind are counted.
pub(super) fn normal(slaves: &[SlaveSpec]) -> String {
    if slaves.is_empty() {
        return NONE.to_owned();
    }
    // What says nothing more than the default does is not written, so it must not keep neighbours apart.
    let makers =
        |slave: &SlaveSpec| slave.makers.as_ref().map(|makers| format!(":{OBJECTS}@{makers}")).unwrap_or_default();
    let name = |slave: &SlaveSpec| format!("{}{}{}", slave.model.name(), slave.travel, makers(slave));
    list(slaves.iter().map(name))
}

/// The words as a list in which neighbours that are equal are counted: `drive*2,io`.
pub(super) fn list(words: impl Iterator<Item = String>) -> String {
    let words: Vec<String> = words.collect();
    let runs = words.chunk_by(|a, b| a == b).map(|run| match run.len() {
        1 => run[0].clone(),
        n => format!("{}*{n}", run[0]),
    });
    runs.collect::<Vec<_>>().join(",")
}

/// Why a list is too long for a board of that slot size.
pub(super) fn too_many(slot: SlotSize) -> String {
    format!("allowed: at most {} slaves with slot={}", slot.max_slaves(), slot.bytes())
}

/// Parts the objects of the maker from the parts of the travel.
fn makers_of(parts: &str) -> Result<(Option<String>, Option<MakersSpec>), String> {
    let mut travel: Vec<String> = Vec::new();
    let mut makers = None;
    let mut parts = parts.split(':').peekable();
    while let Some(part) = parts.next() {
        let Some(value) = part.strip_prefix(OBJECTS).and_then(|rest| rest.strip_prefix('@')) else {
            travel.push(part.to_owned());
            continue;
        };
        // A drive of Windows: `C:` and then the path.
        let is_letter = value.len() == 1 && value.bytes().all(|byte| byte.is_ascii_alphabetic());
        let path = parts.next_if(|next| is_letter && next.starts_with(['/', '\\']));
        let value = path.map_or_else(|| value.to_owned(), |path| format!("{value}:{path}"));
        let spec = match value.as_str() {
            "" => return Err(format!("`{part}` names no file; allowed: {OBJECTS}@FILE, {OBJECTS}@{ANY}")),
            ANY => MakersSpec::Any,
            file => MakersSpec::File(file.into()),
        };
        if makers.replace(spec).is_some() {
            return Err(format!("`{OBJECTS}` is given twice; allowed: once"));
        }
    }
    Ok(((!travel.is_empty()).then(|| travel.join(":")), makers))
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

fn parse_count(item: &str, count: &str) -> Result<usize, String> {
    let digits = count.bytes().all(|b| b.is_ascii_digit());
    let number = count.parse().ok().filter(|n| digits && (1..=MAX).contains(n));
    number.ok_or_else(|| format!("in `{item}`, allowed: a whole number from 1 to {MAX} after the *"))
}

fn kinds() -> String {
    SlaveModel::ALL.map(SlaveModel::name).join(", ")
}

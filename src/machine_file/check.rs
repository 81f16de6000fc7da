//! Checks the values of a machine file, and converts them: link, cycle, slaves, inputs and outputs, alarm texts.

use std::collections::BTreeMap;

use serde::Deserialize as _;
use toml::de::DeValue;

use super::axes::{axes, check_name, number};
use super::format::{AlarmFields, Content, LineFields, ModeWord, SlaveFields};
use super::picture::picture;
use super::places::Places;
use super::{AlarmTexts, FORMAT, IoLine, MachineFile, MachineFileError, MachineSlave};
use crate::address::slaves::{self, IdentitySpec, SlaveModel, SlaveSpec, declared_words};
use crate::address::text::{suggestion, visible};
use crate::address::uri::LinkUri;
use crate::ethercat::cia402::Mode;
use crate::sk::{CycleTime, SlaveKind, SlotSize};

/// The highest number of a slave in a machine file.
const SLAVES_MAX: usize = SlotSize::Bytes12.max_slaves();
/// The number of inputs, and of outputs, that an IO slave has.
const BITS: i64 = 16;
/// The longest text of an alarm, characters. \[OURS]
const ALARM_TEXT_MAX: usize = 200;
/// The value of `kind` for a slave that is on the cable but is not used.
const UNUSED: &str = "none";

/// The text of a machine file with the lines of its fields, which errors name.
pub(super) struct Source<'t> {
    file: &'t str,
    places: Places<'t>,
}

/// What is wrong with a field, and what the user has to do, in this order.
pub(super) type Fault = (String, String);

impl Source<'_> {
    /// Makes the error for the field at `path` from a fault.
    pub(super) fn wrong(&self, path: &[&str], (what, next): Fault) -> MachineFileError {
        let field = visible(&path.join("."));
        MachineFileError::Field { file: self.file.to_owned(), line: self.places.line(path), field, what, next }
    }
}

/// Makes a fault: `what` is wrong, and `next` is what the user has to do.
pub(super) fn fault(what: impl Into<String>, next: impl Into<String>) -> Fault {
    (what.into(), next.into())
}

pub(super) fn machine(file: &str, text: &str) -> Result<MachineFile, MachineFileError> {
    let places = Places::new(text).map_err(|(line, message)| MachineFileError::Syntax {
        file: file.to_owned(),
        line,
        message,
    })?;
    let source = Source { file, places };
    check_format(&source)?;
    let content = read(&source, text)?;
    let link = content.link.as_deref().map(LinkUri::parse).transpose();
    let link = link.map_err(|error| source.wrong(&["link"], fault(error.to_string(), "correct the link")))?;
    let cycle_us = content.cycle_us.map(|us| cycle(&source, us)).transpose()?;
    let slaves = slaves(&source, &content)?;
    let axes = axes(&source, &content.axes, &slaves)?;
    Ok(MachineFile {
        path: file.into(),
        name: content.name,
        link,
        cycle_us,
        inputs: lines(&source, "inputs", &content.inputs, &slaves)?,
        outputs: lines(&source, "outputs", &content.outputs, &slaves)?,
        program_limits: content.limits.program,
        picture: picture(&source, &content.picture, &axes)?,
        alarms: alarms(&source, &content.alarms)?,
        axes,
        slaves,
    })
}

/// Checks the version of the format before all other fields: a file with a newer version may have fields that this
/// version of the library does not know.
fn check_format(source: &Source<'_>) -> Result<(), MachineFileError> {
    let wrong =
        |what: &str| Err(source.wrong(&["format"], fault(what, format!("write `format = {FORMAT}` at the top"))));
    let found = match source.places.top("format") {
        None => return wrong("it is missing, and says which version of the format the file has"),
        Some(DeValue::Integer(number)) => i64::from_str_radix(number.as_str(), number.radix()).ok(),
        Some(_) => None,
    };
    match found {
        Some(FORMAT) => Ok(()),
        Some(found) if found > FORMAT => {
            let line = source.places.line(&["format"]);
            Err(MachineFileError::Newer { file: source.file.to_owned(), line, found, known: FORMAT })
        }
        _ => wrong("it is no version of the format"),
    }
}

/// Reads the fields of a machine file, with their types checked.
fn read(source: &Source<'_>, text: &str) -> Result<Content, MachineFileError> {
    let read = toml::de::Deserializer::parse(text).and_then(Content::deserialize);
    read.map_err(|error| {
        let (path, line) = source.places.field(error.span().map_or(0, |span| span.start));
        let message = error.message().trim_end().replace('\n', ", ");
        let words = [("expected i64", "expected a whole number"), ("expected f64", "expected a number")];
        let what = words.iter().fold(message, |text, (word, ours)| text.replace(word, ours));
        let steps = [("unknown field", "correct its name, or take it out"), ("missing field", "add it")];
        let next = steps.iter().find(|(word, _)| what.starts_with(word)).map_or("correct the value", |(_, next)| *next);
        let field = if path.is_empty() { "the file".to_owned() } else { visible(&path.join(".")) };
        MachineFileError::Field { file: source.file.to_owned(), line, field, what, next: next.to_owned() }
    })
}

fn cycle(source: &Source<'_>, us: i64) -> Result<u32, MachineFileError> {
    let cycle = u32::try_from(us).ok().and_then(CycleTime::from_us);
    cycle.map(CycleTime::us).ok_or_else(|| {
        let next = "write 250, 500, 1000 or another 250 * 2^n";
        source.wrong(&["cycle_us"], fault(format!("{us} us is no cycle of a board"), next))
    })
}

/// The slaves in network order: those of the table `[slaves]`, and a drive for each axis whose slave is not listed
/// there.
fn slaves(source: &Source<'_>, content: &Content) -> Result<Vec<MachineSlave>, MachineFileError> {
    let mut listed: BTreeMap<usize, MachineSlave> = BTreeMap::new();
    for (key, fields) in &content.slaves {
        let number = key.parse::<usize>().ok().filter(|number| number.to_string() == *key);
        let number = number.filter(|number| (1..=SLAVES_MAX).contains(number)).ok_or_else(|| {
            let next = format!("name slaves by their numbers in the order of the cable, 1 to {SLAVES_MAX}");
            source.wrong(&["slaves", key], fault(format!("`{}` is no number of a slave", visible(key)), next))
        })?;
        listed.insert(number, slave(source, key, fields)?);
    }
    for axis in content.axes.values() {
        if let Ok(number @ 1..=SLAVES_MAX) = usize::try_from(axis.slave) {
            listed.entry(number).or_insert_with(|| MachineSlave {
                kind: SlaveKind::Drive,
                mode: Mode::Csp,
                expected: IdentitySpec::default(),
                simulated: simulated(SlaveModel::Drive),
            });
        }
    }
    let count = listed.last_key_value().map_or(0, |(number, _)| *number);
    // A file with axes but without a valid slave gets no error here: the check of the axes reports the wrong slave
    // number.
    if count == 0 && content.axes.is_empty() {
        let what = "the file names no slave and no axis";
        return Err(source.wrong(&["slaves"], fault(what, "add an axis, e.g. [axes] X = { slave = 1 }")));
    }
    if let Some(lacks) = (1..=count).find(|number| !listed.contains_key(number)) {
        let what = format!("slave {count} is named, and slave {lacks} is not");
        let next = format!("add [slaves.{lacks}] with its kind; kind = \"{UNUSED}\" if it is not used");
        return Err(source.wrong(&["slaves"], fault(what, next)));
    }
    Ok(listed.into_values().collect())
}

fn slave(source: &Source<'_>, key: &str, fields: &SlaveFields) -> Result<MachineSlave, MachineFileError> {
    let wrong = |name: &str, fault| source.wrong(&["slaves", key, name], fault);
    let model = SlaveModel::ALL.into_iter().find(|model| model.name() == fields.kind);
    if model.is_none() && fields.kind != UNUSED {
        let near = suggestion(&fields.kind, SlaveModel::ALL.map(SlaveModel::name));
        let what = format!("kind `{}` is unknown;{near}", visible(&fields.kind));
        return Err(wrong("kind", fault(what.trim_end_matches(';'), format!("allowed: {}", declared_words()))));
    }
    if fields.mode.is_some() && model.is_none_or(|model| model.axes() == 0) {
        return Err(wrong("mode", fault(format!("a slave of kind {} has no axis", fields.kind), "take it out")));
    }
    let id = |name: &str, value: Option<i64>| {
        value.map(|value| number(value, 0..=u32::MAX.into()).map_err(|fault| wrong(name, fault))).transpose()
    };
    let expected = IdentitySpec {
        vendor: id("vendor", fields.vendor)?,
        product: id("product", fields.product)?,
        revision: id("revision", fields.revision)?,
    };
    let simulated = match &fields.simulated {
        // [OURS] An unused slave is simulated by an IO slave, the simplest model.
        None => simulated(model.unwrap_or(SlaveModel::Io)),
        Some(text) => {
            let listed = slaves::parse(text).map_err(|why| wrong("simulated", fault(why, "see `ecmsk link help`")))?;
            let one = <[SlaveSpec; 1]>::try_from(listed).ok();
            let [one] = one.filter(|[one]| model.is_none_or(|model| model == one.model)).ok_or_else(|| {
                let what = format!("`{}` is not one slave of kind {}", visible(text), fields.kind);
                wrong("simulated", fault(what, "name the kind, and its travel or objects behind it"))
            })?;
            one
        }
    };
    Ok(MachineSlave {
        kind: model.map_or(SlaveKind::None, SlaveModel::kind),
        mode: match fields.mode {
            None | Some(ModeWord::Csp) => Mode::Csp,
            Some(ModeWord::Csv) => Mode::Csv,
            Some(ModeWord::Cst) => Mode::Cst,
        },
        expected,
        simulated: SlaveSpec { identity: expected, ..simulated },
    })
}

fn simulated(model: SlaveModel) -> SlaveSpec {
    SlaveSpec { model, travel: Default::default(), manufacturer_objects: None, identity: IdentitySpec::default() }
}

/// Checks the number of a slave, from 1; it is an error if the file has no slave with this number.
pub(super) fn slave_number(value: i64, slaves: &[MachineSlave]) -> Result<u8, Fault> {
    let number = u8::try_from(value).ok().filter(|number| (1..=SLAVES_MAX).contains(&usize::from(*number)));
    let number = number.ok_or_else(|| {
        let next = format!("name a slave by its number in the order of the cable, 1 to {SLAVES_MAX}");
        fault(format!("there is no slave {value}"), next)
    })?;
    if usize::from(number) > slaves.len() {
        return Err(fault(format!("the file has no slave {number}"), format!("add [slaves.{number}] with its kind")));
    }
    Ok(number)
}

fn lines(
    source: &Source<'_>,
    table: &str,
    fields: &BTreeMap<String, LineFields>,
    slaves: &[MachineSlave],
) -> Result<Vec<IoLine>, MachineFileError> {
    let mut lines: Vec<IoLine> = Vec::new();
    for (name, line) in fields {
        check_name(name, lines.iter().map(|line| &*line.name)).map_err(|fault| source.wrong(&[table, name], fault))?;
        let wrong = |field: &str, fault| source.wrong(&[table, name, field], fault);
        let slave = slave_number(line.slave, slaves).map_err(|fault| wrong("slave", fault))?;
        let found = &slaves[usize::from(slave) - 1];
        if found.simulated.model.channels() == 0 || found.kind == SlaveKind::None {
            let what = format!("slave {slave} is of a kind without inputs and outputs");
            return Err(wrong("slave", fault(what, "name an io slave")));
        }
        let bit = number(line.bit, 0..=BITS - 1).map_err(|fault| wrong("bit", fault))? as u8;
        if let Some(other) = lines.iter().find(|other| (other.slave, other.bit) == (slave, bit)) {
            let what = format!("`{}` is bit {bit} of slave {slave}, too", other.name);
            return Err(wrong("bit", fault(what, "give each bit one name")));
        }
        lines.push(IoLine { name: name.clone(), slave, bit });
    }
    Ok(lines)
}

fn alarms(source: &Source<'_>, fields: &[AlarmFields]) -> Result<Vec<AlarmTexts>, MachineFileError> {
    let one = |(place, fields): (usize, &AlarmFields)| {
        let place = place.to_string();
        let id = |name: &str, value: Option<i64>| {
            let wrong = |fault| source.wrong(&["alarms", &place, name], fault);
            value.map(|value| number(value, 0..=u32::MAX.into()).map_err(wrong)).transpose()
        };
        if fields.product.is_some() && fields.vendor.is_none() {
            let what = "product codes are those of a vendor";
            return Err(source.wrong(&["alarms", &place, "product"], fault(what, "add its vendor")));
        }
        let text = |(key, text): (&String, &String)| {
            let wrong = |fault| source.wrong(&["alarms", &place, "texts", key], fault);
            let digits = key.strip_prefix("0x").or_else(|| key.strip_prefix("0X"));
            let code = digits.map_or_else(|| key.parse().ok(), |digits| u16::from_str_radix(digits, 16).ok());
            let code = code.filter(|code| *code != 0 && !key.contains('+')).ok_or_else(|| {
                let next = "write the code as the drive shows it in 0x603F, 0x0001 to 0xFFFF";
                wrong(fault(format!("`{}` is no error code", visible(key)), next))
            })?;
            if text.trim().is_empty() || text.chars().count() > ALARM_TEXT_MAX || text.chars().any(char::is_control) {
                let next = format!("write 1 to {ALARM_TEXT_MAX} characters in one line");
                return Err(wrong(fault("it is no text of an alarm", next)));
            }
            Ok((code, text.clone()))
        };
        let texts = fields.texts.iter().map(text).collect::<Result<_, _>>()?;
        Ok(AlarmTexts { vendor: id("vendor", fields.vendor)?, product: id("product", fields.product)?, texts })
    };
    (1_usize..).zip(fields).map(one).collect()
}

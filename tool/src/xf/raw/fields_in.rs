//! Converts fields of the command line (`name=value`) to a request.

use ecmsk::xf::fields::{Draft, Field, FieldKind, FunctionFields, Names, Value};

use crate::board::whole;
use crate::hex::parse_hex;
use crate::xf::words::{list, named, word};

/// The names and codes of the CiA 402 states that 402_STATE_SET accepts (XF EN 767).
const DRIVE_STATES: Names = &[
    ("NotReadyToSwitchOn", 0x00),
    ("SwitchOnDisabled", 0x40),
    ("ReadyToSwitchOn", 0x21),
    ("SwitchedOn", 0x23),
    ("OperationEnabled", 0x27),
    ("QuickStopActive", 0x07),
    ("FaultReactionActive", 0x0F),
    ("Fault", 0x08),
];

/// A field with its value, as the user wrote it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Assignment {
    name: String,
    value: String,
}

impl Assignment {
    /// Parses `name=value`.
    ///
    /// # Errors
    /// The text is invalid; the error says what is allowed.
    pub fn parse(text: &str) -> Result<Self, String> {
        let (name, value) = text.split_once('=').ok_or("write a field as name=value, e.g. slave=0")?;
        Ok(Self { name: name.trim().replace('-', "_"), value: value.trim().to_owned() })
    }
}

/// Writes the fields into the request, and checks the request.
///
/// # Errors
/// The text says what is wrong with a field.
pub fn fill(draft: &mut Draft<'_>, row: &'static FunctionFields, fields: &[Assignment]) -> Result<(), String> {
    let mut given: Vec<&Field> = Vec::new();
    for Assignment { name, value } in fields {
        let field = row.field(name).ok_or_else(|| format!("there is no field `{name}`"))?;
        if given.contains(&field) {
            return Err(format!("`{name}` is given twice"));
        }
        given.push(field);
        let wrong = |why| format!("{name}={value} is wrong: {why}");
        match Parsed::of(field, value).map_err(wrong)? {
            Parsed::Number(number) => draft.put(field, Value::Number(number)),
            Parsed::Bytes(bytes) => draft.put(field, Value::Bytes(&bytes)),
        }
        .map_err(|malformed| malformed.to_string())?;
    }
    let is_counted = |field: &Field| field.counts.is_some_and(|data| given.iter().any(|given| given.name == data));
    let missing = row.request.iter().filter(|field| field.default.is_none() && !is_counted(field));
    let missing: Vec<_> = missing.filter(|field| !given.contains(field)).map(|field| field.name).collect();
    if !missing.is_empty() {
        return Err(format!("{} {} missing", missing.join(", "), if missing.len() == 1 { "is" } else { "are" }));
    }
    draft.request().map_err(|malformed| malformed.to_string())?;
    match given.iter().find(|field| !draft.keeps(field)) {
        Some(field) => Err(format!("`{}` means nothing beside the other fields as they are", field.name)),
        None => Ok(()),
    }
}

/// The value of a field after parsing.
enum Parsed {
    Number(i64),
    Bytes(Vec<u8>),
}

impl Parsed {
    fn of(field: &Field, text: &str) -> Result<Self, String> {
        let number = |names: Names| {
            let known = named(text, names).map(i64::from).or_else(|| whole(text));
            let allowed = || allowed(field);
            known.map(Self::Number).ok_or_else(|| format!("allowed: {}", allowed()))
        };
        match field.kind {
            FieldKind::Named(names) | FieldKind::Choice(names) => number(names),
            FieldKind::DriveState => number(DRIVE_STATES),
            FieldKind::Bits(names) => bits(text, names).map(Self::Number),
            FieldKind::Text => Ok(Self::Bytes(text.as_bytes().to_vec())),
            FieldKind::Bytes => parse_hex(text).map(Self::Bytes),
            FieldKind::Objects { .. } => objects(text).map(Self::Bytes),
            FieldKind::SlaveSet => slave_set(text).map(Self::Bytes),
            FieldKind::Number | FieldKind::Signed | FieldKind::Hex | FieldKind::Abort | FieldKind::NumberOrText => {
                number(&[])
            }
        }
    }
}

fn bits(text: &str, names: Names) -> Result<i64, String> {
    let wrong = || format!("allowed: a number, none, or {} and several of them with commas", list(names).join(", "));
    if text.eq_ignore_ascii_case("none") {
        return Ok(0);
    }
    text.split(',').try_fold(0, |bits, part| {
        let bit = named(part.trim(), names).map(i64::from).or_else(|| whole(part.trim()));
        bit.filter(|bit| *bit >= 0).map(|bit| bits | bit).ok_or_else(wrong)
    })
}

/// Parses PDO mapping entries. Each is one number of index, sub-index and number of bits, such as 0x60400010.
fn objects(text: &str) -> Result<Vec<u8>, String> {
    let object = |text: &str| whole(text.trim()).and_then(|object| u32::try_from(object).ok());
    let objects: Option<Vec<_>> = text.split(',').map(|text| object(text).map(u32::to_le_bytes)).collect();
    objects.map(|objects| objects.concat()).ok_or_else(|| {
        "allowed: objects with index, sub-index and bits, e.g. 0x60400010,0x607A0020 for 0x6040 with 16 and 0x607A with 32"
            .into()
    })
}

/// Parses a set of slaves, `none` or numbers separated by commas, to a bit field with bit 0 of the first byte for slave
/// 0.
fn slave_set(text: &str) -> Result<Vec<u8>, String> {
    let wrong = || "allowed: none, or slaves from 0 to 127, e.g. 0,2,9".to_owned();
    let slaves: Vec<u8> = match text {
        "none" => Vec::new(),
        _ => text.split(',').map(|slave| slave.trim().parse().map_err(|_| wrong())).collect::<Result<_, _>>()?,
    };
    let mut set = vec![0; slaves.iter().max().map_or(1, |last| usize::from(*last) / 8 + 1)];
    for slave in slaves {
        if slave > 127 {
            return Err(wrong());
        }
        set[usize::from(slave) / 8] |= 1 << (slave % 8);
    }
    Ok(set)
}

/// The fields of a function with their allowed values, for help and errors; optional fields are in brackets.
pub fn described(row: &FunctionFields) -> String {
    let fields = row.request.iter().map(|field| {
        let text = format!("{}={}", field.name, allowed(field));
        if field.default.is_some() { format!("[{text}]") } else { text }
    });
    let fields: Vec<_> = fields.collect();
    if fields.is_empty() { "none".to_owned() } else { fields.join(" ") }
}

fn allowed(field: &Field) -> String {
    let largest = || if field.width >= 32 { u32::MAX } else { (1 << field.width) - 1 };
    match field.kind {
        FieldKind::Number | FieldKind::Abort | FieldKind::NumberOrText => format!("0..{}", largest()),
        FieldKind::Hex => format!("0..0x{:X}", largest()),
        FieldKind::Signed => "NUMBER".to_owned(),
        FieldKind::Named(names) => format!("0..{}|{}", largest(), list(names).join("|")),
        FieldKind::Choice(names) => list(names).join("|"),
        FieldKind::DriveState => DRIVE_STATES.iter().map(|(name, _)| word(name)).collect::<Vec<_>>().join("|"),
        FieldKind::Bits(names) => format!("{}|none, with commas", list(names).join("|")),
        FieldKind::Bytes => "HEX".to_owned(),
        FieldKind::Text => "TEXT".to_owned(),
        FieldKind::Objects { .. } => "0x60400010,..".to_owned(),
        FieldKind::SlaveSet => "0,2,..".to_owned(),
    }
}

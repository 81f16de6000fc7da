//! `xf sdo`: reads and writes objects of slaves.

use clap::Subcommand;
use ecmsk::coe::SdoScope;
use ecmsk::xf::EtherCatState;
use ecmsk::xf_api::XfError;
use serde_json::{Value as Json, json};

use super::hex::{hex, parse_hex, spaced};
use super::session::{ChipArgs, Session};
use super::{Shown, XfVerbError};
use crate::step::object::{Object, Type, Value};

/// Read or write an object of a slave (SDO)
///
/// A network that is not up is initialised and brought to PreOP.
#[derive(clap::Args)]
#[command(
    disable_help_subcommand = true,
    arg_required_else_help = true,
    after_help = "\
Examples:
  ecmsk xf sdo read 0 statusword
  ecmsk xf sdo read 0 0x1018 --complete
  ecmsk xf sdo write 0 0x6099:1 50000
  ecmsk xf sdo write 0 0x2100 hex:01020304"
)]
pub struct Args {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    /// Read an object
    Read(Which),
    /// Write an object
    Write {
        #[command(flatten)]
        which: Which,
        /// Decimal, or with 0x; or any bytes as hex:0102FF, in the order of the wire
        #[arg(value_name = "VALUE", allow_hyphen_values = true, value_parser = Written::parse)]
        value: Written,
    },
}

#[derive(Clone, clap::Args)]
pub struct Which {
    /// The slave, the first one is 0
    #[arg(value_name = "SLAVE", value_parser = clap::value_parser!(u8).range(0..=127))]
    pub slave: u8,
    /// 0x6064, 0x6099:1, or a name: statusword, position_actual, homing_method ..
    #[arg(value_name = "OBJECT[:SUB]", value_parser = Object::parse)]
    pub object: Object,
    /// u8, i8, u16, i16, u32, i32 [default: the object's own, where that is known]
    #[arg(long = "type", value_name = "TYPE", value_parser = Type::parse)]
    pub of: Option<Type>,
    /// All sub-indices at once (complete access), as bytes
    #[arg(long, conflicts_with = "of")]
    pub complete: bool,
    #[command(flatten)]
    pub chip: ChipArgs,
}

/// What is written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Written {
    Number(Value),
    Bytes(Vec<u8>),
}

impl Written {
    /// Parses a number, or bytes behind `hex:`.
    ///
    /// # Errors
    /// The text is invalid; the error says what is allowed.
    pub fn parse(text: &str) -> Result<Self, String> {
        match text.strip_prefix("hex:") {
            Some(bytes) => parse_hex(bytes).map(Self::Bytes),
            None => {
                Value::parse(text).map(Self::Number).map_err(|allowed| format!("{allowed}, or bytes as hex:0102FF"))
            }
        }
    }
}

impl Which {
    fn of(&self) -> Option<Type> {
        if self.complete { None } else { self.of.or(self.object.known.map(|(_, of)| of)) }
    }

    const fn scope(&self) -> SdoScope {
        if self.complete { SdoScope::Complete } else { SdoScope::Entry }
    }

    fn json(&self, verb: &str, bytes: &[u8]) -> Json {
        json!({
            "verb": verb, "slave": self.slave, "index": self.object.address.index, "sub": self.object.address.sub,
            "complete": self.complete, "bytes": hex(bytes),
        })
    }
}

impl Args {
    pub const fn chip(&self) -> &ChipArgs {
        match &self.verb {
            Verb::Read(which) | Verb::Write { which, .. } => &which.chip,
        }
    }

    /// # Errors
    /// [`XfVerbError`]
    pub fn run(&self, session: &mut Session) -> Result<Vec<Shown>, XfVerbError> {
        match &self.verb {
            Verb::Read(which) => read(session, which),
            Verb::Write { which, value } => write(session, which, value),
        }
    }

    /// Checks the command line before the chip is opened.
    ///
    /// # Errors
    /// The value has no type or does not fit it.
    pub fn check(&self) -> Result<(), XfVerbError> {
        match &self.verb {
            Verb::Read(_) => Ok(()),
            Verb::Write { which, value } => encoded(which, value).map(|_| ()),
        }
    }
}

/// # Errors
/// [`XfVerbError`]
pub fn read(session: &mut Session, which: &Which) -> Result<Vec<Shown>, XfVerbError> {
    session.join_or_start(EtherCatState::PreOp)?;
    session.expect_mailboxes("xf sdo read")?;
    let (slave, object) = (which.slave, which.object.address);
    let bytes = session.xf.sdo_read_bytes(slave, object, which.scope())?;
    let mut json = which.json("xf sdo read", &bytes);
    let Some(of) = which.of() else { return Ok(vec![(untyped(which, &bytes), json)]) };
    let wanted = of.bits() as usize / 8;
    if bytes.len() != wanted {
        return Err(XfError::SdoSize { slave, object, found: bytes.len(), wanted }.into());
    }
    let raw = number(&bytes);
    let value = of.number(raw);
    json["type"] = of.name().into();
    json["value"] = value.into();
    let digits = 2 * wanted;
    Ok(vec![(format!("{value} (0x{raw:0digits$X})"), json)])
}

/// Up to 4 bytes as a number.
fn number(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |number, byte| number << 8 | u32::from(*byte))
}

/// The bytes of an object whose type is not known, as a number or a text where they may be one.
fn untyped(which: &Which, bytes: &[u8]) -> String {
    if which.complete {
        return spaced(bytes);
    }
    let object = which.object;
    match bytes.len() {
        1..=4 => format!("0x{0:X} ({0}); the type of {object} is not known", number(bytes)),
        _ => match std::str::from_utf8(bytes) {
            Ok(text) if !bytes.is_empty() && bytes.iter().all(|byte| (b' '..=b'~').contains(byte)) => {
                format!("{}, as a text `{text}`", spaced(bytes))
            }
            _ => spaced(bytes),
        },
    }
}

/// # Errors
/// [`XfVerbError`]
pub fn write(session: &mut Session, which: &Which, value: &Written) -> Result<Vec<Shown>, XfVerbError> {
    let bytes = encoded(which, value)?;
    session.join_or_start(EtherCatState::PreOp)?;
    session.expect_mailboxes("xf sdo write")?;
    let (slave, object) = (which.slave, which.object);
    session.xf.sdo_write_bytes(slave, object.address, which.scope(), &bytes)?;
    let mut json = which.json("xf sdo write", &bytes);
    let text = match (value, which.of()) {
        (Written::Number(_), Some(of)) => {
            let value = of.number(number(&bytes));
            json["type"] = of.name().into();
            json["value"] = value.into();
            value.to_string()
        }
        _ => spaced(&bytes),
    };
    Ok(vec![(format!("slave {slave}: {object} = {text}"), json)])
}

/// The bytes to write.
fn encoded(which: &Which, value: &Written) -> Result<Vec<u8>, XfVerbError> {
    let value = match value {
        Written::Bytes(bytes) => return Ok(bytes.clone()),
        Written::Number(value) => *value,
    };
    let refused = |why, next: &str| XfVerbError::WrongRequest { what: "xf sdo write".into(), why, next: next.into() };
    match which.of() {
        _ if which.complete => Err(refused(
            "all sub-indices at once are bytes".into(),
            "write them as hex:0102FF, see `ecmsk xf sdo write --help`",
        )),
        None => Err(refused(
            format!("the type of {} is not known", which.object),
            "name it with --type, e.g. --type u16, see `ecmsk xf sdo write --help`",
        )),
        Some(of) if !of.takes(value) => Err(refused(
            format!("{} has the type {}, {} does not fit", which.object, of.name(), value.number),
            "correct the value, or --type, see `ecmsk xf sdo write --help`",
        )),
        Some(of) => Ok(value.number.to_le_bytes()[..of.bits() as usize / 8].to_vec()),
    }
}

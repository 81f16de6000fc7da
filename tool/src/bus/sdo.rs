//! `bus sdo`: reads, writes and lists the objects of a slave.

use clap::Subcommand;
use ecmsk::bus::dictionary::{self, Entry, Object, ObjectValue};
use ecmsk::coe::{DataTypeCode, ObjectAccess, ObjectCode};
use serde_json::{Value as Json, json};

use super::{BusVerbError, Session, SlaveArgs};
use crate::hex::hex;
use crate::transfer::{SizeMismatch, Transfer, Written, WrongValue};

const READ: &str = "bus sdo read";
const WRITE: &str = "bus sdo write";

/// List, dump, read or write the objects of a slave (SDO, in PreOP)
#[derive(clap::Args)]
#[command(
    disable_help_subcommand = true,
    arg_required_else_help = true,
    after_help = "\
Examples:
  ecmsk bus sdo list 1 --link nic:eth1
  ecmsk bus sdo dump 1 --link nic:eth1 > before.txt
  ecmsk bus sdo read 1 statusword
  ecmsk bus sdo write 1 0x6099:1 50000"
)]
pub struct Args {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    /// List the objects of a slave, by its own dictionary (SDO information)
    List {
        #[command(flatten)]
        whose: SlaveArgs,
        /// List each sub-index, too, with its type and its access rights
        #[arg(long)]
        entries: bool,
    },
    /// Print all readable values of a slave, by its own dictionary
    Dump {
        #[command(flatten)]
        whose: SlaveArgs,
    },
    /// Read an object
    Read {
        #[command(flatten)]
        whose: SlaveArgs,
        #[command(flatten)]
        transfer: Transfer,
    },
    /// Write an object; a drive may act on it, in PreOP, too
    Write {
        #[command(flatten)]
        whose: SlaveArgs,
        #[command(flatten)]
        transfer: Transfer,
        /// Decimal, or hexadecimal with 0x; or bytes as hex:0102FF, in the order of the wire
        #[arg(value_name = "VALUE", allow_hyphen_values = true, value_parser = Written::parse)]
        value: Written,
    },
}

/// Lists, dumps, reads or writes objects of a slave and prints the results.
///
/// # Errors
/// [`BusVerbError`] if the value is wrong, if the network does not open, if the slave aborts a transfer, or if standard
/// output cannot be written to.
pub fn run(args: &Args) -> Result<(), BusVerbError> {
    match &args.verb {
        Verb::List { whose, entries } => list(whose, *entries),
        Verb::Dump { whose } => dump(whose),
        Verb::Read { whose, transfer } => read(whose, transfer),
        Verb::Write { whose, transfer, value } => write(whose, transfer, value),
    }
}

fn list(whose: &SlaveArgs, with_entries: bool) -> Result<(), BusVerbError> {
    let (Session { mut network, reporter, .. }, slave) = whose.open()?;
    for object in dictionary::objects(&mut *network, slave)? {
        let Object { index, name, code, data_type, max_sub } = &object;
        let kind = kind(*code);
        let text = format!("0x{index:04X}  {kind:<6}  {:<14}  {name}", type_name(*data_type));
        let json = json!({
            "verb": "bus sdo list", "slave": slave, "index": index, "name": name, "kind": kind,
            "type": data_type.text(), "type_code": data_type.0, "max_sub": max_sub,
        });
        reporter.result(text, &json)?;
        if !with_entries {
            continue;
        }
        for entry in dictionary::entries(&mut *network, slave, &object)? {
            let access = access(entry.access);
            let text = format!(
                "  :{:<3}  {access:<10}  {:<14}  {} bits  {}",
                entry.object.sub,
                type_name(entry.data_type),
                entry.bits,
                entry.name
            );
            reporter.result(text, &entry_json("bus sdo list", slave, &entry))?;
        }
    }
    Ok(())
}

fn entry_json(verb: &str, slave: u8, entry: &Entry) -> Json {
    json!({
        "verb": verb, "slave": slave, "index": entry.object.index, "sub": entry.object.sub, "name": entry.name,
        "type": entry.data_type.text(), "type_code": entry.data_type.0, "bits": entry.bits,
        "access": access(entry.access),
    })
}

fn dump(whose: &SlaveArgs) -> Result<(), BusVerbError> {
    const VERB: &str = "bus sdo dump";
    let (Session { mut network, reporter, .. }, slave) = whose.open()?;
    for object in dictionary::objects(&mut *network, slave)? {
        for entry in dictionary::entries(&mut *network, slave, &object)? {
            let mut json = entry_json(VERB, slave, &entry);
            let value = dictionary::value(&mut *network, slave, &entry)?;
            let shown = match value {
                None => "(cannot be read)".to_owned(),
                Some(Err(code)) => {
                    json["abort_code"] = code.0.into();
                    format!("(aborted with {code})")
                }
                Some(Ok(bytes)) => {
                    let value = ObjectValue::of(entry.data_type, &bytes);
                    json["bytes"] = hex(&bytes).into();
                    json["value"] = value_json(&value);
                    value_text(&value, &bytes)
                }
            };
            let name = match entry.name.as_str() {
                name if name.is_empty() || name == object.name => object.name.clone(),
                name if entry.object.sub == 0 => format!("{}, {name}", object.name),
                name => name.to_owned(),
            };
            let text = format!(
                "{:<10}  {:<14}  {:<10}  {shown}  {name}",
                entry.object.to_string(),
                type_name(entry.data_type),
                access(entry.access)
            );
            reporter.result(text, &json)?;
        }
    }
    Ok(())
}

/// A value as text; an integer of more than one digit is also shown in hexadecimal.
fn value_text(value: &ObjectValue, bytes: &[u8]) -> String {
    match value {
        ObjectValue::Whole(number) if !(0..10).contains(number) => {
            let digits: String = bytes.iter().rev().map(|byte| format!("{byte:02X}")).collect();
            format!("{number} (0x{digits})")
        }
        value => value.to_string(),
    }
}

fn value_json(value: &ObjectValue) -> Json {
    match value {
        ObjectValue::Whole(number) => u64::try_from(*number)
            .map(Json::from)
            .or_else(|_| i64::try_from(*number).map(Json::from))
            .unwrap_or(Json::Null),
        ObjectValue::Real(number) => (*number).into(),
        ObjectValue::Text(text) => text.clone().into(),
        ObjectValue::Bytes(_) => Json::Null,
    }
}

fn type_name(of: DataTypeCode) -> String {
    of.text().map_or_else(|| format!("type 0x{:04X}", of.0), |name| if of.0 == 0 { "-".into() } else { name.into() })
}

const fn kind(code: ObjectCode) -> &'static str {
    match code {
        ObjectCode::Domain => "domain",
        ObjectCode::DefType | ObjectCode::DefStruct => "type",
        ObjectCode::Variable => "value",
        ObjectCode::Array => "array",
        ObjectCode::Record => "record",
        ObjectCode::Unknown(_) => "other",
    }
}

/// The access rights as text: `rw`, `r-`, `-w`, or `rw(PreOP)` if the object can be written only in some states.
fn access(access: ObjectAccess) -> String {
    let read = if access.intersects(ObjectAccess::READ) { "r" } else { "-" };
    if access.contains(ObjectAccess::WRITE) {
        return format!("{read}w");
    }
    let states =
        [(ObjectAccess::WRITE_PREOP, "PreOP"), (ObjectAccess::WRITE_SAFEOP, "SafeOP"), (ObjectAccess::WRITE_OP, "OP")];
    let states: Vec<&str> = states.into_iter().filter(|(bit, _)| access.contains(*bit)).map(|(_, name)| name).collect();
    if states.is_empty() { format!("{read}-") } else { format!("{read}w({})", states.join(",")) }
}

fn read(whose: &SlaveArgs, transfer: &Transfer) -> Result<(), BusVerbError> {
    let (Session { mut network, reporter, .. }, slave) = whose.open()?;
    let bytes = network.upload(slave, transfer.object.address, transfer.scope())?;
    let object = transfer.object.to_string();
    let size_mismatch = |SizeMismatch { found, wanted }| BusVerbError::SizeMismatch { slave, object, found, wanted };
    let (text, json) = transfer.read(READ, slave, &bytes).map_err(size_mismatch)?;
    Ok(reporter.result(text, &json)?)
}

fn write(whose: &SlaveArgs, transfer: &Transfer, value: &Written) -> Result<(), BusVerbError> {
    let wrong = |WrongValue { why, next }| BusVerbError::WrongRequest { what: WRITE, why, next };
    // The value is checked first, so that a wrong value is reported before the network is opened.
    let bytes = transfer.encoded(WRITE, value).map_err(wrong)?;
    let (Session { mut network, reporter, .. }, slave) = whose.open()?;
    network.download(slave, transfer.object.address, transfer.scope(), &bytes)?;
    let (text, json) = transfer.written(WRITE, slave, value, &bytes);
    Ok(reporter.result(text, &json)?)
}

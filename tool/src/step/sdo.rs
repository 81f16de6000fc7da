//! `sdo`: reads and writes objects of slaves.

use clap::Subcommand;
use ecmsk::cia402;
use ecmsk::coe::{AbortCode, ObjectAddress};
use ecmsk::ecm::{Ecm, EcmError};
use ecmsk::machine_file::MachineFile;
use serde_json::json;

use super::object::{Object, Type, Value};
use crate::board::{AxisWord, Board, BoardError, Needs, find_slave};
use crate::machine_option::alarm_words;

/// The object 0x603F, error code: the drive's last alarm.
const ERROR_CODE: ObjectAddress = ObjectAddress::new(cia402::ERROR_CODE, 0);

/// Read or write an object of a slave (SDO)
#[derive(Clone, Debug, clap::Args)]
#[command(disable_help_subcommand = true, arg_required_else_help = true)]
pub struct Args {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Clone, Debug, Subcommand)]
enum Verb {
    /// Read an object
    Read(Which),
    /// Write an object
    Write {
        #[command(flatten)]
        which: Which,
        /// The value to write, decimal or hexadecimal with 0x
        #[arg(value_name = "VALUE", allow_hyphen_values = true, value_parser = Value::parse)]
        value: Value,
    },
}

#[derive(Clone, Debug, clap::Args)]
pub(super) struct Which {
    /// The slave, from 1 in the order of the cable, or the name of its axis in the machine file
    #[arg(value_name = "SLAVE", value_parser = AxisWord::of_slave)]
    slave: AxisWord,
    /// The object: 0x6064, 0x6099:1, or a name: statusword, position_actual, homing_method ..
    #[arg(value_name = "OBJECT[:SUB]", value_parser = Object::parse)]
    pub(super) object: Object,
    /// The type of the value: u8, i8, u16, i16, u32 or i32 [default: the object's type, where it is known]
    #[arg(long = "type", value_name = "TYPE", value_parser = Type::parse)]
    of: Option<Type>,
}

impl Which {
    /// The number of the slave.
    ///
    /// # Errors
    /// The machine file has no axis with that name.
    pub(super) fn slave(&self, what: &str, machine: Option<&MachineFile>) -> Result<u8, BoardError> {
        self.slave.slave(what, machine)
    }

    /// The type of the object: from the option, else from the list of known objects.
    pub(super) fn of(&self) -> Option<Type> {
        self.of.or(self.object.known.map(|(_, of)| of))
    }
}

impl Args {
    /// Checks the slave and the value to write before anything is sent.
    ///
    /// # Errors
    /// The machine file has no axis with that name, or the value to write does not fit the type of the object, or that
    /// type is not known.
    pub fn check(&self, machine: Option<&MachineFile>) -> Result<(), BoardError> {
        let (Verb::Read(which) | Verb::Write { which, .. }) = &self.verb;
        which.slave("sdo", machine)?;
        let Verb::Write { which, value } = &self.verb else { return Ok(()) };
        let refused = |why, next: &str| BoardError::Refused { what: "sdo write".into(), why, next: next.into() };
        match which.of() {
            None => Err(refused(
                format!("the type of {} is not known", which.object),
                "name it with --type, e.g. --type u16",
            )),
            Some(of) if !of.takes(*value) => {
                let why = format!("{} is {} {}, {} does not fit", which.object, article(of), of.name(), value.number);
                Err(refused(why, "correct the value, or --type"))
            }
            Some(_) => Ok(()),
        }
    }

    /// Reads or writes the object, and prints its value.
    ///
    /// # Errors
    /// [`BoardError`] if the type of a value to write is not known or the value does not fit it, if the slave answers
    /// with an abort code, if the board does not answer, or if a signal stops the SDO.
    pub fn run(&self, board: &Board) -> Result<(), BoardError> {
        self.check(board.machine.as_ref())?;
        match &self.verb {
            Verb::Read(which) => read(board, which),
            Verb::Write { which, value } => write(board, which, *value),
        }
    }
}

const fn article(of: Type) -> &'static str {
    match of {
        Type::U8 | Type::U16 | Type::U32 => "a",
        Type::I8 | Type::I16 | Type::I32 => "an",
    }
}

/// Reads an object and returns its bits. `what` is the verb in messages.
///
/// # Errors
/// The slave answers with an abort code, the board does not answer, or the value does not fit the type of the object.
pub(super) fn read_raw(board: &Board, what: &str, which: &Which) -> Result<u32, BoardError> {
    board.ready(what, Needs::Sdo)?;
    let (slave, object) = (which.slave(what, board.machine.as_ref())?, which.object.address);
    let raw = board.run_interruptible("an SDO read", |ecm| ecm.sdo_read::<u32>(slave, object));
    let value = raw.map_err(|error| answered(board, what, slave, error))?;
    match which.of().map(Type::bits).filter(|bits| *bits < 32 && value >> bits != 0) {
        Some(bits) => Err(EcmError::SdoTooWide { slave, object, value, bits }.into()),
        None => Ok(value),
    }
}

fn read(board: &Board, which: &Which) -> Result<(), BoardError> {
    let (slave, object) = (which.slave("sdo read", board.machine.as_ref())?, which.object);
    let raw = read_raw(board, "sdo read", which)?;
    let mut json = json!({
        "verb": "sdo read", "slave": slave, "index": object.address.index, "sub": object.address.sub, "raw": raw,
    });
    let Some(of) = which.of() else {
        return Ok(board
            .reporter
            .result(format_args!("0x{raw:X} ({raw}); the type of {object} is not known"), &json)?);
    };
    let value = of.number(raw);
    json["type"] = of.name().into();
    json["value"] = value.into();
    let digits = of.bits() as usize / 4;
    let mut meaning = String::new();
    if object.address == ERROR_CODE {
        let name = alarm_words(board.machine.as_ref(), slave, raw as u16);
        json["meaning"] = name.into();
        meaning = format!(": {name}");
    }
    Ok(board.reporter.result(format_args!("{value} (0x{raw:0digits$X}){meaning}"), &json)?)
}

fn write(board: &Board, which: &Which, value: Value) -> Result<(), BoardError> {
    board.ready("sdo write", Needs::Sdo)?;
    let slave = which.slave("sdo write", board.machine.as_ref())?;
    let (object, number) = (which.object, value.number);
    let of = which.of().unwrap_or(Type::U32);
    let sent = board.run_interruptible("an SDO write", |ecm| send(ecm, slave, object, of, number));
    sent.map_err(|error| answered(board, "sdo write", slave, error))?;
    let json = json!({
        "verb": "sdo write", "slave": slave, "index": object.address.index, "sub": object.address.sub,
        "type": of.name(), "value": of.number(number as u32),
    });
    Ok(board.reporter.result(format_args!("slave {slave}: {object} = {}", of.number(number as u32)), &json)?)
}

/// Improves the error of an SDO that the slave did not answer. An SDO may go to a slave that the options do not list.
/// So the slave is looked up in the known network only after a timeout.
fn answered(board: &Board, what: &str, slave: u8, error: BoardError) -> BoardError {
    let silent = matches!(&error, BoardError::Ecm(EcmError::SdoAborted { code, .. }) if *code == AbortCode::TIMEOUT);
    match &board.config {
        Some(config) if silent => find_slave(config, what, slave).map_or_else(|none| none, |_| error),
        None if silent => BoardError::Refused {
            what: what.to_owned(),
            why: format!("slave {slave} does not answer it"),
            next: "see with `info --scan` whether it is there; if it is not, check its cable and power, and if it is, whether it has CoE \
                   (an IO slave may have none)"
                .into(),
        },
        _ => error,
    }
}

/// Writes a value that was checked to fit its type.
fn send(ecm: &Ecm, slave: u8, object: Object, of: Type, number: i64) -> Result<(), EcmError> {
    let object = object.address;
    match of {
        Type::U8 => ecm.sdo_write(slave, object, number as u8),
        Type::I8 => ecm.sdo_write(slave, object, number as i8),
        Type::U16 => ecm.sdo_write(slave, object, number as u16),
        Type::I16 => ecm.sdo_write(slave, object, number as i16),
        Type::U32 => ecm.sdo_write(slave, object, number as u32),
        Type::I32 => ecm.sdo_write(slave, object, number as i32),
    }
}

//! Makes the tables of the Wireshark plugin for packets of a chip: commands with their fields, and the offsets of
//! header fields.

use ecmsk::xf::command_table::COMMANDS;
use ecmsk::xf::fields::{AnswerFields, FUNCTIONS, Field, FieldKind, FieldPosition, FunctionFields, Names};
use ecmsk::xf::{
    AnswerHeader, CheckType, CommandCode, CommandHeader, Control, DataSize, END_WORD, Errors, EtherCatState,
    FIXED_CHECK, HEADER_LEN, Interrupts, NOT_READY, NetworkState, Reserve, START_WORD, Status, TRAILER_LEN,
};
use serde_json::{Map, Value, json};

use super::board::by_code;

/// All tables of the plugin for the packets of a chip.
pub fn tables() -> Value {
    json!({
        "start_word": START_WORD,
        "end_word": END_WORD,
        "fixed_check": FIXED_CHECK,
        "not_ready": NOT_READY,
        "header_bytes": HEADER_LEN,
        "trailer_bytes": TRAILER_LEN,
        "data_min": DataSize::MIN.bytes(),
        "data_max": DataSize::MAX.bytes(),
        "check": {"fixed": CheckType::Fixed.code(), "crc32": CheckType::Crc32.code(), "mask": 3},
        "nop": Status::NOP.0,
        "errors": Errors::ALL.0,
        "fifo_error": Errors::FIFO.0,
        "state_error": NetworkState::ERROR,
        "states": named(EtherCatState::NAMES),
        "always_fixed": CommandCode::SpiReconfig.code(),
        "emergency": CommandCode::CoeEmergency.code(),
        "commands": by_code(COMMANDS.iter().map(|row| (row.code.code().into(), row.name.into()))),
        "command_header": command_header(),
        "answer_header": answer_header(),
        "functions": FUNCTIONS.iter().map(function).collect::<Vec<_>>(),
    })
}

/// A field of a header: its name, offset, length, kind, and the names of its bits. The offset and the length are those
/// of the bytes in which the encoded headers `base` and `other` differ.
fn header_field(name: &str, base: [u8; HEADER_LEN], other: [u8; HEADER_LEN], kind: &str, bits: Names) -> Value {
    let differs = |n: &usize| base[*n] != other[*n];
    let (first, last) = ((0..HEADER_LEN).find(differs), (0..HEADER_LEN).rfind(differs));
    let len = first.zip(last).map(|(first, last)| last - first + 1);
    json!({"name": name, "at": first, "len": len, "kind": kind, "bits": single_bits(bits)})
}

fn command_header() -> Value {
    let base = CommandHeader::with_index(0);
    let row = |name, other: CommandHeader, kind, bits| header_field(name, base.encode(), other.encode(), kind, bits);
    json!([
        row("info", CommandHeader { info: [u8::MAX; 4], ..base }, "bytes", &[]),
        row("reserve", CommandHeader { reserve: Reserve(u16::MAX), ..base }, "hex", Reserve::NAMES),
        row("control", CommandHeader { control: Control(u8::MAX), ..base }, "hex", Control::NAMES),
        row("index", CommandHeader { index: u8::MAX, ..base }, "number", &[]),
        row("code", CommandHeader { code: CommandCode::Unknown(u8::MAX), ..base }, "code", &[]),
        row("parameter", CommandHeader { parameter: u8::MAX, ..base }, "number", &[]),
        row("len", CommandHeader { len: u16::MAX, ..base }, "number", &[]),
        row(
            "interrupt_clear",
            CommandHeader { interrupt_clear: Interrupts(u32::MAX), ..base },
            "hex",
            Interrupts::NAMES
        ),
        row("gpio_interrupt_clear", CommandHeader { gpio_interrupt_clear: u16::MAX, ..base }, "hex", &[]),
        row("gpio_outputs", CommandHeader { gpio_outputs: u16::MAX, ..base }, "hex", &[]),
    ])
}

fn answer_header() -> Value {
    let base = AnswerHeader::default();
    let row = |name, other: AnswerHeader, kind, bits| header_field(name, base.encode(), other.encode(), kind, bits);
    json!([
        row("crc_errors", AnswerHeader { crc_errors: u8::MAX, ..base }, "number", &[]),
        row("wkc_errors", AnswerHeader { wkc_errors: u8::MAX, ..base }, "number", &[]),
        row("tx_fifo", AnswerHeader { tx_fifo: u8::MAX, ..base }, "number", &[]),
        row("rx_fifo", AnswerHeader { rx_fifo: u8::MAX, ..base }, "number", &[]),
        row("state", AnswerHeader { state: NetworkState(u8::MAX), ..base }, "state", &[]),
        row("errors", AnswerHeader { errors: Errors(u8::MAX), ..base }, "hex", Errors::NAMES),
        row("status", AnswerHeader { status: Status(u8::MAX), ..base }, "hex", Status::NAMES),
        row("index", AnswerHeader { index: u8::MAX, ..base }, "number", &[]),
        row("code", AnswerHeader { code: CommandCode::Unknown(u8::MAX), ..base }, "code", &[]),
        row("ret", AnswerHeader { ret: u8::MAX, ..base }, "number", &[]),
        row("len", AnswerHeader { len: u16::MAX, ..base }, "number", &[]),
        row("interrupts", AnswerHeader { interrupts: Interrupts(u32::MAX), ..base }, "hex", Interrupts::NAMES),
        row("gpio_interrupts", AnswerHeader { gpio_interrupts: u16::MAX, ..base }, "hex", &[]),
        row("gpio_inputs", AnswerHeader { gpio_inputs: u16::MAX, ..base }, "hex", &[]),
    ])
}

fn function(row: &FunctionFields) -> Value {
    json!({
        "code": row.code.code(),
        "parameter": row.function,
        "name": row.name(),
        "what": row.what,
        "key": snake(row.type_name),
        "request": list(row.request.iter().map(field)),
        "answers": list(row.answers.iter().map(answer)),
    })
}

fn answer(form: &AnswerFields) -> Value {
    json!({"len": form.len, "every": form.every, "fields": list(form.fields.iter().map(field))})
}

/// A list; `None` if it is empty, so that the table gets no entry for it.
fn list(values: impl Iterator<Item = Value>) -> Option<Vec<Value>> {
    let values: Vec<Value> = values.collect();
    (!values.is_empty()).then_some(values)
}

fn field(field: &Field) -> Value {
    let (place, at) = match field.position {
        FieldPosition::Parameter => ("parameter", 0),
        FieldPosition::Return => ("ret", 0),
        FieldPosition::Info(byte) => ("info", byte.into()),
        FieldPosition::Reserve => ("reserve", 0),
        FieldPosition::Length => ("len", 0),
        FieldPosition::Data(at) => ("data", at),
    };
    let mut row = Map::from_iter([
        ("name".to_owned(), field.name.into()),
        ("place".to_owned(), place.into()),
        ("at".to_owned(), at.into()),
        ("bytes".to_owned(), field.bytes.into()),
        ("kind".to_owned(), kind(field.kind).into()),
    ]);
    let whole = u32::from(field.width) == 8 * u32::from(field.bytes) && field.shift == 0;
    if field.is_number() && field.bytes > 0 && !whole {
        let ones = if field.width >= 32 { u32::MAX } else { (1 << field.width) - 1 };
        row.insert("mask".to_owned(), (ones << field.shift).into());
        row.insert("shift".to_owned(), field.shift.into());
    }
    if let Some(counted) = field.counts {
        row.insert("counts".to_owned(), counted.into());
    }
    match field.kind {
        FieldKind::Named(names) | FieldKind::Choice(names) => {
            row.insert("names".to_owned(), named(names));
        }
        FieldKind::Bits(names) => {
            row.insert("bits".to_owned(), single_bits(names).into());
        }
        FieldKind::Objects { count_at } => {
            row.insert("count_at".to_owned(), count_at.into());
        }
        _ => {}
    }
    Value::Object(row)
}

const fn kind(kind: FieldKind) -> &'static str {
    match kind {
        FieldKind::Number | FieldKind::Named(_) | FieldKind::Choice(_) => "number",
        FieldKind::Signed => "signed",
        FieldKind::Hex | FieldKind::Bits(_) => "hex",
        FieldKind::DriveState => "drive_state",
        FieldKind::Abort => "abort",
        FieldKind::NumberOrText => "number_or_text",
        FieldKind::Bytes | FieldKind::SlaveSet => "bytes",
        FieldKind::Text => "text",
        FieldKind::Objects { .. } => "objects",
    }
}

fn named(names: Names) -> Value {
    by_code(names.iter().map(|(name, number)| (*number, (*name).into())))
}

/// The names of single bits; names for several bits are left out.
fn single_bits(names: Names) -> Option<Vec<Value>> {
    let single = names.iter().filter(|(_, bits)| bits.is_power_of_two());
    list(single.map(|(name, bit)| json!([name.to_lowercase(), bit])))
}

/// Converts a name to snake case: `StateSet` becomes `state_set`.
fn snake(name: &str) -> String {
    let mut text = String::new();
    for letter in name.chars() {
        if letter.is_uppercase() && !text.is_empty() {
            text.push('_');
        }
        text.extend(letter.to_lowercase());
    }
    text
}

//! Prints the output of the verbs of `ecmsk params`: differences, and values in the notation of their types.

use ecmsk::slave::{ManufacturerObject, ManufacturerType};
use serde_json::{Value as Json, json};

use super::choice;
use super::drive::Answer;
use super::kept::{LeftOut, by_reason};
use super::place::Opened;
use super::restore::{Compared, Difference};
use crate::board::Reporter;
use crate::hex::hex;

/// Prints a difference. `word` is its outcome in JSON, such as `written`. `what` is appended to the line of text, such
/// as the reason of a refusal.
pub fn show(
    reporter: &Reporter,
    verb: &str,
    slave: u8,
    Difference { wanted, present }: &Difference,
    word: &str,
    what: &str,
) -> std::io::Result<()> {
    let (from, to) = (answer_shown(wanted, present), shown(wanted, wanted.value.bytes()));
    let name = if wanted.name.is_empty() { String::new() } else { format!("  {}", wanted.name) };
    let mut json = object_json(verb, slave, wanted);
    json["result"] = word.into();
    json["file"] = hex(wanted.value.bytes()).into();
    put_answer(&mut json, "drive", present);
    reporter.result(format_args!("{:<10}  {from} -> {to}{name}{what}", wanted.address.to_string()), &json)
}

/// Prints how many parameters differ, how many are equal, and which were not compared and why.
///
/// # Errors
/// Standard output cannot be written to.
pub fn summarise(opened: &Opened, verb: &str, slave: u8, compared: &Compared) -> std::io::Result<()> {
    let Compared { different, same, left_out } = compared;
    let differ = if different.len() == 1 { "differs" } else { "differ" };
    let left = if left_out.is_empty() { String::new() } else { format!(", {} were not compared", left_out.len()) };
    opened.reporter.note(format_args!("{} {differ}, {same} are the same{left}", parameters(different.len())));
    show_left_out(&opened.reporter, "not compared", left_out);
    for one in left_out.iter().filter(|_| opened.json) {
        let mut json = one.json();
        json["verb"] = verb.into();
        json["slave"] = slave.into();
        json["result"] = "not_compared".into();
        opened.reporter.result("", &json)?;
    }
    Ok(())
}

/// Prints a note for each reason for which parameters were left out, with their names. `what` is the beginning of the
/// note, such as `not kept`.
pub fn show_left_out(reporter: &Reporter, what: &str, left_out: &[LeftOut]) {
    for (why, which) in by_reason(left_out) {
        let names: Vec<String> = which.iter().map(|one| one.to_string().trim().to_owned()).collect();
        reporter.note(format_args!("{what}, because {why}: {}", names.join(", ")));
    }
}

/// The number of parameters as text: `1 parameter`, `3 parameters`.
pub fn parameters(count: usize) -> String {
    format!("{count} {}", if count == 1 { "parameter" } else { "parameters" })
}

/// Begins the JSON object that a verb prints for a parameter of a drive: the verb, the slave, and the parameter's address, name
/// and type.
pub fn object_json(verb: &str, slave: u8, object: &ManufacturerObject) -> Json {
    json!({
        "verb": verb, "slave": slave, "index": object.address.index, "sub": object.address.sub, "name": object.name,
        "type": object.data.word(),
    })
}

/// Adds the answer of a drive to a JSON object: the value in the field `key`, or the abort code.
pub fn put_answer(json: &mut Json, key: &str, answer: &Answer<Vec<u8>>) {
    match answer {
        Ok(bytes) => json[key] = hex(bytes).into(),
        Err(code) => json["abort_code"] = code.0.into(),
    }
}

/// The value as text, see [`shown`]; if the drive has aborted the read, the abort code in parentheses.
pub fn answer_shown(object: &ManufacturerObject, answer: &Answer<Vec<u8>>) -> String {
    answer.as_ref().map_or_else(|code| format!("({code})"), |bytes| shown(object, bytes))
}

/// A value as text: a decimal number or a quoted text. Mapping entries are hexadecimal, because they contain object
/// indexes.
pub fn shown(object: &ManufacturerObject, bytes: &[u8]) -> String {
    let data = object.data;
    // Behind a board a read always returns 4 bytes, so a shorter object is cut to its own length.
    let bytes = data.bytes().and_then(|len| bytes.get(..len.into())).unwrap_or(bytes);
    let raw = || bytes.iter().rev().fold(0_u64, |number, byte| number << 8 | u64::from(*byte));
    match data {
        _ if bytes.len() > 8 && data != ManufacturerType::Text => crate::hex::spaced(bytes),
        ManufacturerType::Text => format!("\"{}\"", String::from_utf8_lossy(bytes).trim_end_matches('\0')),
        ManufacturerType::I8 | ManufacturerType::I16 | ManufacturerType::I32 | ManufacturerType::I64 => {
            let left = 64 - 8 * bytes.len() as u32;
            raw().checked_shl(left).map_or(0, |bits| bits.cast_signed() >> left).to_string()
        }
        ManufacturerType::F32 if bytes.len() == 4 => f32::from_bits(raw() as u32).to_string(),
        ManufacturerType::F64 if bytes.len() == 8 => f64::from_bits(raw()).to_string(),
        _ if choice::is_mapping(object.address) => format!("0x{:X}", raw()),
        _ => raw().to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn object(index: u16, data: ManufacturerType) -> ManufacturerObject {
        ManufacturerObject {
            address: ecmsk::coe::ObjectAddress::new(index, 1),
            data,
            access: ecmsk::slave::dictionary::Access::ReadWrite,
            mappable: ecmsk::slave::Mappable::default(),
            value: ecmsk::slave::ManufacturerValue::of_bytes(&[]),
            name: String::new(),
        }
    }

    #[test]
    fn values_are_shown_by_their_types() {
        assert_eq!(shown(&object(0x1600, ManufacturerType::U32), &[0x10, 0, 0x40, 0x60]), "0x60400010");
        for (data, bytes, said) in [
            (ManufacturerType::I16, &[0xFF, 0xFF][..], "-1"),
            (ManufacturerType::I8, &[0x80, 0, 0, 0], "-128"),
            (ManufacturerType::U16, &[0x10, 0x01, 0, 0], "272"),
            (ManufacturerType::I64, &[0xFE, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF], "-2"),
            (ManufacturerType::F32, &[0, 0, 0xC0, 0x3F], "1.5"),
            (ManufacturerType::Text, b"drive\0", "\"drive\""),
            (ManufacturerType::Any, &[1, 2, 3, 4, 5, 6, 7, 8, 9], "01 02 03 04 05 06 07 08 09"),
            (ManufacturerType::I8, &[], "0"),
        ] {
            assert_eq!(shown(&object(0x2000, data), bytes), said, "{data:?}");
        }
    }
}

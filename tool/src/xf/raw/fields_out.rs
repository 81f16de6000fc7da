//! Converts the answer of a function to text and JSON.

use ecmsk::cia402::Statusword;
use ecmsk::coe::AbortCode;
use ecmsk::xf::fields::{AnswerFields, Field, FieldKind, FunctionFields, Names, Value};
use ecmsk::xf::response::Returned;
use serde_json::{Map, Value as Json, json};

use crate::hex::{hex, spaced};
use crate::xf::Shown;
use crate::xf::words::{listed, word};

/// Converts the answer of a function to text and JSON, field by field.
pub fn shown(row: &FunctionFields, returned: Returned, data: &[u8]) -> Shown {
    let mut json = json!({
        "verb": "xf raw", "name": row.name(), "type": row.type_name, "code": row.code.code(), "parameter": row.function,
    });
    let (text, answer) = match row.answer(returned) {
        Some(form) => by_fields(form, returned, data),
        None if row.answers.is_empty() => ("done".to_owned(), Json::Null),
        None => {
            let valid = &data[..data.len().min(returned.len.into())];
            (format!("returned: {}\ndata: {}", returned.ret, spaced(valid)), json!({"data": hex(valid)}))
        }
    };
    json["answer"] = answer;
    (text, json)
}

fn by_fields(form: &AnswerFields, returned: Returned, data: &[u8]) -> (String, Json) {
    let Some(every) = form.every else {
        let (lines, json) = once(form.fields, returned, data, 0, "");
        return if lines.is_empty() { ("no data".to_owned(), json) } else { (lines.join("\n"), json) };
    };
    let bases = (0..usize::from(returned.len)).step_by(every.max(1).into());
    let parts = bases.enumerate().map(|(n, base)| once(form.fields, returned, data, base, &format!("{n}.")));
    let (lines, json): (Vec<_>, Vec<_>) = parts.unzip();
    (lines.concat().join("\n"), json.into())
}

fn once(fields: &[Field], returned: Returned, data: &[u8], base: usize, before: &str) -> (Vec<String>, Json) {
    let (mut lines, mut json) = (Vec::new(), Map::new());
    for field in fields {
        let Some(value) = field.get(returned, data, base) else { continue };
        let (text, value) = match value {
            Value::Number(number) => of_number(field, number),
            Value::Bytes(bytes) => of_bytes(field.kind, bytes),
        };
        lines.push(format!("{before}{}: {text}", field.name));
        json.insert(field.name.to_owned(), value);
    }
    (lines, json.into())
}

fn of_number(field: &Field, number: i64) -> (String, Json) {
    let hex = || format!("0x{number:0digits$X}", digits = usize::from(field.bytes.clamp(1, 4)) * 2);
    let with_name = |name: Option<String>| {
        let text = name.as_ref().map_or_else(hex, |name| format!("{name} ({})", hex()));
        (text, json!({"value": number, "name": name}))
    };
    match field.kind {
        FieldKind::Hex => (format!("{} ({number})", hex()), number.into()),
        FieldKind::Named(names) | FieldKind::Choice(names) => match name_of(number, names) {
            Some(name) => (format!("{name} ({number})"), json!({"value": number, "name": name})),
            None => (number.to_string(), json!({"value": number, "name": null})),
        },
        FieldKind::Bits(names) => {
            let set = |(name, bits): &&(&str, u32)| {
                (bits.is_power_of_two() && number & i64::from(*bits) != 0).then(|| word(name))
            };
            let names: Vec<String> = names.iter().filter_map(|bit| set(&bit)).collect();
            (format!("{} ({})", listed(&names), hex()), json!({"value": number, "names": names}))
        }
        FieldKind::DriveState => with_name(Statusword(number as u16).state().map(|state| state.name().to_owned())),
        FieldKind::Abort if number == 0 => with_name(Some("none".to_owned())),
        FieldKind::Abort => with_name(AbortCode(number as u32).text().map(str::to_owned)),
        _ => (number.to_string(), number.into()),
    }
}

fn name_of(number: i64, names: Names) -> Option<String> {
    names.iter().find(|(_, known)| i64::from(*known) == number).map(|(name, _)| word(name))
}

fn of_bytes(kind: FieldKind, bytes: &[u8]) -> (String, Json) {
    match kind {
        FieldKind::Text | FieldKind::NumberOrText => {
            let text = String::from_utf8_lossy(bytes);
            let text = text.trim_end_matches(['\0', ' ']);
            (text.to_owned(), text.into())
        }
        FieldKind::Objects { .. } => {
            let objects =
                bytes.as_chunks::<4>().0.iter().map(|object| format!("0x{:08X}", u32::from_le_bytes(*object)));
            let objects: Vec<_> = objects.collect();
            (listed(&objects), objects.into())
        }
        FieldKind::SlaveSet => {
            let slaves = (0..8 * bytes.len()).filter(|slave| bytes[slave / 8] >> (slave % 8) & 1 == 1);
            let slaves: Vec<_> = slaves.collect();
            (listed(&slaves.iter().map(usize::to_string).collect::<Vec<_>>()), slaves.into())
        }
        _ => (spaced(bytes), hex(bytes).into()),
    }
}

//! Code for tests that compare what tshark shows with the plugin and what `ecmsk dump --json` prints.

use std::path::{Path, PathBuf};
use std::process::Command;

use ecmsk::cia402::Mode;
use serde_json::{Map, Value};

use super::{json_lines, run};

/// The plugin in `share/wireshark`, which is the same that `ecmsk wireshark install` writes.
pub fn plugin() -> PathBuf {
    support::root().join("share/wireshark/ecmsk.lua")
}

/// Runs tshark with the plugin on a file; returns its output. An error of the plugin is a panic.
#[track_caller]
pub fn tshark(file: &Path, options: &[&str]) -> String {
    let mut tshark = Command::new("tshark");
    tshark.arg("-X").arg(format!("lua_script:{}", plugin().display())).arg("-r").arg(file).args(options);
    let out = support::succeed(&mut tshark);
    assert!(!out.contains("Lua Error"), "{}", out.lines().find(|line| line.contains("Lua Error")).unwrap_or_default());
    out
}

/// The packets of a file that the plugin dissects as `protocol`, each with its number and the layer that tshark shows.
pub fn shown(file: &Path, protocol: &str, options: &[&str]) -> Vec<(u64, Value)> {
    let layers = format!("frame {protocol}");
    let out = tshark(file, &[&["-T", "json", "-J", &layers, "--no-duplicate-keys"], options].concat());
    let packets: Vec<Value> = serde_json::from_str(&out).expect("JSON");
    let of_protocol = packets.into_iter().filter_map(|mut packet| {
        let layers = &mut packet["_source"]["layers"];
        let number = layers["frame"]["frame.number"].as_str()?.parse().ok()?;
        let layer = layers[protocol].take();
        (!layer.is_null()).then_some((number, layer))
    });
    of_protocol.collect()
}

/// The lines of `ecmsk dump --json` for a file, without the line about the recording as a whole.
pub fn dumped(file: &Path, options: &[&str]) -> Vec<Value> {
    let ran = run([&["dump", file.to_str().expect("UTF-8"), "--json"], options].concat());
    assert_eq!(ran.code, Some(0), "{ran:?}");
    json_lines(&ran.out).into_iter().filter(|line| line.get("recording").is_none()).collect()
}

/// A field of a layer. The fields that tshark shows below another field are in an object beside that field, which has `_tree`
/// at the end of its name.
pub fn field<'v>(layer: &'v Value, name: &str) -> Option<&'v Value> {
    layer.get(name).or_else(|| layer.get(format!("{}_tree", name.rsplit_once('.')?.0))?.get(name))
}

/// The values of a field that may be there once, several times or not at all.
pub fn values(layer: &Value, name: &str) -> Vec<Value> {
    match layer.get(name) {
        Some(Value::Array(values)) => values.clone(),
        Some(value) => vec![value.clone()],
        None => Vec::new(),
    }
}

/// Whether a value in tshark's output, which is always a text, is equal to this value of the JSON of `dump`.
pub fn is_same(shown: &Value, expected: &Value) -> bool {
    let text = shown.as_str().unwrap_or_default();
    match expected {
        Value::Bool(yes) => text == if *yes { "1" } else { "0" },
        Value::Number(number) => number.as_i64().is_some() && parsed(text) == number.as_i64(),
        Value::Array(_) => shown == expected || expected.as_array().is_some_and(|list| list[..] == [shown.clone()]),
        other => shown == other,
    }
}

/// Parses a number as tshark prints it, decimal or with 0x.
fn parsed(text: &str) -> Option<i64> {
    match text.strip_prefix("0x") {
        Some(digits) => i64::from_str_radix(digits, 16).ok(),
        None => text.parse().ok(),
    }
}

/// The fields of a slot by name, as the plugin shows them.
fn fields_of_slot(slot: &Value) -> Map<String, Value> {
    let object = slot.as_object().expect("a slot");
    let named = object.iter().filter_map(|(key, value)| Some((key.strip_prefix("ecmsk.slot.")?, value)));
    // Left out: the text of an object, which its parts show as well, and the raw bytes of a slot without a meaning, which
    // `dump` does not show.
    let kept = named.filter(|(name, _)| !name.ends_with("_tree") && !["object", "raw"].contains(name));
    kept.map(|(name, value)| (name.to_owned(), value.clone())).collect()
}

/// The fields of a slot by name, from the JSON of `dump`.
fn fields_of_dump(slot: &Value) -> Map<String, Value> {
    let mut fields = Map::new();
    for (name, value) in slot.as_object().expect("a slot") {
        match (name.as_str(), value) {
            ("raw" | "text", _) => {}
            ("slot", _) => fields.extend([("n".to_owned(), value.clone())]),
            ("id", _) => fields.extend([("cmd".to_owned(), value.clone())]),
            // In a response the mode is a number in the JSON of `dump`. The plugin shows its name.
            ("mode", Value::Number(code)) => {
                let mode = code.as_u64().and_then(|code| Mode::from_code(code as u8));
                let name = mode.map_or_else(|| code.to_string(), |mode| mode.name().to_owned());
                fields.extend([("mode".to_owned(), name.into())]);
            }
            (_, Value::Object(parts)) => {
                fields.extend(parts.iter().map(|(part, value)| (format!("{name}.{part}"), value.clone())));
            }
            _ => fields.extend([(name.clone(), value.clone())]),
        }
    }
    fields.insert("cmd_code".to_owned(), slot["raw"]["id"].clone());
    // For a malformed command the JSON of `dump` has the index only among the raw numbers. The plugin shows it as a field.
    if slot.get("malformed").is_some() && slot["role"] == "slave" {
        fields.insert("index".to_owned(), slot["raw"]["index"].clone());
    }
    fields
}

/// Compares all frames of a file, slot by slot and field by field; returns how many fields there were.
#[track_caller]
pub fn compare_frames(file: &Path, dump: &[&str], options: &[&str]) -> usize {
    let (shown, dumped) = (shown(file, "ecmsk", options), dumped(file, dump));
    assert_eq!(shown.len(), dumped.len(), "frames of {}", file.display());
    assert!(!shown.is_empty());
    shown.iter().zip(&dumped).map(|((number, layer), frame)| compare_frame(*number, layer, frame)).sum()
}

#[track_caller]
fn compare_frame(number: u64, layer: &Value, frame: &Value) -> usize {
    for (name, expected) in [
        ("ecmsk.direction", &frame["direction"]),
        ("ecmsk.slot_bytes", &frame["slot_bytes"]),
        ("ecmsk.crc", &frame["crc"]["found"]),
        ("ecmsk.crc.expected", &frame["crc"]["expected"]),
        ("ecmsk.crc.status", &frame["crc"]["status"]),
    ] {
        let shown = field(layer, name).unwrap_or(&Value::Null);
        assert!(is_same(shown, expected), "packet {number}: {name} is {shown} in tshark, {expected} in dump");
    }
    let (slots, expected) = (values(layer, "ecmsk.slot"), frame["slots"].as_array().expect("slots"));
    assert_eq!(slots.len(), expected.len(), "packet {number}: slots");
    slots.iter().zip(expected).map(|(slot, expected)| compare_slot(number, slot, expected)).sum()
}

#[track_caller]
fn compare_slot(number: u64, slot: &Value, expected: &Value) -> usize {
    let (shown, dumped) = (fields_of_slot(slot), fields_of_dump(expected));
    let names = |fields: &Map<String, Value>| fields.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(&shown), names(&dumped), "packet {number}: {}", expected["text"]);
    for (name, shown) in &shown {
        let expected_value = &dumped[name];
        assert!(
            is_same(shown, expected_value),
            "packet {number}: {name} is {shown} in tshark, {expected_value} in dump: {}",
            expected["text"]
        );
    }
    shown.len()
}

/// The remarks (expert information) of a layer: for each its field and its text.
pub fn remarks(layer: &Value) -> Vec<(String, String)> {
    let mut found = Vec::new();
    collect_remarks(layer, &mut found);
    found
}

fn collect_remarks(value: &Value, found: &mut Vec<(String, String)>) {
    match value {
        Value::Array(values) => values.iter().for_each(|value| collect_remarks(value, found)),
        Value::Object(object) => {
            let text = object.get("_ws.expert.message").and_then(Value::as_str);
            let name = object.keys().find(|key| key.starts_with("ecmsk"));
            match (name, text) {
                (Some(name), Some(text)) => found.push((name.clone(), text.to_owned())),
                _ => object.values().for_each(|value| collect_remarks(value, found)),
            }
        }
        _ => {}
    }
}

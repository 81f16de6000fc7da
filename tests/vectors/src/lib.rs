//! Shared code of the tests of the wire format: the golden frames as in their file, and a frame full of rubbish.

pub mod golden;
pub mod xf;

use ecmsk::sk::{Frame, RawSlot, SlotSize};
use serde_json::Value;

/// A frame of `tests/vectors/ecm-sk-frames.json`.
pub struct Vector {
    pub name: String,
    pub size: SlotSize,
    /// `filled`, `absent` or `wrong`.
    pub crc: String,
    /// The CRC over the frame's bytes; `None` if the vector has no CRC.
    pub crc8: Option<u8>,
    /// The slots by their number in the vector, byte 3 of slot 0 being 0.
    pub slots: Vec<RawSlot>,
    /// 504 or 512 bytes.
    pub bytes: Vec<u8>,
}

impl Vector {
    pub fn frame(&self) -> Frame {
        Frame::from_prefix(&self.bytes)
    }

    pub fn is_response(&self) -> bool {
        self.name.starts_with("resp-")
    }
}

fn file() -> Value {
    serde_json::from_str(include_str!("../ecm-sk-frames.json")).expect("the vectors are JSON")
}

/// The CRC's parameters: poly, init, check over `123456789`; the rest of them is checked here.
pub fn crc_parameters() -> (u8, u8, u8) {
    let crc = &file()["crc8"];
    assert_eq!((&crc["refin"], &crc["refout"], &crc["xorout"]), (&false.into(), &false.into(), &0.into()));
    (number(crc, "poly") as u8, number(crc, "init") as u8, number(crc, "check_123456789") as u8)
}

/// All golden frames.
pub fn vectors() -> Vec<Vector> {
    let all: Vec<Vector> = file()["frames"].as_array().expect("an array").iter().map(vector).collect();
    assert_eq!(all.len(), 32, "vectors were lost");
    all
}

/// The golden frame of that name.
pub fn vector_named(name: &str) -> Vector {
    vectors().into_iter().find(|vector| vector.name == name).unwrap_or_else(|| panic!("no vector {name}"))
}

/// 512 bytes of 0xA5: an encoder that leaves out a byte fails.
pub fn rubbish() -> Frame {
    Frame::from_bytes([0xA5; 512])
}

fn vector(v: &Value) -> Vector {
    let size = SlotSize::from_bytes(number(v, "slot_bytes") as usize).expect("12 or 16");
    let mut slots = vec![RawSlot::ZERO; size.slots()];
    for (i, fields) in v["slots"].as_object().expect("an object") {
        let cmd = number(fields, "cmd") as u16;
        slots[i.parse::<usize>().expect("a slot number")] = RawSlot {
            id: cmd as u8,
            index: (cmd >> 8) as u8,
            parm: number(fields, "parm") as u16,
            data1: number(fields, "d1") as u32,
            data2: number(fields, "d2") as u32,
            data3: number(fields, "d3") as u32,
        };
    }
    Vector {
        name: text(v, "name"),
        size,
        crc: text(v, "crc"),
        crc8: v["crc8"].as_u64().map(|crc| crc as u8),
        slots,
        bytes: hex(&text(v, "hex")),
    }
}

fn number(v: &Value, key: &str) -> i64 {
    v.get(key).map_or(0, |number| number.as_i64().expect("an integer"))
}

fn text(v: &Value, key: &str) -> String {
    v[key].as_str().expect("a string").to_owned()
}

fn hex(digits: &str) -> Vec<u8> {
    digits
        .as_bytes()
        .chunks(2)
        .map(|pair| u8::from_str_radix(std::str::from_utf8(pair).expect("ASCII"), 16).expect("hex digits"))
        .collect()
}

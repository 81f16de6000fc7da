//! The golden packets of the ECM-XF as in their file.

use ecmsk::xf::{CheckRule, CheckType, CrcCoverage, DataSize};
use serde_json::Value;

use crate::{hex, number, text};

/// A packet of `tests/vectors/ecm-xf-packets.json`.
pub struct Packet {
    pub name: String,
    pub is_answer: bool,
    pub size: DataSize,
    pub rule: CheckRule,
    /// The check word.
    pub check: u32,
    fields: Value,
    /// n + 32 bytes.
    pub bytes: Vec<u8>,
}

impl Packet {
    /// A field of the header.
    pub fn field(&self, key: &str) -> u32 {
        number(&self.fields, key) as u32
    }

    /// A field of several bytes.
    pub fn field_bytes<const N: usize>(&self, key: &str) -> [u8; N] {
        let bytes = self.fields[key].as_array().expect("an array").iter();
        let bytes: Vec<u8> = bytes.map(|byte| byte.as_u64().expect("a byte") as u8).collect();
        bytes.try_into().expect("as many bytes")
    }

    /// The begin of the data segment; the rest is 0.
    pub fn data(&self) -> Vec<u8> {
        hex(&text(&self.fields, "data"))
    }
}

/// All golden packets.
pub fn packets() -> Vec<Packet> {
    let file: Value = serde_json::from_str(include_str!("../ecm-xf-packets.json")).expect("the vectors are JSON");
    let all: Vec<Packet> = file["frames"].as_array().expect("an array").iter().map(packet).collect();
    assert_eq!(all.len(), 20, "vectors were lost");
    all
}

/// The golden packet of that name.
pub fn packet_named(name: &str) -> Packet {
    packets().into_iter().find(|packet| packet.name == name).unwrap_or_else(|| panic!("no packet {name}"))
}

fn packet(v: &Value) -> Packet {
    let coverage = match text(v, "crc_cover").as_str() {
        "valid" => CrcCoverage::Valid,
        other => {
            assert_eq!(other, "all");
            CrcCoverage::All
        }
    };
    Packet {
        name: text(v, "name"),
        is_answer: v.get("answer").is_some(),
        size: DataSize::new(number(v, "data_size") as usize).expect("a size"),
        rule: CheckRule { kind: CheckType::from_code(number(v, "crc_type") as u8).expect("0 or 3"), coverage },
        check: number(v, "check") as u32,
        fields: v["fields"].clone(),
        bytes: hex(&text(v, "hex")),
    }
}

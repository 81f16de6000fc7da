//! Test: every message is encoded to the bytes that a table in this file lists. The bytes are frozen: a change requires a new
//! version of the protocol.

use proptest::prelude::*;

use super::wire::{
    Counts, End, Failure, Greeting, Hello, MESSAGE_MAX, Message, PAYLOAD_MAX, Refusal, Role, StopEnd, Welcome,
    WireError,
};
use crate::engine::Counters;
use crate::link::{ReadMeta, Stamp, Wait};
use crate::sk::SlotSize;

const FRAME: [u8; 512] = [0xA5; 512];
const META: ReadMeta = ReadMeta { at: Stamp(0x0102), sequence: 3, dropped: 4 };

fn all() -> Vec<(Message<'static>, &'static str)> {
    let board = Counters {
        frames: 1,
        while_booting: 13,
        outputs_lost: 17,
        cycles_left_out: 18,
        rejected: std::array::from_fn(|i| i as u64 + 14),
        ..Counters::default()
    };
    vec![
        (
            Message::Hello(Hello { role: Role::Reader, keepalive_ms: 500, pid: 0x1234, program: "p", proof: &[7; 32] }),
            "2c000100 01 f4010000 34120000 [07;32] 0100 70",
        ),
        (
            Message::Write { request: 1, wait: Wait::Forever, frame: &FRAME },
            "10020200 0100000000000000 ffffffffffffffff [a5;512]",
        ),
        (Message::Read { request: 2, wait: Wait::Now }, "10000300 0200000000000000 0000000000000000"),
        (Message::Pass { request: 3, ns: 1000 }, "10000400 0300000000000000 e803000000000000"),
        (Message::Count { request: 4 }, "08000500 0400000000000000"),
        (Message::Cancel { request: 5 }, "08000600 0500000000000000"),
        (Message::Stop { request: 6, off: true }, "09000700 0600000000000000 01"),
        (Message::Ping, "00004000"),
        (Message::Bye { end: End::Lost, text: "oh" }, "05004100 03 0200 6f68"),
        (Message::Bye { end: End::Overruled, text: "p" }, "04004100 05 0100 70"),
        (
            Message::Hello(Hello { role: Role::Stopper, keepalive_ms: 500, pid: 2, program: "p", proof: &[7; 32] }),
            "2c000100 02 f4010000 02000000 [07;32] 0100 70",
        ),
        (
            Message::Hello(Hello { role: Role::Asker, keepalive_ms: 500, pid: 2, program: "p", proof: &[7; 32] }),
            "2c000100 03 f4010000 02000000 [07;32] 0100 70",
        ),
        (Message::Ask { request: 7, from: 512 }, "0c000800 0700000000000000 00020000"),
        (
            Message::Machine { request: 7, length: 514, name: "m.toml", part: b"ab" },
            "18008a00 0700000000000000 02020000 0600 6d2e746f6d6c 0200 6162",
        ),
        (
            Message::Welcome(Welcome {
                proof: &[7; 32],
                slot: Some(SlotSize::Bytes16),
                virtual_time: true,
                now: Stamp(9),
                sequence: 8,
                board: "sim:",
                slaves: "drive",
                counts_per_unit: "5",
            }),
            "42008100 [07;32] 10 01 0900000000000000 0800000000000000 0400 73696d3a 0500 6472697665 0100 35",
        ),
        (Message::Refused { why: Refusal::HasWriter, text: "x" }, "04008200 01 0100 78"),
        (
            Message::Report { meta: META, frame: &FRAME },
            "18028300 0201000000000000 0300000000000000 0400000000000000 [a5;512]",
        ),
        (
            Message::Written { request: 6, at: Stamp(7), now: None },
            "18008400 0600000000000000 0700000000000000 ffffffffffffffff",
        ),
        (
            Message::Got { request: 6, now: Some(Stamp(7)), meta: META, frame: &FRAME },
            "28028500 0600000000000000 0700000000000000 0201000000000000 0300000000000000 0400000000000000 [a5;512]",
        ),
        (Message::Passed { request: 6, now: Some(Stamp(7)) }, "10008600 0600000000000000 0700000000000000"),
        (
            Message::Counted { request: 6, counts: Counts { reports_dropped: 5, board: None } },
            "11008700 0600000000000000 0500000000000000 00",
        ),
        (
            Message::Counted { request: 6, counts: Counts { reports_dropped: 5, board: Some(board) } },
            "09018700 0600000000000000 0500000000000000 01 0100000000000000 [00;88] 0d00000000000000 [00;24] \
             1100000000000000 1200000000000000 [00;24] 0e00000000000000 0f00000000000000 1000000000000000 1100000000000000 1200000000000000 \
             1300000000000000 1400000000000000 1500000000000000 1600000000000000 1700000000000000",
        ),
        (
            Message::Failed { request: 6, now: None, failure: Failure { code: 2, numbers: [1, 2], text: "" } },
            "23008800 0600000000000000 ffffffffffffffff 02 0100000000000000 0200000000000000 0000",
        ),
        (
            Message::Stopped { request: 6, end: StopEnd::Failed, writer: "w", text: "oh" },
            "10008900 0600000000000000 04 0100 77 0200 6f68",
        ),
    ]
}

/// The bytes of hexadecimal digits, in which `[xx;n]` stands for n times the byte xx.
fn bytes(text: &str) -> Vec<u8> {
    let mut bytes = Vec::new();
    for word in text.split_whitespace() {
        if let Some((byte, count)) = word.strip_prefix('[').and_then(|word| word.strip_suffix(']')?.split_once(';')) {
            bytes.extend(vec![u8::from_str_radix(byte, 16).unwrap(); count.parse().unwrap()]);
        } else {
            bytes.extend((0..word.len()).step_by(2).map(|i| u8::from_str_radix(&word[i..i + 2], 16).unwrap()));
        }
    }
    bytes
}

/// Every message encodes to its frozen bytes, and these decode to the message.
#[test]
fn every_message_encodes_to_its_frozen_bytes_and_back() {
    for (message, text) in all() {
        let mut out = [0x5A; MESSAGE_MAX];
        let length = message.encode(&mut out);
        assert_eq!(out[..length], bytes(text), "{message:?}");
        assert!(out[length..].iter().all(|byte| *byte == 0x5A));
        assert_eq!(Message::decode(out[2], &out[4..length]), Ok(message));
    }
    let greeting = Greeting { tls: true, has_room: false };
    assert_eq!(greeting.encode()[..], bytes("65636d736b746370 0400 01 00 00000000"));
    assert_eq!(Greeting::decode(&greeting.encode()), Ok(greeting));
}

/// TCP-12 A message with a byte too few or too many is refused.
#[test]
fn a_message_with_a_byte_too_few_or_too_many_is_refused() {
    for (message, _) in all() {
        let mut out = [0; MESSAGE_MAX];
        let length = message.encode(&mut out);
        for end in 4..length {
            let cut = Message::decode(out[2], &out[4..end]);
            assert!(matches!(cut, Err(WireError::Short { .. })), "{message:?} cut at {end}: {cut:?}");
        }
        let more = Message::decode(out[2], &out[4..=length]);
        assert!(matches!(more, Err(WireError::Trailing { extra: 1, .. })), "{message:?}: {more:?}");
    }
}

/// A text that is too long is cut between two characters.
#[test]
fn a_text_that_is_too_long_is_cut_between_characters() {
    let text = "ä".repeat(200);
    let mut out = [0; MESSAGE_MAX];
    let length = Message::Bye { end: End::Lost, text: &text }.encode(&mut out);
    let Ok(Message::Bye { text: came, .. }) = Message::decode(out[2], &out[4..length]) else { panic!("it is one") };
    assert_eq!(came, "ä".repeat(128));
}

proptest! {
    /// TCP-12 Any payload of any kind is a message that encodes to the same bytes, or an error.
    #[test]
    fn what_decodes_encodes_to_the_same(kind: u8, payload in prop::collection::vec(any::<u8>(), 0..PAYLOAD_MAX)) {
        if let Ok(message) = Message::decode(kind, &payload) {
            let mut out = [0; MESSAGE_MAX];
            let length = message.encode(&mut out);
            prop_assert_eq!((out[2], &out[4..length]), (kind, &payload[..]));
        }
    }
}

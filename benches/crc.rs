//! `crc8_504`: the CRC-8 of a 12-byte frame against a loop over its bytes with a table of 256.

mod common;

use std::hint::black_box;

use ecmsk::sk::crc::frame_crc;

const TABLE: [u8; 256] = {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let mut crc = byte as u8;
        let mut bit = 0;
        while bit < 8 {
            crc = if crc & 0x80 == 0 { crc << 1 } else { crc << 1 ^ 0x07 };
            bit += 1;
        }
        table[byte] = crc;
        byte += 1;
    }
    table
};

fn bytewise(frame: &[u8]) -> u8 {
    let mut crc = 0x5A;
    for (i, byte) in frame.iter().enumerate() {
        let byte = if i == 3 { 0 } else { *byte };
        crc = TABLE[usize::from(crc ^ byte)];
    }
    crc
}

fn main() {
    let mut frame = [0; 504];
    for (i, byte) in frame.iter_mut().enumerate() {
        *byte = (i * 37 + 11) as u8;
    }
    assert_eq!(frame_crc(&frame), bytewise(&frame), "the two do not compute the same");

    common::pair(
        "crc8_504",
        0.25,
        || {
            black_box(frame_crc(black_box(&frame)));
        },
        || {
            black_box(bytewise(black_box(&frame)));
        },
    );
}

//! The binary format of points. A block consists of records. Each record has points of one channel and is independent
//! of all others, so a page can read on after a block that was dropped. `tool/web/src/codec.js` decodes the blocks.
//!
//! A record begins with the channel, flags (bit 0: the first point is not connected with the previous point of the
//! channel) and the number of points. For each point follow its time in nanoseconds and its value, in steps of the
//! channel's factor. All numbers are in LEB128.
//!
//! A value is stored as its difference from the previous value. A time is stored as the change of the interval: the
//! interval to the previous time, minus the interval before that. Before the first point of a record, time, interval
//! and value are 0. The differences are signed, in zigzag encoding. So with a constant cycle, a point of an axis at
//! rest takes two bytes.

/// A point: nanoseconds since the first frame, and the value in steps of the channel's factor.
pub type Point = (i64, i64);

/// Appends a record with points of a channel to a block. `breaks`: the first point is not connected with the channel's
/// previous point. Points inside a run of equal values are left out, since a straight line connects the ends of the
/// run.
pub fn append(block: &mut Vec<u8>, channel: usize, breaks: bool, points: &[Point]) {
    let inside = |i: usize| {
        let near = i.checked_sub(1).and_then(|before| points.get(before)).zip(points.get(i + 1));
        near.is_some_and(|(before, after)| before.1 == points[i].1 && after.1 == points[i].1)
    };
    let kept = || points.iter().enumerate().filter(|(i, _)| !inside(*i)).map(|(_, point)| *point);
    unsigned(block, channel as u64);
    unsigned(block, u64::from(breaks));
    unsigned(block, kept().count() as u64);
    let (mut before, mut step) = ((0_i64, 0_i64), 0_i64);
    for (at_ns, value) in kept() {
        let now = at_ns.wrapping_sub(before.0);
        signed(block, now.wrapping_sub(step));
        signed(block, value.wrapping_sub(before.1));
        (before, step) = ((at_ns, value), now);
    }
}

fn signed(block: &mut Vec<u8>, value: i64) {
    unsigned(block, ((value << 1) ^ (value >> 63)).cast_unsigned());
}

fn unsigned(block: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        block.push(value as u8 | 0x80);
        value >>= 7;
    }
    block.push(value as u8);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `tool/web/tests/codec.test.js` uses the same bytes to test the decoder in JavaScript.
    #[test]
    fn a_record_has_the_bytes_that_the_page_reads() {
        let mut block = Vec::new();
        append(&mut block, 300, true, &[(1_000_000, -5), (2_000_000, 7), (3_000_100, 7)]);
        let expected = [0xAC, 0x02, 0x01, 0x03, 0x80, 0x89, 0x7A, 0x09, 0x00, 0x18, 0xC8, 0x01, 0x00];
        assert_eq!(block, expected);
    }

    /// In a run of equal values, only the first and the last point are written.
    #[test]
    fn a_run_of_equal_values_has_two_points() {
        let points: Vec<Point> = (0..1000).map(|i| (i * 1_000_000, if i < 500 { 3 } else { 4 })).collect();
        let (mut run, mut ends) = (Vec::new(), Vec::new());
        append(&mut run, 0, false, &points);
        append(&mut ends, 0, false, &[points[0], points[499], points[500], points[999]]);
        assert_eq!(run, ends);
    }
}

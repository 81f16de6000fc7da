//! The binary format of points. A block consists of records. Each record belongs to one channel and is independent of all
//! others, so that a page can read on after a block that it did not get. `tool/web/src/codec.js` reads them.
//!
//! A record: channel, flags (bit 0: its first point is not connected with the channel's point before), number of points, then
//! for each point its time in nanoseconds and its value, in whole steps of the channel's factor. All are LEB128 numbers. A
//! value is stored as its difference to the value before. A time is stored as the difference of two intervals: that to the time
//! before, and the one before that. Time, interval and value before the first point of a record are 0. The differences are
//! signed by zigzag: at a steady cycle a point at rest takes two bytes.

/// A point: nanoseconds since the first frame, value in steps of the channel's factor.
pub type Point = (i64, i64);

/// Appends a record with points of a channel to a block. `breaks`: the first point is not connected with the channel's
/// point before. Points inside a run of equal values are left out: a straight line connects the ends of the run.
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

    /// `tool/web/tests/codec.test.js` tests with the same bytes that JavaScript decodes them.
    #[test]
    fn a_record_has_the_bytes_that_the_page_reads() {
        let mut block = Vec::new();
        append(&mut block, 300, true, &[(1_000_000, -5), (2_000_000, 7), (3_000_100, 7)]);
        let expected = [0xAC, 0x02, 0x01, 0x03, 0x80, 0x89, 0x7A, 0x09, 0x00, 0x18, 0xC8, 0x01, 0x00];
        assert_eq!(block, expected);
    }

    /// Of a run of equal values only the first and the last point are written.
    #[test]
    fn a_run_of_equal_values_has_two_points() {
        let points: Vec<Point> = (0..1000).map(|i| (i * 1_000_000, if i < 500 { 3 } else { 4 })).collect();
        let (mut run, mut ends) = (Vec::new(), Vec::new());
        append(&mut run, 0, false, &points);
        append(&mut ends, 0, false, &[points[0], points[499], points[500], points[999]]);
        assert_eq!(run, ends);
    }
}

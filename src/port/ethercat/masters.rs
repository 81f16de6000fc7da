//! Detects whether a master sends frames to the simulated slaves, and whether a second one does so at the same time.
//! The caller passes the time to every call, so that tests need no clock.

use std::time::{Duration, Instant};

use crate::ethercat::FrameHeader;
use crate::io::ethernet::MacAddress;

/// After this long without a frame the master counts as gone. \[OURS]
const SILENCE: Duration = Duration::from_secs(2);
/// If no frame has come for this long since the start of the server, a log line asks whether the master is connected.
/// \[OURS]
const FIRST_FRAME: Duration = Duration::from_secs(10);

/// What is known of the masters that send frames to the interfaces of a server, from the times and source addresses of
/// these frames.
pub(super) struct Masters {
    interface: String,
    /// When the log is to ask whether the master is connected; `None`: the log has asked, or a frame has come.
    asks: Option<Instant>,
    /// When the last frame came; `None`: there is no master.
    last_frame: Option<Instant>,
    /// The source address of the present master's first frame. `None`: no such frame has come yet.
    source: Option<MacAddress>,
    /// A second source address that was seen after `source`. If `source` then comes again, the two addresses belong to
    /// two masters that send at the same time. `None`: there was only one address.
    other: Option<MacAddress>,
    is_other_told: bool,
}

impl Masters {
    /// Creates the state before the first frame of a master. `interface` is the name of the interface before the first
    /// slave.
    pub(super) fn new(interface: String, begin: Instant) -> Self {
        Self {
            interface,
            asks: Some(begin + FIRST_FRAME),
            last_frame: None,
            source: None,
            other: None,
            is_other_told: false,
        }
    }

    /// Records a frame of a master at `now`. Returns the line for the log, if any. `source`: the source address of the
    /// frame, if the frame came in before the first slave. `None` for a frame at the other end of a ring, where the
    /// same master may use another address.
    pub(super) fn note(&mut self, source: Option<&[u8]>, now: Instant) -> Option<String> {
        self.asks = None;
        let comes = self.last_frame.replace(now).is_none();
        if let Some(&[first, ref rest @ ..]) = source.and_then(<[u8]>::first_chunk::<6>) {
            let mut source = [first & !FrameHeader::PASSED_A_SLAVE; 6];
            source[1..].copy_from_slice(rest);
            if let Some(line) = self.compare(source) {
                return Some(line);
            }
        }
        comes.then(|| format!("a master is there on {}", self.interface))
    }

    /// Detects two masters by their alternating source addresses: a master that replaces another one does not
    /// alternate. Returns the log line about the two masters when it detects them for the first time, otherwise `None`.
    fn compare(&mut self, source: MacAddress) -> Option<String> {
        let first = *self.source.get_or_insert(source);
        if source != first {
            self.other = Some(source);
            return None;
        }
        let other = self.other.filter(|_| !self.is_other_told)?;
        self.is_other_told = true;
        let [first, other] = [first, other].map(|address| address.map(|byte| format!("{byte:02X}")).join(":"));
        Some(format!(
            "another master sends frames to {}, too: {first} and {other}; the slaves obey both, so stop one of them",
            self.interface
        ))
    }

    /// Advances the time to `now`. Returns the line for the log if no master has come or the master is gone; otherwise
    /// `None`.
    pub(super) fn pass(&mut self, now: Instant) -> Option<String> {
        if self.last_frame.is_some_and(|last| now.saturating_duration_since(last) >= SILENCE) {
            (self.last_frame, self.source, self.other, self.is_other_told) = (None, None, None, false);
            return Some(format!("no frame has come for {} s: the master is gone", SILENCE.as_secs()));
        }
        self.asks.take_if(|asks| now >= *asks)?;
        Some(format!(
            "no frame has come to {} within {} s; is the master at the other end of its cable (of a pair of interfaces: on the \
             other one), and is that end switched on?",
            self.interface,
            FIRST_FRAME.as_secs()
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ONE: [u8; 6] = [0x01, 1, 1, 1, 1, 1];
    const OTHER: [u8; 6] = [0x10, 0x20, 0x30, 0x40, 0x50, 0x60];

    /// ECAT-15.22 A line is logged when a master appears, and when no frame has come from it for 2 s. A second master
    /// that sends at the same time is logged once, with both addresses. A master that replaces another one does not
    /// count as a second master.
    #[test]
    fn masters_come_and_go_and_two_are_told() {
        let begin = Instant::now();
        let at = |ms| begin + Duration::from_millis(ms);
        let mut masters = Masters::new("veth1".into(), begin);
        assert_eq!(masters.note(Some(&ONE), at(10)).as_deref(), Some("a master is there on veth1"));
        assert_eq!(masters.note(Some(&ONE), at(20)), None);
        // Slaves set a bit in the source address of a frame (0x02 of the first byte). An address with this bit counts
        // as the same address.
        assert_eq!(masters.note(Some(&[ONE[0] | 2, 1, 1, 1, 1, 1]), at(30)), None);
        assert_eq!(masters.note(Some(&OTHER), at(40)), None, "it may be the next one");
        let said = masters.note(Some(&ONE), at(50)).expect("it is told");
        assert!(said.contains("another master") && said.contains("01:01:01:01:01:01 and 10:20:30:40:50:60"), "{said}");
        assert_eq!(masters.note(Some(&OTHER), at(60)), None, "once");
        assert_eq!(masters.note(Some(&ONE), at(70)), None, "once");
        assert_eq!(masters.pass(at(2000)), None);
        assert_eq!(masters.pass(at(2070)).as_deref(), Some("no frame has come for 2 s: the master is gone"));
        assert_eq!(masters.pass(at(20_000)), None, "a master was there");
        assert_eq!(masters.note(Some(&OTHER), at(20_010)).as_deref(), Some("a master is there on veth1"));
        assert_eq!(masters.note(None, at(20_020)), None, "at the other end of a ring a master has another source");
    }

    /// ECAT-15.22 If no frame comes at all, the log asks once whether the master is connected.
    #[test]
    fn a_master_that_does_not_come_is_asked_for() {
        let begin = Instant::now();
        let mut masters = Masters::new("veth1".into(), begin);
        assert_eq!(masters.pass(begin + Duration::from_millis(9_999)), None);
        let said = masters.pass(begin + FIRST_FRAME).expect("it is asked");
        assert!(said.starts_with("no frame has come to veth1 within 10 s; is the master at the other end"), "{said}");
        assert_eq!(masters.pass(begin + 3 * FIRST_FRAME), None, "once");
    }
}

//! Invariants after a writer's end: its axes stand within the documented time, and no entry that it left in the FIFO
//! moves one of them later. The fuzz target `settle` checks the same.

use std::time::Duration;

use ecmsk::link::{Link, Wait};
use ecmsk::port::tcp::in_memory::{ClientMessage, InMemoryClient, InMemoryServer, ServerMessage};
use ecmsk::sk::{FIFO_ENTRIES, Frame};

use super::eyes::Eyes;

/// docs/SAFETY.md: axes are at rest 2 s and some cycles after the server has noticed the end.
pub const DOCUMENTED: Duration = Duration::from_secs(2);
const CYCLES: u32 = 8;
/// How far noise and friction may move a standing shaft, counts: a two-hundredth of a degree and less.
const STANDS: i64 = 60;
/// The time over which the standstill of axes is checked.
const LOOK: Duration = Duration::from_millis(60);

/// Frames with which a server ends a stop that it cannot carry out: they clear the FIFO, and command a standstill.
const LAST_FRAMES: u64 = 2;

/// The server's reaction to a writer's end.
pub struct End {
    pub took: Duration,
    pub told: Vec<String>,
    /// Whether its last entries waited behind a threshold while the axes stood.
    pub was_held: bool,
}

impl End {
    /// Ends the writer without a good-bye, and checks that the server's reaction takes no longer than documented, and
    /// that entries behind a threshold begin no motion.
    pub fn of(writer: InMemoryClient<'_>, server: &InMemoryServer, eyes: &Eyes, cycle_us: u32) -> Self {
        Self::by(server, eyes, cycle_us, || writer.end(false))
    }

    /// Has another client stop the axes, and checks the same. `says_bye`: the writer closes its link before, so that
    /// there is none any more.
    #[allow(dead_code, reason = "the fuzz target `settle` has writers that vanish")]
    pub fn of_stop(
        mut writer: InMemoryClient<'_>,
        says_bye: bool,
        server: &InMemoryServer,
        eyes: &Eyes,
        cycle_us: u32,
    ) -> Self {
        Self::by(server, eyes, cycle_us, || {
            let mut stopper = server.join_stopper().expect("a stop has a place");
            if says_bye {
                writer.end(true);
                stopper.say(ClientMessage::Stop { off: false }, usize::MAX);
            } else {
                stopper.begin(ClientMessage::Stop { off: false }, usize::MAX);
                assert!(!writer.hear(&[]), "its connection ends");
                let said = writer.take_messages().expect("valid messages");
                assert!(matches!(said.last(), Some(ServerMessage::Bye)), "{said:?}");
                writer.end(false);
                while stopper.work() {}
            }
            let said = stopper.take_messages().expect("valid messages");
            assert!(matches!(said.last(), Some(ServerMessage::Stopped { request: 1, .. })), "{said:?}");
            stopper.end(true);
        })
    }

    fn by(server: &InMemoryServer, eyes: &Eyes, cycle_us: u32, end: impl FnOnce()) -> Self {
        let was_held = eyes.holds_what_waits(Duration::from_micros(cycle_us.into()));
        let (began, stood) = (eyes.now(), eyes.shafts());
        end();
        let took = eyes.now() - began;
        if was_held {
            eyes.assert_still(&stood, STANDS, "that stood, by what waited behind a threshold");
        }
        let limit = DOCUMENTED + eyes.stood() + CYCLES * Duration::from_micros(cycle_us.into());
        assert!(took <= limit, "it took {took:?} with a cycle of {cycle_us} us");
        Self { took, told: server.told(), was_held }
    }

    /// Whether the server reports that axes may go on.
    pub fn has_failed(&self) -> bool {
        self.told.iter().any(|line| line.contains("may still move"))
    }
}

/// Heals a fault; returns whether there was one. Then drives that have lost their master, or have an alarm, stand as
/// the others do, and entries that the writer or the server has left are not executed.
pub fn heal(eyes: &Eyes, cycle_us: u32) -> bool {
    if !eyes.is_broken() {
        eyes.heal();
        return false;
    }
    eyes.pass(Duration::from_secs(1)).expect("it is there");
    let stood = eyes.shafts();
    eyes.pass(Duration::from_secs(1)).expect("it is there");
    eyes.assert_still(&stood, STANDS, "while something is broken");
    let executed = eyes.executed();
    eyes.heal();
    eyes.pass(10 * Duration::from_micros(cycle_us.into())).expect("it is there");
    let left = eyes.executed() - executed;
    assert!(left <= LAST_FRAMES, "{left} entries were left in the FIFO, and are executed when all is whole again");
    true
}

/// Asserts that after `rest` axes stand and the FIFO is empty, and that this lasts while another writer sends no
/// commands, long enough to execute every waiting entry.
pub fn assert_lasting(
    server: &InMemoryServer,
    eyes: &Eyes,
    readers: &[InMemoryClient<'_>],
    rest: Duration,
    cycle_us: u32,
) {
    let mut report = Frame::new();
    eyes.pass(rest).expect("it is there");
    let cycles = (LOOK.as_micros() as u64).div_ceil(cycle_us.into()).max(3);
    eyes.drain();
    let stood = eyes.shafts();
    for _ in 0..cycles {
        eyes.read(&mut report, Wait::For(Duration::from_secs(1))).expect("a report");
    }
    eyes.assert_still(&stood, STANDS, "after the stop");
    assert_eq!(eyes.newest_free(), FIFO_ENTRIES, "the FIFO is empty");

    let mut next = server.join(true).expect("the place is free");
    for _ in 0..2 * u64::from(FIFO_ENTRIES) {
        assert!(next.say(ClientMessage::Write(&Frame::new()), usize::MAX) && next.say(ClientMessage::Read, usize::MAX));
        drop(next.take_sent());
        readers.iter().for_each(|reader| drop(reader.take_sent()));
    }
    assert!(eyes.newest_free() + 2 >= FIFO_ENTRIES, "no threshold holds the frames of the next writer");
    next.end(true);
    eyes.assert_still(&stood, STANDS, "under the next writer");
}

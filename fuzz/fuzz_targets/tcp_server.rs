//! Any bytes from a client: the server answers or lets it go; it never panics, what it says can be read, and every frame
//! that the board took is one that was acknowledged.

#![no_main]

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use ecmsk::link::tcp::messages;
use ecmsk::link::{Dir, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Stamp, Wait};
use ecmsk::port::tcp::answer;
use ecmsk::sk::{Frame, SlotSize};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Some((kind, bytes)) = bytes.split_first() else { return };
    let board = Arc::new(Board { kind: *kind, now: AtomicU64::new(0), taken: AtomicU64::new(0) });
    let said = answer(board.clone(), bytes);
    let messages = messages(&said).expect("what a server says can be read");
    assert!(board.taken.load(Ordering::Relaxed) <= messages as u64);
});

/// A board that does at once what it is told, or fails as its kind says.
struct Board {
    kind: u8,
    now: AtomicU64,
    taken: AtomicU64,
}

impl Board {
    fn step(&self, dir: Dir) -> Result<u64, LinkError> {
        let now = self.now.fetch_add(1, Ordering::Relaxed);
        match (self.kind >> 2, now % 8) {
            (1, 7) => Err(LinkError::Timeout { dir, waited: Duration::ZERO, what: "a test" }),
            (2, 7) => Err(LinkError::Lost { name: "board".into(), reason: "a test".into() }),
            (3, 7) => Err(LinkError::Silent { since_ns: now, cycles: 1 }),
            (4, 7) => Err(LinkError::Io { what: "a test".into(), message: "no".into() }),
            _ => Ok(now),
        }
    }
}

impl Link for Board {
    fn info(&self) -> LinkInfo {
        LinkInfo {
            name: "board:".into(),
            slot: [None, Some(SlotSize::Bytes12), Some(SlotSize::Bytes16)][usize::from(self.kind) % 3],
            virtual_time: self.kind & 2 == 0,
            opened_at: Stamp(0),
            read_wait: Wait::Forever,
            write_wait: Wait::Forever,
        }
    }

    fn write(&self, _: &Frame, _: Wait) -> Result<Stamp, LinkError> {
        let at = self.step(Dir::Write)?;
        self.taken.fetch_add(1, Ordering::Relaxed);
        Ok(Stamp(at))
    }

    fn read(&self, out: &mut Frame, _: Wait) -> Result<ReadMeta, LinkError> {
        let now = self.step(Dir::Read)?;
        // Every state of a board comes by.
        out.bytes_mut()[2] = now as u8;
        Ok(ReadMeta { at: Stamp(now), sequence: now, dropped: 0 })
    }

    fn pass(&self, _: Duration) -> Result<Option<Stamp>, LinkError> {
        Ok(Some(Stamp(self.now.load(Ordering::Relaxed))))
    }

    fn cancel(&self, _: Dir) {}

    fn close(&self) {}

    fn check(&self) -> Result<(), LinkError> {
        Ok(())
    }

    fn stats(&self) -> LinkStats {
        LinkStats::default()
    }
}

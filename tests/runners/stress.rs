//! Many threads on one link of the real clock, with every frame accounted for at the end.

use std::collections::HashSet;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use ecmsk::engine::Board;
use ecmsk::link::engine::{EngineLink, RunOptions};
use ecmsk::link::{Dir, LinkError, Wait};
use ecmsk::sk::{CrcPolicy, Frame};

use crate::client::{Client, SIZE, board, target};

const SPAN: Duration = Duration::from_secs(1);

/// LIB-26 Four writers, two readers, one thread that cancels and one that polls, for a second. Every write that
/// succeeded has arrived, and its frame was executed, or counted because the FIFO was full, or is still in it. Every
/// report went to one reader, or was counted as dropped, or is still in the queue; each reader gets them in order and
/// complete.
#[test]
fn eight_threads_and_a_full_account() {
    for host_ns in [0, 125_000] {
        let place: Arc<Mutex<Option<Board>>> = Arc::default();
        let keep = Arc::clone(&place);
        let keeper = Box::new(move |board| *keep.lock().unwrap() = board);
        let options = RunOptions { virtual_time: false, host_ns, ..RunOptions::default() };
        let (board, _) = board(1);
        let reports_before = board.engine().counters().reports;
        let mut client = Client::on(Arc::new(EngineLink::open("stress", board, options, Some(keeper)).unwrap()));
        client.op();
        let written_before = client.link.stats().written;
        let read_before = client.link.stats().read;

        let link = &client.link;
        let stop = AtomicBool::new(false);
        let (accepted, cancelled) = (AtomicU64::new(0), AtomicU64::new(0));
        let seen = Mutex::new(Vec::new());
        thread::scope(|scope| {
            for writer in 0..4u8 {
                let (stop, accepted, cancelled) = (&stop, &accepted, &cancelled);
                scope.spawn(move || {
                    let frame = target(i32::from(writer), writer);
                    while !stop.load(Ordering::Relaxed) {
                        match link.write(&frame, Wait::For(Duration::from_secs(5))) {
                            Ok(_) => accepted.fetch_add(1, Ordering::Relaxed),
                            Err(LinkError::Cancelled { dir: Dir::Write }) => cancelled.fetch_add(1, Ordering::Relaxed),
                            Err(other) => panic!("{other}"),
                        };
                    }
                });
            }
            for _ in 0..2 {
                scope.spawn(|| {
                    let (mut report, mut mine) = (Frame::new(), Vec::new());
                    while !stop.load(Ordering::Relaxed) {
                        match link.read(&mut report, Wait::For(Duration::from_secs(5))) {
                            Ok(meta) => {
                                assert!(mine.last() < Some(&meta.sequence), "in order");
                                assert!(report.check_crc(SIZE, CrcPolicy::Strict).is_ok(), "whole");
                                mine.push(meta.sequence);
                            }
                            Err(LinkError::Cancelled { dir: Dir::Read }) => {}
                            Err(other) => panic!("{other}"),
                        }
                    }
                    seen.lock().unwrap().extend(mine);
                });
            }
            scope.spawn(|| {
                while !stop.load(Ordering::Relaxed) {
                    link.cancel(Dir::Write);
                    link.cancel(Dir::Read);
                    thread::sleep(Duration::from_millis(3));
                }
            });
            scope.spawn(|| {
                let mut last = link.stats();
                while !stop.load(Ordering::Relaxed) {
                    let stats = link.stats();
                    assert!(stats.written >= last.written && stats.reports_dropped >= last.reports_dropped);
                    assert!(link.check().is_ok());
                    last = stats;
                    thread::yield_now();
                }
            });
            thread::sleep(SPAN);
            stop.store(true, Ordering::Relaxed);
        });

        let accepted = accepted.into_inner();
        link.close();
        let stats = link.stats();
        assert_eq!(stats.written, written_before + accepted);
        assert!(stats.write_errors >= cancelled.into_inner());

        let mut board = place.lock().unwrap().take().expect("the board comes back");
        let counters = *board.engine().counters();
        assert_eq!(counters.frames, stats.written, "every write that succeeded has arrived");
        let inside = u64::from(160 - board.engine().fifo_free());
        assert_eq!(counters.executed + counters.full + inside, accepted, "{counters:?}");
        board.advance(board.now() + 1_000_000_000, &mut |_, _| {});
        assert_eq!(board.engine().counters().executed, counters.executed + inside);

        let seen = seen.into_inner().unwrap();
        assert_eq!(seen.iter().collect::<HashSet<_>>().len(), seen.len(), "no report went to two readers");
        assert_eq!(stats.read, read_before + seen.len() as u64);
        let made = counters.reports - reports_before;
        let left = made.checked_sub(stats.read + stats.reports_dropped);
        assert!(left.is_some_and(|left| left <= 32), "{made} made, {stats:?}");
    }
}

//! `rate=`: a board whose time passes more slowly than the machine's.

use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use ecmsk::engine::Counters;
use ecmsk::link::{self, Dir, Link, LinkError, Share, Wait};
use ecmsk::sk::Frame;

const MS: u64 = 1_000_000;

fn open(options: &str) -> Arc<dyn Link> {
    let uri = format!("sim:?slaves=drive&{options}");
    link::open(&uri, Share::ByName).unwrap_or_else(|error| panic!("{uri}: {error}"))
}

fn board(link: &dyn Link) -> Counters {
    link.stats().board.expect("a simulated board shows its counters")
}

/// The board's time of the next report, from the opening of the link.
fn read(link: &dyn Link) -> u64 {
    let meta = link.read(&mut Frame::new(), Wait::Forever).expect("a report");
    meta.at.0 - link.info().opened_at.0
}

/// On any machine: in a span of real time no more board time has passed than the rate allows.
#[test]
fn board_time_passes_at_the_rate() {
    for (rate, share) in [("0.1", 10), ("0.5", 2)] {
        let begin = Instant::now();
        let link = open(&format!("rate={rate}&queue=1024"));
        let first = read(&*link);
        let mut last = first;
        for _ in 0..20 {
            let at = read(&*link);
            assert_eq!((at - last) % MS, 0, "stamps are board time, on its cycles");
            last = at;
        }
        assert!(last - first >= 20 * MS);
        let real = begin.elapsed().as_nanos() as u64;
        assert!(real >= last * share, "rate={rate}: {last} ns of the board in {real} ns");
    }
}

/// The time stamp of a write is board time too, and a write takes `host_us` of it.
#[test]
fn writes_take_board_time() {
    let link = open("rate=0.1&host_us=1000&queue=1024");
    let begin = Instant::now();
    let stamps: Vec<u64> = (0..5).map(|_| link.write(&Frame::new(), Wait::Forever).expect("written").0).collect();
    let real = begin.elapsed().as_nanos() as u64;
    assert!(stamps.windows(2).all(|pair| pair[1] - pair[0] >= MS), "{stamps:?}");
    assert!(real >= 4 * 10 * MS, "{real}");
    let last = stamps[4];
    while link.info().opened_at.0 + read(&*link) < last + 2 * MS {}
    assert_eq!(board(&*link).frames, 5);
    // Two consecutive writes do not fail, however slow the board is.
    for _ in 0..3 {
        let link = open("rate=0.1");
        link.write(&Frame::new(), Wait::Now).expect("written");
        link.write(&Frame::new(), Wait::Now).expect("written");
    }
}

/// However slow the board is: limits of calls are in the machine's time, and close and cancel end a wait at once.
#[test]
fn a_very_slow_board_keeps_nobody_waiting() {
    let link = open("rate=0.001");
    // Its first cycle takes a second.
    let error = link.read(&mut Frame::new(), Wait::For(Duration::from_millis(1))).expect_err("none yet");
    assert!(matches!(error, LinkError::Timeout { .. }), "{error}");
    for end in [|link: &dyn Link| link.cancel(Dir::Read), |link: &dyn Link| link.close()] {
        let reader = thread::spawn({
            let link = Arc::clone(&link);
            move || {
                let mut errors = Vec::new();
                while !errors.iter().any(|error| matches!(error, LinkError::Closed | LinkError::Cancelled { .. })) {
                    errors.extend(link.read(&mut Frame::new(), Wait::Forever).err());
                }
            }
        });
        while !reader.is_finished() {
            end(&*link);
            thread::yield_now();
        }
        reader.join().expect("no panic");
    }
}

/// A board that was closed catches up with its own time, not with the machine's.
#[test]
fn a_parked_board_ages_at_its_rate() {
    let begin = Instant::now();
    let first = open("rate=0.1&name=slow-parked");
    let zero = first.info().opened_at.0;
    first.close();
    thread::sleep(Duration::from_millis(50));
    let second = open("rate=0.1&name=slow-parked");
    let board_time = second.info().opened_at.0 - zero;
    let real = begin.elapsed().as_nanos() as u64;
    assert!(board_time >= 5 * MS && board_time <= real / 10 + MS, "{board_time} ns of the board in {real} ns");
}

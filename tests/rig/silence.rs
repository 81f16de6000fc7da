//! Boards that answer NAK for a long time: neither the kernel nor libusb nor the link sets a limit.

use std::thread;
use std::time::{Duration, Instant};

use ecmsk::link::{Dir, LinkError, Wait};
use ecmsk::sk::Frame;

use super::links::open;
use super::rogue::{Answer, Manners, Rogue};

const A_MINUTE: Duration = Duration::from_secs(60);

/// A minute of NAK in both directions, in the guest's time. Calls without a limit go on waiting and get the first
/// report after it. Calls with a limit end by it and have transferred nothing. The board is not lost.
#[test]
fn a_board_may_answer_nak_for_a_minute() {
    let rogue = Rogue::plug_in_and_wait(Manners { takes: |_| Answer::Hold, ..Manners::default() });
    let board = open("usb:");
    let reader = thread::spawn({
        let board = board.clone();
        move || {
            let mut report = Frame::new();
            board.read(&mut report, Wait::Forever).map(|meta| (meta.sequence, report))
        }
    });
    let writer = thread::spawn({
        let board = board.clone();
        move || board.write(&Frame::new(), Wait::Forever)
    });
    thread::sleep(A_MINUTE);
    assert!(!reader.is_finished() && !writer.is_finished(), "they wait");
    board.check().expect("it is there");
    rogue.send(&[0x77; 512]);
    let (sequence, report) = reader.join().expect("it ends").expect("a report");
    assert_eq!((sequence, report), (0, Frame::from_bytes([0x77; 512])));
    rogue.take();
    writer.join().expect("it ends").expect("it is taken");

    for dir in [Dir::Read, Dir::Write] {
        let began = Instant::now();
        let error = match dir {
            Dir::Read => board.read(&mut Frame::new(), Wait::For(A_MINUTE)).unwrap_err(),
            Dir::Write => board.write(&Frame::new(), Wait::For(A_MINUTE)).unwrap_err(),
        };
        assert!(began.elapsed() >= A_MINUTE, "{dir} after {:?}", began.elapsed());
        assert!(matches!(error, LinkError::Timeout { waited: A_MINUTE, .. }), "{error}");
    }
    rogue.send(&[0x78; 512]);
    let meta = board.read(&mut Frame::new(), Wait::Forever).expect("the next report");
    let stats = board.stats();
    assert_eq!((meta.sequence, stats.written, stats.reports_dropped, stats.transfers_failed), (1, 1, 0, 0));
    board.close();
    rogue.pull();
}

//! Boards that were opened and closed leave nothing behind, neither in this process nor in libusb.

use std::fs;
use std::thread;

use ecmsk::link::{LinkError, Wait};
use ecmsk::sk::Frame;

use super::links::open;
use super::rogue::{Answer, Manners, Rogue};
use support::served::{PATIENCE, until};

/// Bytes per round; less than a transfer or a report.
const NOISE: usize = 100;
const ROUNDS: usize = 10;

/// Allocated bytes of all threads: the guest's environment puts all threads on one heap (GLIBC_TUNABLES).
fn allocated() -> usize {
    // SAFETY: it only reads the allocator's own figures, under its lock.
    let heap = unsafe { libc::mallinfo2() };
    heap.uordblks + heap.hblkhd
}

fn open_now() -> (usize, usize) {
    let count = |folder: &str| fs::read_dir(folder).expect("the guest has it").count();
    (count("/proc/self/fd"), count("/proc/self/task"))
}

/// A board that is used, closed and opened again, and unplugged while it is read, written and idle.
fn round() {
    for under_way in ["read", "write", "nothing"] {
        let sends = (0..20).map(|_| Answer::Data(vec![0x5A; 512])).collect();
        let rogue = Rogue::plug_in_and_wait(Manners { sends, takes: takes_zeros, ..Manners::default() });
        let board = open("usb:");
        board.write(&Frame::new(), Wait::For(PATIENCE)).expect("it takes it");
        board.read(&mut Frame::new(), Wait::For(PATIENCE)).expect("a report");
        board.close();
        drop(board);
        let board = open("usb:");
        let user = thread::spawn({
            let board = board.clone();
            move || match under_way {
                "read" => until("it is lost", || board.read(&mut Frame::new(), Wait::Forever).err()),
                "write" => board.write(&Frame::from_bytes([0x66; 512]), Wait::Forever).unwrap_err(),
                _ => until("it is lost", || board.check().err()),
            }
        });
        rogue.pull();
        let error = user.join().expect("it ends");
        assert!(matches!(error, LinkError::Lost { .. }), "{under_way}: {error}");
    }
}

fn takes_zeros(frame: &[u8]) -> Answer {
    if frame[0] == 0 { Answer::Data(Vec::new()) } else { Answer::Hold }
}

/// WIRE-92 After every round of opening, using, closing and losing boards there are as many threads and open files as
/// before, and the heap, libusb's part included, has not grown by as much as a transfer.
#[test]
fn nothing_is_left_of_boards_that_came_and_went() {
    let before = allocated();
    let leaked = thread::spawn(|| vec![0_u8; 4096]).join().expect("it ends");
    assert!(allocated() >= before + 4096, "what other threads allocate is seen");
    drop(leaked);

    // After this all one-time allocations are made.
    (0..2).for_each(|_| round());
    let (open_before, before) = (open_now(), allocated());
    (0..ROUNDS).for_each(|_| round());
    assert_eq!(open_now(), open_before, "files and threads");
    let after = allocated();
    assert!(after < before + ROUNDS * NOISE, "{before} bytes before, {after} after {ROUNDS} rounds");
}

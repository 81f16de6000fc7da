//! The link `usb:`, with the kernel's USB code between it and a virtual board.

use std::fs;
use std::process::Command;
use std::thread;
use std::time::Duration;

use ecmsk::ecm::{Close, Ecm};
use ecmsk::link::{self, Dir, LinkError, Share, Wait};
use ecmsk::sk::{Frame, MasterCommand, MasterState, StateByte};

use super::links::{frame, open, reads_end, refused, state};
use support::served::{Board, PATIENCE, Served, attach, detach_all, recorded, until};

/// SK-9.8 Reports come unasked; the network is brought to OP, by the native API too.
#[test]
fn a_board_on_usb_is_a_link() {
    let _served = Served::start(&["sim:?slaves=io"], &[]);
    attach("1-1");
    let board = open("usb:?slot=12");
    let mut report = Frame::new();
    let first = board.read(&mut report, Wait::For(PATIENCE)).expect("a report");
    assert_eq!((first.sequence, state(&report)), (0, StateByte::reached(MasterState::PreOp)));
    board.write(&frame(MasterCommand::SetState(MasterState::Op)), Wait::For(PATIENCE)).expect("it takes it");
    until("it is in OP", || {
        board.read(&mut report, Wait::For(PATIENCE)).expect("a report");
        (state(&report) == StateByte::reached(MasterState::Op)).then_some(())
    });
    let stats = board.stats();
    assert!(stats.written == 1 && stats.read > 1, "{stats:?}");
    board.close();

    let ecm = Ecm::open("usb:?slot=12").expect("it opens again");
    assert_eq!(ecm.state().expect("a report"), StateByte::reached(MasterState::Op));
    ecm.set_state(MasterState::PreOp).expect("it goes back");
    ecm.close(Close::Leave).expect("it closes");
    detach_all();
}

/// LIB-57 Threads of a program that are cancelled in calls over a real kernel's USB do no harm.
#[test]
fn a_thread_may_be_cancelled() {
    let _served = Served::start(&["sim:?slaves=drive*2"], &[]);
    attach("1-1");
    let mut program = Command::new("/rig/cancelled");
    program.env("LD_LIBRARY_PATH", "/rig/ours").env("ECMSK_LINK", "usb:");
    let output = program.output().expect("it starts");
    assert!(output.status.success() && output.stdout == b"ok\n", "{output:?}");
    detach_all();
}

/// Frames arrive once, complete and in order, independently of reads meanwhile; always 512 bytes.
#[test]
fn no_frame_is_lost_or_doubled() {
    let served = Served::start(&["sim:?slaves=io&record=%2Ftmp%2Fusb.pcapng"], &[]);
    attach("1-1");
    let board = open("usb:");
    let reader = thread::spawn({
        let board = board.clone();
        move || {
            let mut report = Frame::new();
            let mut last = None;
            while let Ok(meta) = board.read(&mut report, Wait::Forever) {
                assert!(last.is_none_or(|last| meta.sequence > last), "in order");
                last = Some(meta.sequence);
            }
            last
        }
    });
    let mut sent = Vec::new();
    for number in 0..1000_u32 {
        let mut frame = Frame::new();
        frame.bytes_mut()[16..20].copy_from_slice(&number.to_le_bytes());
        frame.bytes_mut()[504..512].copy_from_slice(&[number as u8; 8]);
        board.write(&frame, Wait::For(PATIENCE)).expect("it takes it");
        sent.push(frame);
    }
    board.close();
    assert!(reader.join().expect("it ends").is_some(), "reports came");
    served.stop();
    let arrived = recorded("/tmp/usb.pcapng", Dir::Write);
    assert!(arrived == sent, "{} of {}", arrived.len(), sent.len());
}

/// Without a reader the newest reports are kept, the others counted; a program that reads gets the oldest first.
#[test]
fn of_reports_nobody_reads_the_newest_are_kept() {
    let _served = Served::start(&["sim:?slaves=io"], &[]);
    attach("1-1");
    let board = open("usb:?queue=4&transfers=2");
    let mut report = Frame::new();
    until("more came than are kept", || (board.stats().reports_dropped > 10).then_some(()));
    let metas: Vec<_> = (0..4).map(|_| board.read(&mut report, Wait::For(PATIENCE)).expect("a report")).collect();
    assert!(metas[0].sequence > 10, "{metas:?}");
    assert!(metas.windows(2).all(|pair| pair[0].sequence < pair[1].sequence && pair[0].at <= pair[1].at), "{metas:?}");
    assert!(metas[3].sequence - 3 <= metas[3].dropped, "all that is missing is counted: {metas:?}");
    board.close();
    detach_all();
}

/// While it is open, only the link uses the board; the kernel's driver has it before and after. No file stays open, no
/// thread goes on.
#[test]
fn the_kernels_driver_gets_the_board_back() {
    let _served = Served::start(&["sim:?slaves=io"], &[]);
    attach("1-1");
    let count = |folder: &str| fs::read_dir(folder).expect("the guest has it").count();
    let open_now = || (count("/proc/self/fd"), count("/proc/self/task"));
    drop(open("usb:"));
    until("the driver has it", || (!Board::all().is_empty()).then_some(()));
    let before = open_now();
    for _ in 0..100 {
        let board = open("usb:");
        assert!(Board::all().is_empty(), "the driver has let go of it");
        board.close();
        drop(board);
        until("the driver has it", || (!Board::all().is_empty()).then_some(()));
    }
    assert_eq!(open_now(), before, "files and threads");
    let board = open("usb:");
    let error = refused("usb:");
    assert!(matches!(error, LinkError::InUse { .. }) && error.to_string().contains("by this process"), "{error}");
    drop(board);
    detach_all();
}

/// SK-9.2, SK-9.17 Without a board the error says what to check. Two boards without a choice is an error that lists
/// both; they are distinguished by serial number and USB port.
#[test]
fn one_of_two_boards_is_chosen() {
    let error = refused("usb:");
    assert!(error.to_string().contains("set CONFIG0 to USB"), "{error}");
    let _served = Served::start(&["sim:?name=a", "sim:?name=b"], &["--serial", "A", "--serial", "B"]);
    attach("1-1");
    attach("1-2");
    let error = refused("usb:").to_string();
    assert!(error.contains("serial A") && error.contains("serial B") && error.contains("usb:?path="), "{error}");
    let (a, b) = (open("usb:?serial=A"), open("usb:?serial=B"));
    for board in [&a, &b] {
        board.read(&mut Frame::new(), Wait::For(PATIENCE)).expect("a report");
    }
    b.close();
    let path = error.split("usb:?path=").nth(1).expect("an example").to_owned();
    let path = path.split(|c: char| !(c.is_ascii_digit() || c == '-' || c == '.')).next().expect("a path").to_owned();
    a.close();
    let board = open(&format!("usb:?path={path}"));
    board.read(&mut Frame::new(), Wait::For(PATIENCE)).expect("a report");
    assert!(refused("usb:?serial=C").to_string().contains("none with serial number C"));
    drop(board);
    detach_all();
}

/// SK-9.13
#[test]
fn every_wait_ends_when_the_board_goes() {
    let served = Served::start(&["sim:?slaves=io&fault.drop.read=1"], &[]);
    attach("1-1");
    let board = open("usb:");
    let reader = thread::spawn({
        let board = board.clone();
        move || board.read(&mut Frame::new(), Wait::Forever)
    });
    board.write(&Frame::new(), Wait::For(PATIENCE)).expect("it takes it");
    served.kill();
    let error = reader.join().expect("it ends").unwrap_err();
    assert!(matches!(error, LinkError::Lost { .. }), "{error}");
    let error = board.write(&Frame::new(), Wait::Forever).unwrap_err();
    assert!(matches!(error, LinkError::Lost { .. }), "{error}");
    assert!(matches!(board.check(), Err(LinkError::Lost { .. })));
    board.close();
    assert!(matches!(board.read(&mut Frame::new(), Wait::Forever), Err(LinkError::Closed)));
}

/// SK-9.13 A read waits until a report comes or the link is closed; with a limit, at most for that time.
#[test]
fn a_read_ends_by_its_limit_by_cancel_and_by_close() {
    let _served = Served::start(&["sim:?slaves=io&fault.drop.read=1"], &[]);
    attach("1-1");
    let board = open("usb:");
    reads_end(&board);
    detach_all();
}

/// A board that is busy holds the frame; a write that reaches its limit has transferred no byte, and the board never
/// gets it.
#[test]
fn a_frame_that_the_board_does_not_take_is_taken_back() {
    let file = "/tmp/busy.pcapng";
    let link = "sim:?slaves=io&fault.delay.write=1&fault.delay_ms=3600000&record=%2Ftmp%2Fbusy.pcapng";
    let served = Served::start(&[link], &[]);
    attach("1-1");
    let board = open("usb:");
    for _ in 0..3 {
        let error = board.write(&Frame::new(), Wait::For(Duration::from_millis(100))).unwrap_err();
        assert!(matches!(error, LinkError::Timeout { dir: Dir::Write, .. }), "{error}");
        // Reports go on.
        board.read(&mut Frame::new(), Wait::For(PATIENCE)).expect("a report");
    }
    board.close();
    served.stop();
    assert_eq!(recorded(file, Dir::Write).len(), 0);
}

/// A write that may not wait allows only the transfer's own time: the frame is taken completely, or not at all.
#[test]
fn a_write_that_may_not_wait_is_taken_or_not() {
    let served = Served::start(&["sim:?slaves=io&record=%2Ftmp%2Fnow.pcapng"], &[]);
    attach("1-1");
    let board = open("usb:");
    let mut sent = Vec::new();
    let mut number = 0_u32;
    until("enough are taken", || {
        number += 1;
        let mut frame = Frame::new();
        frame.bytes_mut()[16..20].copy_from_slice(&number.to_le_bytes());
        match board.write(&frame, Wait::Now) {
            Ok(_) => sent.push(frame),
            Err(error) => assert!(matches!(error, LinkError::Timeout { dir: Dir::Write, .. }), "{error}"),
        }
        (sent.len() >= 50).then_some(())
    });
    board.close();
    served.stop();
    let arrived = recorded("/tmp/now.pcapng", Dir::Write);
    assert!(arrived == sent, "{} of {}", arrived.len(), sent.len());
}

/// SW_RESET detaches the board; it can be opened again at its new address.
#[test]
fn a_board_that_was_reset_is_opened_again() {
    let served = Served::start(&["sim:?slaves=io"], &["--attach"]);
    until("the kernel shows it", || Board::all().pop());
    let board = open("usb:");
    board.write(&frame(MasterCommand::SoftReset), Wait::For(PATIENCE)).expect("it takes it");
    let mut report = Frame::new();
    let error = until("it is lost", || board.read(&mut report, Wait::For(PATIENCE)).err());
    assert!(matches!(error, LinkError::Lost { .. }), "{error}");
    let again = until("it is back", || link::open("usb:", Share::ByName).ok());
    again.read(&mut report, Wait::For(PATIENCE)).expect("a report");
    again.close();
    drop(board);
    served.stop();
}

/// A program that has used a board and closed it may fork, as a daemon does: the child opens the board, and its calls
/// end.
#[test]
fn a_child_that_was_forked_after_close_opens_the_board() {
    /// The system kills a child whose calls do not end.
    const CHILD_LIMIT_S: u32 = 60;

    fn used() -> Result<(), LinkError> {
        let limit = Wait::For(Duration::from_secs(5));
        let board = link::open("usb:", Share::ByName)?;
        board.write(&Frame::new(), limit)?;
        board.read(&mut Frame::new(), limit)?;
        board.close();
        Ok(())
    }

    let _served = Served::start(&["sim:?slaves=io"], &[]);
    attach("1-1");
    used().expect("the parent has it");
    // SAFETY: the parent's other threads are in no call that holds a lock the child needs; the child ends here.
    let child = unsafe {
        let child = libc::fork();
        if child == 0 {
            libc::alarm(CHILD_LIMIT_S);
            libc::_exit(i32::from(used().is_err()));
        }
        child
    };
    let mut status = 0;
    // SAFETY: `status` receives the answer.
    assert_eq!(unsafe { libc::waitpid(child, &raw mut status, 0) }, child);
    assert!(libc::WIFEXITED(status), "its calls do not end: signal {}", libc::WTERMSIG(status));
    assert_eq!(libc::WEXITSTATUS(status), 0, "it has the board");
    used().expect("the parent has it again");
    detach_all();
}

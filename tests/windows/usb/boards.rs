//! The functions call by call on a board on USB: the table of the vendor's library, LIB-35 to LIB-55, as far as Wine
//! can show it.

use ecmsk::link::Dir;
use serde_json::{Value, json};

use crate::program::{Program, Width, listed, passes};
use support::served::{Board, Served, recorded, until};

/// A board that sends a report each millisecond; one that sends none.
pub const BOARD: &str = "sim:?slaves=io";
const SILENT: &str = "sim:?slaves=io&fault.drop.read=1";

/// A board that is plugged in and visible to the kernel. Wine shows it long before a program has started.
#[track_caller]
pub fn plugged(link: &str) -> Served {
    let served = Served::start(&[link], &["--attach"]);
    in_kernel(1);
    served
}

/// Unplugs it, and waits until programs see none.
#[track_caller]
pub fn unplug(served: Served) {
    served.kill();
    shows(0);
}

/// Waits until the kernel and then Wine show this number of boards: Wine learns of a change later than the kernel, on a busy
/// machine much later. Until then a program may open a board that is gone, or find one of two.
#[track_caller]
fn shows(boards: usize) {
    in_kernel(boards);
    until(&format!("Wine shows {boards}"), || (listed() == boards).then_some(()));
}

/// Waits until the kernel shows this number of boards.
#[track_caller]
fn in_kernel(boards: usize) {
    until(&format!("the kernel shows {boards}"), || (Board::all().len() == boards).then_some(()));
}

crate::for_each_width! {
    /// LIB-20, LIB-39, LIB-40, WIN-41, WIN-46 A read before any write; frames arrive once, complete and in order, 512
    /// bytes each, and successful calls other than Open leave Windows' last error unchanged.
    #[test]
    fn frames_go_to_the_board_and_reports_come(width: Width) {
        let file = "/tmp/moved.pcapng";
        let served = plugged(&format!("{BOARD}&record=%2Ftmp%2Fmoved.pcapng"));
        passes(width, "board", "usb:?slot=12", &["moves", "200"]);
        served.stop();
        let arrived = recorded(file, Dir::Write);
        assert_eq!(arrived.len(), 200);
        for (frame, number) in arrived.iter().zip(1_u32..) {
            assert_eq!(frame.bytes()[16..20], number.to_le_bytes());
            assert_eq!(frame.bytes()[504..], [number as u8; 8]);
        }
        shows(0);
    }

    /// LIB-42, WIN-40 Without a board Open returns false and the text says what to do.
    #[test]
    fn without_a_board_open_is_false(width: Width) {
        passes(width, "board", "usb:", &["none", "set CONFIG0 to USB"]);
    }

    /// LIB-35, LIB-49, LIB-54, LIB-64, WIN-43, WIN-46 A board that is unplugged ends a waiting read; the handle stays
    /// unusable after the board's return, until Open, which needs no Close.
    #[test]
    fn a_board_that_goes_and_comes_back(width: Width) {
        let served = plugged(SILENT);
        let mut program = Program::start(width, "board", "usb:", &["lost"]);
        program.says("open");
        unplug(served);
        program.says("lost");
        let served = plugged(BOARD);
        program.tell("back");
        program.passes();
        unplug(served);
    }

    /// LIB-65, LIB-64, LIB-49 Once the board's loss is noticed, reports that were kept are not read any more.
    #[test]
    fn reports_go_with_the_board(width: Width) {
        let served = plugged(BOARD);
        let mut program = Program::start(width, "board", "usb:", &["lost_with_reports"]);
        program.says("open");
        unplug(served);
        program.tell("back");
        program.passes();
    }

    /// LIB-35, LIB-47, LIB-48, LIB-54, LIB-64, WIN-44, WIN-46 Close ends a waiting read.
    #[test]
    fn close_ends_a_read(width: Width) {
        let served = plugged(SILENT);
        passes(width, "board", "usb:", &["close"]);
        unplug(served);
    }

    /// LIB-70 A thread is ended by TerminateThread in a read: all other calls go on, with a board that makes reports and with
    /// one that makes none. Of many threads that read at once, most wait for the lock of the reports when they are ended.
    #[test]
    fn a_thread_that_is_terminated(width: Width) {
        for (board, says) in [(BOARD, "reports"), (SILENT, "silent"), (BOARD, "crowd")] {
            let served = plugged(board);
            passes(width, "terminated", "usb:", &[says]);
            unplug(served);
        }
    }

    /// LIB-36, LIB-54 A read with a limit returns false after it; the link goes on.
    #[test]
    fn a_read_with_a_limit_ends(width: Width) {
        let served = plugged(SILENT);
        passes(width, "board", "usb:?read_timeout_ms=50", &["limits"]);
        unplug(served);
    }

    /// LIB-55, WIN-42 The newest 32 reports are kept while no call reads, older ones are counted.
    #[test]
    fn unread_reports(width: Width) {
        let served = plugged(BOARD);
        passes(width, "board", "usb:", &["unread"]);
        unplug(served);
    }

    /// WIN-67 A program that only writes for a while then reads the newest reports, and goes on as before.
    #[test]
    fn reports_pause_while_a_program_only_writes(width: Width) {
        let served = plugged(BOARD);
        passes(width, "board", "usb:", &["rests"]);
        unplug(served);
    }

    /// LIB-45, WIN-45 A second process opens the board too; both get its reports, and closing it in one leaves it open
    /// in the other.
    #[test]
    fn two_processes_share_a_board(width: Width) {
        let served = plugged(BOARD);
        let mut first = Program::start(width, "board", "usb:", &["shares", "end"]);
        first.says("open");
        passes(width, "board", "usb:", &["moves", "5"]);
        first.tell("end");
        first.passes();
        unplug(served);
    }

    /// WIN-40 Of two boards one has to be chosen, by its serial number or by its USB port, which the error names.
    #[test]
    fn one_of_two_boards_is_chosen(width: Width) {
        let served = Served::start(&["sim:?name=a", "sim:?name=b"], &["--attach", "--serial", "A", "--serial", "B"]);
        shows(2);
        passes(width, "board", "usb:", &["none", "there are 2", "serial A", "serial B", "usb:?path="]);
        passes(width, "board", "usb:?serial=C", &["none", "none with serial number C"]);
        passes(width, "board", "usb:?serial=B", &["moves", "5"]);
        unplug(served);
    }

    /// SK-4.34, LIB-43, LIB-49, WIN-46 SW_RESET detaches the board: unusable until Open.
    #[test]
    fn a_reset_board(width: Width) {
        let served = plugged("sim:?slaves=drive*2");
        passes(width, "reset", "usb:", &[]);
        unplug(served);
    }

    /// LIB-38, LIB-64 A board that does not accept a frame: the write returns false, and reads go on.
    #[test]
    fn a_board_that_is_busy(width: Width) {
        let served = plugged(&format!("{BOARD}&fault.delay.write=1&fault.delay_ms=3600000"));
        passes(width, "board", "usb:?write_timeout_ms=1000", &["busy"]);
        unplug(served);
    }

    /// WIN-64 `list` prints the link of a board that is plugged in, by which the tool opens it, and `doctor` reports
    /// that it can be opened.
    #[test]
    fn the_tool_finds_a_board(width: Width) {
        let served = Served::start(&["sim:?slaves=drive*2"], &["--attach", "--serial", "A-7"]);
        in_kernel(1);
        let tool = |link: &str, arguments: &[&str]| -> Vec<Value> {
            let lines = Program::start(width, "ecmsk", link, arguments).all();
            lines.iter().map(|line| serde_json::from_str(line).expect("a JSON object a line")).collect()
        };
        let listed = tool("", &["list", "--json"]);
        assert_eq!(listed.len(), 1, "{listed:?}");
        assert_eq!((&listed[0]["serial"], &listed[0]["can_open"]), (&json!("A-7"), &json!(true)));
        let link = listed[0]["link"].as_str().expect("a link");
        let info = tool(link, &["info", "--json"]);
        assert_eq!((&info[0]["state"], &info[0]["slot_bytes"]), (&json!("PreOP"), &json!(12)), "{info:?}");
        let findings = tool("usb:", &["doctor", "--quick", "--json"]);
        let board = findings.iter().find(|finding| finding["check"] == "usb-board").expect("a finding of it");
        assert!(board["state"] == "ok" && board["found"].as_str().is_some_and(|found| found.contains("serial A-7")));
        unplug(served);
    }
}

//! The link `usb:` on boards and buses that misbehave: the effects and the messages.

use std::collections::VecDeque;
use std::fs;
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::sync::{Arc, Mutex, Once};
use std::thread;
use std::time::Duration;

use ecmsk::ecm::{Ecm, Options};
use ecmsk::link::{self, Link, LinkError, Share, Wait};
use ecmsk::port::usbip::Identity;
use ecmsk::port::usbip::descriptors::Descriptors;
use ecmsk::port::usbip::setup::descriptor::CONFIGURATION;
use ecmsk::sk::{Frame, SlotSize};

use super::links::refused;
use super::rogue::{Answer, Manners, Rogue, plugged_in};
use support::served::{Board, PATIENCE, Served, TOOL, attach, detach_all, until};

fn open(uri: &str) -> Result<Arc<dyn Link>, LinkError> {
    link::open(uri, Share::ByName)
}

fn reports(sizes: &[usize]) -> VecDeque<Answer> {
    sizes.iter().map(|size| Answer::Data(vec![0x5A; *size])).collect()
}

/// Warnings of the library, from the first call on.
fn warnings() -> Vec<String> {
    static HEARD: Mutex<Vec<String>> = Mutex::new(Vec::new());
    static BEGIN: Once = Once::new();
    struct Ear;
    impl log::Log for Ear {
        fn enabled(&self, metadata: &log::Metadata<'_>) -> bool {
            metadata.level() <= log::Level::Warn
        }
        fn log(&self, record: &log::Record<'_>) {
            HEARD.lock().expect("no panic there").push(record.args().to_string());
        }
        fn flush(&self) {}
    }
    BEGIN.call_once(|| {
        log::set_logger(&Ear).expect("there is no other one");
        log::set_max_level(log::LevelFilter::Warn);
    });
    HEARD.lock().expect("no panic there").clone()
}

/// A device that ends reports by empty transfers, or sends short ones: they are skipped and counted.
#[test]
fn empty_and_short_reports_are_skipped_and_counted() {
    let sends = reports(&[512, 0, 512, 64, 0, 512]);
    let rogue = Rogue::plug_in_and_wait(Manners { sends, ..Manners::default() });
    let board = until("it opens", || open("usb:").ok());
    for number in 0..3 {
        let meta = board.read(&mut Frame::new(), Wait::For(PATIENCE)).expect("a report");
        assert_eq!((meta.sequence, meta.dropped), (number, 0));
    }
    assert_eq!((board.stats().reports_short, board.stats().read), (3, 3));
    board.close();
    rogue.pull();
}

/// From open to the last report there is no request on endpoint 0, and no halt is cleared.
#[test]
fn nothing_but_reports_moves() {
    let rogue = Rogue::plug_in_and_wait(Manners { sends: reports(&[512; 20]), ..Manners::default() });
    until("the kernel's driver has it", || Board::all().pop());
    let asked = || rogue.requests.lock().expect("no panic there").len();
    let before = asked();
    assert!(before > 0, "the kernel has set it up");
    let board = open("usb:?serial=ROGUE").expect("it opens");
    for _ in 0..10 {
        board.write(&Frame::new(), Wait::For(PATIENCE)).expect("it takes it");
        board.read(&mut Frame::new(), Wait::For(PATIENCE)).expect("a report");
    }
    assert_eq!(asked(), before);
    board.close();
    rogue.pull();
}

/// STALL on endpoint IN: reads and writes end with an error that names the next step; the board can be opened again.
#[test]
fn a_board_that_refuses_to_send_is_lost() {
    let mut sends = reports(&[512]);
    sends.push_back(Answer::Stall);
    sends.extend((0..8).map(|_| Answer::Hold));
    sends.extend(reports(&[512]));
    let rogue = Rogue::plug_in_and_wait(Manners { sends, ..Manners::default() });
    let board = until("it opens", || open("usb:?transfers=1").ok());
    // LIB-65: an unread report is dropped with the board.
    let error = (0..2).find_map(|_| board.read(&mut Frame::new(), Wait::Forever).err()).expect("it is lost");
    assert!(matches!(&error, LinkError::Lost { reason, .. } if reason.contains("stalls")), "{error}");
    assert!(matches!(board.write(&Frame::new(), Wait::Forever), Err(LinkError::Lost { .. })));
    board.close();
    until("the halt is cleared", || rogue.halts_cleared().contains(&0x81).then_some(()));
    let again = until("it opens again", || open("usb:?transfers=16").ok());
    again.read(&mut Frame::new(), Wait::For(PATIENCE)).expect("a report");
    again.close();
    rogue.pull();
}

/// STALL on endpoint OUT: that write fails, the next one may succeed.
#[test]
fn a_frame_that_the_board_refuses_is_an_error_of_that_write() {
    let takes = |frame: &[u8]| if frame[0] == 0x66 { Answer::Stall } else { Answer::Data(Vec::new()) };
    let rogue = Rogue::plug_in_and_wait(Manners { takes, sends: reports(&[512]), ..Manners::default() });
    let board = until("it opens", || open("usb:").ok());
    let error = board.write(&Frame::from_bytes([0x66; 512]), Wait::Forever).unwrap_err();
    assert!(matches!(error, LinkError::Io { .. }) && error.to_string().contains("send it again"), "{error}");
    board.write(&Frame::new(), Wait::For(PATIENCE)).expect("the next one passes");
    board.read(&mut Frame::new(), Wait::For(PATIENCE)).expect("a report");
    assert!(rogue.halts_cleared().contains(&0x02));
    board.close();
    rogue.pull();
}

/// Devices with wrong descriptors are no boards, and do no harm.
#[test]
fn descriptors_that_lie_are_refused() {
    let good = Descriptors::new(&Identity::default()).expect("it has").get(CONFIGURATION, 0).expect("one").to_vec();
    let with = |changes: &[(usize, u8)]| {
        let mut bytes = good.clone();
        changes.iter().for_each(|(at, byte)| bytes[*at] = *byte);
        bytes
    };
    // Configuration 9, interface 9, HID 9, endpoint 7, endpoint 7 bytes.
    let lies = [
        with(&[(2, 0xFF), (3, 0xFF)]),
        good[..20].to_vec(),
        with(&[(14, 8)]),
        with(&[(13, 200)]),
        with(&[(27, 0)]),
        with(&[(31, 64), (32, 0)]),
        with(&[(36, 0x81)]),
        with(&[(30, 2), (37, 2)]),
        with(&[(4, 250), (11, 99)]),
    ];
    for configuration in lies {
        let shown = format!("{configuration:02x?}");
        let rogue = Rogue::plug_in(Manners { configuration: Some(configuration), ..Manners::default() });
        // The kernel may give it up before it becomes visible, so that there is nothing to wait for.
        for _ in 0..10 {
            if !plugged_in().is_empty() {
                break;
            }
            thread::sleep(Duration::from_millis(100));
        }
        if let Err(error) = open("usb:?read_timeout_ms=50") {
            assert!(matches!(error, LinkError::NoBoard { .. }), "{shown}: {error}");
        }
        rogue.pull();
    }
    let rogue = Rogue::plug_in_and_wait(Manners { sends: reports(&[512]), ..Manners::default() });
    let board = until("a good one opens after them", || open("usb:").ok());
    board.read(&mut Frame::new(), Wait::For(PATIENCE)).expect("a report");
    board.close();
    rogue.pull();
}

/// WIRE-80, SK-9.17 A port that cannot supply the current that a board requires.
#[test]
fn too_little_power_is_named() {
    let mut configuration =
        Descriptors::new(&Identity::default()).expect("it has").get(CONFIGURATION, 0).expect("one").to_vec();
    // 510 mA; a port has 500.
    configuration[8] = 255;
    let rogue = Rogue::plug_in_and_wait(Manners { configuration: Some(configuration), ..Manners::default() });
    let error = refused("usb:").to_string();
    assert!(error.contains("too little power") && error.contains("power supply of its own"), "{error}");
    rogue.pull();
}

/// WIRE-80 The library warns of a bus that is too slow and of a board that may be put to sleep.
#[test]
fn a_slow_bus_and_autosuspend_are_named() {
    warnings();
    let rogue = Rogue::plug_in_and_wait(Manners { speed: 2, sends: reports(&[512]), ..Manners::default() });
    let folder = plugged_in().pop().expect("it is there");
    fs::write(folder.join("power/autosuspend_delay_ms"), "100").expect("sysfs takes it");
    fs::write(folder.join("power/control"), "auto").expect("sysfs takes it");
    let board = until("it opens", || open("usb:").ok());
    let said = warnings().join("\n");
    assert!(said.contains("not run at high speed but at 12 Mbit/s"), "{said}");
    assert!(said.contains("put it to sleep") && said.contains("power/control"), "{said}");
    rogue.pull();
    let error = until("it is lost", || board.read(&mut Frame::new(), Wait::For(PATIENCE)).err());
    assert!(error.to_string().contains("it did not run at high speed"), "{error}");
}

/// The cable is unplugged at several times in the first 100 ms after open has begun: the pending call ends.
#[test]
fn a_cable_pulled_early_ends_what_is_under_way() {
    for after in [0, 1, 2, 3, 5, 7, 10, 15, 20, 30, 45, 70, 100] {
        let rogue = Rogue::plug_in_and_wait(Manners { sends: reports(&[512; 50]), ..Manners::default() });
        let user = thread::spawn(|| -> Result<(), LinkError> {
            let board = open("usb:")?;
            loop {
                board.write(&Frame::new(), Wait::Forever)?;
                board.read(&mut Frame::new(), Wait::Forever)?;
            }
        });
        thread::sleep(Duration::from_millis(after));
        rogue.pull();
        let error = user.join().expect("no panic").unwrap_err();
        assert!(matches!(error, LinkError::Lost { .. } | LinkError::NoBoard { .. }), "after {after} ms: {error}");
    }
}

/// LIB-46 If a second program opens the board, the error names the first one.
#[test]
fn the_program_that_has_the_board_is_named() {
    let _served = Served::start(&["sim:?slaves=io"], &[]);
    attach("1-1");
    let mut other = Command::new(TOOL);
    other.args(["serve", "tcp", "--link", "usb:?slot=12", "--listen", "127.0.0.1:4712"]);
    let mut other = other.stdout(Stdio::piped()).spawn().expect("the tool starts");
    let mut line = String::new();
    BufReader::new(other.stdout.take().expect("a pipe")).read_line(&mut line).expect("it says where it listens");
    let error = refused("usb:");
    let said = error.to_string();
    assert!(matches!(error, LinkError::InUse { .. }), "{said}");
    assert!(said.contains(&format!("by ecmsk (PID {})", other.id())) && said.contains("serve tcp"), "{said}");
    other.kill().expect("it runs");
    other.wait().expect("it ends");
    // A program that is killed leaves the board to the next one.
    let board = until("it is free", || open("usb:").ok());
    board.read(&mut Frame::new(), Wait::For(PATIENCE)).expect("a report");
    board.close();
    detach_all();
}

/// WIRE-81 A link with the wrong slot size: no report is misinterpreted, and no command is sent.
#[test]
fn a_slot_size_that_is_not_the_boards_is_named() {
    for (given, of_board) in [(SlotSize::Bytes12, SlotSize::Bytes16), (SlotSize::Bytes16, SlotSize::Bytes12)] {
        let served = Served::start(&[&format!("sim:?slaves=drive&slot={}", of_board.bytes())], &[]);
        attach("1-1");
        let board = open(&format!("usb:?slot={}", given.bytes())).expect("it opens");
        let error = until("it is noticed", || board.read(&mut Frame::new(), Wait::For(PATIENCE)).err());
        assert!(
            matches!(error, LinkError::WrongSlot { given: g, found: f, .. } if (g, f) == (given, of_board)),
            "{error}"
        );
        assert!(error.to_string().contains(&format!("write slot={} into the link", of_board.bytes())), "{error}");
        let error = board.write(&Frame::new(), Wait::For(PATIENCE)).unwrap_err();
        assert!(matches!(error, LinkError::WrongSlot { .. }), "{error}");
        board.close();
        let board = open(&format!("usb:?slot={}", of_board.bytes())).expect("it opens");
        for _ in 0..10 {
            board.read(&mut Frame::new(), Wait::For(PATIENCE)).expect("a report");
        }
        board.close();
        detach_all();
        served.stop();
    }
}

/// The library waits for a board that was reset, and reports how long that took. The board has another address then.
#[test]
fn the_return_of_a_board_is_waited_for() {
    let served = Served::start(&["sim:?slaves=io"], &["--attach"]);
    let address = |board: Board| board.usb_says("devnum");
    let before = address(until("the kernel shows it", || Board::all().pop()));
    let ecm = Ecm::open("usb:?slot=12").expect("it opens");
    ecm.reset().expect("it goes");
    let (ecm, took) = Ecm::open_when_there("usb:?slot=12", Options::default(), PATIENCE).expect("it comes back");
    assert!(took > Duration::ZERO && took < PATIENCE, "{took:?}");
    let after = fs::read_to_string(plugged_in().pop().expect("it is there").join("devnum")).expect("sysfs has it");
    assert_ne!(before, after.trim());
    assert!(ecm.state().expect("a report").state().is_some());
    drop(ecm);
    served.stop();
}

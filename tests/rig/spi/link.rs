//! The link `spi:`, with the kernel's SPI and GPIO code between it and the model.

use std::fs;
use std::thread;
use std::time::Duration;

use ecmsk::ecm::{Close, Ecm};
use ecmsk::link::{Dir, Link, LinkError, Wait};
use ecmsk::sk::{Frame, MasterCommand, MasterState, SlotSize, StateByte};

use super::model::Model;
use super::played::Busy;
use super::{LINK, RESET_KEY, model};
use crate::links::{frame, open, reads_end, refused, state};
use support::served::{PATIENCE, recorded, until};

const BOARD: &str = "sim:?slaves=io";

/// Reads until the link gives the board up.
#[track_caller]
pub fn until_lost(board: &dyn Link) -> LinkError {
    let error = until("it is lost", || board.read(&mut Frame::new(), Wait::For(PATIENCE)).err());
    assert!(matches!(error, LinkError::Lost { .. }), "{error}");
    error
}

/// SK-10.1, SK-10.2, SK-10.3 Reports come unasked; the network is brought to OP, by the native API too. On the wires
/// each frame is one exchange, mode 0, 8 bits, 24 MHz, and none begins while BUSY is high.
#[test]
fn a_board_on_spi_is_a_link() {
    let model = Model::start(BOARD);
    let board = open(LINK);
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

    let ecm = Ecm::open(LINK).expect("it opens again");
    assert_eq!(ecm.state().expect("a report"), StateByte::reached(MasterState::Op));
    ecm.set_state(MasterState::PreOp).expect("it goes back");
    ecm.close(Close::Leave).expect("it closes");

    let seen = model.stop();
    assert_eq!(seen.while_busy, 0);
    let shapes = seen.exchanges.iter().map(|each| (each.len, each.speed_hz, each.mode, each.bits, each.transfers));
    let mut shapes: Vec<_> = shapes.collect();
    shapes.dedup();
    assert_eq!(shapes, [(504, 24_000_000, 0, 8, 1)]);
}

/// SK-10.1 Speed and mode are those of the link.
#[test]
fn speed_and_mode_are_set() {
    for (keys, speed_hz, mode) in [("speed=6M&mode=1", 6_000_000, 1), ("speed=10M&mode=3", 10_000_000, 3)] {
        let model = Model::start(BOARD);
        open(&format!("{LINK}&{keys}")).close();
        let seen = model.stop();
        assert!(!seen.exchanges.is_empty());
        assert!(seen.exchanges.iter().all(|each| (each.speed_hz, each.mode) == (speed_hz, mode)));
    }
}

/// Frames arrive once, complete and in order, independently of reads meanwhile, with both slot sizes.
#[test]
fn no_frame_is_lost_or_doubled() {
    for size in SlotSize::ALL {
        let slot = size.bytes();
        let model = Model::start(&format!("{BOARD}&slot={slot}&record=%2Ftmp%2Fspi.pcapng"));
        let board = open(&format!("{LINK}&slot={slot}"));
        let reader = thread::spawn({
            let board = board.clone();
            move || {
                let (mut report, mut last) = (Frame::new(), None);
                while let Ok(meta) = board.read(&mut report, Wait::Forever) {
                    assert!(last.is_none_or(|last| meta.sequence > last), "in order");
                    last = Some(meta.sequence);
                }
                last
            }
        });
        let mut sent = Vec::new();
        for number in 1..=1000_u32 {
            // Numbered in the data of a slave's slot without a command.
            let mut frame = Frame::new();
            frame.bytes_mut()[slot + 4..slot + 8].copy_from_slice(&number.to_le_bytes());
            frame.bytes_mut()[size.frame_len() - 4..size.frame_len()].copy_from_slice(&[number as u8; 4]);
            board.write(&frame, Wait::For(PATIENCE)).expect("it takes it");
            sent.push(frame);
        }
        // Written frames are sent before it closes.
        board.close();
        assert!(reader.join().expect("it ends").is_some(), "reports came");
        model.stop();
        let arrived = recorded("/tmp/spi.pcapng", Dir::Write);
        let numbered = |frame: &Frame| frame.bytes()[slot + 4..slot + 8] != [0; 4];
        let arrived: Vec<Frame> = arrived.into_iter().filter(numbered).collect();
        assert!(arrived == sent, "{} of {}", arrived.len(), sent.len());
    }
}

/// SK-10.6 Without BUSY no exchange begins sooner than 800 us after the one before, for any number of waiting frames.
#[test]
fn without_busy_exchanges_keep_their_distance() {
    let model = Model::on(BOARD, Busy::Stuck(false), model::straight);
    let board = open(super::LINK_WITHOUT_BUSY);
    for _ in 0..300 {
        board.write(&Frame::new(), Wait::For(PATIENCE)).expect("it takes it");
    }
    board.close();
    let exchanges = model.stop().exchanges;
    assert!(exchanges.len() >= 300);
    let least = exchanges.windows(2).map(|pair| pair[1].at_ns - pair[0].at_ns).min().expect("two at least");
    assert!(least >= 800_000, "{least} ns");
}

#[test]
fn a_read_ends_by_its_limit_by_cancel_and_by_close() {
    let model = Model::start(BOARD);
    let board = open(&format!("{LINK}&queue=1"));
    // No report comes while BUSY is high; for a second the link takes that for a long exchange.
    model.hang(true);
    let mut report = Frame::new();
    let short = Duration::from_millis(50);
    let error = until("no report comes", || board.read(&mut report, Wait::For(short)).err());
    assert!(matches!(error, LinkError::Timeout { dir: Dir::Read, .. }), "{error}");
    reads_end(&board);
    assert!(matches!(board.write(&Frame::new(), Wait::Forever), Err(LinkError::Closed)));
}

/// A board that loses its power drives no line any more: every wait ends, and every later call.
#[test]
fn every_wait_ends_when_the_board_goes() {
    let model = Model::start(BOARD);
    let board = open(LINK);
    let reader = thread::spawn({
        let board = board.clone();
        move || until_lost(&*board)
    });
    board.write(&Frame::new(), Wait::For(PATIENCE)).expect("it takes it");
    drop(model);
    reader.join().expect("it ends");
    assert!(matches!(board.write(&Frame::new(), Wait::Forever), Err(LinkError::Lost { .. })));
    assert!(matches!(board.check(), Err(LinkError::Lost { .. })));
    board.close();
    assert!(matches!(board.read(&mut Frame::new(), Wait::Forever), Err(LinkError::Closed)));
}

/// Opening it a second time, in this or another process, reports that it is in use; a line in use is named. After
/// closing, neither a file nor a thread is left.
#[test]
fn nobody_else_gets_it_and_nothing_is_left() {
    let model = Model::start(BOARD);
    let files = || fs::read_dir("/proc/self/fd").expect("the guest has it").count();
    let threads = || {
        let tasks = fs::read_dir("/proc/self/task").expect("the guest has it").flatten();
        let names = tasks.filter_map(|task| fs::read_to_string(task.path().join("comm")).ok());
        names.filter(|name| name == "ecmsk-spi\n").count()
    };
    open(LINK).close();
    let before = files();
    for _ in 0..10 {
        let board = open(LINK);
        let error = refused(LINK);
        assert!(matches!(error, LinkError::InUse { .. }), "{error}");
        board.read(&mut Frame::new(), Wait::For(PATIENCE)).expect("a report");
        assert_eq!(threads(), 1);
        board.close();
        // It is joined; the kernel removes it from its list a little later.
        until("its thread is gone", || (threads() == 0).then_some(()));
        drop(board);
        assert_eq!(files(), before, "files that stay open");
    }
    let board = open(LINK);
    let tool = super::tool(&["info", "--link", LINK], None);
    let said = String::from_utf8_lossy(&tool.stderr).into_owned();
    assert!(!tool.status.success() && said.contains("in use"), "{said}");
    drop(board);
    let line = gpiocdev::Request::builder().on_chip(super::CHIP).with_line(super::BUSY).as_input().request();
    let error = refused(LINK).to_string();
    assert!(error.contains("in use") && error.contains("line BUSY of /dev/gpiochip0"), "{error}");
    drop(line);
    until("its threads are gone", || (threads() == 0).then_some(()));
    assert_eq!(files(), before, "files that stay open");
    drop(model);
}

/// If the user may not use the device or the line, the error names it and the next step.
#[test]
fn permission_is_asked_for() {
    let _model = Model::start(BOARD);
    let nobody = Some(65534);
    let said = |arguments: &[&str]| {
        let tool = super::tool(arguments, nobody);
        assert!(!tool.status.success(), "{tool:?}");
        String::from_utf8_lossy(&tool.stderr).into_owned()
    };
    let error = said(&["info", "--link", LINK]);
    assert!(error.contains("/dev/spidev0.0 may not be used by this user; add the user to the groups"), "{error}");
    let allow = |file: &str, mode| {
        use std::os::unix::fs::PermissionsExt;
        fs::set_permissions(file, fs::Permissions::from_mode(mode)).expect("root may");
    };
    allow(super::SPIDEV, 0o666);
    let error = said(&["info", "--link", LINK]);
    assert!(error.contains("/dev/gpiochip0 may not be used by this user; add the user to the groups"), "{error}");
    allow(super::CHIP, 0o666);
    let tool = super::tool(&["info", "--link", LINK], nobody);
    assert!(tool.status.success(), "{tool:?}");
    allow(super::SPIDEV, 0o600);
    allow(super::CHIP, 0o600);
}

/// A missing device or line is named, with those that exist.
#[test]
fn what_is_missing_is_named() {
    let error = refused("spi:/dev/spidev7.0").to_string();
    assert!(error.contains("/dev/spidev7.0 is not there") && error.contains("/dev/spidev0.0"), "{error}");
    let error = refused("spi:/dev/spidev0.0?busy=gpiochip7/0").to_string();
    assert!(error.contains("/dev/gpiochip7 is not there") && error.contains("/dev/gpiochip0"), "{error}");
    let error = refused("spi:/dev/spidev0.0?busy=gpiochip0/2").to_string();
    assert!(error.contains("lines 0 to 1"), "{error}");
    let error = refused("spi:/dev/spidev0.0?busy=gpiochip0/BUSI").to_string();
    assert!(error.contains("none of its lines has that name"), "{error}");
}

/// SK-10.9 With a line for RESETN the board is reset when the link is opened: a pulse of more than 32 us, after which
/// the link waits until it has booted.
#[test]
fn opening_resets_the_board() {
    let model = Model::start(BOARD);
    let board = open(LINK);
    board.write(&frame(MasterCommand::SetState(MasterState::Op)), Wait::For(PATIENCE)).expect("it takes it");
    let mut report = Frame::new();
    until("it is in OP", || {
        board.read(&mut report, Wait::For(PATIENCE)).expect("a report");
        (state(&report) == StateByte::reached(MasterState::Op)).then_some(())
    });
    board.close();
    assert_eq!(model.seen().resets.len(), 0);

    let board = open(&format!("{LINK}&reset={RESET_KEY}"));
    board.read(&mut report, Wait::For(PATIENCE)).expect("a report");
    assert_eq!(state(&report), StateByte::reached(MasterState::PreOp));
    board.close();
    let resets = model.stop().resets;
    assert_eq!(resets.iter().map(|reset| reset.high).collect::<Vec<_>>(), [false, true]);
    assert!(resets[1].at_ns - resets[0].at_ns > 32_000, "{resets:?}");
}

/// SW_RESET ends the link with that reason; it can be opened again when the board has booted.
#[test]
fn a_board_that_was_reset_is_opened_again() {
    let model = Model::start(BOARD);
    let board = open(LINK);
    board.write(&frame(MasterCommand::SoftReset), Wait::For(PATIENCE)).expect("it takes it");
    let error = until_lost(&*board).to_string();
    assert!(error.contains("SW_RESET"), "{error}");
    board.close();
    let again = open(LINK);
    again.read(&mut Frame::new(), Wait::For(PATIENCE)).expect("a report");
    again.close();
    model.stop();
}

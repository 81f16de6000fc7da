//! Links that refuse a frame, or fail, while their board stays: no axis may go on unseen.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use ecmsk::link::{self, Layer, Link, LinkError, ReadMeta, Share, Wait};
use ecmsk::port::gadget::in_memory::InMemory;
use ecmsk::port::gadget::{self, OnVanish};
use ecmsk::sk::{Frame, Motion, SlaveCommand};

use super::{LIMIT, SIZE, look, moving, served, until_told};

fn csp(target: i32) -> Frame {
    let mut frame = Frame::new();
    frame.put_slave(SIZE, 1, &SlaveCommand::Csp(Motion::to(target)).into());
    frame.fill_crc(SIZE);
    frame
}

/// WIRE-126 A frame that the link refuses (a target beyond a limit of the machine file) is no lost board: the host keeps the board,
/// its next frame passes, and its axes are stopped when it goes.
#[test]
fn a_refused_frame_is_no_lost_board() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("machine.toml");
    let text = "format = 1\n[limits]\nprogram = \"stop\"\n[axes]\nX = { slave = 1, unit = \"counts\", max = 50000 }\n";
    std::fs::write(&file, text).expect("a file");
    let uri = format!("sim:?name=gadget-refused&slaves=drive*2&queue=1&slot=12&axes={}", file.display());
    let board = served(&uri, OnVanish::Ramp);
    board.attach();
    moving(&board);
    let mut lines = Vec::new();
    for target in [50_001, 60_000, 70_000] {
        assert!(board.put(csp(target).bytes(), LIMIT), "{target}");
        lines.extend(until_told(&board, "a frame of the host was refused: axis X"));
    }
    assert!(board.put(csp(30_000).bytes(), LIMIT) && board.put(csp(30_000).bytes(), LIMIT));
    let [first, later] = look(&board);
    assert!(later[1].0 - first[1].0 > 1000, "the other axis goes on: {first:?} {later:?}");
    board.detach();
    lines.extend(until_told(&board, "axes stand still after the host is gone"));
    assert!(board.is_plugged_in() && !lines.iter().any(|line| line.contains("the board is lost")), "{lines:?}");
    board.attach();
    let [first, later] = look(&board);
    assert!((0..2).all(|axis| (later[axis].0 - first[axis].0).abs() < 20), "{first:?} {later:?}");
}

/// A link whose next read fails when a test says so, with its board there or lost.
struct Failing {
    link: Arc<dyn Link>,
    fails: Arc<AtomicBool>,
    loses: bool,
    is_lost: AtomicBool,
}

impl Layer for Failing {
    fn inner(&self) -> &dyn Link {
        &*self.link
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        if self.fails.swap(false, Ordering::Relaxed) {
            self.is_lost.store(self.loses, Ordering::Relaxed);
            Layer::check(self)?;
            return Err(LinkError::Io { what: "read".into(), message: "try again".into() });
        }
        self.link.read(out, wait)
    }

    fn check(&self) -> Result<(), LinkError> {
        if self.is_lost.load(Ordering::Relaxed) {
            return Err(LinkError::Lost { name: "failing".to_owned(), reason: "its cable was pulled".into() });
        }
        self.link.check()
    }
}

/// WIRE-126 A link that fails although its board is there is opened again; before that the axes that the host has moved are
/// stopped. Those of a board that is lost are stopped when it is back, before its host sees it.
#[test]
fn a_link_that_fails_is_not_left_with_moving_axes() {
    for (loses, said) in [(false, "after the board's link has failed"), (true, "after the board was lost")] {
        // The board of a URI goes on while its link is closed.
        let uri = format!("sim:?name=gadget-failing-{loses}&slaves=drive*2&queue=1");
        let fails = Arc::new(AtomicBool::new(false));
        let failing = Arc::clone(&fails);
        let opener = move || {
            let link = link::open(&uri, Share::ByUri)?;
            let (fails, is_lost) = (Arc::clone(&failing), AtomicBool::new(false));
            Ok(Arc::new(Failing { link, fails, loses, is_lost }) as Arc<dyn Link>)
        };
        let options = gadget::Options { retry: Duration::from_millis(5), ..gadget::Options::default() };
        let board = InMemory::start(Box::new(opener), options).expect("it is served");
        board.attach();
        moving(&board);
        fails.store(true, Ordering::Relaxed);
        let lines = until_told(&board, "the board is back");
        assert!(lines.iter().any(|line| line.contains(&format!("axes stand still {said}"))), "{lines:?}");
        board.detach();
        board.attach();
        let [first, later] = look(&board);
        assert!((0..2).all(|axis| (later[axis].0 - first[axis].0).abs() < 20), "{loses}: {first:?} {later:?}");
    }
}

//! A server whose link to its board was lost and is back, while the board has gone on.
#![cfg(unix)]

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::Duration;

use ecmsk::link::tcp::{Stopped, stop};
use ecmsk::link::uri::LinkUri;
use ecmsk::link::{self, Dir, Layer, Link, LinkError, ReadMeta, Share, Stamp, Wait};
use ecmsk::port::tcp::{OnVanish, ServeOptions, Server};
use ecmsk::sk::{Frame, MasterCommand};
use parking_lot::Mutex;
use support::tcp::{LIMIT, SIZE, Told, options, own, until, uri};

use crate::vanish::{Wired, after, drive, prepared};

/// The board, and the cable to it, which a test pulls.
struct Plugged {
    board: Mutex<Arc<dyn Link>>,
    is_pulled: AtomicBool,
    /// After how many writes the cable is pulled; 0: the test pulls it.
    writes_left: AtomicU32,
    /// Whether the board takes no frame.
    is_full: AtomicBool,
}

/// One opening of the board. It is lost when the cable is pulled, and the board does not notice. SW_RESET never arrives.
struct Opened {
    plugged: Arc<Plugged>,
    board: Arc<dyn Link>,
    is_lost: AtomicBool,
}

impl Opened {
    fn look(&self) -> Result<(), LinkError> {
        if self.plugged.is_pulled.load(Ordering::Acquire) {
            self.is_lost.store(true, Ordering::Release);
        }
        if self.is_lost.load(Ordering::Acquire) {
            return Err(LinkError::Lost { name: "pulled".to_owned(), reason: "its cable was pulled".into() });
        }
        Ok(())
    }
}

impl Layer for Opened {
    fn inner(&self) -> &dyn Link {
        self.board.as_ref()
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        if self.plugged.writes_left.fetch_update(Ordering::AcqRel, Ordering::Acquire, |left| left.checked_sub(1))
            == Ok(1)
        {
            self.plugged.is_pulled.store(true, Ordering::Release);
        }
        self.look()?;
        if MasterCommand::decode(&frame.slot(SIZE, 0), SIZE) == Ok(MasterCommand::SoftReset) {
            return Ok(Stamp(0));
        }
        if self.plugged.is_full.load(Ordering::Acquire) {
            return Err(LinkError::Timeout {
                dir: Dir::Write,
                waited: Duration::ZERO,
                what: "the board takes no frame",
            });
        }
        self.board.write(frame, wait)
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        self.look()?;
        self.board.read(out, wait)
    }

    fn check(&self) -> Result<(), LinkError> {
        self.look()
    }

    fn cancel(&self, dir: Dir) {
        self.board.cancel(dir);
    }

    /// Only the server's end of the cable closes.
    fn close(&self) {}
}

fn board(clock: &str) -> Arc<dyn Link> {
    link::open(&own(&format!("sim:?slaves=drive*3&clock={clock}")), Share::ByUri).unwrap()
}

fn served(clock: &str, on_vanish: OnVanish) -> (Server, Told, Arc<Plugged>) {
    let (options, told) = options();
    let plugged = Arc::new(Plugged {
        board: Mutex::new(board(clock)),
        is_pulled: AtomicBool::new(false),
        writes_left: AtomicU32::new(0),
        is_full: AtomicBool::new(false),
    });
    let open = {
        let plugged = Arc::clone(&plugged);
        move || -> Result<Arc<dyn Link>, LinkError> {
            if plugged.is_pulled.load(Ordering::Acquire) {
                return Err(LinkError::NoBoard { name: "pulled".to_owned(), reason: "no cable".to_owned() });
            }
            let (plugged, board) = (Arc::clone(&plugged), Arc::clone(&plugged.board.lock()));
            Ok(Arc::new(Opened { plugged, board, is_lost: AtomicBool::new(false) }))
        }
    };
    (Server::start(open, ServeOptions { on_vanish, ..options }).unwrap(), told, plugged)
}

impl Plugged {
    /// Pulls the cable, so that the server loses the board.
    fn pull(&self, told: &Told, writer: Option<&dyn Link>) {
        self.is_pulled.store(true, Ordering::Release);
        if let Some(writer) = writer {
            until("lost board", || writer.write(&Frame::new(), Wait::For(LIMIT)).err());
        }
        told.wait("the board is gone: its cable was pulled");
    }

    fn plug(&self, told: &Told) {
        self.is_pulled.store(false, Ordering::Release);
        told.wait("the board is back");
    }
}

/// Whether axes 1 and 2 stand, and all are on.
fn stand(server: &Server) -> bool {
    let (first, later) = after(server);
    (0..2).all(|axis| (later[axis].0 - first[axis].0).abs() < 20) && later.iter().all(|axis| axis.1)
}

/// Has the axes stopped. A late machine may need more than one stop.
fn stopped(server: &Server) -> Stopped {
    let link = LinkUri::parse(&uri(server, "")).unwrap();
    until("stop", || stop(&link, false).ok())
}

/// TCP-26 docs/SAFETY.md: the writer's axes go on while the board is away, and are stopped when it is back, before another
/// client becomes the writer. They are stopped, too, if the writer has sent SW_RESET and that frame was lost on its way.
#[test]
fn axes_that_go_on_are_stopped_when_the_board_is_back() {
    for resets in [false, true] {
        assert_eq!(go_on_and_stand("virtual", resets), Ok(()), "{resets}");
        // A machine may be late, but not in each of so many tries.
        assert!((0..5).any(|_| go_on_and_stand("real", resets).is_ok()), "{resets}");
    }
}

fn go_on_and_stand(clock: &str, resets: bool) -> Result<(), Vec<String>> {
    let (server, told, plugged) = served(clock, OnVanish::Ramp);
    let Wired { link, cable: _cable } = prepared(&server, &told);
    drive(link.as_ref(), 200);
    if resets {
        let mut reset = Frame::new();
        reset.put_master(SIZE, &MasterCommand::SoftReset);
        reset.fill_crc(SIZE);
        link.write(&reset, Wait::For(LIMIT)).unwrap();
    }
    plugged.pull(&told, Some(link.as_ref()));
    plugged.is_pulled.store(false, Ordering::Release);
    let next = until("place for a writer", || link::open(&uri(&server, ""), Share::ByName).ok());
    server.flush();
    let lines = told.lines();
    assert!(lines.iter().any(|line| line.contains("had not stopped its axes when the board went away")), "{lines:?}");
    let says_so = lines.iter().any(|line| line.contains("axes stand still after "));
    next.close();
    if says_so && stand(&server) { Ok(()) } else { Err(lines) }
}

/// TCP-26 A brake that the loss has interrupted, at whatever frame, begins anew.
#[test]
fn a_brake_that_was_interrupted_begins_anew() {
    for writes in [1, 2, 50, 200] {
        let (server, told, plugged) = served("virtual", OnVanish::Ramp);
        let Wired { link, cable } = prepared(&server, &told);
        drive(link.as_ref(), 200);
        plugged.writes_left.store(writes, Ordering::Release);
        cable.cut();
        told.wait("the board is gone: its cable was pulled");
        plugged.plug(&told);
        told.wait("axes stand still after ");
        assert!(stand(&server), "{writes}: {:?}", told.lines());
    }
}

/// TCP-26 A brake that has failed on a board that is there is tried again, and the log has the failure once.
#[test]
fn a_brake_that_has_failed_is_tried_again() {
    let (server, told, plugged) = served("virtual", OnVanish::Ramp);
    let Wired { link, cable } = prepared(&server, &told);
    drive(link.as_ref(), 200);
    plugged.is_full.store(true, Ordering::Release);
    cable.cut();
    told.wait("may still move after ");
    plugged.is_full.store(false, Ordering::Release);
    told.wait("axes stand still after ");
    let lines = told.lines();
    assert_eq!(lines.iter().filter(|line| line.contains("may still move")).count(), 1, "{lines:?}");
    assert!(stand(&server), "{lines:?}");
}

/// TCP-26 With `leave` nothing is sent when the board is back. What the server has seen of the network it knows still, so
/// that a stop which a client asks for stops the axes.
#[test]
fn a_stop_works_after_the_board_is_back() {
    let (server, told, plugged) = served("virtual", OnVanish::Leave);
    let Wired { link, cable: _cable } = prepared(&server, &told);
    drive(link.as_ref(), 200);
    plugged.pull(&told, Some(link.as_ref()));
    plugged.plug(&told);
    told.wait("left as they are");
    let (first, later) = after(&server);
    assert!(later[1].0 - first[1].0 > 1000, "{first:?} {later:?}");
    assert!(stopped(&server).in_op, "{:?}", told.lines());
    assert!(stand(&server));
}

/// TCP-10 TCP-26 After a writer that has closed its link nothing is sent either, and a stop works.
#[test]
fn a_writer_that_has_closed_its_link_before() {
    let (server, told, plugged) = served("real", OnVanish::Ramp);
    let Wired { link, cable: _cable } = prepared(&server, &told);
    drive(link.as_ref(), 200);
    link.close();
    told.wait("has closed its link");
    plugged.pull(&told, None);
    plugged.plug(&told);
    let (first, later) = after(&server);
    assert!(later[1].0 - first[1].0 > 1000, "{first:?} {later:?}");
    assert!(stopped(&server).in_op, "{:?}", told.lines());
}

/// TCP-26 A board that was switched off meanwhile is in PreOP, where nothing moves.
#[test]
fn a_board_that_was_switched_off() {
    let (server, told, plugged) = served("virtual", OnVanish::Ramp);
    let Wired { link, cable: _cable } = prepared(&server, &told);
    drive(link.as_ref(), 200);
    plugged.pull(&told, Some(link.as_ref()));
    *plugged.board.lock() = board("virtual");
    plugged.plug(&told);
    assert!(!stopped(&server).in_op);
    assert!(!told.lines().iter().any(|line| line.contains("may still move")), "{:?}", told.lines());
    // The place of the writer is free.
    let next = until("place for a writer", || link::open(&uri(&server, ""), Share::ByName).ok());
    next.read(&mut Frame::new(), Wait::For(Duration::from_secs(1))).unwrap();
}

//! A board that is unplugged, falls silent or sends nonsense in the middle of each call of the native API: each call
//! ends within its limit, with an error that says what happened and what to do.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};
use std::time::Duration;

use crate::common::calls::{CALLS, Call, Needs, SLAVES, config, has_next_step};
use crate::common::{SECOND, SIZE, in_op, script, uri};
use ecmsk::ecm::{Ecm, EcmError, Options};
use ecmsk::link::{self, Dir, Layer, Link, LinkError, ReadMeta, Share, Stamp, Wait};
use ecmsk::sk::{Frame, MasterCommand, MasterState};

/// Limits of the board and, longer, of the program, so that no wait is long.
const LIMITS: &str = "state_timeout_ms=1500&sdo_timeout_ms=300";

fn options() -> Options {
    Options {
        state_limit: 2 * SECOND,
        sdo_limit: Duration::from_millis(600),
        servo_limit: SECOND,
        read_limit: Duration::from_millis(300),
        write_limit: Duration::from_millis(300),
        ..Options::default()
    }
}

/// A fault of a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Misfortune {
    /// Somebody sends SW_RESET.
    Reset,
    /// The plug is pulled.
    Unplugged,
    /// It makes no report any more.
    Silent,
    /// Every report has an inverted bit.
    Garbled,
    /// Every command frame is lost.
    Deaf,
    /// It accepts no command frame.
    Stuck,
}

/// A link whose board has its fault after that many reads and writes.
struct Doomed {
    inner: Arc<dyn Link>,
    misfortune: Misfortune,
    /// Calls that are left; negative once it has happened.
    left: AtomicI64,
    calls: AtomicU64,
}

/// Practically never.
const NEVER: i64 = i64::MAX;

impl Doomed {
    fn new(misfortune: Misfortune) -> Arc<Self> {
        let inner = link::open(&uri(&format!("{SLAVES}&{LIMITS}")), Share::ByName).unwrap();
        Arc::new(Self { inner, misfortune, left: AtomicI64::new(NEVER), calls: AtomicU64::new(0) })
    }

    /// Whether the fault has happened; it happens now if this call is the one.
    fn met(&self) -> bool {
        self.calls.fetch_add(1, Ordering::Relaxed);
        let left = self.left.fetch_sub(1, Ordering::Relaxed);
        if left == 0 && self.misfortune == Misfortune::Reset {
            let mut frame = Frame::new();
            frame.put_master(SIZE, &MasterCommand::SoftReset);
            frame.fill_crc(SIZE);
            self.inner.write(&frame, Wait::Now).unwrap();
        }
        left <= 0
    }

    fn is_unplugged(&self) -> Result<(), LinkError> {
        if self.misfortune == Misfortune::Unplugged && self.left.load(Ordering::Relaxed) < 0 {
            return Err(LinkError::Lost { name: self.inner.info().name, reason: "it was unplugged".into() });
        }
        Ok(())
    }

    fn time(&self) -> Duration {
        self.inner.pass(Duration::ZERO).ok().flatten().map_or(Duration::ZERO, |at| Duration::from_nanos(at.0))
    }
}

impl Layer for Doomed {
    fn inner(&self) -> &dyn Link {
        &*self.inner
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        let met = self.met();
        self.is_unplugged()?;
        match self.misfortune {
            Misfortune::Deaf if met => Ok(self.inner.pass(Duration::from_micros(125))?.unwrap()),
            Misfortune::Stuck if met => {
                let Wait::For(waited) = wait else { panic!("a write without a limit") };
                self.inner.pass(waited)?;
                Err(LinkError::Timeout { dir: Dir::Write, waited, what: "the board takes no more frames" })
            }
            _ => self.inner.write(frame, wait),
        }
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        let met = self.met();
        self.is_unplugged()?;
        let meta = self.inner.read(out, wait)?;
        match self.misfortune {
            Misfortune::Silent if met => Err(LinkError::Silent { since_ns: meta.at.0, cycles: 1 }),
            Misfortune::Garbled if met => {
                out.bytes_mut()[100] ^= 4;
                Ok(meta)
            }
            _ => Ok(meta),
        }
    }

    fn pass(&self, time: Duration) -> Result<Option<Stamp>, LinkError> {
        self.is_unplugged()?;
        self.inner.pass(time)
    }

    fn check(&self) -> Result<(), LinkError> {
        self.is_unplugged()?;
        self.inner.check()
    }
}

/// A healthy board, in a state that suits the call.
fn well(call: &Call, misfortune: Misfortune) -> (Arc<Doomed>, Ecm) {
    let link = Doomed::new(misfortune);
    let ecm = Ecm::over(link.clone(), options()).unwrap();
    let wants_op = match call.needs {
        Needs::States(states) => states.contains(&MasterState::Op) && !call.name.contains("OP"),
        _ => true,
    };
    if wants_op {
        in_op(&ecm, &config());
        ecm.servo_on(&[1, 2]).unwrap();
    } else if call.name != "configure" {
        ecm.configure(&config()).unwrap();
    }
    (link, ecm)
}

/// Whether the error is the right one for this fault.
fn says(misfortune: Misfortune, error: &EcmError) -> bool {
    match misfortune {
        Misfortune::Reset | Misfortune::Unplugged => matches!(error, EcmError::Link(LinkError::Lost { .. })),
        Misfortune::Silent => matches!(error, EcmError::NoReport { bad_crc: 0, .. }),
        Misfortune::Garbled => matches!(error, EcmError::NoReport { bad_crc: 1.., .. }),
        Misfortune::Deaf => matches!(error, EcmError::Timeout { .. } | EcmError::HomingFailed { .. }),
        Misfortune::Stuck => matches!(error, EcmError::Timeout { what: "writing a frame", .. }),
    }
}

fn in_the_middle_of_each_call(misfortune: Misfortune) {
    let mut errors = 0;
    for call in CALLS {
        let (link, ecm) = well(call, misfortune);
        let before = link.calls.load(Ordering::Relaxed);
        (call.run)(&ecm).unwrap_or_else(|error| panic!("{} on a board that is well: {error}", call.name));
        let calls = (link.calls.load(Ordering::Relaxed) - before) as i64;
        for after in [0, 1, 2, 5, 13, 34, 89, 233, calls - 1].into_iter().filter(|after| (0..calls).contains(after)) {
            let what = format!("{misfortune:?} after {after} of {calls} reads and writes of {}", call.name);
            let (link, ecm) = well(call, misfortune);
            link.left.store(after, Ordering::Relaxed);
            let began = link.time();
            match (call.run)(&ecm) {
                Ok(()) => {}
                Err(error) => {
                    errors += 1;
                    assert!(says(misfortune, &error), "{what}: {error}");
                    assert!(has_next_step(&error), "{what}: {error}");
                }
            }
            assert!(link.left.load(Ordering::Relaxed) < 0, "{what}: it has met its misfortune");
            let took = link.time().saturating_sub(began);
            assert!(took < 25 * SECOND, "{what}: {took:?}");
            // Closing is bounded on such a board, too.
            let began = link.time();
            drop(ecm);
            let took = link.time().saturating_sub(began);
            assert!(took <= 3 * SECOND, "{what}: closing took {took:?}");
        }
    }
    assert!(errors > 20, "only {errors} calls noticed");
}

/// API-17 A board that is reset by somebody.
#[test]
fn a_board_that_is_reset() {
    in_the_middle_of_each_call(Misfortune::Reset);
}

/// API-17 A board that is unplugged.
#[test]
fn a_board_that_is_unplugged() {
    in_the_middle_of_each_call(Misfortune::Unplugged);
}

/// A board that makes no reports any more.
#[test]
fn a_board_that_falls_silent() {
    in_the_middle_of_each_call(Misfortune::Silent);
}

/// A line that inverts a bit of every report.
#[test]
fn a_board_that_is_not_understood() {
    in_the_middle_of_each_call(Misfortune::Garbled);
}

/// Command frames that never arrive.
#[test]
fn a_board_that_hears_nothing() {
    in_the_middle_of_each_call(Misfortune::Deaf);
}

/// A board that accepts no frame.
#[test]
fn a_board_that_accepts_nothing() {
    in_the_middle_of_each_call(Misfortune::Stuck);
}

/// SK-4.59 SK-4.61 Faults of the network: a cable that is cut before the first or a later slave, a slave without power,
/// a silent slave, a board that takes nothing out of its FIFO. Calls during the fault end within their limits.
#[test]
fn a_network_in_trouble() {
    let troubles = ["cut 1", "cut 2", "lose 1", "mute 1", "lose 3", "silent", "full", "sdo-delay 1 2s", "jam 1"];
    for trouble in troubles {
        let file = script(&format!("bad-{}", trouble.replace(' ', "-")), &format!("at 2s {trouble}\n"));
        for call in CALLS.iter().filter(|call| matches!(call.needs, Needs::Op | Needs::On | Needs::NoAlarm)) {
            let what = format!("{} with `{trouble}`", call.name);
            let link = link::open(&uri(&format!("{SLAVES}&{LIMITS}&script={file}")), Share::ByName).unwrap();
            let ecm = Ecm::over(link.clone(), options()).unwrap();
            in_op(&ecm, &config());
            ecm.servo_on(&[1, 2]).unwrap();
            let now = || Duration::from_nanos(link.pass(Duration::ZERO).unwrap().unwrap().0);
            let opened = Duration::from_nanos(link.info().opened_at.0);
            link.pass((opened + 2 * SECOND).saturating_sub(now()).saturating_sub(Duration::from_millis(3))).unwrap();
            // A call that is under way at the fault, and, if that one does not notice it, a call after it.
            for _ in 0..2 {
                let began = now();
                let given = (call.run)(&ecm);
                let took = now() - began;
                assert!(took < 25 * SECOND, "{what}: {took:?}");
                if let Err(error) = given {
                    assert!(has_next_step(&error), "{what}: {error}");
                    break;
                }
            }
            drop(ecm);
            assert_eq!(link.check(), Err(LinkError::Closed), "{what}");
        }
    }
}

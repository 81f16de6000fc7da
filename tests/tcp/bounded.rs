//! Virtual time over the network: however much of it a client requests, neither the others nor the end of that client
//! nor the end of the server wait for it.
#![cfg(unix)]

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::thread;
use std::time::Duration;

use ecmsk::link::{self, Dir, Layer, Link, LinkError, PASS_MAX, ReadMeta, Share, Stamp, Wait};
use ecmsk::port::tcp::Server;
use ecmsk::sk::Frame;
use support::tcp::{LIMIT, Raw, connect, connect_next, message, options, own, serve, serve_link, until};

const WELCOME: u8 = 0x81;
const PASSED: u8 = 0x86;
const FAILED: u8 = 0x88;
const BYE: u8 = 0x41;
const CANCELLED: u8 = 4;

fn pass(request: u64, ns: u64) -> Vec<u8> {
    message(0x04, &[request.to_le_bytes(), ns.to_le_bytes()].concat())
}

fn read(request: u64, limit_ns: u64) -> Vec<u8> {
    message(0x03, &[request.to_le_bytes(), limit_ns.to_le_bytes()].concat())
}

/// A writer that may be silent for an hour, and its request.
fn asks(server: &Server, message: &[u8]) -> Raw {
    let mut raw = until("place for a writer", || {
        let mut raw = Raw::connect(server);
        (raw.hello(false, 3_600_000)?.0 == WELCOME).then_some(raw)
    });
    raw.send(message);
    raw
}

fn day() -> Vec<u8> {
    pass(1, PASS_MAX.as_nanos() as u64)
}

fn stops(server: Server) {
    let (done, stopped) = mpsc::channel();
    thread::spawn(move || {
        server.stop();
        done.send(()).unwrap();
    });
    stopped.recv_timeout(LIMIT).expect("the server stops");
}

/// More than a day is refused, with the limit; the client may go on.
#[test]
fn more_than_a_day_of_virtual_time_is_refused() {
    let (server, _) = serve("sim:?slaves=drive&clock=virtual");
    let mut raw = asks(&server, &pass(1, 1 << 63));
    let (kind, payload) = raw.answer().expect("an answer");
    assert_eq!(kind, FAILED);
    assert!(String::from_utf8_lossy(&payload).contains("86400s"), "{payload:?}");
    raw.send(&pass(2, 1_000_000));
    assert_eq!(raw.answer().expect("an answer").0, PASSED);
    drop(raw);
    let over_tcp = connect_next(&server, "");
    let here = link::open("sim:?slaves=drive&clock=virtual", Share::ByName).unwrap();
    for link in [over_tcp, here] {
        let before = link.pass(Duration::ZERO).unwrap();
        let error = link.pass(Duration::from_nanos(1 << 63)).unwrap_err().to_string();
        assert!(error.contains("86400s") && error.contains("several times"), "{error}");
        assert_eq!(link.pass(Duration::ZERO).unwrap(), before, "nothing has passed");
    }
}

/// While a day passes for the writer, others can connect, it can cancel or disconnect, and the server can be stopped.
#[test]
fn while_a_day_passes_others_connect_and_the_call_can_be_cancelled() {
    let (server, _) = serve("sim:?slaves=drive&clock=virtual");
    let mut raw = asks(&server, &day());
    assert_eq!(connect(&server, "role=reader").check(), Ok(()));
    assert!(matches!(support::tcp::refused(&server, ""), LinkError::InUse { .. }));
    raw.send(&message(0x06, &1_u64.to_le_bytes()));
    let (kind, payload) = raw.answer().expect("an answer");
    assert_eq!((kind, payload[16]), (FAILED, CANCELLED));
    raw.send(&day());
    drop(raw);
    let mut raw = asks(&server, &day());
    stops(server);
    assert_eq!(raw.answer().expect("good-bye").0, BYE);
}

/// A day that passes on a link of this process ends when another thread closes it.
#[test]
fn closing_the_link_ends_a_day_that_passes() {
    let link = link::open("sim:?slaves=drive&clock=virtual", Share::ByName).unwrap();
    let other = Arc::clone(&link);
    let passing = thread::spawn(move || other.pass(PASS_MAX));
    let begin = link.info().opened_at;
    until("time passes", || (link.pass(Duration::ZERO).unwrap()? > begin).then_some(()));
    link.close();
    assert_eq!(passing.join().unwrap(), Err(LinkError::Closed));
}

/// A link of virtual time whose calls end when the test allows it, and that makes no report.
struct Stuck {
    inner: Arc<dyn Link>,
    is_stuck: AtomicBool,
}

impl Layer for Stuck {
    fn inner(&self) -> &dyn Link {
        &*self.inner
    }

    fn read(&self, _: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        let Wait::For(waited) = wait else { panic!("every read of this test has a limit") };
        // The board itself takes a day in many steps.
        for _ in 0..waited.as_nanos().div_ceil(PASS_MAX.as_nanos()) {
            self.inner.pass(waited.min(PASS_MAX))?;
        }
        Err(LinkError::Timeout { dir: Dir::Read, waited, what: "no report came" })
    }
    fn pass(&self, time: Duration) -> Result<Option<Stamp>, LinkError> {
        while self.is_stuck.load(Ordering::Acquire) {
            thread::sleep(Duration::from_millis(1));
        }
        self.inner.pass(time)
    }
}

fn stuck() -> (Arc<Stuck>, Server) {
    let inner = link::open(&own("sim:?slaves=drive&clock=virtual"), Share::ByName).unwrap();
    let stuck = Arc::new(Stuck { inner, is_stuck: AtomicBool::new(false) });
    (Arc::clone(&stuck), serve_link(stuck, options().0))
}

/// While a call of one client is stuck in the link others can connect: no call into a link is made under a lock that
/// they need.
#[test]
fn a_stuck_call_keeps_nobody_out() {
    let (link, server) = stuck();
    let mut raw = asks(&server, b"");
    link.is_stuck.store(true, Ordering::Release);
    raw.send(&pass(1, 1_000_000));
    for _ in 0..3 {
        assert_eq!(connect(&server, "role=reader").check(), Ok(()));
    }
    link.is_stuck.store(false, Ordering::Release);
    assert_eq!(raw.answer().expect("an answer").0, PASSED);
    stops(server);
}

/// A read that waits for centuries of the board's time is done in steps, too.
#[test]
fn a_read_that_waits_for_centuries_can_be_ended() {
    let (_link, server) = stuck();
    let mut raw = asks(&server, &read(1, 1 << 63));
    raw.send(&message(0x06, &1_u64.to_le_bytes()));
    let (kind, payload) = raw.answer().expect("an answer");
    assert_eq!((kind, payload[16]), (FAILED, CANCELLED));
    raw.send(&read(2, 1 << 63));
    drop(raw);
    let _raw = asks(&server, &read(3, 1 << 63));
    stops(server);
}

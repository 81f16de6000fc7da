//! How long axes go on after their host is gone: the figures of docs/SAFETY.md, in the board's time.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use ecmsk::link::{self, Dir, KnownNetwork, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Share, Stamp, Wait};
use ecmsk::port::gadget::in_memory::InMemory;
use ecmsk::port::gadget::{OnVanish, Options};
use ecmsk::sk::{DriveResponse, Frame, Motion, SlaveCommand};
use parking_lot::Mutex;

use super::{LIMIT, SIZE, prepared, until, until_told};

/// What the link of the board has shown.
#[derive(Default)]
struct Shown {
    /// When the newest frame was written.
    written: Stamp,
    /// The newest positions of both axes, and since when each has been there.
    axes: [(i32, Stamp); 2],
    /// The longest wait of a call.
    longest: Duration,
}

impl Shown {
    fn waits(&mut self, wait: Wait) {
        self.longest = self.longest.max(wait.limit().unwrap_or(Duration::MAX));
    }
}

/// A board on a virtual clock, whose time stands still while `is_held`: no late thread of this machine counts. What stops the
/// axes begins by cancelling writes, which ends that.
struct Board {
    link: Arc<dyn Link>,
    is_held: AtomicBool,
    shown: Mutex<Shown>,
}

impl Link for Board {
    fn info(&self) -> LinkInfo {
        self.link.info()
    }

    fn network(&self) -> Option<KnownNetwork> {
        self.link.network()
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        self.shown.lock().waits(wait);
        let at = self.link.write(frame, wait)?;
        self.shown.lock().written = at;
        Ok(at)
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        self.shown.lock().waits(wait);
        if self.is_held.load(Ordering::Acquire) {
            std::thread::sleep(Duration::from_millis(1));
            return Err(LinkError::Timeout { dir: Dir::Read, waited: Duration::from_millis(1), what: "it is held" });
        }
        let meta = self.link.read(out, wait)?;
        for (number, axis) in self.shown.lock().axes.iter_mut().enumerate() {
            let position = DriveResponse::decode(&out.slot(SIZE, number + 1)).position;
            if axis.0 != position {
                *axis = (position, meta.at);
            }
        }
        Ok(meta)
    }

    fn pass(&self, time: Duration) -> Result<Option<Stamp>, LinkError> {
        self.link.pass(time)
    }

    fn cancel(&self, dir: Dir) {
        if dir == Dir::Write {
            self.is_held.store(false, Ordering::Release);
        }
        self.link.cancel(dir);
    }

    fn close(&self) {
        self.link.close();
    }

    fn check(&self) -> Result<(), LinkError> {
        self.link.check()
    }

    fn stats(&self) -> LinkStats {
        self.link.stats()
    }
}

/// The board's time from the moment in which a host with `frames` ahead is gone until each axis is where it stays: axis 1 in
/// CSP, axis 2 on a velocity.
fn time_to_rest(name: &str, frames: i32) -> [Duration; 2] {
    let uri = format!("sim:?name={name}&slaves=drive*2&queue=1&clock=virtual");
    let link = link::open(&uri, Share::ByUri).expect("it opens");
    let seen = Arc::new(Board { link, is_held: AtomicBool::new(false), shown: Mutex::default() });
    let opened: Arc<dyn Link> = seen.clone();
    let options = Options { on_vanish: OnVanish::Ramp, ..Options::default() };
    let board = InMemory::start(Box::new(move || Ok(Arc::clone(&opened))), options).expect("it is served");
    board.attach();
    prepared(&board);
    seen.is_held.store(true, Ordering::Release);
    for n in 1..=frames {
        let mut frame = Frame::new();
        frame.put_slave(SIZE, 1, &SlaveCommand::Csp(Motion::to(n * 100)).into());
        frame.put_slave(SIZE, 2, &SlaveCommand::Csv(Motion::to(100_000)).into());
        frame.fill_crc(SIZE);
        assert!(board.put(frame.bytes(), LIMIT), "{n}");
    }
    // It takes the next one when the board has this one.
    until("the last one is with the board", || board.takes());
    let gone = seen.shown.lock().written;
    let longest = seen.shown.lock().longest;
    assert!(longest <= Duration::from_millis(50), "docs/SAFETY.md: within 50 ms if no report comes, {longest:?}");
    board.detach();
    until_told(&board, "axes stand still after the host is gone");
    board.stop();
    let shown = seen.shown.lock();
    assert_eq!(shown.axes[0].0, frames * 100, "all that the board has accepted is executed");
    shown.axes.map(|(_, since)| Duration::from_nanos(since.0 - gone.0))
}

/// WIRE-126 docs/SAFETY.md, the row of a host at the device port: an axis in CSP stands 50 ms after the FIFO is executed at the
/// latest, a velocity is 0 after 250 ms and 10 cycles. The brake begins in the next cycle.
#[test]
fn axes_are_at_rest_in_the_time_of_safety_md() {
    let ms = Duration::from_millis;
    for (name, frames) in [("gadget-rest-1", 1), ("gadget-rest-100", 100)] {
        let [csp, csv] = time_to_rest(name, frames);
        // A frame takes 1/8 ms on the bus, so some of them have been executed already.
        let ahead = ms(frames.unsigned_abs().into());
        assert!(csp <= ahead + ms(50), "{frames}: {csp:?}");
        assert!(csv >= ms(250) && csv <= ahead + ms(250 + 10), "{frames}: {csv:?}");
    }
}

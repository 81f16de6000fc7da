//! What the tests of the native API share: boards, and a link that shows and bends what passes.

pub mod calls;

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use ecmsk::ecm::{Config, Ecm, EcmError, Options, Slave, Stream};
use ecmsk::link::{self, Dir, Layer, Link, LinkError, LinkInfo, ReadMeta, Share, Stamp, Wait};
use ecmsk::sk::{Frame, MasterState, RawSlot, SlotSize};

pub const SIZE: SlotSize = SlotSize::Bytes12;
pub const SECOND: Duration = Duration::from_secs(1);

/// A network of these slaves, in its usual cycle.
pub fn config(slaves: Vec<Slave>) -> Config {
    Config { slaves, ..Config::default() }
}

/// A board on virtual time.
pub fn open(keys: &str) -> Ecm {
    Ecm::open(&uri(keys)).unwrap()
}

pub fn uri(keys: &str) -> String {
    format!("sim:?clock=virtual&{keys}")
}

/// A board of drives that are on.
pub fn enabled(keys: &str, config: &Config) -> Ecm {
    enable(open(keys), config)
}

pub fn enable(ecm: Ecm, config: &Config) -> Ecm {
    in_op(&ecm, config);
    let axes: Vec<u8> = (1..).zip(&config.slaves).filter(|(_, slave)| slave.axis().is_some()).map(|(n, _)| n).collect();
    ecm.servo_on(&axes).unwrap();
    ecm
}

pub fn in_op(ecm: &Ecm, config: &Config) {
    ecm.configure(config).unwrap();
    ecm.set_state(MasterState::Op).unwrap();
}

/// So many cycles pass.
pub fn cycles(ecm: &Ecm, count: u32) {
    for _ in 0..count {
        ecm.next_cycle(SECOND).unwrap();
    }
}

/// A stream goes on with the last values.
pub fn steps(stream: &mut Stream<'_>, count: u32) {
    for _ in 0..count {
        stream.step().unwrap();
    }
}

/// A stream moves an axis by that many steps, with that distance between targets in counts.
pub fn follow(stream: &mut Stream<'_>, slave: u8, from: i32, counts: i32, steps: i32) {
    for n in 0..steps {
        stream.csp(slave, from + n * counts).unwrap();
        stream.step().unwrap();
    }
}

/// A script file of that text.
pub fn script(name: &str, text: &str) -> String {
    let file: PathBuf = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("ecm-{name}.ecmscript"));
    // In one go: the same tests may run in another process.
    let own = file.with_extension(std::process::id().to_string());
    fs::write(&own, text).unwrap();
    fs::rename(&own, &file).unwrap();
    file.display().to_string()
}

/// Bends reports, by their number since it was set.
pub type Bend = Box<dyn FnMut(u64, &mut Frame) + Send>;

/// Frames that do not arrive.
pub type Pick = Box<dyn FnMut(&Frame) -> bool + Send>;

/// A link that keeps what is written, with its limits, and bends what is read.
pub struct Tap {
    inner: Arc<dyn Link>,
    pub written: Mutex<Vec<Frame>>,
    pub waits: Mutex<Vec<Wait>>,
    bend: Mutex<(u64, Option<Bend>)>,
    lose: Mutex<Option<Pick>>,
    refuse: Mutex<Option<Pick>>,
    /// The next read is cancelled, as by another thread.
    pub cancel: AtomicBool,
    hide_slot: bool,
}

impl Tap {
    pub fn open(keys: &str) -> Arc<Self> {
        Self::over(keys, false)
    }

    /// With slaves whose axes are on.
    pub fn enabled(keys: &str, config: &Config) -> (Arc<Self>, Ecm) {
        let tap = Self::open(keys);
        let ecm = enable(tap.ecm(Options::default()).unwrap(), config);
        (tap, ecm)
    }

    /// One that does not say how wide slots are.
    pub fn without_slot(keys: &str) -> Arc<Self> {
        Self::over(keys, true)
    }

    pub fn around(link: Arc<dyn Link>) -> Arc<Self> {
        Self::new(link, false)
    }

    fn over(keys: &str, hide_slot: bool) -> Arc<Self> {
        Self::new(link::open(&uri(keys), Share::ByName).unwrap(), hide_slot)
    }

    fn new(inner: Arc<dyn Link>, hide_slot: bool) -> Arc<Self> {
        let (written, waits, bend, lose, refuse, cancel) = Default::default();
        Arc::new(Self { inner, written, waits, bend, lose, refuse, cancel, hide_slot })
    }

    pub fn ecm(self: &Arc<Self>, options: Options) -> Result<Ecm, EcmError> {
        Ecm::over(self.clone(), options)
    }

    pub fn bend(&self, bend: impl FnMut(u64, &mut Frame) + Send + 'static) {
        *self.bend.lock().unwrap() = (0, Some(Box::new(bend)));
    }

    /// Bends a slot of each report, by the number of the report since then.
    pub fn bend_slot(&self, slot: usize, mut bend: impl FnMut(u64, &mut RawSlot) + Send + 'static) {
        self.bend(move |n, frame| {
            let mut bent = frame.slot(SIZE, slot);
            bend(n, &mut bent);
            frame.put(SIZE, slot, &bent);
            frame.fill_crc(SIZE);
        });
    }

    /// The board's time.
    pub fn now(&self) -> Duration {
        Duration::from_nanos(self.inner.pass(Duration::ZERO).unwrap().unwrap().0)
    }

    /// Frames that are lost without notice.
    pub fn lose(&self, pick: impl FnMut(&Frame) -> bool + Send + 'static) {
        *self.lose.lock().unwrap() = Some(Box::new(pick));
    }

    /// Frames that the board does not take in time.
    pub fn refuse(&self, pick: impl FnMut(&Frame) -> bool + Send + 'static) {
        *self.refuse.lock().unwrap() = Some(Box::new(pick));
    }

    /// The frames written so far, which are forgotten.
    pub fn take(&self) -> Vec<Frame> {
        std::mem::take(&mut self.written.lock().unwrap())
    }

    /// Slots that are not zero, of the frames written so far, which are forgotten.
    pub fn take_slots(&self, slot: usize) -> Vec<RawSlot> {
        let frames = self.take();
        frames.iter().map(|frame| frame.slot(SIZE, slot)).filter(|slot| !slot.is_zero()).collect()
    }
}

impl Layer for Tap {
    fn inner(&self) -> &dyn Link {
        &*self.inner
    }

    fn info(&self) -> LinkInfo {
        let info = self.inner.info();
        LinkInfo { slot: info.slot.filter(|_| !self.hide_slot), ..info }
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        self.waits.lock().unwrap().push(wait);
        let picked = |pick: &Mutex<Option<Pick>>| pick.lock().unwrap().as_mut().is_some_and(|pick| pick(frame));
        if picked(&self.refuse) {
            let waited = Duration::from_millis(1);
            return Err(LinkError::Timeout { dir: Dir::Write, waited, what: "the board takes no more frames" });
        }
        if picked(&self.lose) {
            return Ok(self.inner.pass(Duration::from_micros(125))?.unwrap());
        }
        let at = self.inner.write(frame, wait)?;
        self.written.lock().unwrap().push(frame.clone());
        Ok(at)
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        self.waits.lock().unwrap().push(wait);
        if self.cancel.swap(false, Ordering::Relaxed) {
            return Err(LinkError::Cancelled { dir: Dir::Read });
        }
        let meta = self.inner.read(out, wait)?;
        let (count, bend) = &mut *self.bend.lock().unwrap();
        if let Some(bend) = bend {
            bend(*count, out);
            *count += 1;
        }
        Ok(meta)
    }
}

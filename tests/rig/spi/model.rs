//! The model as the board on the wires.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread;
use std::time::{Duration, Instant};

use ecmsk::link::{self, Link, Share};
use ecmsk::port::spi::{SpiBoard, SpiBoardCounters};

use super::played::{Board, Busy, Played, Seen};

/// SK-10: a shorter pulse on RESET has no effect.
const SHORTEST_RESET: Duration = Duration::from_micros(32);

/// Time that BUSY is high after an exchange here.
const PROCESSING: Duration = Duration::from_micros(100);
/// Time that a board boots here.
const BOOT: Duration = Duration::from_millis(50);

/// A change of the bytes on MISO by the wires; the bytes on MOSI come first.
pub type Miso = fn(&[u8], &mut [u8]);

/// Faultless wires.
pub fn straight(_: &[u8], _: &mut [u8]) {}

/// What a test can change while the board runs.
struct Control {
    miso: Mutex<Miso>,
    /// BUSY is high.
    hangs: AtomicBool,
}

/// A simulated board on the wires, until it is dropped.
pub struct Model {
    played: Played,
    spi_board: Arc<Mutex<SpiBoard>>,
    control: Arc<Control>,
}

impl Model {
    /// The board of that link on faultless wires.
    #[track_caller]
    pub fn start(uri: &str) -> Self {
        Self::on(uri, Busy::True, straight)
    }

    /// The board of that link on these wires.
    #[track_caller]
    pub fn on(uri: &str, busy: Busy, miso: Miso) -> Self {
        let uri = format!("{uri}&queue=1");
        let spi_board = Arc::new(Mutex::new(SpiBoard::new(open(&uri).expect("a simulated board"))));
        let control = Arc::new(Control { miso: Mutex::new(miso), hangs: AtomicBool::new(false) });
        let wired = Wired { spi_board: spi_board.clone(), control: control.clone(), uri, booted: None };
        Self { played: Played::start(wired, busy), spi_board, control }
    }

    pub fn counters(&self) -> SpiBoardCounters {
        locked(&self.spi_board).counters()
    }

    /// Sets how the wires change MISO from now on.
    pub fn set_miso(&self, miso: Miso) {
        *locked(&self.control.miso) = miso;
    }

    /// From now on BUSY stays high, or not.
    pub fn hang(&self, hangs: bool) {
        self.control.hangs.store(hangs, Ordering::Relaxed);
    }

    /// The host's exchanges and resets so far.
    pub fn seen(&self) -> Seen {
        self.played.seen()
    }

    /// Removes the board; its recording is complete then.
    #[track_caller]
    pub fn stop(self) -> Seen {
        self.played.stop()
    }
}

fn open(uri: &str) -> Option<Arc<dyn Link>> {
    link::open(uri, Share::ByName).ok()
}

fn locked<T>(what: &Mutex<T>) -> MutexGuard<'_, T> {
    what.lock().expect("nobody panics with it")
}

struct Wired {
    spi_board: Arc<Mutex<SpiBoard>>,
    control: Arc<Control>,
    uri: String,
    /// The time at which it has booted.
    booted: Option<Instant>,
}

impl Board for Wired {
    fn exchange(&mut self, mosi: &[u8], miso: &mut [u8]) {
        locked(&self.spi_board).exchange(mosi, miso);
        locked(&self.control.miso)(mosi, miso);
    }

    fn process(&mut self) {
        thread::sleep(PROCESSING);
    }

    fn reset(&mut self, low: Duration) -> bool {
        let is_one = low > SHORTEST_RESET;
        if is_one {
            locked(&self.spi_board).reset();
        }
        is_one
    }

    fn is_busy(&mut self) -> bool {
        let mut spi_board = locked(&self.spi_board);
        if !spi_board.is_busy() {
            return self.control.hangs.load(Ordering::Relaxed);
        }
        let booted = *self.booted.get_or_insert_with(|| Instant::now() + BOOT);
        if Instant::now() >= booted
            && let Some(link) = open(&self.uri)
        {
            spi_board.replace(link);
            self.booted = None;
        }
        spi_board.is_busy()
    }
}

//! Wires controlled by a test, with a board's spi_board at the other end.

use std::sync::Arc;
use std::time::{Duration, Instant};

use ecmsk::io::spi::{BusyWires, SpiError};
use ecmsk::link::options::CommonOptions;
use ecmsk::link::spi::{SpiLink, SpiOptions};
use ecmsk::link::uri::LinkUri;
use ecmsk::link::{self, Link, LinkError, Share};
use ecmsk::port::spi::SpiBoard;
use ecmsk::sk::Frame;
use parking_lot::Mutex;

/// A wire's change of the answers.
pub type Tamper = Box<dyn FnMut(&[u8], &mut [u8]) + Send>;

/// The level of BUSY on its wire.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Busy {
    /// As driven by the board.
    #[default]
    True,
    /// Not connected.
    None,
    /// Tied high.
    High,
    /// Tied low.
    Low,
}

pub struct State {
    pub spi_board: SpiBoard,
    pub busy: Busy,
    pub tamper: Option<Tamper>,
    /// When each exchange began, and its frame.
    pub exchanges: Vec<(Instant, Frame)>,
    pub resets: Vec<Duration>,
    /// The next exchanges fail.
    pub fails: bool,
    fallen: bool,
}

/// The test's end of the wires; clones share them.
#[derive(Clone)]
pub struct Held(Arc<Mutex<State>>);

impl Held {
    /// With the board of that URI at the other end.
    pub fn board(uri: &str) -> Self {
        Self::over(link::open(uri, Share::ByName).unwrap())
    }

    pub fn over(board: Arc<dyn Link>) -> Self {
        let state = State {
            spi_board: SpiBoard::new(board),
            busy: Busy::default(),
            tamper: None,
            exchanges: Vec::new(),
            resets: Vec::new(),
            fails: false,
            fallen: false,
        };
        Self(Arc::new(Mutex::new(state)))
    }

    pub fn with<T>(&self, work: impl FnOnce(&mut State) -> T) -> T {
        work(&mut self.0.lock())
    }

    pub fn busy(self, busy: Busy) -> Self {
        self.with(|state| state.busy = busy);
        self
    }

    pub fn tamper(self, tamper: impl FnMut(&[u8], &mut [u8]) + Send + 'static) -> Self {
        self.with(|state| state.tamper = Some(Box::new(tamper)));
        self
    }

    /// A link over them, with the options of that URI.
    pub fn open(&self, uri: &str) -> Result<SpiLink, LinkError> {
        let uri = LinkUri::parse(uri)?;
        let common = CommonOptions::from_uri(&uri)?;
        let (options, _) = SpiOptions::from_uri(&uri)?;
        self.open_with(SpiOptions { open_limit: Duration::from_millis(300), ..options }, &common)
    }

    pub fn open_with(&self, options: SpiOptions, common: &CommonOptions) -> Result<SpiLink, LinkError> {
        SpiLink::over("spi:test", Box::new(self.clone()), options, common)
    }
}

/// The wires themselves.
impl BusyWires for Held {
    fn exchange(&mut self, tx: &[u8], rx: &mut [u8]) -> Result<(), SpiError> {
        let mut state = self.0.lock();
        if state.fails {
            return Err(SpiError::Refused { what: "exchange".into(), message: "no such device".into() });
        }
        state.exchanges.push((Instant::now(), Frame::from_prefix(tx)));
        state.spi_board.exchange(tx, rx);
        state.fallen |= state.busy == Busy::True && !state.spi_board.is_busy();
        if let Some(tamper) = &mut state.tamper {
            tamper(tx, rx);
        }
        Ok(())
    }

    fn has_busy_line(&self) -> bool {
        self.0.lock().busy != Busy::None
    }

    fn is_busy(&mut self) -> Result<bool, SpiError> {
        let state = self.0.lock();
        Ok(match state.busy {
            Busy::True => state.spi_board.is_busy(),
            Busy::None | Busy::Low => false,
            Busy::High => true,
        })
    }

    fn wait_ready(&mut self, limit: Duration) -> Result<bool, SpiError> {
        let began = Instant::now();
        while self.is_busy()? {
            if began.elapsed() >= limit {
                return Ok(false);
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        Ok(true)
    }

    fn busy_has_fallen(&mut self) -> Result<bool, SpiError> {
        Ok(std::mem::take(&mut self.0.lock().fallen))
    }

    fn reset(&mut self, low: Duration) -> Result<bool, SpiError> {
        self.0.lock().resets.push(low);
        Ok(true)
    }
}

//! A board that this process serves, whose writer fails: after the writer's end its axis is at rest, and every frame
//! that the board has taken is accounted for.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use ecmsk::ecm::{Close, Config, Ecm, Options};
use ecmsk::link::{self, Layer, Link, LinkError, Share, Stamp, Wait};
use ecmsk::port::tcp::Server;
use ecmsk::sk::{Frame, MasterState};
use support::tcp::{self, Told};

/// Cycles in which a drive comes to rest after its targets have stopped.
const REST: usize = 50;
/// Cycles in which an axis that has to be at rest is observed.
const LOOKED_ON: usize = 50;
/// Allowed deviation of a drive at rest.
const NOISE_COUNTS: u32 = 2;

/// Counts the frames that reach the board.
struct Counted {
    inner: Arc<dyn Link>,
    written: Arc<AtomicU64>,
}

impl Layer for Counted {
    fn inner(&self) -> &dyn Link {
        self.inner.as_ref()
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        let stamp = self.inner.write(frame, wait)?;
        self.written.fetch_add(1, Ordering::Relaxed);
        Ok(stamp)
    }
}

pub struct Served {
    server: Server,
    told: Told,
    written: Arc<AtomicU64>,
}

impl Served {
    /// Serves a drive in virtual time.
    pub fn start() -> Self {
        let (options, told) = tcp::options();
        let written = Arc::new(AtomicU64::new(0));
        let uri = tcp::own("sim:?slaves=drive&clock=virtual");
        let inner = link::open(&uri, Share::ByUri).expect("a board");
        let link = Arc::new(Counted { inner, written: Arc::clone(&written) });
        Self { server: tcp::serve_link(link, options), told, written }
    }

    pub fn uri(&self) -> String {
        tcp::uri(&self.server, "")
    }

    /// The frames that have reached the board.
    pub fn written(&self) -> u64 {
        self.written.load(Ordering::Relaxed)
    }

    /// The axis is at rest, between its start and the target; at the target if the writer `has_arrived`.
    pub fn stands_within(&self, target: i32, has_arrived: bool) -> Result<(), String> {
        let options = Options { close: Close::Leave, ..Options::default() };
        let look = || Ecm::open_with(&self.uri(), options).ok();
        let ecm = tcp::until("place for a writer", look);
        let told = || self.told.lines().join("; ");
        let failed = |error: ecmsk::ecm::EcmError| format!("{error} ({})", told());
        ecm.adopt(&Config::drives(1)).map_err(failed)?;
        let mut first = ecm.next_cycle(tcp::LIMIT).map_err(failed)?;
        let is_up = first.state().state() == Some(MasterState::Op);
        if has_arrived && !is_up {
            return Err(format!("the network is in {:?} ({})", first.state(), told()));
        }
        if !is_up {
            return Ok(());
        }
        for _ in 0..REST {
            first = ecm.next_cycle(tcp::LIMIT).map_err(failed)?;
        }
        let from = first.position(1).ok_or("no axis")?;
        let mut to = from;
        for _ in 0..LOOKED_ON {
            to = ecm.next_cycle(tcp::LIMIT).map_err(failed)?.position(1).ok_or("no axis")?;
        }
        ecm.close(Close::Leave).map_err(failed)?;
        if from.abs_diff(to) > NOISE_COUNTS {
            return Err(format!("the axis moves without a writer: from {from} to {to} ({})", told()));
        }
        let noise = NOISE_COUNTS.cast_signed();
        let nearest = if has_arrived { target - noise } else { -noise };
        let expected = nearest..=target + noise;
        if expected.contains(&to) { Ok(()) } else { Err(format!("the axis is at {to} ({})", told())) }
    }
}

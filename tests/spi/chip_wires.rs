//! Wires controlled by a test, in virtual time, with the model of an ECM-XF at the other end.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use ecmsk::ethercat::Ns;
use ecmsk::io::spi::{EdgeWires, Level, SpiError};
use ecmsk::link::chip::SpiChip;
use ecmsk::slave::{Drive, DriveConfig, Slave};
use ecmsk::xf::chip::{Chip, ChipPort, Profile, SlaveModels};
use ecmsk::xf::host::{HostConfig, HostPacing};
use ecmsk::xf::request::WarmReset;
use ecmsk::xf::{CheckRule, CommandHeader, MAX_PACKET, Request, write_request};
use ecmsk::xf_api::{Xf, XfError};

/// The clock of SPI.
pub const SPEED_HZ: u32 = 24_000_000;

/// How INT0 is wired.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Int0 {
    /// Not at all.
    None,
    /// To a line that waits for edges to this level.
    To(Level),
}

/// The test's end of the wires.
pub struct ChipWires {
    pub port: ChipPort<SlaveModels>,
    pub now: Ns,
    pub int0: Int0,
    /// Edges to the level of `int0` that were neither waited for nor discarded.
    pub edges: u32,
    /// Every n-th edge is lost; 0: none.
    pub loses_every: u32,
    /// All edges so far, including lost ones.
    pub all_edges: u32,
    /// The level of INT0.
    level: bool,
    /// Bytes of each exchange.
    pub lengths: Vec<usize>,
    /// Number of the next exchanges that fail.
    pub failures: u32,
    /// The time of each reset pulse; shared with the test.
    pub resets: Arc<Mutex<Vec<Duration>>>,
}

impl ChipWires {
    /// A chip of that firmware with that many drives, powered on now.
    pub fn new(profile: Profile, drives: usize, int0: Int0) -> Self {
        let drive = |_| Box::new(Drive::new(DriveConfig::default())) as Box<dyn Slave>;
        let slaves = SlaveModels::new((0..drives).map(drive).collect());
        let port = ChipPort::new(Chip::new(profile, slaves));
        let mut wires = Self {
            port,
            now: 0,
            int0,
            edges: 0,
            loses_every: 0,
            all_edges: 0,
            level: false,
            lengths: Vec::new(),
            failures: 0,
            resets: Arc::default(),
        };
        wires.look();
        wires
    }

    /// The driver of a chip behind these wires, started.
    pub fn open(self) -> Result<Xf<SpiChip<Self>>, XfError> {
        self.open_with(HostConfig::DEFAULT)
    }

    /// As [`Self::open`], with the whole configuration.
    pub fn open_with(self, config: HostConfig) -> Result<Xf<SpiChip<Self>>, XfError> {
        let pacing = if self.int0 == Int0::None { HostPacing::Idle } else { HostPacing::Int0 };
        Xf::over(SpiChip::over("xf-spi:test", self, SPEED_HZ), HostConfig { pacing, ..config })
    }

    /// Resets the chip from outside; it then checks by CRC-32.
    pub fn reset_chip(&mut self) {
        let mut packet = [0; MAX_PACKET];
        let size = self.port.chip().size();
        let packet =
            write_request(&mut packet, size, CheckRule::CRC32, CommandHeader::with_index(0), &Request::from(WarmReset))
                .expect("it fits");
        self.advance(self.now + 1_000_000);
        self.port.transfer(self.now, packet, &mut vec![0; packet.len()]);
        self.look();
    }

    /// Reads INT0 and queues its edges.
    fn look(&mut self) {
        let level = self.port.chip_mut().int0(self.now);
        let is_new = std::mem::replace(&mut self.level, level) != level;
        if is_new && self.int0 == Int0::To(if level { Level::High } else { Level::Low }) {
            self.all_edges += 1;
            let is_lost = self.loses_every > 0 && self.all_edges.is_multiple_of(self.loses_every);
            self.edges += u32::from(!is_lost);
        }
    }

    /// Lets time pass up to then. INT0 changes at only one time while nothing is exchanged.
    fn advance(&mut self, to: Ns) {
        let ready_at = self.port.chip().ready_at();
        if self.now < ready_at && ready_at <= to {
            self.now = ready_at;
            self.look();
        }
        self.now = self.now.max(to);
        self.look();
    }
}

impl EdgeWires for ChipWires {
    fn now_ns(&self) -> u64 {
        self.now
    }

    fn sleep(&mut self, time: Duration) {
        self.advance(self.now + time.as_nanos() as Ns);
    }

    fn exchange(&mut self, tx: &[u8], rx: &mut [u8]) -> Result<(), SpiError> {
        self.lengths.push(tx.len());
        if self.failures > 0 {
            self.failures -= 1;
            return Err(SpiError::Refused { what: "exchange".into(), message: "no such device".into() });
        }
        let last = tx.len() - 1;
        self.port.transfer(self.now, &tx[..last], &mut rx[..last]);
        self.advance(self.now + tx.len() as Ns * 8 * 1_000_000_000 / Ns::from(SPEED_HZ));
        self.port.transfer(self.now, &tx[last..], &mut rx[last..]);
        self.look();
        Ok(())
    }

    fn has_ready_line(&self) -> bool {
        self.int0 != Int0::None
    }

    fn forget_edges(&mut self) -> Result<(), SpiError> {
        self.edges = 0;
        Ok(())
    }

    fn wait_edge(&mut self, limit: Duration) -> Result<bool, SpiError> {
        let end = self.now + limit.as_nanos() as Ns;
        while self.edges == 0 && self.now < end && self.has_ready_line() {
            let ready_at = self.port.chip().ready_at();
            self.advance(if self.now < ready_at { ready_at.min(end) } else { end });
        }
        Ok(std::mem::take(&mut self.edges) > 0)
    }

    fn interrupt_is_high(&mut self) -> Result<Option<bool>, SpiError> {
        Ok(Some(self.port.chip_mut().int1(self.now)))
    }

    fn reset(&mut self, low: Duration) -> Result<bool, SpiError> {
        self.resets.lock().expect("no test panics with it").push(low);
        self.advance(self.now + low.as_nanos() as Ns);
        self.port.reset(self.now);
        self.look();
        Ok(true)
    }
}

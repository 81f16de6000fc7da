//! The link's thread: one exchange after another, as the pacer plans them.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use parking_lot::Mutex;

use super::begin::{BUSY_IS_LOW, busy_is_high};
use super::desk::Desk;
use super::judge::{Judge, Lie};
use super::options::SpiOptions;
use super::pacer::{Carry, Ns, Pacer, PacerCounts, Plan};
use crate::io::spi::{WireError, Wires};
use crate::link::LinkError;
use crate::sk::{CrcPolicy, Frame, MasterCommand};

/// The link looks whether it is to end at least this often while BUSY is high. \[OURS]
const LOOK_EVERY: Duration = Duration::from_millis(20);
/// Answers in a row that are none before the board counts as lost. \[OURS]
const BAD: u32 = 16;
/// Why the link ends after SW_RESET.
const WAS_RESET: &str = "it was reset (SW_RESET)";
/// A board processes a frame in less than a cycle: one that is busy for longer than this after SW_RESET starts up. \[OURS]
const STARTS_UP: Duration = Duration::from_millis(20);
/// Good answers after SW_RESET, of which the first may be an old one, that show that the board has refused it. \[OURS]
const REFUSED_IT: u32 = 4;
/// Exchanges between two looks whether BUSY still rises: the kernel keeps 16 edges. \[OURS]
const LOOK_AT_EDGES: u32 = 16;

/// What the link's thread and its owner share.
pub(super) struct Shared {
    pub name: String,
    pub desk: Desk,
    pub opened: Instant,
    pub counts: Mutex<PacerCounts>,
    /// The cycle that OP has, or will have, us.
    pub cycle_us: AtomicU64,
    /// Answers that were none.
    pub garbled: AtomicU64,
}

impl Shared {
    pub fn now(&self) -> Ns {
        Ns::try_from(self.opened.elapsed().as_nanos()).unwrap_or(Ns::MAX)
    }

    fn instant(&self, at: Ns) -> Instant {
        self.opened + Duration::from_nanos(at)
    }
}

/// However the thread ends, no call waits for it.
struct EndOnExit(Arc<Shared>);

impl Drop for EndOnExit {
    fn drop(&mut self) {
        self.0.desk.end();
    }
}

pub(super) struct Runner {
    pub shared: Arc<Shared>,
    pub wires: Box<dyn Wires>,
    pub options: SpiOptions,
    pub pacer: Pacer,
    pub judge: Judge,
    /// How many good answers show that the board is there still, after a SW_RESET that it may have refused.
    pub doubt: u32,
}

/// Why the thread ends.
enum Over {
    Closed,
    Lost(String),
}

impl From<WireError> for Over {
    fn from(error: WireError) -> Self {
        Self::Lost(error.to_string())
    }
}

impl Runner {
    pub fn run(mut self) {
        let _end = EndOnExit(self.shared.clone());
        let (mut command, mut answer) = (Frame::new(), Frame::new());
        let (mut bad, mut since_edge) = (0, 0);
        let over = loop {
            if let Err(over) = self.step(&mut command, &mut answer, &mut bad, &mut since_edge) {
                break over;
            }
        };
        if let Over::Lost(reason) = over {
            let name = self.shared.name.clone();
            self.shared.desk.lose(LinkError::Lost { name, reason: reason.into() });
        }
    }

    fn step(
        &mut self,
        command: &mut Frame,
        answer: &mut Frame,
        bad: &mut u32,
        since_edge: &mut u32,
    ) -> Result<(), Over> {
        let (carry, extra) = self.wait_for_turn()?;
        self.wait_ready()?;
        // While BUSY was high the host may have taken its frames back.
        let carry = match carry {
            Carry::Host if !self.shared.desk.take(command) => Carry::Status,
            carry => carry,
        };
        if carry != Carry::Host {
            self.pacer.own_frame(carry, command);
        }
        let at = self.shared.now();
        self.pacer.begins(command, carry, extra, at);
        let size = self.options.slot;
        self.wires.exchange(command.wire(size), &mut answer.bytes_mut()[..size.frame_len()])?;
        self.pacer.ended(self.shared.now());
        self.publish_counts();
        if self.wires.has_busy() {
            *since_edge += 1;
            if *since_edge >= LOOK_AT_EDGES {
                *since_edge = 0;
                if !self.wires.has_fallen()? {
                    return Err(Over::Lost(BUSY_IS_LOW.to_owned()));
                }
            }
        }
        self.hear(answer, extra, at, bad)?;
        let resets = carry == Carry::Host
            && matches!(MasterCommand::decode(&command.slot(size, 0), size), Ok(MasterCommand::SoftReset));
        if resets {
            // A board that checks CRCs refuses it with another one than its own: what comes next tells.
            if command.check_crc(size, CrcPolicy::Strict).is_ok() {
                return Err(Over::Lost(WAS_RESET.to_owned()));
            }
            self.doubt = REFUSED_IT;
        }
        Ok(())
    }

    /// Waits until an exchange is due.
    fn wait_for_turn(&mut self) -> Result<(Carry, bool), Over> {
        let shared = Arc::clone(&self.shared);
        let mut state = shared.desk.lock();
        loop {
            let held = state.held(self.options.slot);
            if let Some(until) = state.closing()
                && ((held.frames == 0 && !self.pacer.owes_release()) || Instant::now() >= until)
            {
                return Err(Over::Closed);
            }
            match self.pacer.plan(shared.now(), held) {
                Plan::Exchange { carry, extra } => return Ok((carry, extra)),
                Plan::Wait(at) => shared.desk.wait_for_work(&mut state, shared.instant(at)),
            }
        }
    }

    /// Waits until BUSY is low.
    fn wait_ready(&mut self) -> Result<(), Over> {
        if !self.wires.busy()? {
            return Ok(());
        }
        let began = Instant::now();
        let doubts = self.doubt > 0;
        let limit = if doubts { STARTS_UP.min(self.options.busy_limit) } else { self.options.busy_limit };
        loop {
            let left = limit.saturating_sub(began.elapsed());
            if self.wires.wait_ready(left.min(LOOK_EVERY))? {
                return Ok(());
            }
            if left.is_zero() {
                return Err(Over::Lost(if doubts { WAS_RESET.to_owned() } else { busy_is_high(limit) }));
            }
            if self.shared.desk.lock().closing().is_some_and(|until| Instant::now() >= until) {
                return Err(Over::Closed);
            }
        }
    }

    /// Hands the answer on, if it is one.
    fn hear(&mut self, answer: &mut Frame, extra: bool, at: Ns, bad: &mut u32) -> Result<(), Over> {
        let Ok(response) = self.judge.look(answer) else {
            *bad += 1;
            self.shared.garbled.fetch_add(1, Ordering::Relaxed);
            self.shared.desk.no_report();
            if self.doubt > 0 && self.judge.explain() == Lie::Zeros {
                return Err(Over::Lost(WAS_RESET.to_owned()));
            }
            return if *bad < BAD { Ok(()) } else { Err(Over::Lost(self.judge.explain().to_string())) };
        };
        *bad = 0;
        self.doubt = self.doubt.saturating_sub(1);
        self.pacer.answered(&response, extra, self.shared.desk.held());
        let has_crc = answer.crc_byte() != 0 || self.judge.fills_crc();
        if self.pacer.show(answer, self.shared.desk.held()) && has_crc {
            answer.fill_crc(self.options.slot);
        }
        self.shared.desk.report(answer, at, self.pacer.op());
        Ok(())
    }

    fn publish_counts(&self) {
        *self.shared.counts.lock() = self.pacer.counts();
        self.shared.cycle_us.store(self.pacer.cycle().us().into(), Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::spi::pacer::PacerOptions;
    use crate::sk::{CycleTime, MASTER_CYCLIC, SlotSize};

    const SIZE: SlotSize = SlotSize::Bytes12;

    /// Wires to a board in OP whose FIFO stays empty; the desk is closed after so many exchanges.
    struct Constant {
        answer: Frame,
        left: u32,
        shared: Arc<Shared>,
    }

    impl Wires for Constant {
        fn exchange(&mut self, tx: &[u8], rx: &mut [u8]) -> Result<(), WireError> {
            assert_eq!(tx.len(), SIZE.frame_len());
            self.left -= 1;
            match self.left {
                0 => self.shared.desk.close(Instant::now()),
                left if left.is_multiple_of(16) => rx.fill(0xFF),
                _ => rx.copy_from_slice(self.answer.wire(SIZE)),
            }
            Ok(())
        }

        fn has_busy(&self) -> bool {
            true
        }

        fn busy(&mut self) -> Result<bool, WireError> {
            Ok(self.left.is_multiple_of(2))
        }

        fn wait_ready(&mut self, _: Duration) -> Result<bool, WireError> {
            Ok(true)
        }

        fn has_fallen(&mut self) -> Result<bool, WireError> {
            Ok(true)
        }

        fn reset(&mut self, _: Duration) -> Result<bool, WireError> {
            Ok(false)
        }
    }

    /// WIRE-51 The link's thread allocates nothing, from its first exchange to its last: frames of the host and its own,
    /// answers, some of them none, reports that are read and reports that nobody reads.
    #[test]
    fn the_links_thread_allocates_nothing() {
        let options = SpiOptions { slot: SIZE, ..SpiOptions::default() };
        let shared = Arc::new(Shared {
            name: "spi:test".to_owned(),
            desk: Desk::new(4),
            opened: Instant::now(),
            counts: Mutex::default(),
            cycle_us: AtomicU64::new(0),
            garbled: AtomicU64::new(0),
        });
        let pacer = Pacer::new(PacerOptions {
            slot: SIZE,
            cycle: CycleTime::from_us(250).expect("a cycle"),
            prefill: 0,
            period_ns: 0,
            wires_ns: 0,
        });
        let mut answer = Frame::new();
        answer.bytes_mut()[..12].copy_from_slice(&[MASTER_CYCLIC, 0, 8, 0, 0, 0, 0, 0, 160, 0, 0, 0]);
        answer.fill_crc(SIZE);
        let wires = Box::new(Constant { answer, left: 1000, shared: shared.clone() });
        let runner = Runner { shared: shared.clone(), wires, options, pacer, judge: Judge::new(SIZE), doubt: 0 };
        let host = std::thread::spawn({
            let shared = shared.clone();
            move || {
                let mut report = Frame::new();
                while shared.desk.write(&report, SIZE, Some(Duration::ZERO)).is_ok() || shared.desk.check().is_ok() {
                    // One is read where several come.
                    let _ = shared.desk.read(&mut report, Some(Duration::from_millis(1)));
                }
            }
        });
        // What a thread's first wait costs is no exchange's.
        shared.desk.wait_for_work(&mut shared.desk.lock(), Instant::now() + Duration::from_millis(1));
        let counted = allocation_counter::measure(|| runner.run());
        host.join().expect("it ends");
        assert_eq!(counted.count_total, 0, "{counted:?}");
        let counts = *shared.counts.lock();
        assert_eq!(counts.exchanges, 1000);
        assert!(counts.host > 100, "{counts:?}");
        assert!(shared.garbled.load(Ordering::Relaxed) >= 60);
    }
}

//! The link's thread, which makes one exchange after another at the times that the pacer gives.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use parking_lot::Mutex;

use super::answer_check::{AnswerCheck, WiringFault};
use super::begin::{BUSY_IS_LOW, busy_is_high};
use super::options::SpiOptions;
use super::pacer::{ExchangeContent, Pacer, PacerCounts, PacerPlan};
use super::queues::FrameQueues;
use crate::ethercat::Ns;
use crate::io::spi::{BusyWires, SpiError};
use crate::link::LinkError;
use crate::sk::{CrcPolicy, Frame, MasterCommand};

/// How often the thread checks, while BUSY is high, whether the time limit for closing the link has passed. \[OURS]
const CLOSE_CHECK_INTERVAL: Duration = Duration::from_millis(20);
/// How many invalid answers in a row mean that the board is lost. \[OURS]
const INVALID_ANSWERS_MAX: u32 = 16;
/// The reason that the link gives for the loss of the board after SW_RESET.
const WAS_RESET: &str = "it was reset (SW_RESET)";
/// BUSY is high while a board processes a frame, which takes less than a cycle. If BUSY stays high for longer than this
/// after a SW_RESET, the board is starting up. \[OURS]
const BUSY_AFTER_RESET_MAX: Duration = Duration::from_millis(20);
/// If this many valid answers follow a SW_RESET, the board has refused the command: a board that executes it starts up
/// and gives no valid answers. One answer is not enough, since the first answers may be from before the command.
/// \[OURS]
const ANSWERS_AFTER_RESET: u32 = 4;
/// How many exchanges pass between two checks that BUSY has fallen. BUSY falls once in each exchange; if the line has
/// not fallen in any of these exchanges, `busy=` names another line. The kernel stores at most 16 edges of a line until
/// they are read. \[OURS]
const EXCHANGES_PER_EDGE_CHECK: u32 = 16;

/// What the link's thread and the link share.
pub(super) struct Shared {
    pub name: String,
    pub queues: FrameQueues,
    pub opened: Instant,
    pub counts: Mutex<PacerCounts>,
    /// The cycle time of OP in microseconds, also while the board is below OP.
    pub cycle_us: AtomicU64,
    /// Number of invalid answers.
    pub invalid_answers: AtomicU64,
}

impl Shared {
    pub fn now(&self) -> Ns {
        Ns::try_from(self.opened.elapsed().as_nanos()).unwrap_or(Ns::MAX)
    }

    fn instant(&self, at: Ns) -> Instant {
        self.opened + Duration::from_nanos(at)
    }
}

/// Ends all waiting calls when the thread ends, even by a panic.
struct EndOnExit(Arc<Shared>);

impl Drop for EndOnExit {
    fn drop(&mut self) {
        self.0.queues.end();
    }
}

/// What the link's thread needs to make exchanges.
pub(super) struct Runner {
    pub shared: Arc<Shared>,
    pub wires: Box<dyn BusyWires>,
    pub options: SpiOptions,
    pub pacer: Pacer,
    pub answer_check: AnswerCheck,
    /// How many more valid answers have to come until a SW_RESET counts as refused by the board; 0: no SW_RESET with an
    /// unknown effect is pending.
    pub reset_doubt: u32,
}

/// Why the link's thread ends.
enum EndReason {
    Closed,
    Lost(String),
}

impl From<SpiError> for EndReason {
    fn from(error: SpiError) -> Self {
        Self::Lost(error.to_string())
    }
}

impl Runner {
    pub fn run(mut self) {
        let _end = EndOnExit(self.shared.clone());
        let (mut command, mut answer) = (Frame::new(), Frame::new());
        let (mut invalid, mut since_edge) = (0, 0);
        let end_reason = loop {
            if let Err(end_reason) = self.step(&mut command, &mut answer, &mut invalid, &mut since_edge) {
                break end_reason;
            }
        };
        if let EndReason::Lost(reason) = end_reason {
            let name = self.shared.name.clone();
            self.shared.queues.lose(LinkError::Lost { name, reason: reason.into() });
        }
    }

    fn step(
        &mut self,
        command: &mut Frame,
        answer: &mut Frame,
        invalid: &mut u32,
        since_edge: &mut u32,
    ) -> Result<(), EndReason> {
        let (content, extra) = self.wait_for_turn()?;
        self.wait_ready()?;
        // The oldest frame is taken only now: while BUSY was high, the program's waiting frames may have been
        // discarded.
        let content = match content {
            ExchangeContent::Host if !self.shared.queues.take(command) => ExchangeContent::Status,
            content => content,
        };
        if content != ExchangeContent::Host {
            self.pacer.own_frame(content, command);
        }
        let at = self.shared.now();
        self.pacer.begins(command, content, extra, at);
        let size = self.options.slot;
        self.wires.exchange(command.wire(size), &mut answer.bytes_mut()[..size.frame_len()])?;
        self.pacer.ended(self.shared.now());
        self.publish_counts();
        if self.wires.has_busy_line() {
            *since_edge += 1;
            if *since_edge >= EXCHANGES_PER_EDGE_CHECK {
                *since_edge = 0;
                if !self.wires.busy_has_fallen()? {
                    return Err(EndReason::Lost(BUSY_IS_LOW.to_owned()));
                }
            }
        }
        self.handle_answer(answer, extra, at, invalid)?;
        let resets = content == ExchangeContent::Host
            && matches!(MasterCommand::decode(&command.slot(size, 0), size), Ok(MasterCommand::SoftReset));
        if resets {
            // A SW_RESET with a right CRC is executed. If the CRC is wrong, a board that checks CRCs refuses the
            // command: the next answers show whether this board has refused it.
            if command.check_crc(size, CrcPolicy::Strict).is_ok() {
                return Err(EndReason::Lost(WAS_RESET.to_owned()));
            }
            self.reset_doubt = ANSWERS_AFTER_RESET;
        }
        Ok(())
    }

    /// Waits until an exchange is due. Returns what it carries, and whether it is an extra one.
    fn wait_for_turn(&mut self) -> Result<(ExchangeContent, bool), EndReason> {
        let shared = Arc::clone(&self.shared);
        let mut state = shared.queues.lock();
        loop {
            let held = state.held(self.options.slot);
            if let Some(until) = state.closing()
                && ((held.frames == 0 && !self.pacer.owes_release()) || Instant::now() >= until)
            {
                return Err(EndReason::Closed);
            }
            match self.pacer.plan(shared.now(), held) {
                PacerPlan::Exchange { content, extra } => return Ok((content, extra)),
                PacerPlan::Wait(at) => shared.queues.wait_for_work(&mut state, shared.instant(at)),
            }
        }
    }

    /// Waits until BUSY is low.
    fn wait_ready(&mut self) -> Result<(), EndReason> {
        if !self.wires.is_busy()? {
            return Ok(());
        }
        let began = Instant::now();
        let may_have_reset = self.reset_doubt > 0;
        let limit =
            if may_have_reset { BUSY_AFTER_RESET_MAX.min(self.options.busy_limit) } else { self.options.busy_limit };
        loop {
            let left = limit.saturating_sub(began.elapsed());
            if self.wires.wait_ready(left.min(CLOSE_CHECK_INTERVAL))? {
                return Ok(());
            }
            if left.is_zero() {
                return Err(EndReason::Lost(if may_have_reset { WAS_RESET.to_owned() } else { busy_is_high(limit) }));
            }
            if self.shared.queues.lock().closing().is_some_and(|until| Instant::now() >= until) {
                return Err(EndReason::Closed);
            }
        }
    }

    /// Passes a valid answer to the program as a report, and counts an invalid one.
    fn handle_answer(&mut self, answer: &mut Frame, extra: bool, at: Ns, invalid: &mut u32) -> Result<(), EndReason> {
        let Ok(response) = self.answer_check.check(answer) else {
            *invalid += 1;
            self.shared.invalid_answers.fetch_add(1, Ordering::Relaxed);
            self.shared.queues.no_report();
            if self.reset_doubt > 0 && self.answer_check.explain() == WiringFault::Zeros {
                return Err(EndReason::Lost(WAS_RESET.to_owned()));
            }
            return if *invalid < INVALID_ANSWERS_MAX {
                Ok(())
            } else {
                Err(EndReason::Lost(self.answer_check.explain().to_string()))
            };
        };
        *invalid = 0;
        self.reset_doubt = self.reset_doubt.saturating_sub(1);
        self.pacer.answered(&response, extra, self.shared.queues.held());
        let has_crc = answer.crc_byte() != 0 || self.answer_check.fills_crc();
        if self.pacer.to_report(answer, self.shared.queues.held()) && has_crc {
            answer.fill_crc(self.options.slot);
        }
        self.shared.queues.report(answer, at, self.pacer.op());
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
    use crate::hardware::spi::pacer::PacerOptions;
    use crate::sk::{CycleTime, MASTER_CYCLIC, SlotSize};

    const SIZE: SlotSize = SlotSize::Bytes12;

    /// Fake wires to a board in OP whose FIFO stays empty. After `left` exchanges they close the link.
    struct Constant {
        answer: Frame,
        left: u32,
        shared: Arc<Shared>,
    }

    impl BusyWires for Constant {
        fn exchange(&mut self, tx: &[u8], rx: &mut [u8]) -> Result<(), SpiError> {
            assert_eq!(tx.len(), SIZE.frame_len());
            self.left -= 1;
            // On a busy machine the host would get no chance before all exchanges are over.
            while self.left.is_multiple_of(4) && self.shared.queues.held() == 0 {
                std::thread::yield_now();
            }
            match self.left {
                0 => self.shared.queues.close(Instant::now()),
                left if left.is_multiple_of(16) => rx.fill(0xFF),
                _ => rx.copy_from_slice(self.answer.wire(SIZE)),
            }
            Ok(())
        }

        fn has_busy_line(&self) -> bool {
            true
        }

        fn is_busy(&mut self) -> Result<bool, SpiError> {
            Ok(self.left.is_multiple_of(2))
        }

        fn wait_ready(&mut self, _: Duration) -> Result<bool, SpiError> {
            Ok(true)
        }

        fn busy_has_fallen(&mut self) -> Result<bool, SpiError> {
            Ok(true)
        }

        fn reset(&mut self, _: Duration) -> Result<bool, SpiError> {
            Ok(false)
        }
    }

    /// The link's thread does not allocate, from its first exchange to its last. The run has frames of the host and of
    /// the link, valid and invalid answers, and reports that are read and reports that are not.
    #[test]
    fn the_links_thread_allocates_nothing() {
        let options = SpiOptions { slot: SIZE, ..SpiOptions::default() };
        let shared = Arc::new(Shared {
            name: "spi:test".to_owned(),
            queues: FrameQueues::new(4),
            opened: Instant::now(),
            counts: Mutex::default(),
            cycle_us: AtomicU64::new(0),
            invalid_answers: AtomicU64::new(0),
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
        let runner = Runner {
            shared: shared.clone(),
            wires,
            options,
            pacer,
            answer_check: AnswerCheck::new(SIZE),
            reset_doubt: 0,
        };
        let host = std::thread::spawn({
            let shared = shared.clone();
            move || {
                let mut report = Frame::new();
                while shared.queues.write(&report, SIZE, Some(Duration::ZERO)).is_ok() || shared.queues.check().is_ok()
                {
                    // The reader takes one report where several arrive, so that some are dropped unread.
                    let _ = shared.queues.read(&mut report, Some(Duration::from_millis(1)));
                }
            }
        });
        // A thread's first wait may allocate, so it happens before the measurement.
        shared.queues.wait_for_work(&mut shared.queues.lock(), Instant::now() + Duration::from_millis(1));
        let counted = allocation_counter::measure(|| runner.run());
        host.join().expect("it ends");
        assert_eq!(counted.count_total, 0, "{counted:?}");
        let counts = *shared.counts.lock();
        assert_eq!(counts.exchanges, 1000);
        assert!(counts.host > 100, "{counts:?}");
        assert!(shared.invalid_answers.load(Ordering::Relaxed) >= 60);
    }
}

//! A board as a slave on SPI: takes the bytes of an exchange and returns the answer.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use crate::link::{Link, LinkError, ReadMeta, Stamp, Wait};
use crate::sk::{FIFO_ENTRIES, Frame, MasterCommand, MasterResponse, MasterState, SlotSize};

/// How long a [`SpiBoard`] waits for the first report of its link when it starts. \[OURS]
const FIRST_REPORT_WAIT_MAX: Duration = Duration::from_secs(1);

/// How long an exchange outside OP waits for the answer to the previous frame: some cycles of the default length, and
/// time for a link whose thread is late. \[OURS]
const ANSWER_WAIT_MAX: Duration = Duration::from_millis(50);

/// Counters of the exchanges with a host on SPI.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SpiBoardCounters {
    /// The number of exchanges whose frame the board has accepted.
    pub frames: u64,
    /// The number of exchanges with fewer bytes than a frame. The board executes nothing of them.
    pub incomplete: u64,
    /// The number of exchanges while BUSY was high. They are answered with zeros, and the board executes nothing of
    /// them.
    pub while_busy: u64,
    /// The number of exchanges whose frame was not written, because the link has returned an error.
    pub refused: u64,
}

/// The number of free FIFO entries in the report before the newest one, if the board was in OP.
#[derive(Clone, Copy)]
struct ReportedFifo {
    at: Stamp,
    sequence: u64,
    free: u16,
}

/// A board as a host on SPI sees it (SK-10).
///
/// One exchange lasts while chip select is active. The answer is the newest report from before the exchange. Outside OP
/// the board executes a frame on arrival, so this is the answer to the previous frame, for which the exchange waits if
/// necessary. In OP the previous frame may still be in the FIFO. The frame is passed to the link unchanged.
///
/// \[OURS] In OP the number of free FIFO entries in an answer counts all frames of earlier exchanges as in the FIFO: it
/// is the number in the newest report, less the frames exchanged since that report. So a host that writes as many
/// frames as the number allows never overfills the FIFO.
///
/// `examples/rust/spi_board.rs` shows how another program uses an `SpiBoard`.
pub struct SpiBoard {
    link: Arc<dyn Link>,
    size: SlotSize,
    write_wait: Wait,
    /// The newest report of the board, as its link has returned it.
    report: Frame,
    /// The answer to send: the newest report with the corrected number of free entries.
    answer: Frame,
    command: Frame,
    /// When the newest frame was written; `None` once a report has answered it.
    unanswered: Option<Stamp>,
    /// Write times of the frames that the FIFO level in the newest report does not include yet; at most as many as the
    /// FIFO has entries.
    uncounted: VecDeque<Stamp>,
    /// The FIFO state in the report before the newest one: the difference shows how many frames have reached the FIFO
    /// between the two. `None`: that report was not from OP.
    before: Option<ReportedFifo>,
    /// Whether the board's reports have a CRC.
    fills_crc: bool,
    /// Why the board is lost; `None`: it is connected.
    lost: Option<LinkError>,
    counters: SpiBoardCounters,
}

impl SpiBoard {
    /// The board behind `link`. The link must have been opened with `queue=1`, so that a read returns the newest
    /// report; otherwise the answers are older reports. The slot size is that of the link, or 12 bytes if unknown.
    /// Waits up to 1 s for the first report; until there is one, the answers are zeros.
    pub fn new(link: Arc<dyn Link>) -> Self {
        let mut spi_board = Self {
            size: SlotSize::default(),
            write_wait: Wait::Forever,
            link,
            report: Frame::new(),
            answer: Frame::new(),
            command: Frame::new(),
            unanswered: None,
            uncounted: VecDeque::with_capacity(FIFO_ENTRIES.into()),
            before: None,
            fills_crc: false,
            lost: None,
            counters: SpiBoardCounters::default(),
        };
        spi_board.begin();
        spi_board
    }

    /// Continues with a board that was opened again: after SW_RESET, after a loss, and after [`Self::close`]. The old
    /// link has to be closed first, because a board cannot be opened twice.
    pub fn replace(&mut self, link: Arc<dyn Link>) {
        self.link = link;
        self.lost = None;
        self.begin();
    }

    fn begin(&mut self) {
        let info = self.link.info();
        self.size = info.slot.unwrap_or_default();
        self.write_wait = info.write_wait;
        self.report = Frame::new();
        self.unanswered = None;
        self.uncounted.clear();
        self.before = None;
        self.fills_crc = false;
        self.read_report(Wait::For(FIRST_REPORT_WAIT_MAX));
    }

    /// Performs one exchange during one chip select: `tx` are the bytes on MOSI, `rx` gets those on MISO.
    ///
    /// Bytes beyond the length of a frame are ignored and answered with zeros. Fewer bytes are not a frame; the next
    /// chip select begins a new one \[OURS]. While BUSY is high the answer is zeros and nothing is executed \[OURS].
    pub fn exchange(&mut self, tx: &[u8], rx: &mut [u8]) {
        rx.fill(0);
        if self.is_busy() {
            self.counters.while_busy += 1;
            return;
        }
        self.read_reports();
        self.count_frames();
        let wire = self.answer.wire(self.size);
        let count = wire.len().min(rx.len());
        rx[..count].copy_from_slice(&wire[..count]);
        if tx.len() < self.size.frame_len() {
            self.counters.incomplete += 1;
            return;
        }
        self.command.set_prefix(&tx[..self.size.frame_len()]);
        match self.link.write(&self.command, self.write_wait) {
            Ok(at) => {
                self.counters.frames += 1;
                self.unanswered = Some(at);
                if self.uncounted.len() < FIFO_ENTRIES.into() {
                    self.uncounted.push_back(at);
                }
            }
            Err(error) => {
                self.counters.refused += 1;
                self.note(error);
            }
        }
    }

    /// The level of BUSY between two exchanges: high while the board is gone, as when it starts up (SK-10). The caller,
    /// which drives the wires, also has to set BUSY high from the start of [`Self::exchange`] until it returns.
    pub fn is_busy(&self) -> bool {
        self.lost.is_some() || self.link.check().is_err()
    }

    /// RESETN was low for more than 32 us (SK-10): the board starts up, and [`Self::is_busy`] is true until
    /// [`Self::replace`].
    pub fn reset(&mut self) {
        self.command = Frame::new();
        self.command.put_master(self.size, &MasterCommand::SoftReset);
        self.command.fill_crc(self.size);
        if let Err(error) = self.link.write(&self.command, self.write_wait) {
            self.note(error);
        }
        self.lost.get_or_insert(LinkError::Lost { name: self.link.info().name, reason: "it was reset".into() });
    }

    /// Closes the link; [`Self::is_busy`] is true until [`Self::replace`].
    pub fn close(&mut self) {
        self.link.close();
    }

    /// Why the board is lost; `None`: it is connected.
    pub fn lost(&self) -> Option<LinkError> {
        self.lost.clone().or_else(|| self.link.check().err())
    }

    /// The length of a frame on the wires: 504 or 512 bytes.
    pub const fn frame_len(&self) -> usize {
        self.size.frame_len()
    }

    /// The counters since this value was made; [`Self::replace`] keeps them.
    pub const fn counters(&self) -> SpiBoardCounters {
        self.counters
    }

    /// Reads the newest report. Outside OP, waits for a report that answers the newest frame.
    fn read_reports(&mut self) {
        self.read_report(Wait::Now);
        // The first reports may have been made before the newest frame. Outside OP they are skipped, until one answers
        // that frame or none comes within `ANSWER_WAIT_MAX`.
        while self.unanswered.is_some() && !self.in_op() && self.read_report(Wait::For(ANSWER_WAIT_MAX)) {}
        self.unanswered = None;
    }

    /// Removes from `uncounted` the frames that the newest report includes: those written before it, as far as they can
    /// have reached the FIFO by then. A frame that is still in transit inside this machine while the board makes a
    /// report is included in the next report. The board takes at most one entry per cycle out of the FIFO, so the two
    /// newest reports show how many entries have arrived between them.
    fn count_by_report(&mut self, report: ReadMeta) {
        let master = MasterResponse::decode(&self.report.slot(self.size, 0));
        let seen = (master.state.state() == Some(MasterState::Op)).then_some(ReportedFifo {
            at: report.at,
            sequence: report.sequence,
            free: master.fifo_free,
        });
        let (mut came, mut before_that) = (usize::MAX, Stamp(0));
        if let (Some(now), Some(before)) = (seen, self.before) {
            let cycles = now.sequence.saturating_sub(before.sequence);
            came = usize::try_from((u64::from(before.free) + cycles).saturating_sub(now.free.into()))
                .unwrap_or(usize::MAX);
            before_that = before.at;
        }
        self.before = seen;
        while let Some(written) = self.uncounted.front()
            && *written <= report.at
            // A frame reaches the FIFO within a cycle. A frame that was written before the previous report and has
            // still not used an entry was refused by the board, so it is removed too.
            && (came > 0 || *written <= before_that)
        {
            came = came.saturating_sub(1);
            self.uncounted.pop_front();
        }
    }

    /// Builds the answer from the newest report, with the number of free entries reduced by the frames exchanged since.
    fn count_frames(&mut self) {
        self.answer.clone_from(&self.report);
        if self.uncounted.is_empty() || !self.in_op() {
            return;
        }
        let mut master = self.answer.slot(self.size, 0);
        let free = MasterResponse::decode(&master).fifo_free.saturating_sub(self.uncounted.len() as u16);
        master.data2 = master.data2 & 0xFFFF_0000 | u32::from(free);
        self.answer.put(self.size, 0, &master);
        if self.fills_crc {
            self.answer.fill_crc(self.size);
        }
    }

    fn in_op(&self) -> bool {
        MasterResponse::decode(&self.report.slot(self.size, 0)).state.state() == Some(MasterState::Op)
    }

    /// Reads a report if a new one comes within `wait`. Returns whether one has come.
    fn read_report(&mut self, wait: Wait) -> bool {
        match self.link.read(&mut self.report, wait) {
            Ok(report) => {
                self.unanswered = self.unanswered.filter(|written| report.at < *written);
                self.count_by_report(report);
                self.fills_crc |= self.report.crc_byte() != 0;
                true
            }
            Err(error) => {
                self.note(error);
                false
            }
        }
    }

    fn note(&mut self, error: LinkError) {
        if matches!(error, LinkError::Lost { .. } | LinkError::Closed) {
            self.lost = Some(error);
        }
    }
}

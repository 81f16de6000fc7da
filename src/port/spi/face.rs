//! One board on SPI: exchanges in, answers out.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use crate::link::{Link, LinkError, ReadMeta, Stamp, Wait};
use crate::sk::{FIFO_ENTRIES, Frame, MasterCommand, MasterResponse, MasterState, SlotSize};

/// How long a board that was just given to a [`Face`] may take for its first report. \[OURS]
const FIRST_REPORT: Duration = Duration::from_secs(1);

/// How long an exchange waits for the answer to the frame before, outside OP: cycles of the default length, and patience
/// with a link whose thread is late. \[OURS]
const ANSWER: Duration = Duration::from_millis(50);

/// What was exchanged, and what was not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FaceCounters {
    /// Exchanges whose frame the board has taken.
    pub frames: u64,
    /// Exchanges of fewer bytes than a frame has; the board executes nothing of them.
    pub incomplete: u64,
    /// Exchanges while BUSY was high: zeros were answered and nothing was executed.
    pub while_busy: u64,
    /// Frames that the link did not take.
    pub refused: u64,
}

/// What counts of a report in OP.
#[derive(Clone, Copy)]
struct Seen {
    at: Stamp,
    sequence: u64,
    free: u16,
}

/// A board as a host on SPI sees it (SK-10).
///
/// One exchange is one chip select. What is answered is the newest report before it: outside OP, where a board executes a
/// frame on arrival, that is the answer to the frame before, for which the exchange waits if it has to; in OP the frame
/// before may still be in the FIFO. The frame goes to the link as it is.
///
/// \[OURS] The free count of an answer in OP is that after the exchange before, however many there are in a cycle: what the
/// newest report says, less the frames that were exchanged since. A host that writes as much as the count allows never
/// overfills the FIFO.
///
/// `examples/rust/spi_face.rs` feeds one from another program.
pub struct Face {
    link: Arc<dyn Link>,
    size: SlotSize,
    write_wait: Wait,
    /// The newest report, as the link gave it.
    report: Frame,
    /// What is answered.
    answer: Frame,
    command: Frame,
    /// When the newest frame was written, if no report has answered it yet.
    unanswered: Option<Stamp>,
    /// When each frame was written that the newest report does not count yet: no more than the FIFO has entries.
    uncounted: VecDeque<Stamp>,
    /// The report before the newest one that was read.
    before: Option<Seen>,
    /// The board fills the CRC of its reports.
    fills_crc: bool,
    lost: Option<LinkError>,
    counters: FaceCounters,
}

impl Face {
    /// The board behind a link that was opened with `queue=1`, so that a read gives its newest report. Its slot size is
    /// what the link says, else 12 bytes. Waits up to 1 s for its first report: without one it answers zeros.
    pub fn new(link: Arc<dyn Link>) -> Self {
        let mut face = Self {
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
            counters: FaceCounters::default(),
        };
        face.begin();
        face
    }

    /// The same wires with the board opened again, after SW_RESET or a loss and after [`Self::close`]: no board is opened
    /// twice.
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
        self.look(Wait::For(FIRST_REPORT));
    }

    /// One exchange under one chip select: `tx` are the bytes on MOSI, `rx` becomes those on MISO.
    ///
    /// Bytes beyond the board's frame are ignored and answered by zeros; fewer are no frame, and the next chip select
    /// begins a new one \[OURS]. While BUSY is high zeros are answered and nothing is executed \[OURS].
    pub fn exchange(&mut self, tx: &[u8], rx: &mut [u8]) {
        rx.fill(0);
        if self.is_busy() {
            self.counters.while_busy += 1;
            return;
        }
        self.hear();
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

    /// BUSY between two exchanges: high while there is no board, which is what starting up looks like (SK-10). A wire
    /// shows it high from the start of [`Self::exchange`] to its end too.
    pub fn is_busy(&self) -> bool {
        self.lost.is_some() || self.link.check().is_err()
    }

    /// RESETN low for more than 32 us (SK-10): the board boots, [`Self::is_busy`] until [`Self::replace`].
    pub fn reset(&mut self) {
        self.command = Frame::new();
        self.command.put_master(self.size, &MasterCommand::SoftReset);
        self.command.fill_crc(self.size);
        if let Err(error) = self.link.write(&self.command, self.write_wait) {
            self.note(error);
        }
        self.lost.get_or_insert(LinkError::Lost { name: self.link.info().name, reason: "it was reset".into() });
    }

    /// Gives the board back, [`Self::is_busy`] until [`Self::replace`].
    pub fn close(&mut self) {
        self.link.close();
    }

    /// Why there is no board any more; `None`: it is there.
    pub fn lost(&self) -> Option<LinkError> {
        self.lost.clone().or_else(|| self.link.check().err())
    }

    /// Bytes that count in an exchange: 504 or 512.
    pub const fn frame_len(&self) -> usize {
        self.size.frame_len()
    }

    /// What was exchanged so far.
    pub const fn counters(&self) -> FaceCounters {
        self.counters
    }

    /// The newest report, and outside OP one that answers the newest frame.
    fn hear(&mut self) {
        self.look(Wait::Now);
        // Several reports may be older than the frame.
        while self.unanswered.is_some() && !self.in_op() && self.look(Wait::For(ANSWER)) {}
        self.unanswered = None;
    }

    /// Which frames the newest report counts: those written before it, so far as they can have been in the FIFO. A frame that is
    /// on its way in the machine while the board makes a report is in the next one. In each cycle the board takes at most one
    /// out, so that the two newest reports show how many have come between them.
    fn count_by_report(&mut self, report: ReadMeta) {
        let master = MasterResponse::decode(&self.report.slot(self.size, 0));
        let seen = (master.state.state() == Some(MasterState::Op)).then_some(Seen {
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
            // One cycle is time enough: a frame that the board did not keep is not waited for.
            && (came > 0 || *written <= before_that)
        {
            came = came.saturating_sub(1);
            self.uncounted.pop_front();
        }
    }

    /// Makes the answer of the newest report, with the frames counted that were exchanged since.
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

    /// Takes the newest report, if there is one since the last look.
    fn look(&mut self, wait: Wait) -> bool {
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

//! One board on SPI: exchanges in, answers out.

use std::sync::Arc;
use std::time::Duration;

use crate::link::{Link, LinkError, Stamp, Wait};
use crate::sk::{Frame, MasterCommand, MasterResponse, MasterState, SlotSize};

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

/// A board as a host on SPI sees it (SK-10).
///
/// One exchange is one chip select. What is answered is the newest report before it: outside OP, where a board executes a
/// frame on arrival, that is the answer to the frame before, for which the exchange waits if it has to; in OP the frame
/// before may still be in the FIFO. The frame goes to the link as it is.
pub struct Face {
    link: Arc<dyn Link>,
    size: SlotSize,
    write_wait: Wait,
    answer: Frame,
    command: Frame,
    /// When the newest frame was written, if no report has answered it yet.
    unanswered: Option<Stamp>,
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
            answer: Frame::new(),
            command: Frame::new(),
            unanswered: None,
            lost: None,
            counters: FaceCounters::default(),
        };
        face.begin();
        face
    }

    /// The same wires with the board opened again, after SW_RESET or a loss.
    pub fn replace(&mut self, link: Arc<dyn Link>) {
        self.link = link;
        self.lost = None;
        self.begin();
    }

    fn begin(&mut self) {
        let info = self.link.info();
        self.size = info.slot.unwrap_or_default();
        self.write_wait = info.write_wait;
        self.answer = Frame::new();
        self.unanswered = None;
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

    fn in_op(&self) -> bool {
        MasterResponse::decode(&self.answer.slot(self.size, 0)).state.state() == Some(MasterState::Op)
    }

    /// Takes the newest report, if there is one since the last look.
    fn look(&mut self, wait: Wait) -> bool {
        match self.link.read(&mut self.answer, wait) {
            Ok(report) => {
                self.unanswered = self.unanswered.filter(|written| report.at < *written);
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

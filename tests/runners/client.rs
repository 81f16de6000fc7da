//! A program on a link: writes typed commands, reads typed answers.

use std::sync::Arc;
use std::time::Duration;

use ecmsk::engine::{Board, EngineConfig};
use ecmsk::fieldbus::Ns;
use ecmsk::fieldbus::sim::{SimBus, SimHandle};
use ecmsk::link::engine::{EngineLink, Keeper, RunOptions};
use ecmsk::link::{Link, LinkError, ReadMeta, Wait};
use ecmsk::sk::{
    Frame, MasterCommand, MasterResponse, MasterState, Motion, RawSlot, SdoCommand, SlaveCommand, SlaveKind, SlotSize,
    StateByte,
};
use ecmsk::slave::{Drive, DriveConfig, Slave};

pub const SIZE: SlotSize = SlotSize::Bytes12;
pub const MS: Ns = 1_000_000;
/// A wait that ends with an error if the board hangs.
pub const PATIENCE: Wait = Wait::For(Duration::from_secs(60));

/// A board with that many servo drives that has booted, and its network.
pub fn board(drives: usize) -> (Board, SimHandle) {
    let slave = |_| Box::new(Drive::new(DriveConfig::default())) as Box<dyn Slave>;
    let bus = SimBus::new((0..drives).map(slave).collect());
    let network = bus.handle();
    let mut board = Board::new(EngineConfig::default(), Box::new(bus));
    assert!(board.boot(60_000 * MS));
    (board, network)
}

/// A program on the link to such a board.
pub fn open(drives: usize, options: RunOptions) -> (Client, SimHandle) {
    open_kept(drives, options, None)
}

pub fn open_kept(drives: usize, options: RunOptions, keeper: Option<Keeper>) -> (Client, SimHandle) {
    let (board, network) = board(drives);
    (Client::on(Arc::new(EngineLink::open("board", board, options, keeper).unwrap())), network)
}

/// The program.
pub struct Client {
    pub link: Arc<dyn Link>,
    pub report: Frame,
}

impl Client {
    pub fn on(link: Arc<dyn Link>) -> Self {
        Self { link, report: Frame::new() }
    }

    pub fn write(&self, frame: &Frame) {
        self.link.write(frame, Wait::Forever).unwrap();
    }

    pub fn master(&self, command: MasterCommand) {
        let mut frame = Frame::new();
        frame.put_master(SIZE, &command);
        self.write(&frame);
    }

    pub fn slave(&self, slave: usize, command: SlaveCommand) {
        let mut frame = Frame::new();
        frame.put_slave(SIZE, slave, &command.into());
        self.write(&frame);
    }

    pub fn sdo(&self, command: SdoCommand) {
        let mut frame = Frame::new();
        frame.put_sdo(SIZE, &command);
        self.write(&frame);
    }

    pub fn try_read(&mut self, wait: Wait) -> Result<ReadMeta, LinkError> {
        self.link.read(&mut self.report, wait)
    }

    pub fn read(&mut self) -> ReadMeta {
        self.try_read(PATIENCE).unwrap()
    }

    pub fn answer(&self) -> MasterResponse {
        MasterResponse::decode(&self.report.slot(SIZE, 0))
    }

    pub fn slot(&self, slot: usize) -> RawSlot {
        self.report.slot(SIZE, slot)
    }

    /// Reads until a report satisfies `done`.
    pub fn until(&mut self, what: &str, done: impl Fn(&Self) -> bool) {
        for _ in 0..60_000 {
            self.read();
            if done(self) {
                return;
            }
        }
        panic!("never: {what}; {:?}", self.answer());
    }

    pub fn go(&mut self, state: MasterState) {
        self.master(MasterCommand::SetState(state));
        self.until("the state", |client| client.answer().state == StateByte::reached(state));
    }

    /// All slaves are drives; then OP.
    pub fn op(&mut self) {
        for group in 0..5 {
            self.master(MasterCommand::SetAxis { group, kinds: [SlaveKind::Drive; 8] });
        }
        self.go(MasterState::Op);
    }
}

/// A frame with a target for slave 1 and that index.
pub fn target(counts: i32, index: u8) -> Frame {
    let mut frame = Frame::new();
    frame.put_slave(SIZE, 1, &SlaveCommand::Csp(Motion::to(counts)).with_index(index));
    frame
}

pub fn soft_reset() -> Frame {
    let mut frame = Frame::new();
    frame.put_master(SIZE, &MasterCommand::SoftReset);
    frame
}

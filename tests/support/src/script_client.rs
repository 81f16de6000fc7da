//! A program on a simulated board with a script.

use std::fs;
use std::path::PathBuf;
use std::sync::Arc;

use ecmsk::link::options::SimOptions;
use ecmsk::link::slaves::SlaveSpec;
use ecmsk::link::uri::LinkUri;
use ecmsk::link::{self, Link, LinkError, ReadMeta, Share, Wait};
use ecmsk::sk::{Frame, MasterCommand, MasterResponse, MasterState, RawSlot, SlaveKind, SlotSize, StateByte};

use crate::out_dir;

pub const SIZE: SlotSize = SlotSize::Bytes12;
pub const MS: u64 = 1_000_000;

pub fn slaves(list: &str) -> Vec<SlaveSpec> {
    let uri = LinkUri::parse(&format!("sim:?slaves={list}")).expect(list);
    SimOptions::from_uri(&uri).expect(list).slaves
}

/// A file of that text. A name may have a point: the ending comes behind the whole of it.
pub fn file(name: &str, text: &str) -> PathBuf {
    let file = out_dir().join(format!("{name}.ecmscript"));
    fs::write(&file, text).expect("a file in the target folder");
    file
}

/// A program on a board of two drives with that script.
pub struct Client {
    pub link: Arc<dyn Link>,
    pub report: Frame,
    pub zero: u64,
    kinds: Vec<SlaveKind>,
}

impl Client {
    pub fn open(name: &str, options: &str, script: &str) -> Self {
        Self::with("drive*2", name, options, script)
    }

    /// The same on a board of those slaves.
    pub fn with(list: &str, name: &str, options: &str, script: &str) -> Self {
        let uri = format!("sim:?slaves={list}&{options}&script={}", file(name, script).display());
        let link = link::open(&uri, Share::ByName).unwrap_or_else(|error| panic!("{uri}: {error}"));
        let zero = link.info().opened_at.0;
        let kinds = slaves(list).into_iter().map(|slave| slave.model.kind()).collect();
        Self { link, report: Frame::new(), zero, kinds }
    }

    /// The same on a virtual clock.
    pub fn stepped(name: &str, script: &str) -> Self {
        Self::open(name, "clock=virtual", script)
    }

    pub fn try_read(&mut self) -> Result<ReadMeta, LinkError> {
        self.link.read(&mut self.report, Wait::Forever)
    }

    /// Reads a report and returns its time since the opening of the link.
    pub fn read(&mut self) -> u64 {
        self.try_read().expect("a report").at.0 - self.zero
    }

    pub fn write(&self, put: impl FnOnce(&mut Frame)) {
        let mut frame = Frame::new();
        put(&mut frame);
        self.link.write(&frame, Wait::Forever).expect("written");
    }

    pub fn answer(&self) -> MasterResponse {
        MasterResponse::decode(&self.report.slot(SIZE, 0))
    }

    pub fn slot(&self, slot: usize) -> RawSlot {
        self.report.slot(SIZE, slot)
    }

    /// Reads until `so` holds; returns the time of that report.
    pub fn until(&mut self, what: &str, so: impl Fn(&Self) -> bool) -> u64 {
        for _ in 0..100_000 {
            let at = self.read();
            if so(self) {
                return at;
            }
        }
        panic!("never: {what}; {:?}", self.answer());
    }

    pub fn declare(&self) {
        for group in 0..5u8 {
            let kind = |k| self.kinds.get(usize::from(group) * 8 + k).copied().unwrap_or(SlaveKind::None);
            let kinds = std::array::from_fn(kind);
            self.write(|f| f.put_master(SIZE, &MasterCommand::SetAxis { group, kinds }));
        }
    }

    pub fn request(&self, state: MasterState) {
        self.write(|f| f.put_master(SIZE, &MasterCommand::SetState(state)));
    }

    pub fn op(&mut self) {
        self.declare();
        self.request(MasterState::Op);
        self.until("OP", |c| c.answer().state == StateByte::reached(MasterState::Op));
    }
}

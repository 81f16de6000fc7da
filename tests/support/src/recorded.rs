//! A recorded program on a simulated board, to be compared with another run of it.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use ecmsk::coe::{ObjectAddress, SdoSize};
use ecmsk::link::{self, Link, Share, Wait};
use ecmsk::sk::{
    DriveResponse, Frame, MasterCommand, MasterResponse, MasterState, Motion, SdoCommand, SdoResponse, SlaveCommand,
    SlaveKind, SlotSize,
};
use tempfile::TempDir;

pub const SIZE: SlotSize = SlotSize::Bytes12;
/// Targets of the motion.
pub const TARGETS: i32 = 300;
/// Commands before the first target: SET_AXIS, SET_DC, SET_STATE, SV_ON.
pub const BEFORE: u64 = 4;

/// A program: two drives move, an IO slave gets outputs. A test chooses how its runs differ.
pub struct Program {
    /// The scheme of the link.
    pub scheme: &'static str,
    /// Keys of the link behind `clock=virtual`.
    pub keys: String,
    /// Lines of a script of the board.
    pub script: String,
    /// Frames of nothing but GET_STATUS before each report that the program waits for.
    pub polls: usize,
    /// How often it repeats a command until it is carried out.
    pub repeats: usize,
    /// A change of one target: its number and the counts that are added.
    pub other_target: Option<(i32, i32)>,
    /// The value that it writes to an object of drive 1.
    pub home_offset: u32,
    /// EtherCAT cycle.
    pub cycle_us: u32,
    /// Whether it stops after the motion.
    pub short: bool,
    /// Pauses: before the target of this number it only reads that many reports.
    pub pauses: &'static [(i32, usize)],
}

impl Default for Program {
    fn default() -> Self {
        Self {
            scheme: "sim",
            keys: String::new(),
            script: String::new(),
            polls: 0,
            repeats: 1,
            other_target: None,
            home_offset: 0,
            cycle_us: 1000,
            short: false,
            pauses: &[],
        }
    }
}

/// A recording in a folder of its own.
pub struct Run {
    _folder: TempDir,
    pub file: PathBuf,
}

impl Run {
    pub fn path(&self) -> &str {
        self.file.to_str().expect("UTF-8")
    }
}

struct Host {
    link: Arc<dyn Link>,
    report: Frame,
    polls: usize,
    repeats: usize,
}

impl Host {
    fn write(&self, put: impl FnOnce(&mut Frame)) {
        let mut frame = Frame::new();
        put(&mut frame);
        frame.fill_crc(SIZE);
        self.link.write(&frame, Wait::Forever).expect("written");
    }

    fn say(&self, put: impl Fn(&mut Frame)) {
        for _ in 0..self.repeats {
            self.write(&put);
        }
    }

    fn until(&mut self, what: &str, so: impl Fn(&Frame) -> bool) {
        for _ in 0..20_000 {
            // In OP a poll takes an entry of the FIFO, too, so it is sent only if there is room.
            let board = board(&self.report);
            if board.state.state() != Some(MasterState::Op) || board.fifo_free == 160 {
                for _ in 0..self.polls {
                    self.write(|_| {});
                }
            }
            self.link.read(&mut self.report, Wait::Forever).expect("a report");
            if so(&self.report) {
                return;
            }
        }
        panic!("never: {what}");
    }

    fn state(&mut self, state: MasterState) {
        self.say(|frame| frame.put_master(SIZE, &MasterCommand::SetState(state)));
        self.until("the state", |report| board(report).state.state() == Some(state));
    }
}

fn board(report: &Frame) -> MasterResponse {
    MasterResponse::decode(&report.slot(SIZE, 0))
}

fn drive(report: &Frame, slave: usize) -> DriveResponse {
    DriveResponse::decode(&report.slot(SIZE, slave))
}

impl Program {
    /// Runs it in virtual time.
    pub fn record(&self) -> Run {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("run.pcapng");
        let script = folder.path().join("script");
        self.record_to(&file, &script);
        Run { _folder: folder, file }
    }

    /// The same to files of the caller's: the recording, and the script if there is one.
    pub fn record_to(&self, file: &Path, script: &Path) {
        let Self { scheme, keys, polls, repeats, .. } = self;
        let mut uri = format!("{scheme}:?slaves=drive*2,io&clock=virtual&record={}{keys}", file.display());
        if !self.script.is_empty() {
            std::fs::write(script, &self.script).expect("a file");
            uri += &format!("&script={}", script.display());
        }
        let link = link::open(&uri, Share::ByName).unwrap_or_else(|error| panic!("{uri}: {error}"));
        let mut host = Host { link, report: Frame::new(), polls: *polls, repeats: *repeats };
        let mut kinds = [SlaveKind::None; 8];
        kinds[..3].copy_from_slice(&[SlaveKind::Drive, SlaveKind::Drive, SlaveKind::Io]);
        host.write(|frame| frame.put_master(SIZE, &MasterCommand::SetAxis { group: 0, kinds }));
        let cycle = ecmsk::sk::CycleTime::from_us(self.cycle_us).expect("a cycle");
        let shift = ecmsk::sk::DcShift::Auto;
        host.write(|frame| frame.put_master(SIZE, &MasterCommand::SetDc { cycle, shift }));
        host.state(MasterState::Op);
        host.say(|frame| {
            for slave in 1..=2 {
                frame.put_slave(SIZE, slave, &SlaveCommand::ServoOn.into());
            }
        });
        host.until("servo on", |report| (1..=2).all(|n| drive(report, n).statusword.is_enabled()));
        self.motion(&mut host);
        // A program that finds an alarm ends.
        if !self.short && drive(&host.report, 2).error_code == 0 {
            self.rest(&mut host);
        }
        host.link.close();
    }

    fn motion(&self, host: &mut Host) {
        for i in 0..TARGETS {
            for _ in self.pauses.iter().filter(|(target, _)| *target == i).flat_map(|(_, reports)| 0..*reports) {
                host.link.read(&mut host.report, Wait::Forever).expect("a report");
            }
            let other = self.other_target.filter(|(number, _)| *number == i).map_or(0, |(_, counts)| counts);
            host.write(|frame| {
                for slave in 1..=2 {
                    let target = 10 * (i + 1) * slave as i32 + if slave == 2 { other } else { 0 };
                    let motion = SlaveCommand::Csp(Motion::to(target)).with_index((i + 1) as u8);
                    frame.put_slave(SIZE, slave, &motion);
                }
            });
            // Some targets wait in the FIFO, so that none comes late.
            if i >= 8 {
                host.link.read(&mut host.report, Wait::Forever).expect("a report");
            }
        }
        let there = |report: &Frame| {
            let drive = drive(report, 2);
            board(report).fifo_free == 160 && (drive.position == 20 * TARGETS || drive.error_code != 0)
        };
        host.until("the end of the way", there);
        // The drives swing a little.
        for _ in 0..100 {
            host.until("they stand", |_| true);
        }
    }

    fn rest(&self, host: &mut Host) {
        host.write(|frame| frame.put_slave(SIZE, 3, &SlaveCommand::IoWrite(0x5A5A).into()));
        host.until("the inputs", |report| report.slot(SIZE, 3).data1 == 0x5A5A);
        let object = ObjectAddress::new(0x607C, 0);
        let write = SdoCommand::Write { slave: 1, object, size: SdoSize::Four, value: self.home_offset };
        host.say(|frame| frame.put_sdo(SIZE, &write));
        host.until("the SDO", |report| sdo(report).is_some());
        let read = SdoCommand::Read { slave: 1, object: ObjectAddress::new(0x1018, 4) };
        host.write(|frame| frame.put_sdo(SIZE, &read));
        host.until("the other SDO", |report| sdo(report) == Some(0x1018));
        host.state(MasterState::PreOp);
    }
}

/// The object that the SDO slot answers.
fn sdo(report: &Frame) -> Option<u16> {
    match SdoResponse::decode(&report.slot(SIZE, SIZE.sdo_slot())) {
        SdoResponse::Done { object, .. } | SdoResponse::Aborted { object, .. } => Some(object.index),
        _ => None,
    }
}

//! Code shared by tests of the verbs that talk to a board: transcripts, and reading a recording of a run.

use std::path::{Path, PathBuf};

use ecmsk::cia402::Statusword;
use ecmsk::link::Dir;
use ecmsk::recording::Recording;
use ecmsk::sk::{CommandId, DriveResponse, Frame, MasterResponse, MasterState, SlotSize};

use super::{Ran, run, run_with_input};

pub const SIZE: SlotSize = SlotSize::Bytes12;
/// The link of the tests: two drives and an IO slave on virtual time.
pub const BOARD: &str = "sim:?slaves=drive*2,io&clock=virtual";

/// The transcript of several command lines: each with its output as a user sees it, standard error first.
pub fn transcript(lines: &[&[&str]]) -> String {
    lines.iter().map(|words| transcript_entry(words, &run(*words))).collect()
}

/// The part of a transcript for one command line: the command, its output and its exit code.
pub fn transcript_entry(words: &[&str], ran: &Ran) -> String {
    let quoted: Vec<String> = words.iter().map(|word| quoted(word)).collect();
    let said: String = ran.err.lines().map(|line| format!("! {line}\n")).collect();
    let code = ran.code.map_or("no exit code".to_owned(), |code| format!("exit code {code}"));
    format!("$ ecmsk {}\n{said}{}({code})\n\n", quoted.join(" "), ran.out)
}

fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "_-./:=,+*".contains(c);
    if word.chars().all(plain) && !word.contains('*') { word.to_owned() } else { format!("'{word}'") }
}

/// The path of a file for tests. The name contains the process id, so that other processes have other files.
pub fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("tool-{}-{name}", std::process::id()))
}

/// Writes a text to the file [`file`] of this name; returns its path.
pub fn text(name: &str, text: &str) -> String {
    let file = file(name);
    std::fs::write(&file, text).expect("a file in the target folder");
    file.display().to_string()
}

/// Runs `ecmsk run` on the board with this link, with the script `lines` on standard input.
pub fn script(board: &str, lines: &str) -> Ran {
    run_with_input(&["run", "-", "--link", board], lines)
}

/// The frames in a recording: the command frames that were written, and the reports that were read.
pub struct RecordedTraffic {
    pub written: Vec<Frame>,
    pub reports: Vec<Frame>,
    size: SlotSize,
}

impl RecordedTraffic {
    pub fn read(file: &Path) -> Self {
        Self::of_size(file, SIZE)
    }

    pub fn of_size(file: &Path, size: SlotSize) -> Self {
        let (mut written, mut reports) = (Vec::new(), Vec::new());
        for recorded in Recording::open(file).expect("the recording") {
            let recorded = recorded.expect("a frame");
            let frames = if recorded.dir == Dir::Write { &mut written } else { &mut reports };
            frames.push(*recorded.frame);
        }
        Self { written, reports, size }
    }

    /// The CSP targets of a slave, in the order in which they were sent.
    pub fn targets(&self, slave: usize) -> Vec<i32> {
        let slots = self.written.iter().map(|frame| frame.slot(self.size, slave));
        slots.filter(|slot| slot.id == CommandId::Csp.code()).map(|slot| slot.data1 as i32).collect()
    }

    /// Whether the command `id` was sent in the slot.
    pub fn sent(&self, slot: usize, id: CommandId) -> bool {
        self.written.iter().any(|frame| frame.slot(self.size, slot).id == id.code())
    }

    /// The slot of a drive in the last report.
    pub fn last(&self, slave: usize) -> DriveResponse {
        DriveResponse::decode(&self.reports.last().expect("a report").slot(self.size, slave))
    }

    /// The board's state in the last report.
    pub fn state(&self) -> Option<MasterState> {
        MasterResponse::decode(&self.reports.last().expect("a report").slot(self.size, 0)).state.state()
    }

    pub fn is_on(&self, slave: usize) -> bool {
        let Statusword(word) = self.last(slave).statusword;
        Statusword(word).is_enabled()
    }

    /// The positions of a drive in all reports.
    pub fn positions(&self, slave: usize) -> Vec<i32> {
        self.reports.iter().map(|frame| DriveResponse::decode(&frame.slot(self.size, slave)).position).collect()
    }
}

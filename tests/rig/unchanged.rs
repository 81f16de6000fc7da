//! The unchanged programs of `examples/` on this project's library. Over `usb:` and over `spi:`, with a real kernel's
//! code in between, a board gets the same commands as in their own process.

use std::collections::BTreeMap;
use std::fs;
use std::io::{self, Write};
use std::process::Command;
use std::sync::{Mutex, PoisonError};

use ecmsk::link::Dir;
use ecmsk::sk::{CommandId, Frame, MasterResponse, RawSlot, SlotSize};

use super::spi::{self, Model};
use support::examples::{C_WITHOUT_BOARD, C_WITHOUT_LIBRARY};
use support::served::{Served, attach, detach_all, recorded};

/// The folder with all programs.
const EXAMPLES: &str = "/rig/examples";
/// The folder with this project's library.
const LIBRARY: &str = "/rig/ours";

struct Program {
    name: &'static str,
    /// Its network.
    board: &'static str,
    size: SlotSize,
    /// Events of the board.
    script: Option<&'static str>,
    same: Same,
}

/// The part of the frames that does not depend on when a program sees a report.
#[derive(Clone, Copy)]
enum Same {
    /// Every frame with a command, to the byte.
    Frames,
    /// The commands; its targets depend on the positions it has read.
    Commands,
}

use Same::{Commands, Frames};
use SlotSize::{Bytes12, Bytes16};

const DRIVES: &str = "slaves=drive*2";
const ON_THE_WAY: Option<&str> = Some(include_str!("../../examples/scripts/alarm_on_the_way.ecmscript"));
const ALARM: Option<&str> = Some(include_str!("../../examples/scripts/alarm.ecmscript"));
const LOCAL_INPUTS: Option<&str> = Some(include_str!("../../examples/scripts/local_inputs.ecmscript"));

const PROGRAMS: [Program; 14] = [
    program("two_axes_12b", DRIVES, Bytes12, None, Frames),
    program("two_axes_16b", DRIVES, Bytes16, None, Frames),
    program("hsp_16b", "slaves=hsp2", Bytes16, None, Frames),
    program("io", "slaves=io", Bytes12, LOCAL_INPUTS, Frames),
    program("csv_cst", DRIVES, Bytes12, None, Commands),
    program("homing", DRIVES, Bytes12, None, Commands),
    program("alarm_recovery", DRIVES, Bytes12, ON_THE_WAY, Commands),
    program("operator_panel", DRIVES, Bytes12, ALARM, Commands),
    program("habit_read_after_open", DRIVES, Bytes12, None, Frames),
    program("habit_reader_writer_threads", DRIVES, Bytes12, None, Frames),
    program("habit_sdo_retry", DRIVES, Bytes12, None, Frames),
    program("habit_set_axis_burst", DRIVES, Bytes12, None, Frames),
    program("habit_tight_writer", DRIVES, Bytes12, None, Frames),
    program("habit_two_writes_fifo_mark", DRIVES, Bytes12, None, Frames),
];

const fn program(
    name: &'static str,
    board: &'static str,
    size: SlotSize,
    script: Option<&'static str>,
    same: Same,
) -> Program {
    Program { name, board, size, script, same }
}

impl Program {
    #[track_caller]
    fn run(&self, link: &str) {
        let mut command = Command::new(format!("{EXAMPLES}/{}", self.name));
        let output = command.env("LD_LIBRARY_PATH", LIBRARY).env("ECMSK_LINK", link).output().expect("it starts");
        assert!(output.status.success(), "{} on {link}: {output:?}", self.name);
    }

    /// Prints past the capture of tests, since all programs together take a while.
    fn say(&self) {
        writeln!(io::stdout(), "{}", self.name).expect("the console is there");
    }

    /// A file of its own: recordings of one process to the same file are joined.
    fn file(&self, whose: &str) -> String {
        format!("/tmp/{}-{whose}.pcapng", self.name)
    }

    /// A recording's content. The file is removed, since it is in the guest's memory.
    #[track_caller]
    fn recorded(&self, whose: &str) -> Recorded {
        let [told, reports] = [Dir::Write, Dir::Read].map(|dir| recorded(&self.file(whose), dir));
        fs::remove_file(self.file(whose)).expect("it was there");
        let boards = reports.iter().map(|report| MasterResponse::decode(&report.slot(self.size, 0)));
        Recorded { told, lost: boards.map(|board| board.full_count).max() }
    }

    /// Its board, with a recording.
    fn board(&self, whose: &str) -> String {
        let script = self.script.map_or(String::new(), |script| {
            fs::write("/tmp/script.ecmscript", script).expect("it is a file system in memory");
            "&script=%2Ftmp%2Fscript.ecmscript".to_owned()
        });
        format!("sim:?{}&slot={}{script}&{}", self.board, self.size.bytes(), recording(&self.file(whose)))
    }

    /// Its commands to a board in its own process; it runs there once.
    #[track_caller]
    fn at_home(&self) -> Recorded {
        static RUNS: Mutex<BTreeMap<&str, Recorded>> = Mutex::new(BTreeMap::new());
        let mut runs = RUNS.lock().unwrap_or_else(PoisonError::into_inner);
        let run = runs.entry(self.name).or_insert_with(|| {
            self.run(&format!("{}&clock=virtual", self.board("home")));
            self.recorded("home")
        });
        run.clone()
    }

    /// Frames with a command. While it waits, a program only requests the state, and so does the link `spi:` while the
    /// program writes nothing.
    fn told(&self, frames: &[Frame]) -> Vec<Frame> {
        frames.iter().filter(|frame| tells(frame, self.size)).cloned().collect()
    }

    /// Its steps, without repetitions: how often it repeats a command until the answer arrives depends on timing.
    fn steps(&self, frames: &[Frame]) -> Vec<Vec<u8>> {
        let mut steps: Vec<Vec<u8>> = self.told(frames).into_iter().map(|frame| self.step(frame)).collect();
        steps.dedup();
        steps
    }

    fn step(&self, mut frame: Frame) -> Vec<u8> {
        if let Commands = self.same {
            let motion = [CommandId::Csp, CommandId::Csv, CommandId::Cst].map(CommandId::code);
            for slave in 1..=self.size.max_slaves() {
                let slot = frame.slot(self.size, slave);
                if motion.contains(&slot.id) {
                    frame.put(self.size, slave, &RawSlot { id: slot.id, ..RawSlot::ZERO });
                }
            }
        }
        frame.wire(self.size).to_vec()
    }

    /// Compares the frames `sent` by the program with those `arrived` at the board, of which it has `lost` that many.
    #[track_caller]
    fn check(&self, sent: &[Frame], arrived: &[Frame], lost: Option<u16>) {
        let other = arrived.iter().zip(sent).position(|(arrived, sent)| arrived != sent);
        let (came, went) = (arrived.len(), sent.len());
        assert!(arrived == sent, "{}: {came} arrived of {went}, the first other one: {other:?}", self.name);
        let at_home = self.at_home();
        let (steps, expected) = (self.steps(arrived), self.steps(&at_home.told));
        let least = match self.name {
            "habit_read_after_open" => 0,
            "two_axes_12b" => 501,
            "two_axes_16b" | "hsp_16b" => 21,
            _ => 1,
        };
        assert!(expected.len() >= least, "{}: {} steps at home", self.name, expected.len());
        let other = steps.iter().zip(&expected).position(|(step, expected)| step != expected);
        let (here, home) = (steps.len(), expected.len());
        assert!(
            steps == expected,
            "{}: {here} steps, {home} at home, the first other one: {other:?}; at home: {:?}, here: {:?}",
            self.name,
            other.map(|other| &expected[other]),
            other.map(|other| &steps[other]),
        );
        // One writes faster than any board executes, on purpose: frames that a slow wire delays cannot be lost in a
        // full FIFO.
        if self.name != "habit_tight_writer" {
            assert_eq!((lost, at_home.lost), (Some(0), Some(0)), "{}", self.name);
        }
    }
}

/// A recording's content.
#[derive(Clone)]
struct Recorded {
    /// Command frames.
    told: Vec<Frame>,
    /// Commands that found the FIFO full, as counted by the board; `None`: the board has sent no report.
    lost: Option<u16>,
}

fn recording(file: &str) -> String {
    format!("record={}", file.replace('/', "%2F"))
}

/// Frames of the link `spi:` at its opening have this mark in the SDO slot.
const OPENING_MARK: u8 = 0x5A;

/// GET_STATUS in every slot is a frame of zeros, except for the CRC.
fn tells(frame: &Frame, size: SlotSize) -> bool {
    let (board, sdo) = (frame.slot(size, 0), frame.slot(size, size.sdo_slot()));
    let asks = |slot: &RawSlot| slot.id == CommandId::GetStatus.code() && slot.data1 == 0 && slot.data2 == 0;
    if asks(&sdo) && sdo.index == OPENING_MARK {
        return false;
    }
    let slaves = (1..size.slots()).map(|slot| frame.slot(size, slot));
    !asks(&board) || slaves.into_iter().any(|slot| !slot.is_zero())
}

/// No program is left out.
#[test]
fn all_programs_are_in_the_list() {
    let entries = fs::read_dir(EXAMPLES).expect("the programs are there");
    let names = entries.map(|entry| entry.expect("a file").file_name().into_string().expect("a plain name"));
    let mut listed: Vec<String> = PROGRAMS.iter().map(|program| program.name.to_owned()).collect();
    listed.extend([C_WITHOUT_BOARD, C_WITHOUT_LIBRARY].map(str::to_owned));
    listed.sort();
    let mut there: Vec<String> = names.collect();
    there.sort();
    assert_eq!(there, listed);
}

/// SK-9.7 Every program on a board on USB: each of its frames arrives complete, none lost or duplicated, in order, and
/// they are the commands that a board in its own process gets.
#[test]
fn every_program_on_usb() {
    for program in &PROGRAMS {
        program.say();
        let served = Served::start(&[&program.board("usb")], &[]);
        attach("1-1");
        program.run(&format!("usb:?slot={}&{}", program.size.bytes(), recording(&program.file("host-usb"))));
        detach_all();
        served.stop();
        let [sent, arrived] = ["host-usb", "usb"].map(|whose| program.recorded(whose));
        program.check(&sent.told, &arrived.told, arrived.lost);
    }
}

/// Every program on a board on SPI: each of its commands arrives complete, none lost or duplicated, in order, and they
/// equal the commands that a board in its own process gets.
#[test]
fn every_program_on_spi() {
    for program in &PROGRAMS {
        program.say();
        let model = Model::start(&program.board("spi"));
        let link = format!("{}&slot={}&{}", spi::LINK, program.size.bytes(), recording(&program.file("host-spi")));
        program.run(&link);
        let counters = model.counters();
        let seen = model.stop();
        assert_eq!((counters.incomplete, counters.while_busy, counters.refused, seen.while_busy), (0, 0, 0, 0));
        let len = program.size.frame_len();
        assert!(seen.exchanges.iter().all(|exchange| exchange.len == len && exchange.transfers == 1));
        let [sent, arrived] = ["host-spi", "spi"].map(|whose| program.recorded(whose));
        program.check(&program.told(&sent.told), &program.told(&arrived.told), arrived.lost);
    }
}

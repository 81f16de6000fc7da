//! The tool for Windows, `ecmsk.exe`: on virtual time its output equals that of this system's tool, to the byte,
//! including line ends. [OURS]

use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::process::{Child, ChildStderr, ChildStdout, Command, Stdio};

use ecmsk::link::Dir;
use ecmsk::recording::{Recorded, Recording};
use ecmsk::sk::{CommandId, DriveResponse, FIFO_ENTRIES, MasterResponse, SlotSize};
use rustix::process::{Pid, Signal, kill_process};

use crate::fixture::{DLL, Folder, Toolchain, Width, given, lines};
use support::{self, Ended, root};

const TOOL: &str = "ecmsk.exe";
const BOARD: &str = "sim:?slaves=drive*2,io&clock=virtual";

/// A folder with the tool and the DLL, as in a package.
fn folder(width: Width, name: &str) -> Folder {
    let folder = Folder::with_dll(width, name);
    fs::copy(width.stage().join(TOOL), folder.path().join(TOOL)).expect("the tool");
    folder
}

/// The tool of this system, in the same folder.
fn here(folder: &Folder, words: &[&str]) -> Ended {
    let mut command = Command::new(given("ECMSK_WINDOWS_HOST_TOOL"));
    command.current_dir(folder.path()).args(words).env_remove("ECMSK_LINK").env_remove("ECMSK_LOG");
    support::run(&mut command)
}

fn there(folder: &Folder, words: &[&str]) -> Ended {
    folder.run(TOOL, "", words)
}

/// Both print the same, to the byte, and exit with the same code.
fn same(folder: &Folder, words: &[&str]) -> String {
    let (expected, found) = (here(folder, words), there(folder, words));
    assert_eq!(
        (found.status.code(), &found.stdout, &found.stderr),
        (expected.status.code(), &expected.stdout, &expected.stderr),
        "{words:?}"
    );
    found.stdout
}

crate::for_each_width! {
    /// WIN-60 The tool prints its version, moves axes of a simulated board, and prints the same as on Linux.
    #[test]
    fn steps_print_what_they_print_on_linux(width: Width) {
        let folder = folder(width, "tool-steps");
        assert!(same(&folder, &["--version"]).starts_with("ecmsk "));
        same(&folder, &["info", "--link", BOARD]);
        same(&folder, &["move", "1=1000", "--link", BOARD]);
        same(&folder, &["move", "9=1000", "--link", BOARD]);
        same(&folder, &["sdo", "read", "1", "0x6041", "--link", BOARD, "--json"]);
        same(&folder, &["completions", "bash", "--no-such-option"]);
        let script = there(&folder, &["completions", "powershell"]);
        assert!(script.success().contains("Register-ArgumentCompleter"));
        assert!(there(&folder, &["man", "dump"]).success().contains(".TH ecmsk-dump"));
    }

    /// WIN-61 A program that is run by `exec` gets the DLL beside the tool and the given board, and prints the same as
    /// on Linux; its recording is read, compared and plotted equally on both.
    #[test]
    fn exec_and_recordings(width: Width) {
        let folder = folder(width, "tool-exec");
        let csv = root().join("examples/c/csv_cst.c");
        // Not beside the tool, where Windows would find the DLL anyway.
        fs::create_dir(folder.path().join("program")).expect("a folder");
        folder.build(Toolchain::MinGw, &csv, "program/csv_cst.exe");
        let link = "sim:?slaves=drive*2&clock=virtual";
        for name in ["one.pcapng", "other.pcapng"] {
            let words = ["exec", "--link", link, "--record", name, "--", "program\\csv_cst.exe"];
            let ended = there(&folder, &words);
            assert_eq!(ended.stderr, "");
            support::snapshot("csv_cst", &lines(&ended.success()));
        }
        assert!(same(&folder, &["dump", "one.pcapng"]).lines().count() > 10);
        same(&folder, &["dump", "--json", "one.pcapng"]);
        same(&folder, &["compare", "one.pcapng", "other.pcapng"]);
        same(&folder, &["plot", "one.pcapng", "--out", "plot.svg"]);
        let nothing = there(&folder, &["exec", "--link", link, "--", "cmd.exe", "/c", "exit 7"]);
        assert_eq!(nothing.status.code(), Some(7));
        assert!(nothing.stderr.contains("cmd.exe has opened no board"), "{}", nothing.stderr);
        let none = there(&folder, &["exec", "--link", link, "--", "none.exe"]);
        assert_eq!(none.status.code(), Some(127), "{}", none.stderr);
    }

    /// WIN-62 A DLL beside the program that is not this project's comes first on Windows: `exec` says so and starts nothing.
    #[test]
    fn exec_does_not_start_on_another_dll(width: Width) {
        let folder = folder(width, "tool-beside");
        fs::create_dir(folder.path().join("program")).expect("a folder");
        folder.build(Toolchain::MinGw, &root().join("examples/c/io.c"), "program/io.exe");
        let machine = if width == Width::X64 { support::pe::X64 } else { support::pe::X86 };
        fs::write(folder.path().join("program").join(DLL), support::pe::vendors(machine)).expect("a file");
        let words = ["exec", "--link", "sim:?slaves=io&clock=virtual", "--", "program\\io.exe"];
        let ended = there(&folder, &words);
        assert_eq!((ended.status.code(), ended.stdout.as_str()), (Some(125), ""));
        assert!(ended.stderr.contains("keep it under another name, and copy"), "{}", ended.stderr);
        let doctor = there(&folder, &["doctor", "program"]);
        assert!(doctor.stdout.contains("by Maker Inc."), "{}", doctor.stdout);
        fs::copy(folder.path().join(DLL), folder.path().join("program").join(DLL)).expect("the DLL");
        assert!(!there(&folder, &words).success().is_empty());
    }

    /// WIN-63 Unsupported on Windows is reported as such: links `spi:`, and boards attached by the kernel.
    #[test]
    fn what_windows_does_not_have(width: Width) {
        let folder = folder(width, "tool-errors");
        let spi = there(&folder, &["info", "--link", "spi:/dev/spidev0.0"]);
        assert_eq!(spi.status.code(), Some(1));
        assert!(spi.stderr.contains("this system has no such links") && spi.stderr.contains("tcp://HOST:PORT"), "{}", spi.stderr);
        let words = ["serve", "usbip", "--link", "sim:", "--attach", "--listen", "127.0.0.1:0"];
        let attach = there(&folder, &words);
        assert_eq!(attach.status.code(), Some(1));
        assert!(attach.stderr.contains("kernel of Linux alone") && attach.stderr.contains("usbip-win2"), "{}", attach.stderr);
    }

    /// WIN-64 `list` and `doctor` check the devices of Windows' HID driver, and say what to do; `doctor DIR` checks
    /// real programs and DLLs.
    #[test]
    fn list_and_doctor(width: Width) {
        let folder = folder(width, "tool-doctor");
        let list = there(&folder, &["list"]);
        assert_eq!((list.status.code(), list.stdout.as_str()), (Some(1), ""));
        assert!(list.stderr.starts_with("note: no board on USB; plug it in"), "{}", list.stderr);

        let mut doctor = folder.command(TOOL, "sim:?slaves=drive*2");
        let doctor = support::run(doctor.args(["doctor", "--json"]));
        assert_eq!(doctor.status.code(), Some(0), "{}", doctor.stdout);
        let findings: Vec<serde_json::Value> =
            doctor.stdout.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
        let found = |check: &str| {
            let finding = findings.iter().find(|finding| finding["check"] == check);
            finding.unwrap_or_else(|| panic!("no {check} in {findings:?}"))["found"].as_str().expect("a text")
        };
        assert!(found("versions").contains(DLL) && found("versions").contains("Windows"), "{findings:?}");
        assert!(found("link").starts_with("sim:?slaves=drive*2"), "{findings:?}");
        assert_eq!(found("usb"), "no board on USB");
        assert!(found("timer").starts_with("resolution "), "{findings:?}");
        assert!(found("wake-up").starts_with("late by "), "{findings:?}");
        let usb = support::run(folder.command(TOOL, "usb:").args(["doctor", "--quick"]));
        assert_eq!(usb.status.code(), Some(1));
        assert!(usb.stdout.contains("do: plug it in, set CONFIG0 to USB"), "{}", usb.stdout);

        folder.build(Toolchain::Msvc, &root().join("examples/c/io.c"), "io.exe");
        let bits = if width == Width::X64 { "64-bit" } else { "32-bit" };
        let said = same(&folder, &["doctor", "."]);
        let version = env!("CARGO_PKG_VERSION");
        let takes = format!("{bits}; takes {DLL} (this project's, version {version})");
        assert!(said.contains(&takes), "{said}");
    }

    /// WIN-65 The tool of this system uses a board that the tool serves under Windows; Ctrl-C ends the server properly.
    #[test]
    fn a_served_board_and_its_end(width: Width) {
        let folder = folder(width, "tool-serve");
        let mut served = Running::start(&folder, &["serve", "tcp", "--link", "sim:?slaves=drive*2", "--listen", "127.0.0.1:0"]);
        let mut line = String::new();
        served.out.read_line(&mut line).expect("a line");
        let address = line.strip_prefix("listening on ").and_then(|rest| rest.split(';').next()).expect("where");
        let link = format!("tcp://{address}");
        let moved = here(&folder, &["move", "1=1000", "--up", "--slaves", "drive*2", "--link", &link]);
        assert!(moved.success().contains("1000"));
        served.press_ctrl_c();
        let (code, err) = served.end();
        assert!(code == Some(0) && err.contains("stopped by Ctrl-C"), "{code:?} {err}");
    }

    /// WIN-66 Ctrl-C in a move brakes the axis before the tool exits with 130: it has not reached its target position,
    /// its last targets slow down to rest, and it stands. On a machine that is late an axis may have run out of targets
    /// and stand already; then three runs are tried.
    #[test]
    fn ctrl_c_brakes_a_move(width: Width) {
        let folder = folder(width, "tool-stop");
        let _ = (0..3).any(|_| is_braked_in_time(&folder));
    }
}

/// Ctrl-C in a move. Returns whether targets came in time; then they slow down to rest.
fn is_braked_in_time(folder: &Folder) -> bool {
    let file = folder.path().join("stop.pcapng");
    let _ = fs::remove_file(&file);
    let board = "sim:?slaves=drive&record=stop.pcapng";
    let line = ["move", "1=90000000", "--velocity", "100000", "--acceleration", "200000", "--up", "--link", board];
    let mut moving = Running::start(folder, &line);
    moving.until("progress: moving");
    moving.press_ctrl_c();
    let (code, err) = moving.end();
    assert_eq!(code, Some(130), "{err}");
    assert!(err.contains("stopped by Ctrl-C; no axis moves, those that were on stay on"), "{err}");
    let recording = Recording::open(&file).expect("the recording");
    let frames: Vec<Recorded> = recording.map(|recorded| recorded.expect("a frame")).collect();
    let slot = |frame: &Recorded, at: usize| frame.frame.slot(SlotSize::Bytes12, at);
    let is_target = |frame: &Recorded| frame.dir == Dir::Write && slot(frame, 1).id == CommandId::Csp.code();
    let targets: Vec<i32> =
        frames.iter().filter(|frame| is_target(frame)).map(|frame| slot(frame, 1).data1 as i32).collect();
    let steps: Vec<i32> = targets.windows(2).map(|pair| pair[1] - pair[0]).collect();
    // Ctrl-C may come before it is at 100 counts a cycle.
    let has_moved = steps.iter().any(|step| *step > 10);
    assert!(has_moved && steps.iter().all(|step| (0..=101).contains(step)), "it moved, and never back");
    let reports: Vec<&Recorded> = frames.iter().filter(|frame| frame.dir == Dir::Read).collect();
    let position = |frame: &Recorded| DriveResponse::decode(&slot(frame, 1)).position;
    let [.., before, last] = reports[..] else { panic!("there are reports") };
    let target = targets[targets.len() - 1];
    let (off, moved) = (position(last).abs_diff(target), position(last).abs_diff(position(before)));
    assert!(off <= 100 && moved <= 2, "it stands: {off} counts off its last target, {moved} counts in the last cycle");
    let free = |frame: &Recorded| MasterResponse::decode(&slot(frame, 0)).fifo_free;
    let (first, last) = (frames.iter().position(is_target), frames.iter().rposition(is_target));
    let motion = &frames[first.expect("a target")..last.expect("a target")];
    // The first targets are on their way to the FIFO for some cycles.
    let is_late = motion.iter().skip(50).any(|frame| frame.dir == Dir::Read && free(frame) == FIFO_ENTRIES);
    if !is_late {
        assert!(steps.ends_with(&[0]) || steps.ends_with(&[1]), "it came to rest: {:?}", steps.last());
        assert!(steps.windows(2).all(|pair| (pair[1] - pair[0]).abs() <= 2), "no jump");
    }
    !is_late
}

/// A running tool.
struct Running {
    child: Child,
    out: BufReader<ChildStdout>,
    said: BufReader<ChildStderr>,
    err: String,
}

impl Running {
    fn start(folder: &Folder, words: &[&str]) -> Self {
        let mut command = folder.command(TOOL, "");
        command.args(words).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().expect("Wine starts");
        let out = BufReader::new(child.stdout.take().expect("a pipe"));
        let said = BufReader::new(child.stderr.take().expect("a pipe"));
        Self { child, out, said, err: String::new() }
    }

    /// Waits until it prints a line with this text on standard error.
    fn until(&mut self, words: &str) {
        while !self.err.contains(words) {
            let read = self.said.read_line(&mut self.err).expect("UTF-8");
            assert!(read > 0, "it ended without `{words}`: {}", self.err);
        }
    }

    /// Wine passes SIGINT on as Windows does Ctrl-C. The process that starts Wine becomes the program.
    fn press_ctrl_c(&self) {
        kill_process(Pid::from_child(&self.child), Signal::INT).expect("it runs");
    }

    /// Its exit code, and everything it has printed on standard error.
    fn end(mut self) -> (Option<i32>, String) {
        self.said.read_to_string(&mut self.err).expect("UTF-8");
        (self.child.wait().expect("it ends").code(), self.err)
    }
}

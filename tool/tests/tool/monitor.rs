//! `ecmsk monitor --once` and `--json`, of boards and of recordings.

use std::path::PathBuf;

use crate::common::motion::FakeBoard;
use crate::common::plots::Recorded;
use crate::common::recordings::Script;
use crate::common::{Ran, json_lines, run};
use ecmsk::cia402::Statusword;
use ecmsk::coe::ObjectAddress;
use ecmsk::sk::{
    CommandId, DriveResponse, Frame, HspAxis, HspResponse, IoResponse, MASTER_CYCLIC, MasterCommand, MasterResponse,
    MasterState, SdoResponse, SlaveKind, SlaveResponse, SlotSize, StateByte,
};
use tempfile::TempDir;

const SIZE: SlotSize = SlotSize::Bytes16;
const MS: u64 = 1_000_000;

/// Makes a recording with each kind of slave: a drive that is on, one with an alarm, a stepper that is off, an IO slave, a
/// pulse module of two channels. It has 100 reports, 1 ms apart, between which the first drive goes 5 counts. `declared`: it
/// begins with SET_AXIS, which gives the kinds.
fn everything(declared: bool) -> (TempDir, PathBuf) {
    let mut script = Script::default();
    let mut command = Frame::new();
    use SlaveKind::{Drive, Hsp, Io, None, Step};
    let kinds = [Drive, Drive, Step, Io, Hsp, None, None, None];
    command.put_master(SIZE, &MasterCommand::SetAxis { group: 0, kinds });
    command.fill_crc(SIZE);
    if declared {
        script.command(MS, command);
    }
    for i in 0..100 {
        let mut frame = Frame::new();
        let state = StateByte::reached(MasterState::Op);
        let board = MasterResponse { id: MASTER_CYCLIC, error: 3, state, result: 0, fifo_free: 100, full_count: 7 };
        frame.put(SIZE, 0, &board.encode());
        let drive = |id: CommandId, index, statusword, position, torque, error_code| {
            let head = SlaveResponse { id: id.code(), index };
            DriveResponse { head, statusword: Statusword(statusword), position, torque, error_code }.encode()
        };
        frame.put(SIZE, 1, &drive(CommandId::Csp, 37, 0x1637, 5 * i - 1000, -123, 0));
        frame.put(SIZE, 2, &drive(CommandId::ServoOn, 0, 0x0218, i32::MIN, 0, 0x7500));
        frame.put(SIZE, 3, &drive(CommandId::GetStatus, 0, 0x0250, i32::MAX, 0, 0));
        let head = SlaveResponse { id: CommandId::IoRead.code(), index: 0 };
        frame.put(SIZE, 4, &IoResponse { head, bits: 0xBEEF }.encode());
        let head = SlaveResponse { id: CommandId::Csp.code(), index: 2 };
        let first = HspAxis { position: 77, inputs: 0x21 };
        let second = HspAxis { position: -78, inputs: 0x42 };
        frame.put(SIZE, 5, &HspResponse { head, statusword: Statusword(0x0237), first, second }.encode(SIZE));
        let object = ObjectAddress::new(0x6098, 0);
        let sdo = SdoResponse::Done { id: CommandId::SdoWrite, slave: 2, object, value: 35 };
        frame.put(SIZE, SIZE.sdo_slot(), &sdo.encode());
        frame.fill_crc(SIZE);
        script.response((i as u64 + 2) * MS, frame);
    }
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("run.pcapng");
    script.record(&file, "usb:", Some(SIZE));
    (folder, file)
}

fn monitor(file: &std::path::Path, options: &[&str]) -> Ran {
    let path = file.to_str().expect("UTF-8");
    run([&["monitor", "--recording", path], options].concat())
}

/// The table of `monitor` shows the board, the FIFO, the SDO, and every slave by its kind.
#[test]
fn the_table_shows_board_fifo_sdo_and_every_slave() {
    let (folder, file) = everything(true);
    let text = monitor(&file, &["--once", "--interval", "20ms"]).expect_quiet();
    let text = text.replace(folder.path().to_str().expect("UTF-8"), "FOLDER");
    support::snapshot("monitor_once", &text);
}

/// Without SET_AXIS kinds are guessed and marked; --slaves gives them.
#[test]
fn without_set_axis_kinds_are_guessed_and_marked() {
    let (_folder, file) = everything(false);
    let guessed = monitor(&file, &["--once"]).expect_quiet();
    assert!(guessed.contains("    1 drive? Operation enabled"), "{guessed}");
    assert!(guessed.contains("    4 io "), "an answer to IO_RD is of an IO slave: {guessed}");
    let told = monitor(&file, &["--once", "--slaves", "drive:csv,none,step,io,hsp2"]).expect_quiet();
    assert!(told.contains("    1 drive  Operation enabled") && told.contains("axis 2"), "{told}");
    assert!(!told.contains("\n    2 "), "{told}");
}

/// `monitor --json` prints one object for each interval of the recording's time, with rates, velocities, and slots as in `dump
/// --json`.
#[test]
fn json_has_one_object_for_each_interval() {
    let (_folder, file) = everything(true);
    let views = json_lines(&monitor(&file, &["--json", "--interval", "25ms"]).expect_quiet());
    let times: Vec<_> = views.iter().map(|view| view["time_ns"].as_u64().expect("a time") / MS).collect();
    assert_eq!(times, [25, 50, 75, 100]);
    let view = &views[2];
    assert_eq!((&view["reports"], &view["reports_lost"]), (&75.into(), &0.into()));
    assert_eq!(view["reports_per_s"], 1000.0);
    assert_eq!(view["velocities"][0], serde_json::json!({ "slave": 1, "counts_per_s": 5000.0 }));
    assert_eq!(view["velocities"][1]["counts_per_s"], 0.0);
    let path = file.to_str().expect("UTF-8");
    let dump = json_lines(&run(["dump", path, "--json", "--from", "100ms"]).expect_quiet());
    assert_eq!(views[3]["slots"], dump[0]["slots"]);
    assert_eq!(
        json_lines(&monitor(&file, &["--json", "--interval", "25ms", "--seconds", "60ms"]).expect_quiet()).len(),
        3
    );
}

/// The monitor sends nothing to a board: the board counts no frame, and keeps its state.
#[test]
fn nothing_is_sent() {
    for clock in ["real", "virtual"] {
        let link = format!("sim:?slaves=drive*2,io&clock={clock}&queue=4096");
        let options = ["monitor", "--link", &link, "--json", "--interval", "50ms", "--seconds", "0.4"];
        let views = json_lines(&run(options).expect_quiet());
        let last = views.last().expect("a view");
        assert_eq!((&last["counters"]["frames"], &last["slots"][0]["state"]), (&0.into(), &"PreOP".into()), "{clock}");
        assert!(last["reports"].as_u64().is_some_and(|reports| reports > 0), "{clock}");
        assert_eq!(last["reports_lost"], 0, "{clock}");
        // The kinds of the slaves are known from the link.
        assert_eq!(last["slots"][3]["kind"], "io", "{clock}");
    }
    let text = run(["monitor", "--link", "sim:?slaves=drive*2", "--once"]).expect_quiet();
    assert!(
        text.starts_with("sim:   a board of this process alone; ")
            && text.contains("\nstate PreOP ")
            && text.contains("    2 drive  says nothing"),
        "{text}"
    );
}

/// A board that falls silent is reported, and one that is gone ends the monitor.
#[test]
fn a_silent_board_is_shown_and_a_lost_one_ends_the_monitor() {
    let link = "sim:?slaves=drive&fault.disconnect_ms=300";
    let ran = run(["monitor", "--link", link, "--json", "--interval", "20ms", "--seconds", "30"]);
    ran.expect_failure(1, &["is gone"], "open it again");
    assert!(json_lines(&ran.out).iter().all(|view| view["slots"][0]["state"] == "PreOP"), "{}", ran.out);
}

/// A source that cannot be watched is an error with the next step.
#[test]
fn a_source_that_cannot_be_watched_is_an_error_with_the_next_step() {
    let board = FakeBoard::new(SlotSize::Bytes12, 1);
    let recorded = Recorded::new(&board);
    let file = recorded.file.to_str().expect("UTF-8");
    run(["monitor", "--recording", file]).expect_failure(1, &["no terminal"], "use --once or --json");
    run(["monitor", "--once", "--recording", "/no/such/file"]).expect_failure(1, &["/no/such/file"], "check the path");
    run(["monitor", "--once", "--link", "tcp:?x"]).expect_misuse(&["--link"]);
    run(["monitor", "--link", "sim:", "--recording", file]).expect_misuse(&["--link", "--recording"]);
    run(["monitor", "--link", "sim:", "--interval", "1ms"]).expect_misuse(&["--interval", "10ms to 3600s"]);
    let mut script = Script::default();
    script.command(MS, Frame::new());
    let folder = tempfile::tempdir().expect("a folder");
    let empty = folder.path().join("empty.pcapng");
    script.record(&empty, "usb:", Some(SIZE));
    monitor(&empty, &["--once"]).expect_failure(1, &["holds no report"], "record a program that reads");
}

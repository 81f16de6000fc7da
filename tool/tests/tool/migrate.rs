//! `ecmsk migrate`: its report on recordings, in words, as JSON and as a picture, and its errors for other files.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use crate::common::motion::FakeBoard;
use crate::common::recordings::make_capture;
use crate::common::svg::{ALARM, GAP, Plot};
use crate::common::{Ran, run};
use ecmsk::link::uri::LinkUri;
use ecmsk::migrate::Row;
use ecmsk::sk::{FifoAction, MasterCommand, MasterState, SdoCommand, SlaveCommand, SlaveKind, SlotSize};
use serde_json::{Value, json};
use support::recorded::Program;
use tempfile::TempDir;

/// Recordings in a folder of their own.
struct Files(TempDir);

impl Files {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a folder"))
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Writes the frames of a fake board as a recording in virtual time; returns its path.
    fn recorded(&self, name: &str, board: &FakeBoard) -> PathBuf {
        let file = self.path(name);
        board.script.record(&file, "sim:?clock=virtual", Some(board.size));
        file
    }

    /// The same frames as a capture of usbmon, whose times are those of a real clock.
    fn captured(&self, name: &str, board: &FakeBoard) -> PathBuf {
        let file = self.recorded(name, board);
        make_capture(&file, &vec![5; board.script.frames()]);
        file
    }
}

fn migrate(file: &Path, options: &[&str]) -> Ran {
    run([&["migrate", file.to_str().expect("UTF-8")], options].concat())
}

/// A program of one axis that is 30 targets ahead, and stalls for `cycles` cycles in the motion.
fn stalled(cycles: i32) -> FakeBoard {
    let mut board = FakeBoard::new(SlotSize::Bytes12, 1);
    let mut sent = 0;
    for cycle in 0..400 {
        while !(200..200 + cycles).contains(&cycle) && sent < cycle + 30 {
            board.send(&[10 * sent]);
            sent += 1;
        }
        board.cycle();
    }
    board
}

/// The verdict in the JSON of `migrate` on an item (such as a command) that the program uses.
#[track_caller]
fn verdict<'a>(found: &'a Value, name: &str) -> &'a Value {
    let uses = found["uses"].as_array().expect("a list");
    &uses.iter().find(|used| used["name"] == name).unwrap_or_else(|| panic!("no {name}: {found}"))["verdict"]
}

/// `migrate` judges a program of two drives and an IO slave, as text and as JSON.
#[test]
fn a_program_in_words_and_as_json() {
    let program = Program::default().record();
    let shown = |options: &[&str]| {
        let ran = migrate(&program.file, options);
        assert_eq!((ran.code, ran.err.as_str()), (Some(1), ""), "{}", ran.out);
        let folder = program.file.parent().expect("a folder").to_str().expect("UTF-8");
        ran.out.replace(&format!("{folder}/"), "")
    };
    let json = shown(&["--json"]);
    let pretty: Value = serde_json::from_str(&json).expect("one object");
    let pretty = serde_json::to_string_pretty(&pretty).expect("JSON");
    support::snapshot("tool_migrate", &format!("{}\n{pretty}\n", shown(&[])));
}

/// The verdict on an item (runs, differs, does not run) depends on how the program uses it. The report names the row of
/// docs/MIGRATION.md for each, with a sentence.
#[test]
fn what_differs_is_named_with_its_row() {
    let files = Files::new();
    let mut board = FakeBoard::of_kinds(SlotSize::Bytes12, &[SlaveKind::Drive, SlaveKind::Io]);
    for n in 0..50 {
        board.send(&[10 * n]);
        board.cycle();
    }
    board.master(&MasterCommand::SetFifo(FifoAction::Clear));
    board.master(&MasterCommand::LocalWrite(3));
    board.send_to(1, &SlaveCommand::ServoOff);
    board.master(&MasterCommand::SetState(MasterState::SafeOp));
    board.sdo(&SdoCommand::Read { slave: 1, object: ecmsk::coe::ObjectAddress::new(0x6098, 0) });
    let file = files.recorded("run.pcapng", &board);
    let ran = migrate(&file, &["--json"]);
    let found = ran.json();
    assert_eq!((ran.code, &found["runs"]), (Some(1), &json!("differs")));
    for (name, runs, row) in [
        ("CSP", "differs", json!("latency")),
        ("SET_FIFO", "differs", json!("clear")),
        ("SDO_RD 0x6098:0", "differs", json!("sdo")),
        ("LIO_WR", "differs", json!("lio")),
        ("SV_OFF", "yes", Value::Null),
        ("slaves of kind DRIVE", "yes", Value::Null),
        ("SET_STATE SafeOP", "yes", Value::Null),
    ] {
        let verdict = verdict(&found, name);
        assert_eq!((&verdict["runs"], &verdict["row"]), (&json!(runs), &row), "{name}");
    }
    let text = migrate(&file, &[]).out;
    assert!(text.contains("\nruns on an ECM-XF, with differences\n"), "{text}");
    assert!(text.contains("&local_out=0,1,2,3,4,5\""), "{text}");
    for row in ["latency", "clear", "sdo", "lio"] {
        assert!(text.contains(&format!("\n{row:8} ")), "{row}: {text}");
    }
}

/// Exit codes are those of diff: 0 it runs unchanged, 1 with differences or not at all, 2 it could not be judged.
#[test]
fn exit_codes_are_those_of_diff() {
    let files = Files::new();
    // A program on a board reaches OP early, so its recording does not show how long it would wait for a chip. A recording
    // behind a chip shows that it waits long enough.
    let text = migrate(&files.recorded("ahead.pcapng", &stalled(0)), &[]);
    assert_eq!((text.code, text.err.as_str()), (Some(1), ""), "{}", text.out);
    assert!(!text.out.contains("as it is"), "{}", text.out);
    let program = Program { scheme: "xf-sim", ..Program::default() }.record();
    let whole = program.file.clone();
    let text = migrate(&whole, &[]).expect_quiet();
    assert!(text.contains("\nruns on an ECM-XF as it is\n"), "{text}");
    assert!(text.contains("\nrecorded with the slaves behind a chip already: "), "{text}");
    assert_eq!(migrate(&whole, &["--json"]).json()["behind_chip"], true);
    let bytes = fs::read(&whole).expect("a recording");
    let cut = files.path("cut.pcapng");
    fs::write(&cut, &bytes[..bytes.len() / 2 + 1]).expect("a file");
    let ran = migrate(&cut, &[]);
    assert_eq!(ran.code, Some(2), "{}", ran.out);
    assert!(ran.err.starts_with("note: ") && ran.err.contains("ends in the middle"), "{}", ran.err);
    assert!(ran.out.contains("as it is, as far as the recording goes\n"), "{}", ran.out);
    let found = migrate(&cut, &["--json"]).json();
    assert_eq!((&found["whole"], &found["runs"]), (&json!(false), &json!("yes")));
    assert_eq!(migrate(&cut, &["--allow-incomplete"]).code, Some(0));
    let help = run(["--help"]).expect_quiet();
    assert!(help.contains("0 the program runs on an ECM-XF as it is, 1 it runs with differences or not, 2"), "{help}");
}

/// A program that never reached OP did not show its purpose: the report has the items that it used, and the code is 2.
#[test]
fn a_program_that_was_never_in_op() {
    let files = Files::new();
    let mut board = FakeBoard::starting(SlotSize::Bytes12, 2, SlaveKind::Drive);
    board.report(MasterState::PreOp);
    let file = files.recorded("run.pcapng", &board);
    let ran = migrate(&file, &[]);
    assert_eq!(ran.code, Some(2), "{}", ran.out);
    assert!(ran.err.contains("never reaches OP"), "{}", ran.err);
    assert!(ran.out.contains("SET_AXIS") && ran.out.contains("no slave is declared"), "{}", ran.out);
    let found = migrate(&file, &["--json"]).json();
    assert_eq!((&found["in_op"], &found["host"], &found["chip"]), (&json!(false), &Value::Null, &Value::Null));
    let plot = files.path("x.svg");
    migrate(&file, &["--plot", plot.to_str().expect("UTF-8")]);
    assert!(!plot.exists());
}

/// A file that is no recording of a board, and an output that cannot be written, are errors with the next step.
#[test]
fn bad_input() {
    let files = Files::new();
    run(["migrate", "/no/such/file"]).expect_failure(2, &["/no/such/file"], "check the path");
    run(["migrate", "-"]).expect_failure(2, &["standard input"], "save it to a file");
    run(["migrate"]).expect_misuse(&["<RECORDING>"]);
    let text = files.path("text.pcapng");
    fs::write(&text, "no recording").expect("a file");
    migrate(&text, &[]).expect_failure(2, &["is no recording (.ecmrec, .pcapng)"], "with Wireshark");
    migrate(&text, &["--json"]).expect_failure(2, &["is no recording (.ecmrec, .pcapng)"], "with Wireshark");
    let empty = files.path("empty.pcapng");
    fs::write(&empty, "").expect("a file");
    assert_eq!(migrate(&empty, &[]).code, Some(2));
    let silent = files.path("silent.pcapng");
    ecmsk::link::open(&format!("sim:?clock=virtual&record={}", silent.display()), ecmsk::link::Share::ByUri)
        .expect("a board")
        .close();
    migrate(&silent, &[]).expect_failure(2, &["holds no frame"], "record a program");
    let chip = files.path("chip.pcapng");
    let link = format!("xf-sim:?slaves=drive&record={}", chip.display());
    drop(ecmsk::Xf::open(&link).expect("a chip"));
    let ran = migrate(&chip, &[]);
    assert!(ran.code == Some(2) && ran.err.contains("the recording of a chip ECM-XF"), "{ran:?}");
    let whole = files.recorded("run.pcapng", &stalled(0));
    let path = whole.to_str().expect("UTF-8");
    migrate(&whole, &["--plot", path]).expect_failure(2, &["would replace the recording"], "with --plot");
    migrate(&whole, &["--plot", "/no/such/folder/x.svg"]).expect_failure(2, &["cannot write"], "with --plot");
    for speed in ["0", "97M", "fast", "5", "M", "99999M", ""] {
        migrate(&whole, &["--speed", speed]).expect_misuse(&["--speed", "100k to 96M"]);
    }
}

/// If a host stalled while its targets waited in the FIFO, it needs as many sets of outputs in the chip. A recording in virtual
/// time allows no such conclusion.
#[test]
fn a_stall_wants_sets_ahead() {
    let files = Files::new();
    let board = stalled(20);
    let captured = files.captured("capture.pcapng", &board);
    let ran = migrate(&captured, &["--json"]);
    let found = ran.json();
    assert_eq!(ran.code, Some(1), "{ran:?}");
    let ahead = &found["ahead"];
    assert_eq!((&ahead["stall"]["cycles"], &ahead["stall"]["seen_by"]), (&json!(20), &json!("late write")));
    assert_eq!((&ahead["value"], &ahead["verdict"]["row"]), (&json!(20), &json!("stall")));
    assert_eq!(found["host"]["fifo_sets"]["most"], 29);
    let text = migrate(&captured, &[]).out;
    for words in ["a capture, ", "for a stall of 20 cycles, ", "differs (stall)", "the kernel takes reports"] {
        assert!(text.contains(words), "`{words}` is missing in {text}");
    }
    let recorded = files.recorded("recorded.pcapng", &board);
    let found = migrate(&recorded, &["--json"]);
    assert_eq!((found.code, found.json()["ahead"]["verdict"]["runs"].as_str()), (Some(1), Some("yes")), "{found:?}");
    let found = found.json();
    assert_eq!((&found["ahead"]["stall_known"], &found["ahead"]["value"]), (&json!(false), &json!(4)));
    assert!(migrate(&recorded, &[]).out.contains("in virtual time no PC is late"));
}

/// The picture of `--plot` shows the level of the FIFO and the pauses of the host, each with the number that `ahead=` covers,
/// and the gaps in a motion.
#[test]
fn the_picture_shows_level_pauses_and_ahead() {
    let files = Files::new();
    let board = stalled(50);
    let file = files.captured("run.pcapng", &board);
    let svg = files.path("stalls.svg");
    let ran = migrate(&file, &["--plot", svg.to_str().expect("UTF-8")]);
    assert!(ran.out.ends_with(&format!("\npicture: {}\n", svg.display())), "{}", ran.out);
    let found = migrate(&file, &["--json"]).json();
    let bridged = found["ahead"]["value"].as_f64().expect("a number");
    let lie = bridged + found["ahead"]["transport_sets"].as_f64().expect("a number");
    let plot = Plot::parse(&fs::read_to_string(&svg).expect("a picture"));
    assert_eq!(plot.panel_names(), ["FIFO: sets of 160", "Pauses of the host in a motion (cycles)"]);
    for (panel, value) in [("FIFO", lie), ("Pauses", bridged)] {
        let marks = plot.panel(panel).samples(ALARM, false);
        assert!(marks.len() >= 2 && marks.iter().all(|(_, at)| (at - value).abs() < 0.3), "{panel}: {marks:?}");
        assert_eq!(plot.panel(panel).spans(GAP).len(), 1, "{panel}");
    }
    assert_eq!(found["host"]["gaps"], 1);
}

/// `migrate` reads captures of the USB of a real system as other verbs do, whatever their slot size.
#[test]
fn captures_are_read() {
    for slot in [12, 16] {
        let file = support::root().join(format!("tests/recordings/usbmon_{slot}.pcap"));
        let ran = migrate(&file, &["--json"]);
        let found = ran.json();
        assert_eq!((ran.code, &found["link"], &found["runs"]), (Some(1), &Value::Null, &json!("differs")), "{slot}");
        let rows: Vec<_> = found["rows"].as_array().expect("a list").iter().map(|row| &row["id"]).collect();
        assert_eq!(rows, ["start"], "{slot}");
        assert_eq!((&found["chip"]["output_bytes"], &found["chip"]["input_bytes"]), (&json!(28), &json!(32)));
        assert_eq!(verdict(&found, "SDO_RD 0x6502:0")["runs"], "yes");
        let link = found["links"]["model"].as_str().expect("a link");
        assert!(link.starts_with("xf-sim:?slaves=drive,hsp,io&int0=yes&ahead=4&use_n=112&speed=24M"), "{link}");
        assert_eq!(link.ends_with("&slot=16"), slot == 16, "{link}");
    }
}

/// If the cycle is too short for the chip, the report has the time that is needed and a remedy. A slower SPI clock needs larger
/// packets.
#[test]
fn a_cycle_and_a_clock() {
    let files = Files::new();
    let file = files.recorded("run.pcapng", &FakeBoard::new(SlotSize::Bytes12, 40));
    let found = migrate(&file, &["--json"]).json();
    assert_eq!(
        found["chip"]["with_int0"],
        json!({"holds": true, "n": 400, "sets": 1, "in_flight": 1, "least_clock_hz": 17_141_000})
    );
    assert_eq!((&found["chip"]["fifo_entries"], &found["chip"]["ahead_max"]), (&json!(25), &json!(21)));
    let ran = migrate(&file, &["--speed", "4M"]);
    assert_eq!(ran.code, Some(1), "{}", ran.out);
    for words in [
        "cycle of 1000 us",
        "no (cycle)",
        "the exchanges with the chip take 1710 us for each",
        "    do: a cycle of 4000 us holds",
    ] {
        assert!(ran.out.contains(words), "`{words}` is missing in {}", ran.out);
    }
}

/// There is no advice to wire INT0 if the link has it; without it there is.
#[test]
fn int0_is_advised_where_it_is_not_wired() {
    let program = Program::default().record();
    let ran = migrate(&program.file, &["--speed", "200k"]);
    assert_eq!(ran.code, Some(1), "{}", ran.out);
    let line =
        |name: &str| ran.out.lines().find(|line| line.starts_with(name)).unwrap_or_else(|| panic!("{}", ran.out));
    assert!(line("INT0 ").contains("cannot be held") && !line("INT0 ").contains("int0="), "{}", ran.out);
    assert!(line("no INT0 ").contains("INT0 (int0=)"), "{}", ran.out);
}

/// A program with a time limit for reaching OP may fail behind a chip. The report has the time that the chip needs beside that
/// of the board, with its row, and never says `as it is`.
#[test]
fn the_way_to_op_is_told() {
    let run = Program::default().record();
    let ran = migrate(&run.file, &[]);
    assert_eq!(ran.code, Some(1), "{}", ran.out);
    for words in [
        "\nruns on an ECM-XF, with differences\n",
        "differs (start)",
        "\nthe way to OP\nboard    0.",
        "for 3 slaves: a program that gives up after less than that fails (start)\n",
    ] {
        assert!(ran.out.contains(words), "`{words}` is missing in {}", ran.out);
    }
    let found = migrate(&run.file, &["--json"]).json();
    let ns = |key: &str| found["start"][key].as_i64().unwrap_or_else(|| panic!("{key}: {found}"));
    assert!(ns("recorded_ns") < ns("chip_ns") && ns("slaves") == 3, "{found}");
    assert_eq!(verdict(&found, "SET_STATE OP")["row"], "start");
}

/// `migrate` counts commands and polls as `compare` does.
#[test]
fn commands_are_counted_as_compare_does() {
    let run = Program { polls: 3, ..Program::default() }.record();
    let counts = |text: String| {
        let line = text.lines().find(|line| line.contains(" polls, ")).expect("a line").to_owned();
        let at = line.find(" commands").expect("commands");
        line[line[..at].rfind(' ').expect("a number") + 1..].to_owned()
    };
    let compared = crate::common::run(["compare", run.path(), run.path()]).expect_quiet();
    assert_eq!(counts(migrate(&run.file, &[]).out), counts(compared));
}

/// The report says which part of a pause counts as a stall, with the length of the pause, the usual pause, and the number of
/// sets that waited.
#[test]
fn a_stall_is_told_with_what_it_is_of() {
    let files = Files::new();
    let captured = files.captured("capture.pcapng", &stalled(50));
    let found = migrate(&captured, &["--json"]).json();
    let stall = &found["ahead"]["stall"];
    let ns = |key: &str| stall[key].as_i64().unwrap_or_else(|| panic!("{key}: {found}"));
    assert!(ns("ns") < ns("whole_ns") - ns("usual_ns"), "{stall}");
    assert_eq!(ns("ns"), ns("sets") * 1_000_000, "{stall}");
    let text = migrate(&captured, &[]).out;
    let words = format!("{} sets waited when it began, and no more cycles of it count", ns("sets"));
    assert!(text.contains(&words) && text.contains(" in a motion, less the usual one of "), "{text}");
}

/// The links that the report proposes are valid.
#[test]
fn the_links_can_be_opened() {
    let program = Program::default().record();
    let found = migrate(&program.file, &["--json"]).json();
    for link in ["machine", "model"] {
        let link = found["links"][link].as_str().expect("a link");
        LinkUri::parse(link).unwrap_or_else(|error| panic!("{link}: {error}"));
    }
}

/// Each row that `migrate` names is in the table of docs/MIGRATION.md, and each row of the table has its difference,
/// the amount, the reason, and a test.
#[test]
fn every_row_is_in_the_page() {
    let page = fs::read_to_string(support::root().join("docs/MIGRATION.md")).expect("the page");
    let rows: Vec<Vec<&str>> = page
        .lines()
        .skip_while(|line| !line.starts_with("| id |"))
        .skip(2)
        .take_while(|line| line.starts_with('|'))
        .map(|line| line.trim_matches('|').split(" | ").map(str::trim).collect())
        .collect();
    let ids: BTreeSet<&str> = rows.iter().map(|cells| cells[0].trim_matches('`')).collect();
    assert_eq!(ids, Row::ALL.iter().map(|row| row.id()).collect(), "the rows of the page and those of `migrate`");
    for cells in &rows {
        assert!(cells.len() == 5 && cells.iter().all(|cell| !cell.is_empty()), "{cells:?}");
        assert!(cells[4].contains("tests/"), "{cells:?}");
    }
}

/// The lines to replay and to run the program have the slaves of the recording's link, with all their options.
#[test]
fn the_links_have_the_slaves_of_the_recording() {
    let files = Files::new();
    let board = stalled(0);
    let slaves = "drive:start@5:limits@-200000..300000:home@..500:objects@maker.txt";
    let file = files.path("run.pcapng");
    board.script.record(&file, &format!("sim:?slaves={slaves}&clock=virtual"), Some(board.size));
    let ran = migrate(&file, &["--allow-incomplete"]);
    for verb in ["ecmsk replay", "ecmsk exec"] {
        let line = ran.out.lines().find(|line| line.contains(verb)).expect(verb);
        assert!(line.contains(&format!("xf-sim:?slaves={slaves}&int0=yes&ahead=")), "{line}");
    }
    let plain = files.recorded("plain.pcapng", &board);
    assert!(migrate(&plain, &[]).out.contains("xf-sim:?slaves=drive&int0=yes"));
}

//! `ecmsk flight`, and the option `--flight` of `exec` and of servers.
#![cfg(unix)]

use std::fs;
use std::process::{Command, Stdio};

use crate::common::exec::ExecFolder;
use crate::common::{Ran, ecmsk, run, without_times};
use ecmsk::link::{self, Share, Wait, uri::LinkUri};
use ecmsk::sk::Frame;
use serde_json::Value;

const TOOL: &str = env!("CARGO_BIN_EXE_ecmsk");

/// `--flight` and `--flight-bytes` become keys of the link; what is wrong with them is an error before the program starts.
#[test]
fn the_options_are_keys_of_the_link() {
    let place = ExecFolder::new();
    let options = ["--link", "sim:?clock=virtual", "--flight", "a flight", "--flight-bytes", "500M"];
    let out = place.run(&options, "echo \"$ECMSK_LINK\"").expect_quiet();
    let link = LinkUri::parse(out.trim_end()).expect("a link");
    let expected = fs::canonicalize(place.path()).expect("a folder").join("a flight");
    assert_eq!(link.value("flight"), expected.to_str());
    assert_eq!((link.value("flight_bytes"), link.value("clock")), (Some("500M"), Some("virtual")));

    let refused = |options: &[&str], code, words: &[&str], next: &str| {
        let ran = place.run(&[&["--link", "sim:"][..], options].concat(), "echo started");
        ran.expect_failure(code, words, next);
        assert_eq!(ran.out, "", "the program was started");
    };
    refused(&["--flight", "not/there"], 125, &["cannot record to the folder"], "with --flight");
    let few = place.run(&["--link", "sim:", "--flight", "a", "--flight-bytes", "5"], "echo started");
    assert!(few.code == Some(2) && few.err.contains("a number of bytes from 16M to 1000G"), "{few:?}");
    let twice = place.run(&["--link", "sim:?flight=a", "--flight", "b"], "echo started");
    twice.expect_failure(2, &["`flight` is given twice"], "ecmsk link help");
}

/// A program with an alarm: `list` shows the moment, and other verbs read it.
#[test]
fn a_kept_moment_is_a_recording_for_every_verb() {
    let place = ExecFolder::new();
    fs::write(place.path().join("script"), "at 2s alarm 1 0x7500\n").expect("a file");
    let link = format!("sim:?slaves=drive&clock=virtual&script={}", place.path().join("script").display());
    let moves = format!("{TOOL} move 1=100000000 --up >/dev/null 2>&1; exit 0");
    let ran = place.run(&["--link", &link, "--flight", "flight", "--quiet"], &moves);
    assert_eq!((ran.code, ran.err.as_str()), (Some(0), ""), "{ran:?}");

    let folder = place.path().join("flight");
    let folder = folder.to_str().expect("UTF-8");
    let text = run(["flight", "list", folder]).expect_quiet();
    assert!(text.starts_with(&format!("nothing is being recorded to {folder}\nkept moments: 1, ")), "{text}");
    assert!(text.contains("s  alarm: slave 1 has an alarm, 0x7500: ") && text.contains("\nsegments: 1, "), "{text}");
    let json: Value =
        serde_json::from_str(&run(["flight", "list", folder, "--json"]).expect_quiet()).expect("an object");
    assert_eq!(json["moments"][0]["reasons"][0]["kind"], "alarm");
    assert_eq!((&json["writer"], &json["moments"][0]["from"]), (&Value::Null, &Value::Null), "a virtual clock");
    let file = json["moments"][0]["file"].as_str().expect("a file").to_owned();

    let summary = run(["summary", &file]).expect_quiet();
    assert!(summary.contains("slave 1 has an alarm, 0x7500"), "{summary}");
    let dump = run(["dump", &file]).expect_quiet();
    assert!(dump.contains("CSP"), "{}", &dump[..dump.len().min(2000)]);
    let svg = place.path().join("plot.svg");
    run(["plot", &file, "-o", svg.to_str().expect("UTF-8")]).expect_quiet();
    assert!(fs::read_to_string(svg).expect("a picture").contains("0x7500"));
}

/// An axis that its drive holds back is kept as a moment, and the summary has it: `--exit-code` and `--fail-on` see it.
#[test]
fn an_axis_that_is_held_back_is_an_event() {
    let place = ExecFolder::new();
    let link = "sim:?slaves=drive:limits@-1000..1000&clock=virtual";
    let moves = format!("{TOOL} move 1=5000 --up >/dev/null 2>&1; exit 0");
    let ran = place.run(&["--link", link, "--flight", "flight", "--quiet"], &moves);
    assert_eq!((ran.code, ran.err.as_str()), (Some(0), ""), "{ran:?}");
    let says = "the drive of slave 1 holds its axis back at 10";

    let folder = place.path().join("flight");
    let folder = folder.to_str().expect("UTF-8");
    let json: Value =
        serde_json::from_str(&run(["flight", "list", folder, "--json"]).expect_quiet()).expect("an object");
    assert_eq!(json["moments"][0]["reasons"][0]["kind"], "held-back", "{json}");
    let file = json["moments"][0]["file"].as_str().expect("a file");
    let summary = run(["summary", "--exit-code", file]);
    assert!(summary.code == Some(1) && summary.out.contains(says), "{summary:?}");
    for (reason, code) in [("any", 1), ("held-back", 1), ("alarm", 0)] {
        run(["summary", "--fail-on", reason, file]).expect_code(code);
    }
    let machine = place.path().join("machine.toml");
    let text = "format = 1\n[axes]\nX = { slave = 1, unit = \"mm\", per = 0.01 }\n";
    fs::write(&machine, text).expect("a file");
    let named = run(["summary", "--machine", machine.to_str().expect("UTF-8"), file]);
    assert!(named.out.contains("\naxis X: held back at 10."), "{named:?}");
    let json = run(["summary", "--json", file]).json();
    assert_eq!((&json["held_back"][0]["slave"], &json["held_back"][0]["times"]), (&1.into(), &1.into()), "{json}");
}

/// A folder that another process records to is refused with its number; `mark` reaches that process. A process that was
/// killed is no obstacle, and the next `exec` that is killed is named by its parent.
#[test]
fn a_folder_that_is_recorded_to_is_refused_and_can_be_marked() {
    let place = ExecFolder::new();
    let folder = place.path().join("flight");
    let folder = folder.to_str().expect("UTF-8");
    run(["flight", "list", folder]).expect_failure(1, &["not the folder of a flight recorder"], "flight=DIR");
    let board = link::open(&format!("sim:?slaves=drive&flight={folder}"), Share::ByName).expect("a board");
    let mut report = Frame::new();
    board.read(&mut report, Wait::Forever).expect("a report");

    let options = ["--link", "sim:?clock=virtual", "--flight", "flight"];
    let pid = format!("process {} is recording to it", std::process::id());
    place.run(&options, "echo started").expect_failure(125, &[&pid], "with --flight");
    let said = run(["flight", "mark", folder, "a noise"]).expect_quiet();
    assert!(said == "marked\n" || said == "will be marked at the next frame\n", "{said}");
    board.read(&mut report, Wait::Forever).expect("a report");
    board.close();
    let text = run(["flight", "list", folder]).expect_quiet();
    assert!(text.contains("Z  mark: a noise\n"), "{text}");
    run(["flight", "mark", folder, "late"]).expect_failure(1, &["nothing is being recorded to it"], "flight=DIR");

    let link = format!("sim:?slaves=drive&flight={folder}");
    let mut killed = ecmsk(["monitor", "--link", &link, "--json"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("the tool starts");
    let segment = place.path().join("flight/segment-00000002.ecmrec");
    while !segment.exists() {
        std::thread::yield_now();
    }
    killed.kill().expect("it is killed");
    killed.wait().expect("it has ended");
    place.run(&options, &format!("{TOOL} info >/dev/null 2>&1")).expect_quiet();
    let ended = place.run(&options, "printf 'pid 0\\nmissing 0\\n' > flight/writer.txt");
    assert!(ended.code == Some(124) && ended.err.contains("was not ended"), "{ended:?}");
}

/// TOOL-138 A disk that is full says so once, and in the exit code of `exec` and of a server; the motion goes on.
#[test]
fn a_full_disk_is_told_once_and_in_the_exit_code() {
    let place = ExecFolder::new();
    // The shell limits files to 64 KiB: a single file fails, which deleting others does not help.
    let full = |script: &str| format!("trap '' XFSZ; ulimit -f 128; {script}");
    let options = ["--link", "sim:?slaves=drive&clock=virtual", "--flight", "flight", "--quiet"];
    let ran = place.run(&options, &full(&format!("{TOOL} move 1=1000000 --up")));
    assert_eq!((ran.code, ran.out.as_str()), (Some(124), "axis 1: at 1000000\n"), "{ran:?}");
    assert_eq!(ran.err.matches("has stopped: File too large").count(), 1, "{}", ran.err);
    let last = ran.err.lines().last().expect("a line");
    assert!(last.starts_with("warning: ") && last.contains("frames are missing: File too large"), "{last}");

    let script = full(&format!(
        "{TOOL} serve tcp --listen 127.0.0.1:0 --link 'sim:?slaves=drive&clock=virtual' --flight served >said & server=$!
         until address=$(sed -n 's/^listening on \\(.*\\); .*/\\1/p' said) && test \"$address\"; do sleep 0.01; done
         {TOOL} move 1=1000000 --up --link tcp://$address && kill -TERM $server && wait $server"
    ));
    let served = Command::new("sh").args(["-c", &script]).current_dir(place.path()).output().expect("sh starts");
    let served = Ran::from(served);
    assert_eq!((served.code, served.out.as_str()), (Some(124), "axis 1: at 1000000\n"), "{served:?}");
    let last = without_times(served.err.lines().last().expect("a line"));
    assert!(last.starts_with("warning: ") && last.contains("frames are missing: File too large"), "{served:?}");
}

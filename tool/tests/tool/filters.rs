//! The filters of `ecmsk dump` and `ecmsk plot`: by slot, by command, by time.

use crate::common::motion::FakeBoard;
use crate::common::plots::{Recorded, two_axes};
use crate::common::svg::COLOURS;
use crate::common::{Ran, json_lines, run};
use ecmsk::sk::{MasterCommand, MasterState, SdoCommand, SlaveCommand, SlotSize};
use serde_json::Value;

/// A recording of two drives that are moved, one of them homed in between, and of an SDO.
fn mixed(size: SlotSize) -> Recorded {
    let mut board = FakeBoard::new(size, 2);
    for i in 0..10 {
        board.send(&[i, 2 * i]);
        board.cycle();
    }
    board.drives[0].id = 0x18;
    board.send_to(1, &SlaveCommand::GoHome);
    board.cycle();
    board.drives[0].id = 0x15;
    for i in 0..10 {
        board.send(&[i, 2 * i]);
        board.cycle();
    }
    board.master(&MasterCommand::SetState(MasterState::SafeOp));
    board.sdo(&SdoCommand::Read { slave: 2, object: ecmsk::coe::ObjectAddress::new(0x6064, 0) });
    Recorded::new(&board)
}

fn dump(recorded: &Recorded, options: &[&str]) -> Ran {
    run([&["dump", recorded.file.to_str().expect("UTF-8")], options].concat())
}

fn json(recorded: &Recorded, options: &[&str]) -> Vec<Value> {
    let out = dump(recorded, &[&["--json"], options].concat()).expect_quiet();
    json_lines(&out)
}

fn slots(frame: &Value) -> Vec<u64> {
    frame["slots"].as_array().expect("slots").iter().map(|slot| slot["slot"].as_u64().expect("a number")).collect()
}

/// `dump --slots` selects slots by number, range and word; the SDO slot is the last one of a frame in either slot size.
#[test]
fn dump_by_slot() {
    for (size, sdo) in [(SlotSize::Bytes12, 41), (SlotSize::Bytes16, 31)] {
        let recorded = mixed(size);
        let all = json(&recorded, &[]);
        for (list, expected) in [("0,2", vec![0, 2]), ("ecm,1-3,sdo", vec![0, 1, 2, 3, sdo]), ("sdo", vec![sdo])] {
            let frames = json(&recorded, &["--slots", list]);
            assert_eq!(frames.len(), all.len(), "{list}");
            assert!(frames.iter().all(|frame| slots(frame) == expected), "{list}");
        }
    }
    let wide = mixed(SlotSize::Bytes16);
    dump(&wide, &["--slots", "30-40"]).expect_failure(1, &["16-byte slots has no slot 32"], "name slots from 0 to 31");
    for wrong in ["3-1", "x", "1-", "300"] {
        dump(&wide, &["--slots", wrong]).expect_misuse(&["--slots", "ranges as 3-5", "`sdo`"]);
    }
}

/// `dump --commands` selects by the names of commands: it shows the frames with these commands and the reports that answer
/// them, and of both only the slots concerned.
#[test]
fn dump_by_command() {
    let recorded = mixed(SlotSize::Bytes12);
    let home = json(&recorded, &["--commands", "GO_HOME"]);
    let directions: Vec<_> = home.iter().map(|frame| frame["direction"].as_str().expect("a word")).collect();
    assert_eq!(directions, ["command", "response"]);
    assert!(home.iter().all(|frame| slots(frame) == [1] && frame["slots"][0]["id"] == "GO_HOME"), "{home:?}");
    let states = json(&recorded, &["--commands", "set_state,0x07"]);
    let ids: Vec<_> = states.iter().map(|frame| frame["slots"][0]["id"].as_str().expect("a word")).collect();
    assert_eq!(ids, ["SET_STATE", "SET_STATE", "SDO_RD"]);
    // Slot 0 of a report in OP has the name CYCLIC; with --slots both filters must match.
    let cyclic = json(&recorded, &["--commands", "CYCLIC"]);
    assert!(cyclic.len() == 22 && cyclic.iter().all(|frame| slots(frame) == [0]), "{}", cyclic.len());
    let second = json(&recorded, &["--commands", "CSP", "--slots", "2"]);
    assert!(second.len() > 40 && second.iter().all(|frame| slots(frame) == [2]));
    let [sent, answered] = ["command", "response"].map(|direction| {
        let frames = json(&recorded, &["--commands", "CSP", "--direction", direction]);
        assert!(frames.iter().all(|frame| frame["direction"] == direction), "{direction}");
        frames.len()
    });
    assert_eq!((sent, sent + answered), (20, json(&recorded, &["--commands", "CSP"]).len()));
    dump(&recorded, &["--direction", "up"]).expect_misuse(&["--direction", "allowed: command, response"]);
    dump(&recorded, &["--commands", "CPS"]).expect_misuse(&["--commands", "CSP", "SET_STATE", "CYCLIC"]);
    // The frame with SET_AXIS is not shown, but it gives the kinds of the slaves.
    assert_eq!(second.last().expect("frames")["slots"][0]["kind_from"], "given");
}

/// `dump --from --to` selects frames by times with a unit, both ends included; a note says if nothing is left.
#[test]
fn dump_by_time() {
    let recorded = mixed(SlotSize::Bytes12);
    let all = json(&recorded, &[]);
    let at = |frame: &Value| frame["time_ns"].as_i64().expect("a time");
    let (from, to) = (at(&all[10]), at(&all[20]));
    for (from_text, to_text) in [
        (format!("{}", from as f64 / 1e9), format!("{}s", to as f64 / 1e9)),
        (format!("{}ms", from as f64 / 1e6), format!("{}us", to as f64 / 1e3)),
    ] {
        let some = json(&recorded, &["--from", &from_text, "--to", &to_text]);
        assert_eq!(some, all[10..=20], "{from_text} {to_text}");
    }
    // The kinds of slaves are known from earlier frames.
    let late = json(&recorded, &["--from", "5ms", "--slots", "1"]);
    assert_eq!(late.last().map(|frame| &frame["slots"][0]["slot"]), Some(&1.into()));
    let none = dump(&recorded, &["--from", "1h"]);
    none.expect_misuse(&["--from", "500ms"]);
    let none = dump(&recorded, &["--json", "--from", "100"]);
    assert_eq!((none.code, none.out.as_str()), (Some(0), ""));
    assert!(none.err.starts_with(&format!("note: none of {} frames is left; change ", all.len())), "{}", none.err);
    run(["dump", "--hex", "--from", "1"]).expect_misuse(&["--from", "--hex"]);
}

/// `dump --changes` shows the first frame as a whole, and then only slots whose content differs from the frame before in the same
/// direction; frames without one are left out.
#[test]
fn dump_of_changes() {
    let mut board = FakeBoard::new(SlotSize::Bytes12, 2);
    for _ in 0..20 {
        board.send(&[0, 0]);
        board.cycle();
    }
    for _ in 0..20 {
        board.send(&[0, 200]);
        board.cycle();
    }
    let recorded = Recorded::new(&board);
    let changed: Vec<_> = json(&recorded, &["--changes", "--direction", "command"]).iter().map(slots).collect();
    // SET_AXIS, SET_STATE, the first targets, and the target of axis 2.
    assert_eq!(changed, [vec![0], vec![0], vec![0, 1, 2], vec![2]]);
    let answers = json(&recorded, &["--changes", "--direction", "response", "--slots", "1-2"]);
    assert_eq!(slots(&answers[0]), [1, 2]);
    let moving: Vec<_> = answers[1..].iter().filter(|frame| slots(frame) == [2]).collect();
    // The drive goes a tenth of the way in each cycle, until less than ten counts are left.
    assert!((15..=20).contains(&moving.len()), "{}", moving.len());
    assert!(answers.len() - moving.len() <= 3, "{answers:?}");
    assert!(json(&recorded, &["--changes", "--from", "30ms", "--to", "31ms", "--direction", "response"]).len() <= 2);
}

/// `plot` selects axes by ranges, and commands; if nothing is left there is an error and no plot.
#[test]
fn plot_by_axis_and_command() {
    let (run, _) = two_axes();
    let recorded = Recorded::new(&run);
    let plot = recorded.plot(&["--slots", "1-2", "--from", "400ms", "--to", "0.5s"]);
    assert_eq!(plot.panel_names()[..2], ["Axis 1: position (counts)", "Axis 2: position (counts)"]);
    recorded.try_plot(&["--axes", "9"]).expect_failure(1, &["axis 9 is empty"], "name some of 1, 2 with --axes");
    recorded.try_plot(&["--axes", "1", "--commands", "CSV,GO_HOME"]).expect_failure(
        1,
        &["nothing is left of axis 1", "CSV, GO_HOME"],
        "change --commands",
    );
    recorded.try_plot(&["--from", "100"]).expect_failure(1, &["asked for 100 s and later"], "change --from or --to");
    assert!(!recorded.file.with_extension("svg").exists());
}

/// With `--commands` the curve begins where the slot answers the command; there is no curve before.
#[test]
fn plot_of_a_command() {
    let mut board = FakeBoard::new(SlotSize::Bytes12, 1);
    let mut csp = Vec::new();
    for i in 0..300 {
        board.drives[0].id = if i < 100 { 0x00 } else { 0x15 };
        board.send(&[100 + i]);
        board.cycle();
        csp.push(board.seconds());
    }
    let recorded = Recorded::new(&board);
    let from = |options: &[&str]| recorded.plot(options).panel("Axis 1").samples(COLOURS[0], false)[0].0;
    assert!(from(&[]) < 0.01);
    let begin = from(&["--commands", "CSP"]);
    assert!((begin - csp[100]).abs() < 0.001, "{begin}, not {}", csp[100]);
}

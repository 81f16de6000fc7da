//! The flight recorder of a link, `flight=`: a folder on the disk. What it does in a folder that fails or loses its power
//! is tested in `src/link/record/flight/tests.rs`.

use std::path::{Path, PathBuf};
use std::time::Duration;

use ecmsk::link::record::flight::{self, FlightContents, Kind};
use ecmsk::link::{self, Dir, Link, LinkError, Share, Wait};
use ecmsk::recording::lacks_at_end;
use ecmsk::sk::{Frame, MasterCommand, MasterResponse, MasterState, SlaveKind, SlotSize};
use support::recorded::Program;
use support::recording::read_file;
use tempfile::TempDir;

fn new_folder() -> (TempDir, PathBuf) {
    let above = tempfile::tempdir().unwrap();
    let folder = above.path().join("flight");
    (above, folder)
}

/// Runs the program with a flight recorder, and with a recording beside it, whose frames it returns.
fn run(folder: &Path, script: &str, keys: &str) -> Vec<(u64, Dir, Frame)> {
    let keys = format!("&flight={}{keys}", folder.display());
    let beside = folder.parent().unwrap();
    let file = beside.join("run.pcapng");
    Program { script: script.into(), keys, ..Program::default() }.record_to(&file, &beside.join("script"));
    frames(&file)
}

/// The frames of a file, with their times and directions.
fn frames(file: &Path) -> Vec<(u64, Dir, Frame)> {
    read_file(file).into_iter().map(|recorded| (recorded.at_ns, recorded.dir, *recorded.frame)).collect()
}

/// The kinds of the reasons of each kept moment.
fn kinds(contents: &FlightContents) -> Vec<Vec<Kind>> {
    let kinds = contents.moments.iter();
    kinds.map(|kept| kept.moment.reasons.iter().map(|reason| reason.kind).collect()).collect()
}

/// The frames that passed are in the segments, and those around an alarm in an ordinary recording of their own.
#[test]
fn an_alarm_is_kept() {
    let (_above, folder) = new_folder();
    let passed = run(&folder, "at 600ms alarm 2 0x7500 stays", "");
    let contents = FlightContents::of(&folder).unwrap();
    assert_eq!(kinds(&contents), [[Kind::Alarm]]);
    let kept = &contents.moments[0];
    let reason = &kept.moment.reasons[0];
    assert!(reason.text.contains("slave 2 has an alarm, 0x7500"), "{}", reason.text);
    assert!(kept.moment.is_virtual && reason.at_ns > 590_000_000, "{}", reason.at_ns);
    for file in [kept.file.as_ref().unwrap(), &contents.segments[0].file] {
        assert!(frames(file) == passed, "{}", file.display());
        assert!(lacks_at_end(file).unwrap().is_nothing());
    }
    assert_eq!((contents.segments.len(), contents.writer), (1, None));
    assert_eq!(flight::lacks(&folder), None);
}

/// A following error beyond the limit is kept, and none without a limit or below it.
#[test]
fn a_following_error_beyond_the_limit_is_kept() {
    // Targets of the slaves are 10 and 20 counts apart, and the model's drives follow a cycle later at the earliest.
    for (keys, slaves) in [("", &[][..]), ("&flight_following_error=5", &[1, 2]), ("&flight_following_error=1000", &[])]
    {
        let (_above, folder) = new_folder();
        run(&folder, "", keys);
        let contents = FlightContents::of(&folder).unwrap();
        assert!(kinds(&contents).concat().iter().all(|kind| *kind == Kind::FollowingError), "{keys}");
        for slave in 1..=2 {
            let text = format!("slave {slave} is ");
            let mut reasons = contents.moments.iter().flat_map(|kept| &kept.moment.reasons);
            assert_eq!(reasons.any(|reason| reason.text.starts_with(&text)), slaves.contains(&slave), "{keys} {slave}");
        }
    }
}

fn uri(folder: &Path, keys: &str) -> String {
    format!("sim:?slaves=drive&flight={}{keys}", folder.display())
}

/// Lets the board with one drive come to OP.
fn to_op(board: &dyn Link) {
    let mut kinds = [SlaveKind::None; 8];
    kinds[0] = SlaveKind::Drive;
    for command in [MasterCommand::SetAxis { group: 0, kinds }, MasterCommand::SetState(MasterState::Op)] {
        let mut frame = Frame::new();
        frame.put_master(SlotSize::Bytes12, &command);
        frame.fill_crc(SlotSize::Bytes12);
        board.write(&frame, Wait::Forever).unwrap();
    }
    let mut report = Frame::new();
    for _ in 0..20_000 {
        board.read(&mut report, Wait::Forever).unwrap();
        let state = MasterResponse::decode(&report.slot(SlotSize::Bytes12, 0)).state;
        if state.state() == Some(MasterState::Op) {
            return;
        }
    }
    panic!("never in OP");
}

/// A slave that is lost in OP is kept as such.
#[test]
fn a_lost_slave_is_kept() {
    let (above, folder) = new_folder();
    let script = above.path().join("script");
    std::fs::write(&script, "at 2s lose 1\n").unwrap();
    let keys = format!("&clock=virtual&script={}", script.display());
    let board = link::open(&uri(&folder, &keys), Share::ByName).unwrap();
    to_op(&*board);
    let mut report = Frame::new();
    for _ in 0..4000 {
        board.read(&mut report, Wait::Forever).unwrap();
    }
    board.close();
    let contents = FlightContents::of(&folder).unwrap();
    assert!(kinds(&contents).concat().contains(&Kind::LostSlave), "{:?}", contents.moments);
}

/// A second recording to a folder is refused and names the process; the first one goes on. A board that is opened again
/// goes on in its folder, with the next numbers.
#[test]
fn a_folder_has_one_recorder() {
    let (_above, folder) = new_folder();
    let uri = uri(&folder, "&clock=virtual");
    let mut report = Frame::new();
    for opening in 1..=3 {
        let board = link::open(&uri, Share::ByName).unwrap();
        board.read(&mut report, Wait::Forever).unwrap();
        match link::open(&uri, Share::ByName).map(drop) {
            Err(LinkError::Io { what, message }) => {
                assert!(
                    what.contains("cannot record to the folder") && message.contains("this process is"),
                    "{message}"
                );
            }
            other => panic!("{other:?}"),
        }
        assert!(FlightContents::of(&folder).unwrap().writer.is_some_and(|pid| pid == std::process::id()));
        board.read(&mut report, Wait::Forever).unwrap();
        board.close();
        let contents = FlightContents::of(&folder).unwrap();
        assert!(contents.segments.iter().map(|segment| segment.number).eq(1..=opening));
        assert_eq!(read_file(&contents.segments[opening as usize - 1].file).len(), 2);
    }
}

/// A folder that cannot be used is an error of opening the board, before anything moves.
#[test]
fn a_folder_that_cannot_be_used_is_an_error() {
    let (above, folder) = new_folder();
    std::fs::write(&folder, "a file").unwrap();
    for folder in [folder, above.path().join("not/there")] {
        let error = link::open(&uri(&folder, "&clock=virtual"), Share::ByName).map(drop).unwrap_err().to_string();
        assert!(error.contains("cannot record to the folder") && error.contains("name another folder"), "{error}");
    }
}

/// A folder that somebody removes ends the recording, and nothing else: the board goes on, and the frames that are not in
/// the recording are counted.
#[test]
fn a_folder_that_vanishes_stops_no_board() {
    let (_above, folder) = new_folder();
    let board = link::open(&uri(&folder, "&clock=virtual"), Share::ByName).unwrap();
    to_op(&*board);
    let mut report = Frame::new();
    let read = |report: &mut Frame, count: u64| {
        for _ in 0..count {
            board.read(report, Wait::Forever).unwrap();
        }
    };
    read(&mut report, 2_000);
    std::fs::remove_dir_all(&folder).unwrap();
    // More than a segment has.
    read(&mut report, 40_000);
    let state = MasterResponse::decode(&report.slot(SlotSize::Bytes12, 0)).state;
    assert_eq!(state.state(), Some(MasterState::Op));
    board.close();
    let dropped = board.stats().record_dropped;
    assert!((1..=42_000).contains(&dropped), "{dropped}");
    assert!(FlightContents::of(&folder).is_err());
}

/// A mark that is put into the folder before the board is closed is kept, on the real clock too.
#[test]
fn a_mark_is_kept_on_the_real_clock() {
    let (_above, folder) = new_folder();
    assert!(flight::mark(&folder, "too early").is_err());
    let board = link::open(&uri(&folder, ""), Share::ByName).unwrap();
    let mut report = Frame::new();
    board.read(&mut report, Wait::Forever).unwrap();
    let mark = flight::mark(&folder, "a noise").unwrap();
    // The recorder's thread may not have the report yet.
    std::thread::sleep(Duration::from_millis(50));
    board.read(&mut report, Wait::Forever).unwrap();
    board.close();
    assert!(!mark.exists());
    let contents = FlightContents::of(&folder).unwrap();
    assert_eq!(kinds(&contents), [[Kind::Mark]]);
    assert!(contents.moments[0].moment.reasons[0].text == "a noise" && contents.moments[0].file.is_some());
    assert!(flight::mark(&folder, "too late").is_err());
}

/// The last recording of a folder says whether it was ended.
#[test]
fn a_recording_that_was_not_ended_is_named() {
    let (_above, folder) = new_folder();
    let uri = uri(&folder, "&clock=virtual");
    let mut report = Frame::new();
    let board = link::open(&uri, Share::ByName).unwrap();
    board.read(&mut report, Wait::Forever).unwrap();
    assert_eq!(flight::lacks(&folder), None, "it goes on");
    board.close();
    // As a killed process leaves it, whose number is that of none.
    std::fs::write(folder.join("writer.txt"), "pid 0\nmissing 0\n").unwrap();
    assert!(flight::lacks(&folder).unwrap().contains("was not ended"));
    flight::prepare(&folder).unwrap();
    assert_eq!(flight::lacks(&folder), None);
    std::fs::write(folder.join("writer.txt"), "pid 0\nmissing 3\nwhy 3 frames are missing: any\nended\n").unwrap();
    assert!(flight::lacks(&folder).unwrap().starts_with("3 frames are missing: any"));
}

/// A chip that is opened as a chip has no flight recorder, and says so.
#[test]
fn a_chip_refuses_it() {
    let (_above, folder) = new_folder();
    let uri = format!("xf-sim:?slaves=drive&flight={}", folder.display());
    let error = ecmsk::link::chip::open(&uri).map(drop).unwrap_err().to_string();
    assert!(error.contains("`flight`") && error.contains("record a chip with record="), "{error}");
    assert!(!folder.exists());
}

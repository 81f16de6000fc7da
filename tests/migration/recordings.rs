//! Recordings of programs on a board, replayed on a board with its own slaves and on one whose slaves are behind a
//! chip. The same `compare` compares the answers with the recording, and each difference is a row of the table.

use std::path::PathBuf;

use ecmsk::compare::{CompareOptions, Comparison, Deviation, Side, Steps, compare_steps};
use ecmsk::link::uri::LinkUri;
use ecmsk::migrate::Row;
use ecmsk::replay::{FilesInLink, Replay};
use support::recorded::Program;
use support::root;
use tempfile::TempDir;

/// A recording, and the slaves that the board had.
struct Recording {
    name: &'static str,
    file: PathBuf,
    slaves: &'static str,
    /// The rows by which a chip differs, in this order: later answers, a longer way to OP, a longer wait for SDOs.
    rows: &'static [Row],
    /// Keys of the link to the chip.
    keys: &'static str,
}

/// The packet size newer chips start with.
const LARGE: &str = "&use_n=1024";

const ROWS: &[Row] = &[Row::Latency, Row::Start];

/// The project's captures, the recordings of docs/RECORDINGS.md, and similar ones.
fn recordings(folder: &TempDir) -> Vec<Recording> {
    let capture = |name| root().join("tests/recordings").join(name);
    let mut all = vec![
        // The program reads the board only every 2 to 5 ms, so that the latency does not show. With shorter packets an
        // input switched by the slave's own output arrives within the answer to the last command, in the recording
        // after it.
        Recording {
            name: "usbmon_12",
            file: capture("usbmon_12.pcap"),
            slaves: "drive,hsp2,io",
            rows: &[Row::Start],
            keys: LARGE,
        },
        Recording {
            name: "usbmon_16",
            file: capture("usbmon_16.pcap"),
            slaves: "drive,hsp2,io",
            rows: &[Row::Start],
            keys: LARGE,
        },
    ];
    for (name, program) in [
        ("a", Program::default()),
        ("slower", Program { keys: "&host_us=400".into(), polls: 2, ..Program::default() }),
        ("late", Program { pauses: &[(60, 14), (150, 11), (220, 30)], ..Program::default() }),
        ("repeats", Program { repeats: 3, polls: 1, ..Program::default() }),
        ("fast", Program { cycle_us: 500, ..Program::default() }),
        ("slow", Program { cycle_us: 2000, ..Program::default() }),
        ("short", Program { short: true, ..Program::default() }),
    ] {
        let file = folder.path().join(name).with_extension("pcapng");
        program.record_to(&file, &folder.path().join("script"));
        all.push(Recording { name, file, slaves: "drive*2,io", rows: ROWS, keys: "" });
    }
    all
}

/// Replays a recording on a model: the result, and by how many milliseconds the model took longer.
fn played(file: &std::path::Path, link: &str) -> (Comparison, i64) {
    let link = LinkUri::parse(link).expect("a link");
    let options = CompareOptions::default();
    let replay = Replay::open(file, Some(&link), &options, None, FilesInLink::Refused).expect("it is replayed");
    let (board, mut model) = replay.waiting_runs().expect("both runs");
    let size = replay.size();
    let found = compare_steps(Steps::new(board, size, false), Steps::new(&mut model, size, false), &options);
    (found, model.waited_ns() / 1_000_000)
}

/// XF-20.14 A recording replayed on a board gives the recorded answers, and takes no longer. Behind a chip it differs
/// only by rows of the table: answers come later (`latency`), and so does OP (`start`).
#[test]
fn recordings_on_both_models() {
    let folder = tempfile::tempdir().expect("a folder");
    for Recording { name, file, slaves, rows, keys } in recordings(&folder) {
        let (found, waited_ms) = played(&file, &format!("sim:?slaves={slaves}"));
        assert!(found.is_equal() && found.answers > 15, "{name}: {found}");
        assert_eq!((waited_ms, found.latency.usual, found.shifted_answers), (0, 0, 0), "{name}: {found}");

        let (found, waited_ms) = played(&file, &format!("xf-sim:?slaves={slaves}{keys}"));
        assert!(found.is_equal() && found.answers > 15, "{name}: {found}");
        let mut shown = Vec::new();
        if found.latency.usual != 0 {
            assert!((1..=8).contains(&found.latency.usual), "{name}: {found}");
            shown.push(Row::Latency);
        }
        if waited_ms > 0 {
            // 0.5 s of two drives, where the board takes 0.4; 0.8 s with a cycle other than the chip's default.
            assert!((40..=900).contains(&waited_ms), "{name}: {waited_ms} ms");
            shown.push(Row::Start);
        }
        assert_eq!(shown, rows, "{name}: {found}, {waited_ms} ms");
    }
}

/// XF-20.14 A difference of the recorded board is found on both models: a drive that had an alarm there. The model does
/// not show it, and the wait for it is bounded.
#[test]
fn what_was_otherwise_is_found_on_both_models() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("alarm.pcapng");
    let program = Program { script: "at 600ms alarm 2 0x7500 stays".into(), ..Program::default() };
    program.record_to(&file, &folder.path().join("script"));
    for scheme in ["sim", "xf-sim"] {
        let (found, waited_ms) = played(&file, &format!("{scheme}:?slaves=drive*2,io"));
        assert!((2000..3000).contains(&waited_ms), "{scheme}: {waited_ms} ms");
        let first = found.first.as_ref().unwrap_or_else(|| panic!("{scheme}: {found}"));
        let is_alarm = |what: &Deviation| match what {
            Deviation::ErrorCode { slave: 2, codes } => *codes == [0x7500, 0],
            Deviation::Fault { slave: 2, side: Side::A, error_code } => *error_code == 0x7500,
            _ => false,
        };
        assert!(first.what.iter().any(is_alarm), "{scheme}: {first}");
    }
}

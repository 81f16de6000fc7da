//! Programs written like the vendor's examples, in C++, C, C#, Python and Rust, on both links. They print the same, or
//! the program is in a table with the row by which it differs. The same applies to their frames and reports, by
//! `compare`.
#![cfg(target_os = "linux")]

use ecmsk::compare::{CompareOptions, Comparison, Deviation, files};
use ecmsk::migrate::Row;
use support::root;

/// Programs that print other numbers behind a chip: how many reports something took, an axis' position after a number
/// of reports, or how many frames a full FIFO has lost. Language, program, the row.
const DIFFER: [(&str, &str, Row); 10] = [
    ("cpp", "alarm_recovery", Row::Start),
    ("cpp", "habit_sdo_retry", Row::Latency),
    ("cpp", "habit_set_axis_burst", Row::Start),
    ("cpp", "habit_tight_writer", Row::Latency),
    ("cpp", "hsp_16b", Row::Latency),
    ("cpp", "operator_panel", Row::Start),
    ("c", "csv_cst", Row::Latency),
    ("csharp", "OperatorPanel", Row::Start),
    ("rust", "csv_cst", Row::Latency),
    ("rust", "hsp", Row::Latency),
];

/// A difference that a program may see behind a chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Otherwise {
    /// An axis has another position if the program switches it off while it moves, or sends it velocities.
    Position,
    /// A drive is in another state when the program leaves OP without having waited for it.
    State,
    /// Other commands are lost in a full FIFO.
    Lost,
    /// An alarm at a fixed time comes at another position of the motion.
    Alarm,
    /// The program requests the next object with another frame of its motion, since the previous answer came later.
    Command,
}

/// Programs for which `compare` reports a difference, its first finding, and the row.
const SEEN_OTHERWISE: [(&str, &str, Otherwise, Row); 16] = [
    ("cpp", "alarm_recovery", Otherwise::Alarm, Row::Start),
    ("cpp", "habit_reader_writer_threads", Otherwise::Position, Row::Latency),
    ("cpp", "habit_tight_writer", Otherwise::Lost, Row::Latency),
    ("cpp", "habit_two_writes_fifo_mark", Otherwise::Position, Row::Latency),
    ("cpp", "operator_panel", Otherwise::Alarm, Row::Start),
    ("cpp", "two_axes_12b", Otherwise::Position, Row::Latency),
    ("cpp", "two_axes_16b", Otherwise::Position, Row::Latency),
    ("c", "csv_cst", Otherwise::Position, Row::Latency),
    ("csharp", "OperatorPanel", Otherwise::Alarm, Row::Start),
    ("csharp", "TwoAxes12B", Otherwise::Position, Row::Latency),
    ("csharp", "TwoAxes16B", Otherwise::Position, Row::Latency),
    ("python", "two_axes", Otherwise::Position, Row::Latency),
    ("rust", "csv_cst", Otherwise::Position, Row::Latency),
    ("rust", "hsp", Otherwise::Command, Row::Latency),
    ("rust", "operator_panel", Otherwise::State, Row::Latency),
    ("rust", "two_axes", Otherwise::Position, Row::Latency),
];

/// Programs with several threads: virtual time depends on their scheduling, so that they may also be the same.
const THREADS: [&str; 2] = ["habit_reader_writer_threads", "habit_two_writes_fifo_mark"];

/// The first difference between the recordings of a program on a board and behind a chip.
fn otherwise(found: &Comparison) -> Option<Otherwise> {
    let what = &found.first.as_ref()?.what;
    let is = |wanted: fn(&Deviation) -> bool| what.iter().any(wanted);
    Some(match () {
        () if is(|what| matches!(what, Deviation::Command { .. })) => Otherwise::Command,
        () if is(|what| matches!(what, Deviation::ErrorCode { .. } | Deviation::Fault { .. })) => Otherwise::Alarm,
        () if is(|what| matches!(what, Deviation::Lost { .. })) => Otherwise::Lost,
        () if what.iter().all(|what| matches!(what, Deviation::Position { .. })) => Otherwise::Position,
        () if is(|what| matches!(what, Deviation::Statusword { .. })) => Otherwise::State,
        () => panic!("{found}"),
    })
}

/// Compares a program's frames and reports on a board with those behind a chip.
fn sees_the_same(language: &str, name: &str, recordings: &[std::path::PathBuf; 2]) {
    let options = CompareOptions { ignore_repeats: true, ..CompareOptions::default() };
    let [board, chip] = recordings;
    let found = files(board, chip, &options).unwrap_or_else(|error| panic!("{language}, {name}: {error}"));
    let seen = otherwise(&found);
    let listed = SEEN_OTHERWISE.iter().find(|(of, program, ..)| (*of, *program) == (language, name));
    let expected = listed.map(|(.., otherwise, _)| *otherwise).filter(|_| !THREADS.contains(&name) || seen.is_some());
    let row = listed.map(|(.., row)| row.id());
    assert_eq!(seen, expected, "{language}, {name}, row {row:?}: {found}");
    // Answers come later, by no more than the row allows.
    assert!((0..=8).contains(&found.latency.usual), "{language}, {name}: {found}");
}

/// The link to the same slaves behind a chip. The way to OP takes longer there (the row `start`), so that the alarm "on the
/// way" has its own time.
fn behind_chip(link: &str) -> String {
    let link = link.replacen("sim:", "xf-sim:", 1);
    match link.split_once("&script=") {
        Some((link, script)) if script.ends_with("alarm_on_the_way.ecmscript") => {
            let later = support::script_client::file("alarm-on-the-way-behind-chip", "at 4s alarm 2 0x7500\n");
            format!("{link}&script={}", later.display())
        }
        _ => link,
    }
}

/// Compares a program's output on a link with its output behind a chip. A program of the table ends successfully, and
/// differs.
fn prints_the_same(language: &str, name: &str, link: &str, run: impl Fn(&str) -> support::Ended) {
    let folder = tempfile::tempdir().expect("a folder");
    let recordings = ["board", "chip"].map(|name| folder.path().join(name).with_extension("pcapng"));
    let links = [link.to_owned(), behind_chip(link)];
    let [board, chip] = [0, 1].map(|n| {
        let link = format!("{}&record={}", links[n], recordings[n].display());
        let ended = run(&link);
        assert_eq!(ended.stderr, "", "{name} on {link}");
        ended.success()
    });
    let listed = DIFFER.iter().find(|(of, program, _)| (*of, *program) == (language, name));
    match listed {
        None => assert_eq!(chip, board, "{name} on {link}"),
        Some((.., row)) => {
            assert!(!chip.is_empty() && chip != board, "{language}, {name}: take it out of the table ({row})");
        }
    }
    sees_the_same(language, name, &recordings);
}

fn scripted(link: &str, script: &str) -> String {
    format!("{link}&script={}/examples/scripts/{script}.ecmscript", root().display())
}

/// XF-20.11 XF-20.15 Programs on the native API. `homing` is not among them: behind a chip, its refused homing is taken
/// for a successful one, since the report in which the drive shows neither result is missed there.
#[test]
fn rust_programs() {
    const DRIVES: &str = "sim:?slaves=drive*2&clock=virtual";
    for (name, link) in [
        ("two_axes", DRIVES),
        ("alarm_recovery", DRIVES),
        ("csv_cst", DRIVES),
        ("operator_panel", DRIVES),
        ("move_axis", "sim:?slaves=drive&clock=virtual"),
        ("hsp", "sim:?slaves=hsp2&slot=16&clock=virtual"),
        ("io", "sim:?slaves=io&clock=virtual"),
    ] {
        prints_the_same("rust", name, link, |link| support::run(support::example(name).arg(link).current_dir(root())));
    }
}

mod needs_cxx {
    use super::*;
    use support::Language;
    use support::examples::{C, CPP, SCRIPTS};

    /// XF-20.11 XF-20.15 All programs of examples/cpp and examples/c.
    #[test]
    fn programs_in_cpp_and_c() {
        let of = |folder, standard| move |(name, link)| (name, link, folder, standard);
        let cpp = CPP.into_iter().map(of("cpp", Language::Cpp("c++17")));
        for (name, link, folder, language) in cpp.chain(C.into_iter().map(of("c", Language::C("c99")))) {
            let source = root().join("examples").join(folder).join(name).with_extension(folder);
            let program = support::compile(&source, language);
            let script = SCRIPTS.into_iter().find(|(program, _)| *program == name);
            let link = script.map_or(link.to_owned(), |(_, script)| scripted(link, script));
            prints_the_same(folder, name, &link, |link| program.run(link, [""; 0]));
        }
    }
}

mod needs_python {
    use super::*;
    use support::examples::{PYTHON, run_python};

    /// XF-20.11 XF-20.15 All programs of examples/python/ctypes.
    #[test]
    fn programs_in_python() {
        for (name, link) in PYTHON {
            prints_the_same("python", name, link, |link| run_python(name, link));
        }
    }
}

mod needs_mono {
    use super::*;
    use support::dotnet::{EXAMPLES, VIRTUAL, example};

    /// XF-20.11 XF-20.15 All programs of examples/csharp, under Mono.
    #[test]
    fn programs_in_csharp() {
        let scripts = root().join("examples/scripts");
        for (name, _, keys) in EXAMPLES {
            let link = format!("{VIRTUAL}{}", keys.replace("SCRIPTS", scripts.to_str().expect("UTF-8")));
            prints_the_same("csharp", name, &link, |link| support::run(&mut example(name).under("mono", &[], link)));
        }
    }
}

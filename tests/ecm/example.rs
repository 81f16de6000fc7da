//! The examples of the native API run and print what they promise: on virtual time what `tests/snapshots/` holds.
#![cfg(target_os = "linux")]

use std::fs;

use support::{Ended, root};

const DRIVES: &str = "sim:?slaves=drive*2&clock=virtual";

fn run(example: &str, link: Option<&str>) -> Ended {
    support::run(support::example(example).args(link).current_dir(root()))
}

/// Without a link, and on links with the same result, it prints its snapshot.
fn prints_its_snapshot(example: &str, links: &[&str]) {
    for link in std::iter::once(None).chain(links.iter().copied().map(Some)) {
        let ended = run(example, link);
        assert_eq!(ended.stderr, "", "{example} on {link:?}");
        support::snapshot(&format!("rust_{example}"), &ended.success());
    }
}

/// A link with what happens by a script of `examples/scripts/`.
fn scripted(link: &str, script: &str) -> String {
    format!("{link}&script=examples/scripts/{script}.ecmscript")
}

/// SK-5.11 Two axes go where they are sent.
#[test]
fn two_axes() {
    prints_its_snapshot("two_axes", &[&format!("{DRIVES}&fw=1.5&slot=16")]);
}

/// SK-4.10 Errors are printed with the next step.
#[test]
fn two_axes_on_a_board_of_three() {
    let ended = run("two_axes", Some("sim:?slaves=drive*3&clock=virtual"));
    assert_eq!(ended.status.code(), Some(1));
    assert!(ended.stderr.ends_with("correct `slaves`, or check cables and power\n"), "{}", ended.stderr);
}

/// The shortest program moves an axis, and ends with words where it cannot.
#[test]
fn move_axis() {
    let link = "sim:?slaves=drive&clock=virtual";
    for link in [link, &format!("{link}&fw=1.5&slot=16"), "sim:?slaves=drive&clock=real"] {
        let said = run("move_axis", Some(link)).success();
        assert!(
            said.starts_with("StreamStats { frames: 1000, underruns: ") && said.ends_with("losses: 0 }\n"),
            "{said}"
        );
    }
    let ended = run("move_axis", Some("sim:?slaves=none&clock=virtual"));
    assert_eq!(ended.status.code(), Some(1));
    assert!(ended.stderr.starts_with("Error: no board at `sim:") && ended.stderr.ends_with("`slaves=`\n"), "{ended:?}");
}

/// The same program moves the axis of a board that is served, and does it again where it left off.
#[test]
fn move_axis_of_a_served_board() {
    use ecmsk::link::{self, Share};
    use ecmsk::port::tcp::{ServeOptions, Server};

    let open = || link::open("sim:?slaves=drive&clock=virtual&name=served", Share::ByName);
    let listen = "127.0.0.1:0".parse().expect("an address");
    let server = Server::start(open, ServeOptions { listen, ..ServeOptions::default() }).expect("it is served");
    let uri = format!("tcp://{}", server.address());
    let ends = [(); 2].map(|()| {
        let said = run("move_axis", Some(&uri)).success();
        assert!(said.starts_with("StreamStats { frames: 1000, underruns: 0, "), "{said}");
        let ecm = ecmsk::Ecm::open(&uri).expect("the program has left");
        ecm.adopt(&ecmsk::ecm::Config::drives(1)).expect("it is in OP");
        let end = ecm.snapshot().expect("a report").position(1).expect("it is a drive");
        ecm.close(ecmsk::ecm::Close::Leave).expect("nothing to do");
        end
    });
    for (end, told) in ends.into_iter().zip([10_000_i32, 20_000]) {
        // It was stopped at full speed, 10 counts per cycle, and may still settle.
        assert!(end.abs_diff(told) <= 10, "{end}, told {told}");
    }
    server.stop();
}

/// README shows that program, and the guide's programs run as doc tests.
#[test]
fn readme_shows_the_shortest_program() {
    let read = |file: &str| fs::read_to_string(root().join(file)).expect("a file of the repository");
    let program = read("examples/rust/move_axis.rs");
    let (_, program) = program.split_once("\n\n").expect("its comment, then the program");
    assert!(read("README.md").contains(&format!("```rust\n{program}```\n")), "README has another program");
    assert!(read("src/ecm/mod.rs").contains("include_str!(\"../../docs/GUIDE.md\")"));
    assert!(!read("docs/GUIDE.md").contains("```rust,"), "every program of the guide runs");
}

/// SK-7.19 SK-7.24 Both axes home at once, move, and a homing fails: the same on both firmwares.
#[test]
fn homing() {
    prints_its_snapshot("homing", &[&format!("{DRIVES}&fw=1.5")]);
}

/// SK-7.11 An alarm during the motion is cleared and the motion goes on; one that stays ends the program with its text.
#[test]
fn alarm_recovery() {
    prints_its_snapshot("alarm_recovery", &[&format!("{DRIVES}&fw=1.5&slot=16")]);
    let on_the_way = run("alarm_recovery", Some(&scripted(DRIVES, "alarm_on_the_way")));
    support::snapshot("rust_alarm_on_the_way", &on_the_way.success());
    let stays = run("alarm_recovery", Some(&scripted(DRIVES, "alarm_that_stays")));
    assert_eq!(stays.status.code(), Some(1));
    assert!(stays.stdout.contains("axis 1: alarm 0x7305"), "{stays:?}");
    assert!(
        stays
            .stderr
            .starts_with("Error: slave 1 has alarm 0x7305: sensor (encoder, resolver, tacho); remove the cause"),
        "{stays:?}"
    );
}

/// The same lines as the program in C prints.
#[test]
fn io() {
    let link = scripted("sim:?slaves=io&clock=virtual", "local_inputs");
    for link in [link.clone(), format!("{link}&fw=1.5"), format!("{link}&slot=16")] {
        support::snapshot("io", &run("io", Some(&link)).success());
    }
}

/// API-10 SK-4.26 SK-4.27 One drive by velocity, one by torque.
#[test]
fn csv_cst() {
    prints_its_snapshot("csv_cst", &[&format!("{DRIVES}&fw=1.5")]);
}

/// SK-3.22 SK-3.23 Both channels of a pulse module, with outputs and inputs of each.
#[test]
fn hsp() {
    prints_its_snapshot("hsp", &["sim:?slaves=hsp2&slot=16&clock=virtual&fw=1.5"]);
}

/// API-23 A panel: buttons at wrong moments say why they do not go; an alarm while jogging.
#[test]
fn operator_panel() {
    prints_its_snapshot("operator_panel", &[&format!("{DRIVES}&fw=1.5")]);
    let alarm = run("operator_panel", Some(&scripted(DRIVES, "alarm")));
    support::snapshot("rust_operator_panel_alarm", &alarm.success());
}

/// The programs of the folder that are none on this API: `tests/spi/example.rs` and `tests/xf_api/example.rs` run them.
const ELSEWHERE: [&str; 2] = ["spi_board", "xf_two_axes"];
/// The lines of a program; one for a chip has to say more.
const LINES: [(&str, usize); 3] = [("xf_", 120), ("spi_board", 120), ("", 70)];

/// Every program of the folder is one of these, and is short.
#[test]
fn no_example_is_left_out() {
    let tests = fs::read_to_string(root().join("tests/ecm/example.rs")).expect("this file");
    for entry in fs::read_dir(root().join("examples/rust")).expect("the folder") {
        let path = entry.expect("readable").path();
        if path.is_dir() {
            continue;
        }
        let name = path.file_stem().expect("a name").to_string_lossy().into_owned();
        assert!(ELSEWHERE.contains(&name.as_str()) || tests.contains(&format!("fn {name}()")), "{name} has no test");
        let lines = fs::read_to_string(&path).expect("a program").lines().count();
        let most = LINES.iter().find(|(begin, _)| name.starts_with(begin)).expect("any name").1;
        assert!(lines <= most, "{name} has {lines} lines");
    }
}

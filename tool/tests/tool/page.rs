//! The tool's pages, and README: the commands of a page run in one shell and print the output below them.
#![cfg(target_os = "linux")]

use std::net::{Ipv4Addr, TcpListener};
use std::path::Path;
use std::process::Command;

use support::console::{self, Shown};

/// The pages with commands, and the number of commands that each has at least.
const PAGES: [(&str, usize); 7] = [
    ("docs/TOOL.md", 20),
    ("docs/TOOL-NETWORK.md", 10),
    ("docs/TOOL-RECORDINGS.md", 5),
    ("docs/MACHINE.md", 5),
    ("docs/WEB.md", 2),
    ("docs/DEAD-BOARD.md", 10),
    ("README.md", 3),
];

fn page(file: &str) -> Vec<Shown> {
    console::commands(&std::fs::read_to_string(support::root().join(file)).expect("the page"))
}

/// Runs the commands of a page in one shell, in an empty folder, and returns the output of each. `keys` are added to the page's
/// simulated link, such as a virtual clock.
fn run(shown: &[Shown], keys: &str) -> Vec<String> {
    let folder = tempfile::tempdir().expect("a folder");
    // Another process of this machine may listen on the page's port 4711, so a free port replaces it.
    let port = free_port().to_string();
    let changed = |command: &str| {
        let command = command.replace("sim:?slaves=drive*2,io", &format!("sim:?slaves=drive*2,io{keys}"));
        command.replace("serve tcp ", &format!("serve tcp --listen 127.0.0.1:{port} ")).replace("4711", &port)
    };
    let tool = Path::new(env!("CARGO_BIN_EXE_ecmsk")).parent().expect("its folder");
    let path = format!("{}:{}", tool.display(), std::env::var("PATH").expect("it is set"));
    let mut bash = Command::new("bash");
    bash.current_dir(folder.path()).env("PATH", path).env_remove("ECMSK_LOG");
    let said = console::run(&mut bash, shown.iter().map(|shown| changed(&shown.command)));
    // Lines of progress are not compared, because their number depends on the speed of the machine.
    let without_progress =
        |text: &str| -> String { text.split_inclusive('\n').filter(|line| !line.starts_with("progress: ")).collect() };
    said.iter().map(|text| without_progress(&text.replace(keys, "").replace(&port, "4711"))).collect()
}

/// A TCP port that was free when this function asked the system for one.
fn free_port() -> u16 {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).expect("there is one");
    listener.local_addr().expect("it has one").port()
}

/// Every command of the pages prints the shown output, in virtual time to the byte.
#[test]
fn every_command_of_the_pages_prints_what_they_show() {
    for (file, least) in PAGES {
        let shown = page(file);
        assert!(shown.len() >= least, "{shown:?}");
        for (shown, said) in shown.iter().zip(run(&shown, "&clock=virtual")) {
            assert_eq!(said, shown.output, "{file}: $ {}", shown.command);
        }
    }
}

/// On the real clock each command of the pages that should succeed does so. If the machine is late for a chip, a command may
/// report a missing answer: then the page is run again.
#[test]
fn every_command_of_the_pages_succeeds_on_the_real_clock() {
    const TRIES: usize = 5;
    let has_error = |text: &str| text.lines().any(|line| line.starts_with("error: "));
    for (file, _) in PAGES {
        let shown = page(file);
        let mut wrong = String::new();
        let is_as_shown = (0..TRIES).any(|_| {
            let said = run(&shown, "&clock=real");
            let mut pairs = shown.iter().zip(said);
            let other = pairs.find(|(shown, said)| has_error(said) != has_error(&shown.output));
            wrong = other.map(|(shown, said)| format!("$ {}\n{said}", shown.command)).unwrap_or_default();
            let is_late = wrong.contains("error: no answer to ");
            assert!(wrong.is_empty() || is_late, "{file}: {wrong}");
            !is_late
        });
        assert!(is_as_shown, "{file}: {wrong}");
    }
}

//! docs/DEAD-BOARD.md: the lines that make the service of the package one for the network.
#![cfg(target_os = "linux")]

use std::fs;
use std::process::Command;

use ecmsk::link::uri::LinkUri;
use support::console;

use crate::common::{Ran, ecmsk};

/// The text of the first block of that language which has this word.
fn block<'a>(page: &'a str, language: &'a str, word: &str) -> &'a str {
    let found = console::blocks(page, language).find(|block| block.contains(word));
    found.unwrap_or_else(|| panic!("no block `{language}` with {word}"))
}

/// The tool takes the command line of the page, and the link and the card of its settings belong together. systemd accepts the
/// service with these lines, where it is installed.
#[test]
fn the_service_serves_a_board_on_the_network() {
    let page = fs::read_to_string(support::root().join("docs/DEAD-BOARD.md")).expect("the page");
    let drop_in = block(&page, "ini", "ExecStart=");
    let settings = block(&page, "text", "ECMSK_LINK=nic:");
    let value = |name: &str| settings.lines().find_map(|line| line.strip_prefix(name)).expect("a setting");
    let link = LinkUri::parse(value("ECMSK_LINK=")).expect("a link");
    assert_eq!(link.path(), value("BOARD_CARD="));

    let starts: Vec<&str> = drop_in.lines().filter_map(|line| line.strip_prefix("ExecStart=")).collect();
    let ["", start] = starts[..] else { panic!("the unit's own command goes first: {starts:?}") };
    let words: Vec<&str> = start.strip_prefix("ecmsk ").expect("the tool").split(' ').collect();
    // A link that is refused after the options were taken.
    let ran = Ran::from(ecmsk(words).env("ECMSK_LINK", "sim:?slaves=whale").output().expect("the tool starts"));
    assert!(ran.code != Some(0) && ran.err.contains("whale"), "{ran:?}");

    let copy = tempfile::tempdir().expect("a folder");
    let unit = copy.path().join("ecmsk-board.service");
    // Commands have to exist where the unit is verified.
    let there = |text: &str| text.replace("=ecmsk serve", "=/bin/true serve").replace("=-ip ", "=-/bin/true ");
    let folder = support::root().join("share/systemd");
    fs::write(&unit, there(&fs::read_to_string(folder.join("ecmsk-board.service")).expect("the unit")))
        .expect("a file");
    fs::create_dir(copy.path().join("ecmsk-board.service.d")).expect("a folder");
    fs::write(copy.path().join("ecmsk-board.service.d/override.conf"), there(drop_in)).expect("a file");
    match Command::new("systemd-analyze").arg("verify").arg(&unit).output() {
        Ok(output) => assert!(output.status.success(), "{output:?}"),
        Err(error) => assert_eq!(error.kind(), std::io::ErrorKind::NotFound, "systemd is not installed: {error}"),
    }
}

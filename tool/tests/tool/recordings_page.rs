//! `docs/RECORDINGS.md`: every command in it is run, and the output below it is what the tool prints.

use std::fs;
use std::path::Path;

use crate::common::{Ran, ecmsk};
use support::recorded::Program;

const BLOCK: &str = "```console\n";

/// Makes the recordings that the commands of docs/RECORDINGS.md read.
fn record(folder: &Path) {
    for (name, program) in [
        ("a", Program::default()),
        ("slower", Program { keys: "&host_us=400".into(), polls: 2, ..Program::default() }),
        ("chip", Program { scheme: "xf-sim", ..Program::default() }),
        ("late", Program { pauses: &[(60, 14), (150, 11), (220, 30)], ..Program::default() }),
        ("alarm", Program { script: "at 600ms alarm 2 0x7500 stays".into(), ..Program::default() }),
    ] {
        program.record_to(&folder.join(name).with_extension("pcapng"), &folder.join("script"));
    }
}

/// The text of the page with the outputs that its commands print now.
fn run_again(page: &str, folder: &Path) -> String {
    let mut blocks = page.split(BLOCK);
    let mut again = blocks.next().unwrap_or_default().to_owned();
    for block in blocks {
        let (block, rest) = block.split_once("```").expect("a block ends");
        let command = block.lines().next().and_then(|line| line.strip_prefix("$ ecmsk ")).expect("a command");
        let ran = Ran::from(ecmsk(command.split(' ')).current_dir(folder).output().expect("the tool starts"));
        assert_eq!(ran.err, "", "{command}");
        let different = command.starts_with("compare") && !ran.out.contains("\nequal: ");
        assert_eq!(ran.code, Some(i32::from(different)), "{command}");
        again += &format!("{BLOCK}$ ecmsk {command}\n{}```{rest}", ran.out);
    }
    again
}

/// The page of recordings shows what the tool does, and its pictures are the tool's.
#[test]
fn the_recordings_page_shows_what_the_tool_prints_and_draws() {
    let folder = tempfile::tempdir().expect("a folder");
    record(folder.path());
    let docs = support::root().join("docs");
    let page = docs.join("RECORDINGS.md");
    let text = fs::read_to_string(&page).expect("the page");
    let again = run_again(&text, folder.path());
    assert!(again.matches(BLOCK).count() >= 6, "{again}");
    support::kept(&page, &again);
    for picture in ["plot.svg", "compare.svg"] {
        assert!(text.contains(&format!("(recordings/{picture})")), "{picture}");
        let drawn = fs::read_to_string(folder.path().join(picture)).expect("a picture");
        support::kept(&docs.join("recordings").join(picture), &drawn);
    }
}

//! docs/PYTHON.md: its programs are files with the name in their first line, its commands print what the page shows.

use std::fs;
use std::process::Command;

use support::{root, run};

/// What the page has of one language.
struct Block {
    language: String,
    text: String,
}

fn blocks() -> Vec<Block> {
    let page = fs::read_to_string(root().join("docs/PYTHON.md")).expect("the page");
    let mut blocks: Vec<Block> = Vec::new();
    let mut is_inside = false;
    for line in page.lines() {
        match line.strip_prefix("```") {
            Some(language) if !is_inside => {
                is_inside = true;
                blocks.push(Block { language: language.to_owned(), text: String::new() });
            }
            Some(_) => is_inside = false,
            None if is_inside => blocks.last_mut().expect("a block").text += &format!("{line}\n"),
            None => {}
        }
    }
    blocks
}

/// Runs the commands of the page that `chosen` takes, by the way of `python`, in an empty folder, after the programs that
/// stand before them were written there. Returns how many there were.
pub fn check(python: impl Fn() -> Command, chosen: impl Fn(&str) -> bool) -> usize {
    let folder = tempfile::tempdir().expect("a folder");
    let mut count = 0;
    for Block { language, text } in blocks() {
        if language == "python" {
            let name = text.lines().next().and_then(|line| line.strip_prefix("# ")).expect("the name of the program");
            fs::write(folder.path().join(name), &text).expect("a program in the folder");
        }
        if language != "console" {
            continue;
        }
        let (command, shown) = text.split_once('\n').expect("a command");
        let command = command.strip_prefix("$ ").expect("a command");
        if !chosen(command) {
            continue;
        }
        // The program has the name of what it runs: `python3 FILE`, `pytest -q FILE | head -1`.
        let (words, lines) = command.split_once(" | head -").unwrap_or((command, "1000"));
        let words: Vec<&str> = words.split(' ').collect();
        let mut python = python();
        if words[0] == "pytest" {
            python.args(["-m", "pytest", "-p", "no:cacheprovider"]);
        }
        let ended = run(python.args(&words[1..]).current_dir(folder.path()));
        let lines: usize = lines.parse().expect("a number of lines");
        let said: String = ended.stdout.split_inclusive('\n').take(lines).collect();
        assert_eq!(said, shown, "$ {command}\n{}{}", ended.stdout, ended.stderr);
        count += 1;
    }
    count
}

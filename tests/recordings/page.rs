//! `docs/HARDWARE.md`.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

fn page(name: &str) -> String {
    fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs").join(name)).expect("a page")
}

/// Ids of rules in a text, as SK-9.4.
fn ids(text: &str) -> BTreeSet<&str> {
    let words = text.split(|c: char| !(c.is_ascii_alphanumeric() || c == '-' || c == '.'));
    let is_id = |word: &&str| ["SK-", "LIB-", "WIRE-", "WIN-"].iter().any(|start| word.starts_with(start));
    words.map(|word| word.trim_end_matches('.')).filter(is_id).collect()
}

/// The page has five steps, and each row about what only a board can show names existing rules.
#[test]
fn every_question_names_its_rule() {
    let hardware = page("HARDWARE.md");
    let rules = ["board", "library", "links"].map(|name| page(&format!("rules/{name}.md"))).concat();
    for step in 1..=5 {
        assert!(hardware.contains(&format!("\n{step}. **")), "step {step}");
    }
    let known: BTreeSet<&str> = rules.lines().filter_map(|line| line.strip_prefix("| ")?.split(' ').next()).collect();
    let questions = hardware.split("\n## What only a board can show").nth(1).expect("the chapter");
    let questions = questions.split("\n## ").next().expect("its text");
    let rows: Vec<&str> = questions.lines().filter(|line| line.starts_with("| ") && !line.contains("---")).collect();
    let mut asked = 0;
    for row in rows.iter().filter(|row| !row.starts_with("| question ")) {
        let ids = ids(row);
        assert!(!ids.is_empty() && ids.iter().all(|id| known.contains(id)), "{row}");
        asked += 1;
    }
    assert!(asked > 40, "{asked}");
    // Rules of the board's SPI that are not claimed yet are in a question.
    let later = rules
        .lines()
        .filter(|line| line.starts_with("| SK-10.") && line.contains("OURS") && line.ends_with("| later |"));
    for row in later {
        let id = row.trim_start_matches("| ").split(' ').next().expect("an id");
        assert!(ids(questions).contains(id), "{row}");
    }
}

//! `docs/HARDWARE.md` asks about every decision of this project about the DP3CL.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

fn page(name: &str) -> String {
    fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs").join(name)).expect("a page")
}

/// Each row of the chapter names existing rules, and each rule of the drive with a decision has a question, except
/// forced inputs, which no drive has.
#[test]
fn every_decision_has_its_question() {
    let (rules, hardware) = (page("rules/dp3cl.md"), page("HARDWARE.md"));
    let chapter = hardware.split("\n## You have a DP3CL\n").nth(1).expect("the chapter");
    let chapter = chapter.split("\n## ").next().expect("its text");
    let rows = chapter.lines().filter(|line| line.starts_with("| ") && !line.starts_with("| question"));
    let asked: BTreeSet<&str> = rows
        .filter(|row| !row.starts_with("| ---"))
        .flat_map(|row| row.rsplit('|').nth(1).expect("a column").split(',').map(str::trim))
        .collect();
    let of_drive = |id: &str| (1..=9).any(|section| id.starts_with(&format!("DP3CL-{section}.")));
    let rows = rules.lines().filter_map(|line| Some((line.strip_prefix("| ")?.split(' ').next()?, line)));
    let rows: Vec<(&str, &str)> = rows.filter(|(id, _)| of_drive(id)).collect();
    let known: BTreeSet<&str> = rows.iter().map(|(id, _)| *id).collect();
    assert!(asked.is_subset(&known), "{:?}", asked.difference(&known));
    let decided: BTreeSet<&str> = rows.iter().filter(|(_, row)| row.contains("OURS")).map(|(id, _)| *id).collect();
    let open: Vec<_> = decided.difference(&asked).collect();
    assert_eq!(open, [&"DP3CL-9.4"]);
}

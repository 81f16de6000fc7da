//! The table of differences: the rows in the code are the document's, and each row's test exists.

use std::collections::BTreeSet;
use std::fs;

use ecmsk::migrate::Row;
use support::root;

/// The rows of the table: their cells, without the marks of code.
fn rows() -> Vec<Vec<String>> {
    let page = fs::read_to_string(root().join("docs/MIGRATION.md")).expect("the page");
    let (_, table) = page.split_once("\n## What differs\n").expect("the chapter");
    let table = table.split("\n## ").next().expect("its text");
    let rows = table.lines().filter_map(|line| line.strip_prefix("| `")?.strip_suffix(" |"));
    rows.map(|row| row.split(" | ").map(|cell| cell.replace('`', "")).collect()).collect()
}

/// XF-20.1 The rows in the code are the document's, in the same order, and the files of tests that each names exist.
#[test]
fn the_table_is_that_of_the_document() {
    let rows = rows();
    let ids: Vec<&str> = rows.iter().map(|row| row[0].as_str()).collect();
    assert_eq!(ids, Row::ALL.map(Row::id));
    let mut here = BTreeSet::new();
    for row in &rows {
        let [_, what, figure, why, tests] = &row[..] else { panic!("{row:?}") };
        assert!([what, figure, why, tests].iter().all(|cell| !cell.trim().is_empty()), "{row:?}");
        for test in tests.split(", ") {
            assert!(root().join(test).is_file(), "{}: {test}", row[0]);
            here.extend(test.strip_prefix("tests/migration/").map(str::to_owned));
        }
    }
    // A file of this group that tests a row names it in its first line.
    for entry in fs::read_dir(root().join("tests/migration")).expect("the folder") {
        let file = entry.expect("readable");
        let text = fs::read_to_string(file.path()).unwrap_or_default();
        let name = file.file_name().to_string_lossy().into_owned();
        assert_eq!(text.starts_with("//! The row `"), here.contains(&name), "{name}");
    }
}

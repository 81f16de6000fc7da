//! The chapter of `docs/HARDWARE.md` for owners of a chip: it asks about every decision of this project.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// All files of `src/xf`, by their names from there.
fn sources() -> Vec<(String, String)> {
    let room = root().join("src/xf");
    let (mut folders, mut files) = (vec![room.clone()], Vec::new());
    while let Some(folder) = folders.pop() {
        let entries = fs::read_dir(folder).expect("a folder");
        let (inner, here): (Vec<PathBuf>, Vec<PathBuf>) =
            entries.map(|entry| entry.expect("an entry").path()).partition(|path| path.is_dir());
        folders.extend(inner);
        files.extend(here);
    }
    let name = |path: &Path| path.strip_prefix(&room).expect("below it").display().to_string().replace('\\', "/");
    files.iter().map(|path| (name(path), fs::read_to_string(path).expect("a source"))).collect()
}

/// The name that a line of code defines: of a constant, a function, a type, a variant, a field. Empty if it defines
/// none.
fn defined(line: &str) -> &str {
    const WORDS: [&str; 7] = ["pub ", "const ", "async ", "fn ", "struct ", "enum ", "static "];
    let mut rest = line.trim();
    let behind_word = |rest: &'_ str| -> Option<usize> {
        let scope = rest.starts_with("pub(").then(|| rest.find(") ")).flatten().map(|end| end + 2);
        scope.or_else(|| WORDS.iter().find(|word| rest.starts_with(**word)).map(|word| word.len()))
    };
    while let Some(at) = behind_word(rest) {
        rest = &rest[at..];
    }
    let end = rest.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(rest.len());
    let is_definition = ['(', ':', '<', ' ', ','].iter().any(|next| rest[end..].starts_with(*next));
    if is_definition { &rest[..end] } else { "" }
}

/// Every decision as file and name: the items whose comments have the tag.
fn decisions() -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for (file, source) in sources() {
        let lines: Vec<&str> = source.lines().collect();
        for (n, line) in lines.iter().enumerate().filter(|(_, line)| line.contains("[OURS]")) {
            // A tag before a colon is an explanation of the tag.
            if line.contains("`[OURS]`:") {
                continue;
            }
            assert!(line.trim().starts_with("///"), "{file}:{}: the tag stands at what it decides", n + 1);
            let code = |line: &&&str| !line.trim().starts_with("//") && !line.trim().starts_with("#[");
            let name = defined(lines[n..].iter().find(code).expect("code behind a comment"));
            assert!(!name.is_empty(), "{file}:{}: a decision is one constant, function or type", n + 1);
            found.insert(format!("{file}: {name}"));
        }
    }
    found
}

/// The rows of the chapter's tables.
fn rows(page: &str) -> Vec<&str> {
    let chapter = page.split("\n## You have an ECM-XF or ECM-XFU").nth(1).expect("the chapter");
    let chapter = chapter.split("\n## ").next().expect("its text");
    chapter
        .lines()
        .filter(|line| line.starts_with("| ") && !line.contains("---") && !line.contains("| where |"))
        .collect()
}

/// XF-13.5 Every decision in `src/xf`, and every assumption of the bus over a chip, has its question in
/// `docs/HARDWARE.md`, with the assumption, the test that answers it, and the rule; every question names existing
/// decisions.
#[test]
fn every_decision_has_its_question() {
    let page = fs::read_to_string(root().join("docs/HARDWARE.md")).expect("the page");
    let rules = fs::read_to_string(root().join("docs/rules/xf.md")).expect("the rules");
    let mut asked = BTreeSet::new();
    for row in rows(&page) {
        let cells: Vec<&str> = row.trim_matches('|').split(" | ").map(str::trim).collect();
        let [question, assumed, recipe, place] = cells[..] else { panic!("4 cells: {row}") };
        assert!([question, assumed, recipe].iter().all(|cell| !cell.is_empty()), "{row}");
        let rule = place.split(' ').next().expect("a rule");
        assert!(rules.contains(&format!("\n| {rule} | ")), "no rule {rule}: {row}");
        let names: Vec<&str> = place.split('`').skip(1).step_by(2).collect();
        assert!(!names.is_empty(), "{row}");
        for name in names {
            assert!(asked.insert(name.to_owned()), "asked twice: {name}");
        }
    }
    // The assumptions of the bus over a chip.
    let of_bus: Vec<String> = asked.extract_if(.., |place| place.starts_with("fieldbus/")).collect();
    for place in &of_bus {
        let (file, name) = place.split_once(": ").expect("a file and a name");
        let source = fs::read_to_string(root().join("src").join(file)).expect("its source");
        let begins = [format!("fn {name}("), format!("const {name}:")];
        let (above, _) =
            begins.iter().find_map(|begin| source.split_once(begin)).unwrap_or_else(|| panic!("nothing is {place}"));
        let (above, _) = above.rsplit_once('\n').expect("lines before it");
        let comment: Vec<&str> = above.lines().rev().take_while(|line| line.trim().starts_with("///")).collect();
        assert!(comment.iter().any(|line| line.contains("[OURS]")), "{place} is no decision");
    }
    let decided = decisions();
    let (unasked, undecided): (Vec<_>, Vec<_>) =
        (decided.difference(&asked).collect(), asked.difference(&decided).collect());
    assert!(unasked.is_empty() && undecided.is_empty(), "without a question: {unasked:#?}; of nothing: {undecided:#?}");
    assert!(decided.len() > 70, "{}", decided.len());
}

//! The rooms of `src/`: each uses only the rooms that CONTRIBUTING's table allows.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Which rooms a room may use; `None`: all.
type Table = BTreeMap<String, Option<BTreeSet<String>>>;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The words between backticks, without a `/` at their end.
fn quoted(cell: &str) -> impl Iterator<Item = String> {
    cell.split('`').skip(1).step_by(2).map(|word| word.trim_end_matches('/').to_owned())
}

/// The table with the columns `room`, what lives there, `may use`.
fn table(page: &str) -> Table {
    let mut table = Table::new();
    let rows = page.lines().skip_while(|line| !line.starts_with("| room |")).skip(2);
    for row in rows.take_while(|line| line.starts_with('|')) {
        let cells: Vec<&str> = row.trim_matches('|').split(" | ").map(str::trim).collect();
        let [rooms, _, may_use] = cells[..] else { panic!("a row of three cells: {row}") };
        let may_use = match may_use {
            "all" => None,
            "-" => Some(BTreeSet::new()),
            rooms => Some(quoted(rooms).collect()),
        };
        for room in quoted(rooms) {
            assert!(table.insert(room.clone(), may_use.clone()).is_none(), "{room} has two rows");
        }
    }
    table
}

/// The file that re-exports items of other rooms under their public paths. It may use those rooms and contains nothing
/// else.
const PATHS: &str = "src/link/paths.rs";

/// The source files of `src/` without tests.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("src/ can be read") {
        let path = entry.expect("an entry").path();
        let stem = path.file_stem().and_then(|stem| stem.to_str()).expect("a name in UTF-8");
        if stem == "tests" || stem.ends_with("_tests") {
            continue;
        }
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

/// The room of a file: the folder of `src/` that it is in, or the file itself.
fn room_of(file: &Path) -> String {
    let place = file.strip_prefix(root().join("src")).expect("a file of src/");
    let first = place.components().next().expect("a name").as_os_str().to_str().expect("UTF-8");
    first.trim_end_matches(".rs").to_owned()
}

/// A file's code: without its comments, and without its module of tests at its end.
fn code(text: &str) -> String {
    let tests = text.match_indices("\nmod ").map(|(at, _)| at).find(|at| {
        let condition = text[..*at].lines().next_back().unwrap_or_default();
        let declared = text[at + 1..].lines().next().unwrap_or_default();
        condition.starts_with("#[cfg(") && condition.contains("test") && declared.ends_with('{')
    });
    let text = &text[..tests.unwrap_or(text.len())];
    text.lines().map(|line| line.split("//").next().unwrap_or_default()).collect::<Vec<_>>().join("\n")
}

/// The first word after `begin` in all paths with that begin.
fn used(code: &str, begin: &str) -> BTreeSet<String> {
    let mut used = BTreeSet::new();
    for (at, found) in code.match_indices(begin) {
        let path = &code[at + found.len()..];
        let Some(group) = path.strip_prefix('{') else {
            used.insert(first_word(path));
            continue;
        };
        let (mut depth, mut begins) = (0, true);
        for (at, letter) in group.char_indices() {
            match letter {
                '{' => depth += 1,
                '}' if depth == 0 => break,
                '}' => depth -= 1,
                ',' if depth == 0 => begins = true,
                letter if begins && !letter.is_whitespace() => {
                    used.insert(first_word(&group[at..]));
                    begins = false;
                }
                _ => {}
            }
        }
    }
    used
}

fn first_word(path: &str) -> String {
    path.chars().take_while(|letter| letter.is_alphanumeric() || *letter == '_').collect()
}

/// Every file of `src/` uses only the rooms that CONTRIBUTING's table allows its room.
#[test]
fn each_room_uses_what_the_table_says() {
    let table = table(&fs::read_to_string(root().join("CONTRIBUTING.md")).expect("CONTRIBUTING.md"));
    let mut files = Vec::new();
    sources(&root().join("src"), &mut files);
    assert!(files.len() > 200, "{} files of src/ were found", files.len());
    let mut wrong = Vec::new();
    let mut rooms = BTreeSet::new();
    for file in &files {
        let room = room_of(file);
        rooms.insert(room.clone());
        if room == "lib" || file.ends_with(PATHS) {
            continue;
        }
        let Some(may_use) = table.get(&room) else {
            wrong.push(format!("{}: the room `{room}` has no row", file.display()));
            continue;
        };
        let Some(may_use) = may_use else { continue };
        let text = fs::read_to_string(file).expect("a text");
        for word in used(&code(&text), "crate::") {
            if word != room && !may_use.contains(&word) {
                wrong.push(format!("{}: the room `{room}` may not use `{word}`", file.display()));
            }
        }
    }
    let unknown = table.keys().chain(table.values().flatten().flatten()).filter(|room| !rooms.contains(*room));
    wrong.extend(unknown.map(|room| format!("CONTRIBUTING.md: there is no room `{room}` in src/")));
    assert!(wrong.is_empty(), "what the table of rooms in CONTRIBUTING.md does not say:\n{}", wrong.join("\n"));
}

/// No two rooms use each other: the table has an order.
#[test]
fn no_two_rooms_use_each_other() {
    let table = table(&fs::read_to_string(root().join("CONTRIBUTING.md")).expect("CONTRIBUTING.md"));
    let mut left: BTreeMap<&str, BTreeSet<&str>> = table
        .iter()
        .filter_map(|(room, may_use)| Some((room.as_str(), may_use.as_ref()?.iter().map(String::as_str).collect())))
        .collect();
    loop {
        let grounded: Vec<&str> = left
            .iter()
            .filter(|(_, uses)| uses.iter().all(|other| !left.contains_key(other)))
            .map(|(room, _)| *room)
            .collect();
        if grounded.is_empty() {
            break;
        }
        grounded.iter().for_each(|room| {
            left.remove(room);
        });
    }
    assert!(left.is_empty(), "these rooms use each other: {left:?}");
}

/// The file that may name any room contains only public paths, and no room uses them: each names the room that defines
/// an item.
#[test]
fn the_paths_are_for_users_alone() {
    let paths = code(&fs::read_to_string(root().join(PATHS)).expect(PATHS));
    let mut names = BTreeSet::new();
    for line in paths.lines().map(str::trim).filter(|line| !line.is_empty() && *line != "}" && !line.starts_with("#["))
    {
        let path =
            line.strip_prefix("pub mod ").or_else(|| line.strip_prefix("pub use ").filter(|_| line.ends_with(';')));
        let path = path.unwrap_or_else(|| panic!("{PATHS} has public paths alone: {line}"));
        let words = path.rsplit("::").next().unwrap_or(path);
        names.extend(words.split(|letter: char| !letter.is_alphanumeric() && letter != '_').map(str::to_owned));
    }
    assert!(["open", "keys", "chip", "engine"].iter().all(|name| names.contains(*name)), "{names:?}");
    let mut files = Vec::new();
    sources(&root().join("src"), &mut files);
    let taken = files.iter().filter(|file| !file.ends_with(PATHS)).flat_map(|file| {
        let used = used(&code(&fs::read_to_string(file).expect("a text")), "crate::link::");
        used.into_iter().filter(|name| names.contains(name)).map(move |name| format!("{}: {name}", file.display()))
    });
    let taken: Vec<String> = taken.collect();
    assert!(taken.is_empty(), "these live in other rooms:\n{}", taken.join("\n"));
}

/// The test finds the same imports in a file as the compiler.
#[test]
fn imports_are_found() {
    let text = "//! [`crate::one`]\nuse crate::two::Two;\nuse crate::{three, four::{self, Four}, five};\nfn f() { crate::six::g() }\n\
                #[cfg(test)]\nmod tests {\n    use crate::seven;\n}\n";
    assert_eq!(used(&code(text), "crate::").into_iter().collect::<Vec<_>>(), ["five", "four", "six", "three", "two"]);
    let may_use =
        table("| room | x | may use |\n| - | - | - |\n| `a/`, `b/` | x | `c`, `d` |\n| `c/` | x | - |\n\n| `e/` |\n");
    assert_eq!(may_use.keys().collect::<Vec<_>>(), ["a", "b", "c"]);
    assert_eq!(may_use["b"].clone().map(|rooms| rooms.len()), Some(2));
}

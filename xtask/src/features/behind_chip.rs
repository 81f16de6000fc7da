//! Finds the tests whose slaves are behind the model of an ECM-XF. tests/engine/over.rs runs the tests of tests/engine once
//! more that way, except those in its tables. The tests of a few other files always use a board over a chip.

use std::path::Path;

use proc_macro2::{Delimiter, TokenStream, TokenTree};

use super::{rust, text_of};
use crate::error::Error;

/// The file that runs the tests of tests/engine once more, and (next constant) its test that runs them behind a chip.
pub const OVER: &str = "tests/engine/over.rs";
const RUN: &str = "all_that_a_program_sees_is_the_same_behind_an_ecm_xf";
/// The folder of the tests that [`OVER`] runs once more, unchanged, with their slaves behind the model of a chip.
const ENGINE: &str = "tests/engine/";
/// Files and folders whose tests always use a board over a chip, without being run once more.
const ALWAYS: [&str; 8] = [
    "tests/engine/xf_bus.rs",
    "tests/engine/xf_faults.rs",
    "tests/engine/xf_packets.rs",
    "tests/engine/xf_state.rs",
    "tests/migration/",
    "tests/runners/behind_chip.rs",
    "tests/runners/chip_board.rs",
    "tool/tests/tool/behind_chip.rs",
];

/// The tables of tests/engine/over.rs. Their entries are the names of tests (`module::test`) or modules (`module::`).
#[derive(Debug, Default)]
pub struct BehindChip {
    /// Tests that count cycles. In the run of all tests behind a chip, additional cycles pass after the cycles that a test
    /// runs: as many as the chip answers late. Tests that count cycles would count these too. So they are left out of that run,
    /// and have a run of their own without additional cycles, in which their full names select them.
    by_cycles: Vec<String>,
    /// Tests that are left out because they cannot pass behind a chip: every test whose name contains one of these texts.
    cannot: Vec<String>,
    /// Tests that are left out because each of their boards has a simulated bus that the test makes itself, which would not
    /// be behind the chip: every test whose name contains one of these texts.
    own_bus: Vec<String>,
    /// Tests that are part of the run behind a chip although their slaves are not behind it, since they have buses of their own
    /// or boot boards themselves.
    not_behind: Vec<String>,
}

impl BehindChip {
    /// Reads the tables of tests/engine/over.rs in the checkout at `root`.
    ///
    /// # Errors
    /// The file is missing, or its tables do not have the expected form.
    pub fn read(root: &Path) -> Result<Self, Error> {
        let path = root.join(OVER);
        let text = text_of(&path).map_err(Error::file("read", &path))?;
        Self::of(&text).map_err(|problem| Error::Rust { path, problem })
    }

    fn of(text: &str) -> Result<Self, String> {
        if !rust::read(text)?.tests.iter().any(|test| test.name == RUN) {
            return Err(format!("no test {RUN}, which runs the tests of this folder behind a chip"));
        }
        let stream: TokenStream = text.parse().map_err(|error: proc_macro2::LexError| error.to_string())?;
        let trees: Vec<TokenTree> = stream.into_iter().collect();
        let table = |name: &str| {
            table(&trees, name).ok_or_else(|| {
                format!("no table `const {name}: [..] = [..];`, which says what is not run behind a chip")
            })
        };
        let mut cannot = table("CANNOT")?;
        cannot.extend(table("CANNOT_BEHIND_CHIP")?);
        Ok(Self {
            by_cycles: table("BY_CYCLES")?,
            cannot,
            own_bus: table("OWN_BUS")?,
            not_behind: table("NOT_BEHIND_CHIP")?,
        })
    }

    /// Whether a test, as `file::function`, has its slaves behind a chip.
    pub fn has(&self, test: &str) -> bool {
        if ALWAYS.iter().any(|place| test.starts_with(place)) {
            return true;
        }
        let Some(name) = engine_name(test) else { return false };
        if self.by_cycles.contains(&name) {
            return !self.cannot.contains(&name);
        }
        // A part of the name is enough, as with the option `--skip` of test programs.
        let mut left_out = self.by_cycles.iter().chain(&self.cannot).chain(&self.own_bus);
        let stands = |entry: &String| name == *entry || (entry.ends_with("::") && name.starts_with(entry.as_str()));
        !left_out.any(|entry| name.contains(entry.as_str())) && !self.not_behind.iter().any(stands)
    }

    /// Whether a test cannot pass behind a chip, according to the tables of tests/engine/over.rs. For a rule that only such
    /// tests name, the report says so, instead of that no test names it.
    pub fn cannot(&self, test: &str) -> bool {
        engine_name(test).is_some_and(|name| self.cannot.iter().any(|entry| name.contains(entry.as_str())))
    }
}

/// Converts `file::function` to the test's name in the program of tests/engine: `tests/engine/fifo.rs::a` is `fifo::a`.
fn engine_name(test: &str) -> Option<String> {
    let (module, function) = test.strip_prefix(ENGINE)?.split_once(".rs::")?;
    Some(format!("{module}::{function}"))
}

/// The names listed in the array constant called `name`: its elements if they are strings, or the first string of each element
/// if they are tuples. `None`: there is no such constant.
fn table(trees: &[TokenTree], name: &str) -> Option<Vec<String>> {
    let is_word = |tree: &TokenTree, word: &str| matches!(tree, TokenTree::Ident(ident) if ident == word);
    let at = trees.windows(2).position(|pair| is_word(&pair[0], "const") && is_word(&pair[1], name))?;
    let value =
        trees[at..].iter().skip_while(|tree| !matches!(tree, TokenTree::Punct(punct) if punct.as_char() == '='));
    let array = value.skip(1).find_map(|tree| match tree {
        TokenTree::Group(group) if group.delimiter() == Delimiter::Bracket => Some(group.stream()),
        _ => None,
    })?;
    let string = |tree: &TokenTree| match tree {
        TokenTree::Literal(literal) => Some(literal.to_string().trim_matches('"').to_owned()),
        TokenTree::Group(_) | TokenTree::Ident(_) | TokenTree::Punct(_) => None,
    };
    let names = array.into_iter().filter_map(|tree| match &tree {
        TokenTree::Group(tuple) => tuple.stream().into_iter().next().as_ref().and_then(string),
        _ => string(&tree),
    });
    Some(names.collect())
}

#[cfg(test)]
pub mod tests {
    use super::*;

    pub const TABLES: &str = r#"
const BY_CYCLES: [&str; 2] = ["a::by_cycles", "a::jumps"];
const WHY: &str = "b::no_row";
const CANNOT: [(&str, &str); 2] = [("a::each_cycle", WHY), ("a::full", "it counts c::places")];
const CANNOT_BEHIND_CHIP: [(&str, &str); 2] = [("a::jumps", WHY), ("long::", "long")];
const OWN_BUS: [&str; 1] = ["over::"];
const NOT_BEHIND_CHIP: [&str; 2] = ["b::ahead", "honest::"];
/// XF-19.1
#[test]
fn all_that_a_program_sees_is_the_same_behind_an_ecm_xf() {}
"#;

    pub fn behind_chip() -> BehindChip {
        BehindChip::of(TABLES).unwrap()
    }

    #[test]
    fn a_test_in_a_table_is_not_behind_the_chip() {
        let behind = behind_chip();
        for (test, has, cannot) in [
            ("tests/engine/a.rs::moves", true, false),
            ("tests/engine/a.rs::by_cycles", true, false),
            ("tests/engine/a.rs::jumps", false, true),
            ("tests/engine/a.rs::each_cycle", false, true),
            // As with `--skip` of test programs, an entry also leaves out tests whose names contain it.
            ("tests/engine/a.rs::full_and_more", false, true),
            ("tests/engine/b.rs::no_row", true, false),
            ("tests/engine/c.rs::places", true, false),
            ("tests/engine/long.rs::any", false, true),
            ("tests/engine/over.rs::all", false, false),
            ("tests/engine/b.rs::ahead", false, false),
            ("tests/engine/b.rs::ahead_too", true, false),
            ("tests/engine/honest.rs::any", false, false),
            ("tests/migration/clear.rs::any", true, false),
            ("tests/sk/crc.rs::any", false, false),
            ("tests/c/engine.c::main", false, false),
        ] {
            assert_eq!((behind.has(test), behind.cannot(test)), (has, cannot), "{test}");
        }
    }

    #[test]
    fn a_table_or_a_run_that_is_gone_is_an_error() {
        for gone in ["BY_CYCLES", "CANNOT_BEHIND_CHIP", "OWN_BUS", "NOT_BEHIND_CHIP", RUN] {
            let problem = BehindChip::of(&TABLES.replace(gone, "OTHER")).unwrap_err();
            assert!(problem.contains(gone), "{problem}");
        }
    }

    /// Each table in over.rs has entries, and each file or folder of [`ALWAYS`] contains tests with a chip.
    #[test]
    fn the_project_has_them() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
        let behind = BehindChip::read(root).unwrap();
        let tables = [&behind.by_cycles, &behind.cannot, &behind.own_bus, &behind.not_behind];
        assert!(tables.iter().all(|table| !table.is_empty() && table.iter().all(|name| name.contains("::"))));
        for place in ALWAYS {
            let path = root.join(place);
            let path = if path.is_dir() { path.join("main.rs") } else { path };
            let text = text_of(&path).unwrap();
            assert!(text.contains("xf-sim:") || text.contains("Xf"), "{place}");
        }
    }
}

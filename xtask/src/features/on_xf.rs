//! Determines whether each rule of the board also holds on an ECM-XF, and writes docs/FEATURES-XF.md, which lists the result by
//! rule.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::Path;

use super::behind_chip::{BehindChip, OVER};
use super::evidence::Evidence;
use super::id::{RuleId, ids_in};
use super::report::{anchor, shortened};
use super::rules::{Rule, Rules, Section, Status, cells};
use super::text_of;
use crate::error::Error;

/// The page with the table of differences between the board and an ECM-XF.
const MIGRATION: &str = "docs/MIGRATION.md";
/// The heading above the table of differences in [`MIGRATION`].
const DIFFERENCES: &str = "## What differs";
/// The prefix of the ids of the board's rules.
const BOARD: &str = "SK-";

const HEAD: &str = "# The board on an ECM-XF, rule by rule

What of the board a program finds when its slaves are behind an ECM-XF ([MIGRATION.md](MIGRATION.md)). The chip is a modelled one:
no real one was tried yet.

| state | what it says |
| --- | --- |
| same | The test that is named shows the rule on a board, and passes once more, unchanged, with the slaves behind the chip |
| differs | The row of the table in [MIGRATION.md](MIGRATION.md#what-differs) that is named says how |
| apart | No slave and no bus has a part in it: the reason stands beside it, and in [the section](rules/board.md) of the rule |

Written by `cargo xtask features` from the comments of the tests, the tables of `tests/engine/over.rs` of tests that are not run
behind a chip, MIGRATION.md, and the pages of rules: do not edit it, run that again.
";

/// Whether a rule of the board also holds on an ECM-XF.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum State {
    /// It holds: these tests name the rule and run with their slaves behind a chip.
    Same(Vec<String>),
    /// It differs: these rows of the table in docs/MIGRATION.md name the rule.
    Differs(Vec<String>),
    /// The rule concerns neither the bus nor the slaves, so it has no counterpart on an ECM-XF. The text says why.
    Apart(String),
    /// Nothing shows whether it holds. `cannot`: a test of the rule is in a table of those that cannot pass behind a chip.
    NotShown { cannot: bool },
}

/// The states of all board rules with status `now`, and contradictions between the tests, the table of docs/MIGRATION.md
/// and the pages of rules.
#[derive(Debug, Default)]
pub struct OnXf {
    states: BTreeMap<RuleId, State>,
    problems: Vec<String>,
}

impl OnXf {
    /// Determines the states from the checkout at `root`.
    pub fn read(root: &Path, rules: &Rules, evidence: &Evidence) -> Result<Self, Error> {
        let path = root.join(MIGRATION);
        let text = text_of(&path).map_err(Error::file("read", &path))?;
        Ok(Self::of(rules, evidence, &BehindChip::read(root)?, &text))
    }

    /// Determines the states from what was read. `migration` is the text of docs/MIGRATION.md.
    fn of(rules: &Rules, evidence: &Evidence, behind: &BehindChip, migration: &str) -> Self {
        let mut rows = rows(migration);
        let mut found = Self::default();
        for section in rules.pages.iter().flat_map(|page| &page.sections) {
            let mut marks: BTreeMap<&RuleId, &str> = section.apart.iter().map(|(id, why)| (id, why.as_str())).collect();
            for rule in section.rules.iter().filter(|rule| is_listed(rule)) {
                let tests: BTreeSet<&String> = evidence.tests.get(&rule.id).into_iter().flatten().collect();
                let both: Vec<String> =
                    tests.iter().filter(|test| behind.has(test)).map(|test| (*test).clone()).collect();
                let state = match (rows.remove(&rule.id), both.is_empty(), marks.remove(&rule.id)) {
                    (Some(rows), _, mark) => {
                        if mark.is_some() {
                            found.problems.push(format!(
                                "{} is marked as apart on an ECM-XF, and a row of {MIGRATION} names it: take one away",
                                rule.id
                            ));
                        }
                        State::Differs(rows)
                    }
                    (None, false, mark) => {
                        if mark.is_some() {
                            found.problems.push(format!(
                                "{} is marked as apart on an ECM-XF, but {} shows it there: take the mark away",
                                rule.id, both[0]
                            ));
                        }
                        State::Same(both)
                    }
                    (None, true, Some(why)) => State::Apart(why.to_owned()),
                    (None, true, None) => State::NotShown { cannot: tests.iter().any(|test| behind.cannot(test)) },
                };
                found.states.insert(rule.id.clone(), state);
            }
            found.problems.extend(marks.into_keys().map(|id| {
                format!("{id} is marked as apart on an ECM-XF and is no rule with status `now` of `{}`", section.title)
            }));
        }
        found.problems.extend(rows.into_iter().map(|(id, rows)| {
            format!("{id}, which the row {} of {MIGRATION} names, is no rule with status `now`", rows.join(", "))
        }));
        found
    }

    /// The contradictions, and the rules without a state. Each text ends with what the developer can do about it.
    pub fn problems(&self) -> Vec<String> {
        let mut problems = self.problems.clone();
        for (id, state) in &self.states {
            let State::NotShown { cannot } = state else { continue };
            problems.push(if *cannot {
                format!(
                    "{id} is not shown on an ECM-XF: its tests stand in tables of {OVER}; write one that passes there, \
                     or name the rule in the row of {MIGRATION} that says what differs"
                )
            } else {
                format!(
                    "{id} is not shown on an ECM-XF: no test of it has its slaves behind a chip; write one in \
                     tests/engine, or mark the rule in its section if nothing of it is the bus's"
                )
            });
        }
        problems
    }

    /// How many rules of a section have which state, as text: `20 same, 2 differ, 5 apart`. `None` if the section has no
    /// rules of the board.
    pub fn count(&self, section: &Section) -> Option<String> {
        let states = section.rules.iter().filter_map(|rule| self.states.get(&rule.id));
        count(states)
    }

    /// The state of one rule on an ECM-XF, with its tests, rows or reason, as text; `None` if it is no rule of the board
    /// with status `now`.
    pub fn answer(&self, id: &RuleId) -> Option<String> {
        let state = self.states.get(id)?;
        Some(match state {
            State::Same(tests) => format!("same, by {}", tests.join(", ")),
            State::Differs(rows) => format!("differs, row {} of {MIGRATION}", rows.join(", ")),
            State::Apart(why) => format!("apart: {why}"),
            State::NotShown { .. } => "not shown".to_owned(),
        })
    }

    /// The text of docs/FEATURES-XF.md.
    pub fn page(&self, rules: &Rules) -> String {
        let all = count(self.states.values()).unwrap_or_default();
        let mut text = format!("{HEAD}\nOf {} rules: {all}.\n", self.states.len());
        for page in &rules.pages {
            for section in &page.sections {
                let Some(count) = self.count(section) else { continue };
                let link = format!("{}#{}", page.file, anchor(&section.title));
                let _ = write!(text, "\n## {}\n\n{count}; [the rules in full]({link}).\n\n", section.title);
                text.push_str("| id | rule | on an ECM-XF | shown by |\n| --- | --- | --- | --- |\n");
                for rule in &section.rules {
                    let Some(state) = self.states.get(&rule.id) else { continue };
                    let (state, by) = match state {
                        State::Same(tests) => ("same", shown_by(tests)),
                        State::Differs(rows) => {
                            ("differs", rows.iter().map(|row| row_link(row)).collect::<Vec<_>>().join(", "))
                        }
                        State::Apart(why) => ("apart", why.clone()),
                        State::NotShown { .. } => ("**not shown**", String::new()),
                    };
                    let _ =
                        writeln!(text, "| {} | {} | {state} | {by} |", rule.id, shortened(&rule.text).replace('`', ""));
                }
            }
        }
        text
    }
}

/// Whether a rule gets a state: a rule of the board with status `now`.
fn is_listed(rule: &Rule) -> bool {
    rule.status == Status::Now && rule.id.to_string().starts_with(BOARD)
}

fn count<'a>(states: impl Iterator<Item = &'a State>) -> Option<String> {
    let mut counts = [0; 4];
    for state in states {
        counts[match state {
            State::Same(_) => 0,
            State::Differs(_) => 1,
            State::Apart(_) => 2,
            State::NotShown { .. } => 3,
        }] += 1;
    }
    let words = counts.into_iter().zip(["same", "differ", "apart", "not shown"]);
    let words: Vec<String> =
        words.filter(|(count, _)| *count != 0).map(|(count, word)| format!("{count} {word}")).collect();
    (!words.is_empty()).then(|| words.join(", "))
}

/// Tests as text: the name of the first one, and the number of the others.
fn shown_by(tests: &[String]) -> String {
    match tests {
        [] => String::new(),
        [test] => format!("`{test}`"),
        [test, more @ ..] => format!("`{test}` and {} more", more.len()),
    }
}

fn row_link(row: &str) -> String {
    format!("[`{row}`](MIGRATION.md#what-differs)")
}

/// For each rule that the table of differences names in its column "difference": the ids of the rows that name it.
fn rows(migration: &str) -> BTreeMap<RuleId, Vec<String>> {
    let table = migration.split_once(DIFFERENCES).map_or("", |(_, below)| below);
    let table = table.split("\n## ").next().unwrap_or_default();
    let mut rows: BTreeMap<RuleId, Vec<String>> = BTreeMap::new();
    for line in table.lines().filter(|line| line.starts_with("| `")) {
        let cells = cells(line);
        let [row, what, ..] = cells.as_slice() else { continue };
        for id in ids_in(what) {
            rows.entry(id).or_default().push(row.trim_matches('`').to_owned());
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::features::behind_chip::tests::behind_chip;
    use crate::features::id::id_of;

    const PAGE: &str = "# Board\n\nAll of it.\n\n## 1. Frames\n\nFrames work.\n\n\
                        Apart on an ECM-XF, since it is the same code above the bus: SK-1.3, SK-1.4.\n\n\
                        | SK-1.1 | one | s | now |\n| SK-1.2 | two | s | now |\n| SK-1.3 | three | s | now |\n\
                        | SK-1.4 | four | s | now |\n| SK-1.5 | five | s | later |\n\n\
                        ## Calls\n\nCalls.\n\n| LIB-1 | six | s | now |\n";
    const ROWS: &str = "| `SK-1.1` | no row |\n\n## What differs\n\n| id | what | why |\n| --- | --- | --- |\n\
                        | `clear` | SET_FIFO takes longer (SK-1.2) | not SK-1.1 |\n\n## More\n\n| `x` | SK-1.3 | |\n";

    fn on_xf(page: &str, rows: &str, named: &[(&str, &str)]) -> (OnXf, Rules) {
        let mut rules = Rules::default();
        rules.read_page("rules/board.md", page).unwrap();
        let mut evidence = Evidence::default();
        for (id, test) in named {
            evidence.tests.entry(id_of(id).unwrap()).or_default().insert(format!("tests/engine/{test}"));
        }
        (OnXf::of(&rules, &evidence, &behind_chip(), rows), rules)
    }

    const SOUND: [(&str, &str); 4] =
        [("SK-1.1", "a.rs::moves"), ("SK-1.1", "b.rs::ahead"), ("SK-1.2", "a.rs::moves"), ("SK-1.4", "b.rs::ahead")];

    #[test]
    fn each_rule_of_the_board_has_its_state() {
        let (found, rules) = on_xf(PAGE, ROWS, &SOUND);
        let answer = |id: &str| found.answer(&id_of(id).unwrap()).unwrap_or_default();
        assert_eq!(answer("SK-1.1"), "same, by tests/engine/a.rs::moves");
        assert_eq!(answer("SK-1.2"), "differs, row clear of docs/MIGRATION.md");
        assert_eq!(answer("SK-1.3"), "apart: the same code above the bus");
        assert_eq!([answer("SK-1.5"), answer("LIB-1")], [""; 2]);
        assert_eq!(found.problems(), [""; 0]);
        let counts: Vec<_> = rules.pages[0].sections.iter().map(|section| found.count(section)).collect();
        assert_eq!(counts, [Some("1 same, 1 differ, 2 apart".to_owned()), None]);
        let page = found.page(&rules);
        for line in [
            "Of 4 rules: 1 same, 1 differ, 2 apart.",
            "| SK-1.1 | one | same | `tests/engine/a.rs::moves` |",
            "| SK-1.2 | two | differs | [`clear`](MIGRATION.md#what-differs) |",
            "| SK-1.3 | three | apart | the same code above the bus |",
        ] {
            assert!(page.lines().any(|other| other == line), "{line}\n{page}");
        }
        assert!(!page.contains("SK-1.5") && !page.contains("LIB-1"), "{page}");
    }

    /// If the only test of a rule is in a table of tests that cannot pass behind a chip, no test shows the rule on an
    /// ECM-XF.
    #[test]
    fn a_rule_whose_tests_are_left_out_is_not_shown() {
        for (test, what) in [("a.rs::each_cycle", "its tests stand in tables"), ("honest.rs::any", "no test of it")] {
            let (found, _) = on_xf(PAGE, ROWS, &[("SK-1.1", test)]);
            assert_eq!(found.answer(&id_of("SK-1.1").unwrap()).unwrap(), "not shown");
            let problems = found.problems();
            assert!(
                matches!(&problems[..], [one] if one.starts_with("SK-1.1 is not shown") && one.contains(what)),
                "{problems:?}"
            );
        }
        // A row of the table that names the rule gives it a state.
        let rows = ROWS.replace("SK-1.2", "SK-1.1, SK-1.2");
        assert_eq!(on_xf(PAGE, &rows, &[("SK-1.1", "a.rs::each_cycle")]).0.problems(), [""; 0]);
    }

    #[test]
    fn what_contradicts_itself_is_a_problem() {
        let shown = [("SK-1.1", "a.rs::moves"), ("SK-1.3", "a.rs::moves")];
        let rows = ROWS.replace("SK-1.2", "SK-1.2, SK-1.4, SK-1.5, SK-7.7");
        let problems = on_xf(&PAGE.replace("SK-1.3, SK-1.4.", "SK-1.3, SK-1.4,\nSK-1.9."), &rows, &shown).0.problems();
        let ids: Vec<&str> = problems.iter().map(|problem| problem.split([' ', ',']).next().unwrap()).collect();
        assert_eq!(ids, ["SK-1.3", "SK-1.4", "SK-1.9", "SK-1.5", "SK-7.7"], "{problems:?}");
    }
}

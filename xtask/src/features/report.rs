//! Writes docs/FEATURES.md, reports problems of rules and tests, and lists the tests of a rule.
//!
//! The page counts tests by section and not by rule. Otherwise it would change with every test that names another rule of the
//! section.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use super::evidence::Evidence;
use super::id::RuleId;
use super::on_xf::OnXf;
use super::rules::{Rule, Rules, Section, Status};

const HEAD: &str = "# Features

What works, by subject. Behind each subject stand rules, one statement each with its source ([all of them](RULES.md)), and each
rule that is claimed is shown by at least one test. `cargo xtask features SK-5.6` prints a rule with its tests, `cargo xtask
features SK-5` those of a section; `git grep -nw SK-5.6` finds both, too.

Written by `cargo xtask features` from the pages of rules and the comments of the tests: do not edit it, run that again.
";

const HEADS: &str = "| subject | what works | rules | tests |\n| --- | --- | --- | --- |\n";
const HEADS_OF_BOARD: &str = "| subject | what works | rules | tests | [on an ECM-XF](FEATURES-XF.md) |\n\
                              | --- | --- | --- | --- | --- |\n";

/// The text of docs/FEATURES.md: for each section of the pages of rules what works, the number of rules and the number of
/// tests.
pub fn page(rules: &Rules, evidence: &Evidence, on_xf: &OnXf) -> String {
    let findings = Findings::of(rules, evidence);
    let mut text = format!("{HEAD}\n{}.\n", findings.summary());
    for page in &rules.pages {
        let _ = write!(text, "\n## {}\n\n{}\n\n", page.title, from_docs(&page.summary, &page.file));
        // Only rules of the board have a state on an ECM-XF.
        let of_board = page.sections.iter().any(|section| on_xf.count(section).is_some());
        text.push_str(if of_board { HEADS_OF_BOARD } else { HEADS });
        for section in page.sections.iter().filter(|section| !section.rules.is_empty()) {
            let link = format!("{}#{}", page.file, anchor(&section.title));
            let (count, tests) = (count(section), tests_of(&section.rules, evidence).len());
            let summary = from_docs(&section.summary, &page.file);
            let _ = write!(text, "| [{}]({link}) | {summary} | {count} | {tests} |", section.title);
            if of_board {
                let _ = write!(text, " {} |", on_xf.count(section).unwrap_or_default());
            }
            text.push('\n');
        }
    }
    let later: Vec<&Rule> = rules.iter().filter(|rule| rule.status == Status::Later).collect();
    if !later.is_empty() {
        text.push_str("\n## Not claimed yet\n\n| id | rule |\n| --- | --- |\n");
        for rule in later {
            let _ = writeln!(text, "| {} | {} |", rule.id, rule.text);
        }
    }
    text
}

/// Adapts the links in a text from docs/rules/ to a page in docs/.
fn from_docs(text: &str, file: &str) -> String {
    let mut parts = text.split("](");
    let mut moved = parts.next().unwrap_or_default().to_owned();
    for link in parts {
        let begin = match link {
            link if link.starts_with("http") || link.starts_with("../") => "",
            link if link.starts_with('#') => file,
            _ => "rules/",
        };
        let _ = write!(moved, "]({begin}{}", link.strip_prefix("../").unwrap_or(link));
    }
    moved
}

/// The number of rules of a section with status `now` and with status `later`, as text.
fn count(section: &Section) -> String {
    let later = section.rules.iter().filter(|rule| rule.status == Status::Later).count();
    let now = section.rules.len() - later;
    if later == 0 { now.to_string() } else { format!("{now}, {later} not yet") }
}

/// The anchor of a Markdown heading, as GitHub makes it.
pub fn anchor(title: &str) -> String {
    let kept = title.to_lowercase();
    let kept = kept.chars().filter(|c| c.is_alphanumeric() || [' ', '-', '_'].contains(c));
    kept.map(|c| if c == ' ' { '-' } else { c }).collect()
}

/// The rules whose id is `name` or begins with it (`SK-5`, `WIN`), each with its file and line and its tests; `None` if there
/// are none.
pub fn answer(rules: &Rules, evidence: &Evidence, on_xf: &OnXf, name: &str) -> Option<String> {
    let name = name.trim_end_matches(['-', '.']);
    let names = |id: &str| id.strip_prefix(name).is_some_and(|rest| rest.is_empty() || rest.starts_with(['-', '.']));
    let mut text = String::new();
    for rule in rules.iter().filter(|rule| names(&rule.id.to_string())) {
        let later = if rule.status == Status::Later { ", not claimed yet" } else { "" };
        let _ = writeln!(text, "{} ({}{later}) {}", rule.id, rule.place, rule.text);
        for test in tests_of([rule], evidence) {
            let _ = writeln!(text, "    {test}");
        }
        if let Some(state) = on_xf.answer(&rule.id) {
            let _ = writeln!(text, "    on an ECM-XF: {state}");
        }
    }
    (!text.is_empty()).then_some(text)
}

/// The result of comparing the rules with the tests that name them: counts, rules without a test, and ids without a rule.
pub struct Findings<'a> {
    total: usize,
    works: usize,
    /// The number of tests that name at least one rule.
    tests: usize,
    /// Rules with status `now` that no test names.
    untested: Vec<&'a Rule>,
    /// Rules with status `later` that tests name already.
    early: Vec<&'a Rule>,
    /// Ids in tests for which no rule exists: the id, the tests that name it, and whether the id is retired.
    unknown: Vec<(&'a RuleId, &'a BTreeSet<String>, bool)>,
}

impl<'a> Findings<'a> {
    /// Compares the rules with the tests.
    pub fn of(rules: &'a Rules, evidence: &'a Evidence) -> Self {
        let known: BTreeSet<&RuleId> = rules.iter().map(|rule| &rule.id).collect();
        let has_test = |rule: &&Rule| evidence.tests.contains_key(&rule.id);
        let (now, later): (Vec<&Rule>, Vec<&Rule>) = rules.iter().partition(|rule| rule.status == Status::Now);
        let (tested, untested): (Vec<&Rule>, Vec<&Rule>) = now.into_iter().partition(has_test);
        let unknown = evidence.tests.iter().filter(|(id, _)| !known.contains(id));
        Self {
            total: known.len(),
            works: tested.len(),
            tests: tests_of(rules.iter(), evidence).len(),
            untested,
            early: later.into_iter().filter(has_test).collect(),
            unknown: unknown.map(|(id, tests)| (id, tests, rules.retired.contains(id))).collect(),
        }
    }

    /// The counts of rules and tests in one line.
    pub fn summary(&self) -> String {
        let later = self.total - self.works - self.untested.len();
        let mut line = format!("Of {} rules {} work, shown by {} tests", self.total, self.works, self.tests);
        if later != 0 {
            let _ = write!(line, ", {later} come later");
        }
        if !self.untested.is_empty() {
            let _ = write!(line, ", {} have no test", self.untested.len());
        }
        line
    }

    /// The problems that make the check fail. Each text ends with what the developer can do about it.
    pub fn problems(&self) -> Vec<String> {
        let mut problems = Vec::new();
        if !self.untested.is_empty() {
            problems.push(format!(
                "{} rules with status `now` have no test; name the id in the doc comment of the test that shows it:",
                self.untested.len()
            ));
            problems.extend(self.untested.iter().map(|rule| format!("  {}  {}", rule.id, shortened(&rule.text))));
        }
        for (id, tests, retired) in &self.unknown {
            let tests = tests.iter().map(String::as_str).collect::<Vec<_>>().join(", ");
            let what = if *retired { "is no longer in use (docs/RULES.md)" } else { "is no rule of docs/rules/" };
            problems.push(format!("{id} {what}; correct the comment of {tests}"));
        }
        problems
    }

    /// Rules that could be claimed already, because a test shows them. They do not make the check fail.
    pub fn hints(&self) -> Vec<String> {
        let hint = |rule: &&Rule| format!("{} has a test: its status could be `now`", rule.id);
        self.early.iter().map(hint).collect()
    }
}

/// The tests that name at least one of `rules`, each once.
fn tests_of<'a>(rules: impl IntoIterator<Item = &'a Rule>, evidence: &'a Evidence) -> BTreeSet<&'a String> {
    rules.into_iter().filter_map(|rule| evidence.tests.get(&rule.id)).flatten().collect()
}

/// The text of a rule, shortened for a list.
pub fn shortened(text: &str) -> String {
    const LETTERS: usize = 90;
    match text.char_indices().nth(LETTERS) {
        // The text is cut between words, because a part of a word would look like a spelling mistake.
        Some((end, _)) => format!("{} ...", text[..end].rsplit_once(' ').map_or("", |(words, _)| words)),
        None => text.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::features::id::id_of;

    const PAGE: &str = "# Board\n\nAll of it.\n\n## 1. Frames (both)\n\nFrames work.\n\n| SK-1.1 | one | s | now |\n\
                        | SK-1.2 | two | s | now |\n| SK-1.3 | three | s | later |\n\n## 2. More\n\nMore works.\n\n\
                        | SK-2.1 | four | s | now |\n";
    const INDEX: &str = "## Ids that are no longer in use\n\n| id | why |\n| --- | --- |\n| SK-1.9 | told twice |\n";

    fn rules() -> Rules {
        let mut rules = Rules::default();
        rules.read_index(INDEX);
        rules.read_page("rules/board.md", PAGE).unwrap();
        rules
    }

    fn evidence(named: &[(&str, &str)]) -> Evidence {
        let mut evidence = Evidence::default();
        for (id, test) in named {
            evidence.tests.entry(id_of(id).unwrap()).or_default().insert(test.to_string());
        }
        evidence
    }

    /// Links of a page in docs/rules/, adapted to docs/, have the same targets as before.
    #[test]
    fn links_lead_where_they_led() {
        let text = "[a](nic.md#x), [b](../NIC.md), [c](#y), [d](https://e.org)";
        assert_eq!(
            from_docs(text, "rules/bus.md"),
            "[a](rules/nic.md#x), [b](NIC.md), [c](rules/bus.md#y), [d](https://e.org)"
        );
        assert_eq!(from_docs("no link", "rules/bus.md"), "no link");
    }

    /// A test that names two rules of a section is counted once. The page contains no names of tests.
    #[test]
    fn the_page_counts_by_subject() {
        let tests = [("SK-1.1", "a.rs::x"), ("SK-1.1", "a.rs::y"), ("SK-1.2", "a.rs::y"), ("SK-2.1", "a.rs::y")];
        let text = page(&rules(), &evidence(&tests), &OnXf::default());
        let rows: Vec<&str> = text.lines().filter(|line| line.starts_with("| [") || line.starts_with("| SK")).collect();
        assert_eq!(
            rows,
            [
                "| [1. Frames (both)](rules/board.md#1-frames-both) | Frames work. | 2, 1 not yet | 2 |",
                "| [2. More](rules/board.md#2-more) | More works. | 1 | 1 |",
                "| SK-1.3 | three |"
            ]
        );
        assert!(text.contains("\n## Board\n\nAll of it.\n\n| subject |"), "{text}");
        assert!(text.contains("\nOf 4 rules 3 work, shown by 2 tests, 1 come later.\n"), "{text}");
        assert!(!text.contains("a.rs"), "{text}");
    }

    #[test]
    fn a_rule_and_a_section_are_found_with_their_tests() {
        let evidence = evidence(&[("SK-1.1", "a.rs::x"), ("SK-1.2", "a.rs::y"), ("SK-2.1", "a.rs::z")]);
        let ask = |name: &str| answer(&rules(), &evidence, &OnXf::default(), name).unwrap_or_default();
        assert_eq!(ask("SK-1.1"), "SK-1.1 (docs/rules/board.md:9) one\n    a.rs::x\n");
        assert_eq!(ask("SK-1.3"), "SK-1.3 (docs/rules/board.md:11, not claimed yet) three\n");
        assert_eq!(ask("SK-1").lines().count(), 5);
        assert_eq!([ask("SK-1."), ask("SK-1.1.")], [ask("SK-1"), ask("SK-1.1")]);
        assert_eq!(ask("SK").lines().count(), 7);
        assert_eq!([ask("SK-1.4"), ask("S"), ask("SK-11"), ask("")], [""; 4]);
    }

    #[test]
    fn a_rule_without_test_and_a_test_without_rule_are_problems() {
        let rules = rules();
        let sound = evidence(&[("SK-1.1", "a"), ("SK-1.2", "b"), ("SK-2.1", "b")]);
        assert_eq!(Findings::of(&rules, &sound).problems(), [""; 0]);

        let unsound = evidence(&[("SK-1.1", "a"), ("SK-1.3", "c"), ("SK-2.1", "a"), ("SK-7.7", "d"), ("SK-1.9", "e")]);
        let findings = Findings::of(&rules, &unsound);
        let problems = findings.problems();
        assert!(problems[0].starts_with("1 rules") && problems[1] == "  SK-1.2  two", "{problems:?}");
        assert_eq!(problems[2], "SK-1.9 is no longer in use (docs/RULES.md); correct the comment of e");
        assert_eq!(problems[3], "SK-7.7 is no rule of docs/rules/; correct the comment of d");
        assert_eq!(problems.len(), 4);
        assert_eq!(findings.hints().len(), 1);
    }
}

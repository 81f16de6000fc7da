//! docs/FEATURES.md, and what is wrong between rules and tests.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use super::evidence::Evidence;
use super::id::RuleId;
use super::rules::{Rule, Rules, Status};

const HEAD: &str = "# Features

What works, rule by rule, and the tests that show it. Written by `cargo xtask features` from
[RULES.md](RULES.md) and from the comments of the tests: do not edit it, run that again.
";

/// The whole file.
pub fn page(rules: &Rules, evidence: &Evidence) -> String {
    let findings = Findings::of(rules, evidence);
    let mut page = format!("{HEAD}\n{}.\n", findings.summary());
    for section in &rules.sections {
        let _ = write!(page, "\n## {}\n\n| id | rule | status | tests |\n| --- | --- | --- | --- |\n", section.title);
        for rule in &section.rules {
            let tests = tests_of(rule, evidence).map(|test| format!("`{test}`")).collect::<Vec<_>>().join("<br>");
            let status = match rule.status {
                Status::Now if tests.is_empty() => "no test",
                Status::Now => "works",
                Status::Later => "later",
            };
            let _ = writeln!(page, "| {} | {} | {status} | {tests} |", rule.id, rule.text);
        }
    }
    page
}

/// What there is to say about the rules.
pub struct Findings<'a> {
    total: usize,
    works: usize,
    /// Rules `now` that no test names.
    untested: Vec<&'a Rule>,
    /// Rules `later` that tests name.
    early: Vec<&'a Rule>,
    /// Ids that are no rule, with the tests that name them.
    unknown: Vec<(&'a RuleId, &'a BTreeSet<String>)>,
}

impl<'a> Findings<'a> {
    /// Compares the rules with the tests.
    pub fn of(rules: &'a Rules, evidence: &'a Evidence) -> Self {
        let known: BTreeSet<&RuleId> = rules.iter().map(|rule| &rule.id).collect();
        let has_test = |rule: &&Rule| evidence.tests.contains_key(&rule.id);
        let (now, later): (Vec<&Rule>, Vec<&Rule>) = rules.iter().partition(|rule| rule.status == Status::Now);
        let (tested, untested): (Vec<&Rule>, Vec<&Rule>) = now.into_iter().partition(has_test);
        Self {
            total: known.len(),
            works: tested.len(),
            untested,
            early: later.into_iter().filter(has_test).collect(),
            unknown: evidence.tests.iter().filter(|(id, _)| !known.contains(id)).collect(),
        }
    }

    /// One line of numbers.
    pub fn summary(&self) -> String {
        let later = self.total - self.works - self.untested.len();
        let mut line = format!("Of {} rules {} work, {later} come later", self.total, self.works);
        if !self.untested.is_empty() {
            let _ = write!(line, ", {} have no test", self.untested.len());
        }
        line
    }

    /// What makes a check fail, each with what to do.
    pub fn problems(&self) -> Vec<String> {
        let mut problems = Vec::new();
        if !self.untested.is_empty() {
            problems.push(format!(
                "{} rules with status `now` have no test; name the id in the doc comment of the test that shows it:",
                self.untested.len()
            ));
            problems.extend(self.untested.iter().map(|rule| format!("  {}  {}", rule.id, shortened(&rule.text))));
        }
        for (id, tests) in &self.unknown {
            let tests = tests.iter().map(String::as_str).collect::<Vec<_>>().join(", ");
            problems.push(format!("{id} is no rule of docs/RULES.md; correct the comment of {tests}"));
        }
        problems
    }

    /// What may be of use.
    pub fn hints(&self) -> Vec<String> {
        let hint = |rule: &&Rule| format!("{} has a test: its status could be `now`", rule.id);
        self.early.iter().map(hint).collect()
    }
}

fn tests_of<'a>(rule: &Rule, evidence: &'a Evidence) -> impl Iterator<Item = &'a String> {
    evidence.tests.get(&rule.id).into_iter().flatten()
}

/// The beginning of a rule, for a list.
fn shortened(text: &str) -> String {
    const LETTERS: usize = 90;
    match text.char_indices().nth(LETTERS) {
        Some((end, _)) => format!("{} ...", text[..end].trim_end()),
        None => text.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::features::id::id_of;

    const RULES: &str =
        "## 1. Frames\n| SK-1.1 | one | s | now |\n| SK-1.2 | two | s | now |\n| SK-1.3 | three | s | later |\n";

    fn evidence(named: &[(&str, &str)]) -> Evidence {
        let mut evidence = Evidence::default();
        for (id, test) in named {
            evidence.tests.entry(id_of(id).unwrap()).or_default().insert(test.to_string());
        }
        evidence
    }

    #[test]
    fn the_page_shows_status_and_tests() {
        let rules = Rules::parse(RULES).unwrap();
        let page = page(&rules, &evidence(&[("SK-1.1", "tests/a.rs::x"), ("SK-1.1", "tests/a.rs::y")]));
        let rows: Vec<&str> = page.lines().filter(|line| line.starts_with("| SK")).collect();
        assert_eq!(
            rows,
            [
                "| SK-1.1 | one | works | `tests/a.rs::x`<br>`tests/a.rs::y` |",
                "| SK-1.2 | two | no test |  |",
                "| SK-1.3 | three | later |  |"
            ]
        );
        assert!(page.contains("\nOf 3 rules 1 work, 1 come later, 1 have no test.\n"), "{page}");
    }

    #[test]
    fn a_rule_without_test_and_a_test_without_rule_are_problems() {
        let rules = Rules::parse(RULES).unwrap();
        let sound = evidence(&[("SK-1.1", "a"), ("SK-1.2", "b")]);
        assert_eq!(Findings::of(&rules, &sound).problems(), [""; 0]);

        let unsound = evidence(&[("SK-1.1", "a"), ("SK-1.3", "c"), ("SK-7.7", "d")]);
        let findings = Findings::of(&rules, &unsound);
        let problems = findings.problems();
        assert!(problems[0].starts_with("1 rules") && problems[1] == "  SK-1.2  two", "{problems:?}");
        assert!(problems[2].starts_with("SK-7.7") && problems[2].ends_with('d') && problems.len() == 3, "{problems:?}");
        assert_eq!(findings.hints().len(), 1);
    }
}

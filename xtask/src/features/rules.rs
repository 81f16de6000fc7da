//! docs/RULES.md: its sections and the rows of their tables, `| id | rule | source | status |`.

use std::collections::BTreeMap;

use super::id::{PREFIXES, RuleId, id_of};

/// Whether a rule is claimed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// Claimed: a test must show it.
    Now,
    /// Not claimed yet.
    Later,
}

/// A row.
#[derive(Debug)]
pub struct Rule {
    pub id: RuleId,
    /// What holds, as Markdown.
    pub text: String,
    pub status: Status,
}

/// A heading with the rules below it.
#[derive(Debug)]
pub struct Section {
    pub title: String,
    pub rules: Vec<Rule>,
}

/// The file.
#[derive(Debug)]
pub struct Rules {
    pub sections: Vec<Section>,
}

impl Rules {
    /// Reads the file.
    ///
    /// # Errors
    /// The number of a line that looks like a rule and is none, and what is wrong with it.
    pub fn parse(text: &str) -> Result<Self, (usize, String)> {
        let mut sections: Vec<Section> = Vec::new();
        let mut seen = BTreeMap::new();
        for (number, line) in (1..).zip(text.lines()) {
            if let Some(title) = line.strip_prefix("## ") {
                sections.push(Section { title: title.trim().to_owned(), rules: Vec::new() });
            }
            // Every row of a section's table but its head; before the first section stands what the columns mean.
            let is_row = |row: &str| !row.starts_with("id |") && !row.starts_with("---");
            let is_rule = |row: &str| PREFIXES.iter().any(|(prefix, _)| row.starts_with(prefix));
            let applies = |row| is_rule(row) || (!sections.is_empty() && is_row(row));
            if !line.strip_prefix("| ").is_some_and(applies) {
                continue;
            }
            let rule = Self::row(line).map_err(|problem| (number, problem))?;
            if let Some(first) = seen.insert(rule.id.clone(), number) {
                return Err((number, format!("{} stands in line {first} already: take the next free number", rule.id)));
            }
            let section = sections.last_mut().ok_or((number, "a rule before the first heading `## ..`".to_owned()))?;
            section.rules.push(rule);
        }
        sections.retain(|section| !section.rules.is_empty());
        Ok(Self { sections })
    }

    /// All rules in order.
    pub fn iter(&self) -> impl Iterator<Item = &Rule> {
        self.sections.iter().flat_map(|section| &section.rules)
    }

    fn row(line: &str) -> Result<Rule, String> {
        let cells = cells(line);
        let [id, text, source, status] = cells.as_slice() else {
            return Err(format!("{} cells where `| id | rule | source | status |` has 4", cells.len()));
        };
        let id = id_of(id).ok_or(format!("`{id}` is no id: SK-<section>.<n>, LIB-<n> .."))?;
        if text.is_empty() || source.is_empty() {
            return Err(format!("{id} has no rule or no source"));
        }
        let status = match status.as_str() {
            "now" => Status::Now,
            "later" => Status::Later,
            other => return Err(format!("the status of {id} is `{other}`: now or later")),
        };
        Ok(Rule { id, text: text.clone(), status })
    }
}

/// The cells of a row of a Markdown table, blanks taken off; `\|` is a bar inside a cell and stays as it is.
fn cells(line: &str) -> Vec<String> {
    let line = line.trim().trim_start_matches('|');
    let mut cells = vec![String::new()];
    let mut escaped = false;
    for c in line.chars() {
        match c {
            '|' if !escaped => cells.push(String::new()),
            _ => cells.last_mut().expect("there is always a cell").push(c),
        }
        escaped = c == '\\' && !escaped;
    }
    // What comes after the last bar is no cell.
    cells.pop();
    cells.iter().map(|cell| cell.trim().to_owned()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rules_are_read_with_their_sections() {
        let rules = Rules::parse(
            "# Rules\n| id | rule | source | status |\n| --- | --- | --- | --- |\n\n## Words\n\n## 1. Frames\n\n\
             | id | rule | source | status |\n| --- | --- | --- | --- |\n| SK-1.1 | 12 bytes | UG17 2.1 | now |\n\
             ## Library\n| LIB-1 | 0x10 \\| last state | OURS | later |\n",
        )
        .unwrap();
        let titles: Vec<_> = rules.sections.iter().map(|section| section.title.as_str()).collect();
        assert_eq!(titles, ["1. Frames", "Library"]);
        let read: Vec<_> = rules.iter().map(|rule| (rule.id.to_string(), rule.text.as_str(), rule.status)).collect();
        assert_eq!(
            read,
            [
                ("SK-1.1".to_owned(), "12 bytes", Status::Now),
                ("LIB-1".to_owned(), "0x10 \\| last state", Status::Later)
            ]
        );
    }

    #[test]
    fn a_row_that_is_no_rule_is_reported_with_its_line() {
        for (row, problem) in [
            ("| SK-1.1 | text | now |", "3 cells"),
            ("| SK-1.1 | text | source | soon |", "`soon`"),
            ("| SK-1 | text | source | now |", "`SK-1`"),
            ("| SK-1.1 |  | source | now |", "no rule"),
            ("| NEW-1 | text | source | now |", "`NEW-1`"),
        ] {
            let (line, found) = Rules::parse(&format!("## 1\n{row}\n")).unwrap_err();
            assert!(line == 2 && found.contains(problem), "{row}: line {line}: {found}");
        }
        let twice = "## 1\n| SK-1.1 | a | s | now |\n| SK-1.1 | b | s | now |\n";
        assert_eq!(Rules::parse(twice).unwrap_err().0, 3);
    }
}

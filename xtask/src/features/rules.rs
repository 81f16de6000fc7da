//! Reads the rules. docs/RULES.md links the pages and lists the retired ids. The pages in docs/rules/ have sections with tables
//! `| id | rule | source | status |`.

use std::collections::BTreeSet;

use super::id::{PREFIXES, RuleId, id_of, ids_in};

/// The heading above the list in docs/RULES.md of ids of former rules, which must not be used again.
const RETIRED: &str = "## Ids that are no longer in use";

/// The beginning of a paragraph that names the rules of a section which concern neither the bus nor the slaves. No test has
/// to show such a rule on an ECM-XF. The reason follows, then a colon and the rule ids.
const APART: &str = "Apart on an ECM-XF, since it is ";

/// Whether a rule is claimed to hold already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// Claimed: a test must show it.
    Now,
    /// Planned: no test need show it yet.
    Later,
}

/// A rule: a row of a table.
#[derive(Debug)]
pub struct Rule {
    pub id: RuleId,
    /// The text of the rule, as Markdown.
    pub text: String,
    pub status: Status,
    /// Where it is written: `file:line`, as editors accept it.
    pub place: String,
}

/// A section: a heading with the rules below it.
#[derive(Debug)]
pub struct Section {
    pub title: String,
    /// The paragraph below the heading, which tells users what of the section's subject works.
    pub summary: String,
    pub rules: Vec<Rule>,
    /// The rules that concern neither the bus nor the slaves of an ECM-XF, each with the reason, see [`APART`].
    pub apart: Vec<(RuleId, String)>,
}

/// A page of docs/rules/, with its sections and rules.
#[derive(Debug)]
pub struct Page {
    /// Its path as links in docs/ have it: `rules/board.md`.
    pub file: String,
    pub title: String,
    /// The paragraph below the title, which says what the page is about.
    pub summary: String,
    pub sections: Vec<Section>,
}

/// An error in a page of rules: the file, the line, and what is wrong with it.
#[derive(Debug, PartialEq, Eq)]
pub struct Wrong {
    pub file: String,
    pub line: usize,
    pub problem: String,
}

/// The rules of all pages, and the retired ids.
#[derive(Debug, Default)]
pub struct Rules {
    pub pages: Vec<Page>,
    /// Ids of former rules, which must not be used again.
    pub retired: BTreeSet<RuleId>,
}

impl Rules {
    /// Reads the retired ids of the index. Returns the paths of the pages that it links, in its order.
    pub fn read_index(&mut self, text: &str) -> Vec<String> {
        let retired = text.split_once(RETIRED).map_or("", |(_, below)| below);
        let first_cells = retired.lines().filter_map(|line| line.strip_prefix("| ")?.split('|').next());
        self.retired = first_cells.flat_map(ids_in).collect();
        let mut pages: Vec<String> = Vec::new();
        for link in text.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            if link.starts_with("rules/") && !pages.iter().any(|page| page == link) {
                pages.push(link.to_owned());
            }
        }
        pages
    }

    /// Reads a page. `file` is its path as links in docs/ have it.
    ///
    /// # Errors
    /// A row of a table is no valid rule, or the paragraph below a heading is missing.
    pub fn read_page(&mut self, file: &str, text: &str) -> Result<(), Wrong> {
        let wrong = |line: usize, problem: String| Wrong { file: file.to_owned(), line, problem };
        let lines: Vec<&str> = text.lines().collect();
        let title = lines.first().and_then(|line| line.strip_prefix("# ")).unwrap_or_default().trim().to_owned();
        let summary = paragraph(&lines[1.min(lines.len())..]);
        if title.is_empty() || summary.is_empty() {
            return Err(wrong(
                1,
                "a page begins with a title `# ..` and a paragraph that says what it is about".into(),
            ));
        }
        let mut page = Page { file: file.to_owned(), title, summary, sections: Vec::new() };
        for (number, line) in (1..).zip(&lines) {
            if let Some(title) = line.strip_prefix("## ") {
                let (title, summary) = (title.trim().to_owned(), paragraph(&lines[number..]));
                if summary.is_empty() {
                    return Err(wrong(number, format!("below `{title}` no paragraph says what works")));
                }
                page.sections.push(Section { title, summary, rules: Vec::new(), apart: Vec::new() });
            }
            if line.starts_with(APART) {
                let marks = apart(&lines[number - 1..]).ok_or(wrong(
                    number,
                    format!("`{APART}` is followed by the reason, a colon and the ids of rules of the section"),
                ))?;
                let section = page.sections.last_mut();
                let section = section.ok_or(wrong(number, "a mark before the first heading `## ..`".to_owned()))?;
                section.apart.extend(marks);
            }
            // Every row of a section's table is a rule, except the two lines of the table's head.
            let is_row = |row: &str| !row.starts_with("id |") && !row.starts_with("---");
            let is_rule = |row: &str| PREFIXES.iter().any(|(prefix, _)| row.starts_with(prefix));
            let applies = |row| is_rule(row) || (!page.sections.is_empty() && is_row(row));
            if !line.strip_prefix("| ").is_some_and(applies) {
                continue;
            }
            let rule = row(line, format!("docs/{file}:{number}")).map_err(|problem| wrong(number, problem))?;
            if self.retired.contains(&rule.id) {
                return Err(wrong(number, format!("{} had another meaning once: take a new number", rule.id)));
            }
            let before = self.iter().chain(page.rules()).find(|known| known.id == rule.id);
            if let Some(Rule { id, place, .. }) = before {
                return Err(wrong(number, format!("{id} stands in {place} already: take a new number")));
            }
            let section = page.sections.last_mut();
            section.ok_or(wrong(number, "a rule before the first heading `## ..`".to_owned()))?.rules.push(rule);
        }
        self.pages.push(page);
        Ok(())
    }

    /// All rules, in the order of pages, sections and rows.
    pub fn iter(&self) -> impl Iterator<Item = &Rule> {
        self.pages.iter().flat_map(Page::rules)
    }
}

impl Page {
    fn rules(&self) -> impl Iterator<Item = &Rule> {
        self.sections.iter().flat_map(|section| &section.rules)
    }
}

/// The first paragraph of `lines` joined to one line; empty if something other than a paragraph comes first.
fn paragraph(lines: &[&str]) -> String {
    let text = lines.iter().skip_while(|line| line.trim().is_empty()).take_while(|line| !line.trim().is_empty());
    let text = text.map(|line| line.trim()).collect::<Vec<_>>().join(" ");
    if text.starts_with(['#', '|']) { String::new() } else { text }
}

/// Parses a paragraph that begins with [`APART`]: the rules that it names, each with the reason. `None` if the reason or the
/// ids are missing.
fn apart(lines: &[&str]) -> Option<Vec<(RuleId, String)>> {
    let text = paragraph(lines);
    let (why, ids) = text.strip_prefix(APART)?.split_once(':')?;
    let marks: Vec<_> = ids_in(ids).map(|id| (id, why.trim().to_owned())).collect();
    (!why.trim().is_empty() && !marks.is_empty()).then_some(marks)
}

fn row(line: &str, place: String) -> Result<Rule, String> {
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
    Ok(Rule { id, text: text.clone(), status, place })
}

/// The cells of a row of a Markdown table, without blanks around them. `\|` is a bar inside a cell and stays as it is.
pub fn cells(line: &str) -> Vec<String> {
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
    // The text after the last bar is not a cell.
    cells.pop();
    cells.iter().map(|cell| cell.trim().to_owned()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "# Board\n\nAll\nof it.\n\n## 1. Frames\n\nFrames work.\n\n";

    fn page(rows: &str) -> Result<Rules, Wrong> {
        let mut rules = Rules::default();
        rules.read_page("rules/board.md", &format!("{HEAD}{rows}"))?;
        Ok(rules)
    }

    #[test]
    fn rules_are_read_with_their_sections() {
        let rules = page(
            "More words.\n\n| id | rule | source | status |\n| --- | --- | --- | --- |\n\
             | SK-1.1 | 12 bytes | UG17 2.1 | now |\n\n## Library\n\nCalls.\n\n| LIB-1 | 0x10 \\| last state | OURS | later |\n",
        )
        .unwrap();
        let [page] = &rules.pages[..] else { panic!("{rules:?}") };
        assert_eq!((&*page.file, &*page.title, &*page.summary), ("rules/board.md", "Board", "All of it."));
        let sections: Vec<_> = page.sections.iter().map(|section| (&*section.title, &*section.summary)).collect();
        assert_eq!(sections, [("1. Frames", "Frames work."), ("Library", "Calls.")]);
        let read: Vec<_> = rules.iter().map(|rule| (rule.id.to_string(), rule.text.as_str(), rule.status)).collect();
        assert_eq!(
            read,
            [
                ("SK-1.1".to_owned(), "12 bytes", Status::Now),
                ("LIB-1".to_owned(), "0x10 \\| last state", Status::Later)
            ]
        );
        assert_eq!(rules.iter().next().unwrap().place, "docs/rules/board.md:14");
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
            let wrong = page(row).unwrap_err();
            assert!(wrong.line == 10 && wrong.problem.contains(problem), "{row}: {wrong:?}");
        }
    }

    /// An id is used only once: not for a second rule, and not again after it was retired.
    #[test]
    fn an_id_is_used_once() {
        let row = "| SK-1.1 | a | s | now |\n";
        assert_eq!(page(&format!("{row}{row}")).unwrap_err().line, 11);

        let mut rules = page(row).unwrap();
        let again = rules.read_page("rules/other.md", &format!("{HEAD}{row}")).unwrap_err();
        assert!(again.problem.contains("docs/rules/board.md:10"), "{again:?}");

        let mut rules = Rules::default();
        let index = format!(
            "[a](rules/board.md) [b](rules/x.md) [c](y.md) [a](rules/board.md)\n{RETIRED}\n\n| id | why |\n\
                             | --- | --- |\n| SK-1.1, SK-1.2 | is part of SK-1.3 |\n"
        );
        assert_eq!(rules.read_index(&index), ["rules/board.md", "rules/x.md"]);
        let retired: Vec<String> = rules.retired.iter().map(ToString::to_string).collect();
        assert_eq!(retired, ["SK-1.1", "SK-1.2"]);
        let wrong = rules.read_page("rules/board.md", &format!("{HEAD}{row}")).unwrap_err();
        assert!(wrong.line == 10 && wrong.problem.contains("another meaning"), "{wrong:?}");
    }

    #[test]
    fn marks_have_a_reason_and_rules() {
        let rules =
            page(&format!("{APART}the same code\nas ever: SK-1.1,\nSK-1.2.\n\n| SK-1.1 | a | s | now |\n")).unwrap();
        let marks: Vec<_> = rules.pages[0].sections[0].apart.iter().map(|(id, why)| format!("{id} {why}")).collect();
        assert_eq!(marks, ["SK-1.1 the same code as ever", "SK-1.2 the same code as ever"]);
        for mark in ["the same code", "the same code: none", ": SK-1.1"] {
            assert_eq!(page(&format!("{APART}{mark}\n")).unwrap_err().line, 10, "{mark}");
        }
    }

    #[test]
    fn a_heading_has_its_paragraph() {
        let mut rules = Rules::default();
        for (text, line) in [
            ("", 1),
            ("## 1\n\nx\n", 1),
            ("# a\n\n## 1\n\nx\n", 1),
            ("# a\n\nb\n\n## 1\n\n| id |\n", 5),
            ("# a\n\nb\n\n| SK-1.1 | a | s | now |\n", 5),
        ] {
            assert_eq!(rules.read_page("rules/a.md", text).unwrap_err().line, line, "{text}");
            rules = Rules::default();
        }
    }
}

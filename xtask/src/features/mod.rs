//! `cargo xtask features`: writes docs/FEATURES.md, which summarises how many tests show the rules of docs/rules/, and
//! docs/FEATURES-XF.md, which says for each rule of the board whether it also holds with an ECM-XF.
//!
//! Files:
//!
//! - `rules.rs`, `id.rs`: the rules and their ids
//! - `rust.rs`, `c.rs`, `evidence.rs`: the tests in Rust and C sources, and which rules they name
//! - `report.rs`: docs/FEATURES.md, and problems of rules and tests
//! - `behind_chip.rs`: which tests have their slaves behind an ECM-XF
//! - `on_xf.rs`: the state of the board's rules with an ECM-XF, and docs/FEATURES-XF.md

mod behind_chip;
mod c;
mod evidence;
mod id;
mod on_xf;
mod report;
mod rules;
mod rust;

use std::fs;
use std::io;
use std::path::Path;

use crate::error::Error;
use crate::project::Project;
use evidence::Evidence;
use on_xf::OnXf;
use report::Findings;
use rules::Rules;

#[derive(clap::Args)]
pub struct Arguments {
    /// Write nothing; fail if a claimed rule has no test, a test names an unknown rule, or nothing says how a rule of
    /// the board holds on an ECM-XF
    #[arg(long)]
    check: bool,
    /// Write nothing; print these rules with their tests: ids such as SK-5.6, or beginnings of ids such as SK-5 or WIN
    #[arg(value_name = "ID", conflicts_with = "check")]
    ids: Vec<String>,
}

const DOCS: &str = "docs";
/// The page in `docs` that has a link to each page with rules.
const INDEX: &str = "RULES.md";
/// The folder in `docs` with the pages of rules.
const PAGES: &str = "rules";
/// The pages that `cargo xtask features` writes.
pub const FILES: [&str; 2] = ["FEATURES.md", "FEATURES-XF.md"];

pub fn run(project: &Project, arguments: &Arguments) -> Result<(), Error> {
    if arguments.check {
        return check(project);
    }
    if arguments.ids.is_empty() { write(project) } else { print(project, &arguments.ids) }
}

/// The rules and the tests that show them, as read from the pages and sources.
struct Read {
    rules: Rules,
    evidence: Evidence,
    on_xf: OnXf,
}

impl Read {
    fn of(root: &Path) -> Result<Self, Error> {
        let (rules, evidence) = (read_rules(root)?, Evidence::collect(root)?);
        let on_xf = OnXf::read(root, &rules, &evidence)?;
        Ok(Self { rules, evidence, on_xf })
    }

    /// Writes [`FILES`] into `folder`.
    fn write(&self, folder: &Path) -> Result<(), Error> {
        let texts = [report::page(&self.rules, &self.evidence, &self.on_xf), self.on_xf.page(&self.rules)];
        for (file, text) in FILES.iter().zip(texts) {
            let path = folder.join(file);
            fs::write(&path, text).map_err(Error::file("write", &path))?;
        }
        Ok(())
    }

    fn findings(&self) -> Findings<'_> {
        Findings::of(&self.rules, &self.evidence)
    }
}

/// Fails if a rule with status `now` has no test, if a test names a rule that does not exist, or if nothing gives the state of
/// a board rule on an ECM-XF.
pub fn check(project: &Project) -> Result<(), Error> {
    let read = Read::of(&project.root)?;
    let mut problems = read.findings().problems();
    problems.extend(read.on_xf.problems());
    if problems.is_empty() { Ok(()) } else { Err(Error::Features(problems.join("\n"))) }
}

/// Writes [`FILES`] into `folder`, which is that of a release's packages, instead of docs/.
pub fn write_into(project: &Project, folder: &Path) -> Result<(), Error> {
    Read::of(&project.root)?.write(folder)
}

fn write(project: &Project) -> Result<(), Error> {
    let read = Read::of(&project.root)?;
    read.write(&project.root.join(DOCS))?;
    let findings = read.findings();
    for line in findings.problems().iter().chain(&read.on_xf.problems()).chain(&findings.hints()) {
        println!("{line}");
    }
    println!("{DOCS}/{}: {}", FILES[0], findings.summary());
    Ok(())
}

fn print(project: &Project, ids: &[String]) -> Result<(), Error> {
    let read = Read::of(&project.root)?;
    for id in ids {
        let answer = report::answer(&read.rules, &read.evidence, &read.on_xf, id);
        let unknown = || {
            Error::Features(format!("no rule is called or begins with {id}; docs/RULES.md says which ids there are"))
        };
        print!("{}", answer.ok_or_else(unknown)?);
    }
    Ok(())
}

/// Reads the rules of all pages that the index links. A page in the folder of the rules that the index does not link is an
/// error.
fn read_rules(root: &Path) -> Result<Rules, Error> {
    let docs = root.join(DOCS);
    let text = |file: &str| fs::read_to_string(docs.join(file)).map_err(Error::file("read", &docs.join(file)));
    let mut rules = Rules::default();
    let pages = rules.read_index(&text(INDEX)?);
    for page in &pages {
        rules.read_page(page, &text(page)?).map_err(|wrong| Error::Rules {
            path: Path::new(DOCS).join(wrong.file),
            line: wrong.line,
            problem: wrong.problem,
        })?;
    }
    let folder = docs.join(PAGES);
    let entries = fs::read_dir(&folder).and_then(Iterator::collect::<io::Result<Vec<_>>>);
    for entry in entries.map_err(Error::file("list", &folder))? {
        let page = format!("{PAGES}/{}", entry.file_name().to_string_lossy());
        if !pages.contains(&page) {
            return Err(Error::Features(format!(
                "{DOCS}/{INDEX} does not link {page}, so that nobody finds its rules: link it"
            )));
        }
    }
    Ok(rules)
}

/// The text of a file; invalid UTF-8 is replaced by U+FFFD.
fn text_of(path: &Path) -> io::Result<String> {
    fs::read(path).map(|bytes| String::from_utf8_lossy(&bytes).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// README lists as working exactly the link schemes that the library has.
    #[test]
    fn readme_claims_the_links_that_there_are() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
        let readme = fs::read_to_string(root.join("README.md")).unwrap();
        let there_are = fs::read_to_string(root.join("src/address/scheme.rs")).unwrap();
        let mut schemes: Vec<&str> = Vec::new();
        for row in readme.lines().filter(|line| line.starts_with("| `") && line.contains("| works")) {
            let scheme = row.trim_start_matches("| `").split(':').next().unwrap();
            assert!(there_are.contains(&format!("name: \"{scheme}\"")), "{row}");
            schemes.push(scheme);
        }
        schemes.dedup();
        assert_eq!(schemes, ["sim", "usb", "spi", "tcp", "xf-sim", "xf-spi", "xf-usb", "nic"]);
    }
}

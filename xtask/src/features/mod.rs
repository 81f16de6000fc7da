//! `cargo xtask features`: which rule of docs/RULES.md is shown by which test, written to docs/FEATURES.md.

mod c;
mod evidence;
mod id;
mod report;
mod rules;
mod rust;

use std::fs;
use std::io;

use crate::error::Error;
use crate::project::Project;
use evidence::Evidence;
use report::Findings;
use rules::Rules;

#[derive(clap::Args)]
pub struct Arguments {
    /// Write nothing; fail if the file is stale, a rule claimed has no test, or a test names a rule that is not there
    #[arg(long)]
    check: bool,
}

const RULES: &str = "docs/RULES.md";
const FEATURES: &str = "docs/FEATURES.md";

pub fn run(project: &Project, arguments: &Arguments) -> Result<(), Error> {
    if arguments.check { check(project) } else { write(project) }
}

/// Fails if docs/FEATURES.md is stale, a rule `now` has no test, or a test names a rule that is not there.
pub fn check(project: &Project) -> Result<(), Error> {
    let (rules, evidence) = read(project)?;
    let findings = Findings::of(&rules, &evidence);
    let mut problems = findings.problems();
    if fs::read_to_string(project.root.join(FEATURES)).unwrap_or_default() != report::page(&rules, &evidence) {
        problems.push(format!("{FEATURES} is stale: run `cargo xtask features` and commit the file"));
    }
    if problems.is_empty() { Ok(()) } else { Err(Error::Features(problems.join("\n"))) }
}

fn write(project: &Project) -> Result<(), Error> {
    let (rules, evidence) = read(project)?;
    let path = project.root.join(FEATURES);
    fs::write(&path, report::page(&rules, &evidence)).map_err(Error::file("write", &path))?;
    let findings = Findings::of(&rules, &evidence);
    for line in findings.problems().iter().chain(&findings.hints()) {
        println!("{line}");
    }
    println!("{FEATURES}: {}", findings.summary());
    Ok(())
}

fn read(project: &Project) -> Result<(Rules, Evidence), Error> {
    let path = project.root.join(RULES);
    let text = fs::read_to_string(&path).map_err(Error::file("read", &path))?;
    let rules = Rules::parse(&text).map_err(|(line, problem)| Error::Rules { path: RULES.into(), line, problem })?;
    Ok((rules, Evidence::collect(&project.root)?))
}

/// The text of a file; a byte that is no UTF-8 reads as U+FFFD.
fn text_of(path: &std::path::Path) -> io::Result<String> {
    fs::read(path).map(|bytes| String::from_utf8_lossy(&bytes).into_owned())
}

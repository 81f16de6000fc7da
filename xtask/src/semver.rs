//! `cargo xtask semver`: checks that the public API of the library is compatible with the last release.

use crate::command;
use crate::error::Error;
use crate::needs::{self, CARGO_SEMVER_CHECKS};
use crate::project::Project;
use crate::tools;

pub fn run(project: &Project) -> Result<(), Error> {
    let Some(tag) = last_release(project)? else {
        return Err(Error::NoRelease);
    };
    needs::require(project, &[CARGO_SEMVER_CHECKS])?;
    println!("comparing the library with {tag}");
    let mut checks = project.program(tools::CARGO_SEMVER_CHECKS.program(project));
    checks.args(["semver-checks", "--package=ecmsk", "--all-features", "--baseline-rev", &tag]);
    command::run(&mut checks)
}

/// The tag of the newest release, if there is one.
fn last_release(project: &Project) -> Result<Option<String>, Error> {
    let mut git = project.program("git");
    let tags = command::output(git.args(["tag", "--list", "--sort=-version:refname"]))?;
    Ok(newest(&String::from_utf8_lossy(&tags)))
}

/// The first tag of the form `v1.2.3`. `tags` are sorted from the newest to the oldest.
fn newest(tags: &str) -> Option<String> {
    let is_version =
        |tag: &&str| tag.strip_prefix('v').is_some_and(|rest| rest.starts_with(|c: char| c.is_ascii_digit()));
    tags.lines().find(is_version).map(str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_release_is_a_tag_with_its_version() {
        assert_eq!(newest("vendor\nv0.2.0\nv0.1.0\n").as_deref(), Some("v0.2.0"));
        assert_eq!(newest("vendor\n0.1.0\n"), None);
    }
}

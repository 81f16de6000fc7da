//! `cargo xtask semver`: checks that the public API of the library is compatible with the last release, and that the facts of
//! the C library's surface are still those of the releases (`tests/capi/surface.rs`).

use std::fs;

use crate::command;
use crate::error::Error;
use crate::needs::{self, CARGO_SEMVER_CHECKS};
use crate::project::Project;
use crate::tools;

pub fn run(project: &Project) -> Result<(), Error> {
    let tags = releases(project)?;
    let Some(tag) = tags.first() else {
        return Err(Error::NoRelease);
    };
    tags.iter().try_for_each(|tag| same_surface(project, tag))?;
    needs::require(project, &[CARGO_SEMVER_CHECKS])?;
    println!("comparing the library with {tag}");
    let mut checks = project.program(tools::CARGO_SEMVER_CHECKS.program(project));
    checks.args(["semver-checks", "--package=ecmsk", "--all-features", "--baseline-rev", tag]);
    command::run(&mut checks)
}

/// The tags of the releases, from the newest to the oldest.
fn releases(project: &Project) -> Result<Vec<String>, Error> {
    let mut git = project.program("git");
    let tags = command::output(git.args(["tag", "--list", "--sort=-version:refname"]))?;
    Ok(versions(&String::from_utf8_lossy(&tags)))
}

/// The tags of the form `v1.2.3`.
fn versions(tags: &str) -> Vec<String> {
    let is_version =
        |tag: &&str| tag.strip_prefix('v').is_some_and(|rest| rest.starts_with(|c: char| c.is_ascii_digit()));
    tags.lines().filter(is_version).map(str::to_owned).collect()
}

/// Checks that the facts of the C library's surface at a release were not written again since.
fn same_surface(project: &Project, tag: &str) -> Result<(), Error> {
    let file = format!("tests/capi/surface/{}.txt", tag.trim_start_matches('v'));
    let released = command::output(project.program("git").args(["show", &format!("{tag}:{file}")]))?;
    let is_same = fs::read(project.root.join(&file)).is_ok_and(|facts| facts == released);
    if is_same { Ok(()) } else { Err(Error::Surface { file, tag: tag.to_owned() }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_release_is_a_tag_with_its_version() {
        assert_eq!(versions("vendor\nv0.2.0\nv0.1.0\n"), ["v0.2.0", "v0.1.0"]);
        assert_eq!(versions("vendor\n0.1.0\n"), [""; 0]);
    }

    /// Facts that were written again after their release are an error, whether a line is gone or new; so are facts that
    /// are no longer there. The facts of the next version do not count.
    #[test]
    fn the_facts_of_a_release_stay() {
        let folder = tempfile::tempdir().expect("a folder");
        let root = folder.path();
        let project = Project { root: root.into(), target: root.join("target"), for_tests: false, quick: false };
        let git = |arguments: &[&str]| {
            let who = ["-c", "user.name=A", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false"];
            command::output(project.program("git").args(who).args(arguments)).expect("git");
        };
        let surface = root.join("tests/capi/surface");
        fs::create_dir_all(&surface).expect("a folder");
        let write = |version: &str, facts: &str| fs::write(surface.join(version), facts).expect("a file");
        write("0.1.0.txt", "export 1 Open\nexport 2 Close\n");
        git(&["init", "--quiet"]);
        git(&["add", "--all"]);
        git(&["commit", "--quiet", "--message=The release"]);
        git(&["tag", "v0.1.0"]);
        assert_eq!(releases(&project).expect("tags"), ["v0.1.0"]);
        write("0.2.0.txt", "export 1 Open\n");
        same_surface(&project, "v0.1.0").expect("the same");
        for other in ["export 1 Open\n", "export 1 Open\nexport 2 Close\nexport 3 Read\n"] {
            write("0.1.0.txt", other);
            let error = same_surface(&project, "v0.1.0").expect_err(other).to_string();
            assert!(error.contains("git checkout v0.1.0 -- tests/capi/surface/0.1.0.txt"), "{error}");
        }
        fs::remove_file(surface.join("0.1.0.txt")).expect("it was there");
        assert!(same_surface(&project, "v0.1.0").is_err());
    }
}

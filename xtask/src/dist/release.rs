//! The version of a release, and the one time that all its files have.

use std::ffi::OsStr;
use std::process::Command;
use std::{env, fs};

use crate::command;
use crate::error::Error;
use crate::project::Project;

/// The environment variable that gives the time of a reproducible build (reproducible-builds.org).
pub const VARIABLE: &str = "SOURCE_DATE_EPOCH";
/// The earliest time that a zip file can store: 1 January 1980, in seconds since 1970.
const FIRST: u64 = 315_532_800;

/// The version of a release, and the one time that all its files get.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Release {
    pub version: &'static str,
    /// The time of every file in a package, in seconds since 1970.
    pub epoch: u64,
}

impl Release {
    /// Finds the version and the release time. The time is that of `SOURCE_DATE_EPOCH`, or else of the last commit, or else
    /// the date of the newest version in CHANGELOG. \[OURS]
    pub fn find(project: &Project) -> Result<Self, Error> {
        let given = env::var(VARIABLE).ok();
        let from_git = || {
            let there = project.root.join(".git").exists();
            let mut git = Command::new("git");
            git.current_dir(&project.root).args(["log", "-1", "--format=%ct"]);
            there.then(|| command::output(&mut git).ok().and_then(|said| String::from_utf8(said).ok())).flatten()
        };
        let from_changelog = || date_in(&fs::read_to_string(project.root.join("CHANGELOG.md")).ok()?);
        let epoch = given.or_else(from_git).or_else(from_changelog);
        let epoch = epoch.and_then(|text| text.trim().parse().ok()).filter(|epoch| *epoch >= FIRST);
        let epoch = epoch.ok_or(Error::NoTime { variable: VARIABLE })?;
        Ok(Self { version: env!("CARGO_PKG_VERSION"), epoch })
    }

    /// The release time in a format of the program `date`, such as `-R`.
    pub fn date(&self, format: &str) -> Result<String, Error> {
        let mut date = Command::new("date");
        date.env("LC_ALL", "C").args(["-u", "-d", &format!("@{}", self.epoch), format]);
        Ok(String::from_utf8_lossy(&command::output(&mut date)?).trim().to_owned())
    }

    /// Starts a program so that its output does not depend on the present time, the language and the sort order of this
    /// machine.
    pub fn command(&self, program: impl AsRef<OsStr>) -> Command {
        let mut command = Command::new(program);
        command.env(VARIABLE, self.epoch.to_string()).env("LC_ALL", "C").env("TZ", "UTC");
        command
    }
}

/// The date of the newest version in CHANGELOG, in seconds since 1970: from the first heading such as `## [0.1.0] -
/// 2026-11-22`.
fn date_in(changelog: &str) -> Option<String> {
    let day = changelog.lines().filter(|line| line.starts_with("## [")).find_map(|line| line.split_once("] - "))?.1;
    let mut date = Command::new("date");
    let said = command::output(date.args(["-u", "-d", day.trim(), "+%s"])).ok()?;
    String::from_utf8(said).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_changelog_has_the_date_of_its_newest_version() {
        let text = "# Changelog\n\n## [Unreleased]\n\n## [0.2.0] - 2026-11-22\n\n## [0.1.0] - 2026-01-01\n";
        assert_eq!(date_in(text).unwrap().trim(), "1795305600");
        assert_eq!(date_in("## [Unreleased]\n"), None);
    }

    #[test]
    fn times_are_said_in_one_language_and_zone() {
        let release = Release { version: "0.1.0", epoch: 1_795_305_600 };
        assert_eq!(release.date("-R").unwrap(), "Sun, 22 Nov 2026 00:00:00 +0000");
        assert_eq!(release.date("+%Y-%m-%dT%H:%M:%SZ").unwrap(), "2026-11-22T00:00:00Z");
    }
}

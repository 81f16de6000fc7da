//! `docs/CI.md` and the workflow files of `share/ci/`: every command of the page prints what it shows, and those of the
//! workflows pass a program that is right and find one that is wrong.
#![cfg(target_os = "linux")]

use std::fs;

use support::root;

/// What a workflow file runs of the program's own: `run:` with a command on its line (GitHub), the items of `script:` and
/// `after_script:` (GitLab). What installs packages stands in a block of `run:` or in `before_script:`.
fn commands(workflow: &str) -> Vec<&str> {
    let mut is_script = false;
    let mut found = Vec::new();
    for line in workflow.lines().map(str::trim) {
        match (line.strip_prefix("run: "), line.strip_prefix("- ")) {
            (Some("|"), _) => {}
            (Some(command), _) => found.push(command),
            (None, Some(command)) if is_script => found.push(command),
            (None, Some(_)) => {}
            (None, None) => is_script = matches!(line, "script:" | "after_script:"),
        }
    }
    found
}

/// The link of a workflow file.
fn link(workflow: &str) -> &str {
    let line = workflow.lines().find_map(|line| line.trim().strip_prefix("LINK: '")).expect("a link");
    line.strip_suffix('\'').expect("a quote at the end")
}

fn workflows() -> [String; 2] {
    ["github.yml", "gitlab-ci.yml"]
        .map(|name| fs::read_to_string(root().join("share/ci").join(name)).expect("the file"))
}

/// Both services run the same, on the same link.
#[test]
fn the_workflows_run_the_same() {
    let [github, gitlab] = workflows();
    assert_eq!(commands(&github), commands(&gitlab));
    assert_eq!(link(&github), link(&gitlab));
    assert_eq!(commands(&github).len(), 11, "{:?}", commands(&github));
}

mod needs_cxx {
    use std::path::Path;

    use super::*;
    use crate::prefix::{shell, shows};

    /// The workflow's commands up to the first that fails, each in a shell of its own as GitHub runs them.
    /// Returns the command that failed and what it has printed.
    fn run_workflow(folder: &Path) -> Result<(), (String, String)> {
        for entry in fs::read_dir(folder).expect("the folder") {
            let file = entry.expect("readable").path();
            if file.extension().is_some_and(|extension| extension == "ecmrec") {
                fs::remove_file(file).expect("a recording of the run before");
            }
        }
        let [workflow, _] = workflows();
        for command in commands(&workflow) {
            let mut sh = shell("sh", folder);
            let ended = support::run(sh.args(["-e", "-c", command]).env("LINK", link(&workflow)));
            if !ended.status.success() {
                return Err((command.to_owned(), ended.stdout + &ended.stderr));
            }
        }
        Ok(())
    }

    /// The page prints what it shows, its files are what the workflows need, and the workflows find a program that moves
    /// otherwise, and one that does not get over an alarm.
    #[test]
    fn the_page_and_the_workflows_judge_a_program() {
        let folder = tempfile::tempdir().expect("a folder");
        let folder = folder.path();
        let examples = root().join("examples/cpp");
        for (from, to) in [("alarm_recovery.cpp", "press.cpp"), ("ecm.h", "ecm.h"), ("homing.h", "homing.h")] {
            fs::copy(examples.join(from), folder.join(to)).expect("a copy");
        }
        let page = fs::read_to_string(root().join("docs/CI.md")).expect("the page");
        assert!(shows(&page, folder) >= 15, "some commands are in no block `console`");
        assert_eq!(run_workflow(folder), Ok(()));
        let program = fs::read_to_string(folder.join("press.cpp")).expect("the program");
        for (right, wrong, finds, says) in [
            ("SPEED_LIMIT = 2500", "SPEED_LIMIT = 2600", "ecmsk compare ", "first difference:"),
            ("CLEAR_TRIES = 3", "CLEAR_TRIES = 0", "ecmsk exec --link \"$LINK&script=", "alarm"),
        ] {
            assert!(program.contains(right), "{right}");
            fs::write(folder.join("press.cpp"), program.replace(right, wrong)).expect("a file");
            let (command, text) = run_workflow(folder).expect_err(wrong);
            assert!(command.starts_with(finds) && text.contains(says), "{wrong}: {command}: {text}");
        }
    }
}

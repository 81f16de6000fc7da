//! Builds in the background what only later parts of `cargo xtask test --all` need: the files for Windows, the packages'
//! programs for Linux, and the Debian systems. They have folders of their own, so that no part waits for them.
//!
//! The work is done by a second process of this program, at the lowest priority: it runs while a processor has nothing else to
//! do, as most of the time when rustc compiles the last crate of a build, or tests wait for the clock.

use std::fs::{self, File};
use std::io;
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread;

use crate::error::Error;
use crate::needs::{DEBOOTSTRAP, Need, ROOT};
use crate::project::Project;
use crate::{command, dist, windows};

/// A build that is made in the background: its name on the command line, the programs and rights that it needs, and the
/// function that makes it.
struct Step {
    name: &'static str,
    needs: &'static [Need],
    run: fn(&Project) -> Result<(), Error>,
}

/// The steps, in the order in which the parts of `cargo xtask test --all` use their results.
const STEPS: [Step; 4] = [
    Step {
        name: "windows",
        needs: windows::BUILD_NEEDS,
        run: |project| windows::build_into(project, &windows::staged(project)),
    },
    Step { name: "wine", needs: &[DEBOOTSTRAP, ROOT], run: windows::set_up_debian },
    Step { name: "linux", needs: &[], run: |project| dist::build_for_linux(project).map(drop) },
    Step { name: "debian", needs: &[DEBOOTSTRAP, ROOT], run: dist::set_up_debian },
];

#[derive(clap::Args)]
pub struct Arguments {
    /// Steps to run; they run in this order
    #[arg(required = true, value_parser = clap::builder::PossibleValuesParser::new(STEPS.map(|step| step.name)))]
    steps: Vec<String>,
}

/// The background process: runs the steps, also after one that failed, because the part that needs it reports the error.
pub fn run(project: &Project, arguments: &Arguments) -> Result<(), Error> {
    thread::spawn(end_with_the_parent);
    let project = &project.quick_for_tests();
    for step in STEPS.iter().filter(|step| arguments.steps.iter().any(|name| name == step.name)) {
        if let Err(error) = (step.run)(project) {
            eprintln!("{}: {error}", step.name);
        }
    }
    Ok(())
}

/// Waits for the end of standard input, which the parent holds open, and then ends this process and all that it has started.
fn end_with_the_parent() {
    // Only the end of the input matters: nobody writes to it.
    let _ = io::copy(&mut io::stdin().lock(), &mut io::sink());
    // "0" is the process group of the sender, which the parent made for this process. The program `kill` may not be installed,
    // but every shell has the command.
    let _ = Command::new("sh").args(["-c", "kill -KILL 0"]).status();
}

/// The running background process. Dropping it ends the process.
pub struct Ahead {
    child: Child,
    log: PathBuf,
}

impl Ahead {
    /// Starts the process with those steps for which no program or right is `missing` on this machine. `None`: it does not
    /// start, and the parts build everything themselves.
    pub fn start(project: &Project, missing: &[Need]) -> Option<Self> {
        let note = |error| println!("note: nothing is built in the background ({error})");
        Self::try_start(project, missing).map_err(note).ok()
    }

    fn try_start(project: &Project, missing: &[Need]) -> Result<Self, Error> {
        let can = |step: &&Step| !step.needs.iter().any(|need| missing.contains(need));
        let steps: Vec<&str> = STEPS.iter().filter(can).map(|step| step.name).collect();
        let program = std::env::current_exe().map_err(Error::file("find", "this program".as_ref()))?;
        let mut command = Command::new(program);
        command.current_dir(&project.root).arg("ahead").args(steps);
        let ahead = Self::spawn(command, project.target.join("xtask/ahead.log"))?;
        ahead.set_niceness("19");
        Ok(ahead)
    }

    fn spawn(mut command: Command, log: PathBuf) -> Result<Self, Error> {
        let file = log.parent().map_or(Ok(()), fs::create_dir_all).and_then(|()| File::create(&log));
        let file = file.map_err(Error::file("make", &log))?;
        command.stdin(Stdio::piped()).stderr(file.try_clone().map_err(Error::file("share", &log))?).stdout(file);
        crate::system::lead_a_group(&mut command);
        let child = command.spawn().map_err(|source| Error::Start { command: command::shown(&command), source })?;
        Ok(Self { child, log })
    }

    /// Sets the niceness of the process and all that it has started, if this user may do that.
    fn set_niceness(&self, niceness: &str) {
        let group = self.child.id().to_string();
        command::succeeds(Command::new("renice").args(["-n", niceness, "-g", &group]));
    }

    /// Waits until all steps have succeeded or failed. The caller has nothing else to do meanwhile, so the process gets the
    /// usual priority, if this user may raise it.
    pub fn wait(mut self) -> Result<(), Error> {
        self.set_niceness("0");
        // `Child::wait` would first close the pipe to the process. The process ends as soon as the pipe is closed, so the
        // pipe is taken out and kept open here.
        let stdin = self.child.stdin.take();
        let status: ExitStatus = self.child.wait().map_err(Error::file("wait for what writes", &self.log))?;
        drop(stdin);
        if !status.success() {
            println!("note: the background builds ended with {status}, see {}", self.log.display());
        }
        Ok(())
    }
}

impl Drop for Ahead {
    fn drop(&mut self) {
        drop(self.child.stdin.take());
        let _ = self.child.wait();
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;

    fn shell(line: &str) -> (tempfile::TempDir, Ahead) {
        let folder = tempfile::tempdir().unwrap();
        let mut command = Command::new("sh");
        command.args(["-c", line]);
        let ahead = Ahead::spawn(command, folder.path().join("below/ahead.log")).unwrap();
        (folder, ahead)
    }

    #[test]
    fn its_output_goes_to_a_file_and_its_end_is_awaited() {
        let (folder, ahead) = shell("echo out; echo err >&2; sleep 0.2; echo last; exit 3");
        ahead.wait().unwrap();
        assert_eq!(fs::read_to_string(folder.path().join("below/ahead.log")).unwrap(), "out\nerr\nlast\n");
    }

    /// The niceness that is set for the background process is also that of all that it starts.
    #[test]
    fn what_it_starts_is_as_nice() {
        let (folder, ahead) = shell("read go; nice; cat");
        ahead.set_niceness("19");
        ahead.child.stdin.as_ref().unwrap().write_all(b"go\n").unwrap();
        drop(ahead);
        assert_eq!(fs::read_to_string(folder.path().join("below/ahead.log")).unwrap(), "19\n");
    }

    /// The background process has a process group of its own, and ends when the pipe to it is closed.
    #[test]
    fn it_ends_with_its_parent() {
        let (folder, ahead) = shell("cut -d' ' -f5 /proc/$$/stat; echo $$; cat; echo end");
        drop(ahead);
        let said = fs::read_to_string(folder.path().join("below/ahead.log")).unwrap();
        let words: Vec<&str> = said.split_whitespace().collect();
        assert!(words.len() == 3 && words[0] == words[1] && words[2] == "end", "{said}");
    }
}

//! Runs several commands, three at a time, each with its own log file.

use std::fs::{self, File};
use std::path::Path;
use std::process::Command;
use std::sync::Mutex;
use std::thread;
use std::time::Instant;

use crate::command;
use crate::error::Error;

/// The number of commands that run at the same time. They wait for the clock most of the time.
const LANES: usize = 3;

/// A command, and the name that is shown for it.
pub struct Named {
    pub name: String,
    pub command: Command,
}

/// Runs the commands in this order, [`LANES`] at a time. The output of each goes to a file in `logs` and is shown as a whole
/// when the command has ended. After a failure no further command is started. Returns the first failure.
pub fn run(commands: Vec<Named>, logs: &Path) -> Result<(), Error> {
    fs::create_dir_all(logs).map_err(Error::file("make", logs))?;
    let waiting = Mutex::new(commands.into_iter());
    let failure = Mutex::new(None);
    let lane = || {
        while locked(&failure).is_none() {
            let Some(next) = locked(&waiting).next() else { return };
            if let Err(error) = run_one(next, logs) {
                locked(&failure).get_or_insert(error);
            }
        }
    };
    thread::scope(|scope| (0..LANES).for_each(|_| drop(scope.spawn(lane))));
    failure.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner()).map_or(Ok(()), Err)
}

fn locked<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

fn run_one(Named { name, mut command }: Named, logs: &Path) -> Result<(), Error> {
    println!("  {name} ...");
    // The output goes to a file and not to a pipe, because a process that outlives the command would keep a pipe open.
    let log = logs.join(format!("{name}.log"));
    let file = File::create(&log).map_err(Error::file("make", &log))?;
    command.stderr(file.try_clone().map_err(Error::file("share", &log))?).stdout(file);
    let begin = Instant::now();
    let result = command::run(&mut command);
    let said = fs::read(&log).map_err(Error::file("read", &log))?;
    let verdict = if result.is_ok() { "passed" } else { "FAILED" };
    let seconds = begin.elapsed().as_secs_f64();
    println!("{}  {name}: {verdict} after {seconds:.1} s", String::from_utf8_lossy(&said));
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shell(name: &str, line: &str) -> Named {
        let mut command = Command::new("sh");
        command.args(["-c", line]);
        Named { name: name.to_owned(), command }
    }

    /// Two commands run at the same time: each ends only after the other one has written a file.
    #[test]
    fn two_run_at_a_time_each_with_its_log() {
        let folder = tempfile::tempdir().unwrap();
        let (a, b) = (folder.path().join("a"), folder.path().join("b"));
        let meet = |own: &Path, other: &Path| {
            format!(
                "echo out; echo err >&2; touch {0}.is; while [ ! -e {1}.is ]; do sleep 0.01; done",
                own.display(),
                other.display()
            )
        };
        run(vec![shell("first", &meet(&a, &b)), shell("second", &meet(&b, &a))], folder.path()).unwrap();
        for name in ["first.log", "second.log"] {
            assert_eq!(fs::read_to_string(folder.path().join(name)).unwrap(), "out\nerr\n");
        }
    }

    /// After a failure no further command is started.
    #[test]
    fn a_failure_is_the_end() {
        let folder = tempfile::tempdir().unwrap();
        let late = folder.path().join("late");
        let mut commands = vec![shell("bad", "exit 3")];
        commands.extend((1..LANES).map(|n| shell(&format!("slow{n}"), "sleep 0.5")));
        commands.push(shell("late", &format!("touch {}", late.display())));
        let error = run(commands, folder.path()).unwrap_err().to_string();
        assert!(error.contains("exit status: 3") && !late.exists(), "{error}");
    }
}

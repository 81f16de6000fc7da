//! Boots the guest and reads its console.

use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

use super::files;
use crate::command;
use crate::error::Error;

/// The time limit for a guest, from its start to its end. It is long enough for a busy machine.
const LIMIT: Duration = Duration::from_secs(2400);
/// QEMU's exit code if the guest succeeded. The guest writes its own exit code to the device isa-debug-exit, which ends QEMU
/// with twice that code plus 1; the guest's code for success is 0.
const GUEST_SUCCEEDED: i32 = 1;
/// The last line that the guest's init prints if the program that it runs has succeeded.
const END: &str = "GUEST-END rc=0";
/// The number of last lines that are shown if the guest failed.
const LAST_LINES: usize = 80;

/// The command line of the guest's kernel. The arguments of its first program (init) follow.
const KERNEL_OPTIONS: &str = "console=ttyS0 quiet loglevel=3 panic=-1 oops=panic --";

/// The machine that QEMU emulates.
pub struct Machine<'a> {
    pub kernel: &'a Path,
    pub initrd: &'a Path,
    pub memory_mb: u32,
    /// Folders of this machine that are visible in the guest, by the names under which it mounts them; they are
    /// read-only.
    pub folders: &'a [(&'a str, &'a Path)],
}

/// Boots the guest and returns the lines of its output. `words` are the arguments of its first program (init). The output
/// also goes to the file `log`, and lines for which `is_shown` is true, such as results of tests, to standard output at
/// once.
pub fn boot(
    machine: &Machine<'_>,
    words: &[String],
    log: &Path,
    is_shown: fn(&str) -> bool,
) -> Result<Vec<String>, Error> {
    let mut file = File::create(log).map_err(Error::file("make", log))?;
    let mut qemu = command_line(machine, words);
    let started = qemu.spawn().map_err(|source| Error::Start { command: command::shown(&qemu), source });
    let mut child = Guest(started?);
    let said = child.0.stdout.take();

    let (lines, heard) = mpsc::channel();
    let reader = thread::spawn(move || {
        let bytes = said.into_iter().flat_map(|said| BufReader::new(said).split(b'\n')).map_while(Result::ok);
        for line in bytes {
            let line = String::from_utf8_lossy(&line).trim_end().to_owned();
            if lines.send(line).is_err() {
                return;
            }
        }
    });
    let until = Instant::now() + LIMIT;
    let mut all = Vec::new();
    while let Ok(line) = heard.recv_timeout(until.saturating_duration_since(Instant::now())) {
        // The log is only for the user, so a full disk does not fail the test.
        let _ = writeln!(file, "{line}");
        if is_shown(&line) {
            println!("  {line}");
        }
        all.push(line);
    }
    let in_time = Instant::now() < until;
    if !in_time {
        child.end();
    }
    let status = child.0.wait().map_err(Error::file("wait for", Path::new("qemu")))?;
    // The guest has ended, so the thread that reads its output ends too.
    let _ = reader.join();
    if in_time && status.code() == Some(GUEST_SUCCEEDED) && all.iter().any(|line| line == END) {
        return Ok(all);
    }
    let said: Vec<&str> = all.iter().map(String::as_str).filter(|line| !line.starts_with(files::MARK)).collect();
    println!("{}", said[said.len().saturating_sub(LAST_LINES)..].join("\n"));
    let why = if in_time { "what ran there failed, or the guest did" } else { "the guest did not end in time" };
    Err(Error::Guest { why, log: log.to_owned() })
}

/// Boots two guests at the same time, each with one set of arguments and its own log in the folder: a guest uses only one
/// processor, and so two are used. Returns the lines of both.
pub fn boot_two(
    machine: &Machine<'_>,
    words: [&[&str]; 2],
    folder: &Path,
    is_shown: fn(&str) -> bool,
) -> Result<Vec<String>, Error> {
    let [first, second] = words.map(|words| words.iter().map(|&word| word.to_owned()).collect::<Vec<_>>());
    let (first, second) = thread::scope(|scope| {
        let first = scope.spawn(|| boot(machine, &first, &folder.join("console.log"), is_shown));
        let second = boot(machine, &second, &folder.join("console-2.log"), is_shown);
        (first.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)), second)
    });
    Ok([first?, second?].concat())
}

/// The command line of QEMU. KVM is not used, because it may hang on a machine that is a guest itself.
fn command_line(machine: &Machine<'_>, words: &[String]) -> Command {
    let mut qemu = Command::new("qemu-system-x86_64");
    // 64-bit Wine uses the instruction iretq to go on in its own user-mode code. This QEMU wrongly applies SMAP (the
    // protection of user memory from the kernel) to it, so that the guest's kernel would panic.
    qemu.args(["-M", "pc", "-accel", "tcg", "-cpu", "max,-smap", "-smp", "1", "-m", &machine.memory_mb.to_string()]);
    // The guest's time is the number of executed instructions, 1 ns each, so that no test is late on a busy machine.
    // While the guest is idle its time jumps to the next event, unless it waits for a file of this machine, which
    // takes real time.
    let idle = if machine.folders.is_empty() { "off" } else { "on" };
    qemu.arg("-icount").arg(format!("shift=0,sleep={idle}"));
    qemu.args(["-nodefaults", "-no-user-config", "-no-reboot", "-display", "none", "-serial", "stdio"]);
    qemu.args(["-device", "isa-debug-exit,iobase=0xf4,iosize=1"]);
    qemu.arg("-kernel").arg(machine.kernel).arg("-initrd").arg(machine.initrd);
    qemu.arg("-append").arg(format!("{KERNEL_OPTIONS} {}", words.join(" ")));
    for (name, folder) in machine.folders {
        // QEMU expects commas in a value to be doubled.
        let path = folder.to_string_lossy().replace(',', ",,");
        qemu.arg("-virtfs").arg(format!("local,path={path},mount_tag={name},security_model=none,readonly=on"));
    }
    qemu.stdin(Stdio::null()).stdout(Stdio::piped());
    qemu
}

/// Whether a line of output is the result of a test, or says that the guest has started.
pub fn is_result(line: &str) -> bool {
    line.starts_with("test ") || line.starts_with("GUEST-BEGIN")
}

/// A running QEMU, which is killed when this is dropped.
struct Guest(Child);

impl Guest {
    fn end(&mut self) {
        // Killing fails if QEMU has ended already.
        let _ = self.0.kill();
    }
}

impl Drop for Guest {
    fn drop(&mut self) {
        self.end();
        let _ = self.0.wait();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_told_from_what_else_a_guest_says() {
        assert!(is_result("test list::shows ... ok") && is_result("test result: ok. 3 passed"));
        assert!(!is_result("[    1.0] usb 1-1: new high-speed USB device") && !is_result("running 3 tests"));
    }
}

//! Boots the guest and reads what it says.

use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use super::files;
use crate::command;
use crate::error::Error;

/// No run of the tests takes longer, on a machine that is busy with other things too.
const LIMIT: Duration = Duration::from_secs(2400);
/// QEMU's own exit code when the guest said 0: twice that and one more.
const GUEST_SUCCEEDED: i32 = 1;
/// What the guest's first program says last.
const END: &str = "GUEST-END rc=0";
/// Lines that are shown of a guest that failed.
const LAST_LINES: usize = 80;

/// What the kernel is told; behind it stands what it hands to its first program.
const KERNEL_OPTIONS: &str = "console=ttyS0 quiet loglevel=3 panic=-1 oops=panic --";

/// What is booted.
pub struct Machine<'a> {
    pub kernel: &'a Path,
    pub initrd: &'a Path,
    pub memory_mb: u32,
    /// Folders of this machine that it sees, by the names it mounts them by; it cannot write to them.
    pub folders: &'a [(&'a str, &'a Path)],
}

/// Boots it, hands it these words, and gives what it says, line by line. That goes to the file `log` too, and what
/// `is_shown` to standard output at once.
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
    let reader = std::thread::spawn(move || {
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
        // The file is for a person; that it is full is no reason to stop.
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
    // Its output is at its end, as it is itself.
    let _ = reader.join();
    if in_time && status.code() == Some(GUEST_SUCCEEDED) && all.iter().any(|line| line == END) {
        return Ok(all);
    }
    let said: Vec<&str> = all.iter().map(String::as_str).filter(|line| !line.starts_with(files::MARK)).collect();
    println!("{}", said[said.len().saturating_sub(LAST_LINES)..].join("\n"));
    let why = if in_time { "what ran there failed, or the guest did" } else { "the guest did not end in time" };
    Err(Error::Guest { why, log: log.to_owned() })
}

/// Without KVM: on a machine that is a guest itself it may hang.
fn command_line(machine: &Machine<'_>, words: &[String]) -> Command {
    let mut qemu = Command::new("qemu-system-x86_64");
    // 64-bit Wine goes back to itself by iretq, to which this QEMU applies SMAP: the guest's kernel would panic.
    qemu.args(["-M", "pc", "-accel", "tcg", "-cpu", "max,-smap", "-smp", "1", "-m", &machine.memory_mb.to_string()]);
    // Time in the guest is what it has executed, 1 ns an instruction: a busy machine makes no test late. While it does
    // nothing time jumps to what it waits for next, unless that is a file of this machine, which takes its time.
    let idle = if machine.folders.is_empty() { "off" } else { "on" };
    qemu.arg("-icount").arg(format!("shift=0,sleep={idle}"));
    qemu.args(["-nodefaults", "-no-user-config", "-no-reboot", "-display", "none", "-serial", "stdio"]);
    qemu.args(["-device", "isa-debug-exit,iobase=0xf4,iosize=1"]);
    qemu.arg("-kernel").arg(machine.kernel).arg("-initrd").arg(machine.initrd);
    qemu.arg("-append").arg(format!("{KERNEL_OPTIONS} {}", words.join(" ")));
    for (name, folder) in machine.folders {
        // A comma in a value is written twice.
        let path = folder.to_string_lossy().replace(',', ",,");
        qemu.arg("-virtfs").arg(format!("local,path={path},mount_tag={name},security_model=none,readonly=on"));
    }
    qemu.stdin(Stdio::null()).stdout(Stdio::piped());
    qemu
}

/// A line that says how a test or all of them went.
pub fn is_result(line: &str) -> bool {
    line.starts_with("test ") || line.starts_with("GUEST-BEGIN")
}

/// Ends with this program.
struct Guest(Child);

impl Guest {
    fn end(&mut self) {
        // It may have ended by itself.
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

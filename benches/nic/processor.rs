//! Who has used how much of the processors.

use std::fs;
use std::time::Duration;

use rustix::time::{ClockId, clock_gettime};

/// The processor's time of the threads of a process, ns; of those with that name alone, if there is one.
///
/// # Panics
/// There is no such process.
pub fn of_threads(process: u32, name: Option<&str>) -> u64 {
    let threads = fs::read_dir(format!("/proc/{process}/task")).expect("a process");
    let of = |thread: fs::DirEntry| {
        let read = |file| fs::read_to_string(thread.path().join(file));
        let is_meant = name.is_none_or(|name| read("comm").is_ok_and(|comm| comm.trim_end() == name));
        let used = read("schedstat").ok().filter(|_| is_meant)?;
        Some(used.split(' ').next()?.parse::<u64>().expect("a time"))
    };
    threads.flatten().filter_map(of).sum()
}

/// The processor's time of the calling thread, ns.
pub fn of_this_thread() -> u64 {
    Duration::try_from(clock_gettime(ClockId::ThreadCPUTime)).expect("a time").as_nanos() as u64
}

/// Gives the calling thread SCHED_FIFO.
///
/// # Panics
/// It may not.
pub fn with_priority(priority: u8) {
    let parameter = libc::sched_param { sched_priority: priority.into() };
    // SAFETY: the call reads a value that lives until it returns.
    let set = unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const parameter) };
    assert_eq!(set, 0, "{}", std::io::Error::last_os_error());
}

/// What everything but this program and its children uses, from a moment on.
pub struct Others {
    busy: u64,
    all: u64,
    own: u64,
}

impl Others {
    pub fn begin() -> Self {
        let (busy, all) = machine();
        Self { busy, all, own: own() }
    }

    /// How much that was of all processors.
    pub fn percent(&self) -> f64 {
        let now = Self::begin();
        let others = (now.busy - self.busy).saturating_sub(now.own - self.own);
        100.0 * others as f64 / (now.all - self.all).max(1) as f64
    }
}

/// The ticks in which processors were busy, and all ticks.
fn machine() -> (u64, u64) {
    let text = fs::read_to_string("/proc/stat").expect("it is told");
    let ticks: Vec<u64> = numbers(text.lines().next().expect("a line"));
    // user, nice, system, idle, iowait, irq, softirq, steal
    let all: u64 = ticks.iter().take(8).sum();
    (all - ticks[3] - ticks[4], all)
}

/// The ticks of this process and its children that have ended.
fn own() -> u64 {
    let text = fs::read_to_string("/proc/self/stat").expect("it is told");
    let fields = &text[text.rfind(')').expect("a name")..];
    let times: Vec<u64> = fields.split_whitespace().skip(12).take(4).map(|time| time.parse().expect("ticks")).collect();
    times.iter().sum()
}

fn numbers(line: &str) -> Vec<u64> {
    line.split_whitespace().filter_map(|word| word.parse().ok()).collect()
}

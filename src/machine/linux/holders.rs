//! Which processes have the device file of a board open, from `/proc`.

use super::Machine;

/// A process that has a device file of a board open.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Holder {
    /// The process id.
    pub pid: u32,
    /// The name of the process's program; `None` if `/proc` does not show it.
    pub program: Option<String>,
    /// The device file that the process has open.
    pub file: String,
}

/// The processes that have a device file open, as the result of [`Machine::holders`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Holders {
    /// The processes, ordered by process id. A process that has several of the files open has an entry for each.
    pub found: Vec<Holder>,
    /// The number of processes whose open files this user may not see.
    pub hidden: usize,
}

impl Holders {
    /// The processes that have one of `files` open, each as `PID 812 (program)`.
    pub fn of(&self, files: &[String]) -> Vec<String> {
        let mut shown: Vec<String> = Vec::new();
        for holder in self.found.iter().filter(|holder| files.contains(&holder.file)) {
            let text = match &holder.program {
                Some(program) => format!("PID {} ({program})", holder.pid),
                None => format!("PID {}", holder.pid),
            };
            // A process may have several of the files open.
            if !shown.contains(&text) {
                shown.push(text);
            }
        }
        shown
    }
}

impl Machine {
    /// The processes besides this one that have one of `files` open, such as the files of a board.
    pub fn holders(&self, files: &[String]) -> Holders {
        let mut holders = Holders::default();
        if files.is_empty() {
            return holders;
        }
        let mut pids: Vec<u32> = self.names("/proc").iter().filter_map(|name| name.parse().ok()).collect();
        pids.sort_unstable();
        for pid in pids.into_iter().filter(|pid| *pid != std::process::id()) {
            let folder = self.file(&format!("/proc/{pid}/fd"));
            let Ok(entries) = std::fs::read_dir(folder) else {
                // If the folder `/proc/PID/fd` does not exist any more, the process has just ended and does not count
                // as hidden.
                holders.hidden += usize::from(self.has(&format!("/proc/{pid}/fd")));
                continue;
            };
            let mut open: Vec<String> = entries.filter_map(|entry| self.link(&entry.ok()?.path())).collect();
            open.sort();
            open.dedup();
            let ours = open.into_iter().filter(|file| files.contains(file));
            let program = || self.attribute(&format!("/proc/{pid}/comm"));
            holders.found.extend(ours.map(|file| Holder { pid, program: program(), file }));
        }
        holders
    }
}

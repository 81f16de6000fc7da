//! Who has a file open: the open files of all processes, as `/proc` shows them.

use super::Machine;

/// A process that has one of the files open.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Holder {
    /// Its number.
    pub pid: u32,
    /// Its program; `None`: it does not say.
    pub program: Option<String>,
    /// The file.
    pub file: String,
}

/// Who has files open.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Holders {
    /// In the order of their numbers.
    pub found: Vec<Holder>,
    /// Processes that this user may not look into.
    pub hidden: usize,
}

impl Holders {
    /// Those of some of the files, `PID 812 (program)` each.
    pub fn of(&self, files: &[String]) -> Vec<String> {
        let mut shown: Vec<String> = Vec::new();
        for holder in self.found.iter().filter(|holder| files.contains(&holder.file)) {
            let text = match &holder.program {
                Some(program) => format!("PID {} ({program})", holder.pid),
                None => format!("PID {}", holder.pid),
            };
            // By both of its files, or twice.
            if !shown.contains(&text) {
                shown.push(text);
            }
        }
        shown
    }
}

impl Machine {
    /// Who has one of these files open, besides this process.
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
                // A process that has ended meanwhile is not hidden.
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

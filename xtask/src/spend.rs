//! The cost of a verb of `cargo xtask` in disk space and time, which is printed before it begins.

use std::path::Path;
use std::process::Command;

use crate::project::Project;

/// The cost of the first run of a verb. Later runs reuse what was built.
pub struct Spend {
    /// The space on the disk of the target folder, in MB.
    pub disk_mb: u64,
    /// The duration, as text for the user.
    pub time: &'static str,
}

impl Spend {
    /// Prints the cost, and the free disk space if it is too little.
    pub fn announce(&self, project: &Project) {
        println!("{}", self.text(project.relative(&project.target), free_mb(&project.target)));
    }

    fn text(&self, target: &Path, free_mb: Option<u64>) -> String {
        let free =
            free_mb.map_or_else(|| "how much is free is not known".into(), |free| format!("{} are free", size(free)));
        let mut text = format!(
            "takes up to {} in {} ({free}) and {}; what was built before is used again",
            size(self.disk_mb),
            target.display(),
            self.time
        );
        if free_mb.is_some_and(|free| free < self.disk_mb) {
            text += "\nnote: that may not be enough: make room, or set CARGO_TARGET_DIR to a folder on another disk";
        }
        text
    }
}

fn size(mb: u64) -> String {
    if mb < 1000 { format!("{mb} MB") } else { format!("{:.1} GB", mb as f64 / 1000.0) }
}

/// The free space in MB on the disk that contains a folder. The folder need not exist yet.
fn free_mb(folder: &Path) -> Option<u64> {
    let there = folder.ancestors().find(|folder| folder.exists())?;
    let output = Command::new("df").arg("-Pk").arg(there).output().ok()?;
    free_in(&String::from_utf8(output.stdout).ok()?)
}

/// Parses the output of `df -P` (POSIX): the fourth column of the second line, in blocks of 1024 bytes.
fn free_in(df: &str) -> Option<u64> {
    let blocks: u64 = df.lines().nth(1)?.split_whitespace().nth(3)?.parse().ok()?;
    Some(blocks * 1024 / 1_000_000)
}

#[cfg(test)]
mod tests {
    use super::*;

    const DF: &str =
        "Filesystem 1024-blocks Used Available Capacity Mounted on\n/dev/vda 263174212 46913904 48232584 50% /\n";

    /// The cost is printed with the free space, and a disk that is too small with what to do.
    #[test]
    fn what_it_takes_is_named() {
        let spend = Spend { disk_mb: 1400, time: "two minutes" };
        let text = spend.text(Path::new("target"), free_in(DF));
        assert_eq!(
            text,
            "takes up to 1.4 GB in target (49.4 GB are free) and two minutes; what was built before is used again"
        );
        let text = spend.text(Path::new("target"), Some(900));
        assert!(text.contains("(900 MB are free)") && text.contains("\nnote: that may not be enough"), "{text}");
        assert!(text.ends_with("on another disk"), "{text}");
        assert!(spend.text(Path::new("target"), free_in("nonsense")).contains("not known"));
        assert!(free_mb(Path::new("/no/such/folder")).is_some_and(|free| free > 0), "that of the nearest folder");
    }
}

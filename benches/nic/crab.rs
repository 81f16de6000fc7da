//! ethercrab on the same drives: its program is another process.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use super::bench::{MEASURED, PRIORITY};
use super::processor;

pub struct Crab(PathBuf);

impl Crab {
    /// Builds the program.
    pub fn build() -> Result<Self, String> {
        let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/masters/ethercrab/Cargo.toml");
        let target = support::target_dir().join("masters/ethercrab");
        let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
        cargo
            .args(["build", "--release", "--quiet", "--locked", "--manifest-path"])
            .arg(manifest)
            .arg("--target-dir")
            .arg(&target);
        // Without a network in this namespace: what it needs was fetched by the tests.
        cargo.arg("--offline");
        match cargo.status() {
            Ok(ended) if ended.success() => Ok(Self(target.join("release/ethercrab_master"))),
            Ok(ended) => Err(format!(
                "ethercrab's program is not built ({ended}); `cargo fetch` in tests/masters/ethercrab, then again"
            )),
            Err(error) => Err(format!("cargo does not start: {error}")),
        }
    }

    /// The processor's time of a cycle: that of all its threads.
    pub fn processor_ns(&self, interface: &str) -> f64 {
        let mut command = Command::new("chrt");
        command.args(["--fifo", &PRIORITY.to_string()]).arg(&self.0).args([interface, "paced"]);
        let mut child =
            command.stdin(Stdio::null()).stdout(Stdio::piped()).spawn().expect("chrt (util-linux) starts it");
        let used: Vec<(String, u64)> = BufReader::new(child.stdout.take().expect("a pipe"))
            .lines()
            .map(|line| (line.expect("text"), processor::of_threads(child.id(), None)))
            .collect();
        assert!(child.wait().expect("it ends").success(), "{used:?}");
        let at = |word: &str| used.iter().find(|(line, _)| line == word).expect("it says so").1;
        (at("end") - at("begin")) as f64 / MEASURED as f64
    }
}

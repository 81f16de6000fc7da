//! Masters of others on the same drives: their programs are other processes.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use super::bench::{MEASURED, PRIORITY};
use super::processor;

/// SOEM's sources, which `cargo xtask bench` has fetched, in the target folder.
const SOEM: &str = "xtask/pysoem-1.1.13-sources.d/pysoem-1.1.13/soem";

/// A program that says `begin` before the cycles that are measured and `end` behind them.
pub struct Other {
    program: PathBuf,
    arguments: &'static [&'static str],
}

impl Other {
    /// Builds ethercrab's program.
    pub fn ethercrab() -> Result<Self, String> {
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
        build(&mut cargo, "`cargo fetch` in tests/masters/ethercrab, then again")?;
        Ok(Self { program: target.join("release/ethercrab_master"), arguments: &["paced"] })
    }

    /// Builds `soem.c` with SOEM's sources.
    pub fn soem() -> Result<Self, String> {
        let sources = support::target_dir().join(SOEM);
        let program = support::target_dir().join("masters/soem_master");
        std::fs::create_dir_all(program.parent().expect("a folder")).map_err(|error| error.to_string())?;
        let mut shell = Command::new("sh");
        // What their compiler warns of is theirs.
        shell.args([
            "-c",
            "exec cc -O2 -w -DEC_VER2 -o \"$1\" \"$2\" \"$3\"/osal/linux/osal.c \"$3\"/oshw/linux/*.c \"$3\"/soem/*.c \
            -I\"$3\"/soem -I\"$3\"/osal -I\"$3\"/osal/linux -I\"$3\"/oshw/linux -I\"$3\"/oshw -lpthread -lrt",
            "sh",
        ]);
        shell.arg(&program).arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/nic/soem.c")).arg(&sources);
        build(&mut shell, "run `cargo xtask bench nic`, which fetches SOEM")?;
        Ok(Self { program, arguments: &[] })
    }

    /// The processor's time of a cycle: that of all its threads.
    pub fn processor_ns(&self, interface: &str) -> f64 {
        let mut command = Command::new("chrt");
        command.args(["--fifo", &PRIORITY.to_string()]).arg(&self.program).arg(interface).args(self.arguments);
        let mut child =
            command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("chrt (util-linux) starts it");
        let used: Vec<(String, u64)> = BufReader::new(child.stdout.take().expect("a pipe"))
            .lines()
            .map(|line| line.expect("text"))
            .map(|line| {
                let used = (line, processor::of_threads(child.id(), None));
                if used.0 == "end" {
                    // It may end now.
                    drop(child.stdin.take());
                }
                used
            })
            .collect();
        assert!(child.wait().expect("it ends").success(), "{used:?}");
        let at = |word: &str| used.iter().find(|(line, _)| line == word).expect("it says so").1;
        (at("end") - at("begin")) as f64 / MEASURED as f64
    }
}

fn build(command: &mut Command, next: &str) -> Result<(), String> {
    match command.status() {
        Ok(ended) if ended.success() => Ok(()),
        Ok(ended) => Err(format!("its program is not built ({ended}); {next}")),
        Err(error) => Err(format!("{} does not start: {error}", command.get_program().to_string_lossy())),
    }
}

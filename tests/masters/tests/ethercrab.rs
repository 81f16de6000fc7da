//! ethercrab, a master as a crate, on simulated slaves. Its program is `tests/masters/ethercrab`, outside the workspace.
#![cfg(target_os = "linux")]

mod needs_network_namespace {
    use std::path::{Path, PathBuf};
    use std::process::Command;

    use masters::{MASTER, Rig};

    /// Builds the program; its file.
    fn program() -> PathBuf {
        let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join("ethercrab/Cargo.toml");
        let target = support::target_dir().join("masters/ethercrab");
        let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
        cargo.args(["build", "--locked", "--manifest-path"]).arg(manifest).arg("--target-dir").arg(&target);
        // Flags for this test's own build (coverage, a linker) are none of the program's.
        support::succeed(cargo.env_remove("RUSTFLAGS").env_remove("CARGO_ENCODED_RUSTFLAGS"));
        target.join("debug/ethercrab_master")
    }

    /// ECAT-15.14 Two drives with ethercrab: scan, EEPROM, SDOs, aborts, OP with distributed clocks, and a path in CSP.
    #[test]
    fn ethercrab_moves_two_drives_with_distributed_clocks() {
        let program = program();
        let rig = Rig::new("drive*2", "ethercrab");
        assert_eq!(support::succeed(Command::new(program).arg(MASTER)), "all as it has to be\n", "{:?}", rig.said());
        let said = rig.end();
        assert!(said.iter().any(|line| line.starts_with("slave") && line.ends_with("in OP")), "{said:?}");
    }
}

//! pysoem, which is SOEM in a Python wheel, on simulated slaves. What a program of this folder checks is in it; each begins with a
//! network of its own.
#![cfg(target_os = "linux")]

mod needs_pysoem {
    use std::path::Path;

    use masters::Rig;

    fn run(list: &str, program: &str) -> Vec<String> {
        let rig = Rig::new(list, program);
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/pysoem");
        rig.python(&folder.join(format!("{program}.py")));
        rig.end()
    }

    /// ECAT-15.4 Two drives and distributed clocks: scan, EEPROM, identity, mapping, OP; each working counter is the expected one.
    #[test]
    fn two_drives_reach_op_with_distributed_clocks() {
        let said = run("drive*2", "start");
        for line in ["a master is there on veth1", "slaves 1 to 2 are in PreOP", "slaves 1 to 2 are in OP"] {
            assert!(said.iter().any(|said| said == line), "no `{line}`: {said:?}");
        }
        assert!(said.last().is_some_and(|line| line.ends_with("were answered, 0 were lost")), "{said:?}");
    }
}

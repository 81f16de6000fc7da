//! The machine file on a network card: one program runs in units, and parameters come back to a drive.

mod needs_network_namespace {
    use std::fs;

    use masters::Rig;

    use crate::card::{CARD, Ran, ended, file, look, run, tool};

    const MACHINE: &str = "format = 1\nlink = \"nic:veth0?priority=20\"\n\n[axes]\n\
        X = { slave = 1, unit = \"mm\", per = 0.001, min = -10, max = 250, max_velocity = 100, homing = { method = 35, offset = 2.5 } }\n\
        turn = { slave = 2, unit = \"deg\", per = \"-360/131072\", min = -90, max = 90 }\n\n\
        [slaves.3]\nkind = \"io\"\n";

    /// The program that `tool/tests/tool/machine_file.rs` runs on the other links, with the same ends.
    const PROGRAM: &str = "state op\nservo on X,turn\nhome X\nmove X=12.5 turn=-45deg --velocity 40\n\
        move X=-1000counts --relative\nmove 1=5000\nexpect position X=5 turn=-45 --within 0.003 --wait 2s\n\
        expect position 1=5000 2=16384 --within 2\nservo off all\n";

    /// The machine file of the other links, with its own link, runs the same program on a card; its recording is in units.
    #[test]
    fn the_machine_file_runs_its_program_on_a_card() {
        let _rig = Rig::new("drive*2,io", "tool_machine");
        let folder = file("machine_on_card");
        fs::create_dir_all(&folder).expect("a folder");
        fs::write(folder.join("machine.toml"), MACHINE).expect("a file");
        fs::write(folder.join("program"), PROGRAM).expect("a file");
        let here = |words: &[&str]| -> Ran { ended(tool(words).current_dir(&folder)) };
        let out = here(&["run", "program", "--record", "run.pcapng", "--overwrite"]).good();
        for line in
            ["axis X: at 12.5 mm (12500 counts)\n", "axis turn: at -45 deg (16384 counts)\n", "axis X: at 5 mm ("]
        {
            assert!(out.contains(line), "{out}");
        }
        let out = here(&["summary", "run.pcapng"]).good();
        assert!(out.contains("axis X: ") && out.contains(" mm (") && out.contains("axis turn: "), "{out}");
        let found = here(&["find", "position(X) > 12mm", "run.pcapng"]).good();
        assert_eq!(found.lines().count(), 1, "{found}");
    }

    /// What was kept of a stepper on a cable is put back, and it has the same parameters then.
    #[test]
    fn parameters_come_back_over_the_cable() {
        let _rig = Rig::new("dp3cl,drive", "tool_params");
        let [first, second] = ["first.params", "second.params"].map(|name| file(name).display().to_string());
        let params = |words: &[&str]| run(&[&["params"], words, &["--link", CARD]].concat());
        let backup = |to: &str| params(&["backup", "1", "--output", to, "--overwrite"]).good();
        let said = backup(&first);
        assert!(said.contains(": 404 parameters in "), "{said}");
        look(&["sdo", "write", "1", "0x6099:1", "4321"]).good();
        let diff = params(&["diff", &first, "1"]);
        assert!(diff.code == Some(1) && diff.out.starts_with("0x6099:1 ") && diff.out.lines().count() == 1, "{diff:?}");
        let restored = params(&["restore", &first, "1", "--yes"]).good();
        assert!(restored.contains("4321 -> "), "{restored}");
        assert_eq!(params(&["diff", &first, "1"]).good(), "");
        backup(&second);
        let objects = |file: &str| -> Vec<String> {
            let text = fs::read_to_string(file).expect("it is written");
            text.lines().filter(|line| !line.starts_with('#')).map(str::to_owned).collect()
        };
        assert_eq!(objects(&first), objects(&second));
    }
}

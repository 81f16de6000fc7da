//! Example programs, as they are, on a network card: they print what they print on a simulated board.

mod needs_network_namespace {
    use std::process::Command;

    use masters::Rig;
    use support::Program;

    const LINK: &str = "nic:veth0?priority=20";

    /// What a program of these prints must be that of a snapshot, which a simulated board has made.
    fn prints(list: &str, name: &str, snapshot: &str, command: &mut Command) {
        let _rig = Rig::new(list, name);
        support::snapshot(snapshot, &support::run(command).success());
    }

    mod needs_python {
        use super::*;

        /// NIC-1.7 Programs in Python.
        #[test]
        fn python_programs_run_on_a_network_card() {
            for (program, list, snapshot) in [("two_axes", "drive*2", "two_axes_12b"), ("homing", "drive*2", "homing")]
            {
                let mut python = Command::new("python3");
                python.arg(support::root().join("examples/python").join(program).with_extension("py"));
                // No compiled files beside the examples.
                python.env("PYTHONDONTWRITEBYTECODE", "1").env("ECMSK_LIBRARY", &support::library().shared);
                python.env("ECMSK_LINK", LINK).env_remove("ECMSK_LOG").current_dir(support::root());
                let name = format!("nic_python_{program}");
                std::thread::scope(|scope| scope.spawn(|| prints(list, &name, snapshot, &mut python)).join())
                    .expect("no panic");
            }
        }
    }

    mod needs_cxx {
        use super::*;

        /// NIC-1.7 Programs in C++, compiled with the headers and the library alone.
        #[test]
        fn cpp_programs_run_on_a_network_card() {
            for program in ["two_axes_12b", "homing", "habit_read_after_open"] {
                let exe = support::out_dir().join(format!("nic_{program}"));
                let mut compiler = Command::new("g++");
                compiler.arg(support::root().join("examples/cpp").join(program).with_extension("cpp"));
                compiler.args(["-std=c++17", "-O1", "-pthread", "-o"]).arg(&exe).arg("-I").arg(support::include_dir());
                compiler.arg("-L").arg(&support::library().dir).arg("-lNEXTWUSBLib");
                support::succeed(&mut compiler);
                let mut command = Program { exe }.command(LINK);
                let name = format!("nic_cpp_{program}");
                std::thread::scope(|scope| scope.spawn(|| prints("drive*2", &name, program, &mut command)).join())
                    .expect("no panic");
            }
        }
    }
}

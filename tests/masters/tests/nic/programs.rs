//! Example programs, as they are, on a network card: they print what they print on a simulated board.

mod needs_network_namespace {
    use std::process::Command;

    use masters::Rig;
    use support::examples::VIRTUAL;
    use support::{Ended, Program, root};

    /// Programs that print other numbers on a network card, and why: language, program, the reason.
    const OTHER_NUMBERS: [(&str, &str, &str); 10] = [
        ("c", "csv_cst", WHERE),
        ("c", "io", LATER),
        ("cpp", "habit_sdo_retry", REPORTS),
        ("cpp", "habit_set_axis_burst", REPORTS),
        ("cpp", "habit_tight_writer", "as many commands are lost in a full FIFO as the real clock lets through"),
        ("cpp", "hsp_16b", WHERE),
        ("python", "inputs_outputs", LATER),
        ("rust", "csv_cst", WHERE),
        ("rust", "hsp", WHERE),
        ("rust", "io", LATER),
    ];
    const REPORTS: &str = "it says how many reports something took, which real frames need more or less of";
    const WHERE: &str = "it says where an axis was when a report came, which is by the real clock";
    const LATER: &str =
        "inputs that follow outputs come a frame later: a frame takes those that lie in the module when it passes";

    /// What a program prints on a simulated board it prints on slaves at the end of a network card, with the same keys of the
    /// board; the words alone, if it is in the table.
    fn prints_the_same(language: &str, name: &str, link: &str, run: impl Fn(&str) -> Ended + Sync) {
        let board = run(link).success();
        let (slaves, keys) = slaves_and_keys(link);
        let card = format!("nic:veth0?priority=20{keys}");
        let recording = format!("nic_{language}_{name}");
        // Each program has a network of its own, which is that of a thread.
        let on_card = || {
            let _rig = Rig::new(slaves, &recording);
            run(&card).success()
        };
        let printed = std::thread::scope(|scope| scope.spawn(on_card).join().expect("no panic"));
        match OTHER_NUMBERS.iter().find(|(of, program, _)| (*of, *program) == (language, name)) {
            None => assert_eq!(printed, board, "{language}, {name}"),
            Some((.., why)) => assert_eq!(words(&printed), words(&board), "{language}, {name} ({why})"),
        }
    }

    /// What was printed, with one sign for each number.
    fn words(printed: &str) -> String {
        let is_in_number = |letter: char| letter.is_ascii_hexdigit() || matches!(letter, 'x' | '-' | '.');
        let word = |word: &str| {
            let bare = word.trim_end_matches([',', ';', ':']);
            let is_number = bare.starts_with(|first: char| first.is_ascii_digit() || first == '-');
            if is_number && bare.chars().all(is_in_number) { word.replace(bare, "#") } else { word.to_owned() }
        };
        printed.lines().map(|line| line.split_whitespace().map(word).collect::<Vec<_>>().join(" ") + "\n").collect()
    }

    /// The list of slaves of a link, and its keys that are those of the board, as the end of another link.
    fn slaves_and_keys(link: &str) -> (&str, String) {
        let keys = link.strip_prefix("sim:?").expect("a simulated board").split('&');
        let slaves = keys.clone().find_map(|key| key.strip_prefix("slaves=")).expect("slaves");
        let kept = keys.filter(|key| key.starts_with("slot=")).map(|key| format!("&{key}"));
        (slaves, kept.collect())
    }

    /// NIC-1.7 Programs in Rust.
    #[test]
    fn rust_programs_run_on_a_network_card() {
        for (name, link) in [
            ("two_axes", VIRTUAL),
            ("homing", VIRTUAL),
            ("csv_cst", VIRTUAL),
            ("move_axis", "sim:?slaves=drive&clock=virtual"),
            ("hsp", "sim:?slaves=hsp2&slot=16&clock=virtual"),
            ("io", "sim:?slaves=io&clock=virtual"),
        ] {
            let mut cargo = support::cargo();
            cargo.args(["build", "--quiet", "--example", name, "--target-dir"]).arg(support::target_dir());
            support::succeed(cargo.args(["--manifest-path"]).arg(root().join("Cargo.toml")));
            let exe = support::target_dir().join("debug/examples").join(name);
            prints_the_same("rust", name, link, |link| {
                support::run(Command::new(&exe).arg(link).env_remove("ECMSK_LOG").current_dir(root()))
            });
        }
    }

    mod needs_python {
        use super::*;
        use support::examples::{PYTHON, run_python};

        /// NIC-1.7 Programs in Python.
        #[test]
        fn python_programs_run_on_a_network_card() {
            for (name, link) in PYTHON {
                prints_the_same("python", name, link, |link| run_python(name, link));
            }
        }
    }

    mod needs_cxx {
        use super::*;
        use support::Language;
        use support::examples::{C, CPP, SCRIPTS};

        /// NIC-1.7 Programs in C++ and C, compiled with the headers and the library alone.
        #[test]
        fn programs_in_cpp_and_c_run_on_a_network_card() {
            let of = |folder, standard| move |(name, link)| (name, link, folder, standard);
            let cpp = CPP.into_iter().map(of("cpp", Language::Cpp("c++17")));
            let all = cpp.chain(C.into_iter().map(of("c", Language::C("c99"))));
            // An alarm of a script has its time on the board's clock.
            let has_alarm = |name| SCRIPTS.iter().any(|(with, script)| *with == name && script.starts_with("alarm"));
            for (name, link, folder, language) in all.filter(|(name, ..)| !has_alarm(*name)) {
                let source = root().join("examples").join(folder).join(name).with_extension(folder);
                let Program { exe } = support::compile(&source, language);
                prints_the_same(folder, name, link, |link| Program { exe: exe.clone() }.run(link, [""; 0]));
            }
        }
    }

    mod needs_mono {
        use super::*;
        use support::dotnet::{EXAMPLES, VIRTUAL, example};

        /// NIC-1.7 Programs in C#, under Mono.
        #[test]
        fn programs_in_csharp_run_on_a_network_card() {
            for (name, _, keys) in EXAMPLES.into_iter().filter(|(.., keys)| !keys.contains("script=")) {
                prints_the_same("csharp", name, &format!("{VIRTUAL}{keys}"), |link| {
                    support::run(&mut example(name).under("mono", &[], link))
                });
            }
        }
    }
}

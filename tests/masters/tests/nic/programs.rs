//! Unchanged example programs on a network card: they print the same as on a simulated board.

mod needs_network_namespace {
    use std::fs;
    use std::io::{BufRead, BufReader};
    use std::process::{Command, Stdio};
    use std::time::Duration;

    use masters::Rig;
    use support::examples::VIRTUAL;
    use support::{Ended, Program, out_dir, root};

    /// Programs that print other numbers on a network card: language, program, a word of the lines with these numbers, and why.
    const OTHER_NUMBERS: [(&str, &str, &str, &str); 15] = [
        ("c", "csv_cst", "", WHERE),
        ("c", "io", "outputs off", LATER),
        ("cpp", "alarm_recovery", "stopped at", ALARM),
        ("cpp", "habit_sdo_retry", "", REPORTS),
        ("cpp", "habit_set_axis_burst", "", REPORTS),
        ("cpp", "habit_tight_writer", "", "as many commands are lost in a full FIFO as the real clock lets through"),
        ("cpp", "hsp_16b", "", WHERE),
        ("cpp", "operator_panel", "", WHERE),
        ("csharp", "OperatorPanel", "", WHERE),
        ("python", "inputs_outputs", "outputs off", LATER),
        ("rust", "alarm_recovery", "stopped at", ALARM),
        ("rust", "csv_cst", "", WHERE),
        ("rust", "hsp", "", WHERE),
        ("rust", "io", "outputs off", LATER),
        ("rust", "operator_panel", "", WHERE),
    ];
    const REPORTS: &str = "it says how many reports something took, which real frames need more or less of";
    const WHERE: &str = "it says where an axis was when a report came, which is by the real clock";
    const LATER: &str =
        "inputs that follow outputs come a frame later: a frame takes those that lie in the module when it passes";
    const ALARM: &str = "it says where an alarm has stopped the axes, and the alarm comes by the real clock";

    /// An alarm in a program's motion. On a simulated board it comes at that time. For slaves on a card, whose time is
    /// not the board's, it comes at the same point of the program: that time after it has printed a line, or after OP
    /// if it prints none before.
    struct Alarm {
        simulated_ms: u64,
        /// The beginning of the line; "": OP.
        after: &'static str,
        ms: u64,
        what: &'static str,
    }

    const fn alarm(simulated_ms: u64, after: &'static str, ms: u64, what: &'static str) -> Alarm {
        Alarm { simulated_ms, after, ms, what }
    }

    /// The most repetitions if the machine is late for its slaves, or its alarm comes late.
    const TRIES: usize = 5;

    const NONE: &[Alarm] = &[];
    const ONE: &str = "alarm 1 0x7500";
    const TWO: &str = "alarm 2 0x7500";
    const STAYS: &str = "alarm 1 0x7305 stays";
    /// While both axes of an operator's panel jog.
    const JOGGING: Alarm = alarm(1000, "  24  jog +, axis 2", 140, ONE);

    /// Checks that a program prints the same on slaves at the end of a network card as on a simulated board, with the
    /// same keys of the board; only the words if it is in the table. Its exit code is the same, too.
    fn prints_the_same(language: &str, name: &str, link: &str, alarms: &[Alarm], of: impl Fn(&str) -> Command + Sync) {
        let may_fail = alarms.iter().any(|alarm| alarm.what == STAYS);
        let recording = format!("nic_{language}_{name}{}", if may_fail { "_stays" } else { "" });
        let board = if alarms.is_empty() {
            support::run(&mut of(link))
        } else {
            let script = out_dir().join(format!("{recording}_simulated.ecmscript"));
            let line = |Alarm { simulated_ms, what, .. }: &Alarm| format!("at {simulated_ms}ms {what}\n");
            fs::write(&script, alarms.iter().map(line).collect::<String>()).expect("a file in the target folder");
            support::run(&mut of(&format!("{link}&script={}", script.display())))
        };
        let (slaves, keys) = slaves_and_keys(link);
        let card = format!("nic:veth0?priority=20{keys}");
        // Each program has a network of its own, which is that of a thread.
        let on_card = || {
            let (from_op, behind_lines): (Vec<&Alarm>, Vec<&Alarm>) =
                alarms.iter().partition(|alarm| alarm.after.is_empty());
            let line = |alarm: &Alarm| format!("from op\nat {}ms {}\n", alarm.ms, alarm.what);
            let script: String = from_op.into_iter().map(line).collect();
            let rig = Rig::with_script(slaves, &recording, &script);
            let ended = run(&rig, &mut of(&card), &behind_lines);
            // Slaves that have missed their outputs for too long are reported.
            (ended, rig.end().iter().any(|line| line.contains("AL status 0x001B")))
        };
        let on_card = || std::thread::scope(|scope| scope.spawn(on_card).join().expect("no panic"));
        assert!(board.status.success() || may_fail, "{language}, {name}: {board:?}");
        let other = OTHER_NUMBERS.iter().find(|(of, program, ..)| (*of, *program) == (language, name));
        // A program that fails prints the reason.
        let said = |ended: &Ended| {
            let said = without_underruns(&ended.stdout) + if may_fail { &ended.stderr } else { "" };
            (ended.status.code(), other.map_or_else(|| said.clone(), |(.., of, _)| words(&said, of)))
        };
        for tries_left in (0..TRIES).rev() {
            let (card, is_late) = on_card();
            if said(&card) == said(&board) {
                let code_of = |alarm: &Alarm| alarm.what.split(' ').nth(2).expect("a code");
                let all = card.stdout.clone() + &card.stderr;
                assert!(alarms.iter().all(|alarm| all.contains(code_of(alarm))), "{language}, {name}: {card:?}");
                return;
            }
            let may_differ = tries_left > 0 && (is_late || !alarms.is_empty());
            assert!(may_differ, "{language}, {name} ({other:?})\n{:?}\n{:?}", said(&card), said(&board));
        }
    }

    /// Runs a program; alarms come behind its lines, one after the other.
    fn run(rig: &Rig, program: &mut Command, alarms: &[&Alarm]) -> Ended {
        if alarms.is_empty() {
            return support::run(program);
        }
        program.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = program.spawn().expect("the program starts");
        let lines = BufReader::new(child.stdout.take().expect("a pipe")).lines();
        let (mut stdout, mut alarms) = (String::new(), alarms.iter().peekable());
        for line in lines.map(|line| line.expect("text")) {
            if let Some(alarm) = alarms.next_if(|alarm| line.starts_with(alarm.after)) {
                std::thread::sleep(Duration::from_millis(alarm.ms));
                rig.happen(alarm.what);
            }
            stdout += &(line + "\n");
        }
        let ended = child.wait_with_output().expect("it ends");
        Ended { status: ended.status, stdout, stderr: String::from_utf8_lossy(&ended.stderr).into_owned() }
    }

    /// What was printed, without the numbers of cycles that found the FIFO empty: they depend on the lateness of the
    /// program itself on a busy machine.
    fn without_underruns(printed: &str) -> String {
        let line = |line: &str| {
            let words: Vec<&str> = line.split(' ').collect();
            let is_number = |n: usize| {
                words.get(n + 1).is_some_and(|next| *next == "underruns,") || n > 0 && words[n - 1] == "underruns:"
            };
            (0..words.len()).map(|n| if is_number(n) { "#" } else { words[n] }).collect::<Vec<_>>().join(" ") + "\n"
        };
        printed.lines().map(line).collect()
    }

    /// The output, with a sign for each number in lines with that word. If the word matches any line, codes stay.
    fn words(printed: &str, of: &str) -> String {
        let word = |word: &str| {
            let bare = word.trim_start_matches('[').trim_end_matches([',', ';', ':', ']']);
            let is_number = bare.starts_with(|first: char| first.is_ascii_digit() || first == '-')
                && bare.chars().all(|letter| letter.is_ascii_digit() || matches!(letter, '-' | '.'));
            let is_code = bare.starts_with("0x") && !of.is_empty();
            if is_number || is_code { word.replace(bare, "#") } else { word.to_owned() }
        };
        let line = |line: &str| match line.contains(of) {
            true => line.split_whitespace().map(word).collect::<Vec<_>>().join(" "),
            false => line.to_owned(),
        };
        printed.lines().map(|printed| line(printed) + "\n").collect()
    }

    /// The list of slaves of a link, and its board keys, as the end of another link.
    fn slaves_and_keys(link: &str) -> (&str, String) {
        let keys = link.strip_prefix("sim:?").expect("a simulated board").split('&');
        let slaves = keys.clone().find_map(|key| key.strip_prefix("slaves=")).expect("slaves");
        let kept = keys.filter(|key| key.starts_with("slot=")).map(|key| format!("&{key}"));
        (slaves, kept.collect())
    }

    /// Programs in Rust.
    #[test]
    fn rust_programs_run_on_a_network_card() {
        // Each event at the middle of a side of the square.
        const ON_THE_WAY: [Alarm; 2] =
            [alarm(3200, "corner [1000000, 0]", 450, TWO), alarm(4900, "corner [1000000, 1000000]", 450, STAYS)];
        for (name, link, alarms) in [
            ("two_axes", VIRTUAL, NONE),
            ("homing", VIRTUAL, NONE),
            ("csv_cst", VIRTUAL, NONE),
            ("move_axis", "sim:?slaves=drive&clock=virtual", NONE),
            ("hsp", "sim:?slaves=hsp2&slot=16&clock=virtual", NONE),
            ("io", "sim:?slaves=io&clock=virtual", NONE),
            ("alarm_recovery", VIRTUAL, &ON_THE_WAY[..1]),
            ("alarm_recovery", VIRTUAL, &ON_THE_WAY),
            ("operator_panel", VIRTUAL, &[alarm(1000, "On: at", 450, ONE)]),
        ] {
            prints_the_same("rust", name, link, alarms, |link| {
                let mut program = support::example(name);
                program.arg(link).env_remove("ECMSK_LOG").current_dir(root());
                program
            });
        }
    }

    mod needs_python {
        use super::*;
        use support::examples::{PYTHON, python};

        /// Programs in Python.
        #[test]
        fn python_programs_run_on_a_network_card() {
            for (name, link) in PYTHON {
                prints_the_same("python", name, link, NONE, |link| python(name, link));
            }
        }
    }

    mod needs_cxx {
        use super::*;
        use support::Language;
        use support::examples::{C, CPP, SCRIPTS};

        /// Checks the output of a program that is compiled only with the headers and the library.
        fn same(folder: &str, name: &str, language: Language, link: &str, alarms: &[Alarm]) {
            let file = if folder == "c" { format!("c/{name}.c") } else { format!("{folder}/{name}.cpp") };
            let Program { exe } = support::compile(&root().join("examples").join(file), language);
            let of = if folder == "c" { "c" } else { "cpp" };
            prints_the_same(of, name, link, alarms, |link| {
                // Its lines come one by one, as to a terminal.
                Program { exe: exe.clone() }.under("stdbuf", &["-oL"], link)
            });
        }

        /// Programs in C++ and C, compiled only with the headers and the library.
        #[test]
        fn programs_in_cpp_and_c_run_on_a_network_card() {
            for (name, link) in without_alarms().step_by(2) {
                same("cpp", name, Language::Cpp("c++17"), link, NONE);
            }
            for (name, link) in C {
                same("c", name, Language::C("c99"), link, NONE);
            }
        }

        /// The other half of those in C++.
        #[test]
        fn further_programs_in_cpp_run_on_a_card() {
            for (name, link) in without_alarms().skip(1).step_by(2) {
                same("cpp", name, Language::Cpp("c++17"), link, NONE);
            }
        }

        /// Programs without an alarm; those with one have their own test.
        fn without_alarms() -> impl Iterator<Item = (&'static str, &'static str)> {
            let has_alarm = |name| SCRIPTS.iter().any(|(with, script)| *with == name && script.starts_with("alarm"));
            CPP.into_iter().filter(move |(name, _)| !has_alarm(*name))
        }

        /// Programs in C++ that clear alarms on their way, and one that an alarm ends.
        #[test]
        fn programs_in_cpp_overcome_alarms_on_a_network_card() {
            // Each event at the middle of a side of the square.
            let on_the_way =
                [alarm(2750, "corner 2 of the square", 250, TWO), alarm(3650, "corner 3 of the square", 250, STAYS)];
            for (folder, name, alarms) in [
                ("cpp", "alarm_recovery", &on_the_way[..1]),
                ("cpp", "alarm_recovery", &on_the_way),
                ("cpp", "operator_panel", &[JOGGING]),
                ("guide", "07_alarm", &[alarm(1500, "", 1100, ONE)]),
            ] {
                same(folder, name, Language::Cpp("c++17"), VIRTUAL, alarms);
            }
        }
    }

    mod needs_mono {
        use super::*;
        use support::dotnet::{EXAMPLES, VIRTUAL, example};

        /// Programs in C#, under Mono, one of them with an alarm on its way.
        #[test]
        fn programs_in_csharp_run_on_a_network_card() {
            for (name, _, keys) in EXAMPLES {
                // The script of examples/scripts/ has the same alarm.
                let (keys, alarms) = match keys.split_once("&script=") {
                    Some((keys, _)) => (keys, &[JOGGING][..]),
                    None => (keys, NONE),
                };
                prints_the_same("csharp", name, &format!("{VIRTUAL}{keys}"), alarms, |link| {
                    example(name).under("mono", &[], link)
                });
            }
        }
    }
}

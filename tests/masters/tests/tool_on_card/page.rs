//! docs/DEAD-BOARD.md: its commands at the drives' cable, on simulated slaves at the other end of a virtual one.

mod needs_network_namespace {
    use std::collections::BTreeSet;
    use std::fs;
    use std::io::{BufRead, BufReader};
    use std::os::unix::fs::PermissionsExt;
    use std::process::{Command, Stdio};

    use masters::{MASTER, Rig};

    use crate::card::{LIST, file, run, tool};

    /// The page's name of the drives' port.
    const PORT: &str = "eth1";

    /// The tool's arguments in each command of the page at that port: in its blocks of `sh`, and between back ticks.
    fn commands(page: &str) -> BTreeSet<String> {
        let lines = page.lines().map(str::trim).filter(|line| !line.starts_with("$ "));
        let texts = page.replace('\n', " ");
        let quoted = texts.split('`').map(|text| text.split_whitespace().collect::<Vec<_>>().join(" "));
        let all = lines.map(str::to_owned).chain(quoted);
        let arguments = all.filter_map(|command| command.strip_prefix("sudo ecmsk ").map(str::to_owned));
        arguments.filter(|arguments| arguments.contains(PORT) && !arguments.contains('`')).collect()
    }

    /// Each command that looks at the drives ends well, and the scan finds all. `doctor` may find the machine wanting.
    #[test]
    fn the_commands_of_the_page_find_the_drives() {
        let _rig = Rig::new(LIST, "tool_page");
        // The server and its clients are in this network.
        support::succeed(Command::new("ip").args(["link", "set", "lo", "up"]));
        let page = fs::read_to_string(support::root().join("docs/DEAD-BOARD.md")).expect("the page");
        let commands = commands(&page);
        let secret = file("page.secret");
        fs::write(&secret, "a secret of the page that nobody guesses, 0123456789").expect("a file");
        fs::set_permissions(&secret, fs::Permissions::from_mode(0o600)).expect("its mode");
        let folder = file("drives");
        let _ = fs::remove_dir_all(&folder);
        let mut verbs = BTreeSet::new();
        for command in &commands {
            // Nobody moves the cables.
            let command = command.replace(PORT, MASTER).replace("--watch 60", "--watch 2").replace('\'', "");
            let command = command.replace("/etc/ecmsk.secret", &secret.display().to_string());
            let command = command.replace("192.168.77.1:4711", "127.0.0.1:0");
            let words: Vec<&str> = command.split(' ').collect();
            verbs.insert(words[..2].join(" "));
            match words[0] {
                "serve" => serves(&words, &secret.display().to_string()),
                "doctor" => assert!(run(&words).out.contains(&format!("round-trip {MASTER}")), "{command}"),
                _ => {
                    let out = run(&words).good();
                    assert!(words[1] != "scan" || out.matches("vendor 0x").count() == 3, "{out}");
                }
            }
        }
        let expected = ["bus dc", "bus errors", "bus scan", "doctor --link", "params backup", "serve tcp"];
        assert_eq!(verbs.iter().map(String::as_str).collect::<Vec<_>>(), expected, "{commands:?}");
    }

    /// The server of the drives tells a client with the secret that they are there, and refuses one without.
    fn serves(words: &[&str], secret: &str) {
        let mut server = tool(words).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().expect("it starts");
        let mut line = String::new();
        BufReader::new(server.stdout.as_mut().expect("a pipe")).read_line(&mut line).expect("it says something");
        let address = line.strip_prefix("listening on ").and_then(|line| line.split(',').next()).unwrap_or_default();
        let link = format!("tcp://{address}?secret_file={secret}");
        let (shown, refused) =
            (run(&["info", "--scan", "--link", &link]), run(&["info", "--link", &format!("tcp://{address}")]));
        // Before anything is asserted, so that a failure leaves no server behind.
        server.kill().expect("it runs");
        server.wait().expect("it ends");
        let shown = shown.good();
        assert!(shown.contains("found       3 slaves"), "{shown}");
        refused.fails(1, &["its server wants a secret"]);
    }
}

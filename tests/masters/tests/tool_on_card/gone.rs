//! A card that is pulled while the tool works with it.

mod needs_network_namespace {
    use std::io::{BufRead, BufReader};
    use std::process::{Child, Command};
    use std::time::{Duration, Instant};

    use ecmsk::link::{LinkError, Share, Wait, open};
    use ecmsk::sk::Frame;
    use masters::{Elsewhere, MASTER, Rig, SECOND_MASTER};

    use crate::card::{CARD, ends, started, tool, until};

    const GONE: [&str; 2] = ["the network card veth0 was pulled, or deleted: plug in what was pulled", "ip link"];

    /// Waits until it has opened the card.
    fn until_opened(child: &mut Child) {
        let shown = support::succeed(Command::new("ip").args(["-o", "link", "show", MASTER]));
        let index = shown.split(':').next().expect("its number");
        let is_open = || {
            let sockets =
                std::fs::read_to_string("/proc/thread-self/net/packet").expect("the sockets of this namespace");
            sockets.lines().any(|line| line.split_whitespace().nth(4) == Some(index))
        };
        while !is_open() {
            assert!(child.try_wait().expect("it is ours").is_none(), "it has ended");
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// A move, a running `bus` verb, the live table and a program under `exec`: each ends, and reports which card is
    /// gone and what to do.
    #[test]
    fn each_verb_ends_and_says_so() {
        let _rig = Rig::new("drive*2", "tool_gone");
        let elsewhere = Elsewhere::new();
        let line = [
            "move",
            "1=9000000",
            "--velocity",
            "100000",
            "--up",
            "--slaves",
            "drive*2",
            "--link",
            "nic:veth0?priority=20",
        ];
        let mut child = started(&mut tool(&line));
        let mut err = BufReader::new(child.stderr.take().expect("a pipe"));
        until(&mut err, "progress: moving");
        elsewhere.take(MASTER);
        ends(child, err).fails(1, &GONE);

        let looks: [&[&str]; 2] = [
            &["monitor", "--json", "--slaves", "drive*2", "--link", CARD],
            &["bus", "errors", "--watch", "60", "--link", CARD],
        ];
        for words in looks {
            elsewhere.give_back(MASTER);
            let mut child = started(&mut tool(words));
            let err = BufReader::new(child.stderr.take().expect("a pipe"));
            let mut out = BufReader::new(child.stdout.take().expect("a pipe"));
            std::thread::spawn(move || std::io::copy(&mut out, &mut std::io::sink()));
            until_opened(&mut child);
            elsewhere.take(MASTER);
            let ran = ends(child, err);
            assert_eq!(ran.code, Some(1), "{ran:?}");
            assert!(GONE.iter().all(|part| ran.err.contains(part)), "{ran:?}");
        }
        elsewhere.give_back(MASTER);

        let program = support::root().join("tests/c/until_lost.c");
        let program = support::compile(&program, support::Language::C("c99"));
        let library = support::library().shared.display().to_string();
        let program = program.exe.display().to_string();
        let words = ["exec", "--library", &library, "--link", CARD, "--", &program];
        let mut child = started(&mut tool(&words));
        let err = BufReader::new(child.stderr.take().expect("a pipe"));
        let mut out = BufReader::new(child.stdout.take().expect("a pipe"));
        until(&mut out, "running");
        elsewhere.take(MASTER);
        let ran = ends(child, err);
        assert_eq!(ran.code, Some(0), "{ran:?}");
        assert!(GONE.iter().all(|part| ran.err.contains(part)), "{ran:?}");
    }

    /// A server reports the loss of the board to its clients, and serves it again when the card is back.
    #[test]
    fn a_server_serves_again_when_the_card_is_back() {
        let _rig = Rig::new("drive*2", "tool_gone_served");
        let elsewhere = Elsewhere::new();
        support::succeed(Command::new("ip").args(["link", "set", "lo", "up"]));
        let mut server = started(&mut tool(&["serve", "tcp", "--listen", "127.0.0.1:0", "--link", CARD]));
        let mut out = BufReader::new(server.stdout.take().expect("a pipe"));
        let mut line = String::new();
        out.read_line(&mut line).expect("text");
        let address = line.strip_prefix("listening on ").and_then(|line| line.split([';', '\n']).next());
        let uri = format!("tcp://{}", address.unwrap_or_else(|| panic!("{line}")));
        let link = open(&uri, Share::ByName).expect("it is served");
        let mut report = Frame::new();
        link.read(&mut report, Wait::For(Duration::from_secs(60))).expect("a report");
        elsewhere.take(MASTER);
        let failed = loop {
            if let Err(failed) = link.read(&mut report, Wait::For(Duration::from_secs(60))) {
                break failed;
            }
        };
        assert!(matches!(failed, LinkError::Lost { .. }), "{failed}");
        let said = failed.to_string();
        assert!(said.contains("veth0"), "{said}");
        link.close();
        elsewhere.give_back(MASTER);
        let began = Instant::now();
        while open(&uri, Share::ByName)
            .and_then(|link| link.read(&mut report, Wait::For(Duration::from_secs(1))))
            .is_err()
        {
            assert!(began.elapsed() < Duration::from_secs(60), "it is not served again");
            std::thread::sleep(Duration::from_millis(50));
        }
        server.kill().expect("it is ours");
        server.wait().expect("it is ours");
    }

    /// In a ring the tool says which card is gone, and that the motion goes on by the other one.
    #[test]
    fn one_card_of_a_ring_is_told() {
        let _rig = Rig::ring("drive*2", "tool_gone_ring");
        let elsewhere = Elsewhere::new();
        let link = format!("nic:{MASTER}?second={SECOND_MASTER}&priority=20");
        let words = ["move", "1=250000", "--velocity", "100000", "--up", "--slaves", "drive*2", "--link", &link];
        let mut child = started(tool(&words).env("ECMSK_LOG", "warn"));
        let mut err = BufReader::new(child.stderr.take().expect("a pipe"));
        until(&mut err, "progress: moving");
        elsewhere.take(SECOND_MASTER);
        // A machine that is busy may be late, and then loses slaves.
        let ran = ends(child, err);
        let told = format!("the network card {SECOND_MASTER} was pulled, or deleted");
        assert_eq!(ran.err.matches(&told).count(), 1, "{ran:?}");
        assert!(ran.err.contains(&format!("The ring goes on by {MASTER}")), "{ran:?}");
        assert!(!ran.err.contains("is gone"), "the board is there: {ran:?}");
    }
}

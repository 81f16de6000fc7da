//! `ecmsk fault`, `--control`, and the step `fault` of scripts: events on a simulated board that runs.
#![cfg(target_os = "linux")]

use std::io::{BufRead, BufReader};
use std::process::Stdio;
use std::sync::atomic::{AtomicBool, Ordering};

use ecmsk::link::{self, Share};

use crate::common::board::script;
use crate::common::exec::ExecFolder;
use crate::common::serving::Serving;
use crate::common::{Ran, ecmsk, run};

/// The tool's output for an event on a board on the real clock, in words and as JSON; a wrong event has the words of the
/// parser of scripts.
#[test]
fn an_event_happens_and_says_when() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("board").display().to_string();
    let board = link::open(&format!("sim:?slaves=drive*2&control={path}"), Share::ByName).expect("a board");
    let out = run(["fault", &path, "alarm 2 0x7500"]).expect_quiet();
    let words = out.strip_prefix("cycle ").and_then(|rest| rest.strip_suffix(" s: alarm 2 0x7500\n"));
    let (cycle, seconds) = words.and_then(|words| words.split_once(", ")).expect(&out);
    let (cycle, seconds): (u64, f64) = (cycle.parse().expect(&out), seconds.parse().expect(&out));
    assert!((seconds - (cycle + 1) as f64 / 1000.0).abs() < 0.002, "a cycle has 1 ms: {out}");
    let json = run(["fault", "--json", &path, "cut", "2", "for", "500ms"]).json();
    assert_eq!((&json["verb"], &json["event"]), (&"fault".into(), &"cut 2 for 500ms".into()));
    assert!(json["cycle"].as_u64() > Some(cycle), "{json}");
    run(["fault", &path, "alarm 3 0x7500"]).expect_failure(
        1,
        &["column 7: `3` is no slave of this network; allowed: a number from 1 to 2"],
        "ecmsk link help",
    );
    board.close();
    run(["fault", &path, "heal"]).expect_failure(1, &["no board `", "` is running"], "in its link");
    run(["fault", "a b", "heal"]).expect_failure(1, &["`a b` is no name of a board"], "the path of a socket");
    run(["fault", &path]).expect_misuse(&["<EVENT>..."]);
}

/// Who names a board that is not there is shown those that are; `--wait` waits for one.
#[test]
fn boards_that_run_are_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let fault = |words: &[&str]| {
        let mut command = ecmsk(["fault"]);
        command.args(words).env("XDG_RUNTIME_DIR", folder.path());
        Ran::from(command.output().expect("the tool starts"))
    };
    let said = fault(&["press", "heal"]);
    said.expect_failure(
        1,
        &["no board `press` is running, and no other; start it with --control press"],
        "in its link",
    );
    let path = folder.path().join("ecmsk/mill.control");
    let open = || {
        let uri = format!("sim:?slaves=drive*2&control={}", path.display());
        link::open(&uri, Share::ByName).expect("a board")
    };
    let board = open();
    assert!(fault(&["press", "heal"]).err.contains("no board `press` is running, but mill; "));
    fault(&["mill", "heal"]).expect_code(0);
    board.close();
    let is_opened = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let waits = scope.spawn(|| {
            let ran = fault(&["--wait", "60s", "mill", "heal"]);
            assert!(is_opened.load(Ordering::SeqCst), "it waited: {ran:?}");
            ran
        });
        is_opened.store(true, Ordering::SeqCst);
        let board = open();
        waits.join().expect("it ends").expect_code(0);
        board.close();
    });
}

/// `exec --control` is the key `control=` of the link; what is not simulated is refused before the program starts.
#[test]
fn control_is_part_of_the_link() {
    let place = ExecFolder::new();
    let out =
        place.run(&["--link", "sim:?clock=virtual", "--control", "./press"], "echo \"$ECMSK_LINK\"").expect_quiet();
    assert_eq!(out, "sim:?clock=virtual&control=./press\n");
    for (link, next) in [("usb:", "--link 'sim:?slaves=drive*2'"), ("tcp://localhost", "`ecmsk serve tcp`")] {
        let ran = place.run(&["--link", link, "--control", "press"], "echo started");
        assert_eq!((ran.code, &*ran.out), (Some(2), ""), "{}", ran.err);
        assert!(
            ran.err.contains("--control is for simulated boards, sim: and xf-sim:") && ran.err.contains(next),
            "{}",
            ran.err
        );
    }
    let ran = place.run(&["--link", "sim:?control=a", "--control", "./b"], "echo started");
    ran.expect_failure(2, &["`control` is given twice"], "ecmsk link help");
    let ran = run(["serve", "tcp", "--link", "usb:", "--control", "press"]);
    assert_eq!(ran.code, Some(2), "{}", ran.err);
    let ran = run(["serve", "usbip", "--link", "sim:", "--control", "./a", "--control", "./b"]);
    ran.expect_failure(2, &["--control is given 2 times for 1 board(s)"], "once for each --link");
}

/// A fault of a script happens between two steps, in virtual time at the same cycle in every run; what is expected of it is
/// seen, and what is not, is said.
#[test]
fn a_script_makes_faults_happen() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name).display().to_string();
    let board = format!("sim:?slaves=drive*2,io&clock=virtual&control={}", at("board"));
    let steps = "\
state op
servo on 1,2
expect alarm 1=none 2=none
fault alarm 2 0x7500
expect alarm 2=0x7500 --wait 10ms
expect alarm 2=any 1=none
expect sdo 2 error_code 0x7500
expect sdo 1 mode 8
expect velocity 1=0
expect torque 1=0 --within 5
expect counter reports_lost=0 commands_rejected=0
expect time --at-most 10s --at-least 1ms
servo clear 2
fault io 3 inputs 0x00F0 for 50ms
expect inputs 3=0x00F0 --wait 20ms
expect inputs 3=0 --wait 100ms
";
    let runs: [Vec<u8>; 2] = [0, 1].map(|number| {
        let file = at(&format!("run-{number}.pcapng"));
        script(&format!("{board}&record={file}"), steps).expect_code(0);
        std::fs::read(file).expect("a recording")
    });
    assert_eq!(runs[0].len(), runs[1].len(), "both runs have as many frames");
    for (steps, says) in [
        ("state op\nexpect alarm 2=0x7500", ":2: expect: axis 2 has no alarm, not 0x7500; "),
        (
            "state op\nfault alarm 1 0x7500\nexpect alarm 1=none",
            ":3: expect: axis 1 has alarm 0x7500: communication, not none; ",
        ),
        (
            "fault alarm 9 0x7500",
            ":1: fault: column 7: `9` is no slave of this network; allowed: a number from 1 to 3; ",
        ),
        ("expect sdo 1 mode 9", ":1: expect: mode (0x6060:0) of slave 1 is 8, not 9; "),
        (
            "state op\nexpect velocity 1=100 --within 1 --wait 5ms",
            ":2: expect: axis 1 is moving with 0, not moving with 100 within 1; ",
        ),
        ("state op\nexpect torque 1=50 --within 1", ":2: expect: axis 1 has a torque of 0 %, not 50 % within 1; "),
        ("expect counter reports_lost=3", ":1: expect: reports_lost is 0, not 3; "),
        ("wait 1s\nexpect time --at-most 500ms", " s have passed since the board was opened, not at most 0.5 s; "),
    ] {
        let ran = script(&board, steps);
        ran.expect_code(1);
        assert!(ran.err.contains(says), "{steps}: {}", ran.err);
    }
    let ran = script("sim:?slaves=drive&clock=virtual", "fault heal");
    assert!(ran.err.contains("has no control socket; write control=NAME into its link"), "{}", ran.err);
    let wrong = script(&board, "expect alarm 1=x\nexpect torque 1\nexpect counter jerk=1\nexpect time\nfault\n");
    assert_eq!((wrong.code, wrong.err.lines().count()), (Some(1), 5), "{}", wrong.err);
}

/// The results of steps as JUnit: a case for each step up to the first that failed, in the board's time.
#[test]
fn the_results_of_steps_are_written() {
    let folder = tempfile::tempdir().expect("a folder");
    let (file, steps) = (folder.path().join("steps.xml"), folder.path().join("steps.ecm"));
    let board = "sim:?slaves=drive&clock=virtual";
    let cases = |text: &str| {
        std::fs::write(&steps, text).expect("a file");
        let ran = run(["run", "--link", board, "--junit", file.to_str().unwrap(), steps.to_str().unwrap()]);
        let text = std::fs::read_to_string(&file).unwrap_or_else(|error| panic!("{error}: {}", ran.err));
        let document = roxmltree::Document::parse(&text).expect(&text);
        let cases = document.descendants().filter(|node| node.has_tag_name("testcase"));
        let of = |case: roxmltree::Node<'_, '_>| {
            let failure = case.first_element_child().and_then(|failure| failure.attribute("message"));
            let attribute = |name| case.attribute(name).expect("an attribute").to_owned();
            (attribute("name"), attribute("time"), failure.map(ToOwned::to_owned))
        };
        (ran.code, cases.map(of).collect::<Vec<_>>())
    };
    let (code, done) = cases("wait 250ms # so long\n\nexpect state op\nwait 1s\n");
    let [waited, expected] = &done[..] else { panic!("{done:?}") };
    assert_eq!((code, &*waited.0, &*waited.1, &waited.2), (Some(1), "line 1: wait 250ms", "0.250", &None));
    assert_eq!((&*expected.0, &*expected.1), ("line 3: expect state op", "0.000"));
    assert!(expected.2.as_ref().is_some_and(|why| why.starts_with("expect: the network is in PreOP")), "{expected:?}");
    let (code, done) = cases("stat op\n");
    assert_eq!((code, done.len(), &*done[0].0), (Some(1), 1, "the whole run"));
    assert!(done[0].2.as_ref().is_some_and(|why| why.contains("`stat` is unknown")), "{done:?}");
    let ran = run(["run", "--link", board, "--junit", "/no/such/folder/x.xml", steps.to_str().unwrap()]);
    assert!(ran.err.contains("cannot write /no/such/folder/x.xml"), "{}", ran.err);
}

/// Results are not written over a file of another kind, which is said before an axis moves.
#[test]
fn results_replace_nothing_else() {
    let folder = tempfile::tempdir().expect("a folder");
    let [machine, steps, record] = ["m.toml", "steps.ecm", "run.ecmrec"].map(|name| folder.path().join(name));
    std::fs::write(&machine, "format = 1\n").expect("a file");
    std::fs::write(&steps, "state op\nservo on all\nmove 1=1000\n").expect("a file");
    let [junit, steps, file] = [&machine, &steps, &record].map(|path| path.to_str().expect("UTF-8"));
    let link = "sim:?slaves=drive&clock=virtual";
    let ran = run(["run", "--link", link, "--record", file, "--junit", junit, steps]);
    ran.expect_failure(1, &["m.toml is there already and is no JUnit file"], "another file with --junit, or remove it");
    assert!(!record.exists() && std::fs::read_to_string(&machine).expect("a file") == "format = 1\n");
}

/// A board that `serve tcp` has gets faults by its name, between the steps of a client.
#[test]
fn serve_tcp_lets_faults_happen() {
    let folder = tempfile::tempdir().expect("a folder");
    let control = folder.path().join("board").display().to_string();
    let server = Serving::start("tcp", &["--link", "sim:?slaves=drive*2", "--control", &control]);
    let steps = format!(
        "state op\nservo on 1,2\nfault --control {control} alarm 2 0x7500\nexpect alarm 2=0x7500 1=none --wait 10s\n"
    );
    script(&server.link(), &steps).expect_code(0);
}

/// A server without a free file descriptor does not spin at its control socket, and takes events when it has one again.
#[test]
fn a_control_socket_without_a_descriptor_does_not_spin() {
    use rustix::process::{Pid, Resource, Rlimit, prlimit};
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("board").display().to_string();
    let words = ["serve", "tcp", "--listen", "127.0.0.1:0", "--link", "sim:?slaves=drive", "--control", &path];
    let mut server = ecmsk(words).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().expect("the tool starts");
    let mut line = String::new();
    BufReader::new(server.stdout.take().expect("a pipe")).read_line(&mut line).expect("it says where it listens");
    let id = Pid::from_child(&server);
    // Descriptors that are open stay so.
    let maximum = rustix::process::getrlimit(Resource::Nofile).maximum;
    let before = prlimit(Some(id), Resource::Nofile, Rlimit { current: Some(3), maximum });
    let client = std::os::unix::net::UnixStream::connect(&path).expect("it listens");
    std::thread::sleep(std::time::Duration::from_millis(500));
    let ticks = ticks_of(server.id(), "ecmsk-control");
    drop(client);
    prlimit(Some(id), Resource::Nofile, before.expect("a limit")).expect("the old limit");
    let ran = run(["fault", &path, "alarm 1 0x7500"]);
    let _ = server.kill();
    let _ = server.wait();
    assert!(ticks < 5, "{ticks} ticks of 10 ms in 500 ms");
    assert_eq!(ran.code, Some(0), "{ran:?}");
}

/// The processor time that the thread of a process with this name has had, in ticks.
fn ticks_of(process: u32, name: &str) -> u64 {
    let threads =
        std::fs::read_dir(format!("/proc/{process}/task")).expect("it runs").flatten().map(|task| task.path());
    let read = |path: &std::path::Path, file: &str| std::fs::read_to_string(path.join(file)).unwrap_or_default();
    let thread = threads.into_iter().find(|thread| read(thread, "comm").trim() == name).expect("the thread");
    let stat = read(&thread, "stat");
    let fields: Vec<_> = stat.rsplit(") ").next().expect("fields").split(' ').collect();
    [11, 12].map(|field| fields[field].parse::<u64>().expect("ticks")).iter().sum()
}

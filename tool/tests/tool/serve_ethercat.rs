//! `ecmsk serve ethercat`: its errors, its output, and a master at the other end of a pair of interfaces.
#![cfg(target_os = "linux")]

use crate::common::{Ran, ecmsk};

fn run(arguments: &[&str]) -> Ran {
    ecmsk([&["serve", "ethercat"][..], arguments].concat()).output().expect("the tool starts").into()
}

/// A wrong list of slaves is a wrong command line; an empty list, a script for a board, and an interface that is
/// missing or no Ethernet are failures with the next step.
#[test]
fn what_serve_ethercat_refuses() {
    let wrong = run(&["--on", "lo", "--slaves", "drive*2,lathe"]);
    assert_eq!(wrong.code, Some(2), "{wrong:?}");
    assert!(wrong.err.contains("kind `lathe` is unknown") && wrong.err.contains("dp3cl"), "{wrong:?}");
    for (list, says) in [
        ("", "no slave is to be served; name some"),
        ("drive*254,io", "at most 254 slaves"),
        ("dp3cl*2:limits@-1..1", "dp3cl:limits@-1..1*2"),
    ] {
        let wrong = run(&["--on", "lo", "--slaves", list]);
        assert_eq!(wrong.code, Some(2), "{wrong:?}");
        assert!(wrong.err.contains(says) && !wrong.err.contains("slot="), "{wrong:?}");
    }
    let folder = tempfile::tempdir().expect("a folder");
    let script = folder.path().join("a.ecmscript");
    std::fs::write(&script, "at 1s cut 2\nat 2s silent for 20ms\n").expect("it is written");
    let script = script.to_str().expect("UTF-8");
    for (arguments, parts) in [
        (&["--on", "lo", "--slaves", "none"][..], &["no slave is to be served", "--slaves"][..]),
        (
            &["--on", "lo", "--slaves", "drive*2", "--script", script],
            &["line 2: `silent` happens to a board", "take the line out"],
        ),
        (
            &["--on", "lo", "--slaves", "drive", "--script", "nofile"],
            &["cannot read the script nofile", "name another file"],
        ),
        (&["--on", "lo", "--second", "lo", "--slaves", "drive"], &["lo is the interface at both ends", "--second"]),
        (&["--on", "lo", "--slaves", "drive"], &["lo is no Ethernet", "name another one"]),
        (
            &["--on", "veth-none", "--slaves", "drive"],
            &["no network interface veth-none; there are", "lo", "docs/SLAVES.md"],
        ),
    ] {
        let refused = run(arguments);
        assert_eq!((refused.code, refused.out.as_str()), (Some(1), ""), "{refused:?}");
        assert!(parts.iter().all(|part| refused.err.contains(part)), "{refused:?}");
    }
}

/// docs/SLAVES.md has the whole program of the example, so that a reader of the page alone can run it.
#[test]
fn the_page_has_the_master_of_the_example() {
    let read = |file| std::fs::read_to_string(support::root().join(file)).expect("a file");
    let program = format!("```python\n{}```\n", read("examples/python/own_master.py"));
    assert!(read("docs/SLAVES.md").ends_with(&program));
}

/// A shell script that makes a pair of virtual interfaces (veth0, veth1), then runs the command that its arguments are.
const IN_NAMESPACE: &str =
    "ip link add veth0 type veth peer name veth1 && ip link set veth0 up && ip link set veth1 up && exec \"$@\"";

/// Tests that run in a network namespace of their own.
mod needs_network_namespace {
    use std::io::{BufRead, BufReader, Read};
    use std::process::{Command, Stdio};

    use super::IN_NAMESPACE;
    use crate::common::{Ran, ecmsk};

    fn inside(server: u32, words: &[&str]) -> Command {
        let mut command = Command::new("nsenter");
        command.arg(format!("--net=/proc/{server}/ns/net")).args(words);
        command
    }

    /// ECAT-15.21 A second server on an interface is refused, and so is this project's master. ECAT-15.23 A server
    /// whose interface is deleted ends with exit code 1 and says so. The recording has Ethernet frames, and verbs for
    /// recordings of boards say so.
    #[test]
    fn an_interface_has_one_server_which_ends_with_it() {
        let recording = support::out_dir().join("served_alone.pcapng");
        let _ = std::fs::remove_file(&recording);
        let tool = ecmsk([] as [&str; 0]);
        let mut server = Command::new("unshare");
        server.args(["--net", "sh", "-c", IN_NAMESPACE, "sh"]).arg(tool.get_program());
        server.args(["serve", "ethercat", "--on", "veth1", "--slaves", "io", "--record"]).arg(&recording);
        let mut server = server.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("unshare");
        let mut line = String::new();
        BufReader::new(server.stdout.as_mut().expect("a pipe")).read_line(&mut line).expect("it says what it serves");
        let mut second = inside(server.id(), &[]);
        second.arg(tool.get_program()).args(["serve", "ethercat", "--on", "veth1", "--slaves", "io"]);
        let second: Ran = second.output().expect("nsenter").into();
        assert_eq!((second.code, second.out.as_str()), (Some(1), ""), "{second:?}");
        assert!(second.err.contains("veth1 is used by another program of ecmsk"), "{second:?}");
        let mut link = inside(server.id(), &[]);
        link.arg(tool.get_program()).args(["info", "--link", "nic:veth1"]);
        let link: Ran = link.output().expect("nsenter").into();
        assert!(link.code == Some(1) && link.err.contains("by another program of ecmsk"), "{link:?}");

        support::succeed(&mut inside(server.id(), &["ip", "link", "del", "veth0"]));
        let mut said = String::new();
        server.stderr.take().expect("a pipe").read_to_string(&mut said).expect("text");
        assert_eq!(server.wait().expect("it ends").code(), Some(1), "{said}");
        let last = said.lines().last().expect("a line");
        assert!(
            last.starts_with("error: the network interface veth1 is gone") && last.contains("start the server"),
            "{said}"
        );
        let dumped: Ran = ecmsk(["dump", recording.to_str().expect("UTF-8")]).output().expect("the tool starts").into();
        assert_eq!(dumped.code, Some(1), "{dumped:?}");
        assert!(dumped.err.contains("`ecmsk serve ethercat`") && dumped.err.contains("Wireshark"), "{dumped:?}");
    }
}

/// Tests with the master pysoem, in a network namespace of their own.
mod needs_pysoem {
    use std::io::{BufRead, BufReader, Read};
    use std::process::{Command, Stdio};

    use rustix::process::{Pid, Signal, kill_process};

    use super::IN_NAMESPACE;
    use crate::common::ecmsk;

    /// Standard output lists what is served, standard error the events of slaves; a signal ends the server, and the
    /// recording is whole then. examples/python/own_master.py moves two DP3CL.
    #[test]
    fn a_master_of_40_lines_moves_two_dp3cl() {
        let recording = support::out_dir().join("own_master.pcapng");
        let _ = std::fs::remove_file(&recording);
        let tool = ecmsk([] as [&str; 0]);
        let mut server = Command::new("unshare");
        server.args(["--net", "sh", "-c", IN_NAMESPACE, "sh"]).arg(tool.get_program());
        server.args(["serve", "ethercat", "--on", "veth1", "--slaves", "dp3cl*2", "--priority", "10", "--record"]);
        let mut server = server.arg(&recording).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("unshare");
        let mut line = String::new();
        BufReader::new(server.stdout.as_mut().expect("a pipe")).read_line(&mut line).expect("it says what it serves");
        assert_eq!(line, "answering EtherCAT on veth1; serving dp3cl*2\n");
        let mut master = Command::new("nsenter");
        master.arg(format!("--net=/proc/{}/ns/net", server.id())).arg("python3");
        master.arg(support::root().join("examples/python/own_master.py")).arg("veth0");
        master.env("PYTHONPATH", support::target_dir().join("xtask/pysoem-1.1.13.d"));
        let printed = support::succeed(&mut master);
        let last = printed.lines().last().expect("a line");
        let positions = last.split("positions ").nth(1).expect("positions").split(' ');
        let positions: Vec<i32> = positions.map(|position| position.parse().expect("a number")).collect();
        assert!(
            positions.len() == 2 && positions.iter().all(|position| (4_900..=5_000).contains(position)),
            "{printed}"
        );
        kill_process(Pid::from_child(&server), Signal::TERM).expect("it runs");
        let mut said = String::new();
        server.stderr.take().expect("a pipe").read_to_string(&mut said).expect("text");
        assert_eq!(server.wait().expect("it ends").code(), Some(0), "{said}");
        for line in ["a master is there on veth1", "in OP", "stopped by SIGTERM"] {
            assert!(said.lines().any(|said| said.contains("Z serve: ") && said.ends_with(line)), "no `{line}`: {said}");
        }
        assert!(!said.contains("alarm"), "{said}");
        let recorded = std::fs::read(&recording).expect("the recording");
        assert!(
            recorded.len() > 100_000 && recorded.starts_with(&[0x0A, 0x0D, 0x0D, 0x0A]),
            "{} bytes",
            recorded.len()
        );
    }

    /// Without the right to raw frames the error names the missing capability, and how to get it.
    #[test]
    fn the_capability_is_asked_for_by_name() {
        let tool = ecmsk([] as [&str; 0]);
        let mut server = Command::new("unshare");
        server.args(["--net", "sh", "-c", IN_NAMESPACE, "sh", "setpriv", "--bounding-set", "-net_raw"]);
        server.arg(tool.get_program()).args(["serve", "ethercat", "--on", "veth1", "--slaves", "drive"]);
        let ended = server.output().expect("unshare");
        let said = String::from_utf8_lossy(&ended.stderr);
        assert_eq!((ended.status.code(), ended.stdout.as_slice()), (Some(1), &b""[..]), "{said}");
        let step = format!("sudo setcap cap_net_raw+ep {}", tool.get_program().display());
        assert!(said.contains("CAP_NET_RAW") && said.contains(&step) && said.contains("sudo"), "{said}");
    }
}

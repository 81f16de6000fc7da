//! `ecmsk serve xf`: its output, its errors, its end, and a host in C.
#![cfg(target_os = "linux")]

use std::io::{Read, Write};
use std::net::TcpStream;

use crate::common::serving::Serving;
use crate::common::{Ran, ecmsk, without_times};
use rustix::process::Signal;

/// The port of a server.
fn port(serving: &Serving) -> &str {
    serving.address().strip_prefix("127.0.0.1:").expect("this machine")
}

fn run(arguments: &[&str]) -> Ran {
    ecmsk([&["serve", "xf"][..], arguments].concat()).output().expect("the tool starts").into()
}

/// XF-14.11 Standard output has the address and what is served, standard error the hosts that come and go; the server
/// ends in order.
#[test]
fn serve_xf_says_what_it_serves_and_who_comes() {
    for (signal, name) in [(Signal::INT, "SIGINT"), (Signal::TERM, "SIGTERM")] {
        let serving = Serving::start("xf", &["--link", "xf-sim:?int0=yes"]);
        let port = port(&serving);
        let expected = format!("127.0.0.1:{port}; serving xf-sim:?int0=yes (real clock, with INT0)\n");
        assert_eq!(serving.first_line, expected);
        let mut host = TcpStream::connect(format!("127.0.0.1:{port}")).expect("it listens");
        let from = host.local_addr().expect("it is connected");
        let mut greeting = [0; 12];
        host.read_exact(&mut greeting).expect("a greeting");
        host.write_all(&[5, 0, 0, 0]).expect("a close");
        assert_eq!(host.read_to_end(&mut Vec::new()).expect("the end"), 4);
        let said = without_times(&serving.end_by(signal));
        let mut said: Vec<&str> = said.lines().collect();
        // The server may notice the signal before it has reported that the host has closed. So the order of the lines is not
        // compared.
        said.sort_unstable();
        let expected = [&format!("{from} has closed"), &format!("{from} has the chip"), &format!("stopped by {name}")];
        assert_eq!(said, expected.map(|line| format!("serve: {line}")));
    }
}

/// XF-14.10, XF-14.11 Impossible options are refused with the next step. An address that other machines reach is
/// refused with exit code 2, unless an option allows everybody there to use the chip; then there is a warning.
#[test]
fn what_serve_xf_refuses() {
    let link = ["--link", "xf-sim:"];
    let refused = run(&[&link[..], &["--listen", "0.0.0.0:0"]].concat());
    assert_eq!((refused.code, refused.out.as_str()), (Some(2), ""), "{refused:?}");
    for part in ["no password", "127.0.0.1", "ssh -N -L", "docs/XF-PORT.md", "--insecure-anyone"] {
        assert!(refused.err.contains(part), "no {part}: {refused:?}");
    }
    run(&["--link", "sim:"]).expect_failure(1, &["is a board and not an ECM-XF"], "ecmsk link help");
    run(&[]).expect_failure(2, &["no --link"], "--link");
    let nowhere = run(&[&link[..], &["--listen", "here"]].concat());
    assert!(nowhere.code == Some(2) && nowhere.err.contains("nor unix:PATH"), "{nowhere:?}");
    let elsewhere = run(&[&link[..], &["--listen", "192.0.2.1:4712", "--insecure-anyone"]].concat());
    assert_eq!(elsewhere.code, Some(1), "{elsewhere:?}");
    assert!(elsewhere.err.contains(" note: anybody who reaches 192.0.2.1:4712"), "{elsewhere:?}");
    assert!(elsewhere.err.contains("; name an address of this machine with `--listen`"), "{elsewhere:?}");
}

mod needs_cxx {
    use super::*;
    use std::process::Command;

    /// A firmware in C on the static library of `examples/firmware` starts a served chip and counts its slaves. Its
    /// header is C99, and C++.
    #[test]
    fn a_firmware_in_c() {
        let folder = tempfile::tempdir().expect("a folder");
        let [example, program] = [support::root().join("examples/firmware"), folder.path().join("firmware")];
        let mut cc = support::Language::C("c99").compiler();
        support::succeed(cc.arg(example.join("main.c")).arg(support::firmware()).arg("-o").arg(&program));
        let mut cxx = support::Language::Cpp("c++11").compiler();
        support::succeed(cxx.args(["-fsyntax-only", "-x", "c++"]).arg(example.join("controller.h")));

        let serving = Serving::start("xf", &["--link", "xf-sim:?slaves=drive*3"]);
        assert_eq!(support::succeed(Command::new(&program).arg(port(&serving))), "3 slaves\n");
        serving.end();
        let refused = support::run(Command::new(&program).arg("1"));
        assert_eq!(refused.status.code(), Some(1), "{}", refused.stdout);
        assert!(refused.stderr.contains("nobody serves a chip there"), "{}", refused.stderr);
    }

    /// XF-14.12 The host in C of the examples compiles as C99 without a warning and finds n and the firmware of either chip.
    #[test]
    fn a_host_in_c() {
        let folder = tempfile::tempdir().expect("a folder");
        let program = folder.path().join("xf_client");
        let source = support::root().join("examples/c/xf_client.c");
        support::succeed(support::Language::C("c99").compiler().arg(source).arg("-o").arg(&program));
        for (firmware, printed) in [("new", "n 1024, firmware 0x22\n"), ("old", "n 112, firmware 0x0E\n")] {
            let link = format!("xf-sim:?chip_fw={firmware}&clock=virtual");
            let serving = Serving::start("xf", &["--link", &link]);
            // A second host opens the chip after the first one has closed it.
            for _ in 0..2 {
                assert_eq!(support::succeed(Command::new(&program).arg(port(&serving))), printed);
            }
            serving.end();
        }
    }
}

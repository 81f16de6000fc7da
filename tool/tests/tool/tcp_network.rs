//! Clients know the slaves and units that the server knows; and the sources of both sides' secret.
#![cfg(unix)]

use crate::common::serving::Serving;
use crate::common::{ecmsk, run};
use ecmsk::ecm::{Axis, Close, Config, Ecm, Slave};
use ecmsk::link::{self, KnownNetwork, Share};
use ecmsk::port::tcp::{ServeOptions, Server};
use serde_json::Value;
use support::tcp::{Puppet, connect, options, serve, serve_link, uri};

fn known(slaves: &str, counts_per_unit: &str) -> Option<KnownNetwork> {
    Some(KnownNetwork { slaves: slaves.to_owned(), counts_per_unit: counts_per_unit.to_owned() })
}

/// The clients of a server get its list of slaves: that of a simulated board, or that which a client has configured, with
/// modes; the list of the server's options comes before both. A server of a server passes the list on. For an unknown board the
/// list is empty.
#[test]
fn clients_know_what_the_server_knows() {
    let (server, _) = serve("sim:?slaves=drive*2,io");
    let writer = connect(&server, "");
    assert_eq!(writer.network(), known("drive*2,io", ""));
    writer.close();
    let ecm = Ecm::open(&uri(&server, "")).unwrap();
    let slaves = vec![Slave::Drive(Axis::CSP), Slave::Drive(Axis::CSV), Slave::Io];
    ecm.configure(&Config { slaves, ..Config::default() }).unwrap();
    assert_eq!(connect(&server, "role=reader").network(), known("drive,drive:csv,io", ""));
    let again = uri(&server, "role=reader&reconnect_ms=1000");
    let second = Server::start(move || link::open(&again, Share::ByName), options().0).unwrap();
    assert_eq!(connect(&second, "role=reader&fault.drop=0.5").network(), known("drive,drive:csv,io", ""));
    ecm.close(Close::Leave).unwrap();

    assert_eq!(connect(&serve_link(Puppet::new(), options().0), "").network(), None);
    let network = known("drive*40", "1=5000,2=131072/360").unwrap();
    let told = serve_link(Puppet::new(), ServeOptions { network: network.clone(), ..options().0 });
    assert_eq!(connect(&told, "").network(), Some(network));
    let network = known(&"drive,io,".repeat(40), "7").unwrap();
    let long = serve_link(Puppet::new(), ServeOptions { network, ..options().0 });
    assert_eq!(connect(&long, "").network(), known("", "7"), "half a list would be another one");
}

/// The environment variable with the secret that a server and its clients share.
const SECRET: &str = "ECMSK_TCP_SECRET";

/// The tool shows kinds over the network without options, and moves in the server's units.
#[test]
fn the_tool_shows_kinds_and_units() {
    let serving = Serving::start("tcp", &["--link", "sim:?slaves=drive*2,io", "--counts-per-unit", "1=1000"]);
    let link = &*serving.link();
    let info: Value = serde_json::from_str(&run(["info", "--json", "--link", link]).expect_quiet()).unwrap();
    assert_eq!(info["network"], "1 drive, 2 drive, 3 io");
    let seen: Value =
        serde_json::from_str(&run(["monitor", "--once", "--json", "--link", link]).expect_quiet()).unwrap();
    let kinds: Vec<_> = (1..=3).map(|slot| (&seen["slots"][slot]["kind"], &seen["slots"][slot]["kind_is"])).collect();
    assert!(kinds.iter().zip(["drive", "drive", "io"]).all(|((kind, _), expected)| **kind == expected), "{kinds:?}");
    assert_eq!(run(["move", "1=2.5", "2=30", "--up", "--link", link]).code, Some(0));
    let moved: Value = serde_json::from_str(&run(["info", "--json", "--link", link]).expect_quiet()).unwrap();
    let at = |slave: usize| moved["slaves"][slave]["position_counts"].as_i64().unwrap();
    assert!((at(0) - 2500).abs() < 64 && (at(1) - 30).abs() < 64, "{moved}");
}

/// `serve` takes the board of ECMSK_LINK where no --link is given, on TCP and on USB/IP; without any it serves nothing.
#[test]
fn the_board_of_the_environment_is_served() {
    for port in ["tcp", "usbip"] {
        let mut command = ecmsk(["serve", port, "--listen", "127.0.0.1:0"]);
        command.env("ECMSK_LINK", "sim:?slaves=drive,io").env_remove(SECRET);
        let serving = Serving::by(command);
        if port == "tcp" {
            assert_eq!(link::open(&serving.link(), Share::ByName).unwrap().network(), known("drive,io", ""));
        }
        run(["serve", port, "--listen", "127.0.0.1:0"]).expect_misuse(&["--link", "ECMSK_LINK"]);
        let wrong = ecmsk(["serve", port]).env("ECMSK_LINK", "whale:").output().unwrap();
        assert!(String::from_utf8_lossy(&wrong.stderr).contains("whale"), "{wrong:?}");
    }
}

/// A secret in a file wins over the variable, at both ends. The variable stays readable in the process for its user, as
/// its help and `ecmsk link help` say; the file's secret does not.
#[cfg(target_os = "linux")]
#[test]
fn the_secret_of_a_file_counts_more_than_that_of_the_variable() {
    use std::os::unix::fs::PermissionsExt as _;

    let [secret, other] = ["0123456789abcdef0123456789abcdef", "fedcba9876543210fedcba9876543210"];
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("secret");
    std::fs::write(&file, secret).unwrap();
    std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o600)).unwrap();
    let serve = |variable: &str, from_file: bool| {
        let mut command = ecmsk(["serve", "tcp", "--listen", "127.0.0.1:0", "--link", "sim:?slaves=drive"]);
        if from_file {
            command.arg("--secret-file").arg(&file);
        }
        command.env(SECRET, variable);
        Serving::by(command)
    };
    let shows = |link: &str, variable: &str| {
        let output = ecmsk(["info", "--link", link]).env(SECRET, variable).output().unwrap();
        output.status.success()
    };
    let environment = |serving: &Serving| {
        let bytes = std::fs::read(format!("/proc/{}/environ", serving.child.id())).unwrap();
        String::from_utf8_lossy(&bytes).into_owned()
    };
    let by_file = serve(other, true);
    let with_file = format!("{}?secret_file={}", by_file.link(), file.display());
    assert!(shows(&with_file, other) && shows(&by_file.link(), secret));
    assert!(!shows(&by_file.link(), other));
    assert!(!environment(&by_file).contains(secret));
    let by_variable = serve(secret, false);
    assert!(shows(&by_variable.link(), secret) && !shows(&by_variable.link(), other));
    assert!(environment(&by_variable).contains(secret));
    for help in [&["serve", "tcp", "--help"][..], &["link", "help"]] {
        let text = run(help.iter().copied()).out.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(text.contains("its children and a core dump of it have that, too"), "{text}");
    }
}

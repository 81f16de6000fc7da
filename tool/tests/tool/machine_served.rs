//! The machine file of a server: its clients have its names, units and limits, and not its link; its recordings carry it.

use std::path::Path;
use std::sync::Arc;

use ecmsk::link::CarriedFile;
use ecmsk::port::tcp::ServeOptions;

use crate::machine_file::{Folder, MACHINE, SAID};

/// A server tells its machine file to those who move its axes, who have their names and units without a file of their own.
#[test]
fn a_server_tells_its_machine_file() {
    let folder = Folder::new(MACHINE);
    let (options, _) = support::tcp::options();
    // Longer than a message of the protocol.
    let long = format!("{MACHINE}{}", "# a comment\n".repeat(500));
    let file = CarriedFile::new(Path::new("portal.toml"), &long);
    let options = ServeOptions { machine: Some(Arc::new(file.clone())), ..options };
    let server = support::tcp::serve_with("sim:?slaves=drive*2,io&clock=virtual", options);
    let link = support::tcp::uri(&server, "");
    assert_eq!(ecmsk::link::tcp::machine(&link.parse().expect("a link")).expect("an answer"), Some(file));
    let elsewhere = Folder(tempfile::tempdir().expect("a folder"));
    let said = "note: machine file portal.toml of the server\n";
    let ran = elsewhere.run(&["move", "X=12.5", "--up", "--link", &link]);
    assert!(ran.code == Some(0) && ran.err.starts_with(said) && ran.err.matches(said).count() == 1, "{ran:?}");
    assert_eq!(ran.out, "axis X: at 12.5 mm (12500 counts)\n");
    let ran = elsewhere.run(&["move", "X=250.5", "--link", &link]);
    assert!(ran.code == Some(1) && ran.err.contains("max = 250 mm"), "{ran:?}");
    elsewhere.write("program", "move X=1\nexpect position X=1\n");
    let ran = elsewhere.run(&["run", "program", "--link", &link]);
    assert!(ran.code == Some(0) && ran.err.matches(said).count() == 1, "{ran:?}");
    let none = elsewhere.run(&["move", "X=2", "--link", &link, "--machine", "none"]);
    assert!(none.code == Some(1) && none.err.contains("there is no machine file"), "{none:?}");
    // The own file comes first.
    assert!(folder.run(&["move", "X=2", "--up", "--link", &link]).err.starts_with(SAID));

    let (server, _) = support::tcp::serve("sim:?slaves=drive*2,io&clock=virtual");
    let link = support::tcp::uri(&server, "");
    assert_eq!(ecmsk::link::tcp::machine(&link.parse().expect("a link")).expect("an answer"), None);
    let none = elsewhere.run(&["move", "X=2", "--link", &link]);
    assert!(none.code == Some(1) && none.err.contains("there is no machine file"), "{none:?}");
}

/// What a server with a machine file records carries the file.
#[cfg(all(unix, feature = "web"))]
#[test]
fn the_flight_recorder_of_a_server_carries_its_machine_file() {
    let folder = Folder::new(MACHINE);
    let (machine, flight) = (folder.path("machine.toml").display().to_string(), folder.path("flight"));
    let link = "sim:?slaves=drive*2,io&clock=virtual";
    let words = ["--link", link, "--machine", &machine, "--flight", &flight.display().to_string()];
    let server = crate::common::page::Serving::start("tcp", &words);
    let link = format!("tcp://{}", server.address());
    let elsewhere = Folder(tempfile::tempdir().expect("a folder"));
    // The limits of the file are for programs, and not for the server and its brake.
    let ran = elsewhere.run(&[
        "move",
        "1=251000",
        "--velocity",
        "200000",
        "--up",
        "--link",
        &link,
        "--machine",
        "none",
        "--slaves",
        "drive*2,io",
    ]);
    assert_eq!(ran.code, Some(0), "{ran:?}");
    server.end();
    let files = std::fs::read_dir(&flight).expect("it is there").map(|file| file.expect("a file").path());
    let files: Vec<_> = files.filter(|file| file.extension().is_some_and(|end| end == "ecmrec")).collect();
    assert!(!files.is_empty());
    for file in files {
        let text = elsewhere.run(&["recording", "info", &file.display().to_string(), "--machine-file"]);
        assert_eq!(text.out, MACHINE, "{text:?}");
    }
}

/// The link in a server's machine file is the server's: verbs of a client stay on the link that they have, also if it is that of
/// `ecmsk.toml`, and open no file that the server names. A recording of such a verb does not name the file either.
#[test]
fn a_servers_machine_file_leads_to_no_other_board() {
    let elsewhere = Folder(tempfile::tempdir().expect("a folder"));
    let trap = elsewhere.path("trap.pcapng");
    let text = MACHINE.replace("clock=virtual", &format!("clock=virtual&record={}", trap.display()));
    let (options, _) = support::tcp::options();
    let options =
        ServeOptions { machine: Some(Arc::new(CarriedFile::new(Path::new("machine.toml"), &text))), ..options };
    let server = support::tcp::serve_with("sim:?slaves=drive*2,io&clock=virtual", options);
    let link = support::tcp::uri(&server, "");
    elsewhere.write("ecmsk.toml", &format!("link = \"{link}\"\n"));
    let ran = elsewhere.run(&["move", "X=2.5", "--up"]);
    assert!(ran.code == Some(0) && ran.out.starts_with("axis X: at 2.5 mm"), "{ran:?}");
    for words in [&["info", "--json"] as &[&str], &["servo", "off", "X"]] {
        let ran = elsewhere.run(words);
        assert!(ran.code == Some(0), "{words:?} {ran:?}");
    }
    assert!(!trap.exists());
    // The board behind the server has moved.
    let ran = elsewhere.run(&["info", "--link", &link, "--machine", "none"]);
    assert!(ran.out.contains("2500"), "{ran:?}");
    let ran = elsewhere.run(&["move", "X=3", "--up", "--link", &link, "--record", "own.ecmrec"]);
    assert!(ran.code == Some(0) && elsewhere.path("own.ecmrec").exists(), "{ran:?}");
    assert_eq!(
        elsewhere.run(&["recording", "info", "own.ecmrec", "--json"]).json()["machine"],
        serde_json::Value::Null
    );
    let ran = elsewhere.run(&["move", "X=251"]);
    assert!(ran.err.contains("or correct max in machine.toml of the server"), "{ran:?}");
}

/// A machine file of the folder that says something else of an axis than that of the server: verbs that read say so, verbs that
/// move the axis refuse, unless `--machine` names the file. Other axes are moved.
#[test]
fn an_axis_is_not_moved_by_two_files_that_differ() {
    let folder = Folder::new(&MACHINE.replace("per = 0.001", "per = 0.01"));
    let (options, _) = support::tcp::options();
    let file = CarriedFile::new(Path::new("machine.toml"), MACHINE);
    let options = ServeOptions { machine: Some(Arc::new(file)), ..options };
    let server = support::tcp::serve_with("sim:?slaves=drive*2,io&clock=virtual", options);
    let link = support::tcp::uri(&server, "");
    let differs = "axis X: a count is 0.01 mm in machine.toml, 0.001 mm in machine.toml of the server";
    let warning = format!("warning: {differs}\n");
    let run = |words: &[&str]| folder.run(&[words, &["--link", &link]].concat());
    let ran = run(&["info"]);
    assert!(ran.code == Some(0) && ran.err.matches(&warning).count() == 1, "{ran:?}");
    for words in [&["move", "X=2", "--up"] as &[&str], &["home", "X", "--up"], &["move", "turn=5", "1=5", "--up"]] {
        let ran = run(words);
        let error = format!(
            "error: {}: {differs}; correct the file that is wrong, or say --machine machine.toml to move by that of this folder\n",
            words[0]
        );
        assert!(ran.code == Some(1) && ran.out.is_empty() && ran.err.ends_with(&error), "{words:?} {ran:?}");
    }
    let ran = run(&["info"]);
    assert!(ran.out.contains("PreOP"), "nothing was sent: {ran:?}");
    assert_eq!(run(&["move", "turn=5", "--up"]).code, Some(0));
    let ran = run(&["move", "X=2", "--up", "--machine", "machine.toml"]);
    assert_eq!((ran.code, ran.out.as_str()), (Some(0), "axis X: at 2 mm (200 counts)\n"), "{ran:?}");
    assert!(ran.err.contains(&warning), "{ran:?}");
    let ran = run(&["servo", "off", "all"]);
    assert!(ran.code == Some(0) && !ran.err.contains("warning"), "{ran:?}");

    folder.write("machine.toml", &MACHINE.replace("max = 250", "max = 300"));
    let ran = run(&["move", "X=2", "--up"]);
    let differs = "axis X: max is 300 mm in machine.toml, 250 mm in machine.toml of the server; ";
    assert!(ran.code == Some(1) && ran.err.contains(differs), "{ran:?}");
    folder.write("machine.toml", MACHINE);
    let ran = run(&["move", "X=2", "--up"]);
    assert!(ran.code == Some(0) && !ran.err.contains("warning"), "{ran:?}");
}

/// A verb that moves axes does not begin if the server's machine file is not known: one of a newer format, or if the connection
/// that asks for it ends. Without the file there would be no limits.
#[test]
fn no_axis_moves_without_the_limits_of_the_server() {
    let elsewhere = Folder(tempfile::tempdir().expect("a folder"));
    let (options, _) = support::tcp::options();
    let newer = CarriedFile::new(Path::new("machine.toml"), &MACHINE.replace("format = 1", "format = 2"));
    let options = ServeOptions { machine: Some(Arc::new(newer)), ..options };
    let server = support::tcp::serve_with("sim:?slaves=drive*2,io&clock=virtual", options);
    let link = support::tcp::uri(&server, "");
    let words = ["move", "1=260000", "--velocity", "200000", "--up", "--link"];
    let ran = elsewhere.run(&[&words, &[&*link][..]].concat());
    ran.expect_failure(
        1,
        &["the machine file of the server may have limits", "machine.toml of the server, line 2: format: it is 2"],
        "or say --machine none to move without its limits",
    );
    // A verb that moves nothing goes on.
    assert_eq!(elsewhere.run(&["info", "--link", &link]).code, Some(0));

    let server = support::tcp::serve_with("sim:?slaves=drive*2,io&clock=virtual", support::tcp::options().0);
    let link = closes_the_first(&server);
    let ran = elsewhere.run(&[&words, &[&*link][..]].concat());
    assert!(ran.code == Some(1) && ran.out.is_empty(), "{ran:?}");
    assert!(
        ran.err.starts_with("error: no board at `tcp://") && ran.err.contains("has closed the connection"),
        "{ran:?}"
    );
}

/// The link to a server through somebody who closes the first connection, and passes on the others.
fn closes_the_first(server: &ecmsk::port::tcp::Server) -> String {
    use std::net::{TcpListener, TcpStream};
    let (listener, to) = (TcpListener::bind("127.0.0.1:0").expect("a port"), server.address());
    let link = format!("tcp://{}", listener.local_addr().expect("it has one"));
    std::thread::spawn(move || {
        drop(listener.accept());
        for client in listener.incoming().flatten() {
            let Ok(server) = TcpStream::connect(to) else { return };
            for (mut from, mut to) in [(&client, &server), (&server, &client)]
                .map(|(from, to)| (from.try_clone().expect("a copy"), to.try_clone().expect("a copy")))
            {
                std::thread::spawn(move || {
                    let _ = std::io::copy(&mut from, &mut to);
                    let _ = to.shutdown(std::net::Shutdown::Both);
                });
            }
        }
    });
    link
}

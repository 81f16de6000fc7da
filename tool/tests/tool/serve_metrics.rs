//! `ecmsk serve ... --metrics`: what a scrape and a check of the health get, who may ask, and that nobody who asks delays the
//! board. The dashboard of Grafana names what the server has.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{Read as _, Write as _};
use std::net::TcpStream;

use serde_json::Value;
use support::tcp::until;

use crate::common::page::{Serving, ask, insist};
use crate::common::run;

/// A served board with metrics, and the address of these.
struct Metrics {
    serving: Serving,
    host: String,
}

impl Metrics {
    fn start(port: &str, arguments: &[&str]) -> Self {
        let mut serving = Serving::start(port, &[arguments, &["--metrics", "0"]].concat());
        let line = loop {
            let line = serving.next_line();
            assert!(!line.is_empty(), "no address of the metrics");
            if line.starts_with("metrics ") {
                break line;
            }
        };
        let host = line.strip_prefix("metrics at http://").and_then(|rest| rest.strip_suffix("/metrics\n"));
        let host = host.unwrap_or_else(|| panic!("{line}")).to_owned();
        assert!(host.starts_with("127.0.0.1:"), "{host}");
        Self { serving, host }
    }

    fn link(&self) -> String {
        self.serving.link()
    }

    fn get(&self, path: &str) -> (String, String) {
        ask(&self.host, &[&format!("GET {path} HTTP/1.1"), "Host: localhost"])
    }

    fn text(&self) -> String {
        let (head, text) = self.get("/metrics");
        assert!(head.starts_with("HTTP/1.1 200 OK\r\n"), "{head}");
        assert!(head.contains("Content-Type: text/plain; version=0.0.4; charset=utf-8\r\n"), "{head}");
        text
    }

    /// The values by their names with labels.
    fn values(&self) -> BTreeMap<String, f64> {
        values(&self.text())
    }

    /// The status and the text of `/healthz`.
    fn health(&self) -> (String, String) {
        let (head, text) = self.get("/healthz");
        (head.split(' ').nth(1).expect("a status").to_owned(), text)
    }
}

/// The lines with values of a text in Prometheus' format.
#[track_caller]
fn values(text: &str) -> BTreeMap<String, f64> {
    let value = |line: &str| {
        let (name, value) = line.rsplit_once(' ').expect(line);
        let value = if value == "+Inf" { f64::INFINITY } else { value.parse().expect(line) };
        (name.to_owned(), value)
    };
    text.lines().filter(|line| !line.starts_with('#')).map(value).collect()
}

/// The names without labels.
fn names(values: &BTreeMap<String, f64>) -> BTreeSet<&str> {
    values.keys().map(|name| name.split('{').next().unwrap_or_default()).collect()
}

/// TOOL-200 The metrics of a served board show what a program does with it: frames, states, positions, the FIFO, alarms.
/// Names and types are those that Prometheus wants, and nothing else than numbers of the board is in it.
#[test]
fn a_scrape_shows_what_the_board_does() {
    let folder = tempfile::tempdir().expect("a folder");
    let (flight, control) = (folder.path().join("flight"), folder.path().join("board"));
    let (flight, control) = (flight.to_str().expect("UTF-8"), control.to_str().expect("UTF-8"));
    let board = Metrics::start(
        "tcp",
        &["--link", "sim:?slaves=drive*2,io&name=secret-name", "--flight", flight, "--control", control],
    );
    assert_eq!(board.health(), ("200".to_owned(), "ok\n".to_owned()));
    let first = board.values();
    assert_eq!(first[r#"ecmsk_frames_written_total{board="1"}"#], 0.0);
    assert_eq!(first[r#"ecmsk_board_up{board="1"}"#], 1.0);
    assert_eq!(first[r#"ecmsk_board_info{board="1",scheme="sim"}"#], 1.0);
    assert_eq!(first[r#"ecmsk_clients{server="tcp"}"#], 0.0);
    assert_eq!(first[r#"ecmsk_network_state{board="1",state="PreOP"}"#], 1.0);

    insist(&["home", "1", "--up", "--link", &board.link()]);
    insist(&["move", "1=700", "--link", &board.link()]);
    insist(&["io", "3", "--set", "0x4", "--link", &board.link()]);
    until("what the program has done", || {
        let now = board.values();
        let is_there = now[r#"ecmsk_axis_position_counts{board="1",slave="1"}"#] == 700.0
            && now.get(r#"ecmsk_axis_following_error_counts{board="1",slave="1"}"#) == Some(&0.0);
        is_there.then_some(())
    });
    let moved = board.values();
    assert_eq!(moved[r#"ecmsk_network_state{board="1",state="OP"}"#], 1.0);
    assert_eq!(moved[r#"ecmsk_network_state{board="1",state="PreOP"}"#], 0.0);
    assert_eq!(moved[r#"ecmsk_axis_state{board="1",slave="1",state="Operation enabled"}"#], 1.0);
    assert_eq!(moved[r#"ecmsk_axis_alarm_code{board="1",slave="1"}"#], 0.0);
    assert!(moved[r#"ecmsk_frames_written_total{board="1"}"#] > 0.0);
    assert!(moved[r#"ecmsk_fifo_executed_total{board="1"}"#] > 0.0);
    let cycles = |values: &BTreeMap<String, f64>| values[r#"ecmsk_cycles_total{board="1"}"#];
    assert!(cycles(&moved) > cycles(&first));
    let late = |le: &str| moved[&format!(r#"ecmsk_cycle_lateness_seconds_bucket{{board="1",le="{le}"}}"#)];
    assert!(late("1e-05") <= late("0.001") && late("0.001") <= late("+Inf"));
    assert_eq!(late("+Inf"), moved[r#"ecmsk_cycle_lateness_seconds_count{board="1"}"#]);

    run(["fault", control, "alarm 2 0x7500"]).expect_quiet();
    until("the alarm", || {
        let now = board.values();
        let is_there = now[r#"ecmsk_axis_alarm_code{board="1",slave="2"}"#] == f64::from(0x7500)
            && now[r#"ecmsk_axis_alarms_total{board="1",slave="2"}"#] >= 1.0;
        is_there.then_some(())
    });
    assert_eq!(board.health().0, "200", "an alarm is no lost slave");

    let text = board.text();
    // What the link names, such as files and machines, is nobody's business.
    for hidden in ["secret-name", flight, control, "sim:"] {
        assert!(!text.contains(hidden), "{hidden}");
    }
    for line in text.lines() {
        let name = line.strip_prefix("# HELP ").or_else(|| line.strip_prefix("# TYPE ")).unwrap_or(line);
        assert!(name.starts_with("ecmsk_"), "{line}");
        if let Some((name, "counter")) = line.strip_prefix("# TYPE ").and_then(|line| line.split_once(' ')) {
            assert!(name.ends_with("_total"), "{line}");
        }
    }
    the_dashboard_names_what_is_there(&until("the size of the recording", || {
        let now = board.values();
        now.contains_key(r#"ecmsk_recording_bytes{board="1",kind="flight"}"#).then_some(now)
    }));
    board.serving.end();
}

/// Each expression of `share/grafana/ecmsk.json` names metrics and labels that the server has, and the dashboard has all that it
/// needs to be imported.
#[track_caller]
fn the_dashboard_names_what_is_there(there: &BTreeMap<String, f64>) {
    let file = support::root().join("share/grafana/ecmsk.json");
    let dashboard: Value = serde_json::from_str(&std::fs::read_to_string(file).expect("a file")).expect("JSON");
    assert!(dashboard["title"] == "ecmsk" && dashboard["schemaVersion"].is_u64());
    let variables = dashboard["templating"]["list"].as_array().expect("a list");
    let panels = dashboard["panels"].as_array().expect("a list");
    assert!(panels.len() > 10);
    let mut expressions: Vec<&str> = variables.iter().filter_map(|variable| variable["query"].as_str()).collect();
    for panel in panels {
        let targets = panel["targets"].as_array().expect("a list");
        assert!(!targets.is_empty() && panel["datasource"]["type"] == "prometheus", "{panel}");
        expressions.extend(targets.iter().map(|target| target["expr"].as_str().expect("an expression")));
    }
    let (names, mut used) = (names(there), BTreeSet::new());
    for expression in expressions {
        assert_eq!(expression.matches('(').count(), expression.matches(')').count(), "{expression}");
        for (at, _) in expression.match_indices("ecmsk_") {
            let is_word = |c: char| c.is_ascii_alphanumeric() || c == '_';
            let name = expression[at..].split(|c| !is_word(c)).next().expect("a name");
            assert!(names.contains(name), "{name} of {expression}");
            used.insert(name);
        }
        for variable in expression.split('$').skip(1).filter_map(|rest| rest.split(['"', ']', ')', '}']).next()) {
            let is_own = variables.iter().any(|own| own["name"] == variable);
            assert!(is_own || variable == "__rate_interval", "{variable} of {expression}");
        }
    }
    // The dashboard shows nearly all of them.
    let left: Vec<_> = names.difference(&used).filter(|name| !name.contains("lateness")).collect();
    assert!(left.is_empty(), "{left:?}");
}

/// TOOL-199 While a slave is lost, `/healthz` has 503 and says which, and `ecmsk_board_up` is 0.
#[test]
fn a_lost_slave_is_no_health() {
    let folder = tempfile::tempdir().expect("a folder");
    let control = folder.path().join("board");
    let control = control.to_str().expect("UTF-8");
    let board = Metrics::start("tcp", &["--link", "sim:?slaves=drive*2", "--control", control]);
    insist(&["home", "1", "--up", "--link", &board.link()]);
    run(["fault", control, "lose 2"]).expect_quiet();
    let text = until("the loss", || {
        let (status, text) = board.health();
        (status == "503").then_some(text)
    });
    assert!(text.starts_with("slave 2 is lost"), "{text}");
    let now = board.values();
    assert_eq!(now[r#"ecmsk_board_up{board="1"}"#], 0.0);
    assert_eq!(now[r#"ecmsk_slaves_lost{board="1"}"#], 1.0);
    assert_eq!(now[r#"ecmsk_slave_lost{board="1",slave="2"}"#], 1.0);
    board.serving.end();
}

/// Frames that are missing in a recording, here because its reader is gone, are said by `/healthz`, and are no reason to start the
/// server again.
#[cfg(target_os = "linux")]
#[test]
fn a_recording_that_has_stopped_is_said() {
    let folder = tempfile::tempdir().expect("a folder");
    let pipe = folder.path().join("pipe");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().expect("it starts").success());
    let reader = std::fs::File::options().read(true).write(true).open(&pipe).expect("a pipe");
    let link = format!("sim:?slaves=drive&record={}", pipe.display());
    let metrics = Metrics::start("tcp", &["--link", &link]);
    assert_eq!(metrics.health(), ("200".to_owned(), "ok\n".to_owned()));
    drop(reader);
    run(["state", "preop", "--link", &metrics.link()]);
    until("frames are missing", || {
        let (status, text) = metrics.health();
        assert_eq!(status, "200", "{text}");
        (text.starts_with("ok, but ") && text.contains(" frames are missing in its recording: ")).then_some(())
    });
}

/// A server on the loopback address answers to names of its machine alone. It only shows, and only these two things.
#[test]
fn who_may_ask_and_what() {
    let board = Metrics::start("tcp", &["--link", "sim:?slaves=io"]);
    for (lines, status) in [
        (["GET /metrics HTTP/1.1", "Host: example.org"], 403),
        (["GET /metrics HTTP/1.1", "X: none"], 403),
        (["POST /metrics HTTP/1.1", "Host: localhost"], 405),
        (["GET / HTTP/1.1", "Host: localhost"], 404),
        (["GET /metrics/.. HTTP/1.1", "Host: localhost"], 404),
        (["GET /metrics?x=1 HTTP/1.1", "Host: 127.0.0.1"], 200),
    ] {
        let (head, _) = ask(&board.host, &lines);
        assert!(head.starts_with(&format!("HTTP/1.1 {status} ")), "{lines:?}: {head}");
    }
    board.serving.end();
    for (at, words) in [("0.0.0.0", "write 0.0.0.0:9464"), ("localhost:1", "e.g. 9464"), ("70000", "e.g. 9464")] {
        run(["serve", "tcp", "--link", "sim:?slaves=io", "--metrics", at]).expect_misuse(&[words]);
    }
    let taken = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let at = taken.local_addr().expect("it has one").to_string();
    let refused = run(["serve", "tcp", "--link", "sim:?slaves=io", "--listen", "127.0.0.1:0", "--metrics", &at]);
    refused.expect_failure(1, &["cannot serve metrics on", &at], "choose another port with --metrics");
}

/// TOOL-200 A thousand connections that say nothing, and clients that ask and do not read, keep nobody from the board: it
/// goes on, and a scrape is answered when they have timed out or gone.
#[test]
fn a_crowd_does_not_slow_the_board() {
    let board = Metrics::start("tcp", &["--link", "sim:?slaves=drive*2"]);
    let cycles = || {
        until("an answer", || {
            let mut stream = TcpStream::connect(&board.host).ok()?;
            stream.write_all(b"GET /metrics HTTP/1.1\r\nHost: localhost\r\n\r\n").ok()?;
            let mut text = String::new();
            stream.read_to_string(&mut text).ok()?;
            let (_, body) = text.split_once("\r\n\r\n").filter(|(head, _)| head.starts_with("HTTP/1.1 200"))?;
            values(body).get(r#"ecmsk_cycles_total{board="1"}"#).copied()
        })
    };
    let before = cycles();
    let mut silent = Vec::new();
    for number in 0..1000 {
        let Ok(mut stream) = TcpStream::connect(&board.host) else { continue };
        if number % 2 == 0 {
            // The server may have closed the connection already.
            let _ = stream.write_all(b"GET /metrics HTTP/1.1\r\nHost: localhost\r\n\r\n");
        }
        silent.push(stream);
    }
    // The board serves its clients meanwhile.
    insist(&["home", "1", "--up", "--link", &board.link()]);
    assert!(cycles() > before);
    drop(silent);
    board.serving.end();
}

/// TOOL-200 Connections that say nothing do not keep a check of the health from its answer: the oldest of them makes room.
#[test]
fn silent_connections_do_not_close_the_check_of_the_health() {
    let board = Metrics::start("tcp", &["--link", "sim:?slaves=drive"]);
    let silent: Vec<_> = (0..20).map(|_| TcpStream::connect(&board.host).expect("it listens")).collect();
    for _ in 0..3 {
        assert_eq!(board.health().0, "200");
    }
    drop(silent);
    board.serving.end();
}

/// `serve usbip` and `serve web` have the same metrics: of each board, and of a board at another server. `serve xf` has those of a
/// chip.
#[test]
fn other_servers_have_the_same() {
    let two =
        Metrics::start("usbip", &["--link", "sim:?name=left&slaves=io", "--link", "sim:?name=right&slaves=drive"]);
    let now = two.values();
    for board in ["1", "2"] {
        assert_eq!(now[&format!(r#"ecmsk_board_up{{board="{board}"}}"#)], 1.0);
        assert_eq!(now[&format!(r#"ecmsk_board_opened_total{{board="{board}"}}"#)], 1.0);
    }
    assert_eq!(now[&format!(r#"ecmsk_build_info{{version="{}",server="usbip"}}"#, env!("CARGO_PKG_VERSION"))], 1.0);
    two.serving.end();

    let chip = Metrics::start("xf", &["--link", "xf-sim:?slaves=drive"]);
    assert_eq!(chip.values()[r#"ecmsk_chip_up{server="xf"}"#], 1.0);
    assert_eq!(chip.health(), ("200".to_owned(), "ok\n".to_owned()));
    chip.serving.end();

    let board = Serving::start("tcp", &["--link", "sim:?slaves=drive*2,io"]);
    let link = board.link();
    let web = Metrics::start("web", &["--link", &link]);
    insist(&["home", "1", "--up", "--link", &link]);
    let read = |values: &BTreeMap<String, f64>| values[r#"ecmsk_frames_read_total{board="1"}"#];
    let before = read(&web.values());
    until("more reports", || (read(&web.values()) > before).then_some(()));
    let now = web.values();
    assert_eq!(now[r#"ecmsk_clients{server="web"}"#], 0.0);
    assert_eq!(now[r#"ecmsk_axis_state{board="1",slave="1",state="Operation enabled"}"#], 1.0);
    assert_eq!(web.health().0, "200");
    // The page waits for a board that has gone, and shows it when it is back.
    board.end();
    let text = until("the loss", || {
        let (status, text) = web.health();
        (status == "503").then_some(text)
    });
    assert!(text.starts_with("no report of the board for "), "{text}");
    let again = Serving::start_again(&link, "sim:?slaves=drive*2,io");
    until("the board", || (web.health().0 == "200").then_some(()));
    web.serving.end();
    again.end();
}

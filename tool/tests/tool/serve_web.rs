//! `ecmsk serve web`: who may read the page, which messages it gets, and that no page delays the board.

use std::io::Read;
use std::net::TcpStream;
#[cfg(target_os = "linux")]
use std::process::Stdio;
#[cfg(target_os = "linux")]
use std::time::Duration;

#[cfg(target_os = "linux")]
use ecmsk::ecm::{Close, Config, Ecm};
#[cfg(target_os = "linux")]
use ecmsk::sk::MasterState;
#[cfg(target_os = "linux")]
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use tungstenite::WebSocket;

use crate::common::page::{Serving, data, insist, next_text, points};
use crate::common::{run, without_times};

const HOST: &str = "Host: localhost:1";
/// How many messages with counters a test reads before it gives up; a page gets four of them a second.
const STATUSES_MAX: u32 = 1000;

fn of_a_simulated_board() -> Serving {
    Serving::start("web", &["--link", "sim:?slaves=drive*2,io"])
}

/// A board that is served over TCP, the link to it, and a page that shows it.
fn of_a_served_board() -> (Serving, String, Serving) {
    let board = Serving::start("tcp", &["--link", "sim:?slaves=drive*2,io"]);
    let link = board.link();
    let web = Serving::start("web", &["--link", &link]);
    (board, link, web)
}

/// The answer with the page has the header fields that keep other sites out. Without its token, under another host name and
/// with other methods there is no page.
#[test]
fn only_who_has_the_address_gets_the_page() {
    let web = of_a_simulated_board();
    let (host, token) = web.host_and_token();
    let (host, get) = (format!("Host: {host}"), format!("GET /?token={token} HTTP/1.1"));
    let (head, page) = web.ask(&[&get, &host]);
    assert!(head.starts_with("HTTP/1.1 200 "), "{head}");
    for field in ["script-src 'sha256-", "frame-ancestors 'none'", "nosniff", "no-store", "no-referrer", "same-origin"]
    {
        assert!(head.contains(field), "{field}: {head}");
    }
    assert!(head.contains(&format!("connect-src ws://{};", web.host_and_token().0)), "{head}");
    assert_eq!(data(&page), "null");
    assert!(!page.contains(token), "the page does not repeat its token");
    assert!(web.ask(&[&get, HOST]).0.starts_with("HTTP/1.1 200 "), "by the end of a tunnel");

    let other = format!("GET /?token={}{} HTTP/1.1", &token[..31], if token.ends_with('0') { '1' } else { '0' });
    for (lines, status) in [
        ([&*get, "Host: example.org"], 403),
        ([&*get, "Host: 127.0.0.1.example.org"], 403),
        ([&*get, "Host2: localhost"], 403),
        (["GET / HTTP/1.1", HOST], 403),
        ([&*other, HOST], 403),
        (["GET /?token= HTTP/1.1", HOST], 403),
        ([&*get.replace("GET", "POST"), HOST], 405),
        ([&*get.replace("GET /?", "GET /etc/passwd?"), HOST], 404),
        ([&*get.replace("GET /?", "GET /../?"), HOST], 404),
        ([&*get.replace("GET /?", "GET /live?"), HOST], 403),
    ] {
        let (head, body) = web.ask(&lines);
        assert!(head.starts_with(&format!("HTTP/1.1 {status} ")), "{lines:?}: {head}");
        assert!(!body.contains(token) && body.len() < 200, "{body}");
    }
    web.end();
}

/// Only the page itself may open the WebSocket: other pages have another origin, and do not know the token.
#[test]
fn a_socket_needs_the_origin_of_the_page() {
    let web = of_a_simulated_board();
    let (host, token) = web.host_and_token();
    let upgrade = |token: &str, origin: &str| {
        let lines = [
            &*format!("GET /live?token={token} HTTP/1.1"),
            &*format!("Host: {host}"),
            "Upgrade: websocket",
            "Connection: Upgrade",
            "Sec-WebSocket-Version: 13",
            "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
            origin,
        ];
        web.ask(&lines).0
    };
    for origin in ["Origin: http://example.org", "Origin: null", "X: none", &format!("Origin: https://{host}")] {
        assert!(upgrade(token, origin).starts_with("HTTP/1.1 403 "), "{origin}");
    }
    assert!(upgrade("0123", &format!("Origin: http://{host}")).starts_with("HTTP/1.1 403 "));
    let plain = web.ask(&[
        &format!("GET /live?token={token} HTTP/1.1"),
        &format!("Host: {host}"),
        &format!("Origin: http://{host}"),
    ]);
    assert!(plain.0.starts_with("HTTP/1.1 400 "), "{}", plain.0);
    assert!(web.socket().is_some());
    web.end();
}

/// A page gets a hello message first, then channels, events, counters and points. They show what another program does with the
/// board.
#[test]
fn a_page_shows_what_another_program_does() {
    let (board, link, web) = of_a_served_board();
    let mut socket = web.socket().expect("there is room");
    let mut blocks = Vec::new();
    let hello = next_text(&mut socket, &mut blocks);
    assert_eq!((&hello["type"], &hello["source"], &hello["format"]), (&"hello".into(), &"board".into(), &1.into()));
    insist(&["home", "1", "--up", "--link", &link]);
    insist(&["io", "3", "--set", "0x4", "--link", &link]);
    let (mut channels, mut events) = (hello["channels"].clone(), hello["events"].as_array().expect("a list").clone());
    let (mut statuses, mut has_position, mut has_output) = (0, false, false);
    while !has_position
        || !has_output
        || statuses < 2
        || !events.iter().any(|event| event["text"] == "Operation enabled")
    {
        let message = next_text(&mut socket, &mut blocks);
        match message["type"].as_str().expect("a type") {
            "channels" => channels = message["channels"].clone(),
            "events" => events.extend(message["events"].as_array().expect("a list").iter().cloned()),
            "status" => {
                statuses += 1;
                assert!(statuses < STATUSES_MAX, "position {has_position}, output {has_output}, {events:?}");
                assert!(message["status"]["reports"].is_u64() && message["dropped"].is_u64(), "{message}");
            }
            other => panic!("{other}"),
        }
        let of = |slave: u8, quantity: &str, bit: u8| {
            let is_it =
                |channel: &Value| channel["slave"] == slave && channel["quantity"] == quantity && channel["bit"] == bit;
            channels.as_array().expect("a list").iter().position(is_it)
        };
        for all in blocks.drain(..).map(|block| points(&block)) {
            let has = |place: Option<usize>, is_it: fn(i64) -> bool| {
                let found = place.and_then(|place| all.get(&place));
                found.is_some_and(|points| points.iter().any(|(_, value)| is_it(*value)))
            };
            has_position |= has(of(1, "position", 0), |position| position == 0);
            has_output |= has(of(3, "output", 2), |output| output == 1);
        }
    }
    // The page has sent nothing to the board: it is still in the state in which the program has left it.
    let info = run(["info", "--link", &link]).expect_quiet();
    assert!(info.contains("state       OP"), "{info}");
    web.end();
    let said = board.end();
    // The page is the only reader of the board. The verbs `home`, `io` and `info` are writers.
    assert_eq!(said.matches(" is a reader").count(), 1, "{said}");
    assert!(said.matches(" is a writer").count() >= 3, "{said}");
}

/// With `--find` a page gets an event when the condition becomes true, each time. A page of a board refuses conditions that need
/// what a program sends.
#[test]
fn a_condition_that_becomes_true_is_an_event() {
    const CONDITION: &str = "enabled(1) and position(1) >= 0";
    let board = Serving::start("tcp", &["--link", "sim:?slaves=drive"]);
    let link = board.link();
    let web = Serving::start("web", &["--link", &link, "--find", CONDITION]);
    let mut socket = web.socket().expect("there is room");
    let mut blocks = Vec::new();
    assert_eq!(next_text(&mut socket, &mut blocks)["find"], CONDITION);
    insist(&["state", "op", "--link", &link]);
    // What becomes true again within a second is the same event.
    let mut found = 0;
    for _ in 0..50 {
        insist(&["servo", "on", "1", "--link", &link]);
        insist(&["servo", "off", "1", "--link", &link]);
        loop {
            let message = next_text(&mut socket, &mut blocks);
            let events = message["events"].as_array().into_iter().flatten();
            found += events.filter(|event| event["kind"] == "found" && event["text"] == CONDITION).count();
            if message["type"] == "status" {
                break;
            }
        }
        if found >= 2 {
            break;
        }
    }
    assert!(found >= 2, "{found}");
    web.end();
    for condition in ["following_error(1) > 5", "abs(velocity(1)) < 10", "gap", "alarm or not homing", "target(1) > 0"]
    {
        let refused = run(["serve", "web", "--link", &link, "--find", condition]);
        refused.expect_failure(2, &[condition, "not what a program sends"], "or show a recording");
    }
    let wrong = run(["serve", "web", "--link", &link, "--find", "position(X) > 5"]);
    wrong.expect_failure(2, &["--find: column"], "see `ecmsk find --help`");
    board.end();
}

/// A served board that was lost and is there again is shown again, without a word on the command line.
#[test]
fn a_board_that_is_back_is_shown_again() {
    let (board, link, web) = of_a_served_board();
    let mut socket = web.socket().expect("there is room");
    let trouble = |message: &Value| message["status"]["trouble"].clone();
    assert!(trouble(&status(&mut socket)).is_null());
    board.end();
    let lost = (0..STATUSES_MAX).any(|_| !trouble(&status(&mut socket)).is_null());
    assert!(lost, "its end is said");
    let board = Serving::start_again(&link, "sim:?slaves=drive*2,io");
    let is_back = (0..STATUSES_MAX).any(|_| trouble(&status(&mut socket)).is_null());
    assert!(is_back, "it is shown again");
    let (before, after) = (status(&mut socket), status(&mut socket));
    assert!(before["status"]["reports"].as_u64() < after["status"]["reports"].as_u64(), "{before} {after}");
    web.end();
    board.end();
}

/// If 200 pages connect, 16 are served and the others are refused. The board is read all the time, and when pages have gone
/// others are served.
#[test]
fn a_crowd_of_pages_does_not_slow_the_board() {
    let web = of_a_simulated_board();
    let mut sockets: Vec<_> = (0..200).filter_map(|_| web.socket()).collect();
    assert_eq!(sockets.len(), 16);
    let first = status(&mut sockets[0])["status"]["reports"].as_u64();
    let last = status(&mut sockets[15])["status"]["reports"].as_u64();
    assert!(first > Some(0) && last > Some(0), "{first:?}, {last:?}");
    drop(sockets);
    // The server notices that a page is gone when it sends it the next message.
    let mut socket = (0..10_000).find_map(|_| web.socket()).expect("there is room again");
    let (before, after) = (status(&mut socket), status(&mut socket));
    assert!(before["status"]["reports"].as_u64() < after["status"]["reports"].as_u64(), "{before} {after}");
    web.end();
}

/// Reads the next message with counters (type `status`).
fn status(socket: &mut WebSocket<TcpStream>) -> Value {
    loop {
        let message = next_text(socket, &mut Vec::new());
        if message["type"] == "status" {
            return message;
        }
    }
}

/// Connections that send nothing, and a page that reads nothing, do not delay other pages or the board.
#[test]
fn who_says_nothing_holds_nobody_up() {
    let web = of_a_simulated_board();
    let silent: Vec<_> = (0..40).map(|_| TcpStream::connect(web.host_and_token().0).expect("it listens")).collect();
    let _stalled = web.socket().expect("there is room");
    let mut socket = web.socket().expect("there is room");
    let mut blocks = Vec::new();
    while blocks.len() < 10 {
        next_text(&mut socket, &mut blocks);
    }
    drop(silent);
    web.end();
}

/// The page of a recording contains all its data, and the server opens no WebSocket for it.
#[test]
fn a_recording_is_shown_whole() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = crate::plot_html::recorded(folder.path());
    let web = Serving::start("web", &[file.to_str().expect("UTF-8")]);
    let (host, token) = web.host_and_token();
    let (head, page) = web.ask(&[&format!("GET /?token={token} HTTP/1.1"), &format!("Host: {host}")]);
    assert!(head.contains("connect-src 'none'"), "{head}");
    let hello = crate::common::page::hello(&page);
    assert_eq!(hello["source"], "recording");
    assert!(web.socket().is_none());
    assert_eq!(without_times(&web.end()), "serve: stopped by SIGTERM\n");
}

/// While the server makes the page of a long recording, which may take minutes, a signal ends it.
#[cfg(target_os = "linux")]
#[test]
fn a_signal_ends_the_making_of_a_page() {
    const TERM_BIT: u64 = 1 << 14;
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("long.pcapng");
    let board = Ecm::open(&format!("sim:?slaves=drive*6&clock=virtual&record={}", file.display())).expect("a board");
    board.configure(&Config::drives(6)).expect("it is configured");
    board.set_state(MasterState::Op).expect("it is in OP");
    for _ in 0..20_000 {
        board.next_cycle(Duration::from_secs(60)).expect("a report");
    }
    board.close(Close::Hold).expect("it stands");

    let file = file.to_str().expect("UTF-8");
    let mut command = crate::common::ecmsk(["serve", "web", file, "--listen", "127.0.0.1:0"]);
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the tool starts");
    let status = format!("/proc/{}/status", child.id());
    let catches_signals = || {
        let status = std::fs::read_to_string(&status).unwrap_or_default();
        let caught = status.lines().find_map(|line| line.strip_prefix("SigCgt:")).unwrap_or_default();
        u64::from_str_radix(caught.trim(), 16).is_ok_and(|caught| caught & TERM_BIT != 0)
    };
    while !catches_signals() {
        std::thread::sleep(Duration::from_millis(1));
    }
    kill_process(Pid::from_child(&child), Signal::TERM).expect("it runs");
    let said = child.wait_with_output().expect("it ends");
    let words = String::from_utf8_lossy(&said.stderr);
    assert_eq!((said.status.code(), &*String::from_utf8_lossy(&said.stdout)), (Some(0), ""), "{words}");
    assert_eq!(without_times(&words), "serve: stopped by SIGTERM\n");
}

/// Other machines reach the page over HTTPS alone, and a forgotten link serves no real board.
#[test]
fn what_is_not_served_is_said() {
    let refused = run(["serve", "web", "--link", "sim:", "--listen", "0.0.0.0:4714"]);
    refused.expect_failure(2, &["other machines reach 0.0.0.0:4714", "--cert FILE"], "ssh -L PORT:localhost:PORT");
    run(["serve", "web", "--link", "sim:", "--listen", "127.0.0.1"]).expect_misuse(&["write 127.0.0.1:4714"]);
    let folder = tempfile::tempdir().expect("a folder");
    let mut command = crate::common::ecmsk(["serve", "web"]);
    let said = command.current_dir(folder.path()).env("HOME", folder.path()).output().expect("the tool starts");
    assert_eq!(said.status.code(), Some(2));
    let taken = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = taken.local_addr().expect("it has one").to_string();
    run(["serve", "web", "--link", "sim:", "--listen", &address]).expect_failure(1, &["cannot listen on"], "--listen");
}

/// Who shows a simulated board of the server itself is told that no program moves it, and what shows a program's board. Who
/// shows a served board is not.
#[test]
fn a_board_that_no_program_moves_is_said_to_be_one() {
    const WORDS: &str = "is a new board of this server, which no program moves";
    assert!(of_a_simulated_board().end().contains(WORDS));
    let (_board, _, web) = of_a_served_board();
    assert!(!web.end().contains(WORDS));
}

/// The end of the server ends its connections.
#[test]
fn a_page_sees_the_end_of_the_server() {
    let web = of_a_simulated_board();
    let mut socket = web.socket().expect("there is room");
    web.end();
    while socket.read().is_ok() {}
    let mut rest = Vec::new();
    let _ = socket.get_mut().read_to_end(&mut rest);
    assert!(!socket.can_read() || rest.is_empty());
}

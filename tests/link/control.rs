//! Events that come while a simulated board runs, `control=`.
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};
use std::time::Duration;

use ecmsk::link::control::{ControlError, Happened, Injection, place};
use ecmsk::link::script::ScriptError;
use ecmsk::link::{self, LinkError, Share};

use support::script_client::{Client, MS, file};

/// How long a board may take to answer; a machine that is busy is late.
const LIMIT: Duration = Duration::from_secs(60);

struct Place(tempfile::TempDir);

impl Place {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a folder"))
    }

    fn path(&self) -> PathBuf {
        self.0.path().join("board")
    }

    fn name(&self) -> String {
        self.path().display().to_string()
    }

    /// A program on a board of two drives on a virtual clock, with this control socket and that script.
    fn client(&self, script: &str, keys: &str) -> Client {
        let name = format!("control-{}", self.0.path().file_name().and_then(|name| name.to_str()).expect("a name"));
        Client::open(&name, &format!("clock=virtual&control={}{keys}", self.name()), script)
    }

    fn inject(&self, event: &str) -> Result<Injection, ControlError> {
        Injection::begin(&self.name(), event)
    }

    /// Injects an event, lets one cycle pass, and returns when it happened.
    fn happens(&self, client: &mut Client, event: &str) -> Happened {
        let mut injection = self.inject(event).unwrap_or_else(|error| panic!("{event}: {error}"));
        client.link.pass(Duration::from_millis(1)).expect("a cycle passes");
        injection.wait(LIMIT).unwrap_or_else(|error| panic!("{event}: {error}"))
    }
}

fn error_code(client: &Client, slave: usize) -> u16 {
    client.slot(slave).data2_high()
}

/// An event happens at the beginning of the next cycle, as a line of a script with that time does: the answer has that cycle,
/// and every byte of the run is the same.
#[test]
fn an_event_is_a_line_of_a_script_at_its_cycle() {
    let run = |script: &str, events: &[(u64, &str)]| {
        let place = Place::new();
        let mut client = place.client(script, "");
        client.op();
        let (mut seen, mut happened) = (Vec::new(), Vec::new());
        let mut events = events.iter().peekable();
        loop {
            let at = client.read();
            seen.push((at, client.report.clone()));
            if at >= 2000 * MS {
                return (seen, happened);
            }
            if let Some((_, event)) = events.next_if(|(after, _)| at >= after * MS) {
                let mut injection = place.inject(event).expect(event);
                let at = client.read();
                seen.push((at, client.report.clone()));
                happened.push(injection.wait(LIMIT).expect(event));
            }
        }
    };
    let events = [(1000, "alarm 2 0x7500"), (1200, "mute 1 for 100ms"), (1500, "inputs 0x15")];
    let (injected, happened) = run("", &events);
    let times: Vec<_> = happened.iter().map(|happened| (happened.cycle, happened.at_ns / MS)).collect();
    assert_eq!(times, [(1000, 1001), (1200, 1201), (1500, 1501)], "the first cycle is 1 ms after the opening");
    let lines: Vec<_> =
        events.iter().zip(&happened).map(|((_, event), at)| format!("at {}us {event}", at.at_ns / 1000)).collect();
    let (scripted, _) = run(&lines.join("\n"), &[]);
    let differs = injected.iter().zip(&scripted).position(|(injected, scripted)| injected != scripted);
    assert_eq!(differs, None, "the report where the runs differ");
    assert_eq!(injected.len(), scripted.len());
}

/// What lasts ends by `for`, by `end`, and when the board is opened again.
#[test]
fn what_lasts_ends() {
    let place = Place::new();
    let mut client = place.client("", "&name=what-lasts");
    let mut before = client.read();
    let begun = place.happens(&mut client, "silent for 5ms");
    let next = loop {
        let at = client.read();
        if at > begun.at_ns {
            break at;
        }
        before = at;
    };
    assert_eq!((before, next), (begun.at_ns - MS, begun.at_ns + 5 * MS));
    place.happens(&mut client, "inputs 0x3F");
    place.happens(&mut client, "silent");
    assert!(matches!(client.try_read(), Err(LinkError::Silent { .. }) | Ok(_)));
    place.happens(&mut client, "end silent");
    client.read();
    place.happens(&mut client, "silent");
    client.link.close();
    let mut client = place.client("", "&name=what-lasts");
    client.read();
    assert_eq!(place.happens(&mut client, "inputs 0").cycle, 1, "cycles count from the opening");
}

/// A wrong event is named by the parser of scripts, with the column, and nothing happens.
#[test]
fn a_wrong_event_is_named() {
    let place = Place::new();
    let mut client = place.client("", "");
    for (event, says) in [
        ("", "column 1: VERB is missing; allowed: alarm, cut, heal"),
        ("alarm 3 0x7500", "column 7: `3` is no slave of this network; allowed: a number from 1 to 2"),
        ("alram 1 0x7500", "column 1: `alram` is no verb; did you mean `alarm`?"),
        ("alarm 1 0x7500 for 2s", "column 16: `for` is too much; allowed: alarm SLAVE[.AXIS] CODE [stays]"),
        (
            "at 2s alarm 1 0x7500",
            "column 1: `at` is of scripts; an injected event happens in the next cycle, leave it out",
        ),
        ("from op", "column 1: `from` is of scripts"),
        ("noise 1 10", "`noise` happens to frames, and this board reaches its simulated slaves without any"),
    ] {
        match place.inject(event) {
            Err(ControlError::Wrong { text }) => assert!(text.starts_with(says), "{event}: {text}"),
            other => panic!("{event}: {other:?}"),
        }
    }
    client.op();
    assert_eq!((error_code(&client, 1), error_code(&client, 2)), (0, 0));
    let (text, line) = ("alarm 3 0x7500", file("control-same-words", "alarm 3 0x7500"));
    let uri = format!("sim:?clock=virtual&script={}", line.display());
    let Err(LinkError::Script(ScriptError::Line { column, message, .. })) = link::open(&uri, Share::ByName).map(drop)
    else {
        panic!("the script is wrong, too")
    };
    assert_eq!(
        place.inject(text).unwrap_err().to_string(),
        format!("column {column}: {message}; see `ecmsk link help`")
    );
}

/// On a virtual clock nothing happens before the program lets a cycle pass; an event whose client goes is taken back.
#[test]
fn an_event_waits_for_a_cycle_and_is_taken_back_with_its_client() {
    let place = Place::new();
    let mut client = place.client("", "");
    client.op();
    let mut injection = place.inject("alarm 1 0x7500").expect("it waits");
    let soon = Duration::from_millis(30);
    assert!(matches!(injection.wait(soon), Err(ControlError::Unanswered(limit)) if limit == soon));
    drop(injection);
    // The next client is served when the board has noticed that.
    place.happens(&mut client, "alarm 2 0x5441");
    for _ in 0..10 {
        client.read();
    }
    assert_eq!((error_code(&client, 1), error_code(&client, 2)), (0, 0x5441));
}

/// 64 events with `for` may be in force; a further one is refused until one has ended.
#[test]
fn events_that_last_are_limited() {
    let place = Place::new();
    let mut client = place.client("", "");
    for _ in 0..64 {
        place.happens(&mut client, "sdo-delay 1 1ms for 200ms");
    }
    let mut injection = place.inject("cut 2 for 1s").expect("it waits");
    client.link.pass(Duration::from_millis(1)).expect("a cycle");
    let error = injection.wait(LIMIT).unwrap_err().to_string();
    assert_eq!(error, "64 events with `for` are in force; end one with `end VERB`");
    client.link.pass(Duration::from_millis(300)).expect("they end");
    place.happens(&mut client, "cut 2 for 1s");
}

/// A cycle that carries an event out allocates nothing.
#[test]
fn a_cycle_with_an_event_allocates_nothing() {
    let place = Place::new();
    let client = place.client("", "");
    let pass = || {
        let pass = || client.link.pass(Duration::from_millis(40)).expect("it passes");
        allocation_counter::measure(|| _ = pass()).count_total
    };
    let (_, idle) = (pass(), pass());
    for event in ["silent for 5ms", "cut 2 for 5ms", "inputs 0x15"] {
        let mut injection = place.inject(event).expect(event);
        assert_eq!(pass(), idle, "{event}");
        injection.wait(LIMIT).expect(event);
    }
}

/// The socket is its owner's alone, and goes with the link; a socket that a killed program has left is replaced, another file
/// is not, and two boards need two sockets.
#[test]
fn the_socket_is_there_while_the_board_is_open() {
    let place = Place::new();
    drop(UnixListener::bind(place.path()).expect("a socket"));
    let client = place.client("", "");
    let mode = fs::metadata(place.path()).expect("a socket").permissions().mode();
    assert_eq!(mode & 0o777, 0o600);
    let uri = format!("sim:?clock=virtual&control={}", place.name());
    let refused = |uri: &str| link::open(uri, Share::ByName).map(drop).unwrap_err().to_string();
    assert!(
        refused(&uri).ends_with("somebody listens there; another board has this control=, give each its own"),
        "{}",
        refused(&uri)
    );
    let mut waiting = place.inject("inputs 1").expect("it waits");
    client.link.close();
    assert_eq!(waiting.wait(LIMIT).unwrap_err().to_string(), "the board was closed before it happened");
    assert!(!place.path().exists());
    fs::write(place.path(), "a text").expect("a file");
    assert!(refused(&uri).ends_with("there is a file, which stays as it is; name another path"), "{}", refused(&uri));
    assert_eq!(fs::read_to_string(place.path()).expect("the file"), "a text");
    let client = Client::stepped("control-none", "");
    assert!(matches!(place.inject("inputs 1"), Err(ControlError::NotRunning { .. })));
    drop(client);
}

/// A link that cannot listen leaves its board as it was: the next one gets it.
#[test]
fn a_link_that_cannot_listen_changes_nothing() {
    let place = Place::new();
    let uri = format!("sim:?clock=virtual&name=kept&control={}", place.name());
    let mut report = ecmsk::sk::Frame::new();
    let link = link::open(&uri, Share::ByName).expect("it opens");
    let at = link.read(&mut report, link::Wait::Forever).expect("a report").at;
    link.close();
    fs::write(place.path(), "").expect("a file");
    link::open(&uri, Share::ByName).map(drop).expect_err("there is a file");
    fs::remove_file(place.path()).expect("a file");
    let link = link::open(&uri, Share::ByName).expect("the board is not in use");
    assert!(link.info().opened_at >= at, "it is the same board");
}

/// A name is a socket in a folder of the user's; it says which boards there are.
#[test]
fn a_name_is_a_file_in_the_run_folder() {
    let named = place("press").expect("a place");
    assert!(named.is_absolute() && named.ends_with("press.control"), "{}", named.display());
    assert_eq!(place("./press").expect("a path"), Path::new("./press"));
    for wrong in ["", ".hidden", "a b", "ä", &"x".repeat(65)] {
        assert!(matches!(place(wrong), Err(ControlError::Name(_))), "{wrong}");
    }
    let mode = fs::metadata(named.parent().expect("a folder")).expect("it is there").permissions().mode();
    assert_eq!(mode & 0o022, 0, "nobody else writes to it");
    let name = format!("test-{}", std::process::id());
    let mut client = Client::open("control-named", &format!("clock=virtual&control={name}"), "");
    let other = Injection::begin("no-such-board", "inputs 1").unwrap_err().to_string();
    assert!(other.starts_with("no board `no-such-board` is running, but ") && other.contains(&name), "{other}");
    let mut injection = Injection::begin(&name, "inputs 0x15").expect("it waits");
    client.read();
    injection.wait(LIMIT).expect("it happens");
}

/// On the real clock an event happens by itself; behind a modelled chip, too.
#[test]
fn an_event_happens_on_the_real_clock() {
    let place = Place::new();
    for scheme in ["sim", "xf-sim"] {
        let uri = format!("{scheme}:?control={}", place.name());
        let link = link::open(&uri, Share::ByName).unwrap_or_else(|error| panic!("{uri}: {error}"));
        let mut last = None;
        for event in ["inputs 1", "alarm 1 0x7500"] {
            let happened = place.inject(event).expect("it waits").wait(LIMIT).expect("it happens");
            assert!(Some(happened.cycle) > last);
            last = Some(happened.cycle);
        }
        link.close();
    }
}

/// A chip without a board has no control socket.
#[test]
fn a_chip_has_none() {
    let error = link::chip::open("xf-sim:?control=press").map(drop).unwrap_err().to_string();
    assert!(error.contains("key `control` does not take `press`") && error.contains("script="), "{error}");
}

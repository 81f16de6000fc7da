//! Servers as services: they report to systemd when they are ready, live and end (sd_notify), and a service manager that does
//! not read holds nothing up. Their log, and what they read again on SIGHUP.
#![cfg(target_os = "linux")]

use std::io::ErrorKind;
use std::net::TcpStream;
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::net::UnixDatagram;
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::common::serving::Serving;
use crate::common::{Ran, ecmsk, json_lines, with_default_signals, without_times};
use ecmsk::link::{self, Share};
use rustix::process::Signal;
use support::tcp::{connect, until, uri};

/// `ecmsk serve tcp` of this link, which reports to `socket` as its service manager.
fn serve(socket: &Path, link: &str) -> Command {
    let mut command = ecmsk(["serve", "tcp", "--listen", "127.0.0.1:0", "--link", link]);
    command.env("NOTIFY_SOCKET", socket).env_remove("ECMSK_TCP_SECRET").env_remove("WATCHDOG_PID");
    command
}

/// A server tells its service manager that it is ready once it serves, with the line that it prints.
#[test]
fn a_service_is_ready_when_it_serves() {
    let folder = tempfile::tempdir().expect("a folder");
    let socket = folder.path().join("notify");
    let manager = UnixDatagram::bind(&socket).expect("a socket");
    manager.set_read_timeout(Some(Duration::from_secs(60))).expect("a time");
    let serving = Serving::by(serve(&socket, "sim:?slaves=drive"));
    let mut message = [0; 1000];
    let len = manager.recv(&mut message).expect("it reports");
    let text = String::from_utf8_lossy(&message[..len]).into_owned();
    assert_eq!(text, format!("READY=1\nSTATUS=listening on {}", serving.first_line));
    serving.end();
}

/// A server does not wait for a service manager that reads nothing or does not exist: it serves, and a signal ends it.
#[test]
fn a_service_manager_that_does_not_read_holds_nothing_up() {
    let folder = tempfile::tempdir().expect("a folder");
    let socket = folder.path().join("notify");
    let _deaf = UnixDatagram::bind(&socket).expect("a socket");
    let filler = UnixDatagram::unbound().expect("a socket");
    filler.set_nonblocking(true).expect("it may");
    while filler.send_to(b"full", &socket).is_ok() {}
    let serving = Serving::by(serve(&socket, "sim:?slaves=drive"));
    assert!(serving.first_line.starts_with("127.0.0.1:"), "{}", serving.first_line);
    serving.end();
    let said = Serving::by(serve(&folder.path().join("nobody"), "sim:?slaves=drive")).end();
    assert!(said.contains("warning: systemd does not know that the server is ready"), "{said}");
}

/// A service manager, as systemd is one, and what it has been told.
struct Manager {
    socket: UnixDatagram,
    _folder: tempfile::TempDir,
    path: PathBuf,
}

impl Manager {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("notify");
        let socket = UnixDatagram::bind(&path).expect("a socket");
        Self { socket, path, _folder: folder }
    }

    /// The next report that comes within this time; `None`: none comes.
    fn next(&self, limit: Duration) -> Option<String> {
        self.socket.set_read_timeout(Some(limit)).expect("a time");
        let mut message = [0; 1000];
        match self.socket.recv(&mut message) {
            Ok(len) => Some(String::from_utf8_lossy(&message[..len]).into_owned()),
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => None,
            Err(error) => panic!("{error}"),
        }
    }

    /// Waits for a report with these words.
    #[track_caller]
    fn wait_for(&self, words: &str) -> String {
        let began = Instant::now();
        while began.elapsed() < support::tcp::LIMIT {
            if let Some(report) = self.next(Duration::from_secs(1)).filter(|report| report.contains(words)) {
                return report;
            }
        }
        panic!("no report with `{words}`");
    }

    /// `ecmsk serve tcp` as this manager's service, with this time for its pings.
    fn service(&self, link: &str, watchdog: Option<Duration>) -> Command {
        let mut command = serve(&self.path, link);
        command.envs(watchdog.map(|limit| ("WATCHDOG_USEC", limit.as_micros().to_string())));
        command
    }

    fn serve(&self, link: &str, watchdog: Option<Duration>) -> Serving {
        Serving::by(self.service(link, watchdog))
    }
}

/// TOOL-201 A service is ready when its board is open and its port listens, and not before: one whose board does not open is never
/// ready. It says when it ends.
#[test]
fn a_service_says_when_it_begins_and_ends() {
    let manager = Manager::new();
    let serving = manager.serve("sim:?slaves=drive", None);
    let ready = format!("READY=1\nSTATUS=listening on {}", serving.first_line);
    assert_eq!(manager.next(support::tcp::LIMIT), Some(ready));
    TcpStream::connect(serving.address()).expect("it listens");
    assert_eq!(manager.next(Duration::from_millis(600)), None, "without a watchdog it says no more");
    serving.end();
    assert_eq!(manager.next(Duration::from_secs(1)).as_deref(), Some("STOPPING=1\n"));

    let ran = Ran::from(manager.service("tcp://127.0.0.1:1", None).output().expect("the tool starts"));
    assert_eq!((ran.code, &*ran.out), (Some(1), ""));
    assert_eq!(manager.next(Duration::from_millis(100)), None);
}

/// TOOL-201 A service sends pings while the cycle of its board runs. If its board stands still the pings end, and the status says why;
/// they go on when it goes on.
#[test]
fn a_board_that_stands_still_gets_no_pings() {
    const WATCHDOG: Duration = Duration::from_secs(3);
    let manager = Manager::new();
    let own = manager.serve("sim:?slaves=drive", Some(WATCHDOG));
    for _ in 0..3 {
        manager.wait_for("WATCHDOG=1");
    }
    own.end();
    manager.wait_for("STOPPING=1");

    // A board at another server, which stands still as a whole. With this keep-alive time the link does not end for it.
    let upstream = Manager::new().serve("sim:?slaves=drive", None);
    let link = format!("{}?keepalive_ms=3600000", upstream.link());
    let serving = manager.serve(&link, Some(WATCHDOG));
    for _ in 0..3 {
        manager.wait_for("WATCHDOG=1");
    }
    upstream.signal(Signal::STOP);
    // Pings that were due before are still there, and reports that were under way. systemd would end the service after this
    // silence.
    let began = Instant::now();
    let mut silent_since = Instant::now();
    while silent_since.elapsed() < WATCHDOG {
        assert!(began.elapsed() < support::tcp::LIMIT, "the pings go on");
        if manager.next(Duration::from_millis(500)).is_some_and(|report| report.contains("WATCHDOG=1")) {
            silent_since = Instant::now();
        }
    }
    upstream.signal(Signal::CONT);
    manager.wait_for("WATCHDOG=1");
    serving.end();
    upstream.end();
}

/// TOOL-202 A server that is started, and one that is started again after it was killed, sends no frame to its board: what stood still
/// stands still (docs/SAFETY.md).
#[test]
fn a_start_moves_nothing() {
    let (server, _told) = support::tcp::serve("sim:?slaves=drive*2");
    let upstream = uri(&server, "");
    let writer = ecmsk::Ecm::open(&upstream).expect("a board");
    writer.configure(&ecmsk::ecm::Config::drives(2)).expect("drives");
    writer.set_state(ecmsk::sk::MasterState::Op).expect("OP");
    writer.servo_on(&[1, 2]).expect("they switch on");
    writer.close(ecmsk::ecm::Close::Leave).expect("it closes");
    let reader = connect(&server, "role=reader");
    let frames = || reader.stats().board.expect("a simulated board has counters").frames;
    let manager = Manager::new();
    for _ in 0..2 {
        // The upstream server may have stopped the axes of the writer that was killed, which takes some frames.
        let before = until("rest", || {
            let before = frames();
            std::thread::sleep(Duration::from_millis(300));
            (frames() == before).then_some(before)
        });
        let _serving = until("place for a writer", || {
            let mut command = manager.service(&upstream, None);
            let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the tool starts");
            Serving::try_of(child).ok()
        });
        manager.wait_for("READY=1");
        let mut report = ecmsk::sk::Frame::new();
        for _ in 0..50 {
            reader.read(&mut report, link::Wait::For(support::tcp::LIMIT)).expect("a report");
        }
        let drive = ecmsk::sk::DriveResponse::decode(&report.slot(support::tcp::SIZE, 1));
        assert!(drive.statusword.is_enabled() && drive.position == 0, "{drive:?}");
        assert_eq!(frames(), before, "the start has sent a frame");
    }
}

/// Without a terminal SIGHUP has the server read its secret again, while board and clients stay. A file that is no secret
/// changes nothing. Other servers say that there is nothing to read.
#[test]
fn a_service_reads_its_secret_again() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("secret");
    let write = |path: &Path, text: &str| {
        std::fs::write(path, text).expect("a file");
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o600)).expect("it may");
    };
    let (old, new) = ("0123456789abcdefghijklmnopqrstuvwxyz", "zyxwvutsrqponmlkjihgfedcba9876543210");
    write(&file, old);
    let mine = folder.path().join("mine");
    write(&mine, old);
    let name = file.to_str().expect("UTF-8");
    let mut server = serve_without_terminal(&["tcp", "--link", "sim:?slaves=drive", "--secret-file", name]);
    let uri = format!("{}?role=reader&secret_file={}", server.link(), mine.display());
    let open = || link::open(&uri, Share::ByName);
    let client = open().expect("the old secret");

    write(&file, new);
    server.signal(Signal::HUP);
    server.wait_for("the secret was read again");
    let refused = until("an answer", || open().err());
    assert!(refused.to_string().contains("secret"), "{refused}");
    write(&mine, new);
    open().expect("the new secret").close();
    client.read(&mut ecmsk::sk::Frame::new(), link::Wait::For(support::tcp::LIMIT)).expect("the old client stays");

    write(&file, "short");
    server.signal(Signal::HUP);
    server.wait_for("the secret stays as it was");
    open().expect("the new secret is still the one").close();
    server.end();

    let mut server = serve_without_terminal(&["usbip", "--link", "sim:?slaves=drive"]);
    server.signal(Signal::HUP);
    server.wait_for("nothing is read again");
    server.end();
}

/// A server that has no terminal, as a service.
fn serve_without_terminal(arguments: &[&str]) -> Serving {
    let mut command = with_default_signals(&ecmsk([&["serve"], arguments, &["--listen", "127.0.0.1:0"]].concat()));
    command.env_remove("ECMSK_TCP_SECRET");
    // SAFETY: the call between fork and exec is one system call.
    unsafe {
        command.pre_exec(|| rustix::process::setsid().map(drop).map_err(Into::into));
    }
    Serving::by(command)
}

/// The log of a server has the time; in systemd's journal, which has its own, it has not. With `--log-format json` each line is an
/// object with time, level and message, records of ECMSK_LOG too.
#[test]
fn the_log_has_the_time_or_is_json() {
    let said = |arguments: &[&str], variables: &[(&str, &str)]| {
        let mut command = ecmsk([&["serve", "tcp", "--listen", "127.0.0.1:0"], arguments].concat());
        command.env_remove("ECMSK_TCP_SECRET").envs(variables.iter().copied());
        let serving = Serving::by(command);
        link::open(&serving.link(), Share::ByName).expect("a board").close();
        serving.end()
    };
    let link = ["--link", "sim:?slaves=drive"];
    let plain = without_times(&said(&link, &[]));
    assert!(
        plain.lines().all(|line| line.starts_with("serve: ")) && plain.contains("serve: stopped by SIGTERM\n"),
        "{plain}"
    );
    let journal = said(&link, &[("JOURNAL_STREAM", "8:1")]);
    assert!(journal.lines().all(|line| line.starts_with("serve: ")), "{journal}");

    let arguments = [&link[..], &["--log-format", "json"]].concat();
    let lines = json_lines(&said(&arguments, &[("ECMSK_LOG", "trace")]));
    for line in &lines {
        let time = line["time"].as_str().expect("a time");
        assert!(time.starts_with("20") && time.ends_with('Z') && line["level"].is_string(), "{line}");
        assert!(line["message"].as_str().is_some_and(|message| !message.is_empty()), "{line}");
    }
    let has = |kind: &str, words: &str| {
        lines
            .iter()
            .any(|line| line["kind"] == kind && line["message"].as_str().is_some_and(|message| message.contains(words)))
    };
    assert!(has("serve", "is a writer") && has("serve", "stopped by SIGTERM"), "{lines:?}");
}

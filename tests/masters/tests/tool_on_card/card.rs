//! Running the tool on a network card, and its reports about the card.

use std::io::{BufRead, BufReader, Write};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use ecmsk::bus::{self, Network};
use masters::{MASTER, Rig};
use serde_json::Value;

pub const CARD: &str = "nic:veth0";
pub const LIST: &str = "drive*2,io";

/// The result of a run of the tool.
#[derive(Debug)]
pub struct Ran {
    pub code: Option<i32>,
    pub out: String,
    pub err: String,
}

impl Ran {
    /// The output of a successful run.
    #[track_caller]
    pub fn good(self) -> String {
        assert_eq!(self.code, Some(0), "{self:?}");
        self.out
    }

    /// The lines of its output as JSON.
    #[track_caller]
    pub fn lines(&self) -> Vec<Value> {
        self.out.lines().map(|line| serde_json::from_str(line).unwrap_or_else(|_| panic!("{self:?}"))).collect()
    }

    /// Asserts that it failed with that code, printed no result, and that its last line contains these parts.
    #[track_caller]
    pub fn fails(&self, code: i32, parts: &[&str]) {
        assert_eq!((self.code, self.out.as_str()), (Some(code), ""), "{self:?}");
        let error = self.err.lines().rfind(|line| line.starts_with("error: ")).unwrap_or_else(|| panic!("{self:?}"));
        assert!(parts.iter().all(|part| error.contains(part)), "{parts:?} in {error}");
    }
}

/// The tool in this thread's network, in an environment that names no link.
pub fn tool(words: &[&str]) -> Command {
    support::tool_without_link(words)
}

pub fn run(words: &[&str]) -> Ran {
    ended(&mut tool(words))
}

pub fn ended(tool: &mut Command) -> Ran {
    let ended = support::run(tool);
    Ran { code: ended.status.code(), out: ended.stdout, err: ended.stderr }
}

/// Starts it with pipes for what it says.
pub fn started(command: &mut Command) -> Child {
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it starts")
}

/// Waits for its first line with that on standard output or standard error.
pub fn until(from: &mut impl BufRead, what: &str) {
    let mut said = String::new();
    while !said.contains(what) {
        assert!(from.read_line(&mut said).expect("text") > 0, "never: {what} in {said}");
    }
}

/// Waits until it ends by itself.
pub fn ends(mut child: Child, mut err: impl BufRead) -> Ran {
    let began = Instant::now();
    let code = loop {
        if let Some(status) = child.try_wait().expect("it is ours") {
            break status.code();
        }
        if began.elapsed() > Duration::from_secs(60) {
            child.kill().expect("it is ours");
            panic!("it goes on");
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    let mut text = String::new();
    std::io::Read::read_to_string(&mut err, &mut text).expect("text");
    Ran { code, out: String::new(), err: text }
}

/// `ecmsk bus` on the card.
pub fn look(words: &[&str]) -> Ran {
    run(&[&["bus"], words, &["--link", CARD]].concat())
}

/// Runs the tool again if slaves of a busy machine have answered too late, which it says as for a cable that is cut.
pub fn in_time(run: impl Fn() -> Ran) -> Ran {
    const TRIES: usize = 10;
    let is_late = |ran: &Ran| ran.out.contains("did not answer") || ran.err.contains("did not answer");
    let mut ran = run();
    for _ in 1..TRIES {
        if !is_late(&ran) {
            break;
        }
        ran = run();
    }
    ran
}

/// A file of the test's own.
pub fn file(name: &str) -> PathBuf {
    support::out_dir().join(name)
}

/// Uses the library on the card, between two runs of the tool.
pub fn by_library<T>(ask: impl FnOnce(&mut dyn Network) -> Result<T, bus::BusError>) -> T {
    let mut network = bus::open(CARD).expect("it opens");
    network.scan().expect("slaves");
    ask(&mut *network).expect("an answer")
}

/// The card in the output of `list`, in words and as JSON.
pub fn listed() -> (String, Value) {
    let (text, lines) = (run(&["list"]), run(&["list", "--json"]));
    assert_eq!(text.code, lines.code);
    let row = lines.lines().into_iter().find(|row| row["path"] == MASTER).expect("it is listed");
    (text.out, row)
}

/// The findings of `doctor` for a link. Checks that the exit code shows whether one of them is wrong.
pub fn doctor(link: &str) -> Vec<Value> {
    let ran = ended(tool(&["doctor", "--json"]).env("ECMSK_LINK", link));
    let findings = ran.lines();
    let is_wrong = findings.iter().any(|finding| finding["state"] == "wrong");
    assert_eq!(ran.code, Some(i32::from(is_wrong)), "{ran:?}");
    findings
}

pub fn finding<'a>(findings: &'a [Value], check: &str) -> Option<&'a Value> {
    findings.iter().find(|finding| finding["check"] == check)
}

/// A shell of the tool on the card, with an enabled drive.
pub struct InOp(Child);

impl InOp {
    pub fn start() -> Self {
        let mut shell = tool(&["shell", "--up", "--slaves", LIST, "--link", "nic:veth0?priority=20"]);
        let mut shell = shell.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().expect("it");
        shell.stdin.as_mut().expect("a pipe").write_all(b"servo on 1\n").expect("it reads");
        let mut line = String::new();
        BufReader::new(shell.stdout.as_mut().expect("a pipe")).read_line(&mut line).expect("it says something");
        assert!(line.starts_with("axis 1: on"), "{line}");
        Self(shell)
    }

    pub fn kill(mut self) {
        self.0.kill().expect("it runs");
        self.0.wait().expect("it ends");
    }
}

/// Waits for a line of the server.
pub fn wait_for(rig: &Rig, what: &str) {
    let begin = Instant::now();
    while !rig.said().iter().any(|line| line.contains(what)) {
        assert!(begin.elapsed() < Duration::from_secs(60), "never: {what}; {:?}", rig.said());
        std::thread::sleep(Duration::from_millis(5));
    }
}

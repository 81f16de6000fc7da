//! Connects masters of other projects with simulated slaves: a network namespace with a pair of virtual interfaces, the
//! slaves at one end, the master, a program or a crate, at the other.
#![cfg(target_os = "linux")]

mod elsewhere;
mod middle;
pub mod motion;
mod odd;

use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;

use ecmsk::engine::{RealTime, Script as _};
use ecmsk::link::script::Script;
use ecmsk::link::simulated_slaves;
use ecmsk::link::slaves::{self, SlaveSpec};
use ecmsk::port::ethercat::{Options, Server};
use nix::sched::{CloneFlags, unshare};
use parking_lot::Mutex;

pub use elsewhere::Elsewhere;
pub use middle::{Middle, Trouble};
pub use odd::OddRig;

/// The interface of the master.
pub const MASTER: &str = "veth0";
/// The interface of the slaves.
pub const SLAVES: &str = "veth1";
/// The second interface of the master of a ring.
pub const SECOND_MASTER: &str = "veth2";
/// The second interface of the slaves of a ring.
pub const SECOND_SLAVES: &str = "veth3";
/// The version of pysoem, as `xtask/src/wheel.rs` has it.
const PYSOEM: &str = "pysoem-1.1.13.d";

/// Slaves that are served in a network namespace of the calling thread.
pub struct Rig {
    server: Server,
    slaves: Vec<SlaveSpec>,
    said: Arc<Mutex<Vec<String>>>,
    /// The file with the recorded frames.
    pub recording: PathBuf,
}

impl Rig {
    /// Moves this thread into a network namespace of its own and serves the slaves of the list there. The frames are recorded
    /// to a file of that name.
    ///
    /// # Panics
    /// The system or the server refuses something.
    pub fn new(list: &str, name: &str) -> Self {
        Self::with_drift(list, name, 0)
    }

    /// The same with crystals that are up to that many parts per million too fast or too slow.
    ///
    /// # Panics
    /// As [`Self::new`].
    pub fn with_drift(list: &str, name: &str, drift_ppm: u16) -> Self {
        enter_namespace();
        make_pair(MASTER, SLAVES);
        Self::serve(list, name, drift_ppm, None, None)
    }

    /// The same slaves with a script of faults, as `ecmsk serve ethercat --script` has it.
    ///
    /// # Panics
    /// As [`Self::new`], or they are no lines of a script.
    pub fn with_script(list: &str, name: &str, lines: &str) -> Self {
        enter_namespace();
        make_pair(MASTER, SLAVES);
        let script = support::out_dir().join(format!("{name}.ecmscript"));
        std::fs::write(&script, lines).expect("a file in the target folder");
        Self::serve(list, name, 0, None, Some(script))
    }

    /// The same slaves with a second pair of interfaces at the other end of their cable.
    ///
    /// # Panics
    /// As [`Self::new`].
    pub fn ring(list: &str, name: &str) -> Self {
        enter_namespace();
        make_pair(MASTER, SLAVES);
        make_pair(SECOND_MASTER, SECOND_SLAVES);
        Self::serve(list, name, 0, Some(SECOND_SLAVES), None)
    }

    /// The same with a box in the middle of the cable that loses, delays and doubles frames, as the test sets.
    ///
    /// # Panics
    /// As [`Self::new`].
    pub fn with_middle(list: &str, name: &str) -> (Self, Middle) {
        enter_namespace();
        let [near, far] = middle::INTERFACES;
        make_pair(MASTER, near);
        make_pair(far, SLAVES);
        let middle = Middle::start();
        (Self::serve(list, name, 0, None, None), middle)
    }

    fn serve(list: &str, name: &str, drift_ppm: u16, second: Option<&str>, script: Option<PathBuf>) -> Self {
        let recording = support::target_dir().join("masters").join(format!("{name}.pcapng"));
        std::fs::create_dir_all(recording.parent().expect("a folder")).expect("the target folder");
        // Otherwise it would be renamed and kept.
        let _ = std::fs::remove_file(&recording);
        let slaves = slaves::parse_for_network(list).expect("a list of slaves");
        let said = Arc::new(Mutex::new(Vec::new()));
        let options = Options {
            interface: SLAVES.to_owned(),
            second: second.map(str::to_owned),
            slaves: slaves.clone(),
            drift_ppm,
            script,
            record: Some(recording.clone()),
            allow_default_route: false,
            // Masters wait some milliseconds for an answer, and the machine that runs tests may be busy with others.
            real_time: RealTime { priority: Some(10), cpu: None, lock_memory: false },
            tell: Arc::new({
                let said = Arc::clone(&said);
                move |line| said.lock().push(line.to_owned())
            }),
            failed: Arc::new(|| {}),
        };
        let server = Server::start(options).expect("the slaves are served");
        Self { server, slaves, said, recording }
    }

    /// Executes lines of a script at once.
    ///
    /// # Panics
    /// They are no lines of a script.
    pub fn happen(&self, lines: &str) {
        let script = Script::parse("the test", lines, &self.slaves).expect("lines of a script");
        let mut script = simulated_slaves::start(script, self.server.cable().clone(), 0);
        script.run(0, &mut |_| {});
        assert!(script.is_over(), "`{lines}` has a time");
    }

    /// Runs a program in Python with pysoem in the namespace, as [`Self::run`] does.
    ///
    /// # Panics
    /// The program fails.
    pub fn python(&self, program: &Path) -> String {
        let mut command = Command::new("python3");
        command.arg(program).env("PYTHONPATH", support::target_dir().join("xtask").join(PYSOEM));
        // Nothing is written beside the programs.
        self.run(command.env("PYTHONDONTWRITEBYTECODE", "1"))
    }

    /// Runs a master in the namespace. If it prints `fault: LINE`, that line of a script is executed, and the answer is
    /// an empty line. Returns its other output.
    ///
    /// # Panics
    /// The master fails.
    pub fn run(&self, command: &mut Command) -> String {
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().expect("the master starts");
        let (mut answers, lines) = (child.stdin.take().expect("a pipe"), child.stdout.take().expect("a pipe"));
        let mut printed = String::new();
        for line in BufReader::new(lines).lines() {
            let line = line.expect("text");
            match line.strip_prefix("fault: ") {
                Some(fault) => {
                    self.happen(fault);
                    answers.write_all(b"\n").expect("it waits for the answer");
                }
                None => printed = printed + &line + "\n",
            }
        }
        let ended = child.wait_with_output().expect("it ends");
        let errors = String::from_utf8_lossy(&ended.stderr);
        assert!(ended.status.success(), "{command:?}\n{printed}{errors}\n{}", self.said().join("\n"));
        printed
    }

    /// The lines of the server.
    pub fn said(&self) -> Vec<String> {
        self.server.flush();
        self.said.lock().clone()
    }

    /// Ends the server; returns its lines.
    pub fn end(self) -> Vec<String> {
        self.server.stop().expect("it has not ended by itself");
        Arc::try_unwrap(self.said).map_or_else(|said| said.lock().clone(), Mutex::into_inner)
    }
}

/// Has a recording dissected by `tshark`, which must find two packets for each frame that the server has answered, by
/// its last line, and no malformed one.
///
/// # Panics
/// It finds others.
pub fn dissect(recording: &Path, said: &[String]) {
    let packets = |filter: &str| {
        let mut tshark = Command::new("tshark");
        support::succeed(tshark.arg("-r").arg(recording).args(["-Y", filter])).lines().count()
    };
    let answered = said.last().and_then(|line| line.split(' ').next()).expect("a number");
    let answered: usize = answered.parse().expect("a number");
    assert_eq!(packets("ecat"), 2 * answered, "{}", recording.display());
    assert_eq!(packets("_ws.malformed"), 0, "{}", recording.display());
}

/// Moves this thread into a network namespace of its own.
fn enter_namespace() {
    unshare(CloneFlags::CLONE_NEWNET).expect("a network namespace: these tests run as root");
}

/// Makes a cable between two interfaces.
fn make_pair(one: &str, other: &str) {
    for arguments in [
        &["link", "add", one, "type", "veth", "peer", "name", other][..],
        &["link", "set", one, "up"],
        &["link", "set", other, "up"],
    ] {
        support::succeed(Command::new("ip").args(arguments));
    }
}

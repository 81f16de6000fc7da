//! Code that the wire tests share: the tool as a server, and `usbip`, which attaches its boards.

use std::fs::{self, File};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use ecmsk::link::Dir;
use ecmsk::recording::Recording;
use ecmsk::sk::Frame;

/// The path of the tested tool in the guest.
pub const TOOL: &str = "/rig/ecmsk";
const USBIP: &str = "/rig/usbip";

/// The server's log of clients, shown if a test fails.
const LOG: &str = "/tmp/serve.log";

/// The longest wait, for a slow guest on a busy machine.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// `ecmsk serve usbip`, until it is dropped.
pub struct Served {
    child: Child,
}

impl Served {
    /// Starts it with these links and options, and waits until it listens.
    #[track_caller]
    pub fn start(links: &[&str], options: &[&str]) -> Self {
        let mut command = Command::new(TOOL);
        command
            .args(["serve", "usbip"])
            .args(options)
            .stdout(Stdio::piped())
            .stderr(File::create(LOG).expect("/tmp is there"));
        for link in links {
            command.args(["--link", link]);
        }
        let mut child = command.spawn().expect("the tool starts");
        let mut said = BufReader::new(child.stdout.take().expect("it is a pipe"));
        let mut line = String::new();
        said.read_line(&mut line).expect("it says where it listens");
        let served = Self { child };
        assert_eq!(line, "listening on 127.0.0.1:3240\n");
        served
    }

    /// Ends it as Ctrl-C does, so that a recording is whole.
    #[track_caller]
    pub fn stop(mut self) {
        let pid = rustix::process::Pid::from_child(&self.child);
        rustix::process::kill_process(pid, rustix::process::Signal::TERM).expect("it runs");
        assert!(self.child.wait().expect("it ends").success());
    }

    /// Kills it at any moment.
    pub fn kill(mut self) {
        self.child.kill().expect("it runs");
        self.child.wait().expect("it ends");
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        // The server has ended, or a test has failed.
        let _ = self.child.kill();
        let _ = self.child.wait();
        if thread::panicking() {
            println!("{}", fs::read_to_string(LOG).unwrap_or_default());
        }
    }
}

/// Runs Debian's `usbip`.
pub fn usbip(arguments: &[&str]) -> Output {
    Command::new(USBIP).args(arguments).output().expect("usbip starts")
}

/// Attaches a board of the server and waits until the kernel shows it.
#[track_caller]
pub fn attach(bus_id: &str) -> Board {
    let before = Board::all();
    let output = usbip(&["attach", "-r", "127.0.0.1", "-b", bus_id]);
    assert!(output.status.success(), "{output:?}");
    until(&format!("{bus_id} is attached"), || Board::all().into_iter().find(|board| !before.contains(board)))
}

/// Detaches all that is attached and waits until the kernel has done it.
#[track_caller]
pub fn detach_all() {
    for port in 0..8 {
        usbip(&["detach", "-p", &port.to_string()]);
    }
    until("all is detached", || Board::all().is_empty().then_some(()));
}

/// Waits for something.
#[track_caller]
pub fn until<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let end = Instant::now() + PATIENCE;
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(Instant::now() < end, "{what}: not within {PATIENCE:?}");
        thread::sleep(Duration::from_millis(10));
    }
}

/// A board as the kernel shows it: a HID device that it gave a hidraw node.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Board {
    /// `/dev/hidraw0`.
    pub node: PathBuf,
    /// The folder of the HID device.
    pub hid: PathBuf,
    /// The folder of the USB device.
    pub usb: PathBuf,
}

impl Board {
    /// The present boards.
    pub fn all() -> Vec<Self> {
        let entries = fs::read_dir("/sys/class/hidraw").into_iter().flatten().flatten();
        let mut boards: Vec<Self> = entries.filter_map(|entry| Self::of(&entry.path())).collect();
        boards.sort_by(|a, b| a.node.cmp(&b.node));
        boards
    }

    fn of(class: &Path) -> Option<Self> {
        let hid = fs::canonicalize(class.join("device")).ok()?;
        let facts = fs::read_to_string(hid.join("uevent")).ok()?;
        facts.contains("HID_ID=0003:000016C0:000005DF\n").then_some(())?;
        // HID device, interface, USB device.
        let usb = hid.parent()?.parent()?.to_owned();
        let node = Path::new("/dev").join(class.file_name()?);
        node.exists().then_some(Self { node, hid, usb })
    }

    /// A line of sysfs below the USB device.
    #[track_caller]
    pub fn usb_says(&self, file: &str) -> String {
        let path = self.usb.join(file);
        fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display())).trim().to_owned()
    }
}

/// All frames of one direction in a recording.
#[track_caller]
pub fn recorded(file: &str, dir: Dir) -> Vec<Frame> {
    let bytes = File::open(file).expect("the recording is there");
    let recording = Recording::new(BufReader::new(bytes), file).expect("it is a recording");
    recording
        .map(|frame| frame.expect("it is whole"))
        .filter(|frame| frame.dir == dir)
        .map(|frame| *frame.frame)
        .collect()
}

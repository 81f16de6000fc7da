//! `ecmsk serve gadget`: the board at a device port. The controller is dummy_hcd, whose host is the same kernel, so that
//! FunctionFS, configfs and the kernel's USB code are all real.

use std::fs::{self, File};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::Duration;

use ecmsk::ecm::{Axis, Close, Config, Ecm, Slave, SlaveView};
use ecmsk::link::{Dir, Wait};
use ecmsk::port::usbip::Identity;
use ecmsk::port::usbip::descriptors::Descriptors;
use ecmsk::sk::{Frame, MasterCommand, MasterState, Motion, SlaveCommand, SlotSize, StateByte};
use serde_json::Value;

use super::hidraw::Hidraw;
use super::links::{frame, open, state};
use super::usbfs::Usbfs;
use support::served::{Board, PATIENCE, Served, TOOL, attach, detach_all, recorded, until};

const MODULES: &str = "/modules";
const CONTROLLER: &str = "dummy_udc.0";
const GADGETS: &str = "/sys/kernel/config/usb_gadget";
const OURS: &str = "/sys/kernel/config/usb_gadget/ecmsk-dummy_udc.0";
const LOG: &str = "/tmp/gadget.log";

/// The kernel's modules for a device port, until this is dropped.
struct Kernel {
    loaded: Vec<String>,
}

impl Kernel {
    #[track_caller]
    fn load() -> Self {
        let order = fs::read_to_string(format!("{MODULES}/gadget")).expect("the guest has the list");
        let loaded: Vec<String> = order.lines().map(str::to_owned).collect();
        // A test that has failed may have left some.
        let is_there = |module: &str| {
            let name = module.trim_end_matches(".ko").replace('-', "_");
            Path::new("/sys/module").join(name).exists()
        };
        for module in loaded.iter().filter(|module| !is_there(module)) {
            run("insmod", &[&format!("{MODULES}/{module}")]);
        }
        // It may be there from the test before.
        let _ = Command::new("mount").args(["-t", "configfs", "none", "/sys/kernel/config"]).status();
        until("there is a controller", || Path::new("/sys/class/udc").join(CONTROLLER).exists().then_some(()));
        assert!(Path::new(GADGETS).is_dir());
        Self { loaded }
    }
}

impl Drop for Kernel {
    fn drop(&mut self) {
        // As far as it goes: after a failed test something may be in use.
        let _ = Command::new("umount").arg("/sys/kernel/config").status();
        for module in self.loaded.iter().rev() {
            let _ = Command::new("rmmod").arg(module.trim_end_matches(".ko")).status();
        }
    }
}

#[track_caller]
fn run(program: &str, arguments: &[&str]) {
    let output = Command::new(program).args(arguments).output().expect("busybox has it");
    assert!(output.status.success(), "{program} {arguments:?}: {output:?}");
}

/// `ecmsk serve gadget`, until it is dropped.
struct Gadget {
    child: Child,
}

impl Gadget {
    /// Starts it and waits until the kernel shows the board to its own host.
    #[track_caller]
    fn start(link: &str, options: &[&str]) -> (Self, Board) {
        let mut command = Command::new(TOOL);
        command.args(["serve", "gadget", "--link", link]).args(options);
        command.stdout(Stdio::piped()).stderr(File::create(LOG).expect("/tmp is there"));
        let mut child = command.spawn().expect("the tool starts");
        let mut said = BufReader::new(child.stdout.take().expect("it is a pipe"));
        let mut line = String::new();
        said.read_line(&mut line).expect("it says where it is");
        let gadget = Self { child };
        assert!(line.starts_with(&format!("at the device port of {CONTROLLER}; serving sim:")), "{line}");
        (gadget, shown())
    }

    /// Ends it as Ctrl-C does.
    #[track_caller]
    fn stop(mut self) {
        let pid = rustix::process::Pid::from_child(&self.child);
        rustix::process::kill_process(pid, rustix::process::Signal::INT).expect("it runs");
        assert!(self.child.wait().expect("it ends").success());
        until("the board is gone", || Board::all().is_empty().then_some(()));
    }

    /// Ends it in the middle of whatever it does.
    fn kill(mut self) {
        self.child.kill().expect("it runs");
        self.child.wait().expect("it ends");
        until("the board is gone", || Board::all().is_empty().then_some(()));
    }
}

impl Drop for Gadget {
    fn drop(&mut self) {
        // It has ended, or a test has failed.
        let _ = self.child.kill();
        let _ = self.child.wait();
        if thread::panicking() {
            println!("{}", log());
        }
    }
}

fn log() -> String {
    fs::read_to_string(LOG).unwrap_or_default()
}

#[track_caller]
fn until_told(part: &str) {
    until(part, || log().contains(part).then_some(()));
}

#[track_caller]
fn shown() -> Board {
    until("the kernel shows the board", || Board::all().pop())
}

/// The cable between the host's port and the board. It is pulled by taking the power from the port, which both ends notice as
/// they notice a pulled cable. (`soft_connect` of the controller would not do: it starts the controller again without its
/// callbacks, in kernel 6.1, so that dummy_hcd never answers again.)
struct Cable {
    port: PathBuf,
}

impl Cable {
    #[track_caller]
    fn of(board: &Board) -> Self {
        Self { port: fs::canonicalize(board.usb.join("port")).expect("it is at a port of the root hub") }
    }

    #[track_caller]
    fn pull(&self) {
        fs::write(self.port.join("disable"), "1").expect("the kernel takes it");
        until("the kernel has removed it", || Board::all().is_empty().then_some(()));
    }

    #[track_caller]
    fn plug_in(&self) -> Board {
        fs::write(self.port.join("disable"), "0").expect("the kernel takes it");
        shown()
    }
}

/// SK-9.1, SK-9.3, SK-9.4, SK-9.5 A host gets the descriptors of every virtual board, byte for byte, from the kernel and from the
/// board itself.
#[test]
fn the_kernel_sees_the_board() {
    let _kernel = Kernel::load();
    let (gadget, board) = Gadget::start("sim:", &["--serial", "XYZ"]);
    let identity = Identity { serial: "XYZ".into(), ..Identity::default() };
    let expected = Descriptors::new(&identity).expect("a valid identity");
    let part = |kind| expected.get(kind, 0).expect("it has one").to_vec();
    let seen = fs::read(board.usb.join("descriptors")).expect("sysfs has them");
    assert_eq!(seen, [part(1), part(2)].concat());
    assert_eq!(fs::read(board.hid.join("report_descriptor")).expect("sysfs has it"), part(0x22));
    let says = |file: &str| board.usb_says(file);
    assert_eq!((says("serial"), says("speed")), ("XYZ".into(), "480".into()));
    assert_eq!((says("manufacturer"), says("product")), ("ecmsk".into(), "ECM-SK, virtual".into()));
    gadget.stop();
    assert!(!Path::new(OURS).exists() && !Path::new("/run/ecmsk/ecmsk-dummy_udc.0").exists(), "nothing is left");
}

/// `ecmsk doctor --gadget` finds nothing wrong with this kernel, before and while it serves a board; the threads between port and
/// board have the priority that was asked for.
#[test]
fn the_machine_is_checked_and_threads_have_their_priority() {
    let _kernel = Kernel::load();
    let holder = |state: &str| {
        let mut doctor = Command::new(TOOL);
        let output =
            doctor.args(["doctor", "--quick", "--json", "--gadget", "--link", "sim:"]).output().expect("it starts");
        let text = String::from_utf8(output.stdout).expect("UTF-8");
        let found = text.lines().map(|line| serde_json::from_str::<Value>(line).expect("JSON"));
        let ours: Vec<Value> =
            found.filter(|one| one["check"].as_str().is_some_and(|check| check.starts_with("gadget-"))).collect();
        assert!(ours.len() == 6 && ours.iter().all(|one| one["state"] == "ok"), "{ours:?}");
        assert!(ours.iter().any(|one| one["check"] == "gadget-holder" && one["found"] == state), "{ours:?}");
    };
    holder("free");
    let (gadget, _) = Gadget::start("sim:", &["--priority", "30"]);
    holder("ecmsk serve gadget has it: configured");
    let tasks = fs::read_dir(format!("/proc/{}/task", gadget.child.id())).expect("it runs").flatten();
    let scheduled = tasks.map(|task| {
        let says = |file: &str| fs::read_to_string(task.path().join(file)).expect("it is there");
        let (name, stat) = (says("comm").trim().to_owned(), says("stat"));
        // Fields 40 and 41 of proc(5); the name, field 2, may have spaces.
        let fields: Vec<&str> = stat.rsplit(") ").next().unwrap_or_default().split(' ').collect();
        (name, fields[37].to_owned(), fields[38].to_owned())
    });
    const FIFO: &str = "1";
    let ours: Vec<_> = scheduled.filter(|(name, ..)| name.starts_with("gadget-")).collect();
    assert!(ours.len() == 3 && ours.iter().all(|(_, priority, policy)| priority == "30" && policy == FIFO), "{ours:?}");
    gadget.stop();
}

/// SK-9.5, SK-9.8 Reports come unasked, 512 bytes long, none of them empty; frames arrive whole, once, in order.
#[test]
fn frames_and_reports_pass() {
    let _kernel = Kernel::load();
    let (gadget, shown) = Gadget::start("sim:?slaves=io&record=%2Ftmp%2Fgadget.pcapng", &[]);
    let board = Hidraw::open(&shown);
    let mut sent = Vec::new();
    for number in 0..500_u32 {
        let mut frame = Frame::new();
        frame.bytes_mut()[16..20].copy_from_slice(&number.to_le_bytes());
        frame.bytes_mut()[504..512].copy_from_slice(&[number as u8; 8]);
        assert_eq!(board.put(frame.bytes()).expect("the board takes it"), 513);
        sent.push(frame);
        if number % 7 == 0 {
            let report = board.get(PATIENCE).expect("the board is there").expect("a report");
            assert_eq!(
                (report.len(), state(&Frame::from_prefix(&report))),
                (512, StateByte::reached(MasterState::PreOp))
            );
        }
    }
    drop(board);
    gadget.stop();
    let arrived = recorded("/tmp/gadget.pcapng", Dir::Write);
    assert!(arrived == sent, "{} of {}", arrived.len(), sent.len());
}

/// The link `usb:` and an unchanged program have the board as they have it over USB/IP.
#[test]
fn links_and_programs_have_the_board() {
    let _kernel = Kernel::load();
    let (gadget, _) = Gadget::start("sim:?slaves=drive*2&rate=0.1&record=%2Ftmp%2Fserved.pcapng", &[]);
    let board = open("usb:?slot=12");
    board.write(&frame(MasterCommand::SetState(MasterState::PreOp)), Wait::For(PATIENCE)).expect("it takes it");
    let mut report = Frame::new();
    let sequences: Vec<u64> =
        (0..10).map(|_| board.read(&mut report, Wait::For(PATIENCE)).expect("a report").sequence).collect();
    assert_eq!(sequences, (0..10).collect::<Vec<_>>());
    board.close();
    gadget.stop();

    let (gadget, _) = Gadget::start("sim:?slaves=drive*2&rate=0.1&record=%2Ftmp%2Fgadget-program.pcapng", &[]);
    let mut program = Command::new("/rig/examples/two_axes_12b");
    program.env("LD_LIBRARY_PATH", "/rig/ours").env("ECMSK_LINK", "usb:?record=%2Ftmp%2Fgadget-host.pcapng");
    let output = program.output().expect("it starts");
    assert!(
        output.status.success() && String::from_utf8_lossy(&output.stdout).contains("commands lost: 0\n"),
        "{output:?}"
    );
    gadget.stop();
    let [sent, arrived] =
        ["/tmp/gadget-host.pcapng", "/tmp/gadget-program.pcapng"].map(|file| recorded(file, Dir::Write));
    assert!(arrived == sent && sent.len() > 500, "{} of {}", arrived.len(), sent.len());
}

/// A request, and what the host gets: bytes, or the number of the error.
type Asked = ([u8; 8], Result<Vec<u8>, Option<i32>>);

/// What a host asks on endpoint 0.
fn transcript(board: &Board) -> Vec<Asked> {
    let host = Usbfs::open(board);
    let report = [0; 512];
    let requests: [([u8; 8], &[u8]); 19] = [
        // Descriptors: device, configuration, texts, report, HID; whole, in part, and what is not there.
        ([0x80, 6, 0, 1, 0, 0, 18, 0], &[]),
        ([0x80, 6, 0, 1, 0, 0, 8, 0], &[]),
        ([0x80, 6, 0, 2, 0, 0, 0xFF, 0], &[]),
        ([0x80, 6, 0, 3, 0, 0, 0xFF, 0], &[]),
        ([0x80, 6, 3, 3, 9, 4, 0xFF, 0], &[]),
        ([0x80, 6, 0xEE, 3, 0, 0, 18, 0], &[]),
        ([0x81, 6, 0, 0x22, 0, 0, 0x5A, 0], &[]),
        ([0x81, 6, 0, 0x21, 0, 0, 9, 0], &[]),
        ([0x81, 6, 0, 0x23, 0, 0, 9, 0], &[]),
        // Configuration and interface.
        ([0x80, 8, 0, 0, 0, 0, 1, 0], &[]),
        ([0x81, 10, 0, 0, 0, 0, 1, 0], &[]),
        // GET_IDLE, SET_IDLE, GET_IDLE.
        ([0xA1, 2, 0, 0, 0, 0, 1, 0], &[]),
        ([0x21, 10, 0, 125, 0, 0, 0, 0], &[]),
        ([0xA1, 2, 0, 0, 0, 0, 1, 0], &[]),
        // GET_REPORT of a feature, with an id; SET_REPORT that is too short, and whole; GET_PROTOCOL; of a maker.
        ([0xA1, 1, 0, 3, 0, 0, 0, 2], &[]),
        ([0x21, 9, 0, 2, 0, 0, 0xF8, 1], &report[..504]),
        ([0x21, 9, 0, 2, 0, 0, 0, 2], &report),
        ([0xA1, 3, 0, 0, 0, 0, 1, 0], &[]),
        ([0xC0, 1, 0, 0, 0, 0, 4, 0], &[]),
    ];
    let ask = |(setup, data): ([u8; 8], &[u8])| {
        (setup, host.control(setup, data, PATIENCE).map_err(|error| error.raw_os_error()))
    };
    let told: Vec<_> = requests.into_iter().map(ask).collect();
    // GET_REPORT has the length that was asked for; what is in it is the board's.
    for (length, low, high) in [(512, 0, 2), (4, 4, 0)] {
        let report = host.control([0xA1, 1, 0, 1, 0, 0, low, high], &[], PATIENCE).expect("a report");
        assert_eq!(report.len(), length);
    }
    told
}

/// Endpoint 0 at the device port answers what it answers over USB/IP.
#[test]
fn requests_are_answered_as_over_usbip() {
    let served = Served::start(&["sim:?slaves=io"], &[]);
    let over_usbip = transcript(&attach("1-1"));
    detach_all();
    served.stop();
    let _kernel = Kernel::load();
    let (gadget, board) = Gadget::start("sim:?slaves=io", &[]);
    let at_the_port = transcript(&board);
    for (usbip, port) in over_usbip.iter().zip(&at_the_port) {
        assert_eq!(usbip, port);
    }
    gadget.stop();
}

/// SK-9.7 A short packet hangs the board until it is plugged in again.
#[test]
fn a_short_packet_hangs_the_board() {
    let _kernel = Kernel::load();
    let (gadget, shown_first) = Gadget::start("sim:?slaves=io", &[]);
    let board = Hidraw::open(&shown_first);
    assert!(board.get(PATIENCE).expect("it is there").is_some());
    assert_eq!(board.put(&[0; 504]).expect("the packet itself is taken"), 505);
    let late = (0..200).take_while(|_| board.get(Duration::from_millis(500)).expect("it is there").is_some()).count();
    assert!(late <= 64 + 2, "reports go on: {late}");
    drop(board);
    let cable = Cable::of(&shown_first);
    cable.pull();
    until_told("it hung after an OUT packet of fewer than 512 bytes");
    assert!(Hidraw::open(&cable.plug_in()).get(PATIENCE).expect("it is there").is_some());
    gadget.stop();
}

/// The cable is pulled and plugged in as often as one likes, a host may deselect the configuration, and may reset the board: it
/// is there again.
#[test]
fn hosts_come_and_go() {
    let _kernel = Kernel::load();
    let (gadget, mut board) = Gadget::start("sim:?slaves=io", &[]);
    let cable = Cable::of(&board);
    for _ in 0..3 {
        let reader = Hidraw::open(&board);
        assert!(reader.get(PATIENCE).expect("it is there").is_some());
        cable.pull();
        until("reads end with an error", || reader.get(Duration::from_millis(100)).err());
        board = cable.plug_in();
    }
    let authorized = board.usb.join("authorized");
    fs::write(&authorized, "0").expect("the kernel takes it");
    until("the host has let go of it", || Board::all().is_empty().then_some(()));
    fs::write(&authorized, "1").expect("the kernel takes it");
    let host = Usbfs::open(&shown());
    for _ in 0..3 {
        let mut report = [0; 512];
        assert_eq!(host.read(&mut report, PATIENCE).expect("a report"), 512);
        assert_eq!(host.write(&[0; 512], PATIENCE).expect("it is taken"), 512);
        host.reset().expect("it is reset");
    }
    drop(host);
    let gone = || log().matches("the host is gone, it was unplugged, or has reset the board; ").count();
    until("the server has told each of them", || (gone() >= 7).then_some(()));
    gadget.stop();
}

/// WIRE-126 A cable that is pulled while an axis runs on a velocity: the axis is brought to a standstill, and the next host finds
/// the board with an axis that stands, enabled.
#[test]
fn a_pulled_cable_stops_the_axes() {
    let _kernel = Kernel::load();
    let (gadget, shown) = Gadget::start("sim:?slaves=drive&rate=0.5", &[]);
    let config = Config { slaves: vec![Slave::Drive(Axis::CSV)], ..Config::default() };
    let ecm = Ecm::open("usb:?slot=12").expect("it opens");
    ecm.configure(&config).expect("it is set up");
    ecm.set_state(MasterState::Op).expect("it is in OP");
    ecm.servo_on(&[1]).expect("it is on");
    ecm.close(Close::Leave).expect("nothing is sent");
    let board = open("usb:?slot=12");
    for _ in 0..50 {
        let mut frame = Frame::new();
        frame.put_slave(SlotSize::Bytes12, 1, &SlaveCommand::Csv(Motion::to(100_000)).into());
        frame.fill_crc(SlotSize::Bytes12);
        board.write(&frame, Wait::For(PATIENCE)).expect("it takes it");
        board.read(&mut Frame::new(), Wait::For(PATIENCE)).expect("a report");
    }
    let cable = Cable::of(&shown);
    cable.pull();
    until_told("axes stand still after the host is gone (it was unplugged, or has reset the board)");
    drop(board);
    cable.plug_in();
    let ecm = Ecm::open("usb:?slot=12").expect("it opens again");
    ecm.adopt(&config).expect("it runs");
    let seen = || {
        let report = ecm.next_cycle(PATIENCE).expect("a report");
        let Some(SlaveView::Drive(drive)) = report.slave(1) else { panic!("{report:?}") };
        (drive.position, drive.statusword.is_enabled())
    };
    let first = seen();
    let mut later = first;
    for _ in 0..50 {
        later = seen();
    }
    assert!((later.0 - first.0).abs() < 20 && first.0 != 0 && first.1 && later.1, "{first:?} {later:?}");
    ecm.close(Close::Leave).expect("nothing is sent");
    gadget.stop();
}

/// A server that is killed takes its board from the host, and the next one mends what it has left. While one runs, another one
/// is refused. Gadgets of others are left alone.
#[test]
fn a_leftover_is_mended() {
    let _kernel = Kernel::load();
    let (gadget, _) = Gadget::start("sim:?slaves=io", &[]);
    let refused = |part: &str| {
        let mut other = Command::new(TOOL);
        let output = other.args(["serve", "gadget", "--link", "sim:?name=other"]).output().expect("the tool starts");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(1) && said.contains(part), "{output:?}");
    };
    refused("another program of ecmsk");
    gadget.kill();
    assert!(Path::new(OURS).exists(), "nobody has removed it");
    let (gadget, board) = Gadget::start("sim:?slaves=io", &[]);
    assert!(Hidraw::open(&board).get(PATIENCE).expect("it is there").is_some());
    gadget.stop();
    assert!(!Path::new(OURS).exists());

    let foreign = Path::new(GADGETS).join("foreign");
    for folder in ["", "configs/c.1", "functions/ffs.foreign"] {
        fs::create_dir(foreign.join(folder)).expect("the kernel makes it");
    }
    // It has no descriptors, so the kernel does not take it, and its folder is no obstacle.
    assert!(fs::write(foreign.join("UDC"), CONTROLLER).is_err());
    let (gadget, _) = Gadget::start("sim:?slaves=io", &[]);
    gadget.stop();
    for folder in ["configs/c.1", "functions/ffs.foreign", ""] {
        fs::remove_dir(foreign.join(folder)).expect("the kernel removes it");
    }
}

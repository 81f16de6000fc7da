//! Captures by the kernel's own monitor (usbmon) of a program on a board. They are fixtures of tests that need no guest
//! and also replay them: see tests/recordings/README.md.

use std::fs::{self, File, OpenOptions};
use std::io::{Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use ecmsk::coe::ObjectAddress;
use ecmsk::link::{self, Dir, Share, Wait};
use ecmsk::sk::{
    CycleTime, DcShift, DriveResponse, Frame, HspResponse, MasterCommand, MasterResponse, MasterState, Motion,
    SdoCommand, SdoResponse, SlaveCommand, SlaveKind, SlotSize,
};

use super::usbfs::Usbfs;
use support::served::{Board, PATIENCE, Served, attach, detach_all, recorded, until};

/// All buses. A `read` returns one event: the first 48 bytes of its header and its data (usbmon.rst, "Binary API").
const MONITOR: &str = "/dev/usbmon0";
/// The longest event.
const EVENT: usize = 64 * 1024;
/// Link type of the events of `read`: LINKTYPE_USB_LINUX.
const USB_LINUX: u32 = 189;
/// Offset of an event's time: seconds, microseconds.
const SECONDS_AT: usize = 16;
const MICROSECONDS_AT: usize = 24;

/// `O_NONBLOCK` of x86-64, the guest's architecture.
const NONBLOCK: i32 = 0o4000;

/// Captures until it is stopped.
struct Monitor {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<Vec<u8>>,
}

impl Monitor {
    fn start() -> Self {
        let mut monitor = OpenOptions::new().read(true).custom_flags(NONBLOCK).open(MONITOR).expect("usbmon is loaded");
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let thread = thread::spawn(move || {
            let mut file = pcap_header();
            let mut event = vec![0; EVENT];
            loop {
                match monitor.read(&mut event) {
                    Ok(len) => file.extend(pcap_packet(&event[..len])),
                    Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => {
                        if stopped.load(Ordering::Relaxed) {
                            return file;
                        }
                        thread::sleep(Duration::from_millis(1));
                    }
                    Err(error) => panic!("{MONITOR}: {error}"),
                }
            }
        });
        Self { stop, thread }
    }

    fn stop(self) -> Vec<u8> {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().expect("it ends")
    }
}

/// The header of a pcap file with microseconds, little endian, without a length limit.
fn pcap_header() -> Vec<u8> {
    let words = [0xA1B2_C3D4, 2 | 4 << 16, 0, 0, EVENT as u32, USB_LINUX];
    words.iter().flat_map(|word: &u32| word.to_le_bytes()).collect()
}

fn pcap_packet(event: &[u8]) -> Vec<u8> {
    let number = |at: usize| u32::from_le_bytes(event[at..at + 4].try_into().expect("four bytes"));
    let words = [number(SECONDS_AT), number(MICROSECONDS_AT), event.len() as u32, event.len() as u32];
    [&words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<_>>(), event].concat()
}

/// A program on the board: one transfer after the other, one every few milliseconds.
struct Host {
    board: Usbfs,
    size: SlotSize,
    report: Frame,
}

impl Host {
    fn open(board: &Board, size: SlotSize) -> Self {
        Self { board: Usbfs::open(board), size, report: Frame::new() }
    }

    fn write(&self, put: impl FnOnce(&mut Frame)) {
        let mut frame = Frame::new();
        put(&mut frame);
        frame.fill_crc(self.size);
        let moved = self.board.write(frame.bytes(), PATIENCE).expect("it takes it");
        assert_eq!(moved, 512);
    }

    fn until(&mut self, what: &str, every: Duration, so: impl Fn(&Frame, SlotSize) -> bool) {
        until(what, || {
            thread::sleep(every);
            let moved = self.board.read(self.report.bytes_mut(), PATIENCE).expect("a report");
            assert_eq!(moved, 512);
            so(&self.report, self.size).then_some(())
        });
    }

    fn state(&mut self, state: MasterState) {
        let size = self.size;
        self.write(|frame| frame.put_master(size, &MasterCommand::SetState(state)));
        self.until("the state", LOOK, |report, size| board(report, size).state.state() == Some(state));
    }
}

/// The interval at which the program polls while it waits for the network.
const LOOK: Duration = Duration::from_millis(5);
/// Targets of both axes.
const TARGETS: i32 = 12;

fn board(report: &Frame, size: SlotSize) -> MasterResponse {
    MasterResponse::decode(&report.slot(size, 0))
}

fn drive(report: &Frame, size: SlotSize) -> DriveResponse {
    DriveResponse::decode(&report.slot(size, 1))
}

fn hsp(report: &Frame, size: SlotSize) -> HspResponse {
    HspResponse::decode(&report.slot(size, 2), size)
}

/// A drive, a pulse module and an IO slave are brought to OP and moved a little.
fn program(host: &mut Host) {
    let size = host.size;
    let mut kinds = [SlaveKind::None; 8];
    kinds[..3].copy_from_slice(&[SlaveKind::Drive, SlaveKind::Hsp, SlaveKind::Io]);
    host.until("a report", LOOK, |_, _| true);
    host.write(|frame| frame.put_master(size, &MasterCommand::SetAxis { group: 0, kinds }));
    let cycle = CycleTime::from_us(1000).expect("a cycle");
    host.write(|frame| frame.put_master(size, &MasterCommand::SetDc { cycle, shift: DcShift::Auto }));
    let object = ObjectAddress::new(0x6502, 0);
    host.write(|frame| frame.put_sdo(size, &SdoCommand::Read { slave: 1, object }));
    host.until("the SDO", LOOK, |report, size| {
        matches!(SdoResponse::decode(&report.slot(size, size.sdo_slot())), SdoResponse::Done { .. })
    });
    host.state(MasterState::Op);
    host.write(|frame| {
        for slave in 1..=2 {
            frame.put_slave(size, slave, &SlaveCommand::ServoOn.into());
        }
    });
    host.until("servo on", LOOK, |report, size| {
        drive(report, size).statusword.is_enabled() && hsp(report, size).statusword.is_enabled()
    });
    let moment = Duration::from_millis(2);
    for i in 1..=TARGETS {
        host.write(|frame| {
            for (slave, target) in [(1, 10 * i), (2, -i)] {
                frame.put_slave(size, slave, &SlaveCommand::Csp(Motion::to(target)).with_index(i as u8));
            }
        });
        host.until("the target", moment, |report, size| {
            let reached = (drive(report, size).position, hsp(report, size).first.position) == (10 * i, -i);
            reached && board(report, size).fifo_free == 160
        });
    }
    host.write(|frame| frame.put_slave(size, 3, &SlaveCommand::IoWrite(0x5A5A).into()));
    host.until("the inputs", moment, |report, size| report.slot(size, 3).data1 == 0x5A5A);
    host.state(MasterState::PreOp);
}

/// A capture of the program, from before the board is plugged in.
fn capture(size: SlotSize, file: &str) -> String {
    let slot = size.bytes();
    let served = Served::start(&[&format!("sim:?slaves=drive,hsp2,io&slot={slot}")], &[]);
    let monitor = Monitor::start();
    let board = attach("1-1");
    let mut host = Host::open(&board, size);
    program(&mut host);
    drop(host);
    detach_all();
    let captured = monitor.stop();
    served.stop();
    let path = format!("/tmp/{file}");
    fs::write(&path, &captured).expect("/tmp is there");
    keep(file, &captured);
    path
}

/// Prints a file to the console, in hexadecimal digits, for `cargo xtask test --rig`.
fn keep(name: &str, bytes: &[u8]) {
    let mut console = File::options().write(true).open("/dev/console").expect("the guest has it");
    for part in bytes.chunks(2048) {
        let digits: String = part.iter().map(|byte| format!("{byte:02x}")).collect();
        writeln!(console, "\nFILE {name} {digits}").expect("it takes lines");
    }
}

fn tool(arguments: &[&str]) -> String {
    let output = Command::new("/rig/ecmsk").args(arguments).output().expect("the tool starts");
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{arguments:?}: {said}{}", String::from_utf8_lossy(&output.stderr));
    said
}

/// A capture of usbmon is read: the board, its slot size, commands and answers.
#[test]
fn a_capture_of_usbmon_is_read() {
    for (size, file) in [(SlotSize::Bytes12, "usbmon_12.pcap"), (SlotSize::Bytes16, "usbmon_16.pcap")] {
        let path = capture(size, file);
        let commands = tool(&["dump", &path, "--direction", "command"]);
        assert!(commands.contains("SET_AXIS group 0: 1 DRIVE, 2 HSP, 3 IO"), "{commands}");
        assert_eq!(commands.matches("slave 1  CSP #").count(), TARGETS as usize, "{commands}");
        let reports = tool(&["dump", &path, "--direction", "response", "--slots", "1"]);
        assert!(reports.contains(&format!("CSP #{TARGETS} DRIVE ")), "{reports}");
    }
}

/// The link `usb:` keeps eight reads pending, and cancels them when it is closed. usbmon captures exactly the frames
/// that the link has recorded, in the same order.
#[test]
fn a_capture_has_the_frames_of_the_link() {
    let served = Served::start(&["sim:?slaves=drive*2,io"], &[]);
    let monitor = Monitor::start();
    attach("1-1");
    let uri = "usb:?slot=12&record=%2Ftmp%2Fhost.pcapng";
    let board = link::open(uri, Share::ByName).unwrap_or_else(|error| panic!("{error}"));
    let mut report = Frame::new();
    for number in 0..200_u32 {
        let mut frame = Frame::new();
        if number == 100 {
            frame.put_master(SlotSize::Bytes12, &MasterCommand::SetState(MasterState::Op));
        }
        frame.bytes_mut()[504..508].copy_from_slice(&number.to_le_bytes());
        board.write(&frame, Wait::For(PATIENCE)).expect("it takes it");
        if number % 3 == 0 {
            board.read(&mut report, Wait::For(PATIENCE)).expect("a report");
        }
    }
    board.close();
    detach_all();
    fs::write("/tmp/usbmon.pcap", monitor.stop()).expect("/tmp is there");
    served.stop();
    let [sent, read] = [Dir::Write, Dir::Read].map(|dir| recorded("/tmp/host.pcapng", dir));
    assert_eq!((sent.len(), read.len()), (200, 67));
    assert!(recorded("/tmp/usbmon.pcap", Dir::Write) == sent, "other frames than were sent");
    // The link has dropped some of the unread reports.
    let mut captured = recorded("/tmp/usbmon.pcap", Dir::Read).into_iter();
    assert!(read.iter().all(|report| captured.any(|other| other == *report)), "a report that was not captured");
}

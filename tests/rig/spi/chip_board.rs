//! The link `xf-spi:` opened as a board: unchanged programs and the tool control drives behind the model of an ECM-XF,
//! with the kernel's SPI and GPIO code in between. Each drive's outputs are compared with the frames of the program.

use std::fs;
use std::process::{Command, Output, Stdio};
use std::thread;
use std::time::Duration;

use ecmsk::fieldbus::AlState;
use ecmsk::link::Dir;
use ecmsk::sk::{CommandId, SlotSize};
use ecmsk::xf::chip::Profile;
use rustix::process::{Pid, Signal, kill_process};

use super::chip::WiredChip;
use super::played::Played;
use support::ears::{Ear, Way};
use support::served::{TOOL, recorded, until};

/// Small packets, which fit the guest's speed.
const LINK: &str = "xf-spi:/dev/spidev0.0?int0=gpiochip0/BUSY&use_n=112";
/// A recording of the program's frames.
const SENT: &str = "/tmp/chip-board.pcapng";
const SIZE: SlotSize = SlotSize::Bytes12;
const PROGRAM: &str = "/rig/examples/two_axes_12b";
const LIBRARY: &str = "/rig/ours";

/// Drives behind a chip on the wires.
struct Machine {
    played: Played,
    ears: Vec<Ear>,
}

impl Machine {
    #[track_caller]
    fn start(drives: usize) -> Self {
        let ears: Vec<Ear> = (0..drives).map(|_| Ear::default()).collect();
        let played = WiredChip::start_with(Profile::NEW, ears.iter().map(Ear::drive).collect());
        Self { played, ears }
    }

    /// The paths of all drives at the end of the program, which has left them off, in PreOP.
    #[track_caller]
    fn ways(&self) -> Vec<Way> {
        let sent = recorded(SENT, Dir::Write);
        fs::remove_file(SENT).expect("it was there");
        let way = |(slave, ear): (usize, &Ear)| {
            let notes = ear.notes();
            assert_eq!((notes.is_on, notes.state), (false, AlState::PreOp), "slave {slave}");
            let slots = sent.iter().map(|frame| frame.slot(SIZE, slave));
            let told = slots.filter(|slot| slot.id == CommandId::Csp.code()).map(|slot| slot.data1 as i32);
            let way = Way::judge(&told.collect::<Vec<_>>(), &notes.targets);
            assert_eq!((way.lost, way.out_of_order), (0, 0), "slave {slave}: {way:?}");
            way
        };
        (1..).zip(&self.ears).map(way).collect()
    }
}

fn program(name: &str, link: &str) -> Command {
    let mut command = Command::new(name);
    let record = SENT.replace('/', "%2F");
    command.env("LD_LIBRARY_PATH", LIBRARY).env("ECMSK_LINK", format!("{link}&record={record}"));
    command
}

#[track_caller]
fn succeeded(output: &Output) -> String {
    assert!(output.status.success(), "{output:?}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// XF-20.12 An unchanged program on the library: it finds the slaves, goes to OP, reads and writes objects, and moves
/// two axes around a square, with a cycle of 1 ms. Each target reaches each drive, once and in order; at the end all
/// drives are off.
#[test]
fn an_unchanged_program_goes_round_a_square() {
    let machine = Machine::start(2);
    let said = succeeded(&program(PROGRAM, LINK).output().expect("it starts"));
    assert!(said.contains("commands lost: 0\n"), "{said}");
    let ways = machine.ways();
    assert!(ways.iter().all(|way| way.targets > 400), "{ways:?}");
}

/// XF-20.12 The tool finds the slaves, reads and writes objects and moves four axes. It leaves them on: the board over
/// the chip ends with the process, and switches them off.
#[test]
fn the_tool_moves_four_axes() {
    let machine = Machine::start(4);
    fs::write(
        "/tmp/script.ecm",
        "state op\nsdo write 3 0x6085 20000000\nsdo read 3 0x6085\nservo on all\n\
         move 1=4000 2=-4000 3=8000 4=1234 --velocity 10000\n\
         expect position 1=4000 2=-4000 3=8000 4=1234 --within 3\n",
    )
    .expect("it is a file system in memory");
    let mut tool = program(TOOL, LINK);
    tool.args(["run", "/tmp/script.ecm", "--slaves", "drive*4", "--cycle-us", "4000"]);
    let said = succeeded(&tool.output().expect("it starts"));
    assert!(said.contains("20000000") && said.contains("axis 3: at 8000"), "{said}");
    let ways = machine.ways();
    assert!(ways.iter().all(|way| way.targets > 100 && way.repeated == 0), "{ways:?}");
}

/// The cycle in the tests of stalls: long enough for the guest.
const CYCLE_NS: u64 = 4_000_000;
/// Sets in the chip's FIFO for a stall.
const AHEAD: u64 = 8;
/// Sets for the transport, some of which also bridge a stall.
const TRANSPORT: u64 = 3;
/// Gaps of a host that is not late are shorter than that, in cycles.
const USUAL: u64 = 2;
const STOPS: usize = 3;

/// The result of a program that was stopped repeatedly.
#[derive(Debug)]
struct Stopped {
    ways: Vec<Way>,
    /// Each gap without an exchange, in cycles, rounded up.
    silences: Vec<u64>,
}

impl Stopped {
    /// `ecmsk move` for some seconds, stopped once a second for that time.
    #[track_caller]
    fn for_some_time(stop: Duration) -> Self {
        let machine = Machine::start(4);
        let mut tool = program(TOOL, &format!("{LINK}&ahead={AHEAD}"));
        tool.args(["move", "1=40000", "2=-40000", "3=20000", "4=-30000", "--up", "--close", "servo-off"]);
        tool.args(["--slaves", "drive*4", "--cycle-us", "4000"]);
        tool.args(["--velocity", "10000", "--acceleration", "2000000", "--jerk", "off"]);
        let child = tool.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it starts");
        let pid = Pid::from_child(&child);
        until("it moves", || (machine.ears[0].notes().targets.last() > Some(&4000)).then_some(()));
        let from = machine.played.seen().exchanges.len() - 1;
        for _ in 0..STOPS {
            kill_process(pid, Signal::STOP).expect("it runs");
            thread::sleep(stop);
            kill_process(pid, Signal::CONT).expect("it is there");
            thread::sleep(Duration::from_secs(1) - stop);
        }
        let to = machine.played.seen().exchanges.len();
        let said = succeeded(&child.wait_with_output().expect("it ends"));
        assert!(said.contains("axis 1: at 40000"), "{said}");
        let ways = machine.ways();
        let exchanges = &machine.played.stop().exchanges[from..to];
        let silences = exchanges.windows(2).map(|pair| (pair[1].at_ns - pair[0].at_ns).div_ceil(CYCLE_NS));
        let silences: Vec<u64> = silences.filter(|cycles| *cycles > USUAL).collect();
        let stopped = Self { ways, silences };
        assert!(stopped.silences.len() >= STOPS, "it stood still: {stopped:?}");
        assert!(stopped.ways.iter().all(|way| way.targets > 500), "{stopped:?}");
        stopped
    }

    /// Cycles without an exchange that remain if the chip bridges that many each time.
    fn beyond(&self, bridged: u64) -> u64 {
        self.silences.iter().map(|cycles| cycles.saturating_sub(bridged)).sum()
    }
}

/// XF-20.13 A program that stalls for 7 cycles once a second loses neither a target nor a cycle with `ahead=8`: no
/// drive gets a target twice. The emulated machine may stall for longer than requested, so that the gaps at the chip
/// are counted.
#[test]
fn a_program_that_stands_still_for_7_cycles_loses_nothing() {
    const STOP: Duration = Duration::from_nanos(7 * CYCLE_NS - CYCLE_NS / 2);
    let stopped = Stopped::for_some_time(STOP);
    let most = stopped.beyond(AHEAD);
    assert!(stopped.ways.iter().all(|way| way.repeated <= most), "{stopped:?}");
}

/// XF-20.13 A program that stalls for longer loses no target either: each drive gets the newest target again until the
/// next one comes, in each cycle that the chip did not bridge.
#[test]
fn a_program_that_stands_still_for_longer_loses_nothing() {
    let stopped = Stopped::for_some_time(Duration::from_nanos(16 * CYCLE_NS));
    let (least, most) = (stopped.beyond(AHEAD + TRANSPORT + 1), stopped.beyond(AHEAD));
    assert!(least > 0 && stopped.ways.iter().all(|way| (least..=most).contains(&way.repeated)), "{stopped:?}");
}

//! A whole program through the kernel: the unchanged C++ program of examples/cpp/two_axes_12b.cpp.

use std::fs;
use std::process::{Command, Output};

use ecmsk::link::Dir;
use ecmsk::sk::{CommandId, Frame, SlotSize};

use support::served::{Served, attach, detach_all, recorded};

const PROGRAM: &str = "/rig/examples/two_axes_12b";
/// Folders that each contain a library of that name: this project's, and one that uses a hidraw node.
const OURS: &str = "/rig/ours";
const HIDRAW: &str = "/rig/hidraw";

fn run(library: &str, variables: &[(&str, &str)]) -> Output {
    let mut command = Command::new(PROGRAM);
    command.env("LD_LIBRARY_PATH", library).envs(variables.iter().copied());
    let output = command.output().expect("the program starts");
    assert!(output.status.success(), "{output:?}");
    output
}

/// Targets of both axes, one pair for each step: repeated targets are no step.
fn path(frames: &[Frame]) -> Vec<[u32; 2]> {
    let targets = frames.iter().filter_map(|frame| {
        let slots = [1, 2].map(|slave| frame.slot(SlotSize::Bytes12, slave));
        slots.iter().all(|slot| slot.id == CommandId::Csp.code()).then(|| slots.map(|slot| slot.data1))
    });
    let mut path: Vec<[u32; 2]> = targets.collect();
    path.dedup();
    path
}

/// SK-9.5 An unchanged program behind a real kernel: its frames arrive, none lost or duplicated, in order; the commands
/// equal those to a simulated board in its own process.
#[test]
fn an_unchanged_program_moves_two_axes() {
    // A guest without KVM on a busy machine pauses longer than the program's lead over the board, and a drive cannot
    // follow a gap at full speed. A slow board allows for that.
    let served = Served::start(&["sim:?slaves=drive*2&rate=0.1&record=%2Ftmp%2Fserved.pcapng"], &[]);
    let board = attach("1-1");
    let node = board.node.to_str().expect("a plain name");
    let through_kernel = run(HIDRAW, &[("RIG_NODE", node), ("RIG_SENT", "/tmp/sent")]);
    detach_all();
    served.stop();

    let sent: Vec<Frame> = fs::read("/tmp/sent").expect("it is there").chunks(512).map(Frame::from_prefix).collect();
    let arrived = recorded("/tmp/served.pcapng", Dir::Write);
    assert_eq!(arrived.len(), sent.len());
    assert!(arrived == sent, "other frames than were sent, or in another order");

    let at_home = run(OURS, &[("ECMSK_LINK", "sim:?slaves=drive*2&clock=virtual&record=%2Ftmp%2Fhome.pcapng")]);
    let expected = path(&recorded("/tmp/home.pcapng", Dir::Write));
    assert!(expected.len() > 500, "four sides: {}", expected.len());
    assert!(path(&arrived) == expected, "other targets than on a board in its own process");
    let lost = |output: &Output| String::from_utf8_lossy(&output.stdout).contains("commands lost: 0\n");
    assert!(lost(&through_kernel) && lost(&at_home), "{through_kernel:?}");
}

//! Whole programs over `spi:`: unchanged ones of examples/cpp on this project's library.

use std::process::{Command, Output};

use ecmsk::link::Dir;
use ecmsk::sk::{CommandId, Frame, RawSlot, SlotSize};

use super::LINK;
use super::model::Model;
use crate::served::recorded;

/// The folder with this project's library.
const LIBRARY: &str = "/rig/ours";

#[track_caller]
fn run(program: &str, link: &str) -> Output {
    let mut command = Command::new(format!("/rig/{program}"));
    let output = command.env("LD_LIBRARY_PATH", LIBRARY).env("ECMSK_LINK", link).output().expect("it starts");
    assert!(output.status.success(), "{program} on {link}: {output:?}");
    output
}

/// What was told to the board, as it is on the wires. Questions for the state alone are left out: the link asks when the
/// program says nothing, and a program when it waits.
fn told(file: &str, size: SlotSize) -> Vec<Vec<u8>> {
    let frames = recorded(file, Dir::Write);
    frames.iter().filter(|frame| tells(frame, size)).map(|frame| frame.wire(size).to_vec()).collect()
}

/// The link's questions at its opening have this in the SDO slot.
const OPENING_MARK: u8 = 0x5A;

/// GET_STATUS in every slot is a frame of zeros, but for the CRC.
fn tells(frame: &Frame, size: SlotSize) -> bool {
    let (board, sdo) = (frame.slot(size, 0), frame.slot(size, size.sdo_slot()));
    let asks = |slot: &RawSlot| slot.id == CommandId::GetStatus.code() && slot.data1 == 0 && slot.data2 == 0;
    if asks(&sdo) && sdo.index == OPENING_MARK {
        return false;
    }
    let slaves = (1..size.slots()).map(|slot| frame.slot(size, slot));
    !asks(&board) || slaves.into_iter().any(|slot| !slot.is_zero())
}

/// Runs it on a board behind spidev and on one in its own process.
#[track_caller]
fn says_the_same(program: &str, size: SlotSize, board: &str) {
    let slot = size.bytes();
    let [there, host, home] = ["board", "host", "home"].map(|whose| format!("/tmp/{program}-{whose}.pcapng"));
    let record = |file: &str| format!("record={}", file.replace('/', "%2F"));
    let model = Model::start(&format!("sim:?{board}&slot={slot}&{}", record(&there)));
    let link = format!("{LINK}&slot={slot}&{}", record(&host));
    let on_spi = run(program, &link);
    let counters = model.counters();
    let seen = model.stop();
    assert_eq!((counters.incomplete, counters.while_busy, counters.refused, seen.while_busy), (0, 0, 0, 0));
    assert!(seen.exchanges.iter().all(|exchange| exchange.len == size.frame_len() && exchange.transfers == 1));

    let (sent, arrived) = (told(&host, size), told(&there, size));
    let other = arrived.iter().zip(&sent).position(|(arrived, sent)| arrived != sent);
    assert!(arrived == sent, "{} commands arrived of {}, the first other one: {other:?}", arrived.len(), sent.len());
    // How often a program says something again, until an answer is there, depends on when it comes.
    let steps = |mut told: Vec<Vec<u8>>| {
        told.dedup();
        told
    };
    let at_home = run(program, &format!("sim:?{board}&slot={slot}&clock=virtual&{}", record(&home)));
    let (steps_there, expected) = (steps(arrived), steps(told(&home, size)));
    assert!(expected.len() > 20, "{} steps at home", expected.len());
    let other = steps_there.iter().zip(&expected).position(|(there, expected)| there != expected);
    assert!(
        steps_there == expected,
        "{} steps, {} at home, the first other one: {other:?}",
        steps_there.len(),
        expected.len()
    );
    assert_eq!(lost(&on_spi), lost(&at_home));
}

/// What a program says of lost commands.
fn lost(output: &Output) -> Vec<String> {
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    said.lines().filter(|line| line.starts_with("commands lost")).map(str::to_owned).collect()
}

/// WIRE-62 Two drives on a square, slots of 12 bytes.
#[test]
fn two_axes_on_a_square() {
    says_the_same("two_axes_12b", SlotSize::Bytes12, "slaves=drive*2");
}

/// WIRE-62 Two drives on a circle, slots of 16 bytes.
#[test]
fn two_axes_on_a_circle() {
    says_the_same("two_axes_16b", SlotSize::Bytes16, "slaves=drive*2");
}

/// WIRE-62 Two channels in one slave, slots of 16 bytes.
#[test]
fn two_channels_in_one_slave() {
    says_the_same("hsp_16b", SlotSize::Bytes16, "slaves=hsp2");
}

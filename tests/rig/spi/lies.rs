//! Faulty wires, each named by its error: at the opening of the link and during its traffic.

use std::sync::atomic::{AtomicU32, Ordering};

use ecmsk::link::{LinkError, Wait};
use ecmsk::sk::Frame;

use super::link::until_lost;
use super::model::{Miso, Model, straight};
use super::played::Busy;
use super::{LINK, LINK_WITHOUT_BUSY};
use crate::links::{open, refused};
use support::served::{PATIENCE, until};

const BOARD: &str = "sim:?slaves=io";

fn ones(_: &[u8], miso: &mut [u8]) {
    miso.fill(0xFF);
}

fn zeros(_: &[u8], miso: &mut [u8]) {
    miso.fill(0);
}

fn echo(mosi: &[u8], miso: &mut [u8]) {
    miso.copy_from_slice(mosi);
}

/// The first bit comes at the second bit's position.
fn bit_late(_: &[u8], miso: &mut [u8]) {
    let mut last = 0;
    for byte in miso {
        (*byte, last) = (*byte >> 1 | last << 7, *byte & 1);
    }
}

/// The first bit is missing.
fn bit_early(_: &[u8], miso: &mut [u8]) {
    let mut last = 0;
    for byte in miso.iter_mut().rev() {
        (*byte, last) = (*byte << 1 | last, *byte >> 7);
    }
}

fn byte_late(_: &[u8], miso: &mut [u8]) {
    miso.rotate_right(1);
    miso[0] = 0;
}

fn noise(_: &[u8], miso: &mut [u8]) {
    for (at, byte) in miso.iter_mut().enumerate() {
        *byte ^= (at * 37 + 11) as u8;
    }
}

/// One answer of four is invalid.
fn noise_at_times(mosi: &[u8], miso: &mut [u8]) {
    static EXCHANGES: AtomicU32 = AtomicU32::new(0);
    if EXCHANGES.fetch_add(1, Ordering::Relaxed).is_multiple_of(4) {
        noise(mosi, miso);
    }
}

/// The reason why a board of that link on these wires does not open.
#[track_caller]
fn reason(board: &str, busy: Busy, miso: Miso, link: &str) -> String {
    let model = Model::on(board, busy, miso);
    let error = refused(link);
    model.stop();
    match error {
        LinkError::NoBoard { reason, .. } => reason,
        other => panic!("{other}"),
    }
}

/// BUSY that is stuck, either way.
#[test]
fn busy_is_stuck() {
    let high = reason(BOARD, Busy::Stuck(true), straight, LINK);
    assert!(high.starts_with("BUSY has been high for"), "{high}");
    let low = reason(BOARD, Busy::Stuck(false), straight, LINK);
    assert!(low.starts_with("BUSY does not go high in an exchange"), "{low}");
    // A line that the link does not name is not used.
    let model = Model::on(BOARD, Busy::Stuck(true), straight);
    open(LINK_WITHOUT_BUSY).close();
    model.stop();
}

/// MISO that is constant, or equal to MOSI.
#[test]
fn miso_is_no_answer() {
    for (miso, expected) in [
        (ones as Miso, "MISO is high all the time"),
        (zeros, "MISO is low all the time"),
        (echo, "MISO repeats what MOSI says"),
        (noise, "the answers have neither a right CRC nor the form of a frame"),
    ] {
        let reason = reason(BOARD, Busy::True, miso, LINK);
        assert!(reason.starts_with(expected), "{reason}");
    }
    let error = refused(LINK).to_string();
    assert!(error.contains("MISO is high all the time"), "nothing there: {error}");
}

/// Answers that are shifted.
#[test]
fn answers_have_slipped() {
    for (miso, expected) in [
        (bit_late as Miso, "the answers come 1 bit(s) too late"),
        (bit_early, "the answers come 1 bit(s) too early"),
        (byte_late, "the answers come 1 byte(s) too late"),
    ] {
        let reason = reason(BOARD, Busy::True, miso, LINK);
        assert!(reason.starts_with(expected), "{reason}");
    }
}

/// A slot size that is not the board's: the right one is proposed.
#[test]
fn the_slot_size_is_proposed() {
    for (board, link) in [(12, 16), (16, 12)] {
        let reason = reason(&format!("{BOARD}&slot={board}"), Busy::True, straight, &format!("{LINK}&slot={link}"));
        assert!(reason.contains(&format!("set slot={board} in the link")), "{reason}");
    }
}

/// During traffic an invalid answer is left out together with its number; many of them end the link.
#[test]
fn wires_begin_to_lie() {
    for (miso, expected) in [
        (ones as Miso, "MISO is high all the time"),
        (bit_late, "the answers come 1 bit(s) too late"),
        (noise, "the answers have neither"),
    ] {
        let model = Model::start(BOARD);
        let board = open(LINK);
        board.read(&mut Frame::new(), Wait::For(PATIENCE)).expect("a report");
        model.set_miso(miso);
        let error = until_lost(&*board).to_string();
        assert!(error.contains(expected), "{error}");
    }

    let model = Model::start(BOARD);
    let board = open(LINK);
    let mut report = Frame::new();
    let next = |report: &mut Frame| board.read(report, Wait::For(PATIENCE)).expect("a report");
    let mut last = next(&mut report);
    model.set_miso(noise_at_times);
    let gap = until("a gap", || {
        let before = std::mem::replace(&mut last, next(&mut report));
        (last.sequence > before.sequence + 1).then_some(last)
    });
    assert_eq!(gap.dropped, 0, "nobody was late: {gap:?}");
}

/// BUSY that stays high during traffic ends the link.
#[test]
fn the_board_hangs() {
    let model = Model::start(BOARD);
    let board = open(LINK);
    board.read(&mut Frame::new(), Wait::For(PATIENCE)).expect("a report");
    model.hang(true);
    let error = until_lost(&*board).to_string();
    assert!(error.contains("BUSY has been high for"), "{error}");
    model.hang(false);
    board.close();
    open(LINK).close();
}

//! The rig's own wires: spidev and gpiocdev of a real kernel, with a test as the board.

use std::sync::mpsc;
use std::time::Duration;

use gpiocdev::Request;
use gpiocdev::line::{EdgeDetection, EdgeEvent, EdgeKind, Value};
use gpiocdev::request::EdgeEventBuffer;
use spidev::{SpiModeFlags, Spidev, SpidevOptions, SpidevTransfer};

use super::played::{Busy, Played};
use super::{BUSY, CHIP, RESET, SPIDEV};
use support::served::{PATIENCE, until};

pub fn spidev(mode: SpiModeFlags, speed_hz: u32) -> Spidev {
    let mut device = Spidev::open(SPIDEV).expect("the kernel shows it");
    let options = SpidevOptions::new().bits_per_word(8).max_speed_hz(speed_hz).mode(mode).build();
    device.configure(&options).expect("the controller can do it");
    device
}

/// The next edge. `EdgeEventBuffer::wait_event` of gpiocdev 0.8.0 checks only the kernel, and not the edges already in
/// the buffer: code that waits for edges one by one waits by this function.
#[track_caller]
pub fn next_edge(line: &Request, edges: &mut EdgeEventBuffer<'_>) -> EdgeEvent {
    let has_one = edges.has_event().expect("it is asked") || line.wait_edge_event(PATIENCE).expect("it waits");
    assert!(has_one, "no edge within {PATIENCE:?}");
    edges.read_event().expect("an edge")
}

/// Bytes of both directions pass the kernel's SPI code unchanged, 504 and 512 at a time, with the requested clock and
/// mode.
#[test]
fn exchanges_are_full_duplex() {
    let (send, sent) = mpsc::channel();
    let mut number = 0_u32;
    let board = move |mosi: &[u8], miso: &mut [u8]| {
        send.send(mosi.to_owned()).expect("the test waits");
        number += 1;
        for (at, byte) in miso.iter_mut().enumerate() {
            *byte = (number as usize * 7 + at) as u8;
        }
    };
    let played = Played::start(board, Busy::True);
    let modes = [SpiModeFlags::SPI_MODE_0, SpiModeFlags::SPI_MODE_1];
    for round in 1..=200_usize {
        let (len, speed, mode) = ([504, 512][round % 2], [24_000_000, 6_000_000][round % 2], modes[round / 100 % 2]);
        let device = spidev(mode, speed);
        let tx: Vec<u8> = (0..len).map(|at| (round * 31 + at * 3) as u8).collect();
        let mut rx = vec![0xA5; len];
        device.transfer(&mut SpidevTransfer::read_write(&tx, &mut rx)).expect("it is answered");
        let expected: Vec<u8> = (0..len).map(|at| (round * 7 + at) as u8).collect();
        assert!(rx == expected, "MISO of exchange {round}");
        assert!(sent.recv_timeout(PATIENCE).expect("the board had it") == tx, "MOSI of exchange {round}");
        let seen = *played.seen().exchanges.last().expect("the board had it");
        assert_eq!((seen.len, seen.speed_hz, seen.bits, seen.transfers), (len, speed, 8, 1));
        assert_eq!(u32::from(seen.mode), mode.bits());
    }
    assert_eq!(played.stop().exchanges.len(), 200);
}

/// Transfers under one chip select are one exchange; without a board MISO is pulled up.
#[test]
fn a_chip_select_is_an_exchange() {
    let device = spidev(SpiModeFlags::SPI_MODE_0, 1_000_000);
    let mut nobody = [0; 512];
    device.transfer(&mut SpidevTransfer::read(&mut nobody)).expect("the controller is there");
    assert_eq!(nobody, [0xFF; 512]);

    let played = Played::start(|mosi: &[u8], miso: &mut [u8]| miso.copy_from_slice(mosi), Busy::True);
    let (tx, mut rx) = ([0x5A; 500], [0; 12]);
    let parts = &mut [SpidevTransfer::write(&tx), SpidevTransfer::read(&mut rx)];
    device.transfer_multiple(parts).expect("it is answered");
    let seen = played.stop().exchanges;
    assert_eq!(seen.iter().map(|exchange| (exchange.len, exchange.transfers)).collect::<Vec<_>>(), [(512, 2)]);
    assert_eq!(rx, [0; 12]);
}

/// Every edge of BUSY arrives, in order and with its level.
#[test]
fn busy_has_edges() {
    let played = Played::start(|_: &[u8], _: &mut [u8]| {}, Busy::True);
    let device = spidev(SpiModeFlags::SPI_MODE_0, 24_000_000);
    let line = Request::builder()
        .on_chip(CHIP)
        .with_line(BUSY)
        .as_input()
        .with_edge_detection(EdgeDetection::BothEdges)
        .request()
        .expect("nobody else has it");
    // A buffer that lives on, so that edges already read are not lost.
    let mut edges = line.new_edge_event_buffer(8);
    let mut last = 0;
    for round in 0..1000_u32 {
        device.transfer(&mut SpidevTransfer::write(&[0; 512])).expect("it is answered");
        for kind in [EdgeKind::Rising, EdgeKind::Falling] {
            let edge = next_edge(&line, &mut edges);
            assert_eq!((edge.kind, edge.line_seqno), (kind, last + 1), "round {round}");
            last = edge.line_seqno;
        }
        assert_eq!(line.value(BUSY).expect("a level"), Value::Inactive);
    }
    assert_eq!(played.stop().while_busy, 0);
    assert!(!edges.has_event().expect("it is asked"), "no edge beyond them");
}

/// A pulse on RESET arrives with its length; a line in use cannot be opened again.
#[test]
fn reset_is_an_output() {
    let played = Played::start(|_: &[u8], _: &mut [u8]| {}, Busy::True);
    let line =
        Request::builder().on_chip(CHIP).with_line(RESET).as_output(Value::Active).request().expect("nobody has it");
    let again = Request::builder().on_chip(CHIP).with_line(RESET).as_input().request();
    assert!(again.is_err(), "it is in use");
    line.set_value(RESET, Value::Inactive).expect("it is an output");
    std::thread::sleep(Duration::from_micros(100));
    line.set_value(RESET, Value::Active).expect("it is an output");
    let resets = until("both edges", || {
        let resets = played.seen().resets;
        (resets.len() == 2).then_some(resets)
    });
    assert!(!resets[0].high && resets[1].high, "{resets:?}");
    assert!(resets[1].at_ns - resets[0].at_ns >= 100_000, "{resets:?}");
    let busy = Request::builder().on_chip(CHIP).with_line(BUSY).as_output(Value::Active).request();
    assert!(busy.is_err(), "the board drives it");
}

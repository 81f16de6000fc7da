//! The model behind spidev, without this project's link: as any other host sees it.

use std::thread;
use std::time::Duration;

use ecmsk::sk::{Frame, MasterCommand, MasterResponse, MasterState, SlotSize, StateByte};
use gpiocdev::Request;
use gpiocdev::line::{EdgeDetection, Value};
use spidev::{SpiModeFlags, Spidev, SpidevTransfer};

use super::kernel::{next_edge, spidev};
use super::model::Model;
use super::{BUSY, CHIP, RESET};
use support::served::until;

fn frame(size: SlotSize, command: MasterCommand) -> Frame {
    let mut frame = Frame::new();
    frame.put_master(size, &command);
    frame.fill_crc(size);
    frame
}

/// A host that polls the level of BUSY.
struct Host {
    size: SlotSize,
    device: Spidev,
    busy: Request,
}

impl Host {
    fn new(size: SlotSize) -> Self {
        let busy = Request::builder().on_chip(CHIP).with_line(BUSY).as_input().request().expect("nobody else has it");
        Self { size, device: spidev(SpiModeFlags::SPI_MODE_0, 24_000_000), busy }
    }

    fn is_busy(&self) -> bool {
        self.busy.value(BUSY).expect("a level") == Value::Active
    }

    /// One exchange; returns the state in the answer.
    #[track_caller]
    fn exchange(&self, command: MasterCommand) -> StateByte {
        until("BUSY is low", || (!self.is_busy()).then_some(()));
        let mut answer = vec![0xA5; self.size.frame_len()];
        let command = frame(self.size, command);
        let transfer = &mut SpidevTransfer::read_write(command.wire(self.size), &mut answer);
        self.device.transfer(transfer).expect("it is answered");
        MasterResponse::decode(&Frame::from_prefix(&answer).slot(self.size, 0)).state
    }

    #[track_caller]
    fn bring_to(&self, state: MasterState) {
        self.exchange(MasterCommand::SetState(state));
        until("it is there", || (self.exchange(MasterCommand::GetStatus) == StateByte::reached(state)).then_some(()));
    }
}

/// SK-10.3 Frames of 504 and of 512 bytes: every exchange transfers a command to the board and an answer to the host.
#[test]
fn the_model_answers() {
    for (size, link) in [(SlotSize::Bytes12, "sim:?slaves=io"), (SlotSize::Bytes16, "sim:?slaves=io&slot=16")] {
        let model = Model::start(link);
        let host = Host::new(size);
        assert_eq!(host.exchange(MasterCommand::GetStatus), StateByte::reached(MasterState::PreOp));
        host.bring_to(MasterState::Op);
        host.bring_to(MasterState::PreOp);
        let counters = model.counters();
        let seen = model.stop();
        assert!(seen.exchanges.iter().all(|exchange| exchange.len == size.frame_len()));
        assert_eq!((counters.frames, counters.incomplete), (seen.exchanges.len() as u64, 0));
        assert_eq!((counters.while_busy, counters.refused, seen.while_busy), (0, 0, 0));
    }
}

/// SK-10.4, SK-10.5, SK-10.9 A pulse on RESET of more than 32 us boots the board; BUSY is high until it has booted.
#[test]
fn a_reset_boots_the_model() {
    let model = Model::start("sim:?slaves=io");
    let host = Host::new(SlotSize::Bytes12);
    host.bring_to(MasterState::Op);
    until("BUSY is low", || (!host.is_busy()).then_some(()));
    drop(host);
    let edges = Request::builder()
        .on_chip(CHIP)
        .with_line(BUSY)
        .as_input()
        .with_edge_detection(EdgeDetection::RisingEdge)
        .request()
        .expect("nobody else has it");
    let mut boots = edges.new_edge_event_buffer(1);
    let line =
        Request::builder().on_chip(CHIP).with_line(RESET).as_output(Value::Active).request().expect("nobody has it");
    line.set_value(RESET, Value::Inactive).expect("it is an output");
    thread::sleep(Duration::from_micros(100));
    line.set_value(RESET, Value::Active).expect("it is an output");
    next_edge(&edges, &mut boots);
    drop(boots);
    drop(edges);
    let host = Host::new(SlotSize::Bytes12);
    assert_eq!(host.exchange(MasterCommand::GetStatus), StateByte::reached(MasterState::PreOp));
    assert_eq!(model.stop().resets.len(), 2);
}

//! The chip's own six inputs and outputs: LIO_RD and LIO_WR.

use ecmsk::engine::EngineConfig;
use ecmsk::sk::{FIFO_ENTRIES, FifoAction, Frame, MasterCommand, MasterState, RawSlot, SlaveKind, SlotSize};

use crate::host::Host;
use crate::probe::{Bench, drives};

const STATES: [MasterState; 5] =
    [MasterState::PreOp, MasterState::Init, MasterState::PreOp, MasterState::SafeOp, MasterState::Op];

fn board(slot: SlotSize) -> Host {
    let Bench { mut host, .. } = Bench::new(EngineConfig { slot, ..EngineConfig::default() }, drives(2));
    host.declare_drives(2);
    host
}

fn inputs(host: &mut Host, bits: u8) {
    host.board.engine_mut().set_local_inputs(bits);
}

fn outputs(host: &Host) -> u8 {
    host.board.engine().local_outputs()
}

/// Executes one LIO_RD; returns Data1.
fn read(host: &mut Host) -> u32 {
    host.master(MasterCommand::LocalRead).cycle();
    host.answer().result
}

/// SK-8.1 Six inputs and six outputs; bit k of Data1 is input k, output k, and there are no more.
/// SK-4.31 SK-4.32 In every state.
#[test]
fn a_bit_is_an_input_or_an_output() {
    for size in SlotSize::ALL {
        let mut host = board(size);
        for state in STATES {
            host.go(state).cycle();
            for k in 0..8 {
                let expected = if k < 6 { 1 << k } else { 0 };
                inputs(&mut host, 1 << k);
                assert_eq!(read(&mut host), expected, "{size:?} {state}: input {k}");
                host.raw(0, RawSlot { id: 0x22, data1: 0xFFFF_FF00 | 1 << k, ..RawSlot::ZERO }).cycle();
                assert_eq!(u32::from(outputs(&host)), expected, "{size:?} {state}: output {k}");
            }
            inputs(&mut host, 0xFF);
            assert_eq!((read(&mut host), outputs(&host)), (0x3F, 0), "{size:?} {state}: an output is no input");
            host.master(MasterCommand::LocalWrite(0x2A)).cycle();
            inputs(&mut host, 0x15);
            assert_eq!((read(&mut host), outputs(&host)), (0x15, 0x2A), "{size:?} {state}");
        }
        host.soft_reset();
        assert_eq!((read(&mut host), outputs(&host)), (0x15, 0), "{size:?}: SW_RESET resets what the board drives");
    }
}

/// SK-8.2 LIO_RD answers whether or not the network runs: during a change of state, and when one has failed.
#[test]
fn local_io_needs_no_network() {
    let mut host = board(SlotSize::Bytes12);
    let mut bits = 0;
    let mut answers = |host: &mut Host, what: &str| {
        bits = (bits + 7) & 0x3F;
        inputs(host, bits);
        host.master(MasterCommand::LocalWrite(bits ^ 0x3F)).cycle();
        assert_eq!((read(host), outputs(host)), (bits.into(), bits ^ 0x3F), "{what}");
        assert_eq!(host.answer().id, 0x21, "{what}");
    };
    host.master(MasterCommand::SetState(MasterState::SafeOp));
    for n in 0..10 {
        assert_eq!(host.board.engine().state().0, 2, "still on the way");
        answers(&mut host, &format!("during a change, {n}"));
    }
    host.until("SafeOP", |host| host.state().0 == 4).go(MasterState::PreOp);

    // A drive that is declared IO does not reach SafeOP.
    host.master(MasterCommand::SetAxis { group: 0, kinds: [SlaveKind::Io; 8] });
    host.master(MasterCommand::SetState(MasterState::Op)).until("a failure", |host| host.state().0 == 0x12);
    answers(&mut host, "after a failure");
}

/// SK-5.21 In OP LIO acts when its entry is taken out: not on arrival, and with the inputs of then. SK-8.3 Its answer
/// has no marker: byte 0 is the usual one in OP, and Data1 is valid once the entry has run.
#[test]
fn in_op_local_io_waits_in_the_queue() {
    const BEFORE: usize = 12;
    for size in SlotSize::ALL {
        let mut host = board(size);
        host.go(MasterState::Op).drained();
        inputs(&mut host, 0x01);
        let idle = Frame::new();
        let command = |command: MasterCommand| {
            let mut frame = Frame::new();
            frame.put_master(size, &command);
            frame
        };
        for _ in 0..BEFORE {
            host.arrive(&idle);
        }
        host.arrive(&command(MasterCommand::LocalWrite(0x30)));
        host.arrive(&command(MasterCommand::LocalRead));
        host.arrive(&idle);
        host.arrive(&command(MasterCommand::LocalWrite(0x0C)));
        assert_eq!(host.board.engine().fifo_free(), FIFO_ENTRIES - BEFORE as u16 - 4, "each takes an entry");
        for n in 0..BEFORE {
            host.cycle();
            assert_eq!((host.answer().id, host.answer().result, outputs(&host)), (0xBF, 0, 0), "{size:?} entry {n}");
        }
        host.cycle();
        assert_eq!((host.answer().id, host.answer().result, outputs(&host)), (0xBF, 0, 0x30), "{size:?}: LIO_WR");
        inputs(&mut host, 0x2D);
        host.cycle();
        assert_eq!((host.answer().id, host.answer().result), (0xBF, 0x2D), "{size:?}: the inputs of that cycle");
        inputs(&mut host, 0x12);
        host.cycle();
        assert_eq!(host.answer().result, 0x2D, "{size:?}: GET_STATUS keeps it");
        host.cycle();
        assert_eq!((host.answer().result, outputs(&host)), (0, 0x0C), "{size:?}: the second LIO_WR");
    }
}

/// SK-5.21 An entry that is not taken out does not act: one held back by a threshold, one that is cleared, one that found
/// the FIFO full.
#[test]
fn local_io_that_is_not_taken_out_does_not_act() {
    let mut host = board(SlotSize::Bytes12);
    host.go(MasterState::Op).drained();
    host.master(MasterCommand::SetFifo(FifoAction::Threshold(100))).master(MasterCommand::LocalWrite(0x3F)).cycles(50);
    assert_eq!(outputs(&host), 0, "held back");
    host.master(MasterCommand::SetFifo(FifoAction::Clear)).drained().cycles(5);
    assert_eq!(outputs(&host), 0, "cleared");

    let idle = Frame::new();
    let mut write = Frame::new();
    write.put_master(host.size, &MasterCommand::LocalWrite(0x3F));
    for _ in 0..FIFO_ENTRIES {
        host.arrive(&idle);
    }
    host.arrive(&write).drained().cycles(5);
    assert_eq!((outputs(&host), host.counters().full), (0, 1), "full");
    host.arrive(&write).cycle();
    assert_eq!(outputs(&host), 0x3F);
    host.go(MasterState::SafeOp).go(MasterState::PreOp);
    assert_eq!(outputs(&host), 0x3F, "they hold without the network");
}

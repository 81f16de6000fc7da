//! The row `start`: how long the way to OP takes.

use std::time::Duration;

use ecmsk::cia402::Mode;
use ecmsk::link::{self, Share, Wait};
use ecmsk::migrate::{Network, time_to_op_ns};
use ecmsk::sk::{
    CycleTime, DcShift, DriveSync, Frame, MasterCommand, MasterResponse, MasterState, SlaveCommand, SlaveKind,
    SlotSize, StateByte,
};

use ecmsk::fieldbus::sim::SimBus;
use ecmsk::fieldbus::xf::XfBusOptions;
use support::chip_line::xf_bus;
use support::start::{Program, Start};

use crate::machine::Behind;

/// Milliseconds from SET_STATE to OP, with so many drives and as many more that are declared none; the program rests nowhere.
fn start_ms(behind: Behind, drives: usize, none: usize) -> u64 {
    let mut kinds = vec![SlaveKind::Drive; drives];
    kinds.resize(drives + none, SlaveKind::None);
    let start = Start::of(kinds);
    let mut program = match behind {
        Behind::Board => Program::new(SimBus::new(start.slaves())),
        Behind::Chip { ahead } => Program::new(xf_bus(start.slaves(), XfBusOptions { ahead, ..XfBusOptions::DEFAULT })),
    };
    program.declare(&start);
    program.go(MasterState::Op).ms()
}

/// XF-20.9 The way to OP takes longer behind a chip, the more slaves there are.
#[test]
fn the_way_to_op_takes_longer() {
    for (drives, most) in [(2, 700), (8, 1000), (40, 2700)] {
        let [board, chip] = Behind::BOTH.map(|behind| start_ms(behind, drives, 0));
        assert!(board <= 950 && board < chip && chip <= most, "{drives} drives: {board} and {chip} ms");
    }
}

/// XF-20.9 What `migrate` tells of the way to OP is what the model of a chip takes, but for a tenth.
#[test]
fn the_estimate_is_what_the_model_takes() {
    for (drives, none) in [(2, 0), (8, 0), (40, 0), (6, 2), (8, 8), (39, 1)] {
        let mut network = Network { found: drives + none, ..Network::default() };
        network.kinds[..drives].fill(Some(SlaveKind::Drive));
        let (told, model) = (time_to_op_ns(&network) / 1_000_000, start_ms(Behind::CHIP, drives, none).cast_signed());
        assert!((told - model).abs() * 10 <= model, "{drives} drives, {none} none: {told} and {model} ms");
    }
}

/// The tries that a program in the manner of the vendor's samples needs for each state, 1000 at most (LIB, habits): it reads, compares
/// the state byte, and else writes an all-zero frame.
fn tries(link: &str, drives: usize) -> [usize; 2] {
    const SIZE: SlotSize = SlotSize::Bytes12;
    let board = link::open(link, Share::ByName).expect(link);
    let write = |build: &dyn Fn(&mut Frame)| {
        let mut frame = Frame::new();
        build(&mut frame);
        board.write(&frame, Wait::Forever).expect("it is taken");
        board.pass(Duration::from_millis(2)).expect("it passes");
    };
    let mut report = Frame::new();
    board.read(&mut report, Wait::Forever).expect("a report");
    for group in 0..5u8 {
        let kind = |k| if usize::from(group) * 8 + k < drives { SlaveKind::Drive } else { SlaveKind::None };
        let kinds = std::array::from_fn(kind);
        write(&|frame| frame.put_master(SIZE, &MasterCommand::SetAxis { group, kinds }));
    }
    write(&|frame| frame.put_master(SIZE, &MasterCommand::SetDc { cycle: CycleTime::DEFAULT, shift: DcShift::Auto }));
    let mode = SlaveCommand::DriveMode { mode: Mode::Csp, sync: DriveSync::DcSync };
    write(&|frame| (1..=drives).for_each(|slave| frame.put_slave(SIZE, slave, &mode.into())));
    [MasterState::SafeOp, MasterState::Op].map(|state| {
        write(&|frame| frame.put_master(SIZE, &MasterCommand::SetState(state)));
        for n in 1..=1000 {
            board.read(&mut report, Wait::Forever).expect("a report");
            if MasterResponse::decode(&report.slot(SIZE, 0)).state == StateByte::reached(state) {
                return n;
            }
            board.write(&Frame::new(), Wait::Forever).expect("it is taken");
        }
        panic!("{link}: {drives} drives are not in {state}, and the program gives up")
    })
}

/// XF-20.9 XF-20.11 A program in the manner of the vendor's samples, which gives up after 1000 reads, starts 9 drives on the link to a
/// chip as it is by default, whatever the firmware of the chip.
#[test]
fn a_program_that_gives_up_after_1000_reads_starts() {
    for firmware in ["", "&chip_fw=old", "&chip_fw=xfu", "&int0=yes"] {
        let found = tries(&format!("xf-sim:?slaves=drive*9&clock=virtual{firmware}"), 9);
        assert!(found.iter().all(|tries| *tries < 900), "{firmware}: {found:?}");
    }
}

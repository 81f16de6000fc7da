//! The row `start`: time from SET_STATE to OP.

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

/// Milliseconds from SET_STATE to OP; the program never pauses.
fn start_ms(behind: Behind, start: &Start) -> u64 {
    let mut program = match behind {
        Behind::Board => Program::new(SimBus::new(start.slaves())),
        Behind::Chip { ahead } => Program::new(xf_bus(start.slaves(), XfBusOptions { ahead, ..XfBusOptions::DEFAULT })),
    };
    program.declare(start);
    program.go(MasterState::Op).ms()
}

/// That many drives, and `none` more slaves that are declared as none.
fn drives(drives: usize, none: usize) -> Start {
    let mut kinds = vec![SlaveKind::Drive; drives];
    kinds.resize(drives + none, SlaveKind::None);
    Start::of(kinds)
}

/// XF-20.9 The way to OP takes longer behind a chip, increasingly with the number of slaves.
#[test]
fn the_way_to_op_takes_longer() {
    for (count, most) in [(2, 700), (8, 1000), (40, 2700)] {
        let [board, chip] = Behind::BOTH.map(|behind| start_ms(behind, &drives(count, 0)));
        assert!(board <= 950 && board < chip && chip <= most, "{count} drives: {board} and {chip} ms");
    }
}

/// The network that a program declares for that start.
fn network(start: &Start) -> Network {
    let mut network = Network { found: start.kinds.len(), ..Network::default() };
    let mut modules = 0;
    for (n, kind) in start.kinds.iter().enumerate() {
        network.kinds[n] = Some(*kind);
        network.modes[n] = start.mode;
        modules += usize::from(*kind == SlaveKind::Hsp);
        network.second_channels[n] = *kind == SlaveKind::Hsp && modules % 2 == 0;
    }
    network
}

/// XF-20.9 The time to OP that `migrate` estimates is that of the chip's model within 3 %: for machines with few and
/// with many servo drives, with all kinds of slaves, and with slaves declared as none.
#[test]
fn the_estimate_is_what_the_model_takes() {
    let mixed = |n: usize| Start { kinds: Start::of_forty_mixed().kinds[..n].to_vec(), ..Start::of_forty_mixed() };
    let mut wrong = Vec::new();
    for start in [
        drives(1, 0),
        drives(2, 0),
        drives(8, 0),
        drives(9, 0),
        drives(12, 0),
        drives(20, 0),
        drives(30, 0),
        drives(40, 0),
        mixed(5),
        mixed(9),
        mixed(20),
        mixed(40),
        Start::of(vec![SlaveKind::Io; 9]),
        Start::of(vec![SlaveKind::Step; 20]),
        Start::of(vec![SlaveKind::Hsp; 10]),
        drives(6, 2),
        drives(8, 8),
        drives(20, 4),
        drives(39, 1),
        mixed(40).without(&[20]),
        mixed(40).without(&[5, 12, 19, 26, 33, 40]),
    ] {
        let (told, model) = (time_to_op_ns(&network(&start)) / 1_000_000, start_ms(Behind::CHIP, &start).cast_signed());
        let names: Vec<_> = start.kinds.iter().map(|kind| format!("{kind:?}")).collect();
        let line = format!("{} slaves ({}): {told} and {model} ms", start.kinds.len(), names.join(","));
        if (told - model).abs() * 100 > 3 * model {
            wrong.push(line);
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// The attempts that a program like the vendor's samples needs for each state, 1000 at most (LIB, habits): it reads,
/// compares the state byte, and otherwise writes an all-zero frame.
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

/// XF-20.9 XF-20.11 A program like the vendor's samples, which gives up after 1000 reads, starts 9 drives over the link
/// to a chip with its defaults, with any firmware of the chip.
#[test]
fn a_program_that_gives_up_after_1000_reads_starts() {
    for firmware in ["", "&chip_fw=old", "&chip_fw=xfu", "&int0=yes"] {
        let found = tries(&format!("xf-sim:?slaves=drive*9&clock=virtual{firmware}"), 9);
        assert!(found.iter().all(|tries| *tries < 900), "{firmware}: {found:?}");
    }
}

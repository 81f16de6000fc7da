//! A slot's answer to the program's last command stays, as on USB, although the link requests the state in between.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use ecmsk::link::{Link, Wait};
use ecmsk::sk::{CommandId, CrcPolicy, Frame, MasterCommand, MasterState, SlaveKind};

use super::bench::{Answers, Bench, Setup};
use super::frames::{SIZE, all, axes, board, master, state, target, to};
use super::wires::Held;

const BOTH: [Answers; 2] = [Answers::Newest, Answers::Older];

fn head(report: &Frame, slot: usize) -> (u8, u8) {
    let slot = report.slot(SIZE, slot);
    (slot.id, slot.index)
}

/// SK-3.1 The id and the index of a command stay in every report from its first one on, and the whole FIFO is free
/// then: a program may wait for both.
#[test]
fn the_id_and_index_of_a_command_stay_in_every_report() {
    for answers in BOTH {
        let mut bench = Bench::on(Setup { slaves: 2, answers, ..Setup::default() });
        for (index, command) in [(7, CommandId::AlarmClear), (8, CommandId::ServoOn), (9, CommandId::AlarmClear)] {
            bench.held.push_back(all(2, command, index, 0));
            bench.until(|bench| bench.free == 160 && head(&bench.report, 1) == (command.code(), index));
            for _ in 0..400 {
                bench.exchange(u64::MAX);
                assert_eq!(bench.free, 160);
                assert_eq!([1, 2].map(|slot| head(&bench.report, slot)), [(command.code(), index); 2], "{answers:?}");
                // The other slots have had no command.
                assert_eq!(head(&bench.report, 3), (0, 0));
            }
        }
        assert_eq!(bench.pacer.counts().unanswered, 0, "{answers:?}");
    }
}

/// Positions and statuswords are those of the current cycle, whatever command is shown.
#[test]
fn values_are_those_of_the_cycle() {
    let mut bench = Bench::on(Setup::default());
    (0..50).for_each(|n| bench.held.push_back(target(1, n)));
    bench.until(|bench| bench.free == 160);
    bench.until(|bench| super::frames::drive(&bench.report, 1).position.abs_diff(490) <= 3);
    assert_eq!(head(&bench.report, 1).0, CommandId::Csp.code());
}

/// A GET_STATUS written by the program is executed too: the slot shows it at most six reports later.
#[test]
fn the_programs_own_get_status_is_shown() {
    for answers in BOTH {
        let mut bench = Bench::on(Setup { answers, ..Setup::default() });
        bench.held.push_back(all(1, CommandId::ServoOn, 3, 0));
        bench.until(|bench| head(&bench.report, 1) == (CommandId::ServoOn.code(), 3));
        bench.held.push_back(board(&MasterCommand::GetStatus));
        bench.until(|bench| bench.held.is_empty());
        (0..6).for_each(|_| _ = bench.exchange(u64::MAX));
        assert_eq!(head(&bench.report, 1), (0, 0));
        assert_eq!(bench.pacer.counts().unanswered, 0);
    }
}

/// SK-4.23 After a command that the board rejects, the slot shows no earlier id, and the command is counted.
#[test]
fn a_rejected_command_is_not_shown_as_answered() {
    for answers in BOTH {
        let mut bench = Bench::on(Setup { answers, ..Setup::default() });
        bench.held.push_back(all(1, CommandId::ServoOn, 3, 0));
        bench.until(|bench| head(&bench.report, 1) == (CommandId::ServoOn.code(), 3));
        bench.held.push_back(all(1, CommandId::IoRead, 4, 0));
        bench.until(|bench| bench.held.is_empty() && bench.free == 160);
        for _ in 0..20 {
            bench.exchange(u64::MAX);
            assert_eq!(head(&bench.report, 1), (0, 0), "{answers:?}");
        }
        assert_eq!(bench.pacer.counts().unanswered, 1);
        assert_eq!(bench.board.engine().counters().rejected_total(), 1);
    }
}

/// Commands dropped by a clear were not executed: the id of the last executed command stays, and nothing is counted.
#[test]
fn a_command_dropped_by_a_clear_is_not_shown_as_answered() {
    let mut bench = Bench::on(Setup::default());
    bench.held.push_back(all(1, CommandId::ServoOn, 3, 0));
    bench.until(|bench| bench.free == 160 && head(&bench.report, 1) == (CommandId::ServoOn.code(), 3));
    bench.held.push_back(board(&MasterCommand::SetFifo(ecmsk::sk::FifoAction::Threshold(100))));
    (0..30).for_each(|n| bench.held.push_back(target(1, n)));
    bench.until(|bench| bench.held.is_empty());
    bench.held.push_back(all(1, CommandId::AlarmClear, 5, 0));
    bench.held[0].put_master(SIZE, &MasterCommand::SetFifo(ecmsk::sk::FifoAction::Clear));
    bench.until(|bench| bench.free == 160 && head(&bench.report, 1) == (CommandId::AlarmClear.code(), 5));
    assert_eq!(bench.targets().0, Vec::<u8>::new(), "no target was executed");
    assert_eq!(bench.pacer.counts().unanswered, 0);
}

/// SK-2.1 Outside OP slot 0 shows the program's last command in the same way, and in OP the values of OP.
#[test]
fn the_boards_own_slot_outside_op() {
    let mut bench = Bench::new(Setup::default());
    bench.held.extend(axes());
    bench.until(|bench| bench.held.is_empty());
    (0..4).for_each(|_| _ = bench.exchange(u64::MAX));
    for _ in 0..20 {
        bench.exchange(u64::MAX);
        assert_eq!(head(&bench.report, 0).0, CommandId::SetAxis.code());
        assert_eq!(bench.report.slot(SIZE, 0).data1, 1, "slaves found");
    }
    bench.held.push_back(to(MasterState::Op));
    bench.until(|bench| state(&bench.report) == Some(MasterState::Op));
    (0..20).for_each(|_| _ = bench.exchange(u64::MAX));
    assert_eq!(head(&bench.report, 0).0, ecmsk::sk::MASTER_CYCLIC);
}

/// The first outputs, written until a report shows them. A host that is late by a cycle may miss the only answer with
/// them, and until the first answer the link does not know that the board accepts outputs in this slot.
fn first_outputs(link: &dyn Link, slots: usize, report: &mut Frame) {
    for _ in 0..100 {
        link.write(&all(slots, CommandId::IoWrite, 0, 0x7070), Wait::Forever).unwrap();
        for _ in 0..50 {
            link.read(report, Wait::Forever).unwrap();
            let slot = report.slot(SIZE, 1);
            if master(report).fifo_free == 160 && (slot.id, slot.data1) == (CommandId::IoWrite.code(), 0x7070) {
                return;
            }
        }
    }
    panic!("no report shows them: {report:?}");
}

/// SK-3.7, SK-3.8 An IO slave over a whole link: IO_WR's answer stays the outputs, IO_RD's the inputs of the cycle,
/// both with the whole FIFO free and with a right CRC.
#[test]
fn an_io_slave_is_read_and_written_over_the_whole_link() {
    let held = Held::board("sim:?queue=1&slaves=io");
    let link = held.open("spi:/dev/spidev0.0").unwrap();
    let write = |frame: &Frame| link.write(frame, Wait::Forever).unwrap();
    let kinds = [SlaveKind::Io; 8];
    write(&board(&MasterCommand::SetAxis { group: 0, kinds }));
    write(&to(MasterState::Op));
    let mut report = Frame::new();
    let mut until = |done: &dyn Fn(&Frame) -> bool| {
        for _ in 0..20_000 {
            link.read(&mut report, Wait::Forever).unwrap();
            assert_eq!(report.check_crc(SIZE, CrcPolicy::Strict), Ok(()));
            if done(&report) {
                return report.clone();
            }
        }
        panic!("it does not come: {report:?}");
    };
    until(&|report| state(report) == Some(MasterState::Op));
    first_outputs(&link, 1, &mut Frame::new());
    let answered =
        |report: &Frame, id: CommandId| master(report).fifo_free == 160 && report.slot(SIZE, 1).id == id.code();
    for outputs in [0x8001, 0x1234, 0] {
        write(&all(1, CommandId::IoWrite, 0, outputs));
        until(&|report| answered(report, CommandId::IoWrite) && report.slot(SIZE, 1).data1 == outputs as u32);
        for _ in 0..100 {
            let report = until(&|_| true);
            assert_eq!((report.slot(SIZE, 1).id, report.slot(SIZE, 1).data1), (0x14, outputs as u32));
        }
        write(&all(1, CommandId::IoRead, 0, 0));
        let report = until(&|report| answered(report, CommandId::IoRead));
        let inputs = report.slot(SIZE, 1).data1;
        for _ in 0..100 {
            assert_eq!(until(&|_| true).slot(SIZE, 1).data1, inputs);
        }
    }
}

/// Number of the next answers that are invalid.
fn garble(held: &Held) -> Arc<AtomicU32> {
    let left = Arc::new(AtomicU32::new(0));
    let garbles = left.clone();
    let _ = held.clone().tamper(move |_, rx| {
        if garbles.try_update(Relaxed, Relaxed, |left| left.checked_sub(1)).is_ok() {
            rx[2] ^= 0x55;
        }
    });
    left
}

/// Outputs that were written in a cycle without a report are shown as written, with their index; IO_WR to a missing
/// slave is never shown.
#[test]
fn outputs_that_no_report_has_shown() {
    let held = Held::board("sim:?queue=1&slaves=io");
    let invalid_answers = garble(&held);
    let link = held.open("spi:/dev/spidev0.0").unwrap();
    let write = |frame: &Frame| link.write(frame, Wait::Forever).unwrap();
    write(&board(&MasterCommand::SetAxis { group: 0, kinds: [SlaveKind::Io; 8] }));
    write(&to(MasterState::Op));
    let mut report = Frame::new();
    let mut until = |done: &dyn Fn(&Frame) -> bool| {
        let came = (0..20_000).any(|_| {
            link.read(&mut report, Wait::Forever).unwrap();
            assert_eq!(report.slot(SIZE, 2).id, 0, "there is no slave 2");
            done(&report)
        });
        assert!(came, "{report:?}");
    };
    let shows = |report: &Frame, index: u8, outputs: u32| {
        let slot = report.slot(SIZE, 1);
        (slot.id, slot.index, slot.data1) == (CommandId::IoWrite.code(), index, outputs)
    };
    until(&|report| state(report) == Some(MasterState::Op));
    first_outputs(&link, 2, &mut Frame::new());
    for (index, outputs) in [(1, 0x0F0F), (2, 0x1111), (3, 0x2222)] {
        // Fewer than would lose the board, and longer than the entry stays in the FIFO.
        invalid_answers.store(12, Relaxed);
        write(&all(2, CommandId::IoWrite, index, outputs));
        until(&|report| master(report).fifo_free == 160 && shows(report, index, outputs as u32));
    }
}

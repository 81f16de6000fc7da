//! Process data: outcomes, the room in the FIFO, and lost answers.

use ecmsk::xf::CommandCode;
use ecmsk::xf::host::{HostConfig, HostError, ProcessKind, ProcessOutcome, ProcessReport, ProcessRequest};
use ecmsk::xf::request::FifoEnable;

use super::Rig;
use super::chip::{Fault, PDO};

pub const PIPELINED: HostConfig = HostConfig { pipelined_writes: true, ..HostConfig::DEFAULT };
const DONE: ProcessOutcome = ProcessOutcome::Done { read: false };

/// An RxPDO with its number as data.
pub fn pdo(n: u32) -> [u8; PDO] {
    u64::from(n).to_le_bytes()
}

/// A host whose chip sends the FIFO's entries.
pub fn with_fifo_on(config: HostConfig) -> Rig {
    let mut rig = Rig::running(config);
    let ticket = rig.ended(&FifoEnable { on: true });
    let _ = rig.host.take(ticket, &FifoEnable { on: true });
    rig
}

pub fn write(rig: &mut Rig, n: u32) -> u32 {
    rig.host.process(ProcessRequest::Write { count: 1, outputs: &pdo(n) }).expect("there is room")
}

/// Runs turns until there is a report.
pub fn report(rig: &mut Rig) -> ProcessReport {
    for _ in 0..20_000 {
        if let Some(report) = rig.host.take_report() {
            return report;
        }
        rig.turn().expect("it runs");
    }
    panic!("no report")
}

/// XF-12.11 Each exchange of process data has one report, and its TxPDOs.
#[test]
fn process_data_go_out_and_come_in() {
    for config in [HostConfig::DEFAULT, PIPELINED] {
        let mut rig = with_fifo_on(config);
        let mut seen = 0;
        for n in 1..=300 {
            let sequence = rig.host.process(ProcessRequest::Exchange { count: 1, outputs: &pdo(n) }).expect("room");
            let report = report(&mut rig);
            assert_eq!(report.sequence, sequence);
            let ProcessOutcome::Done { read } = report.outcome else { panic!("{report:?}") };
            if read {
                seen += 1;
                assert_eq!(rig.host.inputs(), pdo(seen));
            }
            rig.exchanges(3);
            if read {
                assert_eq!(rig.host.inputs(), pdo(seen), "other answers leave them");
            }
        }
        assert!(seen > 250, "{seen}");
        assert_eq!(rig.host.counters().rx_written, 300);
        assert_eq!(rig.chip.put_out[..], (1..=rig.chip.put_out.len() as u32).collect::<Vec<_>>());
    }
}

/// XF-12.11 With pipelined writes each exchange has process data; without them every second one.
#[test]
fn pipelined_writes_take_one_exchange() {
    for (config, exchanges) in [(HostConfig::DEFAULT, 200), (PIPELINED, 101)] {
        let mut rig = with_fifo_on(config);
        rig.chip.cycle = 1;
        let before = rig.host.counters().exchanges;
        let mut next = 1;
        while rig.host.counters().rx_written < 100 {
            if next <= 100 && rig.host.process(ProcessRequest::Write { count: 1, outputs: &pdo(next) }).is_ok() {
                next += 1;
            }
            rig.turn().expect("it runs");
            rig.host.take_report();
        }
        assert_eq!(rig.host.counters().exchanges - before, exchanges);
    }
}

/// XF-12.11 The room in the FIFO is never overestimated, though the counts lag behind; when it is full a write is not
/// taken.
#[test]
fn the_fifo_is_never_overfilled() {
    for config in [HostConfig::DEFAULT, PIPELINED] {
        for cycle in [1, 2, 3, 7, u32::MAX] {
            let mut rig = with_fifo_on(config);
            rig.chip.cycle = cycle;
            let (mut n, mut full) = (0, 0);
            for _ in 0..2000 {
                match rig.host.process(ProcessRequest::Write { count: 1, outputs: &pdo(n) }) {
                    Ok(_) => n += 1,
                    Err(HostError::FifoFull { needed: 1, free: 0 }) => full += 1,
                    Err(HostError::ProcessBusy { .. }) => {}
                    Err(error) => panic!("{error}"),
                }
                rig.turn().expect("it runs");
                if let Some(report) = rig.host.take_report() {
                    assert_eq!(report.outcome, DONE, "cycle {cycle}");
                }
                assert!(usize::from(rig.host.rx_free()) <= 64 - rig.chip.rx.len());
            }
            assert!(cycle < 4 || full > 0, "cycle {cycle}: {n} written");
            assert_eq!(rig.host.counters().rx_full, 0);
        }
    }
}

/// XF-12.11 Several PDOs in one packet, reads alone, and past the FIFO.
#[test]
fn all_kinds_of_process_data() {
    let mut rig = with_fifo_on(HostConfig::DEFAULT);
    let three = [pdo(1), pdo(2), pdo(3)].concat();
    rig.host.process(ProcessRequest::Write { count: 3, outputs: &three }).expect("room");
    assert_eq!(report(&mut rig).outcome, DONE);
    rig.exchanges(10);
    assert_eq!((&rig.chip.put_out[..], rig.host.counters().rx_written), (&[1, 2, 3][..], 3));
    rig.host.process(ProcessRequest::Read { count: 2 }).expect("taken");
    assert_eq!(report(&mut rig).outcome, ProcessOutcome::Done { read: true });
    assert_eq!(rig.host.inputs(), [pdo(1), pdo(2)].concat());
    rig.host.process(ProcessRequest::DirectRead).expect("taken");
    assert_eq!(report(&mut rig).outcome, ProcessOutcome::Done { read: true });
    assert_eq!(rig.host.inputs(), [7; PDO]);
    rig.host.process(ProcessRequest::DirectExchange { outputs: &pdo(4) }).expect("taken");
    assert_eq!(report(&mut rig).outcome, ProcessOutcome::Done { read: true });
    let long = rig.host.process(ProcessRequest::DirectExchange { outputs: &[0; 113] });
    assert_eq!(long, Err(HostError::TooLong { code: CommandCode::PdoData, found: 113, most: 112 }));
    let many = rig.host.process(ProcessRequest::Write { count: 65, outputs: &[] });
    assert_eq!(many, Err(HostError::FifoFull { needed: 65, free: 64 }));
}

/// XF-12.11 Outputs that are written directly into the packet reach the chip; if there is an error, nothing is written.
#[test]
fn outputs_are_written_in_place() {
    let mut rig = with_fifo_on(HostConfig::DEFAULT);
    let two = ProcessKind::Write { count: 2 };
    let taken = rig.host.process_in_place(two, 2 * PDO, |place| {
        assert_eq!(place.len(), 2 * PDO);
        place[..PDO].copy_from_slice(&pdo(8));
        place[PDO..].copy_from_slice(&pdo(9));
    });
    let sequence = taken.expect("room");
    let busy = rig.host.process_in_place(two, 2 * PDO, |_| panic!("the other ones wait there"));
    assert_eq!(busy, Err(HostError::ProcessBusy { sequence }));
    assert_eq!(report(&mut rig), ProcessReport { sequence, outcome: DONE });
    rig.exchanges(10);
    assert_eq!(rig.chip.put_out, [8, 9]);
    let direct = ProcessKind::DirectExchange;
    let long = rig.host.process_in_place(direct, 113, |_| panic!("there is no place for them"));
    assert_eq!(long, Err(HostError::TooLong { code: CommandCode::PdoData, found: 113, most: 112 }));
    let many = rig.host.process_in_place(ProcessKind::Write { count: 65 }, PDO, |_| panic!("they have no room"));
    assert_eq!(many, Err(HostError::FifoFull { needed: 65, free: 64 }));
}

/// XF-12.11 A FIFO with fewer entries than the driver assumes: the write is reported as lost.
#[test]
fn a_full_fifo_is_reported() {
    let mut rig = Rig::running(HostConfig::default());
    rig.chip.rx_entries = 2;
    for n in 0..4 {
        write(&mut rig, n);
        let expected = if n < 2 { DONE } else { ProcessOutcome::Full };
        assert_eq!(report(&mut rig).outcome, expected, "{n}");
    }
    assert_eq!((rig.host.counters().rx_written, rig.host.counters().rx_full), (2, 2));
    assert_eq!(rig.chip.rx, [0, 1]);
}

/// XF-12.11 A write whose answer is lost has been written, and is not written again.
#[test]
fn a_lost_answer_to_a_write() {
    let mut rig = Rig::running(HostConfig::default());
    rig.faults = vec![Fault::None, Fault::ToHost(300)];
    write(&mut rig, 5);
    assert_eq!(report(&mut rig).outcome, ProcessOutcome::AnswerLost);
    assert_eq!((&rig.chip.rx, rig.host.counters().rx_written), (&[5].into(), 1));
}

/// XF-12.11 With pipelined writes the chip's count of errors shows whether a write without an answer was executed.
#[test]
fn overtaken_writes() {
    let cases = [
        (vec![Fault::None, Fault::ToHost(300)], ProcessOutcome::AnswerLost, vec![5, 6]),
        (vec![Fault::ToChip(8 * 26)], ProcessOutcome::NotWritten, vec![6]),
    ];
    for (faults, outcome, written) in cases {
        let mut rig = Rig::running(PIPELINED);
        rig.faults = faults;
        let first = write(&mut rig, 5);
        rig.exchanges(1);
        let second = write(&mut rig, 6);
        let mut reports = [report(&mut rig), report(&mut rig)];
        reports.sort_by_key(|report| report.sequence);
        let expected =
            [(first, outcome), (second, DONE)].map(|(sequence, outcome)| ProcessReport { sequence, outcome });
        assert_eq!(reports, expected);
        assert_eq!(rig.chip.rx, written);
        let counters = rig.host.counters();
        assert_eq!(counters.rx_written as usize, written.len());
        assert_eq!(counters.rx_dropped as usize, 2 - written.len());
    }
}

/// XF-12.11 Without pipelined writes, a write that the chip rejected is sent again, in its place.
#[test]
fn a_rejected_write_is_sent_again() {
    let mut rig = Rig::running(HostConfig::default());
    rig.faults = vec![Fault::ToChip(8 * 26), Fault::ToChip(8 * 27), Fault::ToHost(99)];
    write(&mut rig, 5);
    report(&mut rig);
    write(&mut rig, 6);
    assert_eq!(report(&mut rig).outcome, DONE);
    assert_eq!(rig.chip.rx, [5, 6]);
}

/// XF-12.11 Process data and commands take turns: neither keeps the other waiting for long.
#[test]
fn commands_and_process_data_take_turns() {
    for config in [HostConfig::DEFAULT, PIPELINED] {
        let mut rig = with_fifo_on(config);
        rig.chip.cycle = 1;
        let tickets: Vec<_> = (0..4).map(|n| rig.submit(&super::commands::dac(n))).collect();
        let before = rig.host.counters();
        for n in 0..30 {
            let _ = rig.host.process(ProcessRequest::Write { count: 1, outputs: &pdo(n) });
            rig.exchanges(1);
            rig.host.take_report();
        }
        assert!(tickets.iter().all(|ticket| rig.host.is_done(*ticket)));
        assert!(rig.host.counters().rx_written - before.rx_written >= 10, "{:?}", rig.host.counters());
    }
}

/// XF-12.11 With pipelined writes, a write that met a full FIFO, and whose answer is lost, does not count as written;
/// its report comes before that of the next one.
#[test]
fn an_overtaken_write_that_met_a_full_fifo() {
    let mut rig = Rig::running(PIPELINED);
    rig.chip.rx_entries = 0;
    rig.faults = vec![Fault::None, Fault::ToHost(300)];
    let first = write(&mut rig, 5);
    rig.exchanges(1);
    let second = write(&mut rig, 6);
    let reports = [report(&mut rig), report(&mut rig)];
    assert_eq!(reports.map(|report| report.sequence), [first, second]);
    assert_eq!(reports.map(|report| report.outcome), [ProcessOutcome::Unknown, ProcessOutcome::Full]);
}

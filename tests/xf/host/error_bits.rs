//! Error bits in the header that belong to another packet: each command and all process data get their true outcome all
//! the same.

use ecmsk::xf::host::{HostConfig, HostError, ProcessOutcome, ProcessRequest, Timeouts};
use ecmsk::xf::request::SdoOperation;
use ecmsk::xf::{CommandCode, Errors};

use super::Rig;
use super::chip::{Fault, PDO};
use super::commands::{dac, sdo};
use super::process::{PIPELINED, pdo, report, write};

/// Short, so that few exchanges pass until a packet has ended without its answer.
const IMPATIENT: HostConfig =
    HostConfig { timeouts: Timeouts { answer_ns: 2_000_000, ..Timeouts::DEFAULT }, ..HostConfig::DEFAULT };

/// A driver that has not seen that its RxPDOs were refused: its newest header is older, and the chip's error bit
/// belongs to them.
fn refused_unseen(config: HostConfig) -> Rig {
    let mut rig = Rig::running(config);
    rig.chip.refused = Some(CommandCode::PdoDataFifo);
    rig.faults = vec![Fault::Replaced; 1000];
    rig.faults[0] = Fault::None;
    write(&mut rig, 5);
    assert_eq!(report(&mut rig).outcome, ProcessOutcome::Unknown);
    assert!(rig.chip.errors.contains(Errors::COMMAND));
    assert_eq!(rig.host.header().map(|header| header.errors), Some(Errors::NONE));
    rig.chip.refused = None;
    rig.faults.clear();
    rig
}

/// The end of a command that sets the DAC.
fn end_of_dac(rig: &mut Rig, n: u32) -> Result<(), HostError> {
    let ticket = rig.ended(&dac(n));
    rig.host.take(ticket, &dac(n)).expect("it is done").map(drop)
}

fn ran(rig: &Rig, n: u32) -> usize {
    rig.chip.ran.iter().filter(|ran| **ran == (CommandCode::DacFunction, n)).count()
}

const REFUSED: Result<(), HostError> = Err(HostError::Refused { code: CommandCode::DacFunction });

/// XF-12.16 Error bits that a packet without an answer has left are not taken for those of the next command.
#[test]
fn a_command_behind_process_data_without_an_answer() {
    let mut rig = refused_unseen(IMPATIENT);
    assert_eq!((end_of_dac(&mut rig, 7), ran(&rig, 7)), (Ok(()), 1));
    rig.chip.refused = Some(CommandCode::DacFunction);
    assert_eq!(end_of_dac(&mut rig, 8), REFUSED);
}

/// XF-12.16 The same for process data: past the FIFO, their data show that they were exchanged; into the FIFO, nothing
/// shows it if their answer is lost.
#[test]
fn process_data_behind_process_data_without_an_answer() {
    let mut rig = refused_unseen(IMPATIENT);
    rig.host.process(ProcessRequest::DirectExchange { outputs: &pdo(6) }).expect("taken");
    assert_eq!(report(&mut rig).outcome, ProcessOutcome::Done { read: true });
    assert_eq!(rig.host.inputs(), [7; PDO]);

    let mut rig = refused_unseen(IMPATIENT);
    rig.faults = vec![Fault::None, Fault::ToHost(300)];
    write(&mut rig, 6);
    assert_eq!((report(&mut rig).outcome, &rig.chip.rx), (ProcessOutcome::Unknown, &[6].into()));
    assert_eq!((rig.host.counters().rx_unknown, rig.host.counters().rx_written), (2, 0));
}

/// XF-12.16 If the answer to process data is lost and no other packet is in doubt, the error bit is theirs.
#[test]
fn refused_process_data_whose_answer_is_lost() {
    let mut rig = Rig::running(HostConfig::default());
    rig.chip.refused = Some(CommandCode::PdoDataFifo);
    rig.faults = vec![Fault::None, Fault::ToHost(300)];
    write(&mut rig, 5);
    assert_eq!(report(&mut rig).outcome, ProcessOutcome::Refused);
}

/// XF-12.16 An error bit that three answered packets could not clear is ignored until it goes away; another bit that
/// comes meanwhile, at any moment, is cleared, and counts.
#[test]
fn an_error_that_stays_hides_no_other() {
    // A download that the scripted chip's slave aborts.
    let failing = sdo(0x6040, SdoOperation::Write(&[0x55, 0x55, 0, 0]));
    for moment in 0..12 {
        let mut rig = Rig::running(HostConfig::default());
        rig.chip.stays = Errors::FIFO;
        let ticket = rig.submit(&failing);
        rig.exchanges(moment);
        rig.chip.errors = rig.chip.errors | Errors::NON_IMMEDIATE;
        rig.done(ticket);
        let result = rig.host.take(ticket, &failing);
        assert!(matches!(result, Some(Err(HostError::Failed { .. }))), "at {moment}: {result:?}");
    }
}

/// XF-12.16 A packet that should clear an error but had no answer does not count as an attempt.
#[test]
fn only_answers_say_that_an_error_stays() {
    let mut rig = Rig::running(IMPATIENT);
    rig.chip.refused = Some(CommandCode::DacFunction);
    assert_eq!(end_of_dac(&mut rig, 1), REFUSED);
    let ticket = rig.submit(&dac(2));
    // The header that says "command error" comes again and again.
    for _ in 0..1500 {
        rig.faults = vec![Fault::Replaced];
        rig.turn().expect("it runs");
    }
    rig.faults.clear();
    rig.done(ticket);
    assert_eq!(rig.host.take(ticket, &dac(2)).expect("it is done").map(drop), REFUSED);
}

/// XF-12.11 The chip rejects and counts bytes that are sent during a search for packets; that count says nothing about
/// process data that were overtaken before.
#[test]
fn a_search_behind_an_overtaken_write() {
    let mut rig = Rig::running(HostConfig { resync_after: 2, ..PIPELINED });
    rig.faults = [&[Fault::None][..], &[Fault::ToHost(300); 6]].concat();
    let first = write(&mut rig, 5);
    rig.exchanges(1);
    let second = write(&mut rig, 6);
    let reports = [report(&mut rig), report(&mut rig)];
    assert_eq!(reports.map(|report| report.sequence), [first, second]);
    assert_eq!((reports[0].outcome, &rig.chip.rx), (ProcessOutcome::Unknown, &[5, 6].into()));
    assert!(rig.host.counters().searches > 0);
}

/// XF-12.10 A stopped driver takes no command, and says why it stopped.
#[test]
fn a_driver_that_has_stopped_takes_nothing() {
    let mut rig = Rig::running(IMPATIENT);
    rig.faults = vec![Fault::Lost; 100_000];
    let ticket = rig.submit(&dac(1));
    let error = rig.stops();
    assert!(rig.host.is_done(ticket), "what it had taken has ended");
    assert_eq!(rig.host.submit(rig.now, &dac(2)), Err(error));
    assert_eq!(rig.host.process(ProcessRequest::DirectRead), Err(error));
    assert_eq!(rig.host.take_report(), None);
}

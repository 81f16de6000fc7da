//! Random bytes, and random answers, come back to the driver. `schedules/` has random faults with a chip at the other
//! end.

use ecmsk::xf::host::{HostConfig, HostState, Next, ProcessRequest};
use ecmsk::xf::request::{SdoGet, SdoOperation};
use ecmsk::xf::{AnswerHeader, CheckRule, CommandCode, DataSize, MAX_PACKET, Status, write_answer};
use support::dice::Dice;

use super::Rig;
use super::chip::Fault;
use super::commands::{READ, dac, sdo};
use super::process::{pdo, with_fifo_on};

/// XF-12.15 A chip that sends zeros for a while, as in the log of a machine with six axes whose cycle was too short: the driver
/// waits, in its start and later, and each command runs once.
///
/// Row: zeros.
#[test]
fn a_chip_that_answers_zeros() {
    for zeros in [1, 5, 40, 400] {
        let mut rig = Rig::starting(HostConfig::default());
        rig.faults = vec![Fault::Zeros; zeros];
        rig.until_running();
        rig.chip.ran.clear();
        for exchanges in 0..=2 {
            let ticket = rig.submit(&dac(exchanges));
            rig.exchanges(exchanges as usize);
            rig.faults = vec![Fault::Zeros; zeros];
            rig.done(ticket);
            let result = rig.host.take(ticket, &dac(exchanges));
            assert_eq!(result, Some(Ok(())), "{zeros} zeros after {exchanges} exchanges");
        }
        rig.chip.ran.retain(|(code, _)| *code == CommandCode::DacFunction);
        assert_eq!(rig.chip.ran.len(), 3, "{zeros} zeros: {:?}", rig.chip.ran);
    }
}

/// XF-12.15 Any bytes, and any answers with right check words: nothing panics, no wait ends in the past, and the driver
/// goes on with a chip afterwards.
#[test]
fn any_bytes_come_back() {
    for seed in 0..200 {
        let mut dice = Dice(seed);
        let mut rig = with_fifo_on(HostConfig { pipelined_writes: seed % 2 == 0, ..HostConfig::default() });
        for n in 0..300 {
            let _ = match dice.below(3) {
                0 => rig.host.submit(rig.now, &dac(n)),
                1 => rig.host.submit(rig.now, &sdo(1, SdoOperation::Write(&n.to_le_bytes()))),
                _ => rig.host.submit_pair(rig.now, &sdo(n as u16, READ), &SdoGet, 1_000_000_000),
            };
            let _ = rig.host.process(ProcessRequest::Exchange { count: 1, outputs: &pdo(n) });
            match rig.host.next(rig.now) {
                Ok(Next::Exchange(packet)) => {
                    let packet = packet.to_vec();
                    rig.now += 40_000;
                    rig.host.received(rig.now, &any_answer(&mut dice, &packet));
                }
                Ok(Next::WaitUntil(time) | Next::WaitForReady { until: time }) => {
                    assert!(time > rig.now);
                    rig.now = time;
                }
                Err(_) => rig.host.restart(rig.now),
            }
        }
        if matches!(rig.host.state(), HostState::Stopped(_)) {
            rig.host.restart(rig.now);
        }
        rig.until_running();
    }
}

/// Bytes, or an answer that often has the index and the code of the packet.
fn any_answer(dice: &mut Dice, packet: &[u8]) -> Vec<u8> {
    if dice.one_in(8) {
        let len = dice.pick(&[0, 1, packet.len(), packet.len() + 1, 3000]);
        return (0..len).map(|_| dice.roll() as u8).collect();
    }
    let mut header = [0; 24];
    header.iter_mut().for_each(|byte| *byte = if dice.one_in(3) { dice.roll() as u8 } else { 0 });
    let mut header = AnswerHeader::decode(&header).1;
    if packet.len() >= 24 && !dice.one_in(4) {
        (header.index, header.code) = (packet[11], CommandCode::from_code(packet[12]));
    }
    header.status = Status(dice.roll() as u8 & 0xFC);
    let data: Vec<u8> = (0..dice.below(113)).map(|_| dice.roll() as u8).collect();
    let rule = if dice.one_in(8) { CheckRule::FIXED } else { CheckRule::CRC32 };
    let mut buffer = [0; MAX_PACKET];
    let answer = write_answer(&mut buffer, DataSize::MANUAL, rule, header, &&data[..]).expect("it fits");
    answer.to_vec()
}

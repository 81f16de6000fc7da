//! Whatever goes wrong: no command runs twice, no answer goes to the wrong ticket, no RxPDO is written twice or lost
//! without being counted.

use std::collections::BTreeMap;

use ecmsk::coe::{ObjectAddress, SdoScope};
use ecmsk::xf::host::{HostConfig, HostError, HostState, Next, ProcessData, ProcessOutcome, Ticket};
use ecmsk::xf::request::{Analog, DacSetData, SdoGet, SdoOperation, SdoRequest, SlaveInfoGet, SlaveInfoItem};
use ecmsk::xf::response::SlaveInfo;
use ecmsk::xf::{AnswerHeader, CheckRule, CommandCode, DataSize, MAX_PACKET, Status, write_answer};
use support::dice::Dice;

use super::Rig;
use super::chip::Fault;
use super::process::{pdo, with_fifo_on};
use crate::slave;

pub fn dac(n: u32) -> DacSetData {
    DacSetData { value: Analog::new(n).expect("12 bits") }
}

fn vendor(n: u8) -> SlaveInfoGet {
    SlaveInfoGet { slave: slave(n), item: SlaveInfoItem::Vendor }
}

fn read(index: u16) -> SdoRequest<'static> {
    let operation = SdoOperation::Read { bytes: 4 };
    let object = ObjectAddress::new(index, 0);
    SdoRequest { slave: slave(0), object, scope: SdoScope::Entry, timeout_us: 1000, operation }
}

/// What was submitted, with a number that nothing else has.
#[derive(Clone, Copy, Debug)]
enum Submitted {
    Set(u32),
    Get(u8),
    Write(u32),
    Read(u16),
}

fn submit(rig: &mut Rig, what: Submitted) -> Result<Ticket, HostError> {
    let now = rig.now;
    match what {
        Submitted::Set(n) => rig.host.submit(now, &dac(n)),
        Submitted::Get(n) => rig.host.submit(now, &vendor(n)),
        Submitted::Write(n) => {
            let data = n.to_le_bytes();
            rig.host.submit(now, &SdoRequest { operation: SdoOperation::Write(&data), ..read(1) })
        }
        Submitted::Read(n) => rig.host.submit_pair(now, &read(n), &SdoGet, 1_000_000_000),
    }
}

/// Takes the result of what is done: it is the one that belongs to the ticket. Whether it was one without error.
fn take(rig: &mut Rig, ticket: Ticket, what: Submitted) -> Option<bool> {
    let result = match what {
        Submitted::Set(n) => rig.host.take(ticket, &dac(n))?.map(drop),
        Submitted::Get(n) => {
            rig.host.take(ticket, &vendor(n))?.map(|answer| assert_eq!(answer, SlaveInfo::U32(1000 + u32::from(n))))
        }
        Submitted::Write(_) => rig.host.take(ticket, &read(1))?,
        Submitted::Read(n) => rig
            .host
            .take(ticket, &SdoGet)?
            .map(|answer| assert_eq!(answer, (u32::from(n) + 7).to_le_bytes(), "{what:?}")),
    };
    match result {
        Ok(()) => Some(true),
        Err(HostError::NoAnswer { .. } | HostError::ChipReset | HostError::AnswerLost { .. }) => Some(false),
        Err(error) => panic!("{what:?}: {error}"),
    }
}

/// How often the chip ran what was submitted.
fn ran(rig: &Rig, what: Submitted) -> usize {
    let (code, tag) = match what {
        Submitted::Set(n) => (CommandCode::DacFunction, n),
        Submitted::Get(n) => (CommandCode::SlaveInfoGet, n.into()),
        Submitted::Write(n) => (CommandCode::SdoRequest, n),
        Submitted::Read(n) => (CommandCode::SdoRequest, n.into()),
    };
    rig.chip.ran.iter().filter(|ran| **ran == (code, tag)).count()
}

/// A fault in one of `rarely` exchanges.
fn fault(dice: &mut Dice, rarely: u64, resets: bool) -> Fault {
    if !dice.one_in(rarely) {
        return Fault::None;
    }
    let bit = dice.below(8 * 1440) as usize;
    match dice.below(if resets { 70 } else { 69 }) {
        0..15 => Fault::ToChip(bit),
        15..30 => Fault::ToHost(bit),
        30..40 => Fault::NotReady,
        40..50 => Fault::Lost,
        50..55 => Fault::Doubled,
        55..60 => Fault::Replaced,
        60..65 => Fault::Late,
        65..69 => Fault::Stranger,
        _ => Fault::Reset,
    }
}

/// One run with the numbers of `seed`: every third one has process data alone. Gives what became of them.
fn run(seed: u64, config: HostConfig, resets: bool) -> Vec<ProcessOutcome> {
    let mut dice = Dice(seed);
    let mut rig = with_fifo_on(config);
    let rarely = dice.pick(&[2, 3, 5, 10, 50]);
    rig.chip.busy_for = dice.below(20) as u32 + 1;
    rig.chip.cycle = dice.below(4) as u32 + 1;
    let mut open: Vec<(Ticket, Submitted)> = Vec::new();
    let mut process = BTreeMap::new();
    let mut all = Vec::new();
    let mut outcomes = BTreeMap::new();
    let mut number = 0;
    for turn in 0..1500 {
        let quiet = turn >= 1000;
        rig.faults = vec![if quiet { Fault::None } else { fault(&mut dice, rarely, resets) }];
        if !quiet && !seed.is_multiple_of(3) && dice.one_in(3) {
            number += 1;
            let what = match dice.below(4) {
                0 => Submitted::Set(number),
                1 => Submitted::Get((number % 128) as u8),
                2 => Submitted::Write(0x10_0000 + number),
                _ => Submitted::Read(0x6000 + number as u16),
            };
            if let Ok(ticket) = submit(&mut rig, what) {
                open.push((ticket, what));
            }
        }
        if !quiet && dice.one_in(2) {
            let data = pdo(0x20_0000 + turn);
            if let Ok(sequence) = rig.host.process(ProcessData::Exchange { count: 1, outputs: &data }) {
                process.insert(sequence, 0x20_0000 + turn);
            }
        }
        rig.turn().unwrap_or_else(|error| panic!("seed {seed}: {error}"));
        while let Some(report) = rig.host.take_report() {
            assert!(outcomes.insert(report.sequence, report.outcome).is_none(), "seed {seed}: two reports");
        }
        open.retain(|(ticket, what)| match take(&mut rig, *ticket, *what) {
            Some(fine) => {
                all.push((*what, fine));
                false
            }
            None => true,
        });
    }
    assert_eq!(rig.host.state(), HostState::Running, "seed {seed}");
    assert!(open.is_empty(), "seed {seed}: {open:?} {:?}", rig.host.counters());
    for (what, fine) in &all {
        let times = ran(&rig, *what);
        match what {
            Submitted::Get(_) => {}
            _ if *fine => assert_eq!(times, 1, "seed {seed}: {what:?}"),
            _ => assert!(times <= 1, "seed {seed}: {what:?} ran {times} times"),
        }
    }
    assert_eq!(process.len(), outcomes.len(), "seed {seed}: each has its report");
    let written = |n: u32| rig.chip.ran.iter().filter(|ran| **ran == (CommandCode::PdoDataFifo, n)).count();
    for (sequence, n) in &process {
        let allowed = match outcomes[sequence] {
            ProcessOutcome::Done { .. } | ProcessOutcome::AnswerLost => 1..=1,
            ProcessOutcome::NotWritten => 0..=0,
            _ => 0..=1,
        };
        let times = written(*n);
        assert!(allowed.contains(&times), "seed {seed}: {n} was written {times} times, {:?}", outcomes[sequence]);
    }
    let in_order = rig.chip.put_out.windows(2).all(|pair| pair[0] < pair[1]);
    assert!(in_order, "seed {seed}: RxPDOs are put out in their order");
    let counters = rig.host.counters();
    let counted = counters.rx_written + counters.rx_full + counters.rx_dropped + counters.rx_unknown;
    let never_sent = process.len() as u64 - counted;
    assert!(never_sent <= counters.chip_resets, "seed {seed}: {counters:?}");
    outcomes.into_values().collect()
}

/// Runs all seeds, and looks whether everything came that may come.
fn runs(seeds: std::ops::Range<u64>, config: HostConfig, expected: &[ProcessOutcome]) {
    let outcomes: Vec<_> = seeds.flat_map(|seed| run(seed, config, false)).collect();
    for outcome in expected {
        assert!(outcomes.contains(outcome), "{outcome:?} came never");
    }
}

/// XF-12.7, XF-12.11 Faults of all kinds in up to every second exchange, in any order.
#[test]
fn anything_goes_wrong() {
    let expected = [ProcessOutcome::Done { read: true }, ProcessOutcome::AnswerLost];
    runs(0..100, HostConfig::default(), &expected);
}

/// XF-12.7, XF-12.11 The same with pipelined writes.
#[test]
fn anything_goes_wrong_while_writes_are_pipelined() {
    let config = HostConfig { pipelined_writes: true, ..HostConfig::default() };
    use ProcessOutcome::{AnswerLost, Done, NotWritten, Unknown};
    runs(1000..1100, config, &[Done { read: true }, Done { read: false }, AnswerLost, NotWritten, Unknown]);
}

/// XF-12.5, XF-12.7 The same with resets of the chip in between.
#[test]
fn the_chip_is_reset_in_between() {
    for seed in 2000..2080 {
        run(seed, HostConfig { pipelined_writes: seed % 2 == 0, ..HostConfig::default() }, true);
    }
}

/// XF-12.15 Any bytes, and any answers with right check words: nothing panics, no wait is over already, and the driver
/// goes on with a chip afterwards.
#[test]
fn any_bytes_come_back() {
    for seed in 0..200 {
        let mut dice = Dice(seed);
        let mut rig = with_fifo_on(HostConfig { pipelined_writes: seed % 2 == 0, ..HostConfig::default() });
        for n in 0..300 {
            let _ = submit(&mut rig, dice.pick(&[Submitted::Set(n), Submitted::Write(n), Submitted::Read(n as u16)]));
            let _ = rig.host.process(ProcessData::Exchange { count: 1, outputs: &pdo(n) });
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
        rig.until("running", |rig| rig.host.state() == HostState::Running);
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

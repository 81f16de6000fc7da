//! From an unknown chip to a running one, and the deadlines.

use ecmsk::xf::host::{Host, HostConfig, HostError, HostPacing, HostState, Next, ProcessRequest, StartStep, Timeouts};
use ecmsk::xf::request::{SdoOperation, SlaveInfoItem};
use ecmsk::xf::{CheckType, CommandCode, CrcCoverage, CrcCoverages, DataSize};

use super::Rig;
use super::chip::{Chip, Fault};
use super::commands::sdo;
use crate::slave;

fn codes(rig: &Rig) -> Vec<u8> {
    rig.chip.taken.iter().map(|(_, code)| code.code()).collect()
}

/// XF-12.1 From every offset of the stream a chip of unknown n is found and started, with the steps in their order.
#[test]
fn n_and_the_offset_are_found() {
    for offset in 0..144 {
        let mut rig = Rig::new(HostConfig::default(), Chip::new(DataSize::MANUAL));
        rig.chip.clock(&vec![0; offset]);
        rig.until_running();
        assert_eq!(rig.host.size(), DataSize::MANUAL);
        assert_eq!((codes(&rig), rig.chip.kind), (vec![25, 20, 56, 0, 18, 51], CheckType::Crc32), "offset {offset}");
        assert_eq!(rig.host.version().map(|version| version.version), Some(0x22));
        assert_eq!(rig.host.counters().searches, 1);
    }
}

/// XF-12.1 Chips of every n, with a CRC-32 of any coverage already in force, and a busy chip.
#[test]
fn chips_of_all_kinds_are_started() {
    for n in [32, 33, 112, 992, 1024, 1408] {
        for coverage in CrcCoverage::EVERY {
            for kind in [CheckType::Fixed, CheckType::Crc32] {
                let mut chip = Chip::new(DataSize::new(n).expect("in range"));
                (chip.coverages, chip.kind) = (coverage.into(), kind);
                chip.clock(&[0; 2000]);
                let mut rig = Rig::new(HostConfig::default(), chip);
                rig.until_running();
                assert_eq!(rig.host.size().bytes(), n);
                rig.ended(&ecmsk::xf::request::SpiPackSizeGet);
            }
        }
    }
}

/// XF-12.17 Whatever a CRC-32 covers in each direction, the host finds it: commands of any length are taken and no answer is
/// damaged from then on.
///
/// Row: CRC-32 covers.
#[test]
fn what_a_crc_covers_is_found_for_each_direction() {
    for commands in CrcCoverage::EVERY {
        for answers in CrcCoverage::EVERY {
            for kind in [CheckType::Fixed, CheckType::Crc32] {
                let mut chip = Chip::new(DataSize::MANUAL);
                (chip.coverages, chip.kind) = (CrcCoverages { commands, answers }, kind);
                chip.clock(&[0; 500]);
                let mut rig = Rig::new(HostConfig::default(), chip);
                rig.until_running();
                let found = rig.host.coverages();
                assert_eq!((found, rig.host.check()), (CrcCoverages { commands, answers }, CheckType::Crc32));
                assert!(!rig.host.gave_crc_up());
                let before = rig.host.counters();
                rig.chip.ran.clear();
                // Of 13, 14, 15 and 16 bytes.
                for value in [&[1, 0, 0, 0][..], &[2, 0, 0, 0, 0], &[3, 0, 0, 0, 0, 0], &[4, 0, 0, 0, 0, 0, 0]] {
                    rig.ended(&sdo(0x2000, SdoOperation::Write(value)));
                }
                let after = rig.host.counters();
                assert_eq!((after.damaged, after.rejected), (before.damaged, before.rejected));
                assert_eq!(rig.chip.ran.iter().filter(|(code, _)| *code == CommandCode::SdoRequest).count(), 4);
            }
        }
    }
}

/// XF-12.17 A chip with an unknown CRC-32 is set to the fixed word, and the host reports that, whether it is the CRC of
/// its answers or of the packets that it takes.
///
/// Row: CRC-32 covers.
#[test]
fn a_crc_that_covers_nothing_known_is_given_up() {
    for strange in [[true, false], [false, true], [true, true]] {
        let mut chip = Chip::new(DataSize::MANUAL);
        chip.strange = strange;
        let mut rig = Rig::new(HostConfig::default(), chip);
        rig.until_running();
        assert!(rig.host.gave_crc_up(), "{strange:?}");
        assert_eq!((rig.host.check(), rig.chip.kind), (CheckType::Fixed, CheckType::Fixed));
        rig.ended(&ecmsk::xf::request::SlaveInfoGet { slave: slave(3), item: SlaveInfoItem::Vendor });
        assert_eq!(rig.host.counters().chip_resets, 0);
    }
}

/// XF-12.1 A given size is used if packets have it, and searched if not.
#[test]
fn a_wrong_size_is_corrected() {
    let config = HostConfig { size: Some(DataSize::NEWER), ..HostConfig::default() };
    let mut rig = Rig::new(config, Chip::new(DataSize::NEWER));
    rig.until_running();
    assert_eq!(rig.host.counters().searches, 0);
    let mut rig = Rig::new(config, Chip::new(DataSize::MANUAL));
    rig.until_running();
    assert_eq!((rig.host.size(), rig.host.counters().searches), (DataSize::MANUAL, 1));
}

/// XF-12.2 The wanted n is set, with 100 ms of silence after the command; whether the chip keeps CRC-32 then or not is
/// no reset.
#[test]
fn the_size_is_set() {
    for resize_resets_kind in [false, true] {
        let config = HostConfig { wanted_size: DataSize::new(300), ..HostConfig::default() };
        let mut rig = Rig::new(config, Chip::new(DataSize::MANUAL));
        rig.chip.resize_resets_kind = resize_resets_kind;
        rig.until("resized", |rig| rig.chip.size.bytes() == 300);
        let before = rig.now;
        rig.until_running();
        assert!(rig.now - before >= 100_000_000);
        assert_eq!(codes(&rig)[..5], [25, 20, 23, 25, 20]);
        assert_eq!((rig.host.size().bytes(), rig.chip.kind), (300, CheckType::Crc32));
        assert_eq!(rig.host.counters().chip_resets, 0);
    }
}

/// XF-12.1 One packet alone has the fixed check word: CRC_TYPE_SET.
#[test]
fn one_packet_has_the_fixed_check_word() {
    let mut rig = Rig::starting(HostConfig::default());
    rig.until_running();
    let fixed = |packet: &&Vec<u8>| packet[packet.len() - 8..][..4] == [0x78, 0x56, 0x34, 0x12];
    let codes: Vec<u8> = rig.sent.iter().filter(fixed).map(|packet| packet[0x0C]).collect();
    // And the packet that fetches its answer.
    assert_eq!(codes, [25, 25]);
}

/// XF-12.2 XF-12.4 A chip that is not ready for SPI_RECONFIG_OP has lost it: it is sent again, after more idle time.
#[test]
fn a_chip_that_is_not_ready_for_its_size() {
    let config = HostConfig { wanted_size: DataSize::new(300), idle_ns: 20_000, ..HostConfig::default() };
    let mut rig = Rig::starting(config);
    // CRC_TYPE_SET, SPI_PACK_SIZE_GET and their answers, then SPI_RECONFIG_OP.
    rig.faults = [vec![Fault::None; 4], vec![Fault::NotReady; 2]].concat();
    rig.until_running();
    assert_eq!(codes(&rig)[..4], [25, 20, 23, 25]);
    assert_eq!((rig.host.size().bytes(), rig.host.counters().searches), (300, 0));
    assert_eq!(rig.host.counters().not_ready, 2);
}

/// XF-12.1 The start ends well whatever single exchange of it goes wrong.
#[test]
fn each_exchange_of_the_start_may_fail() {
    let all = [
        Fault::ToChip(11 * 8),
        Fault::ToChip(600),
        Fault::ToHost(600),
        Fault::ToHost(12 * 8),
        Fault::ToHost(24 * 8 + 5),
        Fault::NotReady,
        Fault::Lost,
        Fault::Doubled,
        Fault::Replaced,
        Fault::Stranger,
        Fault::Reset,
    ];
    for fault in all {
        for at in 0..16 {
            let mut rig = Rig::starting(HostConfig::default());
            rig.faults = vec![Fault::None; at];
            rig.faults.push(fault);
            rig.exchanges(at + 1);
            rig.until_running();
            assert_eq!(rig.chip.kind, CheckType::Crc32, "{fault:?} at {at}");
        }
    }
}

/// XF-12.3 Without a chip the search ends with what was seen on the line; after a restart it goes on.
#[test]
fn a_silent_chip_has_a_deadline() {
    for level in [0, 0xFF] {
        let mut host = Host::new(0, HostConfig::default());
        let mut now = 0;
        let error = loop {
            match host.next(now) {
                Ok(Next::Exchange(bytes)) => {
                    let back = vec![level; bytes.len()];
                    now += 20_000;
                    host.received(now, &back);
                }
                Ok(Next::WaitUntil(time) | Next::WaitForReady { until: time }) => now = time,
                Err(error) => break error,
            }
        };
        assert!(
            matches!(error, HostError::Silent { waited_ns: 3_000_000_000..3_001_000_000, bytes: 1.. }),
            "{error:?}"
        );
        assert!(error.to_string().contains("check power"), "{error}");
        assert_eq!(host.next(now), Err(error));
        assert_eq!(host.state(), HostState::Stopped(error));
        host.restart(now);
        assert_eq!(host.state(), HostState::Starting(StartStep::Search));
    }
}

/// XF-12.3 A chip that stays busy at the start has a deadline, and one that is never ready.
#[test]
fn a_start_that_does_not_end() {
    let mut rig = Rig::starting(HostConfig::default());
    rig.chip.keep_busy();
    let error = rig.stops();
    assert!(matches!(error, HostError::StartTooLong { step: StartStep::NotBusy, .. }), "{error}");

    let mut rig = Rig::starting(HostConfig::default());
    rig.faults = vec![Fault::NotReady; 100_000];
    let error = rig.stops();
    assert!(matches!(error, HostError::StartTooLong { .. } | HostError::Silent { .. }), "{error}");
}

/// XF-12.4 Between exchanges there is the idle time; an answer "not ready" doubles it, others bring it back.
#[test]
fn idle_time() {
    let mut rig = Rig::running(HostConfig::default());
    let none = Fault::None;
    rig.faults = vec![none, Fault::NotReady, Fault::NotReady, none, none, none, none];
    let mut ended = Vec::new();
    for _ in 0..7 {
        if rig.host.process(ProcessRequest::Read { count: 1 }).is_err() {
            rig.host.take_report();
        }
        rig.exchanges(1);
        ended.push(rig.now);
    }
    let gaps: Vec<u64> = ended.windows(2).map(|pair| (pair[1] - pair[0]) / 1000 - 40).collect();
    assert_eq!(gaps, [150, 300, 600, 300, 150, 150]);
}

/// XF-12.4 With INT0 the next exchange begins at its edge; without the edge after the deadline, and three times in a
/// row end it.
#[test]
fn int0() {
    let mut rig = Rig::starting(HostConfig { pacing: HostPacing::Int0, ..HostConfig::default() });
    rig.int0_ns = Some(30_000);
    rig.until_running();
    let exchanges = rig.host.counters().exchanges;
    assert!(rig.now < exchanges * 71_000 + 2_000_000, "{} exchanges in {} ns", exchanges, rig.now);

    rig.int0_ns = None;
    let error = rig.stops();
    assert_eq!(error, HostError::Int0Missing { waited_ns: 10_000_000, times: 3 });
    assert_eq!(rig.host.counters().int0_missed, 3);
}

/// XF-12.5 After a reset of the chip all waiting commands end with that error, and the chip is started anew, even with
/// another n.
#[test]
fn a_reset_is_seen() {
    for start in [DataSize::MANUAL, DataSize::NEWER] {
        let mut rig = Rig::running(HostConfig::default());
        rig.chip.start = start;
        rig.faults = vec![Fault::Reset];
        let ticket = rig.ended(&ecmsk::xf::request::SlaveCountGet);
        let result = rig.host.take(ticket, &ecmsk::xf::request::SlaveCountGet);
        assert_eq!(result, Some(Err(HostError::ChipReset)), "{start:?}");
        rig.until_running();
        assert_eq!((rig.host.counters().chip_resets, rig.host.size()), (1, start));
        assert!(!rig.chip.ran.iter().any(|(code, _)| *code == CommandCode::SlaveCountGet));
    }
}

/// XF-12.6 After many damaged answers in a row the beginning of packets is searched, and what was under way goes on.
#[test]
fn a_shifted_stream_is_found_again() {
    let mut rig = Rig::running(HostConfig::default());
    let ticket = rig.submit(&ecmsk::xf::request::SlaveCountGet);
    rig.chip.clock(&[0; 55]);
    rig.until("the search", |rig| rig.host.state() == HostState::Searching);
    rig.done(ticket);
    assert_eq!(rig.host.take(ticket, &ecmsk::xf::request::SlaveCountGet), Some(Ok(0)));
    let ran = rig.chip.ran.iter().filter(|(code, _)| *code == CommandCode::SlaveCountGet).count();
    assert_eq!((ran, rig.host.counters().chip_resets), (1, 0));
}

/// XF-12.3 The timeouts are those of the configuration.
#[test]
fn deadlines_are_configured() {
    let timeouts = Timeouts { search_ns: 50_000_000, ..Timeouts::default() };
    let mut host = Host::new(7, HostConfig { timeouts, ..HostConfig::default() });
    assert!(host.next(7).is_ok());
    host.received(50_000_007, &[0; 64]);
    assert!(matches!(host.next(50_000_007), Err(HostError::Silent { waited_ns: 50_000_000, bytes: 64 })));
}

/// XF-12.3 A chip that falls silent while commands wait: they end with the error with which the driver stops.
#[test]
fn a_chip_falls_silent() {
    let mut rig = Rig::running(HostConfig::default());
    let ticket = rig.submit(&ecmsk::xf::request::SlaveCountGet);
    let sequence = rig.host.process(ProcessRequest::Read { count: 1 }).expect("taken");
    rig.faults = vec![Fault::Lost; 100_000];
    let error = rig.stops();
    assert!(matches!(error, HostError::Silent { .. }), "{error}");
    let result = rig.host.take(ticket, &ecmsk::xf::request::SlaveCountGet);
    assert_eq!(result, Some(Err(error)));
    assert_eq!(rig.host.take_report().map(|report| report.sequence), Some(sequence));
}

/// XF-12.1 A chip that reports another n than its packets have is not started.
#[test]
fn a_chip_that_contradicts_itself() {
    let mut rig = Rig::starting(HostConfig::default());
    rig.chip.claims = Some(DataSize::NEWER);
    let error = rig.stops();
    assert_eq!(error, HostError::DataSizeMismatch { expected: DataSize::MANUAL, found: DataSize::NEWER });
    assert!(error.to_string().contains("112"), "{error}");
}

//! From an unknown chip to a running one; sizes, check words, resets.

use ecmsk::slave::Io;
use ecmsk::xf::chip::Profile;
use ecmsk::xf::host::{HostConfig, HostError, ProcessOutcome, ProcessRequest};
use ecmsk::xf::request::{
    AsyncReset, AsyncResetActions, CrcErrorCountClear, FirmwareVersionGet, InfoUpdate, SdoOperation, SdoRequest,
    SlaveCountGet, SpiPackSizeGet, WarmReset,
};
use ecmsk::xf::{
    CheckType, CommandCode, CrcCoverage, CrcCoverages, DataSize, Errors, EtherCatState, NetworkState, Status,
};

use super::{INIT, MS, Pair, S, drive, drives_and_io, sdo};

const PROFILES: [Profile; 3] = [Profile::OLD, Profile::NEW, Profile::XFU];

/// XF-12.1 The driver starts the model, wherever it begins in the stream, whether it knows n or not.
#[test]
fn the_driver_starts_the_model() {
    for profile in PROFILES {
        for skipped in [0, 1, 50, 143, 144, 700] {
            let mut pair = Pair::new(profile, HostConfig::DEFAULT, vec![drive(), drive()], skipped);
            pair.until_running();
            assert_eq!(pair.host.size(), profile.size, "{skipped}");
            assert_eq!(pair.host.version().expect("a version").version, profile.version, "{skipped}");
        }
    }
}

/// XF-12.17 XF-2.3 The driver starts a model whose CRC-32 covers anything in either direction; commands and process data of any length
/// pass then, and the right coverage is found.
///
/// Row: CRC by direction.
#[test]
fn a_crc_of_any_coverage() {
    for commands in CrcCoverage::EVERY {
        for answers in CrcCoverage::EVERY {
            let coverages = CrcCoverages { commands, answers };
            for profile in [Profile::OLD, Profile::XFU].map(|profile| Profile { coverages, ..profile }) {
                let mut pair = Pair::running_with(profile, HostConfig::DEFAULT, drives_and_io());
                assert_eq!((pair.host.coverages(), pair.host.check()), (coverages, CheckType::Crc32));
                let before = pair.host.counters();
                pair.bring_to(EtherCatState::Op);
                for outputs in [[0; 14], [1; 14]] {
                    let outcome = pair.process(ProcessRequest::DirectExchange { outputs: &outputs });
                    assert_eq!(outcome, ProcessOutcome::Done { read: true }, "{coverages:?}");
                }
                let after = pair.host.counters();
                assert_eq!((after.damaged, after.rejected), (before.damaged, before.rejected), "{coverages:?}");
            }
        }
    }
}

/// XF-13.1 INFO_UPDATE (XF EN 369): the header is up to date.
#[test]
pub fn info_update() {
    let mut pair = Pair::running();
    assert_eq!(pair.header().gpio_inputs, 0);
    let now = pair.now;
    pair.chip().wire_gpio(now, 5, Some(true));
    pair.run(&InfoUpdate);
    assert_eq!(pair.host.header().expect("it runs").gpio_inputs, 1 << 5);
}

/// XF-13.1 XF-11.13 FW_VERSION_GET (XF EN 1285, XF ZH 1208) and SPI_PACK_SIZE_GET (XF EN 704) of each firmware.
#[test]
pub fn version_and_size() {
    for (profile, version, has_data, n) in
        [(Profile::OLD, 0x0E, false, 112), (Profile::NEW, 0x22, true, 1024), (Profile::XFU, 0x22, true, 992)]
    {
        let mut pair = Pair::running_with(profile, HostConfig::DEFAULT, vec![]);
        let answer = pair.get(&FirmwareVersionGet, |answer| answer);
        assert_eq!((answer.version, answer.identity.is_some()), (version, has_data));
        assert_eq!(pair.get(&SpiPackSizeGet, DataSize::bytes), n);
    }
}

/// XF-13.1 SPI_RECONFIG_OP (XF EN 715): n is another one from the next packet on, larger or smaller, and an ECM-XFU
/// refuses it.
#[test]
pub fn another_size() {
    for (profile, n) in [(Profile::OLD, 1024), (Profile::OLD, 1408), (Profile::NEW, 112), (Profile::NEW, 32)] {
        let wanted = DataSize::new(n).expect("32 to 1408");
        let config = HostConfig { wanted_size: Some(wanted), ..HostConfig::DEFAULT };
        let mut pair = Pair::running_with(profile, config, vec![drive()]);
        assert_eq!((pair.host.size(), pair.chip().size()), (wanted, wanted));
        assert_eq!(pair.get(&SpiPackSizeGet, DataSize::bytes), n);
        pair.run(&INIT);
        assert_eq!(pair.get(&SlaveCountGet, |count| count), 1);
    }
    let mut chip = Pair::new(Profile::XFU, HostConfig::DEFAULT, vec![], 0);
    chip.until_running();
    assert_eq!(chip.chip().size().bytes(), 992);
}

/// XF-13.1 CRC_TYPE_SET (XF EN 741): after the start both sides have CRC-32, so that one bit that flips is noticed.
#[test]
pub fn check_word() {
    for profile in PROFILES {
        let mut pair = Pair::running_with(profile, HostConfig::DEFAULT, vec![]);
        assert_eq!(pair.header().status.0 & 3, 3, "CRC-32");
        let before = pair.header().crc_errors;
        pair.damages_next = true;
        pair.run(&FirmwareVersionGet);
        assert_eq!(pair.header().crc_errors, before + 1);
    }
}

/// XF-13.1 CRC_ERR_CNT_CLR (XF EN 730): the counter is 0 again, and counts on.
#[test]
pub fn crc_errors() {
    let mut pair = Pair::running();
    for _ in 0..2 {
        pair.run(&CrcErrorCountClear);
        for n in 0..3 {
            assert_eq!(pair.header().crc_errors, n);
            pair.damages_next = true;
            pair.run(&InfoUpdate);
        }
    }
    assert_eq!(Errors(pair.header().errors.0 & Errors::ALL.0), Errors::NONE, "the driver has cleared them");
}

/// XF-13.1 ASYNCCMD_RESET (XF EN 1446): 1 clears the busy flag, 4 gives up the running command, which has failed then.
#[test]
pub fn reset_of_what_runs() {
    for (actions, fails) in [
        (AsyncResetActions::CLEAR_BUSY, false),
        (AsyncResetActions::GIVE_UP, true),
        (AsyncResetActions::CLEAR_BUSY | AsyncResetActions::GIVE_UP, true),
    ] {
        let mut pair = Pair::running();
        pair.bring_to(EtherCatState::PreOp);
        pair.silence(0, true);
        let slow = SdoRequest { timeout_us: 8_000_000, ..sdo(0, 0x1000, 0, SdoOperation::Read { bytes: 4 }) };
        let ticket = pair.submit(&slow);
        pair.pass(S);
        assert!(!pair.host.is_done(ticket) && pair.has(Status::BUSY));
        pair.run(&AsyncReset::new(actions).expect("known bits"));
        let since = pair.now;
        let result = pair.result(ticket, &slow, |()| ());
        assert!(pair.now < since + 100 * MS, "it has ended at once");
        assert_eq!(matches!(result, Err(HostError::Failed { code: CommandCode::SdoRequest, .. })), fails, "{result:?}");
        assert!(!pair.has(Status::BUSY));
        pair.silence(0, false);
        pair.run(&sdo(0, 0x1000, 0, SdoOperation::Read { bytes: 4 }));
    }
}

/// XF-13.1 ASYNCCMD_RESET (XF EN 1446): 2 skips the wait for the network port behind a start.
#[test]
pub fn reset_of_the_wait_for_the_port() {
    let port_is_ready = |skips: bool| {
        let mut pair = Pair::running();
        assert!(!pair.host.header().expect("it runs").status.contains(Status::PORT_READY));
        if skips {
            pair.run(&AsyncReset::new(AsyncResetActions::SKIP_PORT_WAIT).expect("a known bit"));
        }
        pair.has(Status::PORT_READY)
    };
    assert_eq!((port_is_ready(false), port_is_ready(true)), (false, true));
}

/// XF-13.1 WARM_RESET (XF EN 1517): all is as after power-on, and the driver starts the chip anew.
#[test]
pub fn warm_reset() {
    for profile in PROFILES {
        let mut pair = Pair::running_with(profile, HostConfig::DEFAULT, vec![drive(), Box::new(Io::default())]);
        pair.bring_to(EtherCatState::PreOp);
        let ticket = pair.submit(&WarmReset);
        let result = pair.result(ticket, &WarmReset, |()| ());
        assert!(matches!(result, Err(HostError::NoAnswer { .. } | HostError::ChipReset)), "{result:?}");
        pair.until("the reset", |host| host.counters().chip_resets == 1);
        pair.until_running();
        assert_eq!(pair.header().state, NetworkState::NONE);
        assert_eq!(pair.get(&SlaveCountGet, |count| count), 0);
        pair.bring_to(EtherCatState::Op);
        assert_eq!(pair.header().state, EtherCatState::Op.into());
    }
}

/// XF-12.5 A chip that is reset to an n with which several packets fit into an old one: 10 * 144 are 1440 bytes, which
/// begin and end as a packet does that says "not ready".
#[test]
fn a_reset_to_packets_that_fit_into_one() {
    let config = HostConfig { wanted_size: Some(DataSize::MAX), ..HostConfig::DEFAULT };
    let mut pair = Pair::running_with(Profile::OLD, config, vec![]);
    pair.submit(&WarmReset);
    pair.until("a reset", |host| host.counters().chip_resets == 1);
    pair.until_running();
    assert_eq!(pair.host.size(), DataSize::MAX);
}

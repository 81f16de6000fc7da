//! Invariants of disturbed networks: two masters at once, a master that stops in the middle, partly written EEPROMs,
//! FMMUs over everything, sync managers that are too small or overlap.

use ecmsk::coe::{ObjectAddress, SdoRequest, SdoScope, SdoValuePart};
use ecmsk::ethercat::mailbox::{MailboxCounter, MailboxHeader, MailboxMessage, MailboxProtocol};
use ecmsk::ethercat::registers::{self, DlStatus, Fmmu, FmmuDirections, SiiControl, SmControl, SyncManager};
use ecmsk::ethercat::{AlState, AlStatus, Command, DatagramHeader};
use ecmsk::slave::esc::{EscSettings, FrameFate, MAILBOX_BYTES_MIN};
use ecmsk::slave::{Dp3cl, Dp3clConfig};

use super::bad_input::check;
use super::rig::{FIRST, INPUTS, MS, OUTPUTS, Rig, answers, drive, slave};

const UPLOAD: SdoRequest<'_> = SdoRequest::Upload { object: ObjectAddress::new(0x1018, 1), scope: SdoScope::Entry };

/// The frames of a master that brings two drives from nothing to OP, with an SDO in segments on its way.
fn start_up() -> Vec<Vec<u8>> {
    let mut rig = Rig::new((0..2).map(|_| drive(EscSettings::default())));
    rig.sent = Some(Vec::new());
    rig.start();
    rig.sent.expect("they were kept")
}

impl Rig {
    /// Brings two drives from any state to OP, as a master does.
    fn start(&mut self) {
        self.one(Command::Bwr, 0, registers::AL_CONTROL, &[0x11, 0]);
        self.one(Command::Bwr, 0, registers::SYNC_MANAGER, &[0; 32]);
        self.one(Command::Bwr, 0, registers::FMMU, &[0; 32]);
        self.give_stations();
        for n in 0..2 {
            self.bring_to_preop(FIRST + n);
            let value = SdoValuePart::First { size: 150, data: &[7; 100] };
            let object = ObjectAddress::new(0x4FFF, 0);
            self.sdo(FIRST + n, SdoRequest::Download { object, scope: SdoScope::Entry, value });
            self.sdo(FIRST + n, SdoRequest::DownloadSegment { toggle: false, last: true, data: &[8; 50] });
            let len = self.set_process_data(FIRST + n, u32::from(n) * 100);
            self.reach(FIRST + n, AlState::SafeOp);
            self.logical(Command::Lrw, u32::from(n) * 100, &vec![0; len]);
            self.reach(FIRST + n, AlState::Op);
        }
    }
}

/// ECAT-14.4 A master that stops at any place of its start, also in the middle of a transfer, leaves slaves in valid
/// states, with the reason why they have left OP; another master brings them to OP.
#[test]
fn a_master_stops_in_the_middle() {
    let frames = start_up();
    assert!(frames.len() > 30, "{}", frames.len());
    let mut fallen = 0;
    for stop in 0..=frames.len() {
        let mut rig = Rig::new((0..2).map(|_| drive(EscSettings::default())));
        for frame in &frames[..stop] {
            rig.raw(&mut frame.clone());
            check(&rig);
        }
        let before = [0, 1].map(|n| rig.chain.slave(n).state());
        for _ in 0..20 {
            rig.now += 1_000 * MS;
            rig.chain.advance(rig.now);
            check(&rig);
        }
        for (n, before) in before.into_iter().enumerate() {
            let state = rig.chain.slave(n).state();
            let code = rig.chain.slave(n).controller().peek(registers::AL_STATUS_CODE, 2).to_vec();
            match before {
                AlState::Op => {
                    fallen += 1;
                    assert_eq!((state, &code[..]), (AlState::SafeOp, &AlStatus::WATCHDOG.0.to_le_bytes()[..]));
                }
                other => assert_eq!(state, other, "nothing else changes by itself, {stop}"),
            }
        }
        rig.start();
        assert!((0..2).all(|n| rig.chain.slave(n).state() == AlState::Op), "{stop}");
    }
    assert!(fallen > 2, "{fallen}");
}

/// ECAT-14.4 Frames of two masters that both start, in any order: each is answered, slaves are in valid states, and
/// once one master is alone it brings them to OP.
#[test]
fn two_masters_start_at_once() {
    let frames = start_up();
    for shift in 0..frames.len() {
        let mut rig = Rig::new((0..2).map(|_| drive(EscSettings::default())));
        // The second master begins when the first one has sent some frames; then they take turns.
        let second = std::iter::repeat_n(None, shift).chain(frames.iter().map(Some));
        let first = frames.iter().map(Some).chain(std::iter::repeat_n(None, shift));
        for frame in first.zip(second).flat_map(|(first, second)| [first, second]).flatten() {
            let mut bytes = frame.clone();
            assert!(matches!(rig.raw(&mut bytes), FrameFate::Returned(_)));
            check(&rig);
            for (answer, asked) in answers(&bytes).iter().zip(answers(frame)) {
                let DatagramHeader { command, index, len, .. } = asked.header;
                assert_eq!((answer.header.command, answer.header.index, answer.header.len), (command, index, len));
                if command == Command::Brd {
                    assert_eq!(answer.wkc, 2, "each slave counts a broadcast");
                }
            }
        }
        rig.start();
        assert!((0..2).all(|n| rig.chain.slave(n).state() == AlState::Op), "{shift}");
    }
}

/// ECAT-14.4 Two masters use one mailbox: a request is processed once, in the order of arrival; each reader gets the
/// waiting answer; a request with the counter of the other master's last one is dropped.
#[test]
fn two_masters_share_a_mailbox() {
    let mut rig = Rig::in_preop();
    let request = |rig: &Rig, counter, index: u16, sub| {
        let [low, high] = index.to_le_bytes();
        let header = MailboxHeader::new(MailboxProtocol::Coe, MailboxCounter::new(counter).expect("0 to 7"));
        rig.message_with(header, &[0, 0x20, 0x40, low, high, sub, 0, 0, 0, 0])
    };
    let [ours, theirs] = [request(&rig, 1, 0x1018, 1), request(&rig, 2, 0x1018, 2)];
    assert_eq!([rig.post(FIRST, &ours), rig.post(FIRST, &theirs)], [1, 1]);
    let subs: Vec<u8> = std::iter::from_fn(|| rig.collect(FIRST)).map(|answer| answer[11]).collect();
    assert_eq!(subs, [1, 2], "in their order, each once");
    let same_counter = request(&rig, 2, 0x1018, 3);
    assert_eq!((rig.post(FIRST, &same_counter), rig.collect(FIRST)), (1, None));

    // A segmented transfer that the other master disturbs is over: the next segment is refused, and nothing is written.
    let part = SdoValuePart::First { size: 150, data: &[7; 100] };
    let object = ObjectAddress::new(0x4FFF, 0);
    rig.sdo(FIRST, SdoRequest::Download { object, scope: SdoScope::Entry, value: part });
    assert_eq!(rig.sdo(FIRST, UPLOAD)[2], 0x43);
    let segment = SdoRequest::DownloadSegment { toggle: false, last: true, data: &[8; 50] };
    assert_eq!(rig.sdo(FIRST, segment)[2], 0x80);
    let upload = SdoRequest::Upload { object, scope: SdoScope::Entry };
    assert_eq!(rig.sdo(FIRST, upload)[2..10], [0x41, 0xFF, 0x4F, 0, 0, 0, 0, 0], "it is empty");
}

/// ECAT-9.12 An EEPROM keeps the words that a master has written before it stops: with the old checksum nothing is
/// loaded at power-on, PreOP is refused, and writing the rest repairs it. A command that runs at the loss of power has
/// no effect.
#[test]
fn an_eeprom_is_written_in_part() {
    const TAKES: u64 = 5 * MS;
    let mut rig = Rig::with_stations([drive(EscSettings { eeprom_ns: TAKES, ..EscSettings::default() })]);
    let write = |rig: &mut Rig, word: u8, value: u16| {
        let [low, high] = value.to_le_bytes();
        rig.write(FIRST, registers::SII_CONTROL, &[1, 2, word, 0, 0, 0, low, high]);
    };
    let old = rig.chain.slave(0).controller().eeprom().to_vec();
    let power_cycle = |rig: &mut Rig| {
        rig.power_cycle(0);
        rig.give_stations();
    };
    // While the command runs, the interface is busy and takes nothing.
    write(&mut rig, 4, 0x1234);
    assert_ne!(rig.read_u16(FIRST, registers::SII_CONTROL) & SiiControl::BUSY.0, 0);
    let refused = rig.one(Command::Fpwr, FIRST, registers::SII_CONTROL, &[1, 2, 5, 0, 0, 0, 9, 9]);
    assert_eq!(refused.wkc, 0);
    power_cycle(&mut rig);
    assert!(rig.chain.slave(0).controller().eeprom() == old, "the power was lost before it was done");

    // The alias is written, its checksum is not.
    write(&mut rig, 4, 0x1234);
    rig.now += TAKES;
    assert_eq!(rig.read_u16(FIRST, registers::SII_CONTROL), 0x0040);
    power_cycle(&mut rig);
    assert_eq!(rig.chain.slave(0).controller().eeprom()[8..10], [0x34, 0x12]);
    assert_eq!(rig.read_u16(FIRST, registers::STATION_ALIAS), 0, "nothing is loaded");
    assert_eq!(rig.read_u16(FIRST, registers::SII_CONTROL), 0x1840);
    assert_eq!(rig.read_u16(FIRST, registers::DL_STATUS) & DlStatus::SII_LOADED, 0);
    rig.set_mailbox(FIRST);
    assert_eq!(rig.request(FIRST, 2), (0x11, AlStatus::EEPROM_ERROR));

    let first: [u8; 14] = rig.chain.slave(0).controller().eeprom()[..14].try_into().expect("14 bytes");
    write(&mut rig, 7, ecmsk::ethercat::sii::checksum(&first).into());
    rig.now += TAKES;
    rig.read_u16(FIRST, registers::SII_CONTROL);
    power_cycle(&mut rig);
    assert_eq!(rig.read_u16(FIRST, registers::STATION_ALIAS), 0x1234);
    rig.bring_to_preop(FIRST);

    // For each incomplete write the EEPROM does not change, and the next command runs.
    let kept = rig.chain.slave(0).controller().eeprom().to_vec();
    for (ado, data) in [
        (registers::SII_CONTROL, &[1][..]),
        (registers::SII_CONTROL + 1, &[2]),
        (registers::SII_CONTROL, &[0, 2, 4, 0, 0, 0, 9, 9]),
        (registers::SII_ADDRESS, &[4, 0, 0, 0]),
        (registers::SII_DATA, &[9, 9]),
    ] {
        rig.write(FIRST, ado, data);
        rig.now += TAKES;
        rig.read_u16(FIRST, registers::SII_CONTROL);
        assert!(rig.chain.slave(0).controller().eeprom() == kept, "0x{ado:04X} {data:?}");
    }
    write(&mut rig, 0x20, 0xABCD);
    rig.now += TAKES;
    rig.read_u16(FIRST, registers::SII_CONTROL);
    assert_eq!(rig.chain.slave(0).controller().eeprom()[0x40..0x42], [0xCD, 0xAB]);
}

/// ECAT-10.9 FMMUs over all addresses, over each other, and with bits that make no sense: a datagram gets what registers and
/// sync managers give to any other, bytes without a mapping pass, and slaves go on.
#[test]
fn fmmus_over_everything() {
    let both = FmmuDirections(FmmuDirections::READ.0 | FmmuDirections::WRITE.0);
    let whole = Fmmu::bytes(0, u16::MAX, 0, FmmuDirections::READ);
    let states = [AlState::Init, AlState::PreOp, AlState::SafeOp, AlState::Op];
    for (state, directions) in states.into_iter().flat_map(|state| [(state, whole.directions), (state, both)]) {
        let mut rig = Rig::in_state(state);
        for n in 0..8 {
            rig.set_fmmu(FIRST, n, Fmmu { directions, ..whole });
        }
        let read = rig.logical(Command::Lrd, 0, &[0; 4]);
        assert_eq!((read.wkc, &read.data[..2]), (1, &[0x11, 0][..]), "type and revision, through eight FMMUs");
        // All registers and RAM, and beyond their end.
        for at in (0..0x4000).step_by(1486) {
            rig.logical(Command::Lrd, at, &[0; 1486]);
            check(&rig);
        }
        if directions == both {
            // AL control through an FMMU is AL control.
            let written = rig.logical(Command::Lwr, registers::AL_CONTROL.into(), &[0x11, 0]);
            assert_eq!((written.wkc, rig.chain.slave(0).state()), (1, AlState::Init));
            for command in [Command::Lwr, Command::Lrw] {
                for at in (0..0x4000).step_by(1486) {
                    rig.logical(command, at, &[0x5A; 1486]);
                    check(&rig);
                }
            }
        }
    }
    // At the end of logical addresses, without bits, with bits in the wrong order, without bytes.
    let mut rig = Rig::in_state(AlState::Op);
    let odd = [
        Fmmu { logical: u32::MAX - 3, ..Fmmu::bytes(0, 16, 0x0000, both) },
        Fmmu { first_bit: 7, last_bit: 0, ..Fmmu::bytes(0x500, 1, 0x1F00, both) },
        Fmmu { physical_bit: 7, ..Fmmu::bytes(0x600, 1, 0x1F08, both) },
        Fmmu::bytes(0x700, 0, 0x1F10, both),
        Fmmu::bytes(0x800, 16, 0xFFF8, both),
    ];
    for (n, fmmu) in (2..).zip(odd) {
        rig.set_fmmu(FIRST, n, fmmu);
    }
    for (address, data) in [(u32::MAX - 3, 8), (u32::MAX, 4), (0x4FF, 3), (0x5FF, 3), (0x6FF, 3), (0x7FF, 20)] {
        for command in [Command::Lrd, Command::Lwr, Command::Lrw] {
            let answer = rig.logical(command, address, &vec![0xA5; data]);
            assert_eq!(answer.data.len(), data);
            if matches!(address, 0x5FF..=0x6FF) || command == Command::Lwr {
                assert_eq!((answer.data[0], answer.data[data - 1]), (0xA5, 0xA5), "0x{address:X}");
            }
            check(&rig);
        }
    }
    let nothing = rig.logical(Command::Lrw, 0x700, &[0xA5; 3]);
    assert_eq!((nothing.wkc, nothing.data), (0, vec![0xA5; 3]), "an FMMU of no length");
}

/// ECAT-11.1 Mailboxes of each length below the least one are refused in PreOP with 0x16. ECAT-10.10 An area of two
/// sync managers belongs to the one with the lower number.
#[test]
fn sync_managers_too_small_or_over_each_other() {
    for len in 0..=MAILBOX_BYTES_MIN {
        let mut rig = Rig::drives(1);
        rig.set_manager(FIRST, 0, SyncManager::enabled(0x1000, len, SmControl::MAILBOX_OUT));
        rig.set_manager(FIRST, 1, SyncManager::enabled(0x1080, len, SmControl::MAILBOX_IN));
        // A write to an area that is no mailbox yet.
        rig.post(FIRST, &vec![0xFF; len.max(1).into()]);
        let expected = if len < MAILBOX_BYTES_MIN { (0x11, AlStatus::INVALID_MAILBOX) } else { (0x02, AlStatus::NONE) };
        assert_eq!(rig.request(FIRST, 0x02), expected, "{len}");
    }
    // In the smallest mailbox a long value goes in segments both ways.
    let mut rig = Rig::drives(1);
    rig.set_manager(FIRST, 0, SyncManager::enabled(0x1000, MAILBOX_BYTES_MIN, SmControl::MAILBOX_OUT));
    rig.set_manager(FIRST, 1, SyncManager::enabled(0x1080, MAILBOX_BYTES_MIN, SmControl::MAILBOX_IN));
    rig.reach(FIRST, AlState::PreOp);
    let mut message = vec![0; MAILBOX_BYTES_MIN.into()];
    let data = [0, 0x20, 0x40, 0x08, 0x10, 0, 0, 0, 0, 0];
    let header = MailboxHeader::new(MailboxProtocol::Coe, MailboxCounter::NONE);
    MailboxMessage { header, data: &data }.encode(&mut message).expect("room");
    assert_eq!(rig.post(FIRST, &message), 1);
    let answer = rig.one(Command::Fprd, FIRST, 0x1080, &[0; MAILBOX_BYTES_MIN as usize]);
    assert_eq!((answer.wkc, answer.data[8]), (1, 0x41));

    // Process data that overlap the mailbox, each other, registers, or the end of the RAM.
    for (outputs, inputs) in [
        (0x1000, INPUTS),
        (OUTPUTS, OUTPUTS),
        (OUTPUTS, OUTPUTS + 2),
        (OUTPUTS, 0x1040),
        (0x0FFE, INPUTS),
        (0x2FFE, INPUTS),
    ] {
        for device in 0..2 {
            let mut rig = match device {
                0 => Rig::new([drive(EscSettings::default())]),
                _ => Rig::new([slave(Box::new(Dp3cl::new(Dp3clConfig::default())), EscSettings::default())]),
            };
            rig.give_stations();
            rig.bring_to_preop(FIRST);
            let (out_len, in_len) = rig.lens(FIRST);
            rig.set_manager(FIRST, 2, SyncManager::enabled(outputs, out_len, SmControl::OUTPUTS));
            rig.set_manager(FIRST, 3, SyncManager::enabled(inputs, in_len, SmControl::INPUTS));
            let (status, code) = rig.request(FIRST, 0x04);
            check(&rig);
            let is_outside = matches!(outputs, 0x0FFE | 0x2FFE);
            if is_outside {
                assert_eq!((status, code), (0x12, AlStatus::INVALID_OUTPUTS));
            } else if device == 1 {
                // E-811 and E-817 of the drive.
                assert!(matches!(code, AlStatus::INVALID_OUTPUTS | AlStatus::INVALID_INPUTS), "{status:X} {code}");
            }
            for ado in [0x1000, 0x1040, 0x1080, outputs, inputs] {
                for command in [Command::Fpwr, Command::Fprd, Command::Fprw] {
                    rig.one(command, FIRST, ado, &[0xA5; 200]);
                    check(&rig);
                }
            }
        }
    }
    // Two buffers of equal direction: the one with the lower number has the bytes that both would have.
    let mut rig = Rig::drives(1);
    rig.set_manager(FIRST, 4, SyncManager::enabled(0x1F00, 8, SmControl::MAILBOX_OUT));
    rig.set_manager(FIRST, 5, SyncManager::enabled(0x1F04, 8, SmControl::MAILBOX_OUT));
    assert_eq!(rig.one(Command::Fpwr, FIRST, 0x1F00, &[1; 8]).wkc, 1);
    let full = |rig: &mut Rig, n| rig.read_u8(FIRST, registers::sync_manager_status(n)) & 0x08;
    assert_eq!((full(&mut rig, 4), full(&mut rig, 5)), (8, 0));
    assert_eq!(rig.one(Command::Fpwr, FIRST, 0x1F04, &[2; 4]).wkc, 0, "it is full");
    assert_eq!(rig.one(Command::Fpwr, FIRST, 0x1F08, &[2; 4]).wkc, 0, "the other one was not opened by its first byte");
}

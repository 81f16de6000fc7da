//! Invalid frames: whatever comes, slaves go on, in a valid state, and a frame allocates nothing.

use ecmsk::coe::{ObjectAddress, SdoRequest, SdoScope};
use ecmsk::ethercat::registers::{self, RequestedState};
use ecmsk::ethercat::{AlState, Command, DatagramHeader};
use ecmsk::slave::esc::FrameFate;

use support::dice::Dice;
use support::schedules::asked;

use super::rig::{FIRST, Rig, US, frame_of};

/// Important addresses, so that random frames often hit one.
const ADDRESSES: [u16; 24] = [
    0x0010, 0x0040, 0x0100, 0x0120, 0x0130, 0x0200, 0x0300, 0x0400, 0x0420, 0x0500, 0x0502, 0x0600, 0x0610, 0x0800,
    0x0806, 0x0808, 0x080E, 0x0810, 0x0818, 0x0900, 0x0910, 0x0980, 0x0990, 0x1000,
];

/// A datagram: command, address, data. Numbers are often small, and addresses often important ones.
fn datagram(dice: &mut Dice) -> (DatagramHeader, Vec<u8>) {
    let command = Command::from_code(dice.below(17) as u8);
    let any = dice.below(0x1_0000) as u16;
    let adp = dice.pick(&[0, FIRST, FIRST + 1, 0xFFFF, any]);
    let place = dice.pick(&ADDRESSES) + dice.below(10) as u16;
    let ado = match dice.below(8) {
        0 => 0x1000 + dice.below(0x300) as u16,
        1 => any,
        _ => place,
    };
    let is_logical = matches!(command, Command::Lrd | Command::Lwr | Command::Lrw);
    let header = DatagramHeader::register(command, 1, adp, if is_logical { 0 } else { ado });
    let len = match dice.below(10) {
        0..=6 => 1 + dice.below(20),
        7..=8 => 128,
        _ => dice.below(300),
    };
    let byte = |dice: &mut Dice| match dice.below(4) {
        0 => dice.below(256) as u8,
        _ => dice.below(9) as u8,
    };
    (header, (0..len).map(|_| byte(dice)).collect())
}

/// A frame of one to three datagrams.
fn frame(dice: &mut Dice) -> Vec<u8> {
    let datagrams: Vec<_> = (0..=dice.below(9) / 4).map(|_| datagram(dice)).collect();
    let datagrams: Vec<_> = datagrams.iter().map(|(header, data)| (*header, &data[..])).collect();
    frame_of(&datagrams)
}

/// Checks that each slave is in a valid state, and shows the state of its device.
#[track_caller]
pub fn check(rig: &Rig) {
    for n in 0..rig.chain.len() {
        let slave = rig.chain.slave(n);
        let shown = slave.controller().peek(registers::AL_STATUS, 2);
        let state = RequestedState::from_code(shown[0]);
        assert_eq!(state, slave.shown_state(), "{shown:X?}");
        // In bootstrap the device is in Init.
        let of_device = if state == RequestedState::Boot { AlState::Init } else { slave.state() };
        assert_eq!((slave.state(), slave.device().state()), (of_device, of_device));
        assert!(shown[0] & 0xC0 == 0 && shown[1] == 0, "{shown:X?}");
    }
}

/// Frames in each state. `cargo xtask soak` sends more: `ECMSK_SOAK_FRAMES=<frames>`, `ECMSK_SOAK_FIRST=<seed>`.
const FRAMES: u64 = 20_000;
/// The most frames that slaves get after they have left the state, before the state is set up again.
const ELSEWHERE_MAX: u64 = 50;
const RIG_MAX: u64 = 500;

/// ECAT-14.1 Whatever frames come, in whatever state, each slave is in a valid state and shows it.
#[test]
fn random_frames_leave_slaves_in_states_that_there_are() {
    let frames = asked("ECMSK_SOAK_FRAMES").unwrap_or(FRAMES);
    let mut dice = Dice(asked("ECMSK_SOAK_FIRST").unwrap_or(0));
    for state in [AlState::Init, AlState::PreOp, AlState::SafeOp, AlState::Op] {
        // Only frames count that come to a slave in the state.
        let mut counted = 0;
        let mut left = 0_u64;
        while counted < frames {
            let mut rig = Rig::in_state(state);
            let (mut here, mut elsewhere) = (0, 0);
            while here < RIG_MAX && elsewhere < ELSEWHERE_MAX {
                if rig.chain.slave(0).state() == state {
                    here += 1;
                } else {
                    elsewhere += 1;
                }
                rig.pause = US * dice.below(5_000);
                let mut bytes = frame(&mut dice);
                rig.raw(&mut bytes);
                check(&rig);
            }
            counted += here;
            left += u64::from(elsewhere > 0);
        }
        assert!(left > 0 || state == AlState::Init, "no slave has ever left {state:?}");
    }
}

/// ECAT-14.1 Bytes that are no frames, and frames that are cut or changed, do no harm.
#[test]
fn torn_frames_harm_nobody() {
    let mut rig = Rig::in_state(AlState::Op);
    let whole = frame_of(&[
        (DatagramHeader::new(Command::Lrw, 1, 0), &[0; 40]),
        (DatagramHeader::register(Command::Fprd, 2, FIRST, 0x0130), &[0; 6]),
    ]);
    for len in 0..whole.len() {
        rig.raw(&mut whole[..len].to_vec());
        check(&rig);
    }
    for at in 14..whole.len() {
        for bit in 0..8 {
            let mut changed = whole.clone();
            changed[at] ^= 1 << bit;
            rig.raw(&mut changed);
            check(&rig);
        }
    }
}

/// ECAT-14.2 A frame allocates nothing, whatever it carries in a cycle: process data, clocks, states, a short SDO.
#[test]
fn a_frame_allocates_nothing() {
    let mut rig = Rig::drives(10);
    for n in 0..10 {
        rig.bring_to_op(FIRST + n, u32::from(n) * 100);
    }
    let cyclic = frame_of(&[
        (DatagramHeader::register(Command::Frmw, 1, FIRST, registers::SYSTEM_TIME), &[0; 8]),
        (DatagramHeader::new(Command::Lrw, 2, 0), &[0; 1000]),
        (DatagramHeader::register(Command::Brd, 3, 0, registers::AL_STATUS), &[0; 2]),
        (DatagramHeader::register(Command::Bwr, 4, 0, registers::RECEIVE_TIMES), &[0; 4]),
    ]);

    let mut room = [0; 20];
    let upload = SdoRequest::Upload { object: ObjectAddress::new(0x6041, 0), scope: SdoScope::Entry };
    let len = ecmsk::coe::CoeMessage::SdoRequest(upload).encode(&mut room).expect("room");
    let request = rig.message(ecmsk::ethercat::mailbox::MailboxProtocol::Coe, &room[..len]);
    let mails = [(Command::Fpwr, 0x1000, &request[..]), (Command::Fprd, 0x1080, &[0; 128])]
        .map(|(command, ado, data)| frame_of(&[(DatagramHeader::register(command, 5, FIRST, ado), data)]));
    rig.pause = 250 * US;
    let mut counts = Vec::with_capacity(1000);
    let counted = allocation_counter::measure(|| {
        let mut bytes = [0; 1514];
        for _ in 0..300 {
            for frame in [&cyclic, &mails[0], &mails[1]] {
                let bytes = &mut bytes[..frame.len()];
                bytes.copy_from_slice(frame);
                assert!(matches!(rig.raw(bytes), FrameFate::Returned(_)));
                counts.push(bytes[frame.len() - 2]);
            }
        }
    });
    assert_eq!(counted.count_total, 0);
    assert_eq!(rig.al_status(FIRST).0, 8);
    // The mailbox frame ends with its working counter: the first request was worked on, the same ones again were dropped.
    assert_eq!((counts[1], counts[2], counts[4], counts[5]), (1, 1, 1, 0));
}

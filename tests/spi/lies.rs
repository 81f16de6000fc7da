//! Faulty wires are named.

use std::time::Duration;

use ecmsk::link::spi::AnswerCheck;
use ecmsk::link::{Link, LinkError, Wait};
use ecmsk::sk::{CommandId, Frame, MasterState, RawSlot, SlotSize};

use super::frames::{axes, state, to};
use super::wires::{Busy, Held};

const BOARD: &str = "sim:?queue=1&slaves=drive*3";
const LINK: &str = "spi:/dev/spidev0.0";

#[track_caller]
fn refused(held: &Held, uri: &str) -> String {
    match held.open(uri).err().expect("it does not open") {
        LinkError::NoBoard { name, reason } => {
            assert_eq!(name, "spi:test");
            reason
        }
        other => panic!("{other:?}"),
    }
}

#[track_caller]
fn says(reason: &str, parts: &[&str]) {
    for part in parts {
        assert!(reason.contains(part), "{reason}: no {part}");
    }
}

/// Moves the bits of an answer.
fn shift(bits: usize, late: bool) -> impl FnMut(&[u8], &mut [u8]) + Send + 'static {
    move |_, answer| {
        let before: Vec<bool> =
            answer.iter().flat_map(|byte| (0..8).rev().map(move |bit| byte >> bit & 1 == 1)).collect();
        let at = |index: usize| {
            let from = if late { index.checked_sub(bits) } else { Some(index + bits) };
            from.and_then(|from| before.get(from)).copied().unwrap_or(false)
        };
        for (number, byte) in answer.iter_mut().enumerate() {
            *byte = (0..8).fold(0, |byte, bit| byte << 1 | u8::from(at(number * 8 + bit)));
        }
    }
}

/// MISO that never changes.
#[test]
fn a_stuck_miso_is_named() {
    let held = Held::board(BOARD).tamper(|_, answer| answer.fill(0xFF));
    says(&refused(&held, LINK), &["all ones", "MISO (J3/J2 pin 9)", "power"]);
    for busy in [Busy::True, Busy::None] {
        let held = Held::board(BOARD).busy(busy).tamper(|_, answer| answer.fill(0));
        says(&refused(&held, LINK), &["all zeros", "CONFIG0", "SCLK (pin 8)"]);
    }
}

/// MISO connected to MOSI.
#[test]
fn miso_joined_to_mosi_is_named() {
    let held = Held::board(BOARD).tamper(|question, answer| answer.copy_from_slice(question));
    says(&refused(&held, LINK), &["MISO repeats what MOSI says", "connect each to its own pin"]);
}

/// Answers that come too late or too early, with a board that fills the CRC.
#[test]
fn answers_shifted_by_bits_or_bytes_are_named() {
    for bits in [1, 2, 7] {
        let held = Held::board(BOARD).tamper(shift(bits, true));
        says(&refused(&held, LINK), &[&format!("{bits} bit(s) too late"), "mode=1", "speed="]);
        let held = Held::board(BOARD).tamper(shift(bits, false));
        says(&refused(&held, LINK), &[&format!("{bits} bit(s) too early"), "mode=1", "speed="]);
    }
    for bytes in [1, 3] {
        let held = Held::board(BOARD).tamper(shift(8 * bytes, true));
        says(&refused(&held, LINK), &[&format!("{bytes} byte(s) too late"), "chip select"]);
    }
    let held = Held::board(BOARD).tamper(shift(8, false));
    says(&refused(&held, LINK), &["1 byte(s) too early", "chip select"]);
}

/// Noise.
#[test]
fn noise_is_named() {
    let mut noise = 1_u32;
    let held = Held::board(BOARD).tamper(move |_, answer| {
        for byte in answer {
            noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            *byte = (noise >> 24) as u8;
        }
    });
    says(&refused(&held, LINK), &["neither a right CRC nor the form of a frame", "slower speed=", "slot= and mode="]);
}

/// SK-10.13 A slot size other than the board's is detected, and the right one suggested, for either size.
#[test]
fn another_slot_size_is_found_and_the_right_one_proposed() {
    let held = Held::board("sim:?queue=1&slot=16");
    says(&refused(&held, LINK), &["slots of 16 bytes, not of 12", "CONFIG2", "set slot=16"]);
    let held = Held::board(BOARD);
    says(&refused(&held, "spi:/dev/spidev0.0?slot=16"), &["slots of 12 bytes, not of 16", "CONFIG2", "set slot=12"]);
    assert!(held.open(LINK).is_ok());
}

/// The same without a CRC in the answers: the format of the slots shows it.
#[test]
fn without_a_crc_faults_are_found_by_the_form_of_slots() {
    fn no_crc(answer: &mut [u8]) {
        answer[3] = 0;
    }
    let held = Held::board(BOARD).tamper(|_, answer| no_crc(answer));
    let link = held.open(LINK).expect("a board that fills no CRC");
    let mut report = Frame::new();
    link.read(&mut report, Wait::For(Duration::from_secs(10))).unwrap();
    assert_eq!((state(&report), report.crc_byte()), (Some(MasterState::PreOp), 0));
    drop(link);
    let mut slipped = shift(1, true);
    let held = Held::board(BOARD).tamper(move |question, answer| {
        no_crc(answer);
        slipped(question, answer);
    });
    says(&refused(&held, LINK), &["1 bit(s) too late"]);
}

/// SK-2.9 A board that fills no CRC may show any state byte, and outside OP any bytes 8..11 of slot 0: its answers are judged
/// by the ids of their slots, once an id of slot 0 has shown that they are in step. In OP the free count is 160 at most
/// (ecm-sk 2).
#[test]
fn without_a_crc_any_state_is_an_answer() {
    let size = SlotSize::Bytes12;
    const LIO_RD: u8 = 0x21;
    let answer = |id: u8, state: u8, data2: u32| {
        let mut answer = Frame::new();
        answer.put(size, 0, &RawSlot { id, parm: state.into(), data1: 3, data2, ..RawSlot::ZERO });
        answer
    };
    let accepts = |id: u8, state: u8, data2: u32| {
        let mut answer_check = AnswerCheck::new(size);
        assert!(answer_check.check(&answer(LIO_RD, 0x1F, 0)).is_ok());
        answer_check.check(&answer(id, state, data2)).is_ok()
    };
    let mut new = AnswerCheck::new(size);
    assert!(new.check(&answer(0, 0x1F, 0)).is_err() && new.check(&answer(0, 2, 0)).is_ok(), "not known to be in step");
    for state in 0..=u8::MAX {
        for data2 in [0, 160, 7 << 16 | 160] {
            assert!(accepts(0, state, data2) && accepts(LIO_RD, state, data2), "{state:02x} {data2:x}");
        }
        // No command of slot 0: CSP, SDO_RD, and an unknown id.
        assert!([0x15, 0x07, 0x5F].iter().all(|id| !accepts(*id, state, 0)), "{state:02x}");
    }
    assert!([0x08, 0x18, 0x1F, 0x03].iter().all(|state| accepts(0xBF, *state, 160)), "the cyclic response");
    assert!([0x01, 0x02, 0x04, 0x14].iter().all(|state| !accepts(0xBF, *state, 160)), "which is for OP alone");
    assert!([0x08, 0x18].iter().all(|state| !accepts(0xBF, *state, 161)));

    // Over a whole link, from its opening on.
    let held = Held::board(BOARD).tamper(|_, answer| (answer[2], answer[3], answer[8]) = (0x1F, 0, 0x33));
    let link = held.open(LINK).expect("a board that shows a failure");
    let mut report = Frame::new();
    for _ in 0..40 {
        link.read(&mut report, Wait::For(Duration::from_secs(10))).unwrap();
        assert_eq!(report.bytes()[2], 0x1F);
    }
    assert_eq!(link.spi_stats().invalid_answers, 0);
}

/// SK-10.4 BUSY that never falls or never rises, when the link is opened.
#[test]
fn a_stuck_busy_is_named() {
    let held = Held::board(BOARD).busy(Busy::High);
    says(&refused(&held, LINK), &["BUSY has been high", "busy=", "J3/J2 pin 5", "switch it off and on"]);
    assert!(held.with(|state| state.exchanges.is_empty()), "nothing begins while it is high");
    let held = Held::board(BOARD).busy(Busy::Low);
    says(&refused(&held, LINK), &["BUSY does not go high", "busy=", "leave busy= out"]);
}

/// A wire that comes off later ends every call with the same text; invalid answers are not passed on, and a few of them
/// do not end the link.
#[test]
fn a_wire_that_comes_off_ends_every_call_with_its_name() {
    type Break = fn(&Held);
    let breaks: [(Break, &str); 5] = [
        (|held| held.with(|state| state.busy = Busy::High), "BUSY has been high"),
        (|held| held.with(|state| state.busy = Busy::Low), "BUSY does not go high"),
        (|held| held.with(|state| state.tamper = Some(Box::new(|_, answer| answer.fill(0xFF)))), "all ones"),
        (|held| held.with(|state| state.tamper = Some(Box::new(|_, answer| answer.fill(0)))), "all zeros"),
        (|held| held.with(|state| state.fails = true), "no such device"),
    ];
    for (come_off, words) in breaks {
        let held = Held::board(BOARD);
        let link = held.open(LINK).unwrap();
        let mut report = Frame::new();
        link.read(&mut report, Wait::For(Duration::from_secs(10))).unwrap();
        come_off(&held);
        let lost = loop {
            match link.read(&mut report, Wait::For(Duration::from_secs(20))) {
                Ok(_) => assert_eq!(state(&report), Some(MasterState::PreOp), "what is no answer is not handed on"),
                Err(error) => break error,
            }
        };
        assert!(matches!(&lost, LinkError::Lost { reason, .. } if reason.contains(words)), "{words}: {lost:?}");
        assert_eq!(link.check(), Err(lost.clone()));
        assert_eq!(link.write(&Frame::new(), Wait::Forever), Err(lost));
    }
}

/// An occasional invalid answer is left out and counted; its number is missing.
#[test]
fn an_occasional_bad_answer_is_left_out_and_counted() {
    let held = Held::board(BOARD);
    let link = held.open(LINK).unwrap();
    let mut number = 0;
    held.clone().tamper(move |_, answer| {
        number += 1;
        if number % 5 == 0 {
            answer[100] ^= 0x10;
        }
    });
    axes().chain([to(MasterState::Op)]).for_each(|frame| assert!(link.write(&frame, Wait::Forever).is_ok()));
    let mut report = Frame::new();
    let mut last = None;
    while state(&report) != Some(MasterState::Op) {
        let meta = link.read(&mut report, Wait::For(Duration::from_secs(20))).unwrap();
        assert!(last.is_none_or(|last| meta.sequence > last));
        last = Some(meta.sequence);
        assert_eq!(report.bytes()[100], 0);
    }
    // From now on none is invalid; once everything in the queue has been read, every invalid one precedes the last
    // report.
    held.tamper(|_, _| {});
    for _ in 0..100 {
        last = Some(link.read(&mut report, Wait::For(Duration::from_secs(20))).unwrap().sequence);
    }
    let invalid_answers = link.spi_stats().invalid_answers;
    assert!(invalid_answers > 0);
    assert!(last.unwrap() + 1 >= link.stats().read + invalid_answers);
}

/// An invalid answer has a right CRC once in 256 times: a board without a CRC is not taken for one that fills it
/// because of that, and its next answers are accepted. A board with a different, right CRC in each answer is taken for
/// one that fills it.
#[test]
fn a_crc_that_is_right_by_chance_does_not_make_a_board_with_crcs() {
    let answer = |inputs: u32| {
        let mut answer = Frame::new();
        let slot = RawSlot { id: CommandId::LocalRead.code(), parm: 2, data1: inputs, ..RawSlot::ZERO };
        answer.put(SlotSize::Bytes12, 0, &slot);
        answer
    };
    let with_crc = |inputs| {
        let mut answer = answer(inputs);
        answer.fill_crc(SlotSize::Bytes12);
        answer
    };
    let mut answer_check = AnswerCheck::new(SlotSize::Bytes12);
    assert!(answer_check.check(&answer(1)).is_ok());
    let mut noise = Frame::from_bytes([0x5B; 512]);
    noise.fill_crc(SlotSize::Bytes12);
    for _ in 0..3 {
        assert!(answer_check.check(&noise).is_ok(), "nothing tells that it is none");
    }
    assert!(!answer_check.fills_crc());
    assert!(answer_check.check(&answer(2)).is_ok());
    assert!(answer_check.check(&with_crc(1)).is_ok() && !answer_check.fills_crc());
    assert!(answer_check.check(&with_crc(2)).is_ok() && answer_check.fills_crc());
    assert!(answer_check.check(&answer(3)).is_err(), "from now on each has to have one");
}

//! The board's side of the wires.

use std::time::Duration;

use ecmsk::link::{self, Share, Wait};
use ecmsk::port::spi::Face;
use ecmsk::sk::{CrcPolicy, Frame, MasterCommand, MasterState, SlotSize};

use super::frames::{SIZE, board, master, state};

fn face(keys: &str) -> Face {
    Face::new(link::open(&format!("sim:?queue=1&clock=virtual&{keys}"), Share::ByName).unwrap())
}

fn exchange(face: &mut Face, frame: &Frame) -> Frame {
    let mut answer = Frame::from_bytes([0xA5; 512]);
    let length = face.frame_len();
    face.exchange(&frame.bytes()[..length], &mut answer.bytes_mut()[..length]);
    answer
}

/// WIRE-40, SK-10.3 The answer comes in an exchange after the command's, never in the same.
#[test]
fn an_answer_belongs_to_an_earlier_exchange() {
    let mut face = face("slaves=drive");
    assert!(!face.is_busy());
    let first = exchange(&mut face, &board(&MasterCommand::LocalRead));
    assert_eq!((master(&first).id, state(&first)), (0, Some(MasterState::PreOp)));
    assert_eq!(first.check_crc(SIZE, CrcPolicy::Strict), Ok(()));
    let second = exchange(&mut face, &Frame::new());
    assert_eq!(master(&second).id, 0x21, "that to the command before, however soon");
    assert_eq!(master(&exchange(&mut face, &Frame::new())).id, 0);
    assert_eq!(face.counters().frames, 3);
}

/// WIRE-40, SK-10.3 Fewer bytes than a frame are none; more are answered by zeros.
#[test]
fn an_exchange_is_a_whole_frame() {
    let mut face = face("slaves=drive");
    let reset = board(&MasterCommand::SoftReset);
    let mut answer = [0xA5; 512];
    face.exchange(&reset.bytes()[..503], &mut answer[..503]);
    assert!(!face.is_busy());
    face.exchange(&board(&MasterCommand::GetStatus).bytes()[..], &mut answer);
    assert_eq!(answer[504..], [0; 8]);
    assert_eq!((face.counters().frames, face.counters().incomplete), (1, 1));
    let mut wide = Face::new(link::open("sim:?queue=1&clock=virtual&slot=16", Share::ByName).unwrap());
    assert_eq!(wide.frame_len(), 512);
    let answer = exchange(&mut wide, &Frame::new());
    assert_eq!(answer.check_crc(SlotSize::Bytes16, CrcPolicy::Strict), Ok(()));
}

/// WIRE-40, SK-10.5 While the board starts up BUSY is high; a host that does not look at it gets zeros and is not heard.
/// SK-10.9 RESETN does what SW_RESET does.
#[test]
fn busy_is_high_while_the_board_starts_up() {
    for by_line in [false, true] {
        let board_of = || link::open("sim:?queue=1&clock=virtual&name=face", Share::ByName);
        let link = board_of().unwrap();
        let mut face = Face::new(link.clone());
        if by_line {
            face.reset();
        } else {
            exchange(&mut face, &board(&MasterCommand::SoftReset));
            // The board's time passes by calls alone.
            let _ = link.read(&mut Frame::new(), Wait::For(Duration::from_millis(5)));
            let _ = link.read(&mut Frame::new(), Wait::For(Duration::from_millis(5)));
        }
        assert!(face.is_busy() && face.lost().is_some());
        assert_eq!(exchange(&mut face, &board(&MasterCommand::LocalWrite(1))).bytes()[..504], [0; 504]);
        assert_eq!(face.counters().while_busy, 1);
        link.close();
        let again = (0..10_000).find_map(|_| board_of().ok()).expect("it starts up");
        face.replace(again.clone());
        assert!(!face.is_busy());
        assert_eq!(state(&exchange(&mut face, &Frame::new())), Some(MasterState::PreOp));
        again.close();
    }
}

use super::*;
use crate::link::{Dir, LinkInfo, LinkStats};
use crate::sk::{FifoAction, MasterCommand, MasterState, Motion, SlaveCommand};

const SIZE: SlotSize = SlotSize::Bytes12;
const GO_HOME: SlaveCommand = SlaveCommand::GoHome;

/// A board that takes every frame, and whose axis 1 is at the position that the test sets.
#[derive(Default)]
struct Board {
    sent: Mutex<Vec<Frame>>,
    position: Mutex<i32>,
    statusword: Mutex<u16>,
}

impl Link for Board {
    fn info(&self) -> LinkInfo {
        LinkInfo {
            name: "board:".to_owned(),
            slot: Some(SIZE),
            virtual_time: true,
            opened_at: Stamp(0),
            read_wait: Wait::Forever,
            write_wait: Wait::Forever,
        }
    }

    fn write(&self, frame: &Frame, _: Wait) -> Result<Stamp, LinkError> {
        self.sent.lock().push(frame.clone());
        Ok(Stamp(7))
    }

    fn read(&self, out: &mut Frame, _: Wait) -> Result<ReadMeta, LinkError> {
        let (parm, position) = (*self.statusword.lock(), *self.position.lock());
        let slot = RawSlot { parm, data1: position as u32, ..RawSlot::ZERO };
        out.put(SIZE, 1, &slot);
        Ok(ReadMeta::default())
    }

    fn cancel(&self, _: Dir) {}

    fn close(&self) {}

    fn check(&self) -> Result<(), LinkError> {
        Ok(())
    }

    fn stats(&self) -> LinkStats {
        LinkStats::default()
    }
}

/// A board, and the link around it that checks these limits of axis 1 and does not send targets beyond them.
fn board(min: i32, max: i32) -> (Arc<Board>, Arc<dyn Link>) {
    let text = format!(
        "format = 1\n[axes]\nX = {{ slave = 1, min = {min}, max = {max} }}\nY = {{ slave = 2 }}\n[limits]\nprogram = \"stop\"\n"
    );
    let machine = MachineFile::parse("machine.toml", &text).unwrap();
    let axes = Axes { machine, carried: Arc::new(CarriedFile::new("machine.toml".as_ref(), &text)) };
    let board = Arc::new(Board::default());
    (Arc::clone(&board), axes.around(board))
}

fn frame(commands: &[(usize, SlaveCommand)]) -> Frame {
    let mut frame = Frame::new();
    for (slave, command) in commands {
        frame.put_slave(SIZE, *slave, &command.with_index(9));
    }
    frame
}

fn csp(target: i32) -> SlaveCommand {
    SlaveCommand::Csp(Motion::to(target))
}

/// Whether the board gets this target of axis 1.
fn takes(link: &Arc<dyn Link>, target: i32) -> bool {
    match link.write(&frame(&[(1, csp(target))]), Wait::Forever) {
        Ok(_) => true,
        Err(LinkError::BeyondLimit { .. }) => false,
        Err(error) => panic!("{error}"),
    }
}

fn stands(board: &Board, link: &Arc<dyn Link>, position: i32) {
    *board.position.lock() = position;
    link.read(&mut Frame::new(), Wait::Forever).unwrap();
}

/// An axis beyond one limit may come back, but a target beyond the other limit is not sent.
#[test]
fn an_axis_beyond_one_limit_does_not_go_beyond_the_other() {
    let (board, link) = board(100, 200);
    stands(&board, &link, 0);
    for (target, is_sent) in [(0, true), (-1, false), (201, false), (299, false), (200, true), (201, false)] {
        assert_eq!(takes(&link, target), is_sent, "{target}");
    }
    // The axis has come back, so its earlier position is beyond the limit again.
    stands(&board, &link, 150);
    assert!(!takes(&link, 99) && takes(&link, 100) && takes(&link, 200));
    // The same beyond the upper limit.
    stands(&board, &link, 230);
    for (target, is_sent) in [(231, false), (70, false), (230, true), (215, true), (216, true), (231, false)] {
        assert_eq!(takes(&link, target), is_sent, "{target}");
    }
}

/// Homing gives an axis new coordinates: neither its last target nor its last position counts.
#[test]
fn homing_forgets_where_the_axis_was() {
    let (board, link) = board(100, 200);
    stands(&board, &link, 0);
    assert!(takes(&link, 50));
    link.write(&frame(&[(1, GO_HOME)]), Wait::Forever).unwrap();
    assert!(!takes(&link, 50));
}

/// While an axis is enabled, and so on its way to its last target, targets no farther out than that are allowed. An
/// axis that was switched off may have been moved by hand.
#[test]
fn a_target_of_an_axis_that_was_off_is_forgotten() {
    let (board, link) = board(100, 200);
    *board.statusword.lock() = 0x1637;
    stands(&board, &link, 250);
    assert!(takes(&link, 250));
    stands(&board, &link, 199);
    assert!(takes(&link, 240), "it is on its way");
    *board.statusword.lock() = 0x1650;
    stands(&board, &link, 150);
    *board.statusword.lock() = 0x1637;
    stands(&board, &link, 150);
    assert!(!takes(&link, 240) && takes(&link, 200));
}

/// A frame with a target beyond a limit reaches the board without its CSP targets, but with all other commands: those
/// that switch axes off, end a homing, clear the FIFO, leave OP or brake an axis in CSV. The slots keep their marks,
/// and the CRC stays right.
#[test]
fn what_stops_axes_is_sent_beside_a_target_beyond_a_limit() {
    let (board, link) = board(0, 100);
    let others =
        [SlaveCommand::ServoOff, SlaveCommand::AbortHome, SlaveCommand::Csv(Motion::to(0)), SlaveCommand::Cst(0)];
    let masters = [MasterCommand::SetFifo(FifoAction::Clear), MasterCommand::SetState(MasterState::Init)];
    for (other, master) in others.into_iter().zip(masters.into_iter().cycle()) {
        for has_crc in [false, true] {
            let mut written = frame(&[(1, csp(101)), (2, csp(55)), (3, other)]);
            let mut expected = frame(&[(3, other)]);
            for slave in [1, 2] {
                expected.put(SIZE, slave, &RawSlot { index: 9, ..RawSlot::ZERO });
            }
            for frame in [&mut written, &mut expected] {
                frame.put_master(SIZE, &master);
                if has_crc {
                    frame.fill_crc(SIZE);
                }
            }
            let error = link.write(&written, Wait::Forever).unwrap_err();
            let LinkError::BeyondLimit { at_ns: 7, why } = error else { panic!("{error}") };
            assert!(
                why.starts_with("axis X: a target of 101 counts at ")
                    && why.contains("max = 100 counts of machine.toml"),
                "{why}"
            );
            assert!(why.contains("; the frame was sent without its targets (CSP); "), "{why}");
            assert_eq!(board.sent.lock().pop().as_ref(), Some(&expected));
        }
    }
    link.write(&frame(&[(1, csp(100)), (2, csp(55))]), Wait::Forever).unwrap();
    assert_eq!(board.sent.lock().pop(), Some(frame(&[(1, csp(100)), (2, csp(55))])));
}

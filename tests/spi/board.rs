//! The board's side of the wires.

use std::sync::Arc;
use std::time::Duration;

use ecmsk::link::{self, Dir, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Share, Stamp, Wait};
use ecmsk::port::spi::SpiBoard;
use ecmsk::sk::{CrcPolicy, FIFO_ENTRIES, Frame, MasterCommand, MasterState, RawSlot, SlotSize};
use parking_lot::Mutex;

use super::frames::{SIZE, board, master, state, target};

fn spi_board(keys: &str) -> SpiBoard {
    SpiBoard::new(link::open(&format!("sim:?queue=1&clock=virtual&{keys}"), Share::ByName).unwrap())
}

fn exchange(spi_board: &mut SpiBoard, frame: &Frame) -> Frame {
    let mut answer = Frame::from_bytes([0xA5; 512]);
    let length = spi_board.frame_len();
    spi_board.exchange(&frame.bytes()[..length], &mut answer.bytes_mut()[..length]);
    answer
}

/// SK-10.3 The answer comes in an exchange after the command's, never in the same.
#[test]
fn an_answer_belongs_to_an_earlier_exchange() {
    let mut spi_board = spi_board("slaves=drive");
    assert!(!spi_board.is_busy());
    let first = exchange(&mut spi_board, &board(&MasterCommand::LocalRead));
    assert_eq!((master(&first).id, state(&first)), (0, Some(MasterState::PreOp)));
    assert_eq!(first.check_crc(SIZE, CrcPolicy::Strict), Ok(()));
    let second = exchange(&mut spi_board, &Frame::new());
    assert_eq!(master(&second).id, 0x21, "that to the command before, however soon");
    assert_eq!(master(&exchange(&mut spi_board, &Frame::new())).id, 0);
    assert_eq!(spi_board.counters().frames, 3);
}

/// A board in OP whose cycles the test controls: a frame is an entry of its FIFO until a cycle executes it.
#[derive(Default)]
struct Cycles(Mutex<Inside>);

#[derive(Default)]
struct Inside {
    now: u64,
    cycles: u64,
    /// Written frames that arrive after the next report, although their time is before it.
    late: u16,
    entries: u16,
    full: u16,
    report: Option<(Stamp, Frame)>,
}

impl Cycles {
    /// One cycle: an entry is executed, and there is a report of the remaining ones.
    fn pass(&self, fills_crc: bool) {
        let mut inside = self.0.lock();
        inside.now += 1;
        inside.cycles += 1;
        inside.entries = inside.entries.saturating_sub(1);
        let free = FIFO_ENTRIES - inside.entries;
        let in_op = RawSlot { parm: 8, data2: u32::from(free) | u32::from(inside.full) << 16, ..RawSlot::ZERO };
        let mut report = Frame::new();
        report.put(SIZE, 0, &in_op);
        if fills_crc {
            report.fill_crc(SIZE);
        }
        inside.report = Some((Stamp(inside.now), report));
        inside.entries += std::mem::take(&mut inside.late);
    }

    /// Lets the newest frame arrive after the next report.
    fn hold_one(&self) {
        let mut inside = self.0.lock();
        inside.entries -= 1;
        inside.late += 1;
    }

    fn entries(&self) -> u16 {
        self.0.lock().entries
    }
}

impl Link for Cycles {
    fn info(&self) -> LinkInfo {
        let wait = Wait::For(Duration::ZERO);
        LinkInfo {
            name: "cycles".to_owned(),
            slot: Some(SIZE),
            virtual_time: false,
            opened_at: Stamp(0),
            read_wait: wait,
            write_wait: wait,
        }
    }

    fn write(&self, _: &Frame, _: Wait) -> Result<Stamp, LinkError> {
        let mut inside = self.0.lock();
        inside.now += 1;
        if inside.entries == FIFO_ENTRIES {
            inside.full += 1;
        } else {
            inside.entries += 1;
        }
        Ok(Stamp(inside.now))
    }

    fn read(&self, out: &mut Frame, _: Wait) -> Result<ReadMeta, LinkError> {
        let newest = self.0.lock().report.take();
        let timeout = LinkError::Timeout { dir: Dir::Read, waited: Duration::ZERO, what: "no cycle" };
        let (at, report) = newest.ok_or(timeout)?;
        *out = report;
        Ok(ReadMeta { at, sequence: self.0.lock().cycles, dropped: 0 })
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

/// The free count in OP is that after the previous exchange, whether a cycle has passed or not: a host that writes as
/// many frames as it allows loses none, with any number of exchanges per cycle.
#[test]
fn the_free_count_is_that_after_the_exchange_before() {
    for fills_crc in [true, false] {
        let board = Arc::new(Cycles::default());
        board.pass(fills_crc);
        let mut spi_board = SpiBoard::new(board.clone());
        for exchanges_a_cycle in [1, 2, 7, 200] {
            for _ in 0..200 {
                for _ in 0..exchanges_a_cycle {
                    let before = FIFO_ENTRIES - board.entries();
                    if before == 0 {
                        break;
                    }
                    let answer = exchange(&mut spi_board, &target(1, 1));
                    assert_eq!((master(&answer).fifo_free, master(&answer).full_count), (before, 0));
                    if fills_crc {
                        assert_eq!(answer.check_crc(SIZE, CrcPolicy::Strict), Ok(()));
                    } else {
                        assert_eq!(answer.crc_byte(), 0);
                    }
                }
                board.pass(fills_crc);
            }
        }
        // To a host that ignores the count, the frames that the board did not keep are reported, and two cycles later
        // the count is the board's again.
        (0..200).for_each(|_| {
            exchange(&mut spi_board, &target(1, 1));
        });
        assert_eq!(master(&exchange(&mut spi_board, &target(1, 1))).fifo_free, 0);
        let look = |spi_board: &mut SpiBoard| {
            // A chip select without a frame.
            let mut answer = Frame::new();
            spi_board.exchange(&[], &mut answer.bytes_mut()[..504]);
            master(&answer)
        };
        board.pass(fills_crc);
        let told = look(&mut spi_board);
        assert!(told.fifo_free <= 1 && told.full_count > 100, "{told:?}");
        board.pass(fills_crc);
        assert_eq!(look(&mut spi_board).fifo_free, 2);
    }
}

/// A frame that is still in transit while a report is made is counted too: the host's count never exceeds the free
/// entries.
#[test]
fn a_frame_that_comes_late_is_counted() {
    let board = Arc::new(Cycles::default());
    board.pass(true);
    let mut spi_board = SpiBoard::new(board.clone());
    let mut free = 0;
    for cycle in 0..2000 {
        for _ in 0..3 {
            free = master(&exchange(&mut spi_board, &target(1, 1))).fifo_free;
            if free <= 1 {
                break;
            }
        }
        if cycle % 3 == 0 {
            board.hold_one();
        }
        board.pass(true);
    }
    let told = master(&exchange(&mut spi_board, &target(1, 1)));
    assert!(free < 5 && told.full_count == 0, "{told:?}");
}

/// SK-10.3 Fewer bytes than a frame are ignored; more are answered by zeros.
#[test]
fn an_exchange_is_a_whole_frame() {
    let mut spi_board = spi_board("slaves=drive");
    let reset = board(&MasterCommand::SoftReset);
    let mut answer = [0xA5; 512];
    spi_board.exchange(&reset.bytes()[..503], &mut answer[..503]);
    assert!(!spi_board.is_busy());
    spi_board.exchange(&board(&MasterCommand::GetStatus).bytes()[..], &mut answer);
    assert_eq!(answer[504..], [0; 8]);
    assert_eq!((spi_board.counters().frames, spi_board.counters().incomplete), (1, 1));
    let mut wide = SpiBoard::new(link::open("sim:?queue=1&clock=virtual&slot=16", Share::ByName).unwrap());
    assert_eq!(wide.frame_len(), 512);
    let answer = exchange(&mut wide, &Frame::new());
    assert_eq!(answer.check_crc(SlotSize::Bytes16, CrcPolicy::Strict), Ok(()));
}

/// SK-10.5 While the board starts up BUSY is high; a host that ignores it gets zeros, and its frame is dropped. SK-10.9
/// RESETN acts as SW_RESET.
#[test]
fn busy_is_high_while_the_board_starts_up() {
    for by_line in [false, true] {
        let board_of = || link::open("sim:?queue=1&clock=virtual&name=spi_board", Share::ByName);
        let link = board_of().unwrap();
        let mut spi_board = SpiBoard::new(link.clone());
        if by_line {
            spi_board.reset();
        } else {
            exchange(&mut spi_board, &board(&MasterCommand::SoftReset));
            // The board's time passes only by calls.
            let _ = link.read(&mut Frame::new(), Wait::For(Duration::from_millis(5)));
            let _ = link.read(&mut Frame::new(), Wait::For(Duration::from_millis(5)));
        }
        assert!(spi_board.is_busy() && spi_board.lost().is_some());
        assert_eq!(exchange(&mut spi_board, &board(&MasterCommand::LocalWrite(1))).bytes()[..504], [0; 504]);
        assert_eq!(spi_board.counters().while_busy, 1);
        link.close();
        let again = (0..10_000).find_map(|_| board_of().ok()).expect("it starts up");
        spi_board.replace(again.clone());
        assert!(!spi_board.is_busy());
        assert_eq!(state(&exchange(&mut spi_board, &Frame::new())), Some(MasterState::PreOp));
        again.close();
    }
}

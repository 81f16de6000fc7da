//! `examples/rust/spi_board.rs`, driven as by a microcontroller's program.

use std::io::{Read, Write};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use ecmsk::sk::{CommandId, CrcPolicy, Frame, MasterCommand, MasterState};

use super::frames::{SIZE, all, all_on, axes, drive, master, state, to};

/// The example, until its standard input ends; killed after five minutes if it hangs.
struct Example(Child);

impl Example {
    fn start(link: &str) -> Self {
        Self::start_with(&[link])
    }

    fn start_with(words: &[&str]) -> Self {
        let program = support::example("spi_board");
        let mut timeout = Command::new("timeout");
        timeout
            .arg("300")
            .arg(program.get_program())
            .args(words)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        Self(timeout.spawn().expect("coreutils' timeout is there"))
    }

    fn exchange(&mut self, frame: &Frame) -> Frame {
        let mut answer = Frame::new();
        let (mosi, miso) = (self.0.stdin.as_mut().expect("a pipe"), self.0.stdout.as_mut().expect("a pipe"));
        mosi.write_all(&frame.bytes()[..504]).expect("the example takes it");
        miso.read_exact(&mut answer.bytes_mut()[..504]).expect("the example answers");
        answer
    }

    /// Exchanges that frame until `reached`, no faster than once a cycle: in OP each takes an entry of the FIFO.
    #[track_caller]
    fn until(&mut self, frame: &Frame, reached: impl Fn(&Frame) -> bool) -> Frame {
        let mut answers = (0..20_000).map(|_| {
            sleep(Duration::from_millis(2));
            self.exchange(frame)
        });
        answers.find(|answer| reached(answer)).expect("it comes")
    }

    fn end(mut self) -> String {
        drop(self.0.stdin.take());
        let output = self.0.wait_with_output().expect("it ends");
        assert!(output.status.success(), "{}", output.status);
        String::from_utf8_lossy(&output.stderr).into_owned()
    }
}

/// A program moves an axis by a path, paced only by the free count, and none of its frames is lost.
#[test]
fn a_program_feeds_the_board_through_two_pipes() {
    const TARGETS: i32 = 2000;

    let mut example = Example::start("sim:?slaves=drive&queue=1&name=spi-example");
    let silence = Frame::new();
    assert_eq!(example.exchange(&silence).check_crc(SIZE, CrcPolicy::Strict), Ok(()));
    axes().for_each(|frame| {
        example.exchange(&frame);
    });
    example.exchange(&to(MasterState::Op));
    example.until(&silence, |answer| state(answer) == Some(MasterState::Op));
    example.exchange(&all(1, CommandId::ServoOn, 1, 0));
    example.until(&silence, |answer| all_on(answer, 1));
    // From an empty FIFO, as fast as the count allows: far more than one frame per cycle.
    let mut answer = example.until(&silence, |answer| master(answer).fifo_free > 100);
    let mut sent = 0;
    for _ in 0..1_000_000 {
        if sent == TARGETS {
            break;
        }
        if master(&answer).fifo_free > 1 {
            sent += 1;
            answer = example.exchange(&all(1, CommandId::Csp, (sent % 250 + 1) as u8, sent));
        } else {
            // After an exchange without a free entry the count does not change; a cycle frees one.
            sleep(Duration::from_millis(5));
            answer = example.exchange(&silence);
        }
        assert_eq!(master(&answer).full_count, 0, "after {sent} frames");
    }
    assert_eq!(sent, TARGETS);
    let there =
        example.until(&silence, |answer| drive(answer, 1).position == TARGETS && master(answer).fifo_free > 100);
    assert_eq!(master(&there).full_count, 0);

    let said = example.end();
    assert!(said.ends_with("while BUSY was high\n"), "{said}");
}

/// SK-10.5 After SW_RESET the board answers zeros on the same wires until it has started up, and it is in PreOP then.
#[test]
fn the_example_finds_its_board_again_after_a_reset() {
    let mut example = Example::start("sim:?slaves=drive&queue=1&name=spi-example-reset");
    axes().for_each(|frame| {
        example.exchange(&frame);
    });
    example.exchange(&to(MasterState::Op));
    example.until(&Frame::new(), |answer| state(answer) == Some(MasterState::Op));
    let mut reset = Frame::new();
    reset.put_master(SIZE, &MasterCommand::SoftReset);
    reset.fill_crc(SIZE);
    example.exchange(&reset);
    example.until(&Frame::new(), |answer| *answer == Frame::new());
    example.until(&Frame::new(), |answer| state(answer) == Some(MasterState::PreOp));
    let said = example.end();
    assert!(!said.contains(" 0 of them"), "{said}");
}

/// SK-10.9 With a folder it has BUSY and RESETN as a GPIO's files: the board is held in reset while RESETN is low, BUSY is
/// high until it has started, and it is in PreOP then.
#[test]
fn the_example_has_busy_and_resetn() {
    let folder = tempfile::tempdir().expect("a folder");
    let level = |line: &str| std::fs::read(folder.path().join(line)).unwrap_or_default();
    let until = |line: &str, wanted: &[u8]| {
        let mut looks = (0..60_000).map(|_| {
            sleep(Duration::from_millis(1));
            level(line)
        });
        assert!(looks.any(|found| found == wanted), "{line} does not become {wanted:?}");
    };
    let link = "sim:?slaves=drive&queue=1&name=spi-example-lines";
    let mut example = Example::start_with(&[link, folder.path().to_str().expect("UTF-8")]);
    until("busy", b"0");
    axes().for_each(|frame| {
        example.exchange(&frame);
    });
    example.exchange(&to(MasterState::Op));
    example.until(&Frame::new(), |answer| state(answer) == Some(MasterState::Op));
    std::fs::write(folder.path().join("resetn"), "0").expect("it is written");
    until("busy", b"1");
    assert_eq!(example.exchange(&Frame::new()), Frame::new(), "it is held in reset");
    assert_eq!(level("busy"), b"1");
    std::fs::write(folder.path().join("resetn"), "1").expect("it is written");
    until("busy", b"0");
    example.until(&Frame::new(), |answer| state(answer) == Some(MasterState::PreOp));
    example.end();
}

//! Hosts on a microcontroller (`ecmsk::embedded`), with the models of a board and of a chip at the other end of their SPI.

#[path = "../../examples/firmware/src/chip.rs"]
mod firmware;

use std::cell::RefCell;
use std::convert::Infallible;
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use ecmsk::embedded::{Board, BoardError, ChipWires, RESET_LOW_NS};
use ecmsk::io::spi::{EdgeWires as _, Level};
use ecmsk::link::{self, Share};
use ecmsk::port::spi::SpiBoard;
use ecmsk::sk::{CommandId, CrcPolicy, Frame, MasterCommand, MasterState};
use ecmsk::xf::chip::Profile;
use ecmsk::xf::host::{HostConfig, HostPacing, Wires as _};
use embedded_hal::digital::{self, InputPin, OutputPin};
use embedded_hal::spi::{self, ErrorKind, Operation, SpiDevice};

use super::chip_wires::{self, Int0};
use super::frames::{SIZE, all, all_on, axes, board, drive, master, state, to};

/// What answers at the other end of an SPI.
trait Answers {
    /// One exchange under one chip select.
    fn answer(&mut self, tx: &[u8], rx: &mut [u8]) -> Result<(), ErrorKind>;
}

/// A line of the board or the chip, or its SPI: a microcontroller has each of them in another variable.
struct Shared<T>(Rc<RefCell<T>>);

impl<T> spi::ErrorType for Shared<T> {
    type Error = ErrorKind;
}

impl<T: Answers> SpiDevice for Shared<T> {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), ErrorKind> {
        let [Operation::Transfer(rx, tx)] = operations else { return Err(ErrorKind::Other) };
        self.0.borrow_mut().answer(tx, rx)
    }
}

/// What wires do to an answer.
#[derive(Clone, Copy)]
enum Wires {
    Good,
    /// One bit is another one.
    Flip,
    /// MISO is always low.
    Low,
    /// MISO is always high.
    High,
    /// MISO is connected to MOSI.
    Echo,
}

/// A board, and what its wires do.
struct Wired {
    board: SpiBoard,
    wires: Wires,
    link: String,
}

impl Answers for Wired {
    fn answer(&mut self, tx: &[u8], rx: &mut [u8]) -> Result<(), ErrorKind> {
        self.board.exchange(tx, rx);
        match self.wires {
            Wires::Good => {}
            Wires::Flip => rx[100] ^= 1,
            Wires::Low => rx.fill(0),
            Wires::High => rx.fill(0xFF),
            Wires::Echo => rx.copy_from_slice(tx),
        }
        Ok(())
    }
}

impl<T> digital::ErrorType for Shared<T> {
    type Error = Infallible;
}

/// BUSY.
impl InputPin for Shared<Wired> {
    fn is_high(&mut self) -> Result<bool, Infallible> {
        Ok(self.0.borrow().board.is_busy())
    }

    fn is_low(&mut self) -> Result<bool, Infallible> {
        Ok(!self.0.borrow().board.is_busy())
    }
}

/// RESETN: the board is there again some time after it is high.
impl OutputPin for Shared<Wired> {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.0.borrow_mut().board.reset();
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

fn simulated(name: &str) -> Rc<RefCell<Wired>> {
    let link = format!("sim:?queue=1&slaves=drive&name={name}");
    let board = SpiBoard::new(link::open(&link, Share::ByName).expect("a board"));
    Rc::new(RefCell::new(Wired { board, wires: Wires::Good, link }))
}

type Host504 = Board<Shared<Wired>, Shared<Wired>>;

/// Exchanges that frame until an answer is as wanted, no faster than once a cycle: in OP each takes an entry of the FIFO.
#[track_caller]
fn until(host: &mut Host504, frame: &Frame, mut reached: impl FnMut(&Frame) -> bool) -> Frame {
    let mut answers = (0..20_000).filter_map(|_| {
        std::thread::sleep(Duration::from_millis(2));
        host.exchange(frame).expect("an answer")
    });
    answers.find(|answer| reached(answer)).expect("it comes")
}

/// SK-10.3, SK-10.4 A host without an operating system brings a board to OP, and moves an axis.
#[test]
fn a_board_moves_an_axis() {
    let wired = simulated("embedded-moves");
    let mut host: Host504 = Board::new(Shared(wired.clone()), Shared(wired.clone()), SIZE, CrcPolicy::Strict);
    let silence = Frame::new();
    for frame in axes().chain([to(MasterState::Op)]) {
        assert!(host.exchange(&frame).expect("an answer").is_some());
    }
    until(&mut host, &silence, |answer| state(answer) == Some(MasterState::Op));
    host.exchange(&all(1, CommandId::ServoOn, 1, 0)).expect("an answer");
    until(&mut host, &silence, |answer| all_on(answer, 1));
    for n in 1..=500 {
        // Without its CRC: the host fills it in.
        let mut frame = all(1, CommandId::Csp, (n % 250 + 1) as u8, n);
        frame.bytes_mut()[3] = 0;
        until(&mut host, &silence, |answer| master(answer).fifo_free > 100);
        let answer = host.exchange(&frame).expect("an answer").expect("the board is ready");
        assert_eq!((master(&answer).error, master(&answer).full_count), (0, 0));
    }
    until(&mut host, &silence, |answer| drive(answer, 1).position == 500);
}

/// SK-10.4, SK-10.5, SK-10.9 While BUSY is high nothing is sent; a damaged answer and dead wires are none; RESETN resets the
/// board.
#[test]
fn a_board_that_is_busy_damaged_or_reset() {
    let wired = simulated("embedded-busy");
    let mut host: Host504 = Board::new(Shared(wired.clone()), Shared(wired.clone()), SIZE, CrcPolicy::Strict);
    let silence = Frame::new();
    assert!(host.exchange(&silence).expect("an answer").is_some());
    wired.borrow_mut().wires = Wires::Flip;
    let error = host.exchange(&silence).expect_err("it is damaged");
    assert!(matches!(error, BoardError::Crc(_)), "{error:?}");
    assert!(error.to_string().contains("look at MISO and the clock"), "{error}");
    wired.borrow_mut().wires = Wires::Good;
    // Also for a host that accepts answers without a CRC.
    let mut easy: Host504 = Board::new(Shared(wired.clone()), Shared(wired.clone()), SIZE, CrcPolicy::AbsentAllowed);
    for dead in [Wires::Low, Wires::High, Wires::Echo] {
        wired.borrow_mut().wires = dead;
        assert_eq!(easy.exchange(&board(&MasterCommand::LocalRead)), Err(BoardError::NoAnswer));
    }
    wired.borrow_mut().wires = Wires::Good;
    assert!(host.exchange(&silence).expect("an answer").is_some());

    let mut waited = Waited(0);
    let Ok(()) = host.reset(&mut Shared(wired.clone()), &mut waited);
    assert_eq!(waited.0, u64::from(RESET_LOW_NS));
    let before = wired.borrow().board.counters();
    assert_eq!(host.is_ready(), Ok(false));
    assert_eq!(host.exchange(&silence), Ok(None));
    assert_eq!(wired.borrow().board.counters(), before, "nothing was sent");
    {
        let mut wired = wired.borrow_mut();
        wired.board.close();
        let again = support::tcp::until("the board", || link::open(&wired.link, Share::ByName).ok());
        wired.board.replace(again);
    }
    until(&mut host, &silence, |answer| state(answer) == Some(MasterState::PreOp));
}

/// A delay that notes what it was asked for, nanoseconds.
struct Waited(u64);

impl embedded_hal::delay::DelayNs for Waited {
    fn delay_ns(&mut self, ns: u32) {
        self.0 += u64::from(ns);
    }
}

impl Answers for chip_wires::ChipWires {
    fn answer(&mut self, tx: &[u8], rx: &mut [u8]) -> Result<(), ErrorKind> {
        self.exchange(tx, rx).map_err(|_| ErrorKind::Other)
    }
}

/// A chip with two drives whose time passes as the host reads its clock, and the host's wires to it. At an edge of INT0
/// `ready` is set, as by an interrupt.
fn chip(int0: Int0, ready: &'static AtomicBool) -> (Rc<RefCell<chip_wires::ChipWires>>, impl Fn() -> u64) {
    let chip = Rc::new(RefCell::new(chip_wires::ChipWires::new(Profile::NEW, 2, int0)));
    let of_clock = chip.clone();
    let now = move || {
        let mut chip = of_clock.borrow_mut();
        chip.sleep(Duration::from_micros(1));
        if std::mem::take(&mut chip.edges) > 0 {
            ready.store(true, Ordering::SeqCst);
        }
        chip.now
    };
    (chip, now)
}

/// XF-16.2, XF-16.3 The driver starts a chip over the wires of a microcontroller, and finds its slaves, with INT0 and without.
#[test]
fn the_driver_starts_a_chip() {
    static READY: AtomicBool = AtomicBool::new(false);
    for int0 in [Int0::None, Int0::To(Level::High)] {
        let (model, now) = chip(int0, &READY);
        let config = HostConfig::default();
        let (mut wires, config) = match int0 {
            Int0::None => (ChipWires::new(Shared(model.clone()), now), config),
            Int0::To(_) => (
                ChipWires::with_int0(Shared(model.clone()), now, &READY),
                HostConfig { pacing: HostPacing::Int0, ..config },
            ),
        };
        let mut host = firmware::start(&mut wires, config).expect("it answers");
        let before = host.counters().int0_missed;
        assert_eq!(firmware::count(&mut host, &mut wires), Some(2), "{int0:?}");
        assert_eq!(host.counters().int0_missed, before, "each edge is seen");
        assert_eq!(model.borrow().all_edges > 0, int0 != Int0::None);
    }
}

/// XF-16.3 An edge of INT0 from before an exchange says nothing of its packet.
#[test]
fn an_edge_from_before_an_exchange_is_discarded() {
    static READY: AtomicBool = AtomicBool::new(true);
    let (model, now) = chip(Int0::None, &READY);
    let mut wires = ChipWires::with_int0(Shared(model), now, &READY);
    wires.exchange(&[0; 4], &mut [0; 4]).expect("an exchange");
    let time = wires.now();
    assert_eq!(wires.wait_ready(time), Ok(false));
    READY.store(true, Ordering::SeqCst);
    assert_eq!(wires.wait_ready(time), Ok(true));
    assert_eq!(wires.wait_ready(time), Ok(false), "an edge is there once");
}

thread_local! {
    /// The board at the SPI of the firmware.
    static BOARD: Rc<RefCell<Wired>> = simulated("embedded-firmware");
    /// The chip at the SPI of the firmware.
    static CHIP: RefCell<chip_wires::ChipWires> = RefCell::new(chip_wires::ChipWires::new(Profile::NEW, 3, Int0::None));
}

extern "C" fn not_busy() -> bool {
    false
}

/// SK-10.3 The firmware that is built for microcontrollers, here on the model of a board, with its SPI and BUSY in C.
#[test]
fn a_firmware_reads_the_state_of_a_board() {
    extern "C" fn exchange(to_board: *const u8, from_board: *mut u8, len: usize) -> i32 {
        // SAFETY: the firmware hands over two buffers of `len` bytes that it does not use meanwhile.
        let (tx, rx) =
            unsafe { (std::slice::from_raw_parts(to_board, len), std::slice::from_raw_parts_mut(from_board, len)) };
        BOARD.with(|wired| wired.borrow_mut().answer(tx, rx)).map_or(1, |()| 0)
    }
    extern "C" fn now() -> u64 {
        0
    }
    extern "C" fn busy() -> bool {
        true
    }
    let firmware = firmware::Firmware { exchange, now, busy: not_busy };
    let pre_op = MasterState::PreOp.code();
    assert_eq!(firmware::state(firmware), Some(pre_op));
    assert_eq!(firmware::state(firmware::Firmware { busy, ..firmware }), None);
    BOARD.with(|wired| wired.borrow_mut().wires = Wires::Low);
    assert_eq!(firmware::state(firmware), None);
}

/// XF-16.2 The same on the model of a chip, with its timer in C.
#[test]
fn a_firmware_counts_the_slaves_of_a_chip() {
    extern "C" fn exchange(to_chip: *const u8, from_chip: *mut u8, len: usize) -> i32 {
        // SAFETY: the firmware hands over two buffers of `len` bytes that it does not use meanwhile.
        let (tx, rx) =
            unsafe { (std::slice::from_raw_parts(to_chip, len), std::slice::from_raw_parts_mut(from_chip, len)) };
        CHIP.with_borrow_mut(|chip| chip.answer(tx, rx)).map_or(1, |()| 0)
    }
    extern "C" fn now() -> u64 {
        CHIP.with_borrow_mut(|chip| {
            chip.sleep(Duration::from_micros(1));
            chip.now
        })
    }
    let firmware = firmware::Firmware { exchange, now, busy: not_busy };
    assert_eq!(firmware::slaves(firmware), Some(3));
    CHIP.with_borrow_mut(|chip| chip.failures = u32::MAX);
    assert_eq!(firmware::slaves(firmware), None);
}

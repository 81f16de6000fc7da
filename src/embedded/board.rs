//! An ECM-SK on SPI.

use core::fmt;

use embedded_hal::delay::DelayNs;
use embedded_hal::digital::{InputPin, OutputPin};
use embedded_hal::spi::SpiDevice;

use crate::sk::{CrcError, CrcPolicy, FRAME_LEN, Frame, SlotSize};

/// How long [`Board::reset`] keeps RESETN low, in nanoseconds: 100 ms, as a host was seen to do (SK-10, OBS). The board
/// needs 32 us.
pub const RESET_LOW_NS: u32 = 100_000_000;

/// An ECM-SK on SPI: mode 0, up to 24 MHz, chip select low during a whole frame, and its line BUSY (SK-10).
///
/// In OP every exchange puts its frame into the board's FIFO, also one with nothing but GET_STATUS in it. A frame that finds
/// the FIFO full is lost: see `fifo_free` and `full_count` of
/// [`MasterResponse`](crate::sk::MasterResponse).
///
/// **An axis goes on when the firmware stops calling [`Self::exchange`].** The board then repeats the last outputs: in CSP the
/// axis stands at its last target, in CSV and CST it runs on. Let a watchdog of the firmware stop it, by the reset line or by
/// the drives' own enable inputs.
///
/// ```
/// use ecmsk::embedded::{Board, BoardError};
/// use ecmsk::sk::{Frame, Motion, SlaveCommand, SlotSize};
/// # use embedded_hal::{digital::InputPin, spi::SpiDevice};
///
/// /// Sends slave 1 to `target`, in counts, as soon as the board takes a frame. `None`: it was busy for 100,000 looks.
/// fn go<S: SpiDevice, B: InputPin>(
///     board: &mut Board<S, B>,
///     target: i32,
/// ) -> Result<Option<Frame>, BoardError<S::Error, B::Error>> {
///     let mut commands = Frame::new();
///     commands.put_slave(SlotSize::Bytes12, 1, &SlaveCommand::Csp(Motion::to(target)).with_index(0));
///     for _ in 0..100_000 {
///         if let Some(answer) = board.exchange(&commands)? {
///             return Ok(Some(answer));
///         }
///     }
///     Ok(None)
/// }
/// ```
#[derive(Clone, Debug)]
pub struct Board<S, B> {
    spi: S,
    busy: B,
    size: SlotSize,
    crc: CrcPolicy,
    sent: Frame,
}

impl<S: SpiDevice, B: InputPin> Board<S, B> {
    /// A board on this SPI device, whose line BUSY is on the pin `busy`. `crc` says whether an answer without a CRC is
    /// accepted, as a board may send it that was told not to use one (SET_EX).
    pub const fn new(spi: S, busy: B, size: SlotSize, crc: CrcPolicy) -> Self {
        Self { spi, busy, size, crc, sent: Frame::new() }
    }

    /// Gives the SPI device and the pin back.
    pub fn release(self) -> (S, B) {
        (self.spi, self.busy)
    }

    /// Whether the board takes a frame now. It does not while it works on the one before, and while it starts.
    ///
    /// # Errors
    /// The pin cannot be read.
    pub fn is_ready(&mut self) -> Result<bool, BoardError<S::Error, B::Error>> {
        self.busy.is_low().map_err(BoardError::Busy)
    }

    /// Sends a frame of commands with its CRC, and returns the answer, which is that to the frame before. `None`: the board
    /// is not ready, and nothing was sent.
    ///
    /// # Errors
    /// [`BoardError::Busy`]: nothing was sent. With every other error the board may have the frame, and an axis may go to
    /// its target: the next answer shows it.
    pub fn exchange(&mut self, commands: &Frame) -> Result<Option<Frame>, BoardError<S::Error, B::Error>> {
        if !self.is_ready()? {
            return Ok(None);
        }
        self.sent.clone_from(commands);
        self.sent.fill_crc(self.size);
        let mut received = [0; FRAME_LEN];
        let len = self.size.frame_len();
        self.spi.transfer(&mut received[..len], self.sent.wire(self.size)).map_err(BoardError::Spi)?;
        let wire = &received[..len];
        // A line without a board is low or high all the time; with MISO at MOSI what was sent comes back.
        if [0x00, 0xFF].iter().any(|level| wire.iter().all(|byte| byte == level)) || wire == self.sent.wire(self.size) {
            return Err(BoardError::NoAnswer);
        }
        let answer = Frame::from_bytes(received);
        answer.check_crc(self.size, self.crc).map_err(BoardError::Crc)?;
        Ok(Some(answer))
    }

    /// Resets the board by its line RESETN. Afterwards it is not ready until it has found its network, which takes some
    /// hundred milliseconds or, without slaves, for ever (SK-4).
    ///
    /// # Errors
    /// The pin cannot be switched.
    pub fn reset<P: OutputPin>(&mut self, resetn: &mut P, delay: &mut impl DelayNs) -> Result<(), P::Error> {
        resetn.set_low()?;
        delay.delay_ns(RESET_LOW_NS);
        resetn.set_high()
    }
}

/// Why an exchange with a [`Board`] failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoardError<S, B> {
    /// The SPI cannot be used.
    Spi(S),
    /// The pin of BUSY cannot be read.
    Busy(B),
    /// All bits of the answer are the same, or it is what was sent: no board is at the other end.
    NoAnswer,
    /// The CRC of the answer is wrong: the wires disturb it, or the board has slots of the other size.
    Crc(CrcError),
}

impl<S: fmt::Debug, B: fmt::Debug> fmt::Display for BoardError<S, B> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Spi(error) => write!(f, "the SPI cannot be used ({error:?}); look at its set-up: mode 0, 24 MHz at most"),
            Self::Busy(error) => write!(f, "the line BUSY cannot be read ({error:?}); look at the set-up of its pin"),
            Self::NoAnswer => f.write_str(
                "no board answers: MISO is always low, always high, or connected to MOSI; look at the wires, the board's \
                 power, and CONFIG0",
            ),
            Self::Crc(error) => write!(
                f,
                "the answer is damaged ({error}); look at MISO and the clock, and whether CONFIG2 is set to the slots of the \
                 program"
            ),
        }
    }
}

impl<S: fmt::Debug, B: fmt::Debug> core::error::Error for BoardError<S, B> {}

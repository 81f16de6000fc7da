//! The lines of a device on SPI besides its bus, as lines of a GPIO chip: ready, interrupt and reset.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use gpiocdev::line::{EdgeDetection, Value};
use gpiocdev::request::Builder;
use gpiocdev::{Chip, Request};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;

use super::{SpiError, list_devices};

/// The consumer name that the kernel shows as the user of a line (`gpioinfo`).
const CONSUMER: &str = "ecmsk";
/// The maximum number of edge events that are read from the kernel at a time.
const EDGES_PER_READ: usize = 16;

/// The address of a GPIO line: `gpiochip0/25`, `/dev/gpiochip0/25`, or with the line's name, `gpiochip0/BUSY`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GpioLine {
    /// The device file of the GPIO chip.
    pub chip: PathBuf,
    /// The line's offset on the chip, or its name.
    pub line: String,
}

impl GpioLine {
    /// Parses `chip/line`; `None` if one of the two is missing.
    pub fn parse(text: &str) -> Option<Self> {
        let (chip, line) = text.rsplit_once('/')?;
        let chip = if chip.starts_with('/') { PathBuf::from(chip) } else { PathBuf::from("/dev").join(chip) };
        (!line.is_empty() && chip.file_name().is_some()).then(|| Self { chip, line: line.to_owned() })
    }
}

impl std::fmt::Display for GpioLine {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "line {} of {}", self.line, self.chip.display())
    }
}

/// The level of a GPIO line, as the voltage at the pin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// The voltage of logic 0.
    Low,
    /// The voltage of logic 1.
    High,
}

/// The line that shows by its level, and by the edge to that level, when the device is ready for an exchange.
pub(super) struct ReadyLine {
    input: InputLine,
    ready: Level,
    /// The buffer for edge events. gpiocdev's call for a single event is not used, because it drops further events that
    /// it has read from the kernel together with the first one.
    edges: Vec<u64>,
    /// Whether an edge to the ready level was read from the kernel that no call has reported yet.
    has_edge: bool,
}

impl ReadyLine {
    /// Opens the ready line of a device. `ready` is its level while the device is ready.
    pub fn open(place: &GpioLine, ready: Level) -> Result<Self, SpiError> {
        let edge = match ready {
            Level::Low => EdgeDetection::FallingEdge,
            Level::High => EdgeDetection::RisingEdge,
        };
        let request = request(place, |line| line.as_input().with_edge_detection(edge))?;
        let edges = vec![0; EDGES_PER_READ * request.edge_event_u64_size()];
        Ok(Self { input: InputLine { name: place.to_string(), request }, ready, edges, has_edge: false })
    }

    pub fn is_ready(&self) -> Result<bool, SpiError> {
        Ok(self.input.is_high()? == (self.ready == Level::High))
    }

    /// Waits until the device is ready, for at most `limit`; returns whether it is.
    ///
    /// An edge between the reading of the level and the wait also ends the wait, since the kernel queues edges. An
    /// older edge ends the wait too, so the level is read again after each wait.
    pub fn wait_ready(&mut self, limit: Duration) -> Result<bool, SpiError> {
        let began = Instant::now();
        loop {
            if self.is_ready()? {
                return Ok(true);
            }
            let left = limit.saturating_sub(began.elapsed());
            if left.is_zero() {
                return Ok(false);
            }
            if self.edge_comes(left)? {
                self.take_edges()?;
            }
        }
    }

    /// Waits for an edge to the ready level for at most `limit`; returns whether there was one. Edges before the last
    /// call of [`Self::has_become_ready`] or of this function do not count. The level is not checked.
    pub fn wait_edge(&mut self, limit: Duration) -> Result<bool, SpiError> {
        let began = Instant::now();
        loop {
            if self.has_become_ready()? {
                return Ok(true);
            }
            let left = limit.saturating_sub(began.elapsed());
            if left.is_zero() {
                return Ok(false);
            }
            self.edge_comes(left)?;
        }
    }

    /// Whether the line has changed to the ready level since the last call of this function or of [`Self::wait_edge`].
    pub fn has_become_ready(&mut self) -> Result<bool, SpiError> {
        while self.input.request.has_edge_event().map_err(|error| self.input.failed(&error))? {
            self.take_edges()?;
        }
        Ok(std::mem::take(&mut self.has_edge))
    }

    /// Waits until the kernel has an edge event, for at most `limit`; returns whether it has. A signal handler of the
    /// program may end the wait early.
    fn edge_comes(&self, limit: Duration) -> Result<bool, SpiError> {
        let limit = Timespec::try_from(limit).unwrap_or(Timespec { tv_sec: i64::MAX, tv_nsec: 0 });
        match poll(&mut [PollFd::new(&self.input.request, PollFlags::IN)], Some(&limit)) {
            Ok(count) => Ok(count > 0),
            Err(Errno::INTR) => Ok(false),
            Err(errno) => Err(self.input.failed(&errno)),
        }
    }

    fn take_edges(&mut self) -> Result<(), SpiError> {
        let taken = self.input.request.read_edge_events_into_slice(&mut self.edges);
        taken.map_err(|error| self.input.failed(&error))?;
        self.has_edge = true;
        Ok(())
    }
}

/// A GPIO line that the device drives and this machine reads.
pub(super) struct InputLine {
    name: String,
    request: Request,
}

impl InputLine {
    pub fn open(place: &GpioLine) -> Result<Self, SpiError> {
        Ok(Self { name: place.to_string(), request: request(place, Builder::as_input)? })
    }

    pub fn is_high(&self) -> Result<bool, SpiError> {
        let value = self.request.lone_value().map_err(|error| self.failed(&error))?;
        Ok(value == Value::Active)
    }

    fn failed(&self, error: &impl ToString) -> SpiError {
        SpiError::Refused { what: self.name.clone(), message: error.to_string() }
    }
}

/// The reset line: a low pulse resets the device; otherwise the line is high.
pub(super) struct ResetLine {
    name: String,
    request: Request,
}

impl ResetLine {
    pub fn open(place: &GpioLine) -> Result<Self, SpiError> {
        Ok(Self { name: place.to_string(), request: request(place, |line| line.as_output(Value::Active))? })
    }

    pub fn pull_low(&self, time: Duration) -> Result<(), SpiError> {
        let set = |value| {
            let done = self.request.set_lone_value(value);
            done.map_err(|error| SpiError::Refused { what: self.name.clone(), message: error.to_string() })
        };
        set(Value::Inactive)?;
        std::thread::sleep(time);
        set(Value::Active)
    }
}

/// Requests a GPIO line from the kernel; `set` configures it as an input or output.
fn request(place: &GpioLine, set: impl FnOnce(&mut Builder) -> &mut Builder) -> Result<Request, SpiError> {
    let offset = find(place)?;
    let mut line = Request::builder();
    line.on_chip(&place.chip).with_consumer(CONSUMER).with_line(offset);
    set(&mut line).request().map_err(|error| refused(place, &error))
}

/// The offset of the line on its GPIO chip, found by its name if the line is given by name.
fn find(place: &GpioLine) -> Result<u32, SpiError> {
    let chips = || list_devices("gpiochip");
    let file = std::fs::File::open(&place.chip);
    file.map_err(|error| SpiError::of(&place.chip.display().to_string(), &error, chips))?;
    let chip = Chip::from_path(&place.chip).map_err(|error| refused(place, &error))?;
    if let Ok(offset) = place.line.parse() {
        let lines = chip.info().map_err(|error| refused(place, &error))?.num_lines;
        if offset < lines {
            return Ok(offset);
        }
        return Err(SpiError::Missing { what: place.to_string(), there: format!("it has lines 0 to {}", lines - 1) });
    }
    let named = chip.find_line_info(&place.line).map(|info| info.offset);
    named.ok_or_else(|| SpiError::Missing {
        what: place.to_string(),
        there: "none of its lines has that name (`gpioinfo` lists them)".to_owned(),
    })
}

fn refused(place: &GpioLine, error: &gpiocdev::Error) -> SpiError {
    let (what, message) = (place.to_string(), error.to_string());
    let busy = std::io::Error::from(Errno::BUSY).to_string();
    if message.contains(&busy) {
        return SpiError::InUse { what, by: " by another program or a driver".to_owned() };
    }
    SpiError::Refused { what, message }
}

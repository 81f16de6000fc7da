//! The link `usb:`: a real ECM-SK on USB, or a virtual one (`ecmsk serve usbip`), which looks the same to this
//! machine's USB stack.
//!
//! Files: `options.rs` has the keys of `usb:` as Rust types, `choose.rs` selects the board among the devices on the
//! bus, `open_error.rs` explains why a board cannot be opened, `slot_watch.rs` checks `slot=` against the board's reports.

mod choose;
mod open_error;
mod options;
mod slot_watch;

use std::sync::Arc;
use std::time::{Duration, Instant};

use self::choose::choose;
use self::open_error::open_error;
use self::options::UsbOptions;
use self::slot_watch::SlotWatch;
use crate::address::uri::LinkUri;
use crate::io::hid::{self, Bus, Pipe, PipeError, PipeOptions, Sysfs, UsbBusError};
use crate::link::call_counts::CallCounts;
use crate::link::common_options::CommonOptions;
use crate::link::{Dir, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Stamp, Wait};
use crate::sk::{BOARD_IDS, Frame, SlotSize};
use crate::threads::sync::unlockable::Mutex;

/// The minimum time limit of a write: a shorter limit of the caller, or 0, is raised to this value. The transfer takes
/// a microframe of 125 us, and the operating system needs some time to report it. A board that has not accepted the
/// frame by then is busy. \[OURS]
const WRITE_LIMIT_MIN: Duration = Duration::from_millis(2);

/// A link to a board on USB.
struct UsbLink {
    info: LinkInfo,
    pipe: Pipe,
    place: Place,
    opened: Instant,
    counts: CallCounts,
    /// Compares the slots in the board's reports with the given slot size; `None` if the link has no `slot=`.
    slot_watch: Option<Mutex<SlotWatch>>,
}

/// Where the board is plugged in.
struct Place {
    system: Sysfs,
    /// Bus and ports as Linux names them, or the device instance on Windows.
    path: String,
    high_speed: bool,
    /// How many over-currents the port had counted when the board was opened. If the board is lost and the port has
    /// counted more, an over-current is the cause.
    over_currents: u32,
}

/// Opens the board that the URI names. `uncounted`: the caller does not need the number of dropped reports, so the pipe
/// may pause its input while the program does not read.
pub(crate) fn open(uri: &LinkUri, common: &CommonOptions, uncounted: bool) -> Result<Arc<dyn Link>, LinkError> {
    let options = UsbOptions::from_uri(uri)?;
    let name = uri.to_string();
    let unusable = |error: UsbBusError| LinkError::NoBoard { name: name.clone(), reason: error.to_string() };
    let bus = Bus::open().map_err(unusable)?;
    let found = hid::find(&bus, BOARD_IDS.0, BOARD_IDS.1).map_err(|error| unusable(error.into()))?;
    let system = Sysfs::of_this_machine();
    let (board, interface) = choose(&name, &found, &options, &system)?;
    for remark in system.warnings(&board.path, board.high_speed) {
        log::warn!("the board at {}: {remark}", board.path);
    }
    let pipe_options = PipeOptions { transfers: options.transfers, queue: common.queue, may_pause_input: uncounted };
    let pipe = Pipe::open(board, interface, pipe_options).map_err(|error| open_error(&name, board, error, &system))?;
    let over_currents = system.over_currents(&board.path);
    let place = Place { system, path: board.path.clone(), high_speed: board.high_speed, over_currents };
    let info = common.info(name, common.slot);
    let slot_watch = common.slot.map(|given| Mutex::new(SlotWatch::new(given)));
    Ok(Arc::new(UsbLink { info, pipe, place, opened: Instant::now(), counts: CallCounts::default(), slot_watch }))
}

impl Place {
    /// The reason why the board is gone: an over-current at its port since it was opened, or else `reason`, with a
    /// remark if the board did not run at high speed.
    fn explain_loss(&self, reason: &str) -> String {
        let times = self.system.over_currents(&self.path);
        if times > self.over_currents {
            return format!(
                "its port at {} has cut the power (over-current); plug it into a hub with a power supply of its own",
                self.path
            );
        }
        let slow = if self.high_speed { "" } else { "; it did not run at high speed" };
        format!("{reason}{slow}")
    }
}

impl UsbLink {
    fn stamp(&self, at: Instant) -> Stamp {
        let since = at.saturating_duration_since(self.opened).as_nanos();
        Stamp(u64::try_from(since).unwrap_or(u64::MAX))
    }

    fn error(&self, dir: Dir, error: PipeError) -> LinkError {
        let failed = |message: String| LinkError::Io { what: format!("{dir} at `{}`", self.info.name), message };
        match error {
            PipeError::Timeout(waited) => {
                let what = match dir {
                    Dir::Read => "the board sent no report",
                    Dir::Write => "the board took no byte of the frame",
                };
                LinkError::Timeout { dir, waited, what }
            }
            PipeError::Cancelled => LinkError::Cancelled { dir },
            PipeError::Closed => LinkError::Closed,
            PipeError::Lost(reason) => {
                LinkError::Lost { name: self.info.name.clone(), reason: self.place.explain_loss(reason).into() }
            }
            PipeError::Partial { moved } => {
                failed(format!("{moved} of 512 bytes were moved; a board hangs after such a frame, switch it off and on"))
            }
            PipeError::Stalled => failed(
                "the board refuses the frame (its endpoint stalls); send it again, and if it is refused again switch the \
                 board off and on"
                    .to_owned(),
            ),
            PipeError::Usb(error) => failed(format!("{error}; look at the cable and the hub, then send it again")),
        }
    }

    /// Fails if the reports so far, with `report` as the newest one, show that the board's slot size differs from
    /// `slot=`.
    fn check_slot_size(&self, report: Option<&Frame>) -> Result<(), LinkError> {
        let Some(slot_watch) = &self.slot_watch else { return Ok(()) };
        let mut watch = slot_watch.lock();
        let found: Option<SlotSize> = match report {
            Some(report) => watch.check_report(report),
            None => watch.found(),
        };
        let Some(found) = found else { return Ok(()) };
        Err(LinkError::WrongSlot { name: self.info.name.clone(), given: watch.given(), found })
    }

    fn try_write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        self.check_slot_size(None)?;
        let limit = wait.limit().map(|limit| limit.max(WRITE_LIMIT_MIN));
        match self.pipe.write(frame.bytes(), limit) {
            Ok(()) => Ok(self.stamp(Instant::now())),
            Err(PipeError::Timeout(_)) if wait == Wait::Now => {
                Err(self.error(Dir::Write, PipeError::Timeout(Duration::ZERO)))
            }
            Err(error) => Err(self.error(Dir::Write, error)),
        }
    }

    fn try_read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        let mut report = Frame::new();
        let read = self.pipe.read(report.bytes_mut(), wait.limit());
        let (at, sequence) = read.map_err(|error| self.error(Dir::Read, error))?;
        self.check_slot_size(Some(&report))?;
        *out = report;
        Ok(ReadMeta { at: self.stamp(at), sequence, dropped: self.pipe.stats().dropped })
    }
}

impl Link for UsbLink {
    fn info(&self) -> LinkInfo {
        self.info.clone()
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        self.counts.write(self.try_write(frame, wait))
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        self.counts.read(self.try_read(out, wait))
    }

    fn cancel(&self, dir: Dir) {
        match dir {
            Dir::Write => self.pipe.cancel_writes(),
            Dir::Read => self.pipe.cancel_reads(),
        }
    }

    fn close(&self) {
        self.pipe.close();
    }

    fn check(&self) -> Result<(), LinkError> {
        self.pipe.check().map_err(|error| self.error(Dir::Read, error))
    }

    fn stats(&self) -> LinkStats {
        let pipe = self.pipe.stats();
        LinkStats {
            reports_dropped: pipe.dropped,
            reports_short: pipe.short,
            transfers_failed: pipe.failed,
            ..self.counts.stats()
        }
    }
}

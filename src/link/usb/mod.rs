//! The link `usb:`: a real ECM-SK, or what looks like one to the USB stack of this machine.

mod choose;
mod options;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use rusb::Context;

use self::choose::choose;
use self::options::UsbOptions;
use super::options::CommonOptions;
use super::uri::LinkUri;
use super::{Dir, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Stamp, Wait};
use crate::io::hid::{self, Limits, Pipe, PipeError};
use crate::sk::Frame;

/// A board on USB.
struct UsbLink {
    info: LinkInfo,
    pipe: Pipe,
    opened: Instant,
    counts: Counts,
}

#[derive(Default)]
struct Counts {
    written: AtomicU64,
    read: AtomicU64,
    write_errors: AtomicU64,
    read_errors: AtomicU64,
}

/// Opens the board that the URI chooses.
pub(super) fn open(uri: &LinkUri, common: &CommonOptions) -> Result<Arc<dyn Link>, LinkError> {
    let options = UsbOptions::from_uri(uri)?;
    let name = uri.to_string();
    let unusable = |error: rusb::Error| LinkError::NoBoard {
        name: name.clone(),
        reason: format!("the USB of this machine cannot be used ({error}); is there one, and /dev/bus/usb?"),
    };
    let context = Context::new().map_err(unusable)?;
    let found = hid::find(&context, options.vendor, options.product).map_err(unusable)?;
    let (board, shape) = choose(&name, &found, &options)?;
    if !board.high_speed {
        log::warn!(
            "the board at {} does not run at high speed; plug it into another port, and not behind a hub of USB 1.1",
            board.path
        );
    }
    let limits = Limits { transfers: options.transfers, queue: common.queue };
    let pipe = Pipe::open(board, shape, limits).map_err(|error| refused(&name, &board.path, error))?;
    let info = LinkInfo {
        name,
        slot: common.slot,
        virtual_time: false,
        opened_at: Stamp(0),
        read_wait: common.read_wait(),
        write_wait: common.write_wait(),
    };
    Ok(Arc::new(UsbLink { info, pipe, opened: Instant::now(), counts: Counts::default() }))
}

/// A board that was found and does not open.
fn refused(name: &str, path: &str, error: PipeError) -> LinkError {
    let no_board = |reason: String| LinkError::NoBoard { name: name.to_owned(), reason };
    match error {
        PipeError::Usb(rusb::Error::Access) => no_board(format!(
            "the one at {path} may not be opened by this user; give it to users by a udev rule (docs/VIRTUAL-BOARD.md \
             has it), or be root"
        )),
        PipeError::Usb(rusb::Error::Busy) => LinkError::InUse {
            name: name.to_owned(),
            by: format!(" by another program (the board at {path})"),
            instead: "share the board by `ecmsk serve tcp`",
        },
        other => no_board(format!("the one at {path} does not open: {other}; pull it and plug it in again")),
    }
}

impl UsbLink {
    fn stamp(&self, at: Instant) -> Stamp {
        let since = at.saturating_duration_since(self.opened).as_nanos();
        Stamp(u64::try_from(since).unwrap_or(u64::MAX))
    }

    fn error(&self, dir: Dir, error: PipeError) -> LinkError {
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
            PipeError::Lost(reason) => LinkError::Lost { name: self.info.name.clone(), reason: reason.into() },
            PipeError::Torn { moved } => LinkError::Io {
                what: format!("write to the board at `{}`", self.info.name),
                message: format!(
                    "{moved} of 512 bytes were moved; a board hangs after such a frame, switch it off and on"
                ),
            },
            PipeError::Usb(error) => {
                LinkError::Io { what: format!("{dir} at `{}`", self.info.name), message: error.to_string() }
            }
        }
    }
}

const fn limit(wait: Wait) -> Option<Duration> {
    match wait {
        Wait::Forever => None,
        Wait::For(limit) => Some(limit),
        Wait::Now => Some(Duration::ZERO),
    }
}

impl Link for UsbLink {
    fn info(&self) -> LinkInfo {
        self.info.clone()
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        match self.pipe.write(frame.bytes(), limit(wait)) {
            Ok(()) => {
                self.counts.written.fetch_add(1, Ordering::Relaxed);
                Ok(self.stamp(Instant::now()))
            }
            Err(error) => {
                self.counts.write_errors.fetch_add(1, Ordering::Relaxed);
                Err(self.error(Dir::Write, error))
            }
        }
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        match self.pipe.read(out.bytes_mut(), limit(wait)) {
            Ok((at, sequence)) => {
                self.counts.read.fetch_add(1, Ordering::Relaxed);
                Ok(ReadMeta { at: self.stamp(at), sequence, dropped: self.pipe.stats().dropped })
            }
            Err(error) => {
                self.counts.read_errors.fetch_add(1, Ordering::Relaxed);
                Err(self.error(Dir::Read, error))
            }
        }
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
        let count = |count: &AtomicU64| count.load(Ordering::Relaxed);
        LinkStats {
            written: count(&self.counts.written),
            read: count(&self.counts.read),
            reports_dropped: self.pipe.stats().dropped,
            write_errors: count(&self.counts.write_errors),
            read_errors: count(&self.counts.read_errors),
            ..LinkStats::default()
        }
    }
}

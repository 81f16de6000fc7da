//! Opens the link that a URI names, to a board or to a chip. Only this module knows all kinds of links.

pub mod chip;
mod help;

use std::sync::Arc;

use crate::address::keys::Scheme;
use crate::address::uri;
use crate::link::common_options::CommonOptions;
use crate::link::{Link, LinkError, Share, fault, limits, record};
use crate::recording::{CarriedFile, RecordMeta};
use crate::summary::FlightEvents;

pub use help::help;

/// Opens the link that `uri` names.
///
/// ```
/// use ecmsk::link::{self, Share, Wait};
/// use ecmsk::sk::{Frame, MasterResponse, MasterState, SlotSize, StateByte};
///
/// let board = link::open("sim:?slaves=drive*2&clock=virtual", Share::ByName)?;
/// let mut report = Frame::new();
/// board.read(&mut report, Wait::Forever)?;
/// let answer = MasterResponse::decode(&report.slot(SlotSize::Bytes12, 0));
/// assert_eq!(answer.state, StateByte::reached(MasterState::PreOp));
/// # Ok::<(), ecmsk::link::LinkError>(())
/// ```
///
/// # Errors
/// [`LinkError::Uri`] for an invalid URI, [`LinkError::Unsupported`] if this build has no such links,
/// [`LinkError::NoBoard`] if no board answers, [`LinkError::InUse`] if another program has the board, [`LinkError::Io`]
/// for an error of the system.
pub fn open(uri: &str, share: Share) -> Result<Arc<dyn Link>, LinkError> {
    open_with(uri, share, false, None)
}

/// Like [`open`]. Recordings of the link contain the file `machine`, unless the link names a machine file itself
/// (`axes=`). The limits in `machine` are not applied.
///
/// # Errors
/// Those of [`open`].
pub fn open_carrying(uri: &str, share: Share, machine: Arc<CarriedFile>) -> Result<Arc<dyn Link>, LinkError> {
    open_with(uri, share, false, Some(machine))
}

/// Like [`open`], for callers that do not need an exact
/// [`LinkStats::reports_dropped`](crate::link::LinkStats::reports_dropped). On Windows a board on USB then accepts
/// frames faster while its reports are not read, but reports that are dropped meanwhile are not counted. If the link
/// has a recording, this function does the same as [`open`].
///
/// # Errors
/// Those of [`open`].
pub fn open_uncounted(uri: &str, share: Share) -> Result<Arc<dyn Link>, LinkError> {
    open_with(uri, share, true, None)
}

fn open_with(
    uri: &str,
    share: Share,
    uncounted: bool,
    machine: Option<Arc<CarriedFile>>,
) -> Result<Arc<dyn Link>, LinkError> {
    let uri = uri::LinkUri::parse(uri)?;
    let options = CommonOptions::from_uri(&uri)?;
    let is_recorded = options.record.is_some() || options.flight.is_some();
    let mut link = connect(&uri, &options, share, uncounted && !is_recorded)?;
    if options.fault.any() {
        link = Arc::new(fault::FaultLink::new(link, options.fault));
    }
    let info = link.info();
    let mut meta = RecordMeta::now(&info, info.opened_at);
    let axes = limits::Axes::of(&options)?;
    meta.machine = axes.as_ref().map(limits::Axes::carried).or(machine);
    // The recorders wrap the fault injection, so the recordings have the frames as the program saw them. The limits
    // wrap the recorders: if they remove targets from a frame, the recordings have the frame as it was sent.
    if let Some(flight) = &options.flight {
        let watch = Box::new(FlightEvents::new(info.slot, flight.following_error));
        link = Arc::new(record::RecordLink::to_flight(link, flight, &meta, watch)?);
    }
    if let Some(path) = &options.record {
        link = Arc::new(record::RecordLink::new(link, path, &meta)?);
    }
    Ok(match axes {
        Some(axes) => axes.around(link),
        None => link,
    })
}

/// The simulated board of a `sim:` or `xf-sim:` link, without the link. It was just powered on, and its time advances
/// only when the caller advances it. Only the keys that describe the board and its network have an effect.
///
/// # Errors
/// [`LinkError::Uri`], [`LinkError::Script`], [`LinkError::ManufacturerObjects`], [`LinkError::NoBoard`].
#[cfg(feature = "sim")]
pub fn model(uri: &uri::LinkUri) -> Result<crate::engine::Board, LinkError> {
    crate::testbed::sim::model(uri)
}

#[cfg_attr(
    not(all(feature = "sim", feature = "usb")),
    allow(unused_variables, reason = "some of them concern links that are not in the build")
)]
fn connect(
    uri: &uri::LinkUri,
    options: &CommonOptions,
    share: Share,
    uncounted: bool,
) -> Result<Arc<dyn Link>, LinkError> {
    let scheme: Scheme = uri.scheme();
    match scheme {
        #[cfg(feature = "sim")]
        Scheme::Sim | Scheme::XfSim => Ok(Arc::new(crate::testbed::sim::open(uri, options, share)?)),
        #[cfg(all(feature = "spi", target_os = "linux"))]
        Scheme::Spi => crate::hardware::spi::open(uri, options),
        #[cfg(all(feature = "tcp", any(unix, windows)))]
        Scheme::Tcp => crate::tcp::open(uri, options),
        #[cfg(all(feature = "usb", any(unix, windows)))]
        Scheme::Usb => crate::hardware::usb::open(uri, options, uncounted),
        #[cfg(any(all(feature = "spi", target_os = "linux"), all(feature = "usb", unix)))]
        Scheme::XfSpi | Scheme::XfUsb => Ok(Arc::new(chip::board(uri)?)),
        #[cfg(all(feature = "nic", target_os = "linux"))]
        Scheme::Nic => Ok(Arc::new(crate::own_board::nic::open(uri, options)?)),
        #[allow(unreachable_patterns, reason = "a build may have every link")]
        other => Err(LinkError::Unsupported { scheme: other.name().into(), hint: other.instead() }),
    }
}

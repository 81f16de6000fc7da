//! The machine file of a link (`axes=`, `machine=`): a [`Link`] around a link that checks the targets of a program against
//! the soft limits of the file.
//!
//! A target beyond a limit is reported in the log, once for each excursion. The excursion ends when the axis gets a
//! target within its limits again.
//!
//! If the file says so (`[limits] program = "stop"`), a frame with a target that leads further out is sent without its
//! CSP targets, and the write fails with [`LinkError::BeyondLimit`]. So all axes in CSP hold their last targets. All
//! other commands of the frame reach the board, because the frame may switch axes off, abort homing, clear the FIFO or
//! brake an axis in CSV. A program that ignores the result of a write would not send these commands again. A target
//! that leads back is sent, so that an axis outside its limits can return. \[OURS]

#[cfg(test)]
mod tests;

use std::borrow::Cow;
use std::path::PathBuf;
use std::sync::Arc;

use super::common_options::CommonOptions;
use super::{Layer, Link, LinkError, ReadMeta, Stamp, Wait};
use crate::address::scale::SoftLimits;
use crate::address::uri::{LinkUri, UriError};
use crate::machine_file::{MachineAxis, MachineFile, ProgramLimits, axes_of_link};
use crate::recording::{CarriedFile, SizeFinder};
use crate::sk::{CommandId, CrcPolicy, DriveResponse, FRAME_LEN, Frame, RawSlot, SlotSize};
use crate::span::Seconds;
use crate::threads::sync::unlockable::Mutex;

/// The machine file that the options of a link name.
pub(crate) struct Axes {
    machine: MachineFile,
    carried: Arc<CarriedFile>,
}

impl Axes {
    /// The file of a link; `None` if the link names none.
    ///
    /// # Errors
    /// [`UriError::BadValue`]: the file cannot be used.
    pub(crate) fn of(options: &CommonOptions) -> Result<Option<Self>, UriError> {
        let Some(path) = &options.axes else { return Ok(None) };
        let (machine, text) = axes_of_link(path)?;
        Ok(Some(Self { machine, carried: Arc::new(CarriedFile::new(path, &text)) }))
    }

    /// The file in the form in which recordings contain it.
    pub(crate) fn carried(&self) -> Arc<CarriedFile> {
        Arc::clone(&self.carried)
    }

    /// Wraps `link` in a link that checks the limits of the file. Returns `link` itself if no axis has a limit.
    pub(crate) fn around(self, link: Arc<dyn Link>) -> Arc<dyn Link> {
        around(link, self.machine, Box::new(|line| log::warn!("{line}")))
    }
}

/// Wraps `link` in a link that checks the limits of a machine file. Returns `link` itself if no axis has a limit.
/// `tell` gets a line for each excursion; it is called in a write of the program, and must not wait.
pub(crate) fn around(link: Arc<dyn Link>, machine: MachineFile, tell: Tell) -> Arc<dyn Link> {
    let MachineFile { path, axes, program_limits, .. } = machine;
    let axes: Vec<MachineAxis> = axes.into_iter().filter(|axis| axis.limits != SoftLimits::NONE).collect();
    if axes.is_empty() {
        return link;
    }
    let state = State {
        sizes: SizeFinder::new(link.info().slot),
        now: link.info().opened_at,
        axes: vec![AxisState::default(); axes.len()],
    };
    Arc::new(LimitLink { inner: link, file: path, axes, program_limits, tell, state: Mutex::new(state) })
}

/// As [`around`], for the machine file of a server. Returns `link` itself if the link names a machine file of its own
/// (`axes=`, `machine=`), or if the server's file cannot be used; in the latter case `tell` gets a line.
pub(crate) fn around_served(link: Arc<dyn Link>, file: &CarriedFile, tell: Tell) -> Arc<dyn Link> {
    let names_file = |uri: LinkUri| uri.value("axes").or_else(|| uri.value("machine")).is_some();
    if LinkUri::parse(&link.info().name).is_ok_and(names_file) {
        return link;
    }
    match MachineFile::parse(file.name(), file.text()) {
        Ok(machine) => around(link, machine, tell),
        Err(error) => {
            tell(format!("the limits of the machine file are not checked: {error}"));
            link
        }
    }
}

/// Reports a line of text to the user.
pub(crate) type Tell = Box<dyn Fn(String) + Send + Sync>;

/// A link around another one that checks the targets of axes against their limits.
struct LimitLink {
    inner: Arc<dyn Link>,
    /// The path of the machine file, for messages.
    file: PathBuf,
    /// The axes that have limits.
    axes: Vec<MachineAxis>,
    program_limits: ProgramLimits,
    tell: Tell,
    state: Mutex<State>,
}

struct State {
    sizes: SizeFinder,
    /// The time of the newest report.
    now: Stamp,
    /// The state of each axis in [`LimitLink::axes`], in the same order.
    axes: Vec<AxisState>,
}

/// How far an axis is beyond its limits, see [`SoftLimits::excess`].
#[derive(Clone, Copy, Debug, Default)]
struct AxisState {
    /// How far the last target that was sent is beyond the limits; 0 within them.
    target: i64,
    /// How far the position in the newest report is beyond the limits; 0 within them.
    position: i64,
    /// Whether the present excursion was reported.
    is_reported: bool,
}

impl AxisState {
    /// Whether a target with this excess leads no further out: the position or the last target of the axis is at least
    /// as far out, on the same side.
    fn allows(self, excess: i64) -> bool {
        SoftLimits::is_covered(excess, self.target) || SoftLimits::is_covered(excess, self.position)
    }
}

/// A copy of a frame without the targets of axes (CSP). A slot keeps its index, by which reports show that the board
/// has executed the frame. If the CRC of the frame is right, the CRC of the copy is right as well.
fn without_targets(frame: &Frame, size: SlotSize) -> Frame {
    let mut rest = frame.clone();
    for slave in 1..=size.max_slaves() {
        let slot = frame.slot(size, slave);
        if slot.id == CommandId::Csp.code() {
            rest.put(size, slave, &RawSlot { index: slot.index, ..RawSlot::ZERO });
        }
    }
    if frame.check_crc(size, CrcPolicy::Strict).is_ok() {
        rest.fill_crc(size);
    }
    rest
}

/// The frame that the board has got after a write with the result `written`, and when; `None`: it has got none. After
/// [`LinkError::BeyondLimit`] it is the frame without its CSP targets. Only in that case `size` is called.
pub(crate) fn taken<'f>(
    frame: &'f Frame,
    written: &Result<Stamp, LinkError>,
    size: impl FnOnce() -> Option<SlotSize>,
) -> Option<(Cow<'f, Frame>, Stamp)> {
    match written {
        Ok(at) => Some((Cow::Borrowed(frame), *at)),
        Err(LinkError::BeyondLimit { at_ns, .. }) => Some((Cow::Owned(without_targets(frame, size()?)), Stamp(*at_ns))),
        Err(_) => None,
    }
}

impl LimitLink {
    /// The axes that have a slot in frames of this slot size, with their indices in [`Self::axes`].
    fn slots(&self, size: SlotSize) -> impl Iterator<Item = (usize, &MachineAxis)> {
        self.axes.iter().enumerate().filter(move |(_, axis)| usize::from(axis.slave) <= size.max_slaves())
    }

    /// The message about a target beyond a limit: axis, target and limit in the unit of the axis, and the time since
    /// the link was opened.
    fn words(&self, axis: &MachineAxis, target: i32, at: Stamp) -> String {
        let (target, name, limit) = axis.beyond(target);
        let seconds = Seconds(at.0.saturating_sub(self.inner.info().opened_at.0));
        let MachineAxis { name: axis, unit, .. } = axis;
        format!(
            "axis {axis}: a target of {target} {unit} at {seconds} is beyond {name} = {limit} {unit} of {}",
            self.file.display()
        )
    }

    /// Checks the CSP targets of a frame that is to be sent. If one of them leads further out, and the file forbids
    /// that, returns the text of the write's error and the frame that is sent instead.
    fn refused(&self, frame: &Frame) -> Option<(String, Frame)> {
        if self.program_limits != ProgramLimits::Stop {
            return None;
        }
        let mut state = self.state.lock();
        let size = state.sizes.size_of(frame, FRAME_LEN).0;
        let beyond = self.slots(size).find_map(|(place, axis)| {
            let slot = frame.slot(size, usize::from(axis.slave));
            let target = slot.data1 as i32;
            let passes = slot.id != CommandId::Csp.code() || state.axes[place].allows(axis.limits.excess(target));
            (!passes).then_some((place, axis, target))
        });
        let (place, axis, target) = beyond?;
        let words = self.words(axis, target, state.now);
        if !std::mem::replace(&mut state.axes[place].is_reported, true) {
            (self.tell)(format!("{words}; it is not sent, and the axes hold their last targets"));
        }
        let why = format!("{words}; the frame was sent without its targets (CSP); correct the program, or the limit");
        Some((why, without_targets(frame, size)))
    }

    /// Notes the targets of a frame that was sent at the time `at`, and reports those beyond a limit.
    fn sent(&self, frame: &Frame, at: Stamp) {
        let mut state = self.state.lock();
        state.sizes.look(frame, FRAME_LEN);
        let size = state.sizes.size_of(frame, FRAME_LEN).0;
        for (place, axis) in self.slots(size) {
            let slot = frame.slot(size, usize::from(axis.slave));
            let known = &mut state.axes[place];
            if slot.id == CommandId::GoHome.code() {
                // Homing gives the axis new coordinates, so both values are out of date.
                (known.target, known.position) = (0, 0);
            }
            if slot.id != CommandId::Csp.code() {
                continue;
            }
            let target = slot.data1 as i32;
            known.target = axis.limits.excess(target);
            if known.target != 0 && !known.is_reported {
                (self.tell)(self.words(axis, target, at));
            }
            known.is_reported = known.target != 0;
        }
    }
}

impl Layer for LimitLink {
    fn inner(&self) -> &dyn Link {
        &*self.inner
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        let refused = self.refused(frame);
        let sent = refused.as_ref().map_or(frame, |(_, rest)| rest);
        let at = self.inner.write(sent, wait)?;
        self.sent(sent, at);
        match refused {
            None => Ok(at),
            Some((why, _)) => Err(LinkError::BeyondLimit { at_ns: at.0, why }),
        }
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        let meta = self.inner.read(out, wait)?;
        let mut state = self.state.lock();
        state.now = meta.at;
        let size = state.sizes.size_of(out, FRAME_LEN).0;
        for (place, axis) in self.slots(size) {
            let DriveResponse { position, statusword, .. } =
                DriveResponse::decode(&out.slot(size, usize::from(axis.slave)));
            let known = &mut state.axes[place];
            known.position = axis.limits.excess(position);
            if !statusword.is_enabled() {
                // An axis that is off no longer moves to its last target, and may be moved by hand.
                known.target = 0;
            }
        }
        Ok(meta)
    }
}

//! A recording: its frames, what went wrong, and what each axis did, as columns of bytes from which `ecmsk/recordings.py`
//! makes arrays.

use std::path::{Path, PathBuf};

use ecmsk::link::Dir;
use ecmsk::machine_file::MachineFile;
use ecmsk::recording::{
    Address, Entry, Execution, ExecutionReport, InOrder, Kinds, NO_ORDERS, RecordError, RecordMeta, Recorded,
    Recording, SizeFinder, Timeline, board_in,
};
use ecmsk::sk::dump::MAX_SLAVES;
use ecmsk::sk::{
    CommandId, DriveResponse, FRAME_LEN, FifoAction, Frame, MasterCommand, MasterResponse, MasterState, SlaveCommand,
    SlaveKind, SlotCommand, SlotSize,
};
use ecmsk::summary::{FrameWatch, Summary};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::errors::named;
use crate::names::Names;

/// The cycle time of a board to which no SET_DC was sent (UG 1.7), in nanoseconds.
const DEFAULT_CYCLE_NS: i64 = 1_000_000;
/// The most frames by which the slot size is found, if the recording does not state it.
const SIZE_FRAMES_MAX: usize = 1000;
/// Handlers of signals run after this many frames.
const SIGNAL_CHECK_FRAMES: u64 = 100_000;

/// What an axis did, one value for each report in OP.
#[derive(Default)]
struct Columns {
    time_ns: Vec<i64>,
    position: Vec<i32>,
    torque: Vec<i16>,
    statusword: Vec<u16>,
    error_code: Vec<u16>,
    /// The executed target, counts; NaN while none is in force.
    target: Vec<f64>,
    /// The target in force.
    in_force: Option<i32>,
    /// Whether a command for axes was sent to the slave, which makes it an axis without SET_AXIS, too.
    is_axis: bool,
}

impl Columns {
    fn executed(&mut self, order: &SlaveCommand) {
        match order {
            SlaveCommand::Csp(motion) => {
                self.is_axis = true;
                self.in_force = Some(motion.first.target);
            }
            SlaveCommand::GetStatus | SlaveCommand::Other(_) | SlaveCommand::IoRead | SlaveCommand::IoWrite(_) => {}
            order => {
                self.is_axis |= order.id().is_for_axes();
                self.in_force = None;
            }
        }
    }

    fn report(&mut self, at_ns: i64, drive: &DriveResponse, is_hsp: bool, is_certain: bool) {
        // Homing moves the zero of the position, and an axis that is off does not follow.
        if CommandId::from_code(drive.head.id) == CommandId::GoHome || !drive.statusword.is_enabled() {
            self.in_force = None;
        }
        self.time_ns.push(at_ns);
        self.position.push(drive.position);
        self.statusword.push(drive.statusword.0);
        // A pulse module has inputs where a drive has its torque and its error code.
        self.torque.push(if is_hsp { 0 } else { drive.torque });
        self.error_code.push(if is_hsp { 0 } else { drive.error_code });
        self.target.push(self.in_force.filter(|_| is_certain).map_or(f64::NAN, f64::from));
    }
}

/// Follows a run frame by frame, in the order of time.
struct Reader {
    axes: Vec<Columns>,
    kinds: Kinds,
    execution: Execution,
    in_op: bool,
    watch: FrameWatch,
    summary: Summary,
    size: SlotSize,
    last_ns: i64,
}

impl Reader {
    fn new(size: SlotSize) -> Self {
        Self {
            axes: (0..MAX_SLAVES).map(|_| Columns::default()).collect(),
            kinds: Kinds::new(None),
            execution: Execution::new(DEFAULT_CYCLE_NS),
            in_op: false,
            watch: FrameWatch::new(size),
            summary: Summary::default(),
            size,
            last_ns: 0,
        }
    }

    fn frame(&mut self, at_ns: i64, dir: Dir, frame: &Frame) {
        self.last_ns = self.last_ns.max(at_ns);
        match dir {
            Dir::Write => {
                self.watch.command(at_ns, frame);
                self.command(at_ns, frame);
            }
            Dir::Read => {
                let summary = &mut self.summary;
                self.watch.report(at_ns, frame, &mut |event| summary.add_event(event));
                self.report(at_ns, frame);
            }
        }
    }

    fn command(&mut self, at_ns: i64, frame: &Frame) {
        self.kinds.command(frame, self.size);
        let master = MasterCommand::decode(&frame.slot(self.size, 0), self.size);
        if !self.in_op {
            if let Ok(MasterCommand::SetDc { cycle, .. }) = master {
                self.execution = Execution::new(i64::from(cycle.us()).max(1) * 1000);
            }
            return;
        }
        let mut orders = NO_ORDERS;
        for (slave, order) in (1..=self.size.max_slaves()).zip(&mut orders) {
            *order = SlotCommand::decode(&frame.slot(self.size, slave), self.size).ok().map(|slot| slot.command);
        }
        self.execution.command(at_ns, orders, master == Ok(MasterCommand::SetFifo(FifoAction::Clear)));
    }

    fn report(&mut self, at_ns: i64, frame: &Frame) {
        self.kinds.response(frame, self.size);
        let board = MasterResponse::decode(&frame.slot(self.size, 0));
        self.in_op = board.state.state() == Some(MasterState::Op);
        if !self.in_op || board.state.is_failed() {
            // The slots of lost slaves repeat their last values.
            self.execution.reset();
            self.axes.iter_mut().for_each(|axis| axis.in_force = None);
            return;
        }
        let is_certain = match self.execution.report(at_ns, &board) {
            ExecutionReport::Executed { entries, .. } => {
                entries.iter().for_each(|entry| self.execute(entry));
                true
            }
            ExecutionReport::Later => false,
            ExecutionReport::Unknown => {
                self.axes.iter_mut().for_each(|axis| axis.in_force = None);
                false
            }
        };
        for (slave, axis) in (1..=self.size.max_slaves()).zip(&mut self.axes) {
            let kind = self.kinds.of(slave);
            if axis.is_axis || matches!(kind, Some(SlaveKind::Drive | SlaveKind::Step | SlaveKind::Hsp)) {
                let drive = DriveResponse::decode(&frame.slot(self.size, slave));
                axis.report(at_ns, &drive, kind == Some(SlaveKind::Hsp), is_certain);
            }
        }
    }

    fn execute(&mut self, Entry { orders, .. }: &Entry) {
        for (axis, order) in self.axes.iter_mut().zip(orders) {
            order.iter().for_each(|order| axis.executed(order));
        }
    }
}

/// What ``ecmsk.Recording`` is made of.
#[pyclass(frozen, module = "ecmsk")]
pub struct RecordedRun {
    path: PathBuf,
    device: Option<Address>,
    names: Names,
    size: SlotSize,
    meta: Option<RecordMeta>,
    axes: Vec<Columns>,
    summary: Summary,
    frames: u64,
    gaps: u64,
    duration_ns: i64,
    lacks: Option<String>,
}

/// Why a file was not read.
enum Failure {
    Record(RecordError),
    Raised(PyErr),
}

impl From<RecordError> for Failure {
    fn from(error: RecordError) -> Self {
        Self::Record(error)
    }
}

fn slot_size(path: &Path, device: Option<Address>) -> Result<SlotSize, RecordError> {
    let mut recording = opened(path, device)?;
    let mut sizes = SizeFinder::new(recording.meta().and_then(|meta| meta.slot));
    for recorded in recording.by_ref().take(SIZE_FRAMES_MAX) {
        if sizes.is_sure() {
            break;
        }
        // An error comes again when the frames are read.
        let Ok(recorded) = recorded else { break };
        sizes.look(&recorded.frame, FRAME_LEN);
    }
    Ok(sizes.size().0)
}

fn opened(path: &Path, device: Option<Address>) -> Result<Recording<std::fs::File>, RecordError> {
    let recording = Recording::open(path)?;
    Ok(match device {
        Some(device) => recording.only(device),
        None => recording,
    })
}

fn read(path: PathBuf, names: Names) -> Result<RecordedRun, Failure> {
    let device = board_in(&path)?;
    let size = slot_size(&path, device)?;
    let mut recording = opened(&path, device)?;
    let meta = recording.meta().cloned();
    let mut reader = Reader::new(size);
    let (mut timeline, mut order) = (Timeline::<Recorded>::default(), InOrder::<(i64, Recorded)>::default());
    let (mut frames, mut damage) = (0_u64, None);
    let mut take = |(at_ns, recorded): (i64, Recorded)| reader.frame(at_ns, recorded.dir, &recorded.frame);
    for recorded in &mut recording {
        let recorded = match recorded {
            Ok(recorded) => recorded,
            // What comes before the damage is as good as ever.
            Err(error @ (RecordError::Truncated { .. } | RecordError::Malformed { .. })) => {
                damage = Some(error.to_string());
                break;
            }
            Err(error) => return Err(error.into()),
        };
        frames += 1;
        if let Some((at_ns, recorded)) = timeline.push(recorded.at_ns, recorded) {
            order.push(at_ns, (at_ns, recorded)).into_iter().for_each(&mut take);
        }
        if frames.is_multiple_of(SIGNAL_CHECK_FRAMES) {
            Python::attach(|py| py.check_signals()).map_err(Failure::Raised)?;
        }
    }
    if let Some((at_ns, recorded)) = timeline.pop() {
        order.push(at_ns, (at_ns, recorded)).into_iter().for_each(&mut take);
    }
    while let Some(placed) = order.pop() {
        take(placed);
    }
    let lacks = Some(recording.lacks()).filter(|lacks| !lacks.is_nothing()).map(|lacks| lacks.to_string());
    let Reader { axes, watch, mut summary, last_ns, .. } = reader;
    let counts = watch.counts();
    summary.set_frame_counts(&counts);
    Ok(RecordedRun {
        path,
        device,
        names,
        size,
        meta,
        axes,
        summary,
        frames,
        gaps: counts.gaps,
        duration_ns: last_ns,
        lacks: damage.or(lacks),
    })
}

/// The bytes of a column, in the byte order of this machine.
macro_rules! bytes {
    ($py:expr, $column:expr) => {{
        let mut bytes = Vec::with_capacity(size_of_val(&$column[..]));
        $column.iter().for_each(|value| bytes.extend_from_slice(&value.to_ne_bytes()));
        PyBytes::new($py, &bytes)
    }};
}

fn failed(py: Python<'_>, error: &RecordError) -> PyErr {
    named(py, "RecordingError", &error.to_string(), None, None)
}

#[pymethods]
impl RecordedRun {
    #[new]
    #[pyo3(signature = (path, machine = None))]
    fn new(py: Python<'_>, path: PathBuf, machine: Option<PathBuf>) -> PyResult<Self> {
        let machine = machine.map(|file| MachineFile::load(&file)).transpose();
        let machine = machine.map_err(|error| crate::errors::exception(py, &error.into()))?;
        let names = Names(machine.map(Into::into));
        py.detach(|| read(path, names)).map_err(|failure| match failure {
            Failure::Record(error) => failed(py, &error),
            Failure::Raised(error) => error,
        })
    }

    #[getter]
    fn path(&self) -> &Path {
        &self.path
    }

    #[getter]
    const fn slot_size(&self) -> usize {
        self.size.bytes()
    }

    #[getter]
    fn link(&self) -> Option<&str> {
        self.meta.as_ref().map(|meta| meta.link.as_str())
    }

    #[getter]
    const fn frame_count(&self) -> u64 {
        self.frames
    }

    #[getter]
    fn duration(&self) -> f64 {
        self.duration_ns as f64 / 1e9
    }

    #[getter]
    fn lacks(&self) -> Option<&str> {
        self.lacks.as_deref()
    }

    #[getter]
    const fn gaps(&self) -> u64 {
        self.gaps
    }

    #[getter]
    fn summary(&self) -> Vec<String> {
        self.summary.lines(false)
    }

    #[getter]
    fn counts(&self) -> std::collections::BTreeMap<&str, u64> {
        self.summary.counts().collect()
    }

    /// Slave, error code, and how often the alarm began.
    #[getter]
    fn alarms(&self) -> Vec<(u8, u16, u64)> {
        self.summary.alarms().map(|(alarm, times)| (alarm.slave, alarm.code, times)).collect()
    }

    #[getter]
    fn slaves(&self) -> Vec<u32> {
        (1..).zip(&self.axes).filter(|(_, axis)| !axis.time_ns.is_empty()).map(|(slave, _)| slave).collect()
    }

    /// Number, name, unit and counts per unit of an axis.
    fn axis(&self, axis: &Bound<'_, PyAny>) -> PyResult<(u8, Option<&str>, Option<&'static str>, f64)> {
        let slave = self.names.slave(axis)?;
        let columns = usize::from(slave).checked_sub(1).and_then(|n| self.axes.get(n));
        if columns.is_none_or(|columns| columns.time_ns.is_empty()) {
            let message = format!("{} has no axis {slave} in OP; it has {:?}", self.path.display(), self.slaves());
            return Err(named(axis.py(), "NoSuchAxisError", &message, Some(slave), None));
        }
        let named = self.names.0.as_ref().and_then(|machine| machine.axis_of(slave));
        Ok(match named {
            Some(named) => (slave, Some(named.name.as_str()), Some(named.unit.word()), named.scale.counts_per_unit),
            None => (slave, None, None, 1.0),
        })
    }

    fn column<'py>(&self, py: Python<'py>, slave: u8, name: &str) -> Option<Bound<'py, PyBytes>> {
        let axis = self.axes.get(usize::from(slave).checked_sub(1)?)?;
        Some(match name {
            "time_ns" => bytes!(py, axis.time_ns),
            "position" => bytes!(py, axis.position),
            "torque" => bytes!(py, axis.torque),
            "statusword" => bytes!(py, axis.statusword),
            "error_code" => bytes!(py, axis.error_code),
            "target" => bytes!(py, axis.target),
            _ => return None,
        })
    }

    fn frames(&self, py: Python<'_>) -> PyResult<RecordedFrames> {
        let recording = opened(&self.path, self.device).map_err(|error| failed(py, &error))?;
        Ok(RecordedFrames { recording, first_ns: None })
    }

    fn __repr__(&self) -> String {
        format!("<Recording {}, {} frames>", self.path.display(), self.frames)
    }
}

/// The frames of a recording, in the order of the file.
#[pyclass(module = "ecmsk")]
pub struct RecordedFrames {
    recording: Recording<std::fs::File>,
    first_ns: Option<u64>,
}

#[pymethods]
impl RecordedFrames {
    fn __iter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    /// Nanoseconds since the first frame, whether the frame went to the board, its bytes.
    fn __next__<'py>(&mut self, py: Python<'py>) -> PyResult<Option<(i64, bool, Bound<'py, PyBytes>)>> {
        let Some(next) = self.recording.next() else { return Ok(None) };
        let recorded = next.map_err(|error| failed(py, &error))?;
        let first_ns = *self.first_ns.get_or_insert(recorded.at_ns);
        let at_ns = recorded.at_ns.wrapping_sub(first_ns) as i64;
        Ok(Some((at_ns, recorded.dir == Dir::Write, PyBytes::new(py, recorded.frame.bytes()))))
    }
}

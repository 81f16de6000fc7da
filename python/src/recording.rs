//! A recording: its frames, what went wrong, and what each axis did, as columns of bytes from which `ecmsk/recordings.py`
//! makes arrays.

use std::path::{Path, PathBuf};

use ecmsk::link::Dir;
use ecmsk::machine_file::MachineFile;
use ecmsk::recording::{
    Address, InOrder, RecordError, RecordMeta, Recorded, Recording, SizeFinder, Timeline, board_in,
};
use ecmsk::sk::{FRAME_LEN, SlotSize};
use ecmsk::summary::Summary;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::errors::named;
use crate::names::Names;
use crate::recorded_axes::{Columns, Reader};

/// The most frames that are read to find the slot size, if the recording does not state it.
const SIZE_FRAMES_MAX: usize = 1000;
/// Handlers of signals run each time this many frames were read, so that Ctrl-C ends the reading.
const SIGNAL_CHECK_FRAMES: u64 = 100_000;

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
        // An error is ignored here: it occurs again when all frames are read, and is reported then.
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

/// Sorts the frames of a recording by time: the file has them in the order in which the host read and wrote them, so that
/// a report that was read late stands behind later commands.
#[derive(Default)]
struct InTime {
    timeline: Timeline<Recorded>,
    order: InOrder<(i64, Recorded)>,
}

impl InTime {
    /// Adds the next frame of the file. Once enough are buffered, returns the earliest of them with its time.
    fn push(&mut self, recorded: Recorded) -> Option<(i64, Recorded)> {
        let placed = self.timeline.push(recorded.at_ns, recorded)?;
        self.order.push(placed.0, placed)
    }

    /// After the last frame of the file: the earliest frame that is still buffered.
    fn pop(&mut self) -> Option<(i64, Recorded)> {
        let last = self.timeline.pop();
        last.and_then(|placed| self.order.push(placed.0, placed)).or_else(|| self.order.pop())
    }
}

/// Gives all frames to the reader. Returns how many there are, and what is wrong with the rest of the file.
fn follow(recording: &mut Recording<std::fs::File>, reader: &mut Reader) -> Result<(u64, Option<String>), Failure> {
    let (mut in_time, mut frames) = (InTime::default(), 0_u64);
    let mut take = |(at_ns, recorded): (i64, Recorded)| {
        reader.frame(at_ns, recorded.damage_before, recorded.dir, &recorded.frame);
    };
    let mut damage = None;
    for recorded in recording {
        match recorded {
            Ok(recorded) => in_time.push(recorded).into_iter().for_each(&mut take),
            // The frames before the damage are valid, so they are used, and the damage is reported as what the recording
            // lacks.
            Err(error @ (RecordError::Truncated { .. } | RecordError::Malformed { .. })) => {
                damage = Some(error.to_string());
                break;
            }
            Err(error) => return Err(error.into()),
        }
        frames += 1;
        if frames.is_multiple_of(SIGNAL_CHECK_FRAMES) {
            Python::attach(|py| py.check_signals()).map_err(Failure::Raised)?;
        }
    }
    while let Some(placed) = in_time.pop() {
        take(placed);
    }
    Ok((frames, damage))
}

fn read(path: PathBuf, names: Names) -> Result<RecordedRun, Failure> {
    let device = board_in(&path)?;
    let size = slot_size(&path, device)?;
    let mut recording = opened(&path, device)?;
    let meta = recording.meta().cloned();
    let mut reader = Reader::new(size);
    let (frames, damage) = follow(&mut recording, &mut reader)?;
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

    /// For each alarm of a drive: the slave, the error code, and how often the alarm began.
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

/// The frames of a recording in the order of the file, which is not always the order of time: a report that was read late
/// stands behind later commands.
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

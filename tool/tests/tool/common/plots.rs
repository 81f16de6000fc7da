//! Plots of recordings for tests: runs of the fake board, and the tool's plots of them.

use std::path::PathBuf;

use ecmsk::sk::SlotSize;
use tempfile::TempDir;

use super::motion::FakeBoard;
use super::svg::Plot;
use super::{Ran, run};

/// A recording of the fake board in a folder of its own, to be plotted.
pub struct Recorded {
    _folder: TempDir,
    pub file: PathBuf,
}

impl Recorded {
    pub fn new(run: &FakeBoard) -> Self {
        Self::of_link(run, "sim:?slaves=drive*3&clock=virtual")
    }

    pub fn of_link(run: &FakeBoard, link: &str) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("run.pcapng");
        run.script.record(&file, link, Some(run.size));
        Self { _folder: folder, file }
    }

    pub fn try_plot(&self, options: &[&str]) -> Ran {
        run([&["plot", self.file.to_str().expect("UTF-8")], options].concat())
    }

    /// The bytes of the plot in the format of this file name extension.
    pub fn picture(&self, ending: &str, options: &[&str]) -> Vec<u8> {
        let file = self.file.with_extension(ending);
        let name = file.to_str().expect("UTF-8");
        assert_eq!(self.try_plot(&[options, &["-o", name]].concat()).expect_quiet(), format!("{name}\n"));
        std::fs::read(&file).expect("a picture")
    }

    pub fn plot(&self, options: &[&str]) -> Plot {
        Plot::parse(&self.try_plot(&[options, &["-o", "-"]].concat()).expect_quiet())
    }
}

/// A run of two axes and its cycles: axis k goes k * 10 counts in each cycle for a second, and eight commands wait in the FIFO.
pub fn two_axes() -> (FakeBoard, Vec<Cycle>) {
    let mut run = FakeBoard::new(SlotSize::Bytes12, 2);
    let mut cycles = Vec::new();
    for i in 0..1008 {
        run.send(&[10 * i, 20 * i]);
        if i >= 8 {
            run.cycle();
            cycles.push(Cycle { seconds: run.seconds(), position: run.positions.clone(), target: run.targets.clone() });
        }
    }
    (run, cycles)
}

/// The state of the fake board after a cycle: the time, and for each axis the position and the executed target.
pub struct Cycle {
    pub seconds: f64,
    pub position: Vec<i32>,
    pub target: Vec<i32>,
}

/// Asserts that a value read from a plot is the expected one, up to a hundredth of `whole`, the length of the axis.
#[track_caller]
pub fn near(found: f64, expected: f64, whole: f64) {
    assert!((found - expected).abs() <= whole / 100.0, "{found} instead of {expected}");
}

/// Asserts that spans of time have these beginnings and ends, all in seconds, with a tolerance.
#[track_caller]
pub fn spans_are(found: &[(f64, f64)], expected: &[(f64, f64)], tolerance: f64) {
    let near = |a: f64, b: f64| (a - b).abs() < tolerance;
    let same = found.len() == expected.len()
        && found.iter().zip(expected).all(|(found, expected)| near(found.0, expected.0) && near(found.1, expected.1));
    assert!(same, "{found:?} instead of {expected:?}");
}

//! Captures of USB as other programs write them, made from the frames of a program and a board.

pub mod convert;
pub mod traffic;

use std::path::{Path, PathBuf};

use ecmsk::link::Dir;
use ecmsk::recording::Recording;
use tempfile::TempDir;

use convert::{Parts, pcap};
use traffic::Traffic;

/// A capture of a recorded run: the frames in the order of their times, each late by a part of a cycle, as on a
/// computer's clock.
pub fn captured(recording: &Path) -> Traffic {
    const ZERO_US: u64 = 1_600_000_000_000_037;
    let mut frames: Vec<_> = Recording::open(recording).expect("a recording").map(Result::unwrap).collect();
    frames.sort_by_key(|recorded| (recorded.at_ns, recorded.dir == Dir::Write));
    let mut traffic = Traffic::default();
    for recorded in frames {
        let before = traffic.events.len();
        match recorded.dir {
            Dir::Write => traffic.write(7, recorded.frame.bytes()),
            Dir::Read => traffic.read(7, recorded.frame.bytes()),
        };
        for event in &mut traffic.events[before..] {
            event.at_us = ZERO_US + recorded.at_ns / 1000;
        }
    }
    traffic
}

pub struct Kept {
    _folder: TempDir,
    pub file: PathBuf,
}

/// The traffic as a file.
pub fn kept(traffic: &Traffic, link_type: u32) -> Kept {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("board.pcap");
    std::fs::write(&file, pcap(&traffic.events, link_type, Parts::Two, 65_535)).expect("a file");
    Kept { _folder: folder, file }
}

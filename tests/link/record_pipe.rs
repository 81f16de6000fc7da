//! Recordings to a pipe: they can be read live, and a reader that stops reading delays no call.
#![cfg(unix)]

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;

use ecmsk::link::{self, LinkError, Share, Wait};
use ecmsk::recording::Recording;
use ecmsk::sk::Frame;

/// A new pipe of that name.
fn pipe(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}-{}", std::process::id()));
    let _ = fs::remove_file(&path);
    assert!(Command::new("mkfifo").arg(&path).status().expect("mkfifo is there").success());
    path
}

fn uri(clock: &str, pipe: &Path) -> String {
    format!("sim:?clock={clock}&record={}", pipe.display())
}

/// A pipe without a reader is refused with the next step.
#[test]
fn a_pipe_that_nobody_reads_is_refused() {
    let pipe = pipe("no-reader");
    match link::open(&uri("virtual", &pipe), Share::ByName).map(|_| ()) {
        Err(LinkError::Io { message, .. }) => assert!(message.contains("start its reader first"), "{message}"),
        other => panic!("{other:?}"),
    }
}

/// A reader gets every frame while the board is open.
#[test]
fn the_reader_of_a_pipe_gets_every_frame_while_the_board_is_open() {
    let pipe = pipe("reader");
    for clock in ["virtual", "real"] {
        let reader = std::thread::spawn({
            let pipe = pipe.clone();
            move || Recording::new(File::open(pipe).unwrap(), "pipe").unwrap().map(Result::unwrap).count()
        });
        // Until the reader has opened the pipe.
        let link = loop {
            match link::open(&uri(clock, &pipe), Share::ByName) {
                Ok(link) => break link,
                Err(_) => std::thread::yield_now(),
            }
        };
        let mut report = Frame::new();
        (0..500).for_each(|_| {
            link.read(&mut report, Wait::Forever).unwrap();
        });
        link.close();
        assert_eq!(reader.join().unwrap(), 500);
        assert_eq!(link.stats().record_dropped, 0);
    }
}

/// A reader that stops reading: calls go on, closing ends, and every frame that is not recorded is counted.
#[test]
fn a_reader_of_a_pipe_that_stops_reading_holds_up_no_call() {
    for clock in ["virtual", "real"] {
        let pipe = pipe(&format!("sleeper-{clock}"));
        let held = File::options().read(true).write(true).open(&pipe).unwrap();
        let link = link::open(&uri(clock, &pipe), Share::ByName).unwrap();
        let mut report = Frame::new();
        (0..500).for_each(|_| {
            link.read(&mut report, Wait::Forever).unwrap();
        });
        link.close();
        if clock == "virtual" {
            // The pipe and the queue before it hold some.
            assert!(link.stats().record_dropped > 100, "{:?}", link.stats());
        }
        drop(held);
    }
}

//! Any frames as a recording, replayed: the model lives through them and says the same each time, or an error says what is
//! wrong; no file that the recording names is opened.

#![no_main]

#[path = "support/folder.rs"]
mod folder;
#[path = "support/frames.rs"]
mod frames;

use ecmsk::compare::{CompareOptions, Steps, compare_steps};
use ecmsk::replay::{FilesInLink, Replay, ReplayError};
use ecmsk::sk::SlotSize;
use folder::Folder;
use libfuzzer_sys::fuzz_target;

/// What recordings say their link is.
const LINKS: [&str; 6] = [
    "sim:?slaves=drive,io&clock=virtual",
    "sim:?slaves=drive*3,hsp2,step",
    "sim:?slaves=drive&slot=16&name=a&record=/no/such/file",
    "sim:?slaves=drive&script=/no/such/file",
    "usb:",
    "sim:?slaves=none",
];

fuzz_target!(|bytes: &[u8]| {
    let Some((&[choice, of], rest)) = bytes.split_first_chunk() else { return };
    let size = if choice & 1 == 0 { SlotSize::Bytes12 } else { SlotSize::Bytes16 };
    let link = LINKS[usize::from(of) % LINKS.len()];
    let frames = frames::frames(rest, size);
    let folder = Folder::make();
    let file = folder.write("any.pcapng", frames::recording(link, &frames, choice & 2 == 0));
    let options = CompareOptions { ignore_repeats: choice & 4 != 0, ..CompareOptions::default() };
    let opened = Replay::open(&file, None, &options, None, FilesInLink::Refused);
    match opened.and_then(|replay| Ok([replay.runs()?, replay.runs()?, replay.runs()?])) {
        Ok([(board, model), (_, first), (_, second)]) => {
            assert!(!link.contains("script"), "a file that the recording names");
            let size = board.size();
            let found = compare_steps(
                Steps::new(board, size, options.ignore_repeats),
                Steps::new(model, size, options.ignore_repeats),
                &options,
            );
            assert!(!found.to_string().is_empty());
            let models = [first, second].map(|model| Steps::new(model, size, options.ignore_repeats));
            let [first, second] = models;
            assert!(compare_steps(first, second, &options).is_equal(), "another model");
            // The same with a host that waits: it ends.
            let replay = Replay::open(&file, None, &options, None, FilesInLink::Refused).expect("it was opened before");
            let (board, model) = replay.waiting_runs().expect("both runs");
            let found = compare_steps(Steps::new(board, size, false), Steps::new(model, size, false), &options);
            assert!(!found.to_string().is_empty());
        }
        Err(ReplayError::NamesFile { key, .. }) => assert_eq!(key, "script"),
        Err(error) => assert!(!error.to_string().is_empty()),
    }
});

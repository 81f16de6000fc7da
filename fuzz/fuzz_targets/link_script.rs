//! Any text as a script: a clear error with its place in the text, or steps that a board carries out.

#![no_main]

use ecmsk::engine::{BoardHandle, Script as _};
use ecmsk::fieldbus::Ns;
use ecmsk::link::options::SimOptions;
use ecmsk::link::script::{Script, ScriptError};
use ecmsk::link::uri::LinkUri;
use ecmsk::slave::cable::Cable;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    let uri = LinkUri::parse("sim:?slaves=drive*2,io").expect("a link");
    let slaves = SimOptions::from_uri(&uri).expect("of sim").slaves;
    match Script::parse("any", text, &slaves) {
        Ok(script) => {
            let steps = script.len();
            let mut run = script.start(Cable::default(), BoardHandle::default(), 0);
            let mut done = 0;
            run.run(Ns::MAX, &mut |event| {
                assert!(!event.to_string().is_empty());
                done += 1;
            });
            assert_eq!(done, steps);
            assert!(run.is_over());
        }
        Err(ScriptError::Line { line, column, message, .. }) => {
            let wrong = text.lines().nth(line as usize - 1).expect("a line of the text");
            assert!((1..=wrong.chars().count() + 1).contains(&column), "{wrong}: column {column}");
            assert!(message.contains("allowed: "), "{message}");
        }
        Err(error) => panic!("no file was read: {error}"),
    }
});

//! Any text as a machine file: an error that names a line and what to do, or a machine whose values fit together.

#![no_main]

use ecmsk::ecm::Config;
use ecmsk::link::uri::LinkUri;
use ecmsk::machine_file::{MachineFile, MachineFileError};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| match MachineFile::parse("any", text) {
    Ok(machine) => {
        assert!((1..=40).contains(&machine.slaves.len()));
        assert_eq!(Config::of_machine(&machine).slaves.len(), machine.slaves.len());
        for axis in &machine.axes {
            assert!(axis.scale.is_valid() && axis.limits.min <= axis.limits.max);
            assert_eq!(machine.axis(&axis.name).map(|found| found.slave), Some(axis.slave));
            assert_eq!(machine.axis_of(axis.slave).map(|found| &found.name), Some(&axis.name));
            assert!(usize::from(axis.slave) <= machine.slaves.len());
        }
        if let Some(link) = machine.link(None) {
            assert!(LinkUri::parse(&link.to_string()).is_ok(), "{link}");
        }
    }
    Err(MachineFileError::Unreadable { .. }) => panic!("no file was read"),
    Err(error) => {
        let said = error.to_string();
        let line = said.strip_prefix("any, line ").and_then(|said| said.split_once(": ")?.0.parse::<usize>().ok());
        assert!(line.is_some_and(|line| (1..=text.lines().count() + 1).contains(&line)), "{said}");
        assert!(said.contains("; "), "{said}");
    }
});

//! Machine files, from C: `tests/c/machine.c` reads them and checks itself.
#![cfg(target_os = "linux")]

use std::fs;

use crate::behaviour::{c_program, passes};

/// On virtual time, where every run is the same.
const LINK: &str = "sim:?slaves=drive*2&clock=virtual";

/// A whole machine file: axes in two units and in counts, an input, an output, a link.
const MACHINE: &str = r#"
format = 1
link = "sim:?clock=virtual"
[slaves.3]
kind = "io"
[axes]
X = { slave = 1, unit = "mm", per = 0.001, min = -10, max = 250.5, max_velocity = 100, max_acceleration = 1000.5 }
"Größe" = { slave = 2, unit = "deg", per = "-360/131072", min = -90 }
Z = { slave = 4 }
[inputs]
door = { slave = 3, bit = 0 }
[outputs]
lamp = { slave = 3, bit = 15 }
"#;

/// Writes files into the folder of a test, and returns the arguments of `tests/c/machine.c`: a whole file, the smallest one,
/// the beginning of the whole one's link, and wrong files, each with a part of its error.
fn arguments(folder: &str) -> Vec<String> {
    let folder = support::out_dir().join(folder);
    fs::create_dir_all(&folder).expect("a folder in the target folder");
    let file = |name: &str, text: &str| {
        let path = folder.join(name);
        fs::write(&path, text).expect("a file in the target folder");
        path.to_str().expect("UTF-8").to_owned()
    };
    let smallest = "format = 1\naxes.A.slave = 1\n";
    let mut arguments = vec![file("whole.toml", MACHINE), file("smallest.toml", smallest), "sim:?machine=".to_owned()];
    for (name, replaced, by, said) in [
        ("no-toml.toml", "[axes]", "[axes", ", line 6: "),
        ("newer.toml", "format = 1", "format = 2", ", line 2: format: it is 2, and this version reads up to 1"),
        ("scale.toml", "per = 0.001", "per = 0", ", line 7: axes.X.per: 0 is no scale; write"),
        ("two-on-one.toml", "slave = 4", "slave = 2", ", line 9: axes.Z.slave: axis Größe is on slave 2, too; give"),
        ("link.toml", "sim:?", "sims:?", ", line 3: link: link `sims:?clock=virtual`: unknown scheme"),
    ] {
        assert!(MACHINE.contains(replaced), "{replaced}");
        arguments.extend([file(name, &MACHINE.replacen(replaced, by, 1)), said.to_owned()]);
    }
    arguments
}

mod needs_cxx {
    use super::*;

    /// Axes, conversions, texts, inputs and outputs; wrong files with their lines, wrong arguments, handles that are closed, made
    /// up or those of boards; threads that open, use and close files at once.
    #[test]
    fn a_machine_file_is_read() {
        let arguments = arguments("machine-öl");
        passes("machine", LINK, &arguments.iter().map(|argument| &**argument).collect::<Vec<_>>());
    }
}

mod needs_valgrind {
    use super::*;

    /// No byte is touched that is not the caller's or not initialised, and no memory leaks.
    #[test]
    fn memcheck_finds_nothing() {
        let arguments = arguments("machine-memcheck");
        let arguments: Vec<&str> = arguments.iter().map(|argument| &**argument).collect();
        assert_eq!(support::memcheck(&c_program("machine"), LINK, &arguments), "ok\n");
    }
}

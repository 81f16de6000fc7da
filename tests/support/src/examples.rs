//! The programs of `examples/cpp/`, `examples/c/` and `examples/python/ctypes/`, and the links of their snapshots in
//! `tests/snapshots/`.

use std::process::Command;

use crate::{Ended, library, root, run};

/// Two drives on virtual time.
pub const VIRTUAL: &str = "sim:?slaves=drive*2&clock=virtual";
/// The same with slots of 16 bytes.
pub const VIRTUAL_16: &str = "sim:?slaves=drive*2&clock=virtual&slot=16";
/// Every program of `examples/cpp/`, and the link of its test.
pub const CPP: [(&str, &str); 12] = [
    ("alarm_recovery", VIRTUAL),
    ("habit_read_after_open", VIRTUAL),
    ("habit_reader_writer_threads", VIRTUAL),
    ("habit_sdo_retry", VIRTUAL),
    ("habit_set_axis_burst", VIRTUAL),
    ("habit_tight_writer", VIRTUAL),
    ("habit_two_writes_fifo_mark", VIRTUAL),
    ("homing", VIRTUAL),
    ("hsp_16b", "sim:?slaves=hsp2&clock=virtual&slot=16"),
    ("operator_panel", VIRTUAL),
    ("two_axes_12b", VIRTUAL),
    ("two_axes_16b", VIRTUAL_16),
];
/// Every program of `examples/c/`.
pub const C: [(&str, &str); 2] = [("csv_cst", VIRTUAL), ("io", "sim:?slaves=io&clock=virtual")];
/// The program of `examples/c/` that reads a machine file and opens no board.
pub const C_WITHOUT_BOARD: &str = "machine_axes";
/// The program of `examples/c/` that uses no library, and no board either.
pub const C_WITHOUT_LIBRARY: &str = "xf_client";

/// Programs whose snapshot is made with a script of `examples/scripts/`, and that script.
pub const SCRIPTS: [(&str, &str); 3] =
    [("alarm_recovery", "alarm_on_the_way"), ("io", "local_inputs"), ("operator_panel", "alarm")];

/// Every program of `examples/python/ctypes/` that uses the library.
pub const PYTHON: [(&str, &str); 3] =
    [("homing", VIRTUAL), ("two_axes", VIRTUAL), ("inputs_outputs", "sim:?slaves=io&clock=virtual")];

/// Runs a program of `examples/python/ctypes/` on a link.
pub fn run_python(name: &str, link: &str) -> Ended {
    run(&mut python(name, link))
}

/// A program of `examples/python/ctypes/` on a link.
pub fn python(name: &str, link: &str) -> Command {
    let mut python = Command::new("python3");
    python.arg(root().join("examples/python/ctypes").join(name).with_extension("py"));
    // No compiled files beside the examples.
    python.env("PYTHONDONTWRITEBYTECODE", "1").env("ECMSK_LIBRARY", &library().shared);
    python.env("ECMSK_LINK", link).env_remove("ECMSK_LOG").current_dir(root());
    python
}

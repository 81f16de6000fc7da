//! The bench of the library on a board on USB, `cargo xtask bench --windows`: only the guest has a kernel's USB for it.

use crate::boards::{BOARD, plugged, unplug};
use crate::program::{Program, Width};

crate::for_each_width! {
    /// Its figures are lines of the output.
    #[test]
    #[ignore = "a bench: cargo xtask bench --windows"]
    fn figures(width: Width) {
        let served = plugged(BOARD);
        let name = format!("windows_usb_{}", width.name());
        let figures = Program::start(width, "usb", "usb:", &[&name]).all();
        assert_eq!(figures.len(), 4, "{figures:?}");
        // The name of the test is at the begin of the line.
        println!("\n{}", figures.join("\n"));
        unplug(served);
    }
}

//! Windows programs on a board on USB: the DLL, Wine's HID stack, the USB and HID code of a real kernel, and behind it
//! `ecmsk serve usbip`. They run in a guest system, as root, one at a time: `cargo xtask test --windows`. Every test is
//! in a module of the width of its programs.
#![cfg(target_os = "linux")]

mod boards;
mod program;
mod speed;

/// Makes a test of each function for each width.
macro_rules! for_each_width {
    ($($(#[doc = $doc:literal])* #[test] $(#[ignore = $why:literal])? fn $name:ident($width:ident: Width) $body:block)*) => {
        $(fn $name($width: Width) $body)*

        mod x64 {
            $($(#[doc = $doc])* #[test] $(#[ignore = $why])? fn $name() { super::$name(super::Width::X64) })*
        }
        mod x86 {
            $($(#[doc = $doc])* #[test] $(#[ignore = $why])? fn $name() { super::$name(super::Width::X86) })*
        }
    };
}
use for_each_width;

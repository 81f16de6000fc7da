//! The DLLs for Windows: the contents of the files, linking with them, and programs of both widths that run on them
//! under Wine: `cargo xtask test --windows`, which builds the DLLs and sets Wine up. Every test is in a module of its
//! width.
//!
//! Files:
//!
//! - `fixture.rs`: the DLLs, compilers and Wine that the tests use
//! - `exports.rs`, `linking.rs`: the files: exports, imports, versions; the import libraries
//! - `habits.rs`, `examples.rs`, `dotnet.rs` with `vb.rs`: programs: every exported function, the examples, .NET
//! - `links.rs`, `tool.rs`: the choice of the link, boards in the network; the tool
//! - `unloading.rs`: loading and unloading the DLL
//! - `usb/`: a test program of its own: boards on USB, in a guest
#![cfg(target_os = "linux")]

mod dotnet;
mod examples;
mod exports;
mod fixture;
mod habits;
mod linking;
mod links;
mod tool;
mod unloading;
mod vb;

/// Makes a test of each function for each width. A run has the DLL and the Wine of one width, and skips the other's
/// tests by name.
macro_rules! for_each_width {
    ($($(#[$attribute:meta])* fn $name:ident($width:ident: Width) $body:block)*) => {
        $(fn $name($width: Width) $body)*
        mod x64 {
            $($(#[$attribute])* fn $name() { super::$name(crate::fixture::Width::X64) })*
        }
        mod x86 {
            $($(#[$attribute])* fn $name() { super::$name(crate::fixture::Width::X86) })*
        }
    };
}
use for_each_width;

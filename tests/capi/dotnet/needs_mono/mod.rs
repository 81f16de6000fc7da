//! Under Mono, and what the compiled files themselves show.

mod files;

use crate::dotnet::programs;
use crate::dotnet::runtime::Runtime::Mono;

/// LIB-29, LIB-30, NET-4 The programs of `examples/csharp/` print what those in C++ print.
#[test]
fn examples() {
    programs::examples(Mono);
}

/// NET-4 A program that fails says why, and its axes are off.
#[test]
fn an_end_by_an_alarm() {
    programs::an_end_by_an_alarm(Mono);
}

/// LIB-33 CRC-8 of commands and responses.
#[test]
fn the_crc() {
    programs::the_crc(Mono);
}

/// NET-5, NET-6, NET-7 Wrong arrays, calls while nothing is open, calls of finalisers.
#[test]
fn misuse() {
    programs::misuse(Mono);
}

/// NET-8, NET-12, LIB-48 Programs end without Close, whatever their threads are at.
#[test]
fn endings() {
    programs::endings(Mono);
}

/// NET-9, LIB-4 DllImport by I1 and by BOOL.
#[test]
fn declared() {
    programs::declared(Mono);
}

/// NET-3, NET-6 What is wrong with the configuration is said.
#[test]
fn configuration() {
    programs::configuration(Mono);
}

/// NET-2 Where the library is looked for.
#[test]
fn search() {
    programs::search(Mono);
}

mod needs_cxx {
    use super::*;

    /// LIB-29, LIB-4 A library as the vendor's, whose bool is one byte and which gives no reasons, is as good.
    #[test]
    fn a_library_as_the_vendors() {
        programs::a_library_as_the_vendors(Mono);
    }
}

//! Under Microsoft's .NET Core for Linux, from the same files.

use crate::dotnet::runtime::Runtime::Core;
use crate::dotnet::runtime::dotnet;
use crate::dotnet::{packages, programs};

/// LIB-29, LIB-30, NET-4 The programs of `examples/csharp/` print the same as those in C++.
#[test]
fn examples() {
    programs::examples(Core);
}

/// NET-4 A program that fails prints the reason, and its axes are off.
#[test]
fn an_end_by_an_alarm() {
    programs::an_end_by_an_alarm(Core);
}

/// LIB-33, NET-20, NET-21 CRC-8 of commands and responses: a program writes the CRC of its frames, and checks that of
/// responses.
#[test]
fn the_crc() {
    programs::the_crc(Core);
}

/// LIB-29, NET-14, NET-15, NET-16, NET-17, NET-18, NET-19, NET-24 A program that was compiled against the vendor's assembly and
/// uses each member as its type allows runs on this project's assemblies, of either pair.
#[test]
fn swapped() {
    programs::swapped(Core);
}

/// NET-6 No library: exceptions as of DllImport, and a read that is false.
#[test]
fn no_library() {
    programs::no_library(Core);
}

/// NET-5, NET-6, NET-7, NET-22 Other arrays, calls while nothing is open, calls of finalisers.
#[test]
fn misuse() {
    programs::misuse(Core);
}

/// NET-23 A write during a waiting read.
#[test]
fn together() {
    programs::together(Core);
}

/// NET-8, NET-12, LIB-48 Programs end without Close, whatever their threads are doing.
#[test]
fn endings() {
    programs::endings(Core);
}

/// NET-9, LIB-4 DllImport by I1 and by BOOL.
#[test]
fn declared() {
    programs::declared(Core);
}

/// NET-3, NET-6 Errors of the configuration are reported.
#[test]
fn configuration() {
    programs::configuration(Core);
}

/// NET-2 The search path of the library.
#[test]
fn search() {
    programs::search(Core);
}

/// A program on the package Ecmsk moves axes, and transfers objects beside that.
#[test]
fn moves_on_the_package() {
    packages::moves(Core);
}

/// What goes wrong on the package Ecmsk is an exception with the library's text.
#[test]
fn errors_on_the_package() {
    packages::errors(Core);
}

/// What stops an axis on the package Ecmsk waits for no other call, and no command is lost or left over.
#[test]
fn threads_on_the_package() {
    packages::threads(Core);
}

/// .NET Core finds the package Ecmsk and its library in the folder of packages.
#[test]
fn restored_package() {
    packages::restored(dotnet());
}

mod needs_cxx {
    use super::*;

    /// LIB-32, LIB-33, NET-5, NET-18, NET-20, NET-21, NET-22 The behaviour of the vendor's class, row by row, on this
    /// project's.
    #[test]
    fn behaviour() {
        programs::behaviour(Core);
    }

    /// LIB-29, LIB-4 A library like the vendor's, whose bool is one byte and which has no function for the reason,
    /// works as well.
    #[test]
    fn a_library_as_the_vendors() {
        programs::a_library_as_the_vendors(Core);
    }
}

//! Under Mono, and checks of the compiled files themselves.

mod files;

use crate::dotnet::runtime::Runtime::Mono;
use crate::dotnet::{packages, programs};

/// LIB-29, LIB-30, NET-4 The programs of `examples/csharp/` print the same as those in C++.
#[test]
fn examples() {
    programs::examples(Mono);
}

/// NET-4 A program that fails prints the reason, and its axes are off.
#[test]
fn an_end_by_an_alarm() {
    programs::an_end_by_an_alarm(Mono);
}

/// LIB-33, NET-20, NET-21 CRC-8 of commands and responses: a program writes the CRC of its frames, and checks that of
/// responses.
#[test]
fn the_crc() {
    programs::the_crc(Mono);
}

/// LIB-29, NET-14, NET-15, NET-16, NET-17, NET-18, NET-19, NET-24 A program that was compiled against the vendor's assembly and
/// uses each member as its type allows runs on this project's assemblies, of either pair.
#[test]
fn swapped() {
    programs::swapped(Mono);
}

/// NET-6 No library: exceptions as of DllImport, and a read that is false.
#[test]
fn no_library() {
    programs::no_library(Mono);
}

/// NET-5, NET-6, NET-7, NET-22 Other arrays, calls while nothing is open, calls of finalisers.
#[test]
fn misuse() {
    programs::misuse(Mono);
}

/// NET-23 A write during a waiting read.
#[test]
fn together() {
    programs::together(Mono);
}

/// NET-8, NET-12, LIB-48 Programs end without Close, whatever their threads are doing.
#[test]
fn endings() {
    programs::endings(Mono);
}

/// NET-9, LIB-4 DllImport by I1 and by BOOL.
#[test]
fn declared() {
    programs::declared(Mono);
}

/// NET-3, NET-6 Errors of the configuration are reported.
#[test]
fn configuration() {
    programs::configuration(Mono);
}

/// NET-2 The search path of the library.
#[test]
fn search() {
    programs::search(Mono);
}

/// NET-25 The vendor's own assembly on this library.
#[test]
fn mapped() {
    programs::mapped();
}

mod needs_cxx {
    use super::*;

    /// LIB-32, LIB-33, NET-5, NET-18, NET-20, NET-21, NET-22 The behaviour of the vendor's class, row by row, on this
    /// project's.
    #[test]
    fn behaviour() {
        programs::behaviour(Mono);
    }

    /// NET-5, NET-6, NET-20, NET-21, NET-22 The stand-in for the vendor's assemblies behaves the same.
    #[test]
    fn behaviour_of_the_stand_in() {
        programs::behaviour_of_the_stand_in();
    }

    /// LIB-29, LIB-4 A library like the vendor's, whose bool is one byte and which has no function for the reason,
    /// works as well.
    #[test]
    fn a_library_as_the_vendors() {
        programs::a_library_as_the_vendors(Mono);
    }
}

/// A program on the package Ecmsk moves axes, and transfers objects beside that.
#[test]
fn moves_on_the_package() {
    packages::moves(Mono);
}

/// What goes wrong on the package Ecmsk is an exception with the library's text.
#[test]
fn errors_on_the_package() {
    packages::errors(Mono);
}

/// What stops an axis on the package Ecmsk waits for no other call, and no command is lost or left over.
#[test]
fn threads_on_the_package() {
    packages::threads(Mono);
}

/// The program on the front page of the package Ecmsk runs.
#[test]
fn the_front_page_of_the_package() {
    packages::front_page(Mono);
}

/// The NuGet packages have what NuGet looks for.
#[test]
fn contents_of_the_packages() {
    packages::contents();
}

/// The public members of the package Ecmsk are those of the list.
#[test]
fn members_of_the_package() {
    packages::members();
}

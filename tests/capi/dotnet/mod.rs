//! NEXTWUSB_dotNET, the assemblies for programs in .NET languages, the package Ecmsk, and programs on them: compiled once, by
//! `cargo xtask dotnet`, and run by Mono and by .NET Core on a simulated board.
#![cfg(target_os = "linux")]

mod needs_dotnet_core;
mod needs_mono;
mod packages;
mod programs;
mod runtime;

//! The C ABI: programs in C, C++, Python and .NET on the library of this build, and the files shipped with it.
//!
//! Files:
//!
//! - `behaviour.rs`: every exported function, called from C (`tests/c/`)
//! - `machine_file.rs`: machine files, from C
//! - `headers.rs`, `symbols.rs`, `surface.rs`: the headers, the exports of the library, and the stability of both
//! - `prefix.rs`: the library, its headers and the tool as they are installed, and commands of pages with them
//! - `ci_page.rs`: docs/CI.md and the workflow files of `share/ci/`
//! - `cpp_examples.rs`, `cpp_guide.rs`, `python_examples.rs`, `dotnet/`: the examples in C, C++, Python and .NET
//! - `set_user_id.rs`, `vanish.rs`: programs with more rights than their user; programs that end without closing the
//!   board
//! - `log.rs`: the log, whose reader may have stalled
//! - `dist_config.rs`: the `ecmsk.toml` that is shipped with the DLLs

mod behaviour;
mod ci_page;
mod cpp_examples;
mod cpp_guide;
mod dist_config;
mod dotnet;
mod headers;
mod log;
mod machine_file;
mod prefix;
mod python_examples;
mod set_user_id;
mod surface;
mod symbols;
mod vanish;

//! The library that `ecmsk exec --clock virtual` preloads (LD_PRELOAD). It replaces the functions of the C library by
//! which a program waits and reads clocks, and lets them follow the virtual clock of the simulated board.
//!
//! | file | what it holds |
//! | --- | --- |
//! | `clock.rs` | the virtual clock, and the clocks of the program that are derived from it |
//! | `threads.rs`, `advance.rs` | the threads of the program: which run, which wait and for what; when time goes on |
//! | `task.rs` | whether a thread is blocked in the kernel, from `/proc` |
//! | `signals.rs` | when signal handlers may run |
//! | `mode.rs` | whose call it is: the program's, the board's library's, or this library's own |
//! | `boards.rs`, `table.rs` | the connection to NEXTWUSBLib, whose boards keep the time; `table.rs` is compiled there, too |
//! | `counts.rs` | what `ecmsk exec` reports at the end |
//! | `system.rs` | the functions of the C library behind these here |
//! | `exports/` | the functions that the program calls |
//!
//! Virtual time advances only when every thread of the program waits, and then to the earliest deadline of a wait
//! (docs/decisions/sleeping-programs-are-preloaded.md).
#![cfg(all(target_os = "linux", target_env = "gnu"))]

mod advance;
mod boards;
mod clock;
mod counts;
mod exports;
mod mode;
mod signals;
mod system;
mod table;
mod task;
mod threads;

/// The loader calls this before the program's main.
#[used]
#[unsafe(link_section = ".init_array")]
static AT_START: extern "C" fn() = at_start;

extern "C" fn at_start() {
    let _own = mode::Own::begin();
    clock::begin();
    counts::open();
    // Makes the table of threads now, because a signal handler may be the first that uses it, and must not allocate.
    drop(threads::lock());
    // SAFETY: the functions replace pointers and allocate, which a child of fork may do with the GNU C library. Without
    // memory for the registration a child of fork waits for threads that it does not have, at the pace of the real clock.
    unsafe { libc::pthread_atfork(Some(threads::before_fork), None, Some(threads::begin_anew)) };
}

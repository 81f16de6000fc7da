//! Loading and unloading: repeatedly, at another base, while a board is open, and the end of a process.

use crate::fixture::{Folder, Toolchain, Width, source};

const VIRTUAL: &str = "sim:?slaves=drive&clock=virtual";
/// With a thread of the library.
const REAL: &str = "sim:?slaves=drive&clock=real";
/// More rounds than a process has TLS indexes, so that a lost one per round would fail.
const ROUNDS: &str = "1200";
/// Fewer, since starting and ending threads takes longer.
const ROUNDS_WITH_THREADS: &str = "100";

/// A folder of a test's own with the DLL and a program.
fn with_program(width: Width, test: &str, name: &str) -> (Folder, String) {
    let folder = Folder::with_dll(width, &format!("unloading-{test}"));
    let program = format!("{name}.exe");
    folder.build(Toolchain::MinGw, &source(name).with_extension("c"), &program);
    (folder, program)
}

/// The program counts the remaining threads, handles and TLS indexes itself.
fn cycles((folder, program): &(Folder, String), arguments: &[&str], link: &str) {
    let ended = folder.run(program, link, arguments);
    assert_eq!(ended.stderr, "", "{arguments:?} on {link}");
    let said = crate::fixture::lines(&ended.success());
    assert_eq!(said, "threads +0, handles +0, TLS indexes +0\nok\n", "{arguments:?} on {link}");
}

crate::for_each_width! {
    /// WIN-9 Loaded, opened, closed and unloaded repeatedly, the DLL leaves no thread, handle or TLS index behind.
    #[test]
    fn nothing_is_left_after_unloading(width: Width) {
        let program = with_program(width, "again", "cycles");
        cycles(&program, &[ROUNDS], VIRTUAL);
        cycles(&program, &[ROUNDS_WITH_THREADS], REAL);
        cycles(&program, &[ROUNDS_WITH_THREADS], &format!("{REAL}&record=cycles.pcapng"));
    }

    /// WIN-9 The same for a board of ecmsk_open.
    #[test]
    fn nothing_is_left_of_boards_by_uri(width: Width) {
        cycles(&with_program(width, "uri", "cycles"), &[ROUNDS_WITH_THREADS, "uri"], REAL);
    }

    /// WIN-11 While a board is open FreeLibrary does not unload the DLL; Close does then, called by its address alone.
    #[test]
    fn the_dll_stays_while_a_board_is_open(width: Width) {
        let (folder, program) = with_program(width, "stays", "pinned");
        for link in [VIRTUAL, REAL] {
            folder.passes(&program, link, &["alone"]);
            folder.passes(&program, link, &["uri"]);
        }
    }

    /// LIB-48, WIN-11 FreeLibrary and Close during a blocked read: the read returns false, with the reason for a caller
    /// that still has the DLL loaded; then the DLL is unloaded.
    #[test]
    fn unloaded_during_a_read(width: Width) {
        let (folder, program) = with_program(width, "read", "pinned");
        folder.passes(&program, REAL, &["read"]);
        folder.passes(&program, REAL, &["close"]);
    }

    /// WIN-14 The DLL works at any base address.
    #[test]
    fn loaded_at_another_base(width: Width) {
        let (folder, program) = with_program(width, "moved", "moved");
        let base = format!("{:x}", crate::exports::base(width));
        for link in [VIRTUAL, REAL] {
            folder.passes(&program, link, &[&base]);
        }
    }

    /// LIB-41, WIN-12 A program may end without Close, whatever its threads are doing.
    #[test]
    fn programs_may_end_without_close(width: Width) {
        let (folder, program) = with_program(width, "ends", "ends");
        for how in ["return", "exit", "process", "unload"] {
            folder.passes(&program, REAL, &[how]);
            let recorded = format!("{REAL}&record=ends-{how}.pcapng");
            let ended = support::run(folder.command(&program, &recorded).arg(how));
            assert_eq!((ended.status.code(), ended.stderr.as_str()), (Some(0), ""), "{how} while recording");
        }
    }
}

//! Loading and unloading: again and again, at another place, while a board is open, and the end of a process.

use crate::fixture::{Folder, Toolchain, Width, source};

const VIRTUAL: &str = "sim:?slaves=drive&clock=virtual";
/// With a thread of the library's.
const REAL: &str = "sim:?slaves=drive&clock=real";
/// More rounds than a process has TLS indexes, so that none may be lost in each.
const ROUNDS: &str = "1200";
/// With threads to start and to end it takes longer.
const ROUNDS_WITH_THREADS: &str = "100";

/// A folder of a test's own with the DLL and a program.
fn with_program(width: Width, test: &str, name: &str) -> (Folder, String) {
    let folder = Folder::with_dll(width, &format!("unloading-{test}"));
    let program = format!("{name}.exe");
    folder.build(Toolchain::MinGw, &source(name).with_extension("c"), &program);
    (folder, program)
}

/// The program's own count of what is left.
fn cycles((folder, program): &(Folder, String), arguments: &[&str], link: &str) {
    let ended = folder.run(program, link, arguments);
    assert_eq!(ended.stderr, "", "{arguments:?} on {link}");
    let said = crate::fixture::lines(&ended.success());
    assert_eq!(said, "threads +0, handles +0, TLS indexes +0\nok\n", "{arguments:?} on {link}");
}

crate::for_each_width! {
    /// WIN-9 Loaded, opened, closed and unloaded again and again, the DLL leaves no thread, handle or TLS index behind.
    #[test]
    fn nothing_is_left_after_unloading(width: Width) {
        let program = with_program(width, "again", "cycles");
        cycles(&program, &[ROUNDS], VIRTUAL);
        cycles(&program, &[ROUNDS_WITH_THREADS], REAL);
        cycles(&program, &[ROUNDS_WITH_THREADS], &format!("{REAL}&record=cycles.pcapng"));
    }

    /// WIN-9 A board of ecmsk_open is no other.
    #[test]
    fn nothing_is_left_of_boards_by_uri(width: Width) {
        cycles(&with_program(width, "uri", "cycles"), &[ROUNDS_WITH_THREADS, "uri"], REAL);
    }

    /// WIN-11 While a board is open FreeLibrary does not take the DLL away; Close does then, called by its address alone.
    #[test]
    fn the_dll_stays_while_a_board_is_open(width: Width) {
        let (folder, program) = with_program(width, "stays", "pinned");
        for link in [VIRTUAL, REAL] {
            folder.passes(&program, link, &["alone"]);
            folder.passes(&program, link, &["uri"]);
        }
    }

    /// LIB-48, WIN-11 FreeLibrary and Close during a blocked read: the read is false, and says why to who has the
    /// DLL still; then the DLL goes.
    #[test]
    fn unloaded_during_a_read(width: Width) {
        let (folder, program) = with_program(width, "read", "pinned");
        folder.passes(&program, REAL, &["read"]);
        folder.passes(&program, REAL, &["close"]);
    }

    /// WIN-14 The DLL works wherever Windows puts it.
    #[test]
    fn loaded_at_another_base(width: Width) {
        let (folder, program) = with_program(width, "moved", "moved");
        let base = format!("{:x}", crate::exports::base(width));
        for link in [VIRTUAL, REAL] {
            folder.passes(&program, link, &[&base]);
        }
    }

    /// LIB-41, WIN-12 A program may end without Close, whatever its threads are at.
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

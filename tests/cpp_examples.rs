//! The programs of `examples/cpp/`, built with their own Makefile and pkg-config as a user would, run on a simulated
//! board. On virtual time they print what `tests/snapshots/` holds, to the byte.
#![cfg(target_os = "linux")]

mod support;

use std::fs;
use std::os::unix::fs::symlink;
use std::path::PathBuf;
use std::process::Command;
use std::sync::OnceLock;

use support::{Program, out_dir, root};

/// Two drives on virtual time.
const VIRTUAL: &str = "sim:?slaves=drive*2&clock=virtual";
/// The same with slots of 16 bytes.
const VIRTUAL_16: &str = "sim:?slaves=drive*2&clock=virtual&slot=16";
/// Two drives on the real clock.
const REAL: &str = "sim:?slaves=drive*2&clock=real";

/// Every program, and the link that it is tested on.
const PROGRAMS: [(&str, &str); 8] = [
    ("habit_read_after_open", VIRTUAL),
    ("habit_reader_writer_threads", VIRTUAL),
    ("habit_sdo_retry", VIRTUAL),
    ("habit_set_axis_burst", VIRTUAL),
    ("habit_tight_writer", VIRTUAL),
    ("habit_two_writes_fifo_mark", VIRTUAL),
    ("two_axes_12b", VIRTUAL),
    ("two_axes_16b", VIRTUAL_16),
];

/// Builds all programs with `make` and the pkg-config file, and gives the folder they are in.
fn built() -> &'static PathBuf {
    static BUILT: OnceLock<PathBuf> = OnceLock::new();
    BUILT.get_or_init(|| {
        let prefix = out_dir().join("prefix");
        let _ = fs::remove_dir_all(&prefix);
        fs::create_dir_all(&prefix).expect("a folder in the target folder");
        symlink(&support::library().dir, prefix.join("lib")).expect("a symbolic link");
        symlink(support::include_dir(), prefix.join("include")).expect("a symbolic link");
        let template = fs::read_to_string(root().join("capi/nextwusblib.pc.in")).expect("capi/nextwusblib.pc.in");
        let file = template
            .replace("@PREFIX@", prefix.to_str().expect("UTF-8"))
            .replace("@VERSION@", env!("CARGO_PKG_VERSION"))
            .replace("@PRIVATE_LIBS@", "");
        fs::write(prefix.join("nextwusblib.pc"), file).expect("a file in the target folder");

        let out = out_dir().join("programs");
        let _ = fs::remove_dir_all(&out);
        let mut make = Command::new("make");
        make.arg("-C").arg(root().join("examples/cpp")).arg(format!("OUT={}", out.display()));
        make.arg("CXXFLAGS=-std=c++17 -O1 -g -Wall -Wextra -pedantic -Werror").env("PKG_CONFIG_PATH", &prefix);
        support::succeed(&mut make);
        out
    })
}

fn program(name: &str) -> Program {
    Program { exe: built().join(name) }
}

/// Runs a program; it must print what its snapshot holds, and nothing to standard error.
fn prints_its_snapshot(name: &str, link: &str) {
    let ended = program(name).run(link, [""; 0]);
    assert_eq!(ended.stderr, "", "{name} on {link}");
    support::snapshot(name, &ended.success());
}

mod needs_cxx {
    use super::*;

    /// LIB-25 Start-up, SDOs, servo on and off by the statusword, two axes on a path by CSP, shut-down: on 12-byte slots, on
    /// both firmwares.
    #[test]
    fn two_axes_on_a_square() {
        prints_its_snapshot("two_axes_12b", VIRTUAL);
        prints_its_snapshot("two_axes_12b", &format!("{VIRTUAL}&fw=1.5"));
    }

    /// LIB-25, LIB-8 The same on 16-byte slots.
    #[test]
    fn two_axes_on_a_circle() {
        prints_its_snapshot("two_axes_16b", VIRTUAL_16);
    }

    /// LIB-20 One read right after Open, before any write; LIB-9 with the header of the guides' samples.
    #[test]
    fn a_read_right_after_open() {
        prints_its_snapshot("habit_read_after_open", VIRTUAL);
        prints_its_snapshot("habit_read_after_open", REAL);
    }

    /// LIB-21 Five SET_AXIS writes 2 ms apart, SET_DC, DRIVE_MODE, none followed by a read; then a loop until the state is there.
    #[test]
    fn a_burst_of_set_axis() {
        prints_its_snapshot("habit_set_axis_burst", VIRTUAL);
    }

    /// LIB-22 Two writes, then reads until the FIFO has room, from a thread of its own: nothing is lost.
    #[test]
    fn two_writes_and_reads_to_the_fifo_mark() {
        prints_its_snapshot("habit_two_writes_fifo_mark", VIRTUAL);
    }

    /// LIB-23 A tight writer without reads fills the FIFO, as on the board, and every lost frame is counted.
    #[test]
    fn a_tight_writer_without_reads() {
        prints_its_snapshot("habit_tight_writer", VIRTUAL);
    }

    /// LIB-24 An SDO request once, then zero frames and reads until the answer matches; again after 800 tries.
    #[test]
    fn sdo_requests_with_retries() {
        prints_its_snapshot("habit_sdo_retry", VIRTUAL);
    }

    /// LIB-26 One thread reads while another one writes: nothing is lost.
    #[test]
    fn a_reader_and_a_writer_thread() {
        prints_its_snapshot("habit_reader_writer_threads", VIRTUAL);
        prints_its_snapshot("habit_reader_writer_threads", REAL);
    }

    /// LIB-22, LIB-25 On the real clock the path takes its time, and nothing is lost either.
    #[test]
    fn two_axes_on_the_real_clock() {
        let said = program("two_axes_12b").run(REAL, [""; 0]).success();
        assert!(said.contains("\ncommands lost: 0\n"), "{said}");
        assert!(said.ends_with("servos off, PreOP, closed\n"), "{said}");
    }

    /// LIB-19 The programs are C++98, those with threads C++11; no warning in any standard.
    #[test]
    fn programs_compile_in_old_and_new_standards() {
        for (name, _) in PROGRAMS {
            let source = root().join("examples/cpp").join(name).with_extension("cpp");
            let text = fs::read_to_string(&source).expect("the program");
            let oldest = if text.contains("#include <thread>") { "c++11" } else { "c++98" };
            for standard in [oldest, "c++20"] {
                let mut compiler = support::Language::Cpp(standard).compiler();
                support::succeed(compiler.arg("-fsyntax-only").arg(&source));
            }
        }
    }

    /// LIB-20 Every program of the folder is one of these.
    #[test]
    fn no_program_is_left_out() {
        let entries = fs::read_dir(root().join("examples/cpp")).expect("the folder");
        let files = entries.map(|entry| entry.expect("readable").path());
        let mut names: Vec<String> = files
            .filter(|file| file.extension().is_some_and(|extension| extension == "cpp"))
            .map(|file| file.file_stem().expect("a name").to_string_lossy().into_owned())
            .collect();
        names.sort();
        assert_eq!(names, PROGRAMS.map(|(name, _)| name));
    }
}

mod needs_valgrind {
    use super::*;

    /// LIB-20, LIB-21, LIB-22, LIB-23, LIB-24, LIB-25, LIB-26 Under memcheck every program prints the same, and memcheck finds nothing.
    #[test]
    fn memcheck_finds_nothing() {
        for (name, link) in PROGRAMS {
            support::snapshot(name, &support::memcheck(&program(name), link, &[]));
        }
    }
}

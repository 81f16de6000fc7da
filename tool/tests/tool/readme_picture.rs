//! The pictures of README and of a board beside one with a chip are what the demo draws.
#![cfg(target_os = "linux")]

mod needs_cxx {
    use std::os::unix::fs::symlink;
    use std::path::Path;

    use support::examples::VIRTUAL;
    use support::{Language, root};
    use tempfile::TempDir;

    use crate::common::ecmsk;

    /// Records the program of README's picture as the demo runs it, in virtual time, on a board with the link `link`.
    fn record(folder: &Path, link: &str, script: &str, recording: &str) {
        let link = format!("{link}&script=examples/scripts/{script}.ecmscript&record={recording}");
        let program = support::compile(&root().join("examples/cpp/alarm_recovery.cpp"), Language::Cpp("c++17"));
        support::succeed(program.command(&link).current_dir(folder));
    }

    fn folder() -> TempDir {
        let folder = tempfile::tempdir().expect("a folder");
        symlink(root().join("examples"), folder.path().join("examples")).expect("a symbolic link");
        folder
    }

    fn plot(folder: &Path, arguments: &[&str]) -> String {
        support::succeed(ecmsk([&["plot"], arguments, &["-o", "-"]].concat()).current_dir(folder))
    }

    /// The picture of README is what the tool draws of a recording that the demo's program makes, in virtual time.
    #[test]
    fn the_picture_of_readme_is_what_the_demo_draws() {
        let folder = folder();
        record(folder.path(), VIRTUAL, "alarm_on_the_way", "two_axes.pcapng");
        support::kept(&root().join("docs/two_axes.svg"), &plot(folder.path(), &["two_axes.pcapng"]));
    }

    /// XF-19.1 The picture of two boards is what the tool draws of the program on a board and, beside it, on a board behind an
    /// ECM-XF, with the beginnings of OP aligned.
    #[test]
    fn the_picture_of_both_boards_is_what_the_demo_draws() {
        let folder = folder();
        record(folder.path(), VIRTUAL, "alarm_on_the_way", "two_axes.pcapng");
        let behind = VIRTUAL.replace("sim:", "xf-sim:");
        record(folder.path(), &behind, "alarm_on_the_way_behind_chip", "behind_chip.pcapng");
        let picture = plot(folder.path(), &["two_axes.pcapng", "--beside", "behind_chip.pcapng"]);
        assert!(picture.contains("actual, xf-sim:"), "{picture}");
        support::kept(&root().join("docs/both_boards.svg"), &picture);
    }
}

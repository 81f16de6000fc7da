//! The picture of README.
#![cfg(target_os = "linux")]

mod needs_cxx {
    use std::os::unix::fs::symlink;

    use support::examples::VIRTUAL;
    use support::{Language, root};

    use crate::common::ecmsk;

    /// The picture of README is a recording of that program as the demo makes it, on virtual time, drawn by the tool.
    #[test]
    fn the_picture_of_readme_is_what_the_demo_draws() {
        let folder = tempfile::tempdir().expect("a folder");
        symlink(root().join("examples"), folder.path().join("examples")).expect("a symbolic link");
        let link = format!("{VIRTUAL}&script=examples/scripts/alarm_on_the_way.ecmscript&record=two_axes.pcapng");
        let program = support::compile(&root().join("examples/cpp/alarm_recovery.cpp"), Language::Cpp("c++17"));
        support::succeed(program.command(&link).current_dir(folder.path()));
        let mut plot = ecmsk(["plot", "two_axes.pcapng", "-o", "-"]);
        let picture = support::succeed(plot.current_dir(folder.path()));
        support::kept(&root().join("docs/two_axes.svg"), &picture);
    }
}

//! The programs of `examples/cpp/` and `examples/c/`, unchanged: on virtual time their output under Wine equals that on
//! Linux, to the byte.

use crate::fixture::{Folder, Toolchain, Width, lines};
use support::examples::{C, CPP, SCRIPTS};
use support::{root, snapshot};

/// Builds a program of either folder and runs it on the link of its snapshot.
fn prints_its_snapshot(folder: &Folder, toolchain: Toolchain, language: &str, name: &str, link: &str) {
    let source = root().join("examples").join(language).join(name).with_extension(language);
    let program = format!("{name}.exe");
    folder.build(toolchain, &source, &program);
    let link = match SCRIPTS.into_iter().find(|(program, _)| *program == name) {
        None => link.to_owned(),
        Some((_, script)) => {
            let file = format!("{script}.ecmscript");
            let from = root().join("examples/scripts").join(&file);
            std::fs::copy(from, folder.path().join(&file)).expect("the script");
            format!("{link}&script={file}")
        }
    };
    let ended = folder.run(&program, &link, [""; 0]);
    assert_eq!(ended.stderr, "", "{name} by {toolchain:?} on {link}");
    snapshot(name, &lines(&ended.success()));
}

fn all_print_their_snapshots(width: Width, toolchain: Toolchain) {
    let folder = Folder::with_dll(width, &format!("examples-{toolchain:?}").to_lowercase());
    for (language, programs) in [("cpp", &CPP[..]), ("c", &C[..])] {
        for (name, link) in programs {
            prints_its_snapshot(&folder, toolchain, language, name, link);
        }
    }
}

crate::for_each_width! {
    /// LIB-20, LIB-21, LIB-22, LIB-23, LIB-24, LIB-25, LIB-26, WIN-10 Programs built with MinGW.
    #[test]
    fn programs_by_mingw(width: Width) {
        all_print_their_snapshots(width, Toolchain::MinGw);
    }

    /// LIB-20, LIB-21, LIB-22, LIB-23, LIB-24, LIB-25, LIB-26, WIN-10 Programs with Microsoft's conventions.
    #[test]
    fn programs_with_microsofts_conventions(width: Width) {
        all_print_their_snapshots(width, Toolchain::Msvc);
    }
}

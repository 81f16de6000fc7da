//! The package for Windows: the DLLs, their import libraries, the .NET assemblies, the tool, and instructions for
//! replacing a DLL.

use std::fs;
use std::path::Path;

use super::release::Release;
use super::tree::{PROGRAM, Tree};
use crate::dotnet::Compiled;
use crate::error::Error;
use crate::project::Project;
use crate::windows::{DLL, MINGW, MSVC, Width};

/// The files that exist for each width (x86, x64): the file name in the stage folder of `cargo xtask windows`, and the
/// folder in the package, where `@` stands for the width.
const OF_A_WIDTH: [(&str, &str); 3] = [(DLL, "@"), (MSVC, "lib/@"), (MINGW, "lib/@")];

/// The programs in the stage folder, with the same paths in the package.
pub const PROGRAMS: &[&str] = &["x86/ecmsk.exe", "x64/ecmsk.exe"];

/// The text files, by source and path in the package. They get the line ends of Windows.
const TEXTS: [(&str, &str); 5] = [
    ("share/windows/README.txt", "README.txt"),
    ("share/windows/ecmsk.toml", "ecmsk.toml"),
    ("share/wireshark/ecmsk.lua", "wireshark/ecmsk.lua"),
    ("LICENSE-MIT", "LICENSE-MIT.txt"),
    ("LICENSE-APACHE", "LICENSE-APACHE.txt"),
];

/// The file in the package with the licences of other projects.
pub const OTHERS: &str = "THIRD-PARTY-LICENSES.txt";

/// Fills the tree from the stage folder of `cargo xtask windows` and the assemblies of `cargo xtask dotnet`.
pub fn fill(
    project: &Project,
    release: &Release,
    tree: &Tree,
    stage: &Path,
    assemblies: &Compiled,
    others: &str,
) -> Result<(), Error> {
    for width in Width::ALL.map(Width::name) {
        for (file, folder) in OF_A_WIDTH {
            let to = format!("{}/{file}", folder.replace('@', width));
            tree.copy(&stage.join(width).join(file), &to, super::tree::DATA)?;
        }
    }
    for program in PROGRAMS {
        tree.copy(&stage.join(program), program, PROGRAM)?;
    }
    tree.copy_all(&stage.join("include"), "include", &[".h"])?;
    // Each width's folder has the assemblies beside the DLL, as in the vendor's package. The folder `dotnet` has them again
    // with their documentation, for programs that run with any width.
    for (from, to, ends) in [
        (&assemblies.assemblies, Width::X86.name(), &[".dll"][..]),
        (&assemblies.assemblies_x64, Width::X64.name(), &[".dll"][..]),
        (&assemblies.assemblies, "dotnet", &[".dll", ".xml"][..]),
    ] {
        tree.copy_all(from, to, ends)?;
    }
    for (from, to) in TEXTS {
        let from = project.root.join(from);
        let text = fs::read_to_string(&from).map_err(Error::file("read", &from))?;
        tree.write(to, for_windows(&text.replace("@VERSION@", release.version)))?;
    }
    tree.write(OTHERS, for_windows(others))
}

/// The text with the line ends of Windows.
fn for_windows(text: &str) -> String {
    text.replace("\r\n", "\n").replace('\n', "\r\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_end_once() {
        assert_eq!(for_windows("a\nb\r\nc\n"), "a\r\nb\r\nc\r\n");
    }
}

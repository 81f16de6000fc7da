//! The runtimes that run compiled programs.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use support::dotnet::{compile_into, example, test_program};
use support::{self, Ended, Program, out_dir};

/// A runtime of .NET.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Runtime {
    /// Mono, of Debian.
    Mono,
    /// .NET Core 3.1, Microsoft's.
    Core,
}

/// .NET Core's program.
pub fn dotnet() -> &'static Path {
    static DOTNET: OnceLock<PathBuf> = OnceLock::new();
    DOTNET.get_or_init(|| {
        let (_, said) = compile_into(&out_dir().join("with-runtime"), &["--runtime"]);
        let line = said.lines().find_map(|line| line.strip_prefix("dotnet:")).expect("it says where");
        PathBuf::from(line.trim())
    })
}

impl Runtime {
    /// The program with the link in `ECMSK_LINK` and the library of this build.
    pub fn command(self, program: &Program, link: &str) -> Command {
        match self {
            Self::Mono => program.under("mono", &[], link),
            Self::Core => {
                let config = program.exe.with_file_name("core.json");
                let config = config.to_str().expect("UTF-8");
                program.under(dotnet().to_str().expect("UTF-8"), &["exec", "--runtimeconfig", config], link)
            }
        }
    }

    /// Runs it to its end.
    pub fn run(self, program: &Program, link: &str, arguments: &[&str]) -> Ended {
        support::run(self.command(program, link).args(arguments))
    }

    /// Runs a program that checks itself and prints `ok`.
    pub fn passes(self, name: &str, link: &str) {
        let ended = self.run(&test_program(name, "NEXTWUSB_dotNET"), link, &[]);
        assert_eq!(ended.stderr, "", "{name} on {link} by {self:?}");
        assert_eq!(ended.success(), "ok\n", "{name} on {link} by {self:?}");
    }

    /// Runs an example; it must print the snapshot, and nothing to standard error.
    pub fn prints(self, name: &str, snapshot: &str, link: &str) {
        let ended = self.run(&example(name), link, &[]);
        assert_eq!(ended.stderr, "", "{name} on {link} by {self:?}");
        support::snapshot(snapshot, &ended.success());
    }
}

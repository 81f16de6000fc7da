//! Makes the version resources of DLLs and programs, which Windows shows under Properties, Details.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::Width;
use crate::command;
use crate::error::Error;

const VERSION: &str = env!("CARGO_PKG_VERSION");
/// The version as four numbers, by which Windows compares files: that of the crate, then 0.
const NUMBERS: &str = concat!(
    env!("CARGO_PKG_VERSION_MAJOR"),
    ",",
    env!("CARGO_PKG_VERSION_MINOR"),
    ",",
    env!("CARGO_PKG_VERSION_PATCH"),
    ",0"
);

/// The texts in the version resource of a program or DLL.
pub struct File {
    pub name: &'static str,
    pub description: &'static str,
    pub kind: Kind,
}

#[derive(Clone, Copy)]
pub enum Kind {
    Program,
    Library,
}

impl File {
    /// Compiles the version resource into an object file in `folder`, which the linker adds to the program or DLL.
    pub fn object(&self, width: Width, folder: &Path) -> Result<PathBuf, Error> {
        fs::create_dir_all(folder).map_err(Error::file("make", folder))?;
        let source = folder.join(self.name).with_extension("rc");
        fs::write(&source, self.resource()).map_err(Error::file("write", &source))?;
        let object = source.with_extension("o");
        command::run(Command::new(format!("{}-windres", width.mingw())).arg(&source).arg(&object))?;
        Ok(object)
    }

    /// The source text of the resource for windres. 0x40004 means 32-bit and 64-bit Windows, 0x0409 American English, 0x04B0
    /// UTF-16.
    fn resource(&self) -> String {
        let Self { name, description, kind } = self;
        let kind = match kind {
            Kind::Program => 1,
            Kind::Library => 2,
        };
        let internal = Path::new(name).file_stem().unwrap_or_default().display();
        format!(
            r#"1 VERSIONINFO
FILEVERSION {NUMBERS}
PRODUCTVERSION {NUMBERS}
FILEOS 0x40004
FILETYPE {kind}
BEGIN
  BLOCK "StringFileInfo"
  BEGIN
    BLOCK "040904B0"
    BEGIN
      VALUE "CompanyName", "ecmsk"
      VALUE "FileDescription", "{description}"
      VALUE "FileVersion", "{VERSION}"
      VALUE "InternalName", "{internal}"
      VALUE "LegalCopyright", "MIT OR Apache-2.0"
      VALUE "OriginalFilename", "{name}"
      VALUE "ProductName", "ecmsk"
      VALUE "ProductVersion", "{VERSION}"
    END
  END
  BLOCK "VarFileInfo"
  BEGIN
    VALUE "Translation", 0x0409, 0x04B0
  END
END
"#
        )
    }
}

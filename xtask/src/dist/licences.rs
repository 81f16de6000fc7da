//! Collects the licences of all shipped crates in one text file.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;

use super::crates::Crate;
use super::tree;
use crate::error::Error;

/// The prefixes by which licence files in a crate are found, in lower case.
const BEGINNINGS: [&str; 5] = ["license", "licence", "copying", "copyright", "notice"];

/// The licences of code that is no crate: Rust's standard library, which is part of every binary, and MinGW's runtime
/// libraries, which are part of those for Windows.
const STANDARD_LIBRARY: &str = "The Rust standard library: MIT OR Apache-2.0, Copyright (c) The Rust Project Contributors.\n\
    DLLs and programs for Windows: start-up code and import libraries of mingw-w64, mostly in the public domain, and libgcc, \
    GPL-3.0-or-later WITH GCC-exception-3.1, which lets programs of any licence use it.\n";

/// The licence of the font in the tool.
const FONT: &str = include_str!("../../../tool/font/LICENSE.txt");

/// The licence of the library that draws curves in the tool's page.
const PLOT_LIBRARY: &str = include_str!("../../../tool/web/vendor/uPlot-LICENSE.txt");

/// The text of `THIRD-PARTY-LICENSES.txt`: first each crate with its licence, then each licence text once with the crates
/// that contain it.
pub fn text(crates: &[Crate]) -> Result<String, Error> {
    let foreign: Vec<&Crate> = crates.iter().filter(|known| known.checksum.is_some()).collect();
    let mut text = String::from("Parts of ecmsk by others, and their licences.\n\n");
    for part in &foreign {
        // Writing to a String does not fail.
        let _ = writeln!(text, "{} {}: {}", part.name, part.version, part.licence);
    }
    let _ = write!(text, "\n{STANDARD_LIBRARY}");
    let _ = write!(text, "\n{}\n{FONT}", "=".repeat(80));
    let _ = write!(text, "\n{}\nuPlot, in the tool's page\n\n{PLOT_LIBRARY}", "=".repeat(80));

    let mut texts: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for part in &foreign {
        let top = fs::read_dir(&part.folder).map_err(Error::file("list", &part.folder))?;
        let mut names: Vec<_> = top.flatten().map(|entry| entry.file_name()).collect();
        // Some crates have a folder of licences.
        for folder in names.clone().iter().filter(|name| part.folder.join(name).is_dir()) {
            if is_licence(&folder.to_string_lossy()) {
                let inside = tree::files(&part.folder.join(folder))?;
                names.extend(inside.iter().map(|file| part.folder.join(folder).join(file).into_os_string()));
            }
        }
        names.sort();
        for name in names {
            let file = part.folder.join(&name);
            let base = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let inside = file.parent() != Some(part.folder.as_path());
            if file.is_file() && (inside || is_licence(&base)) {
                let bytes = fs::read(&file).map_err(Error::file("read", &file))?;
                let licence = String::from_utf8_lossy(&bytes).replace("\r\n", "\n").trim_end().to_owned();
                texts.entry(licence).or_default().push(format!("{} {} ({base})", part.name, part.version));
            }
        }
    }
    let mut texts: Vec<(Vec<String>, String)> = texts.into_iter().map(|(text, whose)| (whose, text)).collect();
    texts.sort();
    for (whose, licence) in texts {
        let _ = write!(text, "\n{}\n{}\n\n{licence}\n", "=".repeat(80), whose.join("\n"));
    }
    Ok(text)
}

fn is_licence(name: &str) -> bool {
    let name = name.to_lowercase();
    BEGINNINGS.iter().any(|begin| name.starts_with(begin)) && !name.ends_with(".rs")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn crate_in(folder: &Path, name: &str) -> Crate {
        Crate {
            name: name.to_owned(),
            version: "1.0.0".to_owned(),
            licence: "MIT".to_owned(),
            repository: String::new(),
            checksum: Some("00".to_owned()),
            folder: folder.join(name),
        }
    }

    /// A licence text that several crates contain is in the file once, with all their names. Crates of this project are
    /// left out, since the file is about those of others.
    #[test]
    fn texts_stand_there_once() {
        let folder = tempfile::tempdir().unwrap();
        for (file, text) in [
            ("a/LICENSE-MIT", "Permission\r\nis granted\r\n"),
            ("a/src.rs", "let none = 0;"),
            ("b/license.txt", "Permission\nis granted\n"),
            ("b/LICENSES/ring", "Another text"),
            ("own/LICENSE", "Mine"),
        ] {
            fs::create_dir_all(folder.path().join(file).parent().unwrap()).unwrap();
            fs::write(folder.path().join(file), text).unwrap();
        }
        let own = Crate { checksum: None, ..crate_in(folder.path(), "own") };
        let text = text(&[crate_in(folder.path(), "a"), crate_in(folder.path(), "b"), own]).unwrap();
        assert!(text.contains("\na 1.0.0: MIT\nb 1.0.0: MIT\n"), "{text}");
        assert!(text.contains("\na 1.0.0 (LICENSE-MIT)\nb 1.0.0 (license.txt)\n\nPermission\nis granted\n"), "{text}");
        assert!(text.contains("\nb 1.0.0 (ring)\n\nAnother text\n"), "{text}");
        assert_eq!(text.matches("Permission\nis granted").count(), 1, "{text}");
        assert!(text.contains("DejaVu Sans Condensed") && text.contains("Bitstream"), "{text}");
        assert!(text.contains("uPlot, in the tool's page") && text.contains("Leon Sorokin"), "{text}");
        assert!(!text.contains("none") && !text.contains("Mine") && !text.contains("own 1.0.0"), "{text}");
    }
}

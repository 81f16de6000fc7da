//! Finds which tests show which rules: collects the rule ids in the comments of tests.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::id::{RuleId, ids_in};
use super::{c, rust, text_of};
use crate::error::Error;

/// The folders whose sources are searched for tests that name rules.
const FOLDERS: [&str; 6] = ["src", "capi", "tests", "tool", "examples", "xtask"];

/// For each rule the tests that name it, as `file::function`. A C file that names a rule in its head is listed as `file`.
#[derive(Debug, Default)]
pub struct Evidence {
    pub tests: BTreeMap<RuleId, BTreeSet<String>>,
}

impl Evidence {
    /// Reads all sources under `root`.
    pub fn collect(root: &Path) -> Result<Self, Error> {
        let mut files = Vec::new();
        for folder in FOLDERS {
            list(&root.join(folder), &mut files)?;
        }
        files.sort();

        let mut evidence = Self::default();
        let mut named = BTreeSet::new();
        let mut programs = Vec::new();
        for path in &files {
            let text = text_of(path).map_err(Error::file("read", path))?;
            let name = path.strip_prefix(root).unwrap_or(path).display().to_string();
            if path.extension().is_some_and(|extension| extension == "rs") {
                let source = rust::read(&text).map_err(|problem| Error::Rust { path: path.clone(), problem })?;
                evidence.add_rust(&name, &source, &mut named);
            } else {
                programs.push((name, text));
            }
        }
        for (name, text) in programs.iter().filter(|(name, _)| is_named(name, &named)) {
            evidence.add_c(name, text);
        }
        Ok(evidence)
    }

    fn add_rust(&mut self, file: &str, source: &rust::Source, named: &mut BTreeSet<String>) {
        for test in &source.tests {
            self.add(&test.comments, || format!("{file}::{}", test.name));
        }
        // A C program counts as a test only if a string in a folder `tests` names it. All files there are searched, because
        // helpers name such programs, too.
        if file.split('/').any(|folder| folder == "tests") {
            named.extend(source.strings.iter().cloned());
        }
    }

    fn add_c(&mut self, file: &str, text: &str) {
        for comment in c::comments(text) {
            self.add(&comment.text, || match &comment.function {
                Some(function) => format!("{file}::{function}"),
                None => file.to_owned(),
            });
        }
    }

    fn add(&mut self, comment: &str, place: impl Fn() -> String) {
        for id in ids_in(comment) {
            self.tests.entry(id).or_default().insert(place());
        }
    }
}

/// Whether a Rust test runs this C program; only then it counts as a test. That is so if a string in a file below a folder
/// `tests` is the program's file name, with or without extension, alone or at the end of a path.
fn is_named(file: &str, strings: &BTreeSet<String>) -> bool {
    let path = Path::new(file);
    let names =
        [path.file_name(), path.file_stem()].map(|name| name.unwrap_or_default().to_string_lossy().into_owned());
    strings
        .iter()
        .any(|string| names.iter().any(|name| Path::new(string).file_name().is_some_and(|end| end == &**name)))
}

/// Adds all Rust, C and C++ sources below `folder`, if the folder exists.
fn list(folder: &Path, files: &mut Vec<PathBuf>) -> Result<(), Error> {
    let entries = match fs::read_dir(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        entries => entries.and_then(Iterator::collect::<io::Result<Vec<_>>>),
    };
    for entry in entries.map_err(Error::file("list", folder))? {
        let path = entry.path();
        if path.is_dir() {
            list(&path, files)?;
        } else if path.extension().is_some_and(|extension| ["rs", "c", "cpp"].iter().any(|known| extension == *known)) {
            files.push(path);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::features::id::id_of;

    #[test]
    fn tests_and_the_programs_that_they_run_are_evidence() {
        let root = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| {
            let path = root.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        };
        write("src/a.rs", "/// SK-1.1\nfn no_test() { run(\"silent.c\"); }\n/// SK-1.2 and SK-1.3\n#[test]\nfn a() {}");
        write("tests/b.rs", "/// SK-1.2\n#[test]\nfn b() { run(\"c/loud.c\"); run(\"bare\"); }");
        write("tests/c/loud.c", "/* SK-2.1 */\n\n/* LIB-1 */\nint main(void) { /* LIB-2 */ }");
        write("tests/c/silent.c", "/* SK-2.2 */");
        write("examples/cpp/bare.cpp", "// LIB-3\nint main() {}");
        write("capi/notes.md", "SK-9.9");

        let evidence = Evidence::collect(root.path()).unwrap();
        let tests = |id: &str| match evidence.tests.get(&id_of(id).unwrap()) {
            Some(tests) => tests.iter().map(String::as_str).collect::<Vec<_>>().join(" "),
            None => String::new(),
        };
        assert_eq!(tests("SK-1.1"), "");
        assert_eq!(tests("SK-1.2"), "src/a.rs::a tests/b.rs::b");
        assert_eq!(tests("SK-1.3"), "src/a.rs::a");
        assert_eq!(tests("SK-2.1"), "tests/c/loud.c");
        assert_eq!(tests("LIB-1"), "tests/c/loud.c::main");
        assert_eq!(tests("LIB-2"), "tests/c/loud.c::main");
        assert_eq!(tests("LIB-3"), "examples/cpp/bare.cpp::main");
        assert_eq!(tests("SK-2.2"), "");
        assert_eq!(evidence.tests.len(), 6);
    }
}

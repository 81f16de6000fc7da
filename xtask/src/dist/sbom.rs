//! Writes the software bill of materials (CycloneDX 1.5): the components of each shipped file. These are crates with versions,
//! licences and checksums, Rust's standard library, and the runtime of MinGW.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::Command;

use serde_json::{Value, json};

use super::archive;
use super::crates::Crate;
use super::release::Release;
use crate::command;
use crate::error::Error;
use crate::windows::Width;

/// A shipped library or program.
pub struct Artefact {
    /// The package that contains the library or program, and its path in the package.
    pub name: String,
    /// Its type: `library` or `application`.
    pub kind: &'static str,
    /// Its path on this machine.
    pub file: PathBuf,
    pub crates: Vec<Crate>,
    /// Its components that are no crates, see [`Runtime`].
    pub runtimes: Vec<Runtime>,
}

/// Code in a program that is no crate, such as Rust's standard library.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Runtime {
    pub name: &'static str,
    pub version: String,
    pub licence: &'static str,
}

impl Runtime {
    /// Rust's standard library of this version.
    pub fn rust(version: String) -> Self {
        Self { name: "rust-std", version, licence: OWN_LICENCE }
    }

    /// The code in the tool that is no crate: the library that draws curves in its page. `None` for other programs, for
    /// which `is_tool` is false.
    pub fn of_the_tool(is_tool: bool) -> Option<Self> {
        is_tool.then(|| Self { name: "uPlot", version: "1.6.32".to_owned(), licence: "MIT" })
    }

    /// The runtime libraries that Debian's MinGW links into programs of this width.
    pub fn mingw(width: Width) -> Result<Vec<Self>, Error> {
        let (runtime, compiler) = match width {
            Width::X86 => ("mingw-w64-i686-dev", "gcc-mingw-w64-i686-posix"),
            Width::X64 => ("mingw-w64-x86-64-dev", "gcc-mingw-w64-x86-64-posix"),
        };
        let installed = |package: &str| -> Result<String, Error> {
            let mut ask = Command::new("dpkg-query");
            let said = command::output(ask.args(["--show", "--showformat=${Version}", package]))?;
            Ok(String::from_utf8_lossy(&said).into_owned())
        };
        Ok(vec![
            Self { name: runtime, version: installed(runtime)?, licence: "LicenseRef-mingw-w64-runtime" },
            Self { name: "libgcc", version: installed(compiler)?, licence: "GPL-3.0-or-later WITH GCC-exception-3.1" },
        ])
    }

    fn purl(&self) -> String {
        let version = self.version.replace('+', "%2B").replace(' ', "%20");
        format!("pkg:generic/{}@{version}", self.name)
    }
}

/// The bill of materials as JSON.
pub fn text(release: &Release, artefacts: &[Artefact]) -> Result<String, Error> {
    let mut components = BTreeMap::new();
    let mut dependencies = Vec::new();
    for artefact in artefacts {
        let reference = format!("file:{}", artefact.name);
        for known in &artefact.crates {
            components.insert(known.purl(), of_a_crate(known));
        }
        for runtime in &artefact.runtimes {
            components.insert(runtime.purl(), of_a_runtime(runtime));
        }
        let parts = artefact.crates.iter().map(Crate::purl).chain(artefact.runtimes.iter().map(Runtime::purl));
        dependencies.push(json!({ "ref": reference, "dependsOn": parts.collect::<Vec<_>>() }));
        let file = json!({
            "type": artefact.kind,
            "bom-ref": reference,
            "name": artefact.name,
            "version": release.version,
            "licenses": [{ "expression": OWN_LICENCE }],
            "hashes": [{ "alg": "SHA-256", "content": archive::sha256(&artefact.file)? }],
        });
        components.insert(reference, file);
    }
    let list = json!({
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {
            "timestamp": release.date("+%Y-%m-%dT%H:%M:%SZ")?,
            "component": {
                "type": "application",
                "bom-ref": "ecmsk",
                "name": "ecmsk",
                "version": release.version,
                "licenses": [{ "expression": OWN_LICENCE }],
            },
        },
        "components": components.into_values().collect::<Vec<Value>>(),
        "dependencies": dependencies,
    });
    Ok(format!("{list:#}\n"))
}

const OWN_LICENCE: &str = "MIT OR Apache-2.0";

fn of_a_crate(known: &Crate) -> Value {
    let mut component = json!({
        "type": "library",
        "bom-ref": known.purl(),
        "name": known.name,
        "version": known.version,
        "licenses": [{ "expression": known.licence }],
        "purl": known.purl(),
    });
    if let Some(sum) = &known.checksum {
        component["hashes"] = json!([{ "alg": "SHA-256", "content": sum }]);
    }
    if !known.repository.is_empty() {
        component["externalReferences"] = json!([{ "type": "vcs", "url": known.repository }]);
    }
    component
}

fn of_a_runtime(runtime: &Runtime) -> Value {
    json!({
        "type": "library",
        "bom-ref": runtime.purl(),
        "name": runtime.name,
        "version": runtime.version,
        "licenses": [{ "expression": runtime.licence }],
        "purl": runtime.purl(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each shipped file is a component with its checksum, and refers to its own components by their package URLs. No component
    /// is listed twice.
    #[test]
    fn a_file_has_its_sum_and_its_parts() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("x.dll");
        std::fs::write(&file, "a\n").unwrap();
        let part = Crate {
            name: "toml".to_owned(),
            version: "1.2.1+spec-1.1.0".to_owned(),
            licence: "MIT".to_owned(),
            repository: "there".to_owned(),
            checksum: Some("00ff".to_owned()),
            folder: PathBuf::new(),
        };
        let std = Runtime { name: "rust-std", version: "1.95.0".to_owned(), licence: "MIT OR Apache-2.0" };
        let artefact = |name: &str| Artefact {
            name: name.to_owned(),
            kind: "library",
            file: file.clone(),
            crates: vec![part.clone()],
            runtimes: vec![std.clone()],
        };
        let release = Release { version: "0.1.0", epoch: 1_795_305_600 };
        let text = text(&release, &[artefact("x86/x.dll"), artefact("x64/x.dll")]).unwrap();
        let list: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(list["metadata"]["timestamp"], "2026-11-22T00:00:00Z");
        let named = |name: &str| -> Vec<&Value> {
            list["components"].as_array().unwrap().iter().filter(|component| component["name"] == name).collect()
        };
        assert_eq!(named("toml").len(), 1);
        assert_eq!(named("toml")[0]["purl"], "pkg:cargo/toml@1.2.1%2Bspec-1.1.0");
        assert_eq!(named("toml")[0]["hashes"][0]["content"], "00ff");
        assert_eq!(named("rust-std")[0]["licenses"][0]["expression"], "MIT OR Apache-2.0");
        let sum = "87428fc522803d31065e7bce3cf03fe475096631e5e07bbd7a0fde60c4cf25c7";
        assert_eq!(named("x64/x.dll")[0]["hashes"][0]["content"], sum);
        let parts = json!(["pkg:cargo/toml@1.2.1%2Bspec-1.1.0", "pkg:generic/rust-std@1.95.0"]);
        assert_eq!(list["dependencies"][0], json!({ "ref": "file:x86/x.dll", "dependsOn": parts }));
    }
}

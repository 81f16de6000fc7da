//! The wheel, in a fresh environment with nothing but it. maturin makes it of the module that the tests' build has made
//! already, by a cargo of its own that builds the whole workspace: one package alone would have other features, and
//! everything would be compiled once more.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use support::{out_dir, python_module, root, target_dir};

use crate::package::succeed;

/// What maturin tells pyo3, which would therefore be compiled again.
const TOLD_BY_MATURIN: [&str; 5] = [
    "PYO3_BUILD_EXTENSION_MODULE",
    "PYO3_CONFIG_FILE",
    "PYO3_ENVIRONMENT_SIGNATURE",
    "PYO3_PYTHON",
    "PYTHON_SYS_EXECUTABLE",
];

/// A package that the chore of the tests has fetched, in whatever version.
pub fn fetched(name: &str) -> PathBuf {
    let folder = target_dir().join("xtask");
    let entries = fs::read_dir(&folder).expect("what cargo xtask test has fetched");
    let mut found: Vec<PathBuf> = entries.map(|entry| entry.expect("readable").path()).collect();
    let is_it = |path: &PathBuf| {
        let file = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let version = file.strip_prefix(name).and_then(|rest| rest.strip_prefix('-')?.strip_suffix(".d"));
        version.is_some_and(|version| version.starts_with(|first: char| first.is_ascii_digit()))
    };
    found.retain(is_it);
    found.sort();
    found.pop().unwrap_or_else(|| panic!("no {name} in {}: cargo xtask test --all fetches it", folder.display()))
}

/// Folders for `PYTHONPATH`.
pub fn path_of(names: &[&str]) -> std::ffi::OsString {
    std::env::join_paths(names.iter().map(|name| fetched(name))).expect("no colon in a path")
}

/// The cargo that maturin calls.
fn cargo() -> PathBuf {
    let cargo = env!("CARGO");
    let unset = TOLD_BY_MATURIN.map(|name| format!("-u {name}")).join(" ");
    let target = target_dir().display();
    let text = format!(
        "#!/bin/sh\n\
         [ \"$1\" = rustc ] || exec '{cargo}' \"$@\"\n\
         exec env {unset} '{cargo}' build --quiet --offline --workspace --lib --bin=ecmsk --examples \
         --target-dir '{target}' --message-format json-render-diagnostics\n"
    );
    let file = out_dir().join("cargo");
    fs::write(&file, text).expect("a file in the target folder");
    fs::set_permissions(&file, fs::Permissions::from_mode(0o755)).expect("an executable file");
    file
}

fn wheel() -> PathBuf {
    // Built first, so that maturin finds it done.
    python_module();
    let folder = out_dir().join("wheel");
    let _ = fs::remove_dir_all(&folder);
    let unpacked = fetched("maturin");
    let version = unpacked.file_stem().expect("a name").to_string_lossy().into_owned();
    let mut maturin = Command::new(unpacked.join(format!("{version}.data/scripts/maturin")));
    maturin.args(["build", "--quiet", "--offline", "--locked", "--auditwheel=skip", "--compatibility=linux"]);
    maturin.args(["--interpreter=python3", "--compression-level=1", "--out"]).arg(&folder);
    for (name, _) in std::env::vars_os() {
        let text = name.to_string_lossy();
        if text.starts_with("CARGO_PKG_") || text.starts_with("CARGO_MANIFEST_") {
            maturin.env_remove(&name);
        }
    }
    succeed(maturin.current_dir(root().join("python")).env("CARGO", cargo()));
    let mut files = fs::read_dir(&folder).expect("the folder of the wheel");
    files.next().expect("a wheel").expect("readable").path()
}

/// The Python of an environment in which the wheel is installed, without anything from a network.
pub fn installed() -> &'static Path {
    static PYTHON: OnceLock<PathBuf> = OnceLock::new();
    PYTHON.get_or_init(|| {
        let wheel = wheel();
        let name = wheel.file_name().expect("a name").to_string_lossy().into_owned();
        assert!(name.contains("-cp38-abi3-linux_"), "{name} is for one version of Python");
        let environment = out_dir().join("environment");
        let _ = fs::remove_dir_all(&environment);
        succeed(Command::new("python3").args(["-m", "venv", "--without-pip"]).arg(&environment));
        let mut pip = Command::new("pip3");
        pip.arg("--python").arg(&environment);
        pip.args(["--quiet", "--disable-pip-version-check", "install", "--no-index", "--no-deps"]);
        succeed(pip.arg(&wheel));
        environment.join("bin/python3")
    })
}

/// The Python of the environment, with packages that were fetched.
pub fn python(packages: &[&str]) -> Command {
    let mut python = Command::new(installed());
    python.current_dir(root()).env("PYTHONPATH", path_of(packages)).env("PYTHONDONTWRITEBYTECODE", "1");
    python.env_remove("ECMSK_LINK").env_remove("ECMSK_LOG").env("ECMSK_TOOL", support::tool());
    python
}

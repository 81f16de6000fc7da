//! The wheels of the Python package, one for each machine and one for each width of Windows. cargo builds the module as it
//! builds everything else that is packed, maturin writes the metadata of the package, and `wheel` packs both. auditwheel and
//! abi3audit judge the result: which Linux it runs on, and that it calls nothing but Python's stable ABI.

use std::path::{Path, PathBuf};
use std::process::Command;

use super::first_axis;
use super::release::Release;
use super::tree::{DATA, Tree};
use super::windows_zip::OTHERS;
use crate::command;
use crate::error::Error;
use crate::needs::{PIP, PYTHON};
use crate::project::Project;
use crate::python_packages::{self, MATURIN};

/// The cargo package of the module.
pub const PACKAGE: &str = "ecmsk-python";
/// The folder with the Python part of the package, and its `pyproject.toml`.
const SOURCES: &str = "python";
/// The versions of Python and of its ABI that the module is built for: the feature `abi3-py38` of pyo3.
const ABI: &str = "cp38-abi3";
/// Two axes in virtual time, which an installed wheel has to move.
const PROGRAM: &str = "examples/python/two_axes.py";
/// What [`PROGRAM`] prints when it has moved them.
const MOVED: &str = "axis 1: 90.0 degrees\naxis 2: -45.0 degrees\n";

/// The system that a module is for.
pub struct Platform<'a> {
    /// Its tag in the file name, such as `manylinux_2_34_x86_64`.
    pub tag: &'a str,
    /// The name under which its Python finds the module.
    pub module: &'static str,
}

/// The name of the module on Linux, and (next constant) on Windows.
pub const ON_LINUX: &str = "_ecmsk.abi3.so";
pub const ON_WINDOWS: &str = "_ecmsk.pyd";

/// Makes the wheel of the built module `library` in the folder `out`; returns its path. `others`: the licences of other
/// projects' code in the module. `work` is a folder for its files.
pub fn make(
    project: &Project,
    release: &Release,
    platform: &Platform,
    library: &Path,
    others: &str,
    work: &Path,
    out: &Path,
) -> Result<PathBuf, Error> {
    look_into(platform, library)?;
    let tree = Tree::new(work.join(platform.tag))?;
    let sources = project.root.join(SOURCES);
    tree.copy_all(&sources.join("ecmsk"), "ecmsk", &[".py", ".pyi", "py.typed"])?;
    tree.copy(library, &format!("ecmsk/{}", platform.module), DATA)?;
    let info = format!("ecmsk-{}.dist-info", release.version);
    let mut maturin = release.command(MATURIN.program(project));
    maturin.current_dir(&sources).args(["pep517", "write-dist-info", "--locked", "--interpreter", PYTHON.program]);
    command::output(maturin.arg("--metadata-directory").arg(tree.root()))?;
    tree.set_modes(DATA)?;
    let tag = format!("{ABI}-{}", platform.tag);
    let form =
        format!("Wheel-Version: 1.0\nGenerator: ecmsk {}\nRoot-Is-Purelib: false\nTag: {tag}\n", release.version);
    tree.write(&format!("{info}/WHEEL"), form)?;
    for license in ["LICENSE-MIT", "LICENSE-APACHE"] {
        tree.copy(&project.root.join(license), &format!("{info}/licenses/{license}"), DATA)?;
    }
    tree.write(&format!("{info}/licenses/{OTHERS}"), others)?;
    let mut pack = release.command(PYTHON.program);
    pack.env("PYTHONPATH", python_packages::path(project)).args(["-m", "wheel", "pack", "--dest-dir"]);
    command::output(pack.arg(out).arg(tree.root()))?;
    Ok(out.join(format!("ecmsk-{}-{tag}.whl", release.version)))
}

/// Checks what no judge looks at: Python finds the function that begins the module, and a module for Windows asks for the
/// library of any Python 3, not of one version.
fn look_into(platform: &Platform, library: &Path) -> Result<(), Error> {
    let bytes = std::fs::read(library).map_err(Error::file("read", library))?;
    let wrong = |what: &str| Err(Error::Package(format!("{} {what}", library.display())));
    let has = |text: &[u8]| bytes.windows(text.len()).any(|at| at.eq_ignore_ascii_case(text));
    if !has(b"PyInit__ecmsk") {
        return wrong("has no PyInit__ecmsk; is it the module of python/?");
    }
    let one_version = |minor: &u8| has(format!("python3{minor}.dll").as_bytes());
    if platform.module == ON_WINDOWS && (!has(b"python3.dll") || (5..30).any(|minor| one_version(&minor))) {
        return wrong("does not take python3.dll; build it with the feature abi3 of pyo3");
    }
    Ok(())
}

/// What auditwheel and abi3audit say of a wheel.
///
/// # Errors
/// The module needs a newer Linux than its name says, or more of Python than the stable ABI of the version in its name.
pub fn judge(project: &Project, wheel: &Path) -> Result<(), Error> {
    let name = wheel.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let ask = |checker: &str, options: &[&str]| {
        let mut python = Command::new(PYTHON.program);
        python.env("PYTHONPATH", python_packages::path(project)).args(["-m", checker]).args(options).arg(wheel);
        let said = command::output(&mut python)?;
        Ok::<_, Error>(String::from_utf8_lossy(&said).split_whitespace().collect::<Vec<_>>().join(" "))
    };
    let mut answers = vec![("abi3audit", ask("abi3audit", &["--strict", "--report"])?, "\"is_abi3\": true".to_owned())];
    if let Some(tag) = name.split_once("manylinux_") {
        let tag = format!("platform tag: \"manylinux_{}\"", tag.1.trim_end_matches(".whl"));
        answers.push(("auditwheel", ask("auditwheel", &["show"])?, tag));
    }
    match answers.iter().find(|(_, said, expected)| !said.contains(expected)) {
        Some((checker, said, expected)) => {
            Err(Error::Package(format!("{checker} does not say {expected} of {}, but: {said}", wheel.display())))
        }
        None => Ok(()),
    }
}

/// Installs a wheel in an environment, which is made in the folder `environment`, and moves two simulated axes with it.
pub fn first_axis(project: &Project, wheel: &Path, environment: &Path) -> Result<(), Error> {
    first_axis::timed("the wheel", MOVED, || {
        command::output(Command::new(PYTHON.program).args(["-m", "venv", "--without-pip"]).arg(environment))?;
        let mut pip = Command::new(PIP.program);
        pip.arg("--python").arg(environment).args(["--quiet", "--disable-pip-version-check", "install", "--no-index"]);
        command::output(pip.arg(wheel))?;
        let mut python = Command::new(environment.join("bin/python3"));
        python.env_remove("PYTHONPATH").env_remove("ECMSK_LINK").arg(project.root.join(PROGRAM));
        Ok(String::from_utf8_lossy(&command::output(&mut python)?).into_owned())
    })
}

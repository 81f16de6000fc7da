//! Tests packages for another machine than this one: programs are compiled for it with the unpacked packages, and run with the
//! unpacked tool in an emulator of its processor (QEMU), on this machine's kernel.

use std::fs;
use std::path::Path;
use std::process::Command;

use super::machine::Machine;
use super::{ForLinux, deb, first_axis, folder};
use crate::command;
use crate::error::Error;
use crate::project::Project;

/// Unpacks the Debian packages into one folder. Compiles a program with the shared library and with the static one, runs
/// both, and moves a simulated axis with the tool.
pub fn test(project: &Project, packages: &ForLinux, emulator: &str, version: &str) -> Result<(), Error> {
    let machine = packages.machine;
    println!("running programs for {} in {emulator}", machine.debian());
    let root = folder(project).join("foreign").join(machine.debian());
    if root.exists() {
        fs::remove_dir_all(&root).map_err(Error::file("remove", &root))?;
    }
    fs::create_dir_all(&root).map_err(Error::file("make", &root))?;
    for deb in &packages.debs {
        command::output(Command::new("dpkg-deb").arg("--extract").arg(deb).arg(&root))?;
    }
    let emulated = |program: &Path, words: &[&str]| {
        let mut run = Command::new(emulator);
        // The emulator finds the dynamic linker and the C library of that machine in the folder of the cross compiler.
        run.arg("-L").arg(Path::new("/usr").join(machine.gnu()));
        run.arg("-E").arg(format!("LD_LIBRARY_PATH={}", libraries(machine, &root).display()));
        run.env("ECMSK_LINK", "sim:?clock=virtual").arg(program).args(words);
        let said = command::output(&mut run)?;
        Ok::<_, Error>(String::from_utf8_lossy(&said).into_owned())
    };
    let expect = |what: &str, said: String, expected: &str| match said == expected {
        true => Ok(()),
        false => Err(Error::Package(format!(
            "for {} {what} printed {said:?} instead of {expected:?}; look there: {}",
            machine.debian(),
            root.display()
        ))),
    };
    let tool = root.join("usr/bin/ecmsk");
    expect("ecmsk --version", emulated(&tool, &["--version"])?, &format!("ecmsk {version}\n"))?;
    expect("ecmsk move", emulated(&tool, &first_axis::MOVE)?, first_axis::MOVED)?;
    for is_static in [false, true] {
        let program = compile(machine, &root, is_static)?;
        expect(&program.display().to_string(), emulated(&program, &[])?, deb::install::EXPECTED)?;
    }
    fs::remove_dir_all(&root).map_err(Error::file("remove", &root))
}

/// The folder of libraries in the unpacked packages.
fn libraries(machine: Machine, root: &Path) -> std::path::PathBuf {
    root.join("usr/lib").join(machine.gnu())
}

/// Compiles [`deb::install::PROGRAM`] with the unpacked header and the shared library, or with the static library if
/// `is_static`.
fn compile(machine: Machine, root: &Path, is_static: bool) -> Result<std::path::PathBuf, Error> {
    let (source, libraries) = (root.join("program.c"), libraries(machine, root));
    fs::write(&source, deb::install::PROGRAM).map_err(Error::file("write", &source))?;
    let program = root.join(if is_static { "alone" } else { "program" });
    let mut gcc = machine.gnu_program("gcc");
    gcc.args(["-Wall", "-Wextra", "-Werror", "-I"]).arg(root.join("usr/include")).arg(&source).arg("-o").arg(&program);
    if is_static {
        gcc.arg(libraries.join(crate::stage::ARCHIVE)).args(crate::stage::PRIVATE_LIBS.split(' '));
    } else {
        gcc.arg("-L").arg(&libraries).arg("-lNEXTWUSBLib");
    }
    command::run(&mut gcc)?;
    Ok(program)
}

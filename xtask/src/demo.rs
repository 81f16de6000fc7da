//! `cargo xtask demo`: the C++ program of README on a simulated board, and a plot of what it did.

use std::fs;
use std::process::Command;

use crate::error::Error;
use crate::needs::CXX;
use crate::project::Project;
use crate::{command, needs, stage};

const PROGRAM: &str = "two_axes_12b";
const LINK: &str = "sim:?slaves=drive*2&clock=real";

pub fn run(project: &Project) -> Result<(), Error> {
    needs::require(project, &[CXX])?;
    let folder = project.target.join("demo");
    fs::create_dir_all(&folder).map_err(Error::file("make", &folder))?;
    let staged = folder.join("stage");
    let program = folder.join(PROGRAM);
    let recording = folder.join("two_axes.pcapng");
    let plot = folder.join("two_axes.svg");
    let ecmsk = project.target.join("release/ecmsk");

    println!("building the library and the tool");
    stage::build_into(project, &staged, "release")?;

    let mut compiler = Command::new(CXX.program);
    compiler.current_dir(&project.root).args(["-std=c++17", "-O2", "-Wall", "-Wextra", "-pthread"]);
    compiler.arg(format!("examples/cpp/{PROGRAM}.cpp")).arg("-I").arg(staged.join("include"));
    compiler
        .arg("-L")
        .arg(staged.join("lib"))
        .args(["-lNEXTWUSBLib", "-Wl,--enable-new-dtags,-rpath,$ORIGIN/stage/lib", "-o"])
        .arg(&program);
    show_and_run(&mut compiler)?;

    let mut exec = Command::new(&ecmsk);
    exec.current_dir(&project.root).args(["exec", "--link", LINK, "--record"]).arg(&recording).arg("--").arg(&program);
    show_and_run(&mut exec)?;

    let mut draw = Command::new(&ecmsk);
    show_and_run(draw.current_dir(&project.root).arg("plot").arg(&recording).arg("-o").arg(&plot))?;

    println!("\nthe recording: {}", project.shown(&recording));
    println!("the plot:      {}", project.shown(&plot));
    Ok(())
}

fn show_and_run(step: &mut Command) -> Result<(), Error> {
    println!("$ {}", command::shown(step));
    command::run(step)
}

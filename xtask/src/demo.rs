//! `cargo xtask demo`: a C++ program for the board, on a simulated one on which a drive has an alarm, and a plot of it.

use std::env;
use std::fs;
use std::process::Command;

use crate::error::Error;
use crate::needs::CXX;
use crate::project::Project;
use crate::{command, needs, stage};

const SOURCE: &str = "examples/cpp/alarm_recovery.cpp";
const LINK: &str = "sim:?slaves=drive*2&clock=real&script=examples/scripts/alarm_on_the_way.ecmscript";

pub fn run(project: &Project) -> Result<(), Error> {
    needs::require(project, &[CXX])?;
    // The commands are shown, so they are written as one would type them at the root.
    env::set_current_dir(&project.root).map_err(Error::file("go to", &project.root))?;
    let target = project.relative(&project.target);
    let folder = target.join("demo");
    let [staged, program, recording, plot] =
        ["stage", "alarm_recovery", "two_axes.pcapng", "two_axes.svg"].map(|name| folder.join(name));
    let ecmsk = target.join("release/ecmsk");
    fs::create_dir_all(&folder).map_err(Error::file("make", &folder))?;

    stage::build_into(project, &staged, "release")?;

    let mut compile = Command::new(CXX.program);
    compile.args(["-std=c++17", "-O2", "-Wall", "-Wextra", "-pthread", SOURCE]);
    compile.arg("-I").arg(staged.join("include")).arg("-L").arg(staged.join("lib"));
    // A run path, so that it starts without `ecmsk exec` too; the new kind gives way to LD_LIBRARY_PATH.
    compile.args(["-lNEXTWUSBLib", "-Wl,--enable-new-dtags,-rpath,$ORIGIN/stage/lib", "-o"]).arg(&program);
    show_and_run(&mut compile)?;

    let mut exec = Command::new(&ecmsk);
    exec.args(["exec", "--link", LINK, "--record"]).arg(&recording).arg("--").arg(&program);
    show_and_run(&mut exec)?;

    show_and_run(Command::new(&ecmsk).arg("plot").arg(&recording).arg("-o").arg(&plot))?;

    println!("\nthe recording: {}", recording.display());
    println!("the plot:      {}", plot.display());
    Ok(())
}

fn show_and_run(step: &mut Command) -> Result<(), Error> {
    println!("$ {}", command::shown(step));
    command::run(step)
}

//! `cargo xtask demo`: runs a C++ program for the board on a simulated one, on which a drive has an alarm, and plots
//! it.

use std::env;
use std::fs;
use std::path::Path;
use std::process::Command;

use crate::error::Error;
use crate::needs::CXX;
use crate::project::Project;
use crate::spend::Spend;
use crate::{command, needs, stage};

const SOURCE: &str = "examples/cpp/alarm_recovery.cpp";
const LINK: &str = "sim:?slaves=drive*2&clock=real&script=examples/scripts/alarm_on_the_way.ecmscript";

/// The cost of building the optimised library and tool.
const SPEND: Spend = Spend { disk_mb: 1_500, time: "on two free cores, one or two minutes" };

pub fn run(project: &Project) -> Result<(), Error> {
    println!("builds the library and the tool, compiles {SOURCE}, runs it on a simulated board and draws what it did");
    SPEND.announce(project);
    needs::require(project, &[CXX])?;
    // The commands are shown as one would type them at the root.
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
    // With a run path the program also starts without `ecmsk exec`; a DT_RUNPATH is searched after LD_LIBRARY_PATH.
    compile.args(["-lNEXTWUSBLib", "-Wl,--enable-new-dtags,-rpath,$ORIGIN/stage/lib", "-o"]).arg(&program);
    show_and_run(&mut compile)?;

    let mut exec = Command::new(&ecmsk);
    exec.args(["exec", "--link", LINK, "--record"]).arg(&recording).arg("--").arg(&program);
    show_and_run(&mut exec)?;

    show_and_run(Command::new(&ecmsk).arg("plot").arg(&recording).arg("-o").arg(&plot))?;

    println!("{}", end(&folder));
    Ok(())
}

/// The text at the end: what was made, and what to do with it.
fn end(folder: &Path) -> String {
    let folder = folder.display();
    format!(
        "
the recording: {folder}/two_axes.pcapng
the plot:      {folder}/two_axes.svg (a browser shows it)

next, in this folder:
  export PATH=$PWD/{folder}/stage/bin:$PATH PKG_CONFIG_PATH=$PWD/{folder}/stage/lib/pkgconfig
  ecmsk dump {folder}/two_axes.pcapng --slots 2 --from 2.749s --to 2.752s   # the alarm, cycle by cycle
  ecmsk home 1 --up --link 'sim:?slaves=drive*2'                            # an axis without a program
  g++ YOURS.cpp -o yours $(pkg-config --cflags --libs nextwusblib)          # your program, unchanged
  ecmsk exec --link 'sim:?slaves=drive*2' -- ./yours
docs/GUIDE-CPP.md goes on from there in C++, docs/GUIDE.md in Rust, docs/DOTNET.md in C#, docs/TOOL.md with the tool alone"
    )
}

fn show_and_run(step: &mut Command) -> Result<(), Error> {
    println!("$ {}", command::shown(step));
    command::run(step)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The demo ends with what it has made and with commands to go on; the pages that it names exist.
    #[test]
    fn a_next_step() {
        let text = end(Path::new("target/demo"));
        assert!(text.contains("target/demo/two_axes.svg"), "{text}");
        assert!(text.contains("export PATH=$PWD/target/demo/stage/bin:$PATH"), "{text}");
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
        let pages: Vec<&str> = text.split([' ', ',', '\n']).filter(|word| word.starts_with("docs/")).collect();
        assert_eq!(pages.len(), 4, "{text}");
        assert!(pages.iter().all(|page| root.join(page).is_file()), "{pages:?}");
    }
}

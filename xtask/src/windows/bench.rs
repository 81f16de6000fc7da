//! Measures the DLLs: the time from LoadLibrary to an open board compared with an empty DLL, under Wine; and opening, closing
//! and writes on a board on USB, in the guest system.

use std::fs;
use std::path::Path;
use std::process::Command;

use super::{DLL, Width, build_width, folder, wine};
use crate::command;
use crate::error::Error;
use crate::project::Project;
use crate::system::stay_on_one_processor;

const SOURCE: &str = "benches/windows";
/// The name of the folder for the bench, in the folder from which Wine runs programs.
const PLACE: &str = "bench-load";
const LINK: &str = "sim:";

/// Runs the bench for both widths; returns its output.
pub fn bench(project: &Project) -> Result<String, Error> {
    let mut said = String::new();
    let prefix = folder(project).join("stage");
    for width in Width::ALL {
        build_width(project, width, &prefix)?;
    }
    said += &(super::usb::bench(project)? + "\n");
    // Wine exchanges many messages with its server while it loads a DLL. With two processors the wake-up latencies would vary
    // as much as the measured time, so everything runs on one.
    stay_on_one_processor().map_err(Error::Processor)?;
    for width in Width::ALL {
        let wine = wine::set_up(project, width)?;
        let place = wine.programs.join(PLACE);
        let [ours, empty] = ["ours", "empty"].map(|name| place.join(name));
        for folder in [&ours, &empty] {
            fs::create_dir_all(folder).map_err(Error::file("make", folder))?;
        }
        let built = prefix.join(width.name()).join(DLL);
        fs::copy(&built, ours.join(DLL)).map_err(Error::file("copy", &built))?;
        compile(project, width, "empty", &["-shared", "-Wl,--kill-at"], &empty.join(DLL))?;
        compile(project, width, "load", &["-static"], &place.join("load.exe"))?;
        let mut script = Command::new(&wine.script);
        script.env("ECMSK_LINK", LINK).env_remove("ECMSK_LOG").arg(PLACE).arg("load.exe");
        script.args(["ours", "empty"].map(|name| format!("{name}\\{}", DLL)));
        let measured = command::output(script.arg(format!("windows_load_{}", width.name())))?;
        said += &String::from_utf8_lossy(&measured).replace('\r', "");
    }
    Ok(said)
}

fn compile(project: &Project, width: Width, name: &str, options: &[&str], out: &Path) -> Result<(), Error> {
    let mut gcc = Command::new(format!("{}-gcc-posix", width.mingw()));
    gcc.args(["-std=gnu99", "-O2", "-s", "-Wall", "-Wextra", "-Werror"]);
    gcc.arg(project.root.join(SOURCE).join(name).with_extension("c")).args(options);
    command::run(gcc.arg("-o").arg(out))
}

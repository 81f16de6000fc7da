//! `ecmsk wireshark`: a plugin of Wireshark for frames of boards and packets of chips.
//!
//! Files:
//!
//! - `wireshark.rs`: the verb, and the folder for plugins
//! - `plugin.rs`: the plugin: its tables, followed by the files of `lua/`
//! - `board.rs`, `chip.rs`: the tables, made from the types that `dump` decodes with
//! - `table.rs`: tables as Lua
//! - `lua/`: the code of the plugin

mod board;
mod chip;
mod plugin;
mod table;

use std::env;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use clap::ValueHint;

use super::error::CliError;
use super::output;
use super::stderr::say;

/// The file name of the plugin in Wireshark's folder.
const FILE: &str = "ecmsk.lua";

/// Install a plugin with which Wireshark and tshark show frames of boards and packets of chips
#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(clap::Subcommand)]
enum Verb {
    Install(InstallArgs),
}

/// Write the plugin ecmsk.lua into your folder of Wireshark's plugins, or over an older one there
///
/// The folder is that which Wireshark lists as "Personal Lua Plugins" in Help, About Wireshark, Folders: on Linux and
/// macOS ~/.local/lib/wireshark/plugins, on Windows %APPDATA%\Wireshark\plugins.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  ecmsk wireshark install
  tshark -r run.pcapng -Y 'ecmsk.slot.cmd == \"SET_STATE\"'")]
struct InstallArgs {
    /// Write the plugin into this folder instead, which is created if it does not exist
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    dir: Option<PathBuf>,
}

/// Why no plugin was written.
#[derive(Debug, thiserror::Error)]
pub enum WiresharkError {
    /// The environment variable from which the folder for the user's plugins follows is not set.
    #[error(
        "{variable} is not set, so that Wireshark's folder for plugins is not known; name it with --dir, Wireshark \
         lists it in Help, About Wireshark, Folders"
    )]
    NoFolder {
        /// The name of the environment variable.
        variable: &'static str,
    },
    /// The folder cannot be written to.
    #[error("cannot write {}: {source}; name another folder with --dir", .file.display())]
    Write {
        /// The folder that cannot be created, or the file that cannot be written.
        file: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
}

/// Runs `ecmsk wireshark`: writes the plugin and prints its path.
///
/// # Errors
/// [`CliError`] if the folder is not known, or if the plugin or standard output cannot be written to.
pub fn run(args: &Args) -> Result<(), CliError> {
    let Verb::Install(InstallArgs { dir }) = &args.verb;
    let folder = match dir {
        Some(dir) => dir.clone(),
        None => personal_folder(cfg!(windows), |variable| env::var_os(variable).map(PathBuf::from))?,
    };
    let file = folder.join(FILE);
    let failed = |file: &Path| {
        let file = file.to_owned();
        |source| WiresharkError::Write { file, source }
    };
    fs::create_dir_all(&folder).map_err(failed(&folder))?;
    fs::write(&file, plugin::text()).map_err(failed(&file))?;
    output::print(format!("{}\n", file.display()))?;
    say("note", &"Wireshark loads it when it starts, or with Analyze, Reload Lua Plugins");
    Ok(())
}

/// The folder in which Wireshark looks for plugins of the user, by the variables of the environment.
fn personal_folder(
    windows: bool,
    variable: impl Fn(&'static str) -> Option<PathBuf>,
) -> Result<PathBuf, WiresharkError> {
    let set = |name: &'static str| variable(name).filter(|path| !path.as_os_str().is_empty());
    let needed = |name: &'static str| set(name).ok_or(WiresharkError::NoFolder { variable: name });
    if windows {
        let settings = set("WIRESHARK_CONFIG_DIR").map_or_else(|| Ok(needed("APPDATA")?.join("Wireshark")), Ok)?;
        return Ok(settings.join("plugins"));
    }
    Ok(needed("HOME")?.join(".local/lib/wireshark/plugins"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(windows: bool, set: &[(&str, &str)]) -> Result<String, String> {
        let variable = |name| set.iter().find(|(known, _)| *known == name).map(|(_, value)| PathBuf::from(*value));
        let found = personal_folder(windows, variable);
        found.map(|path| path.display().to_string().replace('\\', "/")).map_err(|error| error.to_string())
    }

    /// On each system the folder is the one that Wireshark uses; without its variable the error names --dir.
    #[test]
    fn the_folder_is_wireshark_s_own() {
        let unix = folder(false, &[("HOME", "/home/me"), ("APPDATA", "/a")]);
        assert_eq!(unix.as_deref(), Ok("/home/me/.local/lib/wireshark/plugins"));
        let windows = folder(true, &[("HOME", "/home/me"), ("APPDATA", "/a")]);
        assert_eq!(windows.as_deref(), Ok("/a/Wireshark/plugins"));
        let moved = folder(true, &[("APPDATA", "/a"), ("WIRESHARK_CONFIG_DIR", "/c")]);
        assert_eq!(moved.as_deref(), Ok("/c/plugins"));
        for (windows, variable) in [(false, "HOME"), (true, "APPDATA")] {
            let none = folder(windows, &[(variable, "")]).expect_err("no folder");
            assert!(none.starts_with(variable) && none.contains("--dir"), "{none}");
        }
    }
}

//! The functions that the fuzz targets of `fuzz/` call: each runs a verb on given content and returns its output instead of
//! printing.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use clap::Parser;

use super::board::Interrupt;
use super::{doctor, exec, objects, plot, script, shell};

/// The operands and options that follow a verb on the command line.
#[derive(Parser)]
#[command(no_binary_name = true)]
struct Words<T: clap::Args> {
    #[command(flatten)]
    args: T,
}

fn args<T: clap::Args>(words: impl IntoIterator<Item = impl Into<OsString> + Clone>) -> Result<T, String> {
    Words::try_parse_from(words).map(|Words { args }| args).map_err(|error| error.to_string())
}

/// Draws the picture of `ecmsk plot` with these command line words, in the format of `-o`. Returns the bytes and writes no
/// file.
///
/// # Errors
/// The errors of `ecmsk plot`.
pub fn plot(words: impl IntoIterator<Item = impl Into<OsString> + Clone>) -> Result<Vec<u8>, String> {
    plot::picture(&args(words)?).map_err(|error| error.to_string())
}

/// The output of `ecmsk objects from-esi` for an ESI file with this text.
///
/// # Errors
/// The file has no objects.
pub fn objects(text: &str, device: Option<&str>) -> Result<String, String> {
    objects::converted(text.as_bytes(), Path::new("any"), device).map_err(|error| error.to_string())
}

/// The output of `ecmsk doctor FOLDER`, without and with `--json`.
///
/// # Errors
/// The folder cannot be read.
pub fn doctor(folder: &Path) -> Result<[String; 2], String> {
    doctor::of_folder(folder).map_err(|error| error.to_string())
}

/// The library that `ecmsk exec --library FILE` would use.
///
/// # Errors
/// The file is not a library.
pub fn library(file: &Path) -> Result<PathBuf, String> {
    exec::find_library(Some(file), None).map_err(|error| error.to_string())
}

/// Runs `ecmsk run` with these command line words, the first of which is the script's name, and with `text` as the script.
/// Signals are not watched.
///
/// # Errors
/// The errors of `ecmsk run`.
pub fn script(text: &str, words: impl IntoIterator<Item = impl Into<OsString> + Clone>) -> Result<(), String> {
    script::play(text, &args(words)?, || Ok(Interrupt::default())).map_err(|error| error.to_string())
}

/// The completions that Tab offers in `ecmsk shell` after `line`, and the position where the word to replace begins.
pub fn complete(line: &str) -> (usize, Vec<String>) {
    shell::complete(line)
}

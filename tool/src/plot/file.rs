//! The file of a picture: what it is written as is told by its name.

use std::fs;
use std::path::Path;

use super::chart::Sheet;
use super::{PlotError, png, svg};

/// What a picture is written as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Lines and letters.
    Svg,
    /// Points.
    Png,
}

impl Format {
    /// As the file's name ends; without an ending SVG. `option`: what names it.
    ///
    /// # Errors
    /// Another ending: whoever asks for a JPEG is not to get SVG in it.
    pub fn of(file: &Path, option: &'static str) -> Result<Self, PlotError> {
        let Some(ending) = file.extension() else { return Ok(Self::Svg) };
        match ending.to_string_lossy().to_ascii_lowercase().as_str() {
            "svg" => Ok(Self::Svg),
            "png" => Ok(Self::Png),
            other => Err(PlotError::Ending { ending: other.to_owned(), option }),
        }
    }

    /// The bytes of the file.
    ///
    /// # Errors
    /// If it cannot be drawn.
    pub fn write(self, sheet: &Sheet) -> Result<Vec<u8>, PlotError> {
        match self {
            Self::Svg => svg::write(sheet).map(String::into_bytes),
            Self::Png => png::write(sheet),
        }
    }
}

/// Checks a file, named by that option, before anything is read or drawn: what it is written as, and that it is none of the
/// recordings that the picture is made of.
///
/// # Errors
/// What is wrong with it.
pub fn check(file: &Path, option: &'static str, recordings: &[&Path]) -> Result<Format, PlotError> {
    let same = |recording: &&Path| {
        fs::canonicalize(file).ok().zip(fs::canonicalize(recording).ok()).is_some_and(|(a, b)| a == b)
    };
    if recordings.iter().any(same) {
        return Err(PlotError::SameFile { file: file.to_owned(), option });
    }
    Format::of(file, option)
}

/// Writes a picture to a file, named by that option, that is none of the recordings it was made of.
///
/// # Errors
/// What is wrong with the file, or that it cannot be drawn.
pub fn save(file: &Path, option: &'static str, recordings: &[&Path], sheet: &Sheet) -> Result<(), PlotError> {
    let bytes = check(file, option, recordings)?.write(sheet)?;
    fs::write(file, bytes).map_err(|source| PlotError::Write { file: file.to_owned(), option, source })
}

//! The output file of a picture. The extension of its name decides the format.

use std::path::Path;

use super::chart::Sheet;
use super::{PlotError, png, svg};
use crate::output_file::{Kind, OutputFile, Replace};
use crate::recording::is_same_file;

/// The format of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Scalable vector graphics.
    Svg,
    /// A bitmap.
    Png,
}

impl Format {
    /// The format for the extension of the file; SVG if it has no extension. `option` is the command-line option that
    /// names the file, for the error.
    ///
    /// # Errors
    /// The extension is unknown: a file named `.jpg` must not contain SVG.
    pub fn of(file: &Path, option: &'static str) -> Result<Self, PlotError> {
        let Some(ending) = file.extension() else { return Ok(Self::Svg) };
        match ending.to_string_lossy().to_ascii_lowercase().as_str() {
            "svg" => Ok(Self::Svg),
            "png" => Ok(Self::Png),
            other => Err(PlotError::Ending { ending: other.to_owned(), option }),
        }
    }

    /// Draws a picture and returns the bytes of its file in this format.
    ///
    /// # Errors
    /// The picture cannot be drawn.
    pub fn write(self, sheet: &Sheet) -> Result<Vec<u8>, PlotError> {
        match self {
            Self::Svg => svg::write(sheet).map(String::into_bytes),
            Self::Png => png::write(sheet),
        }
    }
}

/// Checks the output file before anything is read or drawn: its format is known, it is none of the recordings, and it
/// may be written. `option` is the command-line option that names the file.
///
/// # Errors
/// The file has an unknown extension, is one of the recordings, or exists and may not be replaced.
pub fn check<'a>(
    file: &'a Path,
    option: &'static str,
    recordings: &[&Path],
    replace: Replace,
) -> Result<Picture<'a>, PlotError> {
    check_same(file, option, recordings)?;
    let format = Format::of(file, option)?;
    let kind = match format {
        Format::Svg => Kind::Svg,
        Format::Png => Kind::Png,
    };
    let output = OutputFile { file, option, kind, replace };
    output.check()?;
    Ok(Picture { output, format })
}

/// Checks that the output file is none of the recordings and may be written.
///
/// # Errors
/// [`PlotError::SameFile`] if the file is one of the recordings; [`PlotError::File`] if it exists and may not be
/// replaced.
#[cfg_attr(not(feature = "web"), allow(dead_code, reason = "only the page uses it"))]
pub fn check_other(output: &OutputFile, recordings: &[&Path]) -> Result<(), PlotError> {
    check_same(output.file, output.option, recordings)?;
    Ok(output.check()?)
}

fn check_same(file: &Path, option: &'static str, recordings: &[&Path]) -> Result<(), PlotError> {
    if recordings.iter().any(|recording| is_same_file(file, recording)) {
        return Err(PlotError::SameFile { file: file.to_owned(), option });
    }
    Ok(())
}

/// The file of a picture, which was [checked](check).
#[derive(Clone, Copy, Debug)]
pub struct Picture<'a> {
    output: OutputFile<'a>,
    format: Format,
}

impl Picture<'_> {
    /// Writes the picture.
    ///
    /// # Errors
    /// The picture cannot be drawn, or the file cannot be written.
    pub fn save(&self, sheet: &Sheet) -> Result<(), PlotError> {
        Ok(self.output.write(&self.format.write(sheet)?)?)
    }
}

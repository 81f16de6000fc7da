//! Reads which files the folder of a program contains.

use std::fs;
use std::io;
use std::path::Path;

use ecmsk::machine::printable;

use crate::image::Image;

/// The file name of the drop-in library.
pub const LIBRARY: &str = "NEXTWUSBLib.dll";
/// The prefix of the file names of the .NET assemblies for the library.
const ASSEMBLY: &str = "NEXTWUSB_dotNET";
/// The sub-folders that may contain the library for 32 and for 64 bits.
const FOLDERS: [&str; 2] = ["x86", "x64"];

/// A program or a .NET assembly in the folder.
pub struct Entry {
    /// The name of the file, with control characters replaced.
    pub name: String,
    /// The content of the file, or why it cannot be read.
    pub image: Result<Image, String>,
}

/// A NEXTWUSBLib.dll in the folder, or in a sub-folder for one width (32 or 64 bits).
pub struct Library {
    /// The path of the file relative to the folder, for messages.
    pub name: String,
    /// The sub-folder that contains the library, `x86` or `x64`; `None` if the library is in the folder of the
    /// programs.
    pub folder: Option<&'static str>,
    /// The content of the file, or why it cannot be read.
    pub image: Result<Image, String>,
}

/// The contents of a folder. Names are compared case-insensitively, as on Windows.
pub struct Contents {
    pub programs: Vec<Entry>,
    /// DLLs with the same name as a program, each with this name. For .NET 5 and later, `press.dll` contains the code,
    /// and `press.exe` only starts it.
    pub others: Vec<(String, Entry)>,
    pub libraries: Vec<Library>,
    pub assemblies: Vec<Entry>,
}

impl Contents {
    /// Reads the programs, libraries and assemblies in a folder.
    pub fn of(folder: &Path) -> io::Result<Self> {
        let names = names(folder)?;
        let entry = |name: &String| Entry { name: printable(name), image: look(&folder.join(name)) };
        let ends = |name: &str, end: &str| name.to_ascii_lowercase().ends_with(end);
        let programs: Vec<&String> = names.iter().filter(|name| ends(name, ".exe")).collect();
        let stems: Vec<String> = programs.iter().map(|name| stem(name)).collect();
        let others = names.iter().filter(|name| ends(name, ".dll") && stems.contains(&stem(name)));
        let assemblies = names.iter().filter(|name| {
            let begins = name.get(..ASSEMBLY.len()).is_some_and(|start| start.eq_ignore_ascii_case(ASSEMBLY));
            begins && ends(name, ".dll")
        });
        let mut libraries: Vec<Library> = library(folder, None).into_iter().collect();
        for width in FOLDERS {
            let inside = names.iter().find(|name| name.eq_ignore_ascii_case(width));
            libraries.extend(inside.and_then(|inside| library(&folder.join(inside), Some(width))));
        }
        Ok(Self {
            others: others.map(|name| (stem(name), entry(name))).collect(),
            assemblies: assemblies.map(entry).collect(),
            programs: programs.into_iter().map(entry).collect(),
            libraries,
        })
    }
}

/// The company and the version of a file as text, from its version resource.
pub fn whose(image: &Image) -> String {
    let whose = match &image.company {
        _ if image.is_ours() => "this project's".to_owned(),
        Some(company) => format!("by {company}"),
        None => "by nobody who is named".to_owned(),
    };
    image.version.as_ref().map_or_else(|| whose.clone(), |version| format!("{whose}, version {version}"))
}

/// A file name in lower case, without its extension.
pub fn stem(name: &str) -> String {
    let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
    stem.to_ascii_lowercase()
}

fn library(folder: &Path, width: Option<&'static str>) -> Option<Library> {
    let name = names(folder).ok()?.into_iter().find(|name| name.eq_ignore_ascii_case(LIBRARY))?;
    let image = look(&folder.join(&name));
    let name = width.map_or_else(|| printable(&name), |width| format!("{width}\\{}", printable(&name)));
    Some(Library { name, folder: width, image })
}

/// The file names in a folder, sorted. Names that are not valid Unicode are left out, since Windows programs have none.
fn names(folder: &Path) -> io::Result<Vec<String>> {
    let mut names = Vec::new();
    for entry in fs::read_dir(folder)? {
        names.extend(entry?.file_name().into_string());
    }
    names.sort();
    Ok(names)
}

fn look(file: &Path) -> Result<Image, String> {
    // Only regular files are opened, since opening a pipe would block until its other end is opened.
    if !fs::metadata(file).is_ok_and(|data| data.is_file()) {
        return Err("it is no file".to_owned());
    }
    Image::read(file).map_err(|error| error.to_string())
}

//! Files that verbs write because an option names them.
//!
//! A file that exists is replaced only if it is of the kind that the verb writes, such as a page or test results: a
//! test that runs each night writes the same names again. Any other file, such as a machine file or a recording, stays
//! unless `--overwrite` is given. \[OURS]
//!
//! A file is written under a temporary name in the same folder, and renamed when it is complete. So a full disk, or an
//! error during the write, leaves the old file.

use std::fs::{self, File, Metadata, OpenOptions};
use std::io::{self, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

use ecmsk::bus::eeprom;
use tempfile::{Builder, TempPath};

/// \[OURS] The most bytes of a file that are read to find its kind: more than the longest EEPROM that words of 16 bits reach.
const LOOK_BYTES_MAX: u64 = (2 << 16) + 1;
/// \[OURS] The length of the part of a text in which its kind is found, bytes: the head of a page, the first element of
/// XML.
const HEAD_BYTES_MAX: usize = 4096;
/// The folders whose names stand for files that a process has open. Such a file is written directly and not replaced.
const STREAMS: [&str; 4] = ["/dev/fd", "/dev/stderr", "/dev/stdout", "/proc"];

/// What a verb writes, and so what it may replace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A page for a browser that this tool has made.
    Page,
    /// Results of tests, by whatever program.
    Junit,
    /// A picture as SVG.
    Svg,
    /// A picture as PNG.
    Png,
    /// A report of `ecmsk doctor`.
    Report,
    /// The content of an EEPROM (SII).
    Eeprom,
    /// A slave's description (ESI) that this tool has made.
    Esi,
    /// A file whose content does not show whether it may be replaced: a table, parameters of a drive, a file of a
    /// slave.
    Any,
}

impl Kind {
    /// The name of such a file, for errors: `no ...`.
    const fn words(self) -> &'static str {
        match self {
            Self::Page => "page of ecmsk",
            Self::Junit => "JUnit file",
            Self::Svg => "SVG picture",
            Self::Png => "PNG picture",
            Self::Report => "report of ecmsk",
            Self::Eeprom => "EEPROM of a slave",
            Self::Esi => "ESI file of ecmsk",
            Self::Any => "file",
        }
    }

    /// Whether a file with this content is of the kind.
    fn is(self, content: &[u8]) -> bool {
        let head = String::from_utf8_lossy(&content[..content.len().min(HEAD_BYTES_MAX)]).to_ascii_lowercase();
        let head = head.trim_start_matches('\u{FEFF}').trim_start();
        let is_xml = |element: &str| head.starts_with('<') && head.contains(&format!("<{element}"));
        match self {
            Self::Page => head.starts_with("<!doctype html") && head.contains(" - ecmsk</title>"),
            Self::Junit => is_xml("testsuite"),
            Self::Svg => is_xml("svg") && !head.starts_with("<!doctype html"),
            Self::Png => content.starts_with(b"\x89PNG\r\n\x1a\n"),
            Self::Report => content.starts_with(b"report/") && content.get(257..262) == Some(b"ustar"),
            Self::Eeprom => eeprom::check(content).is_ok(),
            Self::Esi => is_xml("ethercatinfo") && head.contains("<name>ecmsk</name>"),
            Self::Any => false,
        }
    }
}

/// Why a file was not written.
#[derive(Debug, thiserror::Error)]
pub enum OutputFileError {
    /// A file exists that the verb replaces only on request.
    #[error("{} is there already{}; name {}, or {next}", .file.display(), is_no(*.kind), another(.option))]
    There {
        /// The path of the file.
        file: PathBuf,
        /// What the verb writes.
        kind: Kind,
        /// The option that names the file.
        option: &'static str,
        /// What the user can do instead.
        next: &'static str,
    },
    /// The file cannot be written.
    #[error("cannot write {}: {source}; name {}", .file.display(), another(.option))]
    Write {
        /// The path of the file.
        file: PathBuf,
        /// The option that names the file.
        option: &'static str,
        /// The error of the operating system.
        source: io::Error,
    },
}

/// Why an existing file is not replaced, as a part of the error text.
fn is_no(kind: Kind) -> String {
    if kind == Kind::Any { String::new() } else { format!(" and is no {}", kind.words()) }
}

/// The option `--overwrite` of a verb that writes files.
#[derive(clap::Args, Clone, Copy, Debug, Default)]
pub struct OverwriteOption {
    /// Replace a file that is there, also if it is none that this verb writes
    #[arg(long)]
    overwrite: bool,
}

impl OverwriteOption {
    /// Whether the option allows to replace any existing file.
    pub const fn replace(self) -> Replace {
        Replace::Asked(self.overwrite)
    }
}

/// The proposal of another file, as a part of the error text.
fn another(option: &str) -> String {
    if option.is_empty() { "another file".to_owned() } else { format!("another file with {option}") }
}

/// Whether the user allows to replace an existing file of another kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Replace {
    /// The verb has the option `--overwrite`; the field says whether it is given.
    Asked(bool),
    /// The verb has no such option.
    Never,
}

/// A file that a verb is to write.
#[derive(Clone, Copy, Debug)]
pub struct OutputFile<'a> {
    /// The path of the file.
    pub file: &'a Path,
    /// The option that names the file, for errors; empty if the file is an argument without an option.
    pub option: &'static str,
    /// What the verb writes.
    pub kind: Kind,
    /// Whether an existing file of another kind is replaced.
    pub replace: Replace,
}

/// The file that a path names.
enum Place {
    /// A file in a folder: its path, without symbolic links if the file exists, and its present metadata; `None` if
    /// there is no such file yet.
    File(PathBuf, Option<Metadata>),
    /// A pipe, a device, or a file that a process has open, which is written directly.
    Stream,
}

impl OutputFile<'_> {
    /// Checks that the file may be written, before a verb does anything that takes time or moves axes.
    ///
    /// # Errors
    /// [`OutputFileError`] if there is a file that is not replaced.
    pub fn check(&self) -> Result<(), OutputFileError> {
        self.place().map(drop)
    }

    /// Writes the file.
    ///
    /// # Errors
    /// [`OutputFileError`] if there is a file that is not replaced, or if the file cannot be written, which leaves it
    /// as it was.
    pub fn write(&self, content: &[u8]) -> Result<(), OutputFileError> {
        let is_there = matches!(self.place()?, Place::File(_, Some(_)));
        match self.begin() {
            Ok(mut new) => {
                new.file().and_then(|mut file| file.write_all(content)).map_err(|source| self.failed(source))?;
                new.finish()
            }
            // The existing file may be written, but not its folder: the file is overwritten in place.
            Err(OutputFileError::Write { source, .. }) if is_there && source.kind() == ErrorKind::PermissionDenied => {
                fs::write(self.file, content).map_err(|source| self.failed(source))
            }
            Err(error) => Err(error),
        }
    }

    /// Begins to write: makes a temporary file in the folder of the file.
    ///
    /// # Errors
    /// [`OutputFileError`] if there is a file that is not replaced, or if the temporary file cannot be made.
    pub fn begin(&self) -> Result<NewFile<'_>, OutputFileError> {
        let (target, old) = match self.place()? {
            Place::Stream => {
                return Ok(NewFile { output: self, beside: None, target: self.file.to_owned(), old: None });
            }
            Place::File(target, old) => (target, old),
        };
        let folder = target.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let name = target.file_name().unwrap_or_default().to_string_lossy();
        let ending = target.extension().map(|ending| format!(".{}", ending.to_string_lossy())).unwrap_or_default();
        let mut builder = Builder::new();
        let prefix = format!("{name}.");
        builder.prefix(&prefix).suffix(&ending);
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // The usual permissions of a new file, from which the umask removes some.
            builder.permissions(fs::Permissions::from_mode(0o666));
        }
        let beside = builder.tempfile_in(folder).map_err(|error| self.failed(system_error(error)))?;
        Ok(NewFile { output: self, beside: Some(beside.into_temp_path()), target, old })
    }

    fn place(&self) -> Result<Place, OutputFileError> {
        let failed = |source| self.failed(source);
        match self.file.symlink_metadata() {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Place::File(self.file.to_owned(), None)),
            found => found.map_err(failed)?,
        };
        let metadata = self.file.metadata().map_err(|error| match error.kind() {
            ErrorKind::NotFound => failed(io::Error::new(error.kind(), "it is a link to a file that is not there")),
            _ => failed(error),
        })?;
        if !metadata.is_file() || STREAMS.iter().any(|stream| self.file.starts_with(stream)) {
            return Ok(Place::Stream);
        }
        let is_asked = self.replace == Replace::Asked(true) || metadata.len() == 0;
        if !is_asked && !self.is_of_its_kind().map_err(failed)? {
            let next = match self.replace {
                Replace::Asked(_) => "replace it with --overwrite",
                Replace::Never => "remove it",
            };
            let (file, kind, option) = (self.file.to_owned(), self.kind, self.option);
            return Err(OutputFileError::There { file, kind, option, next });
        }
        let target = self.file.canonicalize().map_err(failed)?;
        Ok(Place::File(target, Some(metadata)))
    }

    fn is_of_its_kind(&self) -> io::Result<bool> {
        if self.kind == Kind::Any {
            return Ok(false);
        }
        let mut content = Vec::new();
        File::open(self.file)?.take(LOOK_BYTES_MAX).read_to_end(&mut content)?;
        Ok(self.kind.is(&content))
    }

    /// The error that the file cannot be written.
    pub fn failed(&self, source: io::Error) -> OutputFileError {
        OutputFileError::Write { file: self.file.to_owned(), option: self.option, source }
    }
}

/// A file that is being written. If it is dropped before [`NewFile::finish`], the old file stays.
pub struct NewFile<'a> {
    output: &'a OutputFile<'a>,
    /// The temporary file; `None` for a pipe or a device, which is written directly.
    beside: Option<TempPath>,
    target: PathBuf,
    old: Option<Metadata>,
}

impl NewFile<'_> {
    /// The path to which the content has to be written.
    pub fn path(&self) -> &Path {
        self.beside.as_deref().unwrap_or(&self.target)
    }

    /// Opens [`Self::path`] for writing.
    ///
    /// # Errors
    /// Those of the operating system.
    pub fn file(&mut self) -> io::Result<File> {
        OpenOptions::new().write(true).truncate(true).open(self.path())
    }

    /// Renames the complete file to its final name.
    ///
    /// # Errors
    /// [`OutputFileError`] if that fails; the old file stays then.
    pub fn finish(self) -> Result<(), OutputFileError> {
        let Self { output, beside, target, old } = self;
        let Some(beside) = beside else { return Ok(()) };
        let is_new = old.is_none() && output.replace != Replace::Asked(true);
        complete(&beside, old.as_ref()).map_err(|source| output.failed(source))?;
        let placed =
            if is_new { place_new(beside, &target) } else { beside.persist(&target).map_err(|error| error.error) };
        placed.map_err(|source| output.failed(source))
    }
}

/// Renames a temporary file to a name that does not exist yet.
fn place_new(beside: TempPath, target: &Path) -> io::Result<()> {
    match beside.persist_noclobber(target) {
        Ok(()) => Ok(()),
        Err(error) if error.error.kind() == ErrorKind::AlreadyExists => Err(error.error),
        // Some file systems cannot rename a file without replacing another.
        Err(error) => error.path.persist(target).map_err(|error| error.error),
    }
}

/// Flushes the file to disk, and gives it the owner and the permissions of the file that it replaces.
fn complete(beside: &Path, old: Option<&Metadata>) -> io::Result<()> {
    let file = OpenOptions::new().write(true).open(beside)?;
    if let Some(old) = old {
        #[cfg(unix)]
        {
            use std::os::unix::fs::{MetadataExt, fchown};
            let own = file.metadata()?;
            if (own.uid(), own.gid()) != (old.uid(), old.gid()) {
                // Only root may change the owner; without that the file is written all the same.
                let _ = fchown(&file, Some(old.uid()), Some(old.gid()));
            }
        }
        file.set_permissions(old.permissions())?;
    }
    file.sync_all()
}

/// The error of the operating system, without the name of the temporary file.
fn system_error(error: io::Error) -> io::Error {
    let inner = error.get_ref().and_then(|error| error.source()).and_then(|error| error.downcast_ref::<io::Error>());
    inner.and_then(io::Error::raw_os_error).map(io::Error::from_raw_os_error).unwrap_or(error)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::junit;
    use crate::markup::page;

    fn junit_file(file: &Path, replace: Replace) -> OutputFile<'_> {
        OutputFile { file, option: "--junit", kind: Kind::Junit, replace }
    }

    fn names(folder: &Path) -> Vec<String> {
        let name = |entry: io::Result<fs::DirEntry>| entry.unwrap().file_name().into_string().unwrap();
        let mut names: Vec<String> = fs::read_dir(folder).unwrap().map(name).collect();
        names.sort();
        names
    }

    /// A file is replaced by one of its kind; other files stay, unless replacing them is requested.
    #[test]
    fn files_are_replaced_by_their_kind() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("found.xml");
        let results = junit::text("nightly", &[]);
        let write = |replace| junit_file(&file, replace).write(results.as_bytes());
        write(Replace::Never).unwrap();
        write(Replace::Never).unwrap();
        for other in ["", "<?xml version=\"1.0\"?><testsuites name=\"pytest tests\"/>"] {
            fs::write(&file, other).unwrap();
            write(Replace::Asked(false)).unwrap();
            assert_eq!(fs::read_to_string(&file).unwrap(), results);
        }
        for other in ["format = 1\n", "<svg/>", "\0", &page("a title", "text")] {
            fs::write(&file, other).unwrap();
            let error = write(Replace::Asked(false)).unwrap_err().to_string();
            let said = "found.xml is there already and is no JUnit file; name another file with --junit, or replace it with \
                        --overwrite";
            assert!(error.ends_with(said), "{error}");
            assert!(write(Replace::Never).unwrap_err().to_string().ends_with(", or remove it"));
            assert_eq!(fs::read_to_string(&file).unwrap(), other);
        }
        write(Replace::Asked(true)).unwrap();
        assert_eq!((fs::read_to_string(&file).unwrap(), names(folder.path())), (results, vec!["found.xml".to_owned()]));
    }

    /// Each kind knows its own files, and no other.
    #[test]
    fn kinds_differ() {
        let mut report = vec![0; 512];
        report[..20].copy_from_slice(b"report/CONTENTS.txt\0");
        report[257..262].copy_from_slice(b"ustar");
        let esi = "<?xml version=\"1.0\"?>\n<EtherCATInfo>\n <Vendor><Id>#x1</Id><Name>ecmsk</Name></Vendor>";
        let svg = "<?xml version=\"1.0\"?>\n<svg width=\"9\">";
        let contents: [(Kind, Vec<u8>); 6] = [
            (Kind::Page, page("a <svg title", "<svg></svg>").into()),
            (Kind::Junit, junit::text("a suite", &[]).into()),
            (Kind::Svg, svg.into()),
            (Kind::Png, b"\x89PNG\r\n\x1a\n\0\0".to_vec()),
            (Kind::Report, report),
            (Kind::Esi, esi.into()),
        ];
        for (kind, content) in &contents {
            for (other, _) in &contents {
                assert_eq!(other.is(content), other == kind, "{other:?} {kind:?}");
            }
            assert!(!Kind::Any.is(content) && !Kind::Eeprom.is(content));
        }
        assert!(!Kind::Page.is(b"<!DOCTYPE html>\n<title>Our press</title>"));
        assert!(!Kind::Esi.is(esi.replace("ecmsk", "Maker").as_bytes()));
    }

    /// A file whose write is not finished leaves the old file, and no temporary file.
    #[test]
    fn what_is_not_finished_changes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("found.xml");
        fs::write(&file, "old").unwrap();
        let output = junit_file(&file, Replace::Asked(true));
        let mut new = output.begin().unwrap();
        new.file().unwrap().write_all(b"half").unwrap();
        assert!(new.path() != file && new.path().extension() == file.extension());
        drop(new);
        assert_eq!(
            (fs::read_to_string(&file).unwrap(), names(folder.path())),
            ("old".into(), vec!["found.xml".to_owned()])
        );
        // A file that another program has created meanwhile is kept, too.
        fs::remove_file(&file).unwrap();
        let output = junit_file(&file, Replace::Asked(false));
        let new = output.begin().unwrap();
        fs::write(&file, "another's").unwrap();
        assert!(new.finish().is_err() && fs::read_to_string(&file).unwrap() == "another's");
        let missing = folder.path().join("no").join("found.xml");
        let error = junit_file(&missing, Replace::Never).write(b"").unwrap_err().to_string();
        assert!(error.contains("o such file") && error.ends_with("; name another file with --junit"), "{error}");
    }

    /// A symbolic link leads to its target, which keeps its permissions. A link to a missing file makes no file. A pipe
    /// is written directly.
    #[cfg(unix)]
    #[test]
    fn links_and_pipes_are_followed_with_care() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let folder = tempfile::tempdir().unwrap();
        let [file, link, nowhere, victim, pipe] =
            ["found.xml", "link.xml", "nowhere.xml", "victim", "pipe"].map(|name| folder.path().join(name));
        fs::write(&file, "").unwrap();
        fs::set_permissions(&file, fs::Permissions::from_mode(0o604)).unwrap();
        symlink(&file, &link).unwrap();
        symlink(&victim, &nowhere).unwrap();
        junit_file(&link, Replace::Asked(false)).write(b"new").unwrap();
        assert!(link.symlink_metadata().unwrap().is_symlink() && fs::read(&file).unwrap() == b"new");
        assert_eq!(file.metadata().unwrap().permissions().mode() & 0o777, 0o604);
        for replace in [Replace::Asked(false), Replace::Asked(true)] {
            let error = junit_file(&nowhere, replace).write(b"new").unwrap_err().to_string();
            assert!(error.contains("a link to a file that is not there") && !victim.exists(), "{error}");
        }
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let reader = std::thread::spawn({
            let pipe = pipe.clone();
            move || fs::read(pipe).unwrap()
        });
        junit_file(&pipe, Replace::Never).write(b"through").unwrap();
        assert_eq!(reader.join().unwrap(), b"through");
    }
}

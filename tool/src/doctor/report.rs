//! `ecmsk doctor --report`: packs the data that the manufacturer's support needs into one file, with a list of what it
//! contains and what is missing.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

use ecmsk::bus;
use ecmsk::link::keys::Scheme;
use ecmsk::link::record::flight::FlightContents;
use ecmsk::link::uri::LinkUri;
use ecmsk::machine::findings::Finding;
use ecmsk::machine_file;
use ecmsk::recording::{RecordMeta, Recording};
use time::OffsetDateTime;
use time::format_description::well_known::Rfc3339;

use super::secrets::Secrets;
use super::{Args, Paint};
use crate::bus::scan;
use crate::link_option::belongs_to_user;
use crate::output_file::{OutputFile, OutputFileError};

/// The largest total size of the flight recorder files in a report, in bytes. \[OURS]
const FLIGHT_BYTES_MAX: u64 = 32 << 20;
/// The largest size of a text in a report, such as the machine file, in bytes. \[OURS]
const TEXT_BYTES_MAX: u64 = 1 << 20;
/// The beginnings of the kernel options that a report contains: those that affect the timing of a cycle. Other options
/// are left out, since they may contain private data.
const KERNEL_OPTIONS: [&str; 12] = [
    "isolcpus",
    "nohz",
    "rcu_nocb",
    "irqaffinity",
    "threadirqs",
    "preempt",
    "idle=",
    "cpuidle",
    "processor.max_cstate",
    "intel_idle",
    "intel_pstate",
    "mitigations",
];
/// The name of the list of contents in the report.
const CONTENTS: &str = "report/CONTENTS.txt";

/// Parses the file name of `--report`. It must end with `.tar`, so that no other file is overwritten by mistake.
pub fn file(text: &str) -> Result<PathBuf, String> {
    let file = PathBuf::from(text);
    if file.extension().is_some_and(|extension| extension == "tar") {
        return Ok(file);
    }
    Err("a name that ends with .tar is needed, e.g. press.tar".to_owned())
}

/// The files of a report, and the list of what it contains and what is missing.
struct Pack {
    secrets: Secrets,
    files: Vec<(String, Vec<u8>)>,
    /// The lines of the list of what the report contains.
    here: Vec<String>,
    /// The lines of the list of what is missing, with the reasons.
    missing: Vec<String>,
}

/// Packs the report. Returns the list of what it contains and what is missing. `link`: the link that would be used.
///
/// # Errors
/// [`OutputFileError`] if the file cannot be written.
pub fn pack(
    file: &OutputFile,
    args: &Args,
    findings: &[Finding],
    link: Option<&LinkUri>,
    system: Option<String>,
) -> Result<String, OutputFileError> {
    let mut pack = Pack { secrets: Secrets::find(link), files: Vec::new(), here: Vec::new(), missing: Vec::new() };
    pack.text("versions.txt", "versions, system, processor, memory, date", &versions(system));
    pack.text("doctor.txt", "what `ecmsk doctor` says", &super::text(findings, Paint(false)));
    pack.text("doctor.json", "the same for programs", &super::lines(findings));
    pack.machine_file();
    match &args.link {
        Some(link) => pack.network(link),
        None => pack.missing.push("the network: no link was named; add --link nic:INTERFACE".to_owned()),
    }
    let flight = args.flight.clone().or_else(|| link?.value("flight").map(PathBuf::from));
    match flight {
        Some(folder) => pack.flight(&folder),
        None => pack.missing.push("frames: no flight recorder was named; add --flight DIR".to_owned()),
    }
    let list = pack.list();
    pack.files.insert(0, (CONTENTS.to_owned(), list.clone().into_bytes()));
    let mut new = file.begin()?;
    new.file().and_then(|there| write(there, &pack.files)).map_err(|source| file.failed(source))?;
    new.finish()?;
    Ok(format!("{}\n{list}", file.file.display()))
}

/// Writes all files into a tar archive.
fn write(there: File, files: &[(String, Vec<u8>)]) -> io::Result<()> {
    // Only the user may read the report, because it describes the machine.
    #[cfg(unix)]
    if there.metadata()?.is_file() {
        use std::os::unix::fs::PermissionsExt;
        there.set_permissions(std::fs::Permissions::from_mode(0o600))?;
    }
    let mut tar = tar::Builder::new(there);
    let now = OffsetDateTime::now_utc().unix_timestamp();
    for (name, bytes) in files {
        let mut header = tar::Header::new_gnu();
        header.set_size(bytes.len() as u64);
        header.set_mode(0o644);
        header.set_mtime(u64::try_from(now).unwrap_or(0));
        tar.append_data(&mut header, name, &**bytes)?;
    }
    tar.into_inner().map(drop)
}

impl Pack {
    /// Adds a text, with its secrets removed.
    fn text(&mut self, name: &str, what: &str, text: &str) {
        let text = self.secrets.without(text);
        self.add(name, what, text.into_bytes());
    }

    /// Adds a binary file, unless it contains a secret. It would be useless with a part removed, so it is then left
    /// out.
    fn bytes(&mut self, name: &str, what: &str, bytes: Vec<u8>) {
        if self.secrets.are_in(&bytes) {
            self.missing.push(format!("{what}: it has a secret"));
        } else {
            self.add(name, what, bytes);
        }
    }

    fn add(&mut self, name: &str, what: &str, bytes: Vec<u8>) {
        self.here.push(format!("{name}: {what}, {} bytes", bytes.len()));
        self.files.push((format!("report/{name}"), bytes));
    }

    fn list(&self) -> String {
        let date = OffsetDateTime::now_utc().format(&Rfc3339).unwrap_or_default();
        let mut list = format!("A report of ecmsk {}, {date}\n\nIn this file:\n", env!("CARGO_PKG_VERSION"));
        // Writing to a String does not fail.
        self.here.iter().for_each(|line| _ = writeln!(list, "  {line}"));
        if !self.missing.is_empty() {
            list.push_str("\nNot in it:\n");
            self.missing.iter().for_each(|line| _ = writeln!(list, "  {}", self.secrets.without(line)));
        }
        list.push_str(
            "\nSecrets of the environment, of links and of files that links name are left out, and what a text calls one.\n",
        );
        list
    }

    fn machine_file(&mut self) {
        let file = Path::new(machine_file::FILE_NAME);
        if !file.is_file() || !belongs_to_user(file, "it is not packed") {
            self.missing.push(format!("the machine file: there is no {} in this folder", machine_file::FILE_NAME));
            return;
        }
        match read(file, TEXT_BYTES_MAX) {
            Ok(bytes) => self.text("machine.toml", "the machine file", &String::from_utf8_lossy(&bytes)),
            Err(error) => self.missing.push(format!("the machine file: {error}")),
        }
    }

    /// Adds the slaves of a network, their EEPROMs and their error counters.
    fn network(&mut self, link: &LinkUri) {
        if matches!(link.scheme(), Scheme::Usb | Scheme::Spi | Scheme::Tcp) {
            self.missing.push(format!(
                "the network: behind a board ({}:) it cannot be looked at; connect its cable to a network card, and name that",
                link.scheme()
            ));
            return;
        }
        if let Err(error) = self.try_network(link) {
            self.missing.push(format!("the network: {error}"));
        }
    }

    fn try_network(&mut self, link: &LinkUri) -> Result<(), bus::BusError> {
        let mut network = bus::open(&link.to_string())?;
        let slaves = network.scan()?;
        let (tree, lines) = scan::shown(&mut *network, &slaves)?;
        self.text("network.txt", "the slaves, their cables and error counters", &tree);
        let lines: String = lines.iter().map(|line| format!("{line}\n")).collect();
        self.text("network.json", "the same for programs", &lines);
        for slave in slaves.iter().map(|slave| slave.slave) {
            let what = format!("the EEPROM of slave {slave}");
            match network.read_eeprom(slave) {
                Ok(content) => self.bytes(&format!("eeprom/slave-{slave:02}.bin"), &what, content),
                Err(error) => self.missing.push(format!("{what}: {error}")),
            }
        }
        Ok(())
    }

    /// Whether the machine file or the link in a recording contains a secret. Also true if the recording cannot be
    /// read, since this is then unknown.
    fn tells_secrets(&self, file: &Path) -> bool {
        let Ok(mut recording) = Recording::open(file) else { return true };
        let mut known = recording.meta().cloned();
        let has_secret = |meta: &RecordMeta| {
            let machine = meta.machine.as_ref().map_or("", |machine| machine.text());
            [&*meta.link, machine].into_iter().any(|text| self.secrets.without(text) != text)
        };
        if known.as_ref().is_some_and(has_secret) {
            return true;
        }
        // A moment may have frames of several links, each with its own metadata.
        while recording.next().is_some() {
            if recording.meta() != known.as_ref() {
                known = recording.meta().cloned();
                if known.as_ref().is_some_and(has_secret) {
                    return true;
                }
            }
        }
        false
    }

    /// Adds the newest moments and segments of a flight recorder, up to [`FLIGHT_BYTES_MAX`].
    fn flight(&mut self, folder: &Path) {
        let contents = match FlightContents::of(folder) {
            Ok(contents) => contents,
            Err(error) => return self.missing.push(format!("frames of {}: {error}", folder.display())),
        };
        let moments = contents.moments.iter().rev().filter_map(|kept| Some((kept.file.as_ref()?, kept.bytes)));
        let segments = contents.segments.iter().rev().map(|segment| (&segment.file, segment.bytes));
        // The order of priority: the newest moment, then the newest segments, then older moments as far as they fit.
        let (newest, older): (Vec<_>, Vec<_>) = (moments.clone().take(1).collect(), moments.skip(1).collect());
        let (mut left, mut left_out) = (FLIGHT_BYTES_MAX, 0_u32);
        for (file, bytes) in newest.into_iter().chain(segments).chain(older) {
            let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
            if bytes > left {
                left_out += 1;
                continue;
            }
            match read(file, left) {
                Ok(_) if self.tells_secrets(file) => self.missing.push(format!(
                    "frames: {name}: the machine file or the link in it has a secret; take it out, and record anew"
                )),
                Ok(content) => {
                    left = left.saturating_sub(content.len() as u64);
                    self.bytes(&format!("flight/{name}"), "frames of the flight recorder", content);
                }
                Err(error) => self.missing.push(format!("frames: {name}: {error}")),
            }
        }
        if left_out > 0 {
            let bound = FLIGHT_BYTES_MAX >> 20;
            self.missing.push(format!("frames: {left_out} older files of {}, beyond {bound} MB", folder.display()));
        }
    }
}

/// Reads a file. A file of more than `bytes_max` bytes is an error.
fn read(file: &Path, bytes_max: u64) -> io::Result<Vec<u8>> {
    let mut content = Vec::new();
    File::open(file)?.take(bytes_max.saturating_add(1)).read_to_end(&mut content)?;
    if content.len() as u64 > bytes_max {
        return Err(io::Error::new(io::ErrorKind::FileTooLarge, format!("it has more than {bytes_max} bytes")));
    }
    Ok(content)
}

fn versions(system: Option<String>) -> String {
    let mut text = format!("ecmsk {}\n", env!("CARGO_PKG_VERSION"));
    let date = OffsetDateTime::now_utc().format(&Rfc3339).unwrap_or_default();
    let cores = std::thread::available_parallelism().map_or(0, usize::from);
    // Writing to a String does not fail.
    let _ = writeln!(text, "date {date}");
    let _ = writeln!(text, "system {}", system.as_deref().unwrap_or(std::env::consts::OS));
    let _ = writeln!(text, "processor {}, {cores} threads", std::env::consts::ARCH);
    for (file, names) in [
        ("/etc/os-release", &["PRETTY_NAME"][..]),
        ("/proc/version", &["Linux version"]),
        ("/proc/cpuinfo", &["model name", "Model"]),
        ("/proc/meminfo", &["MemTotal"]),
    ] {
        let content = read(Path::new(file), TEXT_BYTES_MAX).unwrap_or_default();
        let content = String::from_utf8_lossy(&content);
        for name in names {
            if let Some(line) = content.lines().find(|line| line.starts_with(name)) {
                let _ = writeln!(text, "{file}: {line}");
            }
        }
    }
    let options = read(Path::new("/proc/cmdline"), TEXT_BYTES_MAX).unwrap_or_default();
    let options = String::from_utf8_lossy(&options);
    let named = options.split_whitespace().filter(|word| KERNEL_OPTIONS.iter().any(|option| word.starts_with(option)));
    let _ = writeln!(text, "/proc/cmdline, as far as it is about time: {}", named.collect::<Vec<_>>().join(" "));
    text
}

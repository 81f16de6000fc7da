//! Reads programs and libraries of Windows. No code of them is run, and the tool may run on another system.
//!
//! Source: the PE format of Windows' documentation; ECMA-335 II.25.3.3 for the CLI header.

mod version;

use std::fmt;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use ecmsk::machine::printable;
use object::LittleEndian as LE;
use object::pe::{
    self, ImageCor20Header, ImageDosHeader, ImageNtHeaders32, ImageNtHeaders64, ImageResourceDirectoryEntry,
};
use object::read::pe::{ImageNtHeaders, ResourceDirectory, SectionTable, optional_header_magic};
use object::read::{Error as Unreadable, ReadRef};

/// \[OURS] The largest file that is read, in bytes. Programs are smaller; installers with all their data may be
/// larger.
const FILE_BYTES_MAX: u64 = 256 << 20;
/// The type of a version resource (`RT_VERSION`).
const VERSION: u16 = 16;
/// \[OURS] The most names of exported functions that are read.
const NAMES_MAX: usize = 10_000;

/// The processor for which a PE file is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Width {
    /// x86, 32 bits.
    X86,
    /// x86-64, 64 bits.
    X64,
    /// Another processor, by its number in the PE format.
    Other(u16),
}

impl Width {
    /// The sub-folder of this project's package for libraries of this width; `None` if there are none.
    pub const fn folder(self) -> Option<&'static str> {
        match self {
            Self::X86 => Some("x86"),
            Self::X64 => Some("x64"),
            Self::Other(_) => None,
        }
    }
}

impl fmt::Display for Width {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::X86 => f.write_str("32-bit"),
            Self::X64 => f.write_str("64-bit"),
            Self::Other(0xAA64) => f.write_str("64-bit ARM"),
            Self::Other(machine) => write!(f, "for the processor 0x{machine:04X}"),
        }
    }
}

/// The processor width that the CLI header of a .NET program or assembly requests.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Managed {
    /// Any CPU: it runs with the width of the system.
    Any,
    /// Any CPU, with a preference for 32 bits.
    Prefers32,
    /// The image runs only on the processor that its PE header names.
    Fixed,
}

/// A PE file: the facts about it, and its bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// The processor and width (32 or 64 bits) with which a 64-bit Windows runs the file: those of the PE header,
    /// except for a .NET program without a fixed width.
    pub width: Width,
    /// The request of the CLI header; `None` if the file is not for .NET.
    pub managed: Option<Managed>,
    /// The company in its version resource, with control characters replaced.
    pub company: Option<String>,
    /// The product in its version resource, with control characters replaced.
    pub product: Option<String>,
    /// The version in its version resource.
    pub version: Option<String>,
    /// The names of its exported functions.
    pub exports: Vec<String>,
    /// The content of the whole file, for [`Self::names`].
    bytes: Vec<u8>,
}

/// Why a file is not a valid PE file.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// The file cannot be read.
    #[error("it cannot be read: {0}")]
    Io(#[from] io::Error),
    /// The file is larger than any program.
    #[error("it is longer than {} MiB, too long for a program", FILE_BYTES_MAX >> 20)]
    TooLong,
    /// The file has another format or is damaged.
    #[error("it is no program or library of Windows, or a broken one ({0})")]
    Broken(#[from] Unreadable),
    /// The file is shorter than its headers say.
    #[error("it is a broken program or library of Windows (its {0} is cut off)")]
    Cut(&'static str),
}

impl Image {
    /// Reads and parses a PE file.
    ///
    /// # Errors
    /// [`ImageError`], whose text contains no next step.
    pub fn read(file: &Path) -> Result<Self, ImageError> {
        let mut bytes = Vec::new();
        File::open(file)?.take(FILE_BYTES_MAX + 1).read_to_end(&mut bytes)?;
        if bytes.len() as u64 > FILE_BYTES_MAX {
            return Err(ImageError::TooLong);
        }
        Self::parse(bytes)
    }

    fn parse(bytes: Vec<u8>) -> Result<Self, ImageError> {
        match optional_header_magic(&bytes[..])? {
            pe::IMAGE_NT_OPTIONAL_HDR64_MAGIC => Self::of::<ImageNtHeaders64>(bytes),
            _ => Self::of::<ImageNtHeaders32>(bytes),
        }
    }

    fn of<Headers: ImageNtHeaders>(bytes: Vec<u8>) -> Result<Self, ImageError> {
        let data = &bytes[..];
        let mut at = ImageDosHeader::parse(data)?.nt_headers_offset().into();
        let (headers, directories) = Headers::parse(data, &mut at)?;
        let sections = headers.sections(data, at)?;
        // A truncated file has the headers of a complete one, so each section is checked to be inside the file.
        for section in sections.iter() {
            section.pe_data(data)?;
        }
        let mut managed = None;
        let mut width = match headers.file_header().machine.get(LE) {
            pe::IMAGE_FILE_MACHINE_I386 => Width::X86,
            pe::IMAGE_FILE_MACHINE_AMD64 => Width::X64,
            other => Width::Other(other.0),
        };
        if let Some(directory) = directories.get(pe::IMAGE_DIRECTORY_ENTRY_COM_DESCRIPTOR)
            && directory.virtual_address.get(LE) != 0
        {
            let header = directory.data(data, &sections)?;
            let header = header.read_at::<ImageCor20Header>(0).map_err(|()| ImageError::Cut("CLI header"))?;
            let flags = header.flags.get(LE).0;
            let has = |flag: pe::CorFlags| flags & flag.0 != 0;
            managed = Some(match width {
                Width::X86 if has(pe::COMIMAGE_FLAGS_32BITREQUIRED) && has(pe::COMIMAGE_FLAGS_32BITPREFERRED) => {
                    Managed::Prefers32
                }
                Width::X86 if has(pe::COMIMAGE_FLAGS_ILONLY) && !has(pe::COMIMAGE_FLAGS_32BITREQUIRED) => Managed::Any,
                _ => Managed::Fixed,
            });
            if managed == Some(Managed::Any) {
                width = Width::X64;
            }
        }

        // Export table and version resource may be invalid, as in packed files; Windows loads such files as well.
        let table = directories.export_table(data, &sections).ok().flatten();
        let exports = table.map_or_else(Vec::new, |table| {
            let names = table.name_iter().take(NAMES_MAX).filter_map(|(name, _)| table.name_from_pointer(name).ok());
            names.map(|name| String::from_utf8_lossy(name).into_owned()).collect()
        });
        let resources = directories.resource_directory(data, &sections).ok().flatten();
        let resource = resources.and_then(|resources| version_resource(resources, data, &sections));
        let text = |name: &str| {
            let text = printable(version::text(resource?, name)?.trim());
            (!text.is_empty()).then_some(text)
        };
        let (company, product, version) = (text("CompanyName"), text("ProductName"), text("FileVersion"));
        Ok(Self { width, managed, company, product, version, exports, bytes })
    }

    /// Whether the file is a library or assembly of this project, in any version. The company alone does not show it: the
    /// assemblies have that of the vendor's assemblies.
    pub fn is_ours(&self) -> bool {
        let named = [&self.company, &self.product].into_iter().any(|text| text.as_deref() == Some("ecmsk"));
        named || self.exports.iter().any(|name| name == "ecmsk_last_error")
    }

    /// Whether the file contains a name anywhere, as a program contains the names of its libraries: in UTF-8 or
    /// UTF-16, in any case of ASCII letters.
    pub fn names(&self, name: &str) -> bool {
        let wide: Vec<u8> = name.bytes().flat_map(|byte| [byte, 0]).collect();
        [name.as_bytes(), &wide].into_iter().any(|name| contains(&self.bytes, name))
    }
}

fn contains(bytes: &[u8], name: &[u8]) -> bool {
    bytes.windows(name.len()).any(|window| window.eq_ignore_ascii_case(name))
}

/// The bytes of the first version resource of the file, in the first language that it has.
fn version_resource<'data>(
    resources: ResourceDirectory<'data>,
    data: &'data [u8],
    sections: &SectionTable<'data>,
) -> Option<&'data [u8]> {
    let of_kind = |entry: &&ImageResourceDirectoryEntry| entry.name_or_id().id() == Some(VERSION);
    let mut entry = resources.root().ok()?.entries.iter().find(of_kind)?;
    // Below the resource type are the levels of names and of languages. The first entry of each is taken.
    for _ in 0..2 {
        entry = entry.data(resources).ok()?.table()?.entries.first()?;
    }
    let there = entry.data(resources).ok()?.data()?;
    sections.pe_data_at(data, there.offset_to_data.get(LE))?.get(..there.size.get(LE) as usize)
}

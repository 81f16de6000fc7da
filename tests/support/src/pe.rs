//! Programs and libraries of Windows, made byte by byte from the PE format as Windows' documentation has it: only the
//! parts that identify a file. They cannot be run.

/// x86.
pub const X86: u16 = 0x014C;
/// x86-64.
pub const X64: u16 = 0x8664;
/// ARM64.
pub const ARM64: u16 = 0xAA64;

/// `COMIMAGE_FLAGS_ILONLY`, `_32BITREQUIRED` and `_32BITPREFERRED` (ECMA-335 II.25.3.3.1 and corhdr.h).
pub const IL_ONLY: u32 = 0x1;
pub const REQUIRES_32: u32 = 0x2;
pub const PREFERS_32: u32 = 0x2_0000;

/// The place of the only section, in the file and in memory.
const FILE_AT: u32 = 0x200;
const MEMORY_AT: u32 = 0x1000;
/// Entries of the data directory.
const EXPORT: usize = 0;
const RESOURCE: usize = 2;
const CLR: usize = 14;

/// A file that is being built.
pub struct Pe {
    machine: u16,
    is_dll: bool,
    section: Vec<u8>,
    directory: [(u32, u32); 16],
}

impl Pe {
    pub fn program(machine: u16) -> Self {
        Self { machine, is_dll: false, section: Vec::new(), directory: [(0, 0); 16] }
    }

    pub fn library(machine: u16) -> Self {
        Self { is_dll: true, ..Self::program(machine) }
    }

    /// Adds that text.
    pub fn text(mut self, text: &[u8]) -> Self {
        self.put(text);
        self
    }

    /// Adds that text in UTF-16.
    pub fn wide(self, text: &str) -> Self {
        let wide = utf16(text);
        self.text(&wide)
    }

    /// Makes it a .NET file with these flags in its CLI header.
    pub fn managed(mut self, flags: u32) -> Self {
        let mut header = vec![0; 72];
        header[0] = 72;
        header[4] = 2;
        header[6] = 5;
        header[16..20].copy_from_slice(&flags.to_le_bytes());
        let at = self.put(&header);
        self.directory[CLR] = (at, 72);
        self
    }

    /// Adds exported functions.
    pub fn exports(mut self, names: &[&str]) -> Self {
        let count = names.len() as u32;
        let base = MEMORY_AT + self.next();
        let (functions, pointers, ordinals) = (base + 40, base + 40 + 4 * count, base + 40 + 8 * count);
        // The names come after the tables, the library's own first.
        let mut texts = b"NEXTWUSBLib.dll\0".to_vec();
        let first = ordinals + 2 * count;
        let mut table: Vec<u8> = Vec::new();
        for word in [0, 0, 0, first, 1, count, count, functions, pointers, ordinals] {
            table.extend(word.to_le_bytes());
        }
        for _ in names {
            table.extend(base.to_le_bytes());
        }
        for name in names {
            table.extend((first + texts.len() as u32).to_le_bytes());
            texts.extend([name.as_bytes(), b"\0"].concat());
        }
        for number in 0..count as u16 {
            table.extend(number.to_le_bytes());
        }
        table.extend(texts);
        let length = table.len() as u32;
        let at = self.put(&table);
        self.directory[EXPORT] = (at, length);
        self
    }

    /// Adds a version resource with these texts.
    pub fn version(mut self, texts: &[(&str, &str)]) -> Self {
        let strings: Vec<u8> = texts.iter().flat_map(|(name, text)| padded(string(name, text))).collect();
        let table = part("040904B0", 0, 1, &[], &strings);
        let info = part("StringFileInfo", 0, 1, &[], &padded(table));
        // VS_FIXEDFILEINFO: its signature and no field that is read.
        let mut fixed = vec![0; 52];
        fixed[..4].copy_from_slice(&0xFEEF_04BD_u32.to_le_bytes());
        let whole = part("VS_VERSION_INFO", 52, 0, &fixed, &padded(info));

        let table = |id: u32, to: u32| {
            let mut table = vec![0; 14];
            table.extend(1_u16.to_le_bytes());
            table.extend(id.to_le_bytes());
            table.extend(to.to_le_bytes());
            table
        };
        const BELOW: u32 = 0x8000_0000;
        let mut tree = [table(16, BELOW | 24), table(1, BELOW | 48), table(0x0409, 72)].concat();
        let base = MEMORY_AT + self.next();
        for word in [base + 88, whole.len() as u32, 0, 0] {
            tree.extend(word.to_le_bytes());
        }
        tree.extend(&whole);
        let length = tree.len() as u32;
        let at = self.put(&tree);
        self.directory[RESOURCE] = (at, length);
        self
    }

    pub fn bytes(self) -> Vec<u8> {
        let is_64 = self.machine != X86;
        let mut file = vec![0; 0x40];
        file[..2].copy_from_slice(b"MZ");
        file[0x3C] = 0x40;
        file.extend(b"PE\0\0");
        // File header: machine, one section, no time, no symbols.
        file.extend(self.machine.to_le_bytes());
        file.extend(1_u16.to_le_bytes());
        file.extend([0; 12]);
        file.extend(if is_64 { 240_u16 } else { 224 }.to_le_bytes());
        file.extend(if self.is_dll { 0x2022_u16 } else { 0x0022 }.to_le_bytes());
        // Optional header, of which the alignments, the sizes and the directory matter.
        let mut optional = vec![0; if is_64 { 112 } else { 96 }];
        let magic: u16 = if is_64 { 0x20B } else { 0x10B };
        let directories = optional.len() - 4;
        let size = MEMORY_AT + 0x1000 * (self.section.len() as u32).div_ceil(0x1000).max(1);
        optional[..2].copy_from_slice(&magic.to_le_bytes());
        for (at, value) in [(32, 0x1000), (36, 0x200), (56, size), (60, FILE_AT), (directories, 16)] {
            optional[at..at + 4].copy_from_slice(&u32::to_le_bytes(value));
        }
        file.extend(optional);
        for (at, length) in self.directory {
            file.extend(at.to_le_bytes());
            file.extend(length.to_le_bytes());
        }
        let mut section = self.section;
        section.resize(section.len().next_multiple_of(0x200).max(0x200), 0);
        file.extend(b".data\0\0\0");
        for word in [section.len() as u32, MEMORY_AT, section.len() as u32, FILE_AT, 0, 0, 0, 0x4000_0040] {
            file.extend(word.to_le_bytes());
        }
        file.resize(FILE_AT as usize, 0);
        file.extend(section);
        file
    }

    /// Appends the bytes, and returns their address in memory.
    fn put(&mut self, bytes: &[u8]) -> u32 {
        let at = self.next();
        self.section.resize(at as usize, 0);
        self.section.extend(bytes);
        MEMORY_AT + at
    }

    fn next(&self) -> u32 {
        self.section.len().next_multiple_of(8) as u32
    }
}

/// This project's library, recognisable by its version resource and its functions.
pub fn ours(machine: u16) -> Vec<u8> {
    let names = ["CloseECMUSB", "ECMUSBRead", "ECMUSBWrite", "OpenECMUSB", "ecmsk_last_error"];
    Pe::library(machine).exports(&names).version(&[("CompanyName", "ecmsk"), ("FileVersion", "0.1.0")]).bytes()
}

/// Another maker's library.
pub fn vendors(machine: u16) -> Vec<u8> {
    let names = ["CloseECMUSB", "ECMUSBRead", "ECMUSBWrite", "OpenECMUSB"];
    Pe::library(machine)
        .exports(&names)
        .version(&[("CompanyName", "Maker Inc."), ("FileVersion", "1, 2, 0, 3")])
        .bytes()
}

fn string(name: &str, text: &str) -> Vec<u8> {
    let units = text.encode_utf16().count() as u16 + 1;
    part(name, units, 1, &[utf16(text), vec![0, 0]].concat(), &[])
}

/// A node of VS_VERSIONINFO.
fn part(name: &str, value_length: u16, kind: u16, value: &[u8], inside: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0, 0];
    bytes.extend(value_length.to_le_bytes());
    bytes.extend(kind.to_le_bytes());
    bytes.extend(utf16(name));
    bytes.extend([0, 0]);
    let mut bytes = padded(bytes);
    bytes.extend(value);
    if !inside.is_empty() {
        bytes = padded(bytes);
        bytes.extend(inside);
    }
    let length = bytes.len() as u16;
    bytes[..2].copy_from_slice(&length.to_le_bytes());
    bytes
}

fn padded(mut bytes: Vec<u8>) -> Vec<u8> {
    bytes.resize(bytes.len().next_multiple_of(4), 0);
    bytes
}

fn utf16(text: &str) -> Vec<u8> {
    text.encode_utf16().flat_map(u16::to_le_bytes).collect()
}

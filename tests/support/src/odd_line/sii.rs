//! The content of an EEPROM.

/// A PDO: its index, its sync manager, and its entries with their lengths in bits.
pub type Pdo<'a> = (u16, u8, &'a [(u16, u8, u8)]);

/// A sync manager: its start, length, control byte, enable byte and type.
pub type Manager = (u16, u16, u8, u8, u8);

/// The CRC-8 over the first 14 bytes: polynomial 0x07, from 0xFF on.
pub fn checksum(bytes: &[u8]) -> u8 {
    bytes.iter().take(14).fold(0xFF, |crc, byte| {
        (0..8).fold(crc ^ byte, |crc: u8, _| if crc & 0x80 != 0 { crc << 1 ^ 0x07 } else { crc << 1 })
    })
}

/// A builder of an EEPROM's content, category by category.
pub struct Content(Vec<u8>);

impl Content {
    /// The fixed words, with vendor 0x1234, product 0x5678: mailboxes of 128 bytes, these protocols (0: no mailbox).
    pub fn new(protocols: u16) -> Self {
        let mut bytes = vec![0; 128];
        let mut put = |word: usize, value: u16| bytes[2 * word..2 * word + 2].copy_from_slice(&value.to_le_bytes());
        put(0x00, 0x0005);
        put(0x08, 0x1234);
        put(0x0A, 0x5678);
        put(0x0C, 1);
        if protocols != 0 {
            for (word, value) in (0x18..).zip([0x1000, 128, 0x1080, 128]) {
                put(word, value);
            }
        }
        put(0x1C, protocols);
        put(0x3E, 15);
        put(0x3F, 1);
        Self(bytes).summed()
    }

    /// Sets a word, and the checksum to match.
    pub fn word(mut self, word: usize, value: u16) -> Self {
        self.0[2 * word..2 * word + 2].copy_from_slice(&value.to_le_bytes());
        self.summed()
    }

    fn summed(mut self) -> Self {
        self.0[14] = checksum(&self.0);
        self
    }

    /// A category.
    pub fn category(mut self, kind: u16, data: &[u8]) -> Self {
        let len = data.len().div_ceil(2);
        self.0.extend(kind.to_le_bytes());
        self.0.extend((len as u16).to_le_bytes());
        self.0.extend(data);
        self.0.resize(self.0.len() + 2 * len - data.len(), 0);
        self
    }

    /// Appends raw bytes.
    pub fn raw(mut self, bytes: &[u8]) -> Self {
        self.0.extend(bytes);
        self
    }

    pub fn strings(self, strings: &[&[u8]]) -> Self {
        let mut data = vec![strings.len() as u8];
        for string in strings {
            data.push(string.len() as u8);
            data.extend(*string);
        }
        self.category(10, &data)
    }

    /// A general category with the number of the name's string.
    pub fn general(self, name: u8) -> Self {
        let mut data = [0; 32];
        data[2] = 1;
        data[3] = name;
        // SDO, SDO information, PDO assignment and configuration.
        data[5] = 0x0F;
        self.category(30, &data)
    }

    pub fn fmmus(self, uses: &[u8]) -> Self {
        self.category(40, uses)
    }

    /// Sync managers.
    pub fn managers(self, managers: &[Manager]) -> Self {
        let mut data = Vec::new();
        for (start, len, control, enable, kind) in managers {
            data.extend(start.to_le_bytes());
            data.extend(len.to_le_bytes());
            data.extend([*control, 0, *enable, *kind]);
        }
        self.category(41, &data)
    }

    /// TxPDOs (50) or RxPDOs (51).
    pub fn pdos(self, kind: u16, pdos: &[Pdo<'_>]) -> Self {
        let mut data = Vec::new();
        for (index, manager, entries) in pdos {
            data.extend(index.to_le_bytes());
            data.extend([entries.len() as u8, *manager, 0, 0, 0, 0]);
            for (index, sub, bits) in *entries {
                data.extend(index.to_le_bytes());
                data.extend([*sub, 0, 0, *bits, 0, 0]);
            }
        }
        self.category(kind, &data)
    }

    /// The bytes, with the end of the categories, in an EEPROM of 2 KiB.
    pub fn end(self) -> Vec<u8> {
        let mut bytes = self.raw(&[0xFF; 4]).0;
        bytes.resize(2048, 0xFF);
        bytes
    }

    /// The bytes without an end.
    pub fn bytes(self) -> Vec<u8> {
        self.0
    }
}

/// The sync managers of a drive, with their types.
pub const MANAGERS: [Manager; 4] =
    [(0x1000, 128, 0x26, 1, 1), (0x1080, 128, 0x22, 1, 2), (0x1100, 6, 0x64, 1, 3), (0x1180, 10, 0x20, 1, 4)];

/// The EEPROM of a drive with these sync managers; `None`: without that category.
pub fn drive(managers: Option<&[Manager]>) -> Vec<u8> {
    let content = Content::new(0x000C).strings(&[b"ODD", b"an odd drive"]).general(2).fmmus(&[1, 2, 3, 0]);
    match managers {
        Some(managers) => content.managers(managers),
        None => content,
    }
    .end()
}

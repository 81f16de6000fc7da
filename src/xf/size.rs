//! n, the size of the data segment: 32 to 1408 bytes, the same in both directions until it is changed.

/// The size n of a packet's data segment in bytes, 32..=1408 (XF EN 182). A host that does not know n finds it with
/// [`Resync`](super::Resync), reads it with SPI_PACK_SIZE_GET and changes it with SPI_RECONFIG_OP.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct DataSize(u16);

impl DataSize {
    /// 32 bytes, the minimum.
    pub const MIN: Self = Self(32);
    /// 1408 bytes, the maximum.
    pub const MAX: Self = Self(1408);
    /// 112 bytes: the size of an ECM-XF at power-on according to the manuals.
    pub const MANUAL: Self = Self(112);
    /// 1024 bytes: the size at power-on with newer firmware (OBS).
    pub const NEWER: Self = Self(1024);
    /// 992 bytes: the only size of an ECM-XFU, so that a packet is one USB packet of 1024 bytes (XF EN 715).
    pub const XFU: Self = Self(992);

    /// The size of `n` bytes; `None` unless `n` is 32..=1408.
    pub const fn new(n: usize) -> Option<Self> {
        if n >= Self::MIN.bytes() && n <= Self::MAX.bytes() { Some(Self(n as u16)) } else { None }
    }

    /// The size of the data segment of a packet of `len` bytes; `None` unless `len` is 64..=1440.
    pub const fn of_packet(len: usize) -> Option<Self> {
        match len.checked_sub(super::HEADER_LEN + super::TRAILER_LEN) {
            Some(n) => Self::new(n),
            None => None,
        }
    }

    /// Size of the data segment in bytes: n.
    pub const fn bytes(self) -> usize {
        self.0 as usize
    }

    /// Size of a whole packet in bytes: n + 32.
    pub const fn packet_len(self) -> usize {
        super::HEADER_LEN + self.bytes() + super::TRAILER_LEN
    }

    /// The size in bytes as a u16, as in the length field of SPI_RECONFIG_OP.
    pub const fn get(self) -> u16 {
        self.0
    }
}

//! Reads the recording of an ECM-XF, packet by packet.

use std::io::Read;

use super::error::RecordError;
use super::file_formats::container::{Blocks, Item};
use super::file_formats::exchange;
use super::lacks::Lacks;
use super::meta::RecordMeta;
use crate::sk::Dir;

/// The bytes of one direction of an exchange.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordedBytes {
    /// The time in nanoseconds: since 1970-01-01, or on a virtual clock.
    pub at_ns: u64,
    /// The direction; [`Dir::Write`] is to the chip.
    pub dir: Dir,
    /// The bytes of this direction.
    pub bytes: Vec<u8>,
}

/// An iterator over the exchanges in a recording of a chip, in the order of the file: for each the bytes to the chip,
/// then those from it. It ends after an error.
pub struct Exchanges<R> {
    blocks: Blocks<R>,
    meta: Option<RecordMeta>,
    lacks: Lacks,
    /// Whether the recorder of this crate wrote the current section, and its end has not been read yet.
    unended: bool,
    /// The time in the file from which times count, ns; `None` before the first packet.
    zero_ns: Option<u64>,
    ended: bool,
}

/// Whether a file that begins with these bytes is the recording of a chip. A few hundred bytes are enough.
pub fn is_of_chip(beginning: &[u8]) -> bool {
    let mut blocks = Blocks::new(beginning, String::new());
    loop {
        match blocks.next() {
            Ok(Some(Item::Interface(link_type))) => return link_type == exchange::LINK_TYPE,
            Ok(Some(Item::Section(..))) => {}
            _ => return false,
        }
    }
}

impl<R: Read> Exchanges<R> {
    /// Reads a recording from any source. `name` is its name in messages.
    ///
    /// # Errors
    /// [`RecordError`] if the beginning is not that of a recording.
    pub fn new(source: R, name: &str) -> Result<Self, RecordError> {
        let blocks = Blocks::new(source, name.to_owned());
        let lacks = Lacks::default();
        let mut exchanges = Self { blocks, meta: None, lacks, unended: false, zero_ns: None, ended: false };
        exchanges.step()?;
        Ok(exchanges)
    }

    /// The metadata in the header. If a file has several recordings, these are the metadata of the last packet read.
    /// `None` if the file has none.
    pub const fn meta(&self) -> Option<&RecordMeta> {
        self.meta.as_ref()
    }

    /// The time in the file from which times count, ns: see [`RecordMeta::zero_ns`]. `None` before the first packet was
    /// read.
    pub const fn zero_ns(&self) -> Option<u64> {
        self.zero_ns
    }

    /// What is missing in the recording, as far as it was read. Complete only after the last packet.
    pub fn lacks(&self) -> Lacks {
        self.lacks.clone().since(self.zero_ns, self.meta.as_ref())
    }

    /// Reads one block: `None` at the end of the file, `Some(None)` if the block has no bytes of an exchange.
    fn step(&mut self) -> Result<Option<Option<RecordedBytes>>, RecordError> {
        let Some(item) = self.blocks.next()? else {
            self.lacks.not_ended += u64::from(std::mem::take(&mut self.unended));
            return Ok(None);
        };
        Ok(Some(match item {
            Item::Section(meta, ours) => {
                self.lacks.not_ended += u64::from(std::mem::replace(&mut self.unended, ours && meta.is_some()));
                self.meta = meta;
                None
            }
            Item::Packet(packet) if packet.link_type == exchange::LINK_TYPE => {
                let at_ns = packet.at_ns;
                self.zero_ns.get_or_insert_with(|| RecordMeta::zero_ns(self.meta.as_ref(), at_ns));
                exchange::parse(packet.data).map(|(dir, bytes)| RecordedBytes { at_ns, dir, bytes: bytes.to_vec() })
            }
            Item::Counts { missing, why } => {
                self.unended = false;
                self.lacks.missing = self.lacks.missing.saturating_add(missing);
                self.lacks.why = why.or_else(|| self.lacks.why.take());
                None
            }
            Item::Lost(lost) => {
                self.lacks.damage.add(lost);
                None
            }
            Item::Interface(_) | Item::Packet(_) | Item::Other => None,
        }))
    }
}

impl<R: Read> Iterator for Exchanges<R> {
    type Item = Result<RecordedBytes, RecordError>;

    fn next(&mut self) -> Option<Self::Item> {
        while !self.ended {
            match self.step() {
                Ok(Some(Some(bytes))) => return Some(Ok(bytes)),
                Ok(Some(None)) => {}
                Ok(None) => self.ended = true,
                Err(error) => {
                    self.ended = true;
                    return Some(Err(error));
                }
            }
        }
        None
    }
}

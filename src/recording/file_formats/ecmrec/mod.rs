//! Recordings of weeks, `FILE.ecmrec`: blocks of packed and compressed packets, each readable without the others (why:
//! docs/decisions/recordings-of-weeks-are-blocks.md).
//!
//! - `header.rs`: the header and the trailer of each block
//! - `packing.rs`: packets as differences from those before them
//! - `compress.rs`: compression of the contents of a block
//! - `section.rs`: the block that begins a recording, and the one that ends it
//! - `reader.rs`: reads a file block by block, also if it is cut or damaged
//! - `index.rs`: where the blocks are, and which of them are needed for a stretch of time
//!
//! The writer is `src/link/record/blocks.rs`.

pub(crate) mod compress;
pub(crate) mod header;
pub(crate) mod index;
pub(crate) mod packing;
pub(super) mod reader;
pub(crate) mod section;

use std::path::Path;

/// The extension of file names that stands for this format.
pub(crate) const EXTENSION: &str = "ecmrec";

/// Whether a recording to this file has this format: by its extension.
pub(crate) fn is_named(file: &Path) -> bool {
    file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(EXTENSION))
}

//! The bytes of a block, compressed with deflate (RFC 1951).

use miniz_oxide::deflate::core::{
    CompressorOxide, TDEFLFlush, TDEFLStatus, compress, create_comp_flags_from_zip_params,
};
use miniz_oxide::inflate::decompress_to_vec_with_limit;

use super::header::BYTES_MAX;

/// The level of compression: the fastest one. \[OURS] The next levels take several times as long, and save only a tenth
/// of the bytes.
const LEVEL: i32 = 1;
/// The window size of deflate, 15 bits (32 KiB). The minus sign leaves out the header and the checksum of zlib.
const RAW: i32 = -15;

/// Compresses blocks, with the same memory for each.
pub(crate) struct Compressor(Box<CompressorOxide>);

impl Compressor {
    pub fn new() -> Self {
        Self(Box::new(CompressorOxide::new(create_comp_flags_from_zip_params(LEVEL, RAW, 0))))
    }

    /// Stores the compressed bytes in `out`. Returns false if they are not shorter than `bytes`; `out` must then be
    /// ignored.
    pub fn compress(&mut self, bytes: &[u8], out: &mut Vec<u8>) -> bool {
        self.0.reset();
        out.clear();
        out.resize(bytes.len(), 0);
        let (status, _, len) = compress(&mut self.0, bytes, out, TDEFLFlush::Finish);
        out.truncate(len);
        status == TDEFLStatus::Done
    }
}

/// Decompresses the bytes of a block; `None` if the compressed bytes are damaged, or the result does not have `len`
/// bytes.
pub(crate) fn decompress(bytes: &[u8], len: usize) -> Option<Vec<u8>> {
    decompress_to_vec_with_limit(bytes, len.min(BYTES_MAX) + 1).ok().filter(|found| found.len() == len)
}

//! Reads the bytes of a file, from any source, in chunks.

use std::io::{ErrorKind, Read};

use crate::recording::error::RecordError;

/// The number of bytes read at a time. \[OURS]
const CHUNK: usize = 64 * 1024;

/// A file that is read once from its beginning to its end. A part of its bytes is in the memory.
pub(super) struct Input<R> {
    source: R,
    /// The name of the file, for messages.
    name: String,
    buffer: Vec<u8>,
    /// `start`: the index in `buffer` of the next byte to process. `offset`: the offset of the same byte in the file.
    start: usize,
    offset: u64,
}

impl<R: Read> Input<R> {
    pub fn new(source: R, name: String) -> Self {
        Self { source, name, buffer: Vec::new(), start: 0, offset: 0 }
    }

    /// The name of the file, for messages.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The offset in the file of the next byte.
    pub const fn offset(&self) -> u64 {
        self.offset
    }

    /// The bytes from the next one on that are in the memory.
    pub fn bytes(&self) -> &[u8] {
        &self.buffer[self.start..]
    }

    /// Moves the next byte forward by `len` bytes. These bytes must be in the memory.
    pub fn advance(&mut self, len: usize) {
        let len = len.min(self.bytes().len());
        self.start += len;
        self.offset += len as u64;
    }

    /// The last `len` bytes before the next byte. They stay in the memory until more of the file is read.
    pub fn passed(&self, len: usize) -> &[u8] {
        &self.buffer[self.start - len..self.start]
    }

    /// Reads until `len` bytes from the next one on are in the memory. Returns false if the file ends before. Fails if
    /// the file cannot be read.
    pub fn has(&mut self, len: usize) -> Result<bool, RecordError> {
        while self.bytes().len() < len {
            if !self.fill()? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Reads the next chunk into the buffer. Returns whether there was anything left to read. Fails if the file cannot
    /// be read.
    pub fn fill(&mut self) -> Result<bool, RecordError> {
        self.buffer.drain(..self.start);
        self.start = 0;
        let len = self.buffer.len();
        self.buffer.resize(len + CHUNK, 0);
        let read = loop {
            match self.source.read(&mut self.buffer[len..]) {
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                read => break read,
            }
        };
        self.buffer.truncate(len + *read.as_ref().unwrap_or(&0));
        match read {
            Ok(read) => Ok(read > 0),
            Err(error) => Err(RecordError::Io { name: self.name.clone(), message: error.to_string() }),
        }
    }
}

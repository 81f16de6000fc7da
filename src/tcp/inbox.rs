//! Buffers received bytes and splits them into messages.

use super::wire::{HEADER_LEN, MESSAGE_MAX, Message, PAYLOAD_MAX, WireError};

/// The size of the buffer: several messages, so that one receive call takes all that has arrived. \[OURS]
const BUFFER_BYTES: usize = 8 * MESSAGE_MAX;

/// The buffer of received bytes that have not been decoded yet.
pub struct Inbox {
    bytes: Box<[u8]>,
    start: usize,
    end: usize,
}

impl Default for Inbox {
    fn default() -> Self {
        Self { bytes: vec![0; BUFFER_BYTES].into(), start: 0, end: 0 }
    }
}

impl Inbox {
    /// The free part of the buffer, for the next bytes. Never empty if [`next`](Self::next) has returned all complete
    /// messages before.
    pub fn room(&mut self) -> &mut [u8] {
        if self.start > 0 {
            self.bytes.copy_within(self.start..self.end, 0);
            (self.start, self.end) = (0, self.end - self.start);
        }
        &mut self.bytes[self.end..]
    }

    /// Copies as many of these bytes into the buffer as fit; returns the others.
    pub fn fill<'a>(&mut self, bytes: &'a [u8]) -> &'a [u8] {
        let room = self.room();
        let (taken, left) = bytes.split_at(room.len().min(bytes.len()));
        room[..taken.len()].copy_from_slice(taken);
        self.came(taken.len());
        left
    }

    /// Discards all received bytes.
    pub const fn clear(&mut self) {
        (self.start, self.end) = (0, 0);
    }

    /// Adds the next `count` bytes of the free part, which the caller has filled, to the received ones.
    pub const fn came(&mut self, count: usize) {
        self.end += count;
    }

    /// The next complete message; `None` if it has not arrived completely.
    ///
    /// # Errors
    /// [`WireError`] for an invalid message, after which no further ones can be found.
    pub fn next(&mut self) -> Result<Option<Message<'_>>, WireError> {
        let Some(([low, high, kind, zero], payload)) =
            self.bytes[self.start..self.end].split_first_chunk::<HEADER_LEN>()
        else {
            return Ok(None);
        };
        let length = usize::from(u16::from_le_bytes([*low, *high]));
        if length > PAYLOAD_MAX {
            return Err(WireError::Long { found: length });
        }
        if *zero != 0 {
            return Err(WireError::Value { kind: *kind, field: "the byte that is 0", found: (*zero).into() });
        }
        let Some(payload) = payload.get(..length) else { return Ok(None) };
        self.start += HEADER_LEN + length;
        Message::decode(*kind, payload).map(Some)
    }
}

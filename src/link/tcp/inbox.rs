//! Bytes as they come, put together to messages.

use super::wire::{HEADER_LEN, MESSAGE_MAX, Message, PAYLOAD_MAX, WireError};

/// Bytes kept: several messages, so that one look at the socket takes all that is there. \[OURS]
const KEPT: usize = 8 * MESSAGE_MAX;

/// What came and was not looked at yet.
pub struct Inbox {
    bytes: Box<[u8]>,
    start: usize,
    end: usize,
}

impl Default for Inbox {
    fn default() -> Self {
        Self { bytes: vec![0; KEPT].into(), start: 0, end: 0 }
    }
}

impl Inbox {
    /// Where the next bytes go: never empty once [`next`](Self::next) has given every message there is.
    pub fn room(&mut self) -> &mut [u8] {
        if self.start > 0 {
            self.bytes.copy_within(self.start..self.end, 0);
            (self.start, self.end) = (0, self.end - self.start);
        }
        &mut self.bytes[self.end..]
    }

    /// Throws away what came.
    pub const fn clear(&mut self) {
        (self.start, self.end) = (0, 0);
    }

    /// So many bytes of the room came.
    pub const fn came(&mut self, count: usize) {
        self.end += count;
    }

    /// The next whole message; `None` while it is not there.
    ///
    /// # Errors
    /// [`WireError`]: nothing after it means anything.
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

//! The messages between a host and the server. \[OURS]
//!
//! Each message, in either direction, is a head of [`HEAD_LEN`] bytes and a body. The head has the kind (u8), the
//! status (u8) and the length of the body (u16); numbers are little-endian. A request has status 0. Its answer has the
//! same kind; if the request has failed, the status is not 0 and the body is the reason as text. `docs/XF-PORT.md` in
//! the project's repository describes the messages for authors of hosts.

/// The version of this protocol, which the greeting contains.
pub const VERSION: u8 = 1;
/// The first bytes of a greeting's body; [`VERSION`] and [`EXCHANGE_MAX`] as a u16 follow.
pub const MAGIC: [u8; 5] = *b"ECMXF";
/// The length of a message's head, before the body, in bytes.
pub const HEAD_LEN: usize = 4;
/// The maximum number of bytes in an exchange, and so in the body of any message. \[OURS] Twice the longest packet
/// fits, so that one exchange is enough to find the packets and so the chip's data size n. It is also the default limit
/// of Linux' spidev.
pub const EXCHANGE_MAX: usize = 4096;
/// The longest wait that a request may ask for, microseconds. \[OURS]
pub const WAIT_MAX_US: u32 = 1_000_000;

/// The kind of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Kind {
    /// From the server, when a connection begins.
    Greeting = 0,
    /// Bytes to the chip, 1 to [`EXCHANGE_MAX`], under one chip select; the answer has as many bytes from the chip.
    Exchange = 1,
    /// Waits for INT0 to become active after the last exchange, at most the given microseconds (u32). The answer is 1
    /// if it became active, otherwise 0.
    WaitInt0 = 2,
    /// A request for the level of INT1; the answer is 0 or 1.
    Int1 = 3,
    /// Waits for the given microseconds (u32); the answer has no body.
    Delay = 4,
    /// From a host: the host ends its session and leaves the network as it is; the answer has no body. From the server:
    /// the server ends.
    Close = 5,
    /// Pulls the chip's reset line low for 100 ms and releases it; the answer has no body.
    Reset = 6,
}

impl Kind {
    /// The kind of message with this number; `None`: no kind has it.
    pub const fn from_code(code: u8) -> Option<Self> {
        match code {
            0 => Some(Self::Greeting),
            1 => Some(Self::Exchange),
            2 => Some(Self::WaitInt0),
            3 => Some(Self::Int1),
            4 => Some(Self::Delay),
            5 => Some(Self::Close),
            6 => Some(Self::Reset),
            _ => None,
        }
    }
}

/// The status of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Status {
    /// The request was carried out.
    Ok = 0,
    /// The request has an unknown kind or an invalid body.
    BadRequest = 1,
    /// Another host has the chip.
    Busy = 2,
    /// The line that the request needs, INT0, INT1 or reset, is not connected.
    NoLine = 3,
    /// The link between the server and the chip has failed, or cannot be opened.
    Chip = 4,
    /// The server is being stopped.
    Ends = 5,
}

/// A decoded request of a host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request<'m> {
    /// Exchange these bytes with the chip.
    Exchange(&'m [u8]),
    /// Wait for INT0, at most this many microseconds.
    WaitInt0(u32),
    /// Read the level of INT1.
    Int1,
    /// Wait for this many microseconds.
    Delay(u32),
    /// The host ends its session.
    Close,
    /// Reset the chip.
    Reset,
}

/// Why a request is invalid.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BadRequest {
    /// The head gives a length that no valid message has, so it is unknown where the next message begins.
    #[error("a message of {found} bytes: an exchange has {EXCHANGE_MAX} at most; send more as several exchanges")]
    TooLong {
        /// The length of the body that the head gives, in bytes.
        found: usize,
    },
    /// No kind of request has this number.
    #[error(
        "no request has the kind {kind}; they are 1 exchange, 2 wait for INT0, 3 read INT1, 4 delay, 5 close, 6 reset"
    )]
    Kind {
        /// The number of the kind in the head of the message.
        kind: u8,
    },
    /// The body is longer or shorter than required.
    #[error("request {kind} has a body of {found} bytes, which has to have {wanted}; see docs/XF-PORT.md")]
    Length {
        /// The number of the kind of the request.
        kind: u8,
        /// The length of the body, in bytes.
        found: usize,
        /// The required length in bytes, as text, such as `1 or more`.
        wanted: &'static str,
    },
    /// The requested wait is too long.
    #[error("a wait of {found} us: {WAIT_MAX_US} us at most; ask again for more")]
    Wait {
        /// The requested wait, microseconds.
        found: u32,
    },
}

/// The length of the body, from the head.
///
/// # Errors
/// [`BadRequest::TooLong`]: the length is more than [`EXCHANGE_MAX`].
pub const fn body_len(head: [u8; HEAD_LEN]) -> Result<usize, BadRequest> {
    let found = u16::from_le_bytes([head[2], head[3]]) as usize;
    if found > EXCHANGE_MAX { Err(BadRequest::TooLong { found }) } else { Ok(found) }
}

impl<'m> Request<'m> {
    /// Decodes the request with this kind and body. The status byte of its head has a meaning in answers only.
    ///
    /// # Errors
    /// [`BadRequest`]: there is no such kind of request, the body has a wrong length, or the wait is too long.
    pub fn parse(kind: u8, body: &'m [u8]) -> Result<Self, BadRequest> {
        let length = |wanted| BadRequest::Length { kind, found: body.len(), wanted };
        let micros = || {
            let bytes = <[u8; 4]>::try_from(body).map_err(|_| length("4"))?;
            match u32::from_le_bytes(bytes) {
                found if found > WAIT_MAX_US => Err(BadRequest::Wait { found }),
                micros => Ok(micros),
            }
        };
        let empty = |request| if body.is_empty() { Ok(request) } else { Err(length("0")) };
        match Kind::from_code(kind) {
            Some(Kind::Exchange) if body.is_empty() => Err(length("1 or more")),
            Some(Kind::Exchange) => Ok(Self::Exchange(body)),
            Some(Kind::WaitInt0) => micros().map(Self::WaitInt0),
            Some(Kind::Int1) => empty(Self::Int1),
            Some(Kind::Delay) => micros().map(Self::Delay),
            Some(Kind::Close) => empty(Self::Close),
            Some(Kind::Reset) => empty(Self::Reset),
            Some(Kind::Greeting) | None => Err(BadRequest::Kind { kind }),
        }
    }
}

/// The head of a message; `len`: the length of the body, at most [`EXCHANGE_MAX`].
pub const fn head(kind: u8, status: Status, len: usize) -> [u8; HEAD_LEN] {
    let len = (len as u16).to_le_bytes();
    [kind, status as u8, len[0], len[1]]
}

/// The greeting: the message with which the server begins a connection. Its body of 8 bytes has [`MAGIC`], [`VERSION`]
/// and [`EXCHANGE_MAX`].
pub fn greeting() -> [u8; HEAD_LEN + 8] {
    let mut message = [0; HEAD_LEN + 8];
    message[..HEAD_LEN].copy_from_slice(&head(Kind::Greeting as u8, Status::Ok, 8));
    message[HEAD_LEN..HEAD_LEN + 5].copy_from_slice(&MAGIC);
    message[HEAD_LEN + 5] = VERSION;
    message[HEAD_LEN + 6..].copy_from_slice(&(EXCHANGE_MAX as u16).to_le_bytes());
    message
}

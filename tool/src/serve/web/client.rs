//! The WebSocket of a page: sends the messages of the page's queue, and ignores what the page sends.

use std::io::{self, Write};
use std::net::TcpStream;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::Duration;

use tungstenite::handshake::derive_accept_key;
use tungstenite::protocol::{Role, WebSocketConfig};
use tungstenite::{Error, Message, WebSocket};

use super::hub::Out;

/// How long sending may block because the page reads nothing, before the connection is closed. \[OURS]
const STALLED_MAX: Duration = Duration::from_secs(10);
/// The longest wait for the next message to send. After it the connection is read, and a request to stop is seen. \[OURS]
const QUEUE_WAIT_MAX: Duration = Duration::from_millis(100);
/// How long a read of the connection may wait. Pages send nothing but pongs and the close frame, so a read is only a short look
/// between two messages to the page. \[OURS]
const LOOK_MAX: Duration = Duration::from_millis(1);
/// The longest message that a page may send, in bytes; a longer one ends the connection. Messages are read and ignored.
/// \[OURS]
const MESSAGE_MAX: usize = 4096;

/// Sends the messages of `queue` to a page. Returns when the queue's sender is gone or `stop` is set.
///
/// # Errors
/// The page has closed the connection, the connection is lost, or the page reads nothing for [`STALLED_MAX`].
pub fn serve(mut stream: TcpStream, key: &str, queue: &Receiver<Out>, stop: &AtomicBool) -> io::Result<()> {
    let accept = derive_accept_key(key.as_bytes());
    stream.set_write_timeout(Some(STALLED_MAX))?;
    stream.set_nodelay(true)?;
    write!(
        stream,
        "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Accept: \
         {accept}\r\n\r\n"
    )?;
    stream.set_read_timeout(Some(LOOK_MAX))?;
    let mut config = WebSocketConfig::default();
    (config.max_message_size, config.max_frame_size) = (Some(MESSAGE_MAX), Some(MESSAGE_MAX));
    let mut socket = WebSocket::from_raw_socket(stream, Role::Server, Some(config));
    while !stop.load(Ordering::Relaxed) {
        match queue.recv_timeout(QUEUE_WAIT_MAX) {
            Ok(Out::Text(text)) => socket.send(Message::text(&*text)).map_err(io::Error::other)?,
            Ok(Out::Block(block)) => socket.send(Message::binary(block.to_vec())).map_err(io::Error::other)?,
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
        match socket.read() {
            Ok(_) => {}
            Err(Error::Io(error)) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut) => {}
            Err(error) => return Err(io::Error::other(error)),
        }
    }
    socket.close(None).map_err(io::Error::other)
}

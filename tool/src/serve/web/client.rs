//! The WebSocket of a page: sends the messages of the page's queue. What the page sends counts only with `--control`.

use std::io::{self, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use tungstenite::handshake::derive_accept_key;
use tungstenite::protocol::{Role, WebSocketConfig};
use tungstenite::{Error, Message, WebSocket};

use super::hub::Out;
use crate::serve::http_stream::Stream;

/// If the page takes nothing for this long while a message is being sent, the connection is closed. \[OURS]
const STALLED_MAX: Duration = Duration::from_secs(10);
/// The same for a page that may control the board. \[OURS]
const URGENT_STALLED_MAX: Duration = Duration::from_secs(1);
/// The longest time of a write to the connection. After it what the page has sent is read, so that a stop does not wait for a
/// page that takes nothing, or little. \[OURS]
const WRITE_MAX: Duration = Duration::from_millis(20);
/// The longest wait for the next message to send. After this time the connection is read, and `stop` is checked.
/// \[OURS]
const QUEUE_WAIT_MAX: Duration = Duration::from_millis(100);
/// The same for a page that may control the board, whose messages are urgent. \[OURS]
const URGENT_WAIT_MAX: Duration = Duration::from_millis(5);
/// How long reading from the connection may block: a page sends little, so a short read between two messages is enough.
/// \[OURS]
const LOOK_MAX: Duration = Duration::from_millis(1);
/// The longest message that a page may send, in bytes; a longer one ends the connection. \[OURS]
const MESSAGE_MAX: usize = 4096;

/// What answers the messages of a page.
pub trait Hears {
    /// Processes a message of the page.
    fn message(&mut self, text: &str);
    /// The messages that are due to the page.
    fn due(&mut self, now: Instant) -> Vec<String>;
}

/// Sends the messages of `queue` to a page. Returns when the sender of the queue is dropped or `stop` is set. What the
/// page sends is for `control`; without it, it is ignored.
///
/// # Errors
/// The page has closed the connection, the connection is lost, or the page takes nothing for [`STALLED_MAX`].
pub fn serve(
    mut stream: Stream,
    key: &str,
    queue: &Receiver<Out>,
    stop: &AtomicBool,
    mut control: Option<&mut dyn Hears>,
) -> io::Result<()> {
    let accept = derive_accept_key(key.as_bytes());
    let stalled_max = if control.is_some() { URGENT_STALLED_MAX } else { STALLED_MAX };
    stream.set_until(Some(Instant::now() + stalled_max));
    stream.socket().set_nodelay(true)?;
    write!(
        stream,
        "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Accept: \
         {accept}\r\n\r\n"
    )?;
    stream.flush()?;
    stream.set_until(None);
    stream.socket().set_write_timeout(Some(WRITE_MAX))?;
    stream.socket().set_read_timeout(Some(LOOK_MAX))?;
    let mut config = WebSocketConfig::default();
    (config.max_message_size, config.max_frame_size) = (Some(MESSAGE_MAX), Some(MESSAGE_MAX));
    let socket = WebSocket::from_raw_socket(stream, Role::Server, Some(config));
    let wait = if control.is_some() { URGENT_WAIT_MAX } else { QUEUE_WAIT_MAX };
    let mut line = Line { socket, stalled_max };
    while !stop.load(Ordering::Relaxed) {
        match queue.recv_timeout(wait) {
            Ok(Out::Text(text)) => line.send(Message::text(&*text), &mut control)?,
            Ok(Out::Block(block)) => line.send(Message::binary(block.to_vec()), &mut control)?,
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
        line.hear(&mut control)?;
        let due = control.iter_mut().flat_map(|control| control.due(Instant::now())).collect::<Vec<_>>();
        for message in due {
            line.send(Message::text(message), &mut control)?;
        }
    }
    line.socket.close(None).map_err(io::Error::other)
}

/// The connection to a page.
struct Line {
    socket: WebSocket<Stream>,
    stalled_max: Duration,
}

impl Line {
    /// Sends a message. What the page sends meanwhile is heard, also if the message cannot be sent.
    fn send(&mut self, message: Message, control: &mut Option<&mut dyn Hears>) -> io::Result<()> {
        let (mut written, mut since) = (self.socket.get_ref().written(), Instant::now());
        let mut sent = self.socket.send(message);
        loop {
            let failed = match sent {
                Ok(()) => return Ok(()),
                Err(Error::Io(error)) if is_no_room(&error) && !self.socket.get_ref().is_broken() => error,
                Err(error) => {
                    // A stop that has arrived is carried out, also if its page takes nothing more.
                    let _ = self.hear(control);
                    return Err(io::Error::other(error));
                }
            };
            self.hear(control)?;
            let now = self.socket.get_ref().written();
            if now != written {
                (written, since) = (now, Instant::now());
            } else if since.elapsed() > self.stalled_max {
                return Err(failed);
            }
            sent = self.socket.flush();
        }
    }

    /// Passes on what has come from the page.
    fn hear(&mut self, control: &mut Option<&mut dyn Hears>) -> io::Result<()> {
        loop {
            match self.socket.read() {
                Ok(Message::Text(text)) => control.iter_mut().for_each(|control| control.message(&text)),
                Ok(_) => {}
                Err(Error::Io(error)) if is_no_room(&error) => return Ok(()),
                Err(error) => return Err(io::Error::other(error)),
            }
        }
    }
}

/// Whether nothing was moved because the timeout of the socket was over.
fn is_no_room(error: &io::Error) -> bool {
    error.kind() == io::ErrorKind::WouldBlock
}

#[cfg(test)]
mod tests {
    use std::io::Read as _;
    use std::net::{TcpListener, TcpStream};
    use std::sync::Arc;
    use std::sync::mpsc::{Sender, channel, sync_channel};
    use std::thread;

    use rustls::crypto::ring;
    use rustls::pki_types::pem::PemObject as _;
    use rustls::pki_types::{CertificateDer, ServerName};
    use rustls::{ClientConfig, ClientConnection, RootCertStore, StreamOwned};

    use super::*;
    use crate::serve::http_stream::Tls;
    use crate::serve::web::certificate::Certificate;

    const KEY: &str = "dGhlIHNhbXBsZSBub25jZQ==";
    /// A WebSocket frame of a client with the text `stop`: FIN and text, masked, 4 bytes, a mask of zeros.
    const STOP: &[u8] = b"\x81\x84\0\0\0\0stop";

    struct Heard(Sender<String>);

    impl Hears for Heard {
        fn message(&mut self, text: &str) {
            self.0.send(text.to_owned()).expect("the test waits");
        }

        fn due(&mut self, _: Instant) -> Vec<String> {
            vec!["a question".repeat(100)]
        }
    }

    /// A page without TLS, or with it.
    enum Page {
        Plain(TcpStream),
        Tls(Box<StreamOwned<ClientConnection, TcpStream>>),
    }

    impl Page {
        fn read_head(&mut self) {
            let mut head = [0; 10];
            match self {
                Self::Plain(stream) => stream.read_exact(&mut head),
                Self::Tls(stream) => stream.read_exact(&mut head),
            }
            .expect("an answer");
        }

        fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
            match self {
                Self::Plain(stream) => stream.write_all(bytes),
                Self::Tls(stream) => stream.write_all(bytes).and_then(|()| stream.flush()),
            }
        }
    }

    fn pages() -> Vec<(Page, Stream)> {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("page.pem");
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = listener.local_addr().expect("it has one");
        let certificate = Certificate::load_or_make(&file, address).expect("it is made");
        let mut roots = RootCertStore::empty();
        roots.add(CertificateDer::from_pem_file(&file).expect("a certificate")).expect("one to trust");
        let config = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()))
            .with_safe_default_protocol_versions()
            .expect("TLS")
            .with_root_certificates(roots)
            .with_no_client_auth();
        let connect = |tls: Option<&Tls>| {
            let page = TcpStream::connect(address).expect("it listens");
            (page, Stream::new(listener.accept().expect("a page").0, tls).expect("a session"))
        };
        let (plain, plain_server) = connect(None);
        let (page, server) = connect(Some(&certificate.tls));
        let name = ServerName::try_from("localhost").expect("a name");
        let session = ClientConnection::new(Arc::new(config), name).expect("a session");
        let tls = Page::Tls(Box::new(StreamOwned::new(session, page)));
        vec![(Page::Plain(plain), plain_server), (tls, server)]
    }

    /// Whether the server hears the stop of a page that takes nothing and then, with `resets`, resets the connection. It does not
    /// if the test is so late that the server has ended the connection before.
    fn is_heard(mut page: Page, stream: Stream, resets: bool) -> bool {
        let (queue, blocks) = sync_channel(4);
        let (heard, stops) = channel();
        let serving =
            thread::spawn(move || serve(stream, KEY, &blocks, &AtomicBool::new(false), Some(&mut Heard(heard))));
        page.read_head();
        // Blocks until no buffer of the system has room for more.
        let block: Arc<[u8]> = vec![7; 1 << 20].into();
        let until = Instant::now() + Duration::from_millis(500);
        while Instant::now() < until {
            let _ = queue.try_send(Out::Block(Arc::clone(&block)));
            thread::sleep(Duration::from_millis(5));
        }
        let is_sent = page.send(STOP).is_ok();
        // Bytes that were not read make the end of the connection a reset.
        let page = Some(page).filter(|_| !resets);
        let is_heard = is_sent && stops.recv().as_deref() == Ok("stop");
        drop(page);
        assert!(serving.join().expect("it does not panic").is_err(), "it has ended");
        is_heard
    }

    /// docs/SAFETY.md, By a page: the stop of a page that takes nothing is heard, with TLS and without it, while its server
    /// has something to send, and also if the page then resets the connection.
    #[test]
    fn the_stop_of_a_page_that_takes_nothing_is_heard() {
        const TRIES: usize = 10;
        for resets in [false, true] {
            for which in [0, 1] {
                let mut tries = (0..TRIES).map(|_| pages().swap_remove(which));
                assert!(tries.any(|(page, stream)| is_heard(page, stream, resets)), "{which}, resets: {resets}");
            }
        }
    }
}

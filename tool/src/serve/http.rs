//! Reads the heads of HTTP requests, and sends answers. It supports only what a page and a metrics scrape need: GET,
//! one request per connection. `http_server.rs` manages the connections.

use std::io::{self, Read, Write};
use std::net::IpAddr;
use std::time::{Duration, Instant};

use super::http_stream::Stream;

/// The longest head of a request in bytes. \[OURS] Browsers send less than 2 KB.
const HEAD_MAX: usize = 8192;
/// The largest number of header fields of a request; a request with more is refused. \[OURS]
const FIELDS_MAX: usize = 64;
/// The time within which a client must have sent its request. \[OURS]
const REQUEST_WAIT_MAX: Duration = Duration::from_secs(5);
/// How long a client may receive nothing of the answer, and how far it may fall behind [`RATE_MIN`]. \[OURS]
const STALLED_MAX: Duration = Duration::from_secs(5);
/// The lowest average rate at which a client must receive the answer, in bytes per second. The page of a long recording
/// has tens of megabytes, and a tunnel may be slow. \[OURS]
const RATE_MIN: u64 = 64 * 1024;

/// The parts of an HTTP request that this server uses.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Request {
    /// The method, such as `GET`.
    pub method: String,
    /// The path without its query.
    pub path: String,
    /// The value of `token` in the query.
    pub token: String,
    /// The value of the header field `Host`; empty if it is missing.
    pub host: String,
    /// The value of the header field `Origin`; empty if it is missing.
    pub origin: String,
    /// The value of `Sec-WebSocket-Key`; `None` if the request does not open a WebSocket.
    pub socket_key: Option<String>,
}

/// An error answer of the server, as plain text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// The HTTP status code with its reason, such as `403 Forbidden`.
    pub status: &'static str,
    /// The body of the answer: what is wrong, and what the user can do.
    pub text: &'static str,
}

/// Reads the head of a request; `None` if the client speaks no TLS though this server does.
///
/// # Errors
/// The client sends no valid head in time.
pub fn read(stream: &mut Stream) -> io::Result<Option<Request>> {
    // The time limit is for the whole head, so a client that sends a byte now and then does not get more time.
    stream.set_until(Some(Instant::now() + REQUEST_WAIT_MAX));
    if stream.lacks_tls()? {
        return Ok(None);
    }
    let (mut bytes, mut piece) = (Vec::new(), [0; 1024]);
    while bytes.len() < HEAD_MAX {
        let count = stream.read(&mut piece)?;
        if count == 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        bytes.extend_from_slice(&piece[..count]);
        if let Some(request) = parse(&bytes)? {
            return Ok(Some(request));
        }
    }
    Err(io::ErrorKind::InvalidData.into())
}

/// Parses the head of a request; `None` if it is still incomplete.
fn parse(bytes: &[u8]) -> io::Result<Option<Request>> {
    let mut fields = [httparse::EMPTY_HEADER; FIELDS_MAX];
    let mut head = httparse::Request::new(&mut fields);
    let is_whole = head.parse(bytes).map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error))?.is_complete();
    if !is_whole {
        return Ok(None);
    }
    let field = |name: &str| {
        let mut found = head.headers.iter().filter(|field| field.name.eq_ignore_ascii_case(name));
        let value = found.next().map(|field| String::from_utf8_lossy(field.value).into_owned());
        // A field that appears twice counts as missing, because browsers and proxies may differ in which of the two
        // values they use.
        value.filter(|_| found.next().is_none())
    };
    let target = head.path.unwrap_or_default();
    let (path, query) = target.split_once('?').unwrap_or((target, ""));
    let token = query.split('&').find_map(|part| part.strip_prefix("token="));
    let asks = |name: &str, word: &str| {
        let list = field(name).unwrap_or_default();
        list.split(',').any(|part| part.trim().eq_ignore_ascii_case(word))
    };
    let is_socket =
        asks("Upgrade", "websocket") && asks("Connection", "upgrade") && asks("Sec-WebSocket-Version", "13");
    Ok(Some(Request {
        method: head.method.unwrap_or_default().to_owned(),
        path: path.to_owned(),
        token: token.unwrap_or_default().to_owned(),
        host: field("Host").unwrap_or_default(),
        origin: field("Origin").unwrap_or_default(),
        socket_key: field("Sec-WebSocket-Key").filter(|_| is_socket),
    }))
}

/// Whether the host name in `Host` is this machine. Another name may resolve to 127.0.0.1 as well (DNS rebinding). The
/// browser then takes this server for another site, whose scripts could read the answers.
pub fn is_this_machine(host: &str) -> bool {
    if !is_host(host) {
        return false;
    }
    let name = match host.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or_default(),
        None => host.split(':').next().unwrap_or_default(),
    };
    name.eq_ignore_ascii_case("localhost") || name.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
}

/// Whether `Host` is a name or an address with an optional port, and nothing else, so that it can be a part of a policy.
pub fn is_host(host: &str) -> bool {
    !host.is_empty() && host.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"-.:[]".contains(&byte))
}

/// Whether two texts are equal. The comparison takes constant time, so that its duration does not reveal where they
/// differ.
pub fn is_same(a: &str, b: &str) -> bool {
    a.len() == b.len() && a.bytes().zip(b.bytes()).fold(0, |differs, (a, b)| differs | (a ^ b)) == 0
}

/// Sends an HTML page. `policy` is the first part of the `Content-Security-Policy`.
///
/// # Errors
/// The client does not receive the page.
pub fn send_page(stream: &mut Stream, html: &str, policy: &str) -> io::Result<()> {
    let policy = format!("Content-Security-Policy: {policy}; frame-ancestors 'none'\r\n");
    send(stream, "200 OK", "text/html", &policy, html)
}

/// Answers a request with an error.
///
/// # Errors
/// The client does not receive the answer.
pub fn refuse(stream: &mut Stream, refusal: Refusal) -> io::Result<()> {
    send_text(stream, refusal.status, PLAIN, &format!("{}\n", refusal.text))
}

/// The `Content-Type` of plain text, without its charset.
pub const PLAIN: &str = "text/plain";

/// Sends text. `kind` is its `Content-Type` without the charset, which is UTF-8.
///
/// # Errors
/// The client does not receive the text.
pub fn send_text(stream: &mut Stream, status: &str, kind: &str, text: &str) -> io::Result<()> {
    send(stream, status, kind, "Content-Security-Policy: default-src 'none'\r\n", text)
}

fn send(stream: &mut Stream, status: &str, kind: &str, fields: &str, body: &str) -> io::Result<()> {
    let length = body.len();
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {kind}; charset=utf-8\r\nContent-Length: {length}\r\n{fields}\
         Cache-Control: no-store\r\nReferrer-Policy: no-referrer\r\nX-Content-Type-Options: nosniff\r\n\
         Cross-Origin-Resource-Policy: same-origin\r\nCross-Origin-Opener-Policy: same-origin\r\nConnection: close\r\n\r\n"
    );
    let mut progress = Progress::begin(Instant::now());
    write_all(stream, head.as_bytes(), &mut progress)?;
    write_all(stream, body.as_bytes(), &mut progress)
}

/// How many bytes of an answer a client has received, and when.
struct Progress {
    began: Instant,
    newest: Instant,
    bytes: u64,
}

impl Progress {
    const fn begin(now: Instant) -> Self {
        Self { began: now, newest: now, bytes: 0 }
    }

    fn took(&mut self, count: usize, now: Instant) {
        self.bytes = self.bytes.saturating_add(count as u64);
        self.newest = now;
    }

    /// The time by which the client must receive more. A client that receives a byte now and then does not get more
    /// time.
    fn until(&self) -> Instant {
        let due = self.began + Duration::from_millis(self.bytes.saturating_mul(1000) / RATE_MIN);
        due.min(self.newest) + STALLED_MAX
    }
}

/// Writes all bytes, unless the client receives them too slowly.
fn write_all(stream: &mut Stream, mut bytes: &[u8], progress: &mut Progress) -> io::Result<()> {
    while !bytes.is_empty() {
        stream.set_until(Some(progress.until()));
        match stream.write(bytes) {
            Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
            Ok(count) => {
                bytes = &bytes[count..];
                progress.took(count, Instant::now());
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_head_that_is_not_whole_waits_for_the_rest() {
        let head = "GET /live?a=1&token=t HTTP/1.1\r\nHost: localhost:1\r\nOrigin: http://localhost:1\r\nUpgrade: WebSocket\r\n\
                    Connection: keep-alive, Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: k\r\n\r\n";
        let parsed = |head: &str| parse(head.as_bytes()).expect("a head");
        for end in 0..head.len() {
            assert_eq!(parsed(&head[..end]), None);
        }
        let request = parsed(head).expect("it is whole");
        assert_eq!((&*request.method, &*request.path, &*request.token), ("GET", "/live", "t"));
        assert_eq!((&*request.host, &*request.origin), ("localhost:1", "http://localhost:1"));
        assert_eq!(request.socket_key.as_deref(), Some("k"));
        let doubled = parsed(&head.replace("Host: ", "Host: other\r\nHost: ")).expect("it is whole");
        assert_eq!(doubled.host, "", "two hosts are none");
        assert_eq!(parsed(&head.replace("Version: 13", "Version: 8")).expect("whole").socket_key, None);
        assert!(parse(b"\x16\x03\x01 TLS").is_err());
    }

    /// A page of 12 MB is sent completely over a line with 1 MB/s or 100 KB/s. A client that receives nothing for 5 s
    /// is disconnected, and so is one that receives only a byte now and then.
    #[test]
    fn a_slow_client_gets_the_whole_answer() {
        let began = Instant::now();
        let lasts = |bytes: usize, each: Duration, all: usize| {
            let (mut progress, mut now) = (Progress::begin(began), began);
            while progress.bytes < all as u64 && now < progress.until() {
                now += each;
                progress.took(bytes, now);
            }
            (progress.bytes >= all as u64, now - began)
        };
        assert!(lasts(1_000, Duration::from_millis(1), 12_000_000).0);
        assert!(lasts(100_000, Duration::from_secs(1), 12_000_000).0);
        let (is_whole, time) = lasts(1, Duration::from_millis(500), 12_000_000);
        assert!(!is_whole && time <= Duration::from_secs(6), "{time:?}");
        let mut progress = Progress::begin(began);
        progress.took(10_000_000, began + Duration::from_secs(1));
        assert_eq!(progress.until(), began + Duration::from_secs(6));
    }

    #[test]
    fn this_machine_has_few_names() {
        for host in ["localhost", "LOCALHOST:4714", "127.0.0.1:80", "127.9.9.9", "[::1]:4714"] {
            assert!(is_this_machine(host), "{host}");
        }
        for host in [
            "localhost; x",
            "localhost:1 'self'",
            "",
            "example.org:4714",
            "localhost.example.org",
            "10.0.0.1",
            "[::2]",
            "127.0.0.1.example.org",
        ] {
            assert!(!is_this_machine(host), "{host}");
        }
    }

    #[test]
    fn texts_are_the_same_byte_by_byte() {
        assert!(is_same("abc", "abc") && is_same("", ""));
        assert!(!is_same("abc", "abx") && !is_same("abc", "ab") && !is_same("", "a"));
    }
}

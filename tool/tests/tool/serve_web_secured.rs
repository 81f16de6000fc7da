//! `ecmsk serve web --cert`: the page for other machines, over HTTPS.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rustls::crypto::ring;
use rustls::pki_types::pem::PemObject as _;
use rustls::pki_types::{CertificateDer, ServerName};
use rustls::version::TLS13;
use rustls::{ClientConfig, ClientConnection, RootCertStore, StreamOwned};
use serde_json::json;
use tempfile::TempDir;
use tungstenite::Message;
use tungstenite::client::IntoClientRequest as _;

use crate::common::page::{Browser, Serving, ask, connect, insist, points};
use crate::common::{ecmsk, run};

const SECRET: &str = "Vm8vZ0tYbHh3c1pQc2V4bVdKa1ZxU3dQbEx4d2c9";
/// The head of a request that opens a WebSocket, behind its first line and its host.
const UPGRADE: &[&str] = &[
    "Upgrade: websocket",
    "Connection: Upgrade",
    "Sec-WebSocket-Version: 13",
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
];

/// A folder with a secret, and the names of its files.
struct Files {
    folder: TempDir,
    certificate: PathBuf,
    secret: PathBuf,
}

impl Files {
    fn new() -> Self {
        use std::os::unix::fs::PermissionsExt as _;
        let folder = tempfile::tempdir().expect("a folder");
        let secret = folder.path().join("secret");
        std::fs::write(&secret, SECRET).expect("it is written");
        std::fs::set_permissions(&secret, std::fs::Permissions::from_mode(0o600)).expect("it is there");
        Self { certificate: folder.path().join("page.pem"), secret, folder }
    }

    /// A page for all networks of this machine.
    fn serve(&self, arguments: &[&str]) -> Serving {
        let mut command = ecmsk(["serve", "web", "--listen", "0.0.0.0:0", "--cert"]);
        command.arg(&self.certificate).arg("--secret-file").arg(&self.secret).args(arguments);
        command.current_dir(self.folder.path());
        Serving::by(command)
    }
}

/// A TLS connection to the page at `port`, by a client that trusts this certificate alone.
fn secured(certificate: &Path, port: &str) -> StreamOwned<ClientConnection, TcpStream> {
    let mut roots = RootCertStore::empty();
    roots.add(CertificateDer::from_pem_file(certificate).expect("a certificate")).expect("one to trust");
    let config = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()))
        .with_protocol_versions(&[&TLS13])
        .expect("TLS 1.3")
        .with_root_certificates(roots)
        .with_no_client_auth();
    let name = ServerName::try_from("localhost").expect("a name");
    let session = ClientConnection::new(Arc::new(config), name).expect("a session");
    StreamOwned::new(session, connect(&format!("127.0.0.1:{port}")))
}

/// Sends a request over TLS; returns the answer.
fn ask_secured(certificate: &Path, port: &str, lines: &[&str]) -> String {
    let mut stream = secured(certificate, port);
    stream.write_all((lines.join("\r\n") + "\r\n\r\n").as_bytes()).expect("it reads");
    let mut answer = String::new();
    stream.read_to_string(&mut answer).expect("an answer and its end");
    answer
}

/// Other machines reach the page over HTTPS, under any name. The certificate is made at the first start. Together with a secret
/// it keeps certificate and address the same.
#[test]
fn other_machines_reach_the_page_over_https() {
    let files = Files::new();
    let mut web = files.serve(&["--link", "sim:?slaves=drive"]);
    let first = web.wait_for("certificate");
    assert!(first.contains("made ") && first.contains("page.pem"), "{first}");
    let (host, token) = web.host_and_token();
    assert!(web.address().starts_with("https://") && token.len() == 32, "{}", web.address());
    let port = host.rsplit(':').next().expect("a port");
    let get = format!("GET /?token={token} HTTP/1.1");

    for name in ["localhost", "machine-3.example", "192.168.7.9"] {
        let answer = ask_secured(&files.certificate, port, &[&get, &format!("Host: {name}:{port}")]);
        assert!(answer.starts_with("HTTP/1.1 200 "), "{answer}");
        assert!(answer.contains(&format!("connect-src wss://{name}:{port};")), "{name}: {}", &answer[..1000]);
        assert!(answer.ends_with("</html>\n"), "the whole page");
    }
    for (lines, status) in [
        (vec![&*get, "Host: a; script-src *"], 400),
        (vec![&*get], 400),
        (vec!["GET / HTTP/1.1", "Host: localhost"], 403),
        ([&["GET /live HTTP/1.1", "Host: localhost", "Origin: https://localhost"], UPGRADE].concat(), 403),
    ] {
        let answer = ask_secured(&files.certificate, port, &lines);
        assert!(answer.starts_with(&format!("HTTP/1.1 {status} ")), "{lines:?}: {answer}");
    }
    let live = format!("GET /live?token={token} HTTP/1.1");
    for origin in ["Origin: http://localhost", "Origin: https://example.org", "Origin: null", "X: none"] {
        let lines = [&[&*live, "Host: localhost", origin], UPGRADE].concat();
        let answer = ask_secured(&files.certificate, port, &lines);
        assert!(answer.starts_with("HTTP/1.1 403 "), "{origin}: {answer}");
    }
    let (head, body) = ask(&format!("127.0.0.1:{port}"), &[&get, "Host: localhost"]);
    assert!(head.starts_with("HTTP/1.1 400 ") && body.contains("https"), "{head} {body}");

    let token = token.to_owned();
    web.end();
    let mut web = files.serve(&["--link", "sim:?slaves=drive"]);
    let second = web.wait_for("certificate");
    let fingerprint = |line: &str| line.rsplit(' ').next().expect("its end").to_owned();
    assert_eq!(fingerprint(&second), fingerprint(&first));
    assert!(!second.contains("made "), "{second}");
    assert_eq!(web.host_and_token().1, token, "the address stays");
    web.end();
}

/// A page gets its points over TLS. Clients that begin a handshake and say no more keep nobody out.
#[test]
fn points_come_over_tls_beside_clients_that_say_nothing() {
    const HANDSHAKE: u8 = 0x16;
    let files = Files::new();
    let web = files.serve(&["--link", "sim:?slaves=drive"]);
    let (host, token) = web.host_and_token();
    let port = host.rsplit(':').next().expect("a port");
    let silent: Vec<TcpStream> = (0..150)
        .map(|number| {
            let mut stream = TcpStream::connect(format!("127.0.0.1:{port}")).expect("it listens");
            if number % 2 == 0 {
                stream.write_all(&[HANDSHAKE, 3, 1]).expect("it reads");
            }
            stream
        })
        .collect();
    let mut request = format!("wss://localhost:{port}/live?token={token}").into_client_request().expect("an address");
    request.headers_mut().insert("Origin", format!("https://localhost:{port}").parse().expect("a field"));
    let mut socket = tungstenite::client(request, secured(&files.certificate, port)).expect("there is room").0;
    let mut blocks = 0;
    while blocks < 10 {
        match socket.read().expect("a message") {
            Message::Binary(block) => blocks += usize::from(!points(&block).is_empty()),
            Message::Text(_) => {}
            other => panic!("{other:?}"),
        }
    }
    drop(silent);
    web.end();
}

/// Without a certificate no other machine is served. What is no certificate stays as it is.
#[test]
fn without_a_certificate_no_other_machine_is_served() {
    for listen in ["0.0.0.0:4714", "[::]:4714", "192.168.0.1:4714"] {
        let refused = run(["serve", "web", "--link", "sim:", "--listen", listen]);
        refused.expect_failure(2, &["other machines reach", "--cert FILE"], "ssh -L PORT:localhost:PORT HOST");
    }
    let files = Files::new();
    let secret = files.secret.to_str().expect("UTF-8");
    let refused = run(["serve", "web", "--link", "sim:", "--listen", "127.0.0.1:0", "--cert", secret]);
    refused.expect_failure(1, &["no certificate for the page", "PEM file"], "--cert");
    assert_eq!(std::fs::read_to_string(secret).expect("it is there"), SECRET);
    std::fs::write(&files.secret, "short").expect("it is written");
    let alone = run(["serve", "web", "--link", "sim:", "--listen", "127.0.0.1:0", "--secret-file", secret]);
    alone.expect_misuse(&["--cert"]);
    let certificate = files.certificate.to_str().expect("UTF-8");
    let refused = ["--listen", "127.0.0.1:0", "--cert", certificate, "--secret-file", secret];
    let refused = run([&["serve", "web", "--link", "sim:"], &refused[..]].concat());
    refused.expect_failure(1, &["it has 5 bytes", "make one"], "head -c 32");
}

mod needs_chromium {
    use super::*;

    /// A browser that accepts the certificate shows what a program does with the board, and stops it.
    #[test]
    fn a_browser_shows_a_board_over_https() {
        let files = Files::new();
        let board = Serving::start("tcp", &["--link", "sim:?slaves=drive"]);
        let link = board.link();
        let web = files.serve(&["--link", &link, "--control"]);
        let mut browser = Browser::start();
        browser.call("Security.setIgnoreCertificateErrors", json!({"ignore": true}));
        let (host, token) = web.host_and_token();
        let port = host.rsplit(':').next().expect("a port");
        browser.open(&format!("https://localhost:{port}/?token={token}"));
        insist(&["servo", "on", "1", "--up", "--link", &link]);
        browser.wait_for("document.querySelector('#slaves').innerText.includes('Operation enabled')");
        browser.wait_for("isSecureContext && page.store.value(1, 'position', page.store.to) === 0");
        browser.value("document.querySelector('#control .stop').dispatchEvent(new PointerEvent('pointerdown'))");
        browser.wait_for("document.querySelector('#control .texts').innerText.includes('axes stand still')");
        web.end();
        board.end();
    }
}

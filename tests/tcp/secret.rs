//! A server with a secret: which clients are accepted, and what is visible on the cable.
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use ecmsk::link::tcp::Secret;
use ecmsk::link::{self, LinkError, Share, Wait};
use ecmsk::port::tcp::{ServeOptions, Server};
use ecmsk::sk::Frame;
use support::tcp::proxy::Cable;
use support::tcp::{LIMIT, Puppet, Raw, Told, frame, options, refused, serve_link, uri};
use tempfile::TempDir;

const GOOD: &str = "0123456789abcdef0123456789abcdef";
const BAD: &str = "0123456789abcdef0123456789abcdeX";

fn file(folder: &TempDir, name: &str, text: &str, mode: u32) -> PathBuf {
    let path = folder.path().join(name);
    fs::write(&path, text).unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(mode)).unwrap();
    path
}

/// A pipe without a writer.
fn fifo(folder: &TempDir) -> PathBuf {
    let path = folder.path().join("fifo");
    let made = std::process::Command::new("mkfifo").args(["-m", "600"]).arg(&path).status().unwrap();
    assert!(made.success());
    path
}

fn secret_server(puppet: &std::sync::Arc<Puppet>, secret: &Path, listen: &str) -> (Server, Told) {
    let (options, told) = options();
    let secret = Some(Secret::load(secret).unwrap());
    let options = ServeOptions { secret, listen: listen.parse().unwrap(), ..options };
    (serve_link(puppet.clone(), options), told)
}

fn key(path: &Path) -> String {
    format!("secret_file={}", path.display())
}

/// With the secret a client is accepted, from outside too, and frames are transferred in both directions.
#[test]
fn a_client_with_the_secret_is_let_in() {
    let folder = tempfile::tempdir().unwrap();
    let secret = file(&folder, "secret", GOOD, 0o600);
    let puppet = Puppet::new();
    let (server, _told) = secret_server(&puppet, &secret, "0.0.0.0:0");
    let uri = format!("tcp://127.0.0.1:{}?{}", server.address().port(), key(&secret));
    let link = link::open(&uri, Share::ByName).unwrap();
    let reader = link::open(&format!("{uri}&role=reader"), Share::ByName).unwrap();
    let mut report = Frame::new();
    for n in 0..100 {
        link.write(&frame(n), Wait::For(LIMIT)).unwrap();
        puppet.report(&frame(n));
        for link in [&link, &reader] {
            link.read(&mut report, Wait::For(LIMIT)).unwrap();
            assert_eq!(report, frame(n));
        }
    }
    assert_eq!(puppet.taken().len(), 100);
    link.close();
    // A burst larger than a TLS record.
    (0..100).for_each(|n| puppet.report(&frame(n)));
    let last = support::tcp::until("the newest report", || {
        reader.read(&mut report, Wait::For(LIMIT)).ok().filter(|meta| meta.sequence == 199)
    });
    assert_eq!((last.sequence, report), (199, frame(99)));
}

/// Another secret, none, or one too many: each end reports the error, and nothing of the board is disclosed.
#[test]
fn a_client_with_another_secret_or_none_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (good, bad) = (file(&folder, "good", GOOD, 0o600), file(&folder, "bad", BAD, 0o600));
    let puppet = Puppet::new();
    let (server, told) = secret_server(&puppet, &good, "127.0.0.1:0");
    let wrong = refused(&server, &key(&bad));
    assert!(matches!(&wrong, LinkError::NoBoard { reason, .. } if reason.contains("another secret")), "{wrong}");
    told.wait("does not know the secret");
    let none = refused(&server, "");
    assert!(none.to_string().contains("secret_file="), "{none}");

    let (open, _) = support::tcp::serve("sim:?slaves=drive");
    let needless = refused(&open, &key(&good));
    let text = needless.to_string();
    assert!(text.contains("knows none"), "a client with a secret talks to no server without: {text}");
    assert!(text.contains("somebody else") && text.contains("--secret-file"), "it says what that may mean: {text}");
    for advice in ["leave", "without", "remove", "unset", "take away", "drop"] {
        assert!(!text.contains(advice), "nobody is advised to go without the secret: {text}");
    }
    link::open(&uri(&server, &key(&good)), Share::ByName).unwrap();
}

/// TCP-12 A client without TLS where it is required, and a TLS handshake that never ends.
#[test]
fn a_client_without_valid_tls_is_disconnected() {
    let folder = tempfile::tempdir().unwrap();
    let (options, told) = options();
    let secret = Some(Secret::load(&file(&folder, "secret", GOOD, 0o600)).unwrap());
    let hello_limit = Duration::from_millis(200);
    let server = serve_link(Puppet::new(), ServeOptions { secret, hello_limit, ..options });
    for nonsense in [support::tcp::hello(false, 500), b"GET / HTTP/1.1\r\n\r\n".to_vec(), vec![0x16, 3, 1, 2, 0, 1]] {
        let mut raw = Raw::dial(&server);
        let greeting = raw.take::<16>().unwrap();
        assert_eq!(greeting[10], 1, "it says that TLS follows");
        raw.send(&nonsense);
        // Possibly an alert, then the end.
        while raw.take::<1>().is_some() {}
    }
    told.wait("said nothing for 200ms");
}

/// Neither the secret nor a frame is visible on the cable.
#[test]
fn neither_the_secret_nor_a_frame_is_visible_on_the_cable() {
    let folder = tempfile::tempdir().unwrap();
    let secret = file(&folder, "secret", GOOD, 0o600);
    for protected in [false, true] {
        let puppet = Puppet::new();
        let (server, key) = if protected {
            (secret_server(&puppet, &secret, "127.0.0.1:0").0, key(&secret))
        } else {
            (serve_link(puppet.clone(), options().0), String::new())
        };
        let cable = Cable::to(server.address());
        let link = link::open(&format!("tcp://{}?{key}", cable.address), Share::ByName).unwrap();
        link.write(&frame(0x5A), Wait::For(LIMIT)).unwrap();
        link.close();
        let carried = cable.carried();
        let shows = |part: &[u8]| carried.windows(part.len()).any(|window| window == part);
        assert_eq!(shows(&[0x5A; 64]), !protected, "a frame");
        assert!(!shows(GOOD.as_bytes()));
        assert!(shows(b"ecmsktcp"), "the cable was looked at");
    }
}

/// TOOL-136 A secret that others may read, one that is too short or can be guessed, one that is no file and a missing
/// one: each error says what to do.
#[test]
fn invalid_secrets_are_refused_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    for (path, part) in [
        (file(&folder, "open", GOOD, 0o644), "chmod 600"),
        (file(&folder, "group", GOOD, 0o640), "chmod 600"),
        (file(&folder, "short", &GOOD[1..], 0o600), "31 bytes"),
        (file(&folder, "blank", &format!("  {}  \n", &GOOD[1..]), 0o600), "31 bytes"),
        (file(&folder, "zeros", &"0".repeat(64), 0o600), "can be guessed"),
        (file(&folder, "huge", &GOOD.repeat(1000), 0o600), "more than 4096 bytes"),
        (fifo(&folder), "a pipe (FIFO)"),
        ("/dev/zero".into(), "a device"),
        (folder.path().to_owned(), "a folder"),
        (folder.path().join("none"), "make one"),
    ] {
        let error = link::open(&format!("tcp://127.0.0.1:1?{}", key(&path)), Share::ByName).err().unwrap();
        assert!(error.to_string().contains(part) && !error.to_string().contains(&GOOD[1..]), "{error}: no {part}");
    }
    assert_eq!(format!("{:?}", Secret::load(&file(&folder, "good", GOOD, 0o600)).unwrap()), "Secret");
}

//! The addresses at which a chip is served.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixListener;

use ecmsk::link::chip;
use ecmsk::port::xf::{Listen, Options, ServeError, Server};

use crate::client::{CLOSE, Client, serve_with};

const URI: &str = "xf-sim:?clock=virtual&chip_fw=old";

fn start(listen: Listen) -> Result<Server, ServeError> {
    Server::start(|| chip::open(URI), Options { listen, ..Options::default() })
}

fn unix(path: &std::path::Path) -> Listen {
    Listen::Unix(path.to_owned())
}

/// XF-14.10 A Unix socket is accessible only to its owner, works like TCP, and its path is removed at the end.
#[test]
fn a_unix_socket() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("xf");
    let (server, _) = serve_with(URI, Options { listen: unix(&path), ..Options::default() });
    assert_eq!(server.listen().to_string(), format!("unix:{}", path.display()));
    assert_eq!(fs::metadata(&path).expect("a socket").permissions().mode() & 0o777, 0o600);
    let mut client = Client::connect(server.listen());
    client.exchange(&[0; 144]);
    client.ask(CLOSE, &[]);
    server.stop();
    assert!(!path.exists());
}

/// XF-14.10 A socket left by a killed server is replaced; one with a listener and a file of any other kind are not.
#[test]
fn what_stands_at_the_path() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("xf");
    drop(UnixListener::bind(&path).expect("a socket"));
    assert!(path.exists());
    let server = start(unix(&path)).expect("it replaces it");
    let error = start(unix(&path)).err().expect("it is in use").to_string();
    assert!(error.contains("somebody listens there") && error.contains("--listen"), "{error}");
    Client::connect(server.listen());
    server.stop();
    fs::write(&path, "text").expect("a file");
    let error = start(unix(&path)).err().expect("it is no socket").to_string();
    assert!(error.contains("stays as it is") && error.contains("--listen"), "{error}");
    assert_eq!(fs::read_to_string(&path).expect("the file"), "text");
    let error = start(unix(&folder.path().join("none/xf"))).err().expect("no folder").to_string();
    assert!(error.contains("in a folder that this user may write to"), "{error}");
}

/// XF-14.10 An address that is reachable from other machines is refused with the next step.
#[test]
fn other_machines() {
    for listen in ["0.0.0.0:0", "192.0.2.1:4712", "[::]:0"] {
        let error = start(listen.parse().expect("an address")).err().expect("it is refused");
        assert!(matches!(error, ServeError::NeedsTunnel { .. }), "{error}");
        assert!(error.to_string().contains("--insecure-anyone"), "{error}");
    }
    for nonsense in ["", "unix:", "localhost", "127.0.0.1"] {
        assert!(nonsense.parse::<Listen>().is_err(), "{nonsense}");
    }
}

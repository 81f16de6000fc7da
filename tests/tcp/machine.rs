//! A client that asks for the machine file of the server, as the tool does for the names of axes.

use std::io::{Read as _, Write as _};
use std::net::TcpListener;
use std::path::Path;
use std::sync::Arc;

use ecmsk::link::tcp::machine;
use ecmsk::link::uri::LinkUri;
use ecmsk::link::{CarriedFile, LinkError};
use ecmsk::port::tcp::ServeOptions;
use support::tcp::{Puppet, Raw, connect, hello, options, serve_link, uri};

/// The file comes whole, however long it is and whoever else is connected; a client that asks takes no place of others.
#[test]
fn a_server_tells_its_machine_file_beside_its_clients() {
    for text in ["", "format = 1\n", &"# a line of a long file: \u{FC}\n".repeat(3000)] {
        let file = (!text.is_empty()).then(|| CarriedFile::new(Path::new("/machines/portal.toml"), text));
        let (options, _told) = options();
        let options = ServeOptions { machine: file.clone().map(Arc::new), max_clients: 1, ..options };
        let server = serve_link(Puppet::new(), options);
        let link = LinkUri::parse(&uri(&server, "")).unwrap();
        assert_eq!(machine(&link), Ok(file.clone()));
        let _writer = connect(&server, "");
        for _ in 0..3 {
            assert_eq!(machine(&link), Ok(file.clone()));
        }
        let error = machine(&LinkUri::parse("sim:").unwrap()).unwrap_err();
        assert!(matches!(error, LinkError::Uri { .. }), "{error:?}");
    }
}

/// Clients that have joined to ask, and do not, keep nobody out.
#[test]
fn idle_clients_keep_no_machine_file_back() {
    let file = CarriedFile::new(Path::new("/machines/portal.toml"), "format = 1\n");
    let (options, _told) = options();
    let options = ServeOptions { machine: Some(Arc::new(file.clone())), ..options };
    let server = serve_link(Puppet::new(), options);
    let mut hello = hello(false, 3_600_000);
    hello[4] = 3;
    let _idle: Vec<Raw> = (0..20)
        .map(|_| {
            let mut raw = Raw::connect(&server);
            raw.send(&hello);
            assert_eq!(raw.answer().expect("an answer").0, 0x81, "a welcome");
            raw
        })
        .collect();
    assert_eq!(machine(&LinkUri::parse(&uri(&server, "")).unwrap()), Ok(Some(file)));
}

/// A server that does not know such clients yet refuses the role in their first message. That is an error, and no wait.
#[test]
fn a_server_from_before_refuses_who_asks() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let link = LinkUri::parse(&format!("tcp://{}", listener.local_addr().unwrap())).unwrap();
    let server = std::thread::spawn(move || {
        let (mut client, _) = listener.accept().unwrap();
        client.write_all(b"ecmsktcp\x04\x00\x00\x01\x00\x00\x00\x00").unwrap();
        let mut hello = [0; 5];
        client.read_exact(&mut hello).unwrap();
        let text = b"a message of kind 0x01 has 3 for a role";
        let length = (3 + text.len()) as u8;
        client.write_all(&[&[length, 0, 0x82, 0, 5, text.len() as u8, 0], &text[..]].concat()).unwrap();
        hello[4]
    });
    let error = machine(&link).unwrap_err();
    assert!(error.to_string().contains("its server did not understand"), "{error}");
    assert_eq!(server.join().unwrap(), 3, "the role");
}

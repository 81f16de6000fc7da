//! Test: an attacker between client and server, with a TLS session to each of them.

use std::io::ErrorKind;
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use super::{ServeOptions, Server};
use crate::link::{self, LinkError, Share};
use crate::tcp::wire::{GREETING_LEN, Greeting, Message, Welcome};
use crate::tcp::{Channel, Inbox, Out, Secret, ServerTls, client_session, first_message};

/// An attacker who ends the client's TLS session and begins one with the server is refused by both: the proof of the
/// client is not valid in another session.
#[test]
fn somebody_in_between_gets_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("secret");
    write_secret(&file);
    let options = ServeOptions {
        listen: ([127, 0, 0, 1], 0).into(),
        secret: Some(Secret::load(&file).unwrap()),
        ..ServeOptions::default()
    };
    let server = Server::start(|| link::open("sim:?clock=virtual&name=between", Share::ByUri), options).unwrap();

    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let place = listener.local_addr().unwrap();
    let hellos = Arc::new(AtomicUsize::new(0));
    let (seen, address) = (Arc::clone(&hellos), server.address());
    let between = std::thread::spawn(move || {
        let deadline = Instant::now() + Duration::from_secs(30);
        let victim = accept_client(&listener, deadline);
        let mut server = Channel::new(TcpStream::connect(address).unwrap()).unwrap();
        let mut greeting = [0; GREETING_LEN];
        while server.receive_plain(&mut greeting).is_err_and(|error| error.kind() == ErrorKind::WouldBlock) {
            server.wait(false, Some(Duration::from_millis(100))).unwrap();
        }
        server.secure(client_session().unwrap(), deadline).unwrap();
        // The attacker passes on the next message of the client, then the next one of the server.
        for (from, to) in [(&victim, &server), (&server, &victim)] {
            let mut out = Out::default();
            let staged = first_message(from, &mut Inbox::default(), deadline, |message| {
                if let Message::Hello(hello) = &message {
                    assert_ne!(hello.proof, &[0; 32]);
                    seen.fetch_add(1, Ordering::Relaxed);
                }
                to.stage(&message, &mut out)
            });
            staged.unwrap().unwrap();
            to.flush(&mut out, deadline).unwrap();
        }
        (victim, server)
    });

    let uri = format!("tcp://{place}?secret_file={}", file.display());
    let error = link::open(&uri, Share::ByName).err().expect("no link");
    assert!(matches!(error, LinkError::NoBoard { .. }) && error.to_string().contains("another secret"), "{error}");
    assert_eq!(hellos.load(Ordering::Relaxed), 1);
    drop(between.join().unwrap());
    let straight = format!("tcp://{}?secret_file={}", server.address(), file.display());
    link::open(&straight, Share::ByName).unwrap();
}

/// An attacker who pretends to be the server and welcomes everybody gets no client: it does not know the secret, and
/// the client's own proof, sent back, is not valid.
#[test]
fn somebody_who_pretends_gets_no_client() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("secret");
    write_secret(&file);
    for sends_back in [false, true] {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let place = listener.local_addr().unwrap();
        let pretending = std::thread::spawn(move || {
            let deadline = Instant::now() + Duration::from_secs(30);
            let mut out = Out::default();
            let victim = accept_client(&listener, deadline);
            let proof = first_message(&victim, &mut Inbox::default(), deadline, |message| match message {
                Message::Hello(hello) => *hello.proof,
                other => panic!("{other:?}"),
            });
            let proof = if sends_back { proof.unwrap() } else { [0; 32] };
            let board = "sim:";
            let (now, sequence) = (crate::link::Stamp(0), 0);
            let (slaves, counts_per_unit) = ("", "");
            let (slot, virtual_time) = (None, false);
            let welcome = Welcome { proof: &proof, slot, virtual_time, now, sequence, board, slaves, counts_per_unit };
            victim.stage(&Message::Welcome(welcome), &mut out).unwrap();
            victim.flush(&mut out, deadline).unwrap();
            victim
        });
        let uri = format!("tcp://{place}?secret_file={}", file.display());
        let error = link::open(&uri, Share::ByName).err().expect("no link");
        assert!(error.to_string().contains("does not know the secret"), "{error}");
        drop(pretending.join().unwrap());
    }
}

fn write_secret(file: &std::path::Path) {
    std::fs::write(file, "0123456789abcdef0123456789abcdef\n").unwrap();
    // Only the owner may read the file of the secret: the library refuses one that others may read.
    #[cfg(unix)]
    std::fs::set_permissions(file, std::os::unix::fs::PermissionsExt::from_mode(0o600)).unwrap();
}

/// Accepts the next client on `listener` and returns the attacker's TLS session with it. The client takes the attacker
/// for the server.
fn accept_client(listener: &TcpListener, deadline: Instant) -> Channel {
    let mut out = Out::default();
    let mut client = Channel::new(listener.accept().unwrap().0).unwrap();
    client.stage_plain(&Greeting { tls: true, has_room: true }.encode(), &mut out);
    client.flush(&mut out, deadline).unwrap();
    client.secure(ServerTls::new().unwrap().accept().unwrap(), deadline).unwrap();
    client
}

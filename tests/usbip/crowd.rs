//! Clients that send nonsense, many clients, and clients that never read.

use std::io::Write;
use std::time::Duration;

use ecmsk::port::usbip::{Event, Options};

use super::puppet::{options, serve};
use support::usbip_client::{Client, IN, OUT, Reply, submit, unlink};

/// A client after nonsense gets the board, and it works.
fn works(server: &ecmsk::port::usbip::Server) {
    let mut client = Client::attached_in_time(server.address());
    let given = client.give(&[7; 512]);
    assert_eq!(client.reply(), Reply::done(given, 512));
}

#[test]
fn who_speaks_another_protocol_is_sent_away() {
    let (_, server, heard) = serve(options());
    let requests: [&[u8]; 5] = [
        b"GET / HTTP/1.1\r\n\r\n",
        &[0; 8],
        &[0x01, 0x06, 0x80, 0x05, 0, 0, 0, 0],
        &[0x01, 0x11, 0x80, 0x06, 0, 0, 0, 0],
        &[&[0x01, 0x11, 0x80, 0x03, 0, 0, 0, 0][..], &[0xFF; 32]].concat(),
    ];
    for request in requests {
        let mut client = Client::connect(server.address());
        client.send(request);
        assert!(client.is_cut(), "{request:x?}");
    }
    heard.until(
        "it says so",
        |event| matches!(event, Event::ClientRejected { why, .. } if why.contains("use a newer client")),
    );
    works(&server);
}

#[test]
fn nonsense_in_the_traffic_ends_it() {
    let (_, server, heard) = serve(options());
    let with = |at: usize, value: u32| {
        let mut header = submit(9, OUT, 2, 0, [0; 8]);
        header[at..at + 4].copy_from_slice(&value.to_be_bytes());
        header
    };
    let mut stranger = unlink(1, 1);
    stranger[8..12].copy_from_slice(&7_u32.to_be_bytes());
    let nonsense =
        [with(0, 0), with(0, 3), with(8, 2), with(12, 5), with(16, 99), with(24, u32::MAX), with(32, 3), stranger];
    for header in nonsense {
        let mut client = Client::attached_in_time(server.address());
        // The server may have closed the connection before it has received everything.
        let _ = client.stream.write_all(&header);
        assert!(client.is_cut(), "{header:x?}");
    }
    let named = |word: &'static str| move |event: &Event| matches!(event, Event::Ended { why, .. } if why.to_string().contains(word));
    heard.until("a stranger", named("command is for device 0x00000007"));
    heard.until("a length", named("more than 65536"));
    works(&server);
}

#[test]
fn who_goes_in_the_middle_of_a_message_has_gone() {
    let (puppet, server, _) = serve(options());
    for len in [0, 1, 7, 8, 39] {
        let mut client = Client::connect(server.address());
        let request = [&[0x01, 0x11, 0x80, 0x03, 0, 0, 0, 0][..], &[b'1'; 32]].concat();
        client.send(&request[..len]);
    }
    for len in [1, 47, 48, 300] {
        let mut client = Client::attached_in_time(server.address());
        let message = [&submit(9, OUT, 2, 512, [0; 8])[..], &[1; 512]].concat();
        client.send(&message[..len]);
    }
    works(&server);
    assert_eq!(puppet.written(), [7], "no part of a frame");
}

#[test]
fn a_thousand_connections_one_after_the_other() {
    let (_, server, _) = serve(options());
    for number in 0..1000 {
        match number % 4 {
            0 => drop(Client::connect(server.address())),
            1 => assert_eq!(Client::connect(server.address()).import("9-9"), Err(4)),
            2 => assert_eq!(Client::connect(server.address()).devices().0, ["1-1"]),
            _ => drop(Client::attached_in_time(server.address())),
        }
    }
    works(&server);
}

/// The oldest client without a request is closed to make room.
#[test]
fn clients_that_ask_for_nothing_do_not_keep_others_away() {
    let (_, server, _) = serve(Options { clients: 4, request_timeout: Duration::from_secs(3600), ..options() });
    let mut idle: Vec<Client> = (0..100).map(|_| Client::connect(server.address())).collect();
    works(&server);
    assert!(idle[0].is_cut(), "the oldest");
    assert_eq!(idle[99].import("8-8"), Err(4), "the youngest is heard still");
}

#[test]
fn a_client_that_asks_for_nothing_is_sent_away_after_a_while() {
    let (_, server, heard) = serve(Options { request_timeout: Duration::from_millis(20), ..options() });
    let mut client = Client::connect(server.address());
    client.send(&[0x01, 0x11]);
    assert!(client.is_cut());
    heard.until("it says so", |event| matches!(event, Event::ClientRejected { .. }));
}

/// The requests of such a client are not queued: the server reads no more until it has sent the pending answers.
#[test]
fn a_host_that_never_reads_loses_the_board() {
    let (_, server, heard) = serve(Options {
        send_timeout: Duration::from_millis(50),
        request_timeout: Duration::from_secs(3600),
        ..options()
    });
    let mut client = Client::attached(server.address());
    let wish = submit(9, IN, 0, 41, [0x80, 6, 0, 2, 0, 0, 41, 0]);
    while client.stream.write_all(&wish).is_ok() {}
    assert!(heard.end().contains("read nothing"));
    works(&server);
}

#[test]
fn a_host_with_too_many_transfers_is_sent_away() {
    let (_, server, heard) = serve(options());
    let mut client = Client::attached(server.address());
    while client.stream.write_all(&submit(9, IN, 1, 512, [0; 8])).is_ok() {}
    assert!(heard.end().contains("transfers under way"));
    works(&server);
}

//! Exchanges, lines and waits; invalid requests.

use ecmsk::link::chip::{ChipLink, SimChip};
use ecmsk::link::uri::LinkUri;
use ecmsk::port::xf::{Options, Server};
use ecmsk::xf::host::{HostConfig, Wires};

use crate::client::{CLOSE, Client, DELAY, EXCHANGE, INT1, RESET, Remote, WAIT_INT0, any_port, serve};

const OLD: &str = "xf-sim:?slaves=drive&clock=virtual&chip_fw=old&int0=yes";

/// XF-14.1 The greeting names the protocol, its version and the longest exchange.
#[test]
fn the_greeting() {
    let (server, _) = serve(OLD);
    let client = Client::connect(server.listen());
    assert_eq!(client.greeting, (0, 0, b"ECMXF\x01\x00\x10".to_vec()));
}

/// XF-14.2 Bytes pass in both directions as on the chip's own link, however they are divided into exchanges: a few
/// bytes, a packet of the old chip (144), several.
#[test]
fn bytes_pass_unchanged() {
    let (server, _) = serve(OLD);
    let mut client = Client::connect(server.listen());
    let mut chip = SimChip::from_uri(&LinkUri::parse(OLD).expect("a link")).expect("a chip");
    let second = chip.now() + 1_000_000_000;
    chip.wait_until(second).expect("it waits");
    assert_eq!(client.ask(DELAY, &1_000_000_u32.to_le_bytes()), (0, Vec::new()));
    let mut seed = 1_u32;
    for len in [1, 143, 144, 7, 137, 4096, 144, 288, 1000] {
        let to_chip: Vec<u8> = std::iter::repeat_with(|| {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (seed >> 24) as u8
        })
        .take(len)
        .collect();
        let mut from_chip = vec![0; len];
        chip.exchange(&to_chip, &mut from_chip).expect("it passes");
        assert_eq!(client.exchange(&to_chip), from_chip, "{len} bytes");
        assert!(len < 144 || from_chip.iter().any(|byte| *byte != 0));
    }
}

/// XF-14.3 A host waits for INT0 as on the link: it becomes active once after an exchange, and not again; INT1 is read.
#[test]
fn lines() {
    let (server, _) = serve(OLD);
    let mut client = Client::connect(server.listen());
    client.ask(DELAY, &1_000_000_u32.to_le_bytes());
    client.exchange(&[0; 144]);
    assert_eq!(client.ask(WAIT_INT0, &100_000_u32.to_le_bytes()), (0, vec![1]));
    assert_eq!(client.ask(WAIT_INT0, &100_000_u32.to_le_bytes()), (0, vec![0]));
    let mut chip = SimChip::from_uri(&LinkUri::parse(OLD).expect("a link")).expect("a chip");
    let level = chip.int1().expect("it can be read").expect("it is wired");
    assert_eq!(client.ask(INT1, &[]), (0, vec![u8::from(level)]));
}

/// XF-14.14 XF-11.74 A host resets the chip in the middle of a packet: it starts as after power-on, with the first byte
/// of a packet and fixed check words. A link without the line reports that.
///
/// Row: reset.
#[test]
fn the_chip_is_reset() {
    let (server, _) = serve(OLD);
    let mut client = Client::connect(server.listen());
    let second = 1_000_000_u32.to_le_bytes();
    client.ask(DELAY, &second);
    let first = client.exchange(&[0; 144]);
    client.exchange(&[0; 100]);
    assert_eq!(client.ask(RESET, &[]), (0, Vec::new()));
    let starting = client.exchange(&[0; 144]);
    assert_eq!(
        (&starting[..4], &starting[136..]),
        (&first[..4], &[0x21, 0x43, 0x65, 0x87, 0x59, 0x58, 0x57, 0x56][..])
    );
    client.ask(DELAY, &second);
    assert_eq!(client.exchange(&[0; 144]), first);
    assert_eq!(client.ask(CLOSE, &[]), (0, Vec::new()));

    // A link of this test, without a reset line.
    let listen = server.listen().clone();
    let open = move || Ok((Box::new(Remote::connect(&listen)) as Box<dyn ChipLink>, HostConfig::DEFAULT));
    let options = Options { listen: any_port(), ..Options::default() };
    let without = Server::start(open, options).expect("it can be served");
    let mut client = Client::connect(without.listen());
    let (status, text) = client.ask(RESET, &[]);
    assert_eq!((status, String::from_utf8(text).expect("text").contains("reset line is not wired")), (3, true));
}

/// XF-14.3 A line that is not wired is reported as missing.
#[test]
fn a_line_that_is_not_wired() {
    let (server, _) = serve("xf-sim:?clock=virtual");
    let mut client = Client::connect(server.listen());
    let (status, text) = client.ask(WAIT_INT0, &1000_u32.to_le_bytes());
    assert_eq!((status, String::from_utf8(text).expect("text").contains("INT0 is not wired")), (3, true));
}

/// XF-14.4 An invalid request is answered with the reason, and the connection goes on.
#[test]
fn what_is_no_request() {
    let (server, _) = serve(OLD);
    let mut client = Client::connect(server.listen());
    let long = (1_000_001_u32).to_le_bytes();
    let cases: [(u8, &[u8], &str); 10] = [
        (0, &[], "no request has the kind 0"),
        (RESET, b"body", "has to have 0"),
        (7, &[], "no request has the kind 7"),
        (255, &[], "no request has the kind 255"),
        (EXCHANGE, &[], "1 or more"),
        (INT1, &[0], "has to have 0"),
        (WAIT_INT0, &[0; 3], "has to have 4"),
        (DELAY, &[0; 5], "has to have 4"),
        (DELAY, &long, "1000000 us at most"),
        (CLOSE, &[1], "has to have 0"),
    ];
    for (kind, body, part) in cases {
        let (status, text) = client.ask(kind, body);
        let text = String::from_utf8(text).expect("text");
        assert!(status == 1 && text.contains(part), "{kind}: {status} {text}");
        client.exchange(&[0; 10]);
    }
}

/// XF-14.4 A length beyond that of any request ends the connection with the reason: the begin of the next one is
/// unknown.
#[test]
fn a_request_that_is_too_long() {
    let (server, log) = serve(OLD);
    let mut client = Client::connect(server.listen());
    client.send(&[EXCHANGE, 0, 0x01, 0x10]);
    let (kind, status, text) = client.receive().expect("the reason");
    let text = String::from_utf8(text).expect("text");
    assert!((kind, status) == (5, 1) && text.contains("a message of 4097 bytes"), "{kind} {status} {text}");
    assert_eq!(client.receive(), None);
    Client::connect(server.listen()).exchange(&[0; 144]);
    server.stop();
    assert!(log.lines().iter().any(|line| line.contains("a message of 4097 bytes")), "{:?}", log.lines());
}

/// XF-14.4 Requests may be sent ahead, and in pieces: each gets its answer, in order.
#[test]
fn requests_ahead_and_in_pieces() {
    let (server, _) = serve(OLD);
    let mut client = Client::connect(server.listen());
    let mut ahead = Vec::new();
    for len in 1..=200_u16 {
        ahead.extend([EXCHANGE, 0]);
        ahead.extend(len.to_le_bytes());
        ahead.extend(vec![0; len.into()]);
    }
    for piece in ahead.chunks(777) {
        client.send(piece);
    }
    for len in 1..=200 {
        let (kind, status, body) = client.receive().expect("an answer");
        assert_eq!((kind, status, body.len()), (EXCHANGE, 0, len));
    }
}

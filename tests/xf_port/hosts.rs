//! One host at a time, hosts that stop reading or writing, links that fail.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::Duration;

use ecmsk::ethercat::Ns;
use ecmsk::link::chip::{self, ChipError, ChipInfo, ChipLink};
use ecmsk::port::xf::{Options, Server};
use ecmsk::xf::host::Wires;

use crate::client::{CLOSE, Client, EXCHANGE, any_port, serve, serve_with};

const URI: &str = "xf-sim:?slaves=drive&clock=virtual&chip_fw=old";

/// XF-14.5 A second host gets an error that names the first one, which is not affected; when the first one has closed,
/// the next one gets the chip.
#[test]
fn one_host_at_a_time() {
    let (server, _) = serve(URI);
    let mut first = Client::connect(server.listen());
    first.exchange(&[0; 144]);
    let mut second = Client::connect(server.listen());
    let (kind, status, text) = second.greeting.clone();
    let text = String::from_utf8(text).expect("text");
    assert!((kind, status) == (0, 2) && text.contains("has the chip"), "{kind} {status} {text}");
    assert_eq!(second.receive(), None);
    first.exchange(&[0; 144]);
    assert_eq!(first.ask(CLOSE, &[]), (0, Vec::new()));
    assert_eq!(first.receive(), None);
    let mut third = Client::connect_when_free(server.listen());
    third.exchange(&[0; 144]);
}

/// XF-14.6 A host that does not send the rest of a message loses the chip.
#[test]
fn half_a_message() {
    for half in [&[EXCHANGE][..], &[EXCHANGE, 0, 144], &[EXCHANGE, 0, 144, 0, 1, 2, 3]] {
        let options = Options { listen: any_port(), message_limit: Duration::from_millis(50), ..Options::default() };
        let (server, log) = serve_with(URI, options);
        let mut client = Client::connect(server.listen());
        client.send(half);
        let (kind, status, text) = client.receive().expect("the reason");
        let text = String::from_utf8(text).expect("text");
        assert!((kind, status) == (5, 5) && text.contains("the rest of a message has not come"), "{text}");
        assert_eq!(client.receive(), None);
        Client::connect_when_free(server.listen());
        server.stop();
        assert!(log.lines().iter().any(|line| line.contains("the rest of a message")), "{:?}", log.lines());
    }
}

/// XF-14.13 A silent connection loses the chip, and the next host gets it; a host that has sent a request may be
/// silent.
#[test]
fn a_silent_stranger() {
    let options = Options { listen: any_port(), message_limit: Duration::from_millis(50), ..Options::default() };
    let (server, log) = serve_with(URI, options);
    let mut stranger = Client::connect(server.listen());
    let (kind, status, text) = stranger.receive().expect("the reason");
    let text = String::from_utf8(text).expect("text");
    assert!((kind, status) == (5, 5) && text.contains("no request has come"), "{text}");
    assert_eq!(stranger.receive(), None);
    let mut host = Client::connect_when_free(server.listen());
    host.exchange(&[0; 144]);
    std::thread::sleep(Duration::from_millis(200));
    host.exchange(&[0; 144]);
    server.stop();
    assert!(log.lines().iter().any(|line| line.contains("no request has come")), "{:?}", log.lines());
}

/// XF-14.6 A host that sends requests and reads no answer loses the chip; the server keeps only one answer for it.
#[test]
fn a_host_that_never_reads() {
    let options = Options { listen: any_port(), message_limit: Duration::from_millis(50), ..Options::default() };
    let (server, log) = serve_with(URI, options);
    let mut client = Client::connect(server.listen());
    // Until the server closes: the waiting answers limit the requests it takes.
    while client.send_request(EXCHANGE, &[0; 4096]).is_ok() {}
    Client::connect_when_free(server.listen());
    server.stop();
    assert!(log.lines().iter().any(|line| line.contains("it does not read the answers")), "{:?}", log.lines());
}

/// XF-14.6 A connection that ends within a message, or before the first one, does not affect the next host.
#[test]
fn connections_that_end() {
    let (server, _) = serve(URI);
    for sent in [&[][..], &[EXCHANGE], &[EXCHANGE, 0, 144, 0, 1, 2, 3]] {
        let mut client = Client::connect_when_free(server.listen());
        client.send(sent);
        client.hang_up();
    }
    Client::connect(server.listen()).exchange(&[0; 144]);
}

/// A link that fails while `fails` is set.
struct Failing {
    inner: Box<dyn ChipLink>,
    fails: Arc<AtomicBool>,
}

impl Wires for Failing {
    type Error = ChipError;

    fn now(&self) -> Ns {
        self.inner.now()
    }

    fn exchange(&mut self, to_chip: &[u8], from_chip: &mut [u8]) -> Result<(), ChipError> {
        if self.fails.load(Ordering::SeqCst) {
            return Err(ChipError::Wires { name: "wires".into(), message: "the cable is pulled; plug it".into() });
        }
        self.inner.exchange(to_chip, from_chip)
    }

    fn wait_until(&mut self, time: Ns) -> Result<(), ChipError> {
        self.inner.wait_until(time)
    }

    fn wait_ready(&mut self, until: Ns) -> Result<bool, ChipError> {
        self.inner.wait_ready(until)
    }
}

impl ChipLink for Failing {
    fn info(&self) -> ChipInfo {
        self.inner.info()
    }

    fn int1(&mut self) -> Result<Option<bool>, ChipError> {
        self.inner.int1()
    }
}

/// XF-14.7 A link's failure is reported to the host, which may go on; for the next host the link is opened again, and
/// if that fails the host gets the reason.
#[test]
fn a_link_that_fails() {
    let (fails, opened) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicU32::new(0)));
    let (its_fails, its_opened) = (Arc::clone(&fails), Arc::clone(&opened));
    let open = move || {
        let nth = its_opened.fetch_add(1, Ordering::SeqCst);
        if nth == 1 {
            return Err(ChipError::Wires { name: "wires".into(), message: "nothing is there; plug it".into() });
        }
        let (inner, config) = chip::open(URI)?;
        let link: Box<dyn ChipLink> = Box::new(Failing { inner, fails: Arc::clone(&its_fails) });
        Ok((link, config))
    };
    let server = Server::start(open, Options { listen: any_port(), ..Options::default() }).expect("it is served");
    let mut client = Client::connect(server.listen());
    fails.store(true, Ordering::SeqCst);
    let (status, text) = client.ask(EXCHANGE, &[0; 144]);
    assert_eq!((status, text), (4, b"wires: the cable is pulled; plug it".to_vec()));
    fails.store(false, Ordering::SeqCst);
    client.exchange(&[0; 144]);
    fails.store(true, Ordering::SeqCst);
    client.ask(EXCHANGE, &[0; 144]);
    client.ask(CLOSE, &[]);
    fails.store(false, Ordering::SeqCst);
    let second = Client::connect(server.listen());
    assert_eq!(second.greeting, (0, 4, b"wires: nothing is there; plug it".to_vec()));
    let mut third = Client::connect_when_free(server.listen());
    third.exchange(&[0; 144]);
    assert_eq!(opened.load(Ordering::SeqCst), 3);
}

//! `usbip_port`: a report through the port of USB/IP over TCP, against the smallest possible server, which answers each
//! request by the same report. The client has as many requests under way as the link `usb:` has; the board always has a
//! report.

mod common;
#[path = "common/places.rs"]
mod places;

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::thread;

use common::Demand;
use ecmsk::link::{Dir, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Stamp, Wait};
use ecmsk::port::usbip::{BoardSpec, Identity, Options, Server};
use ecmsk::sk::Frame;
use places::Places;

const UNDER_WAY: u32 = 8;
const REPORTS: u32 = 4000;
const BLOCKS: usize = 21;
/// Bytes of a message's header, and of one with a report.
const HEADER: usize = 48;
const ANSWER: usize = HEADER + 512;
/// At least 0.8 of the baseline's reports per second.
const TARGET: f64 = 1.0 / 0.8;

fn main() {
    let places = Places::find();
    let server = places.server(serve);
    let ours = attached(server.address());
    let baseline = TcpStream::connect(places.server(smallest_server)).expect("it listens");
    baseline.set_nodelay(true).expect("a socket takes it");
    // Warm: threads are there, buffers have their size.
    for stream in [&ours, &baseline] {
        per_report_ns(stream);
    }
    let demand = Demand { name: "usbip_port", target: Some(TARGET), allowance: None, against: None };
    common::pair_of_blocks(demand, BLOCKS, || per_report_ns(&ours), || per_report_ns(&baseline));
}

/// Time of a report, mean of many.
fn per_report_ns(stream: &TcpStream) -> f64 {
    let mut stream = stream;
    let mut answer = [0; ANSWER];
    let mut asked = 0;
    let mut ask = |mut stream: &TcpStream| {
        asked += 1;
        stream.write_all(&submit(asked, 1, 1, 512, [0; 8])).expect("the server reads");
    };
    (0..UNDER_WAY).for_each(|_| ask(stream));
    let mut rest = REPORTS;
    // One block, timed here: what was under way before has been answered.
    common::per_call_ns(u64::from(REPORTS), &mut || {
        stream.read_exact(&mut answer).expect("an answer");
        rest -= 1;
        if rest >= UNDER_WAY {
            ask(stream);
        }
    })
}

/// USBIP_CMD_SUBMIT.
fn submit(sequence: u32, direction: u32, endpoint: u32, length: u32, setup: [u8; 8]) -> [u8; HEADER] {
    let mut header = [0; HEADER];
    for (at, value) in [(0, 1), (4, sequence), (8, 0x0001_0001), (12, direction), (16, endpoint), (24, length)] {
        header[at..at + 4].copy_from_slice(&u32::to_be_bytes(value));
    }
    header[40..].copy_from_slice(&setup);
    header
}

/// A client that has board 1-1, configured.
fn attached(address: SocketAddr) -> TcpStream {
    let mut stream = TcpStream::connect(address).expect("it listens");
    stream.set_nodelay(true).expect("a socket takes it");
    let mut import = [0; 8 + 32];
    import[..11].copy_from_slice(&[0x01, 0x11, 0x80, 0x03, 0, 0, 0, 0, b'1', b'-', b'1']);
    stream.write_all(&import).expect("the server reads");
    stream.read_exact(&mut [0; 8 + 312]).expect("the board is free");
    stream.write_all(&submit(0, 0, 0, 0, [0, 9, 1, 0, 0, 0, 0, 0])).expect("the server reads");
    stream.read_exact(&mut [0; HEADER]).expect("it is configured");
    stream
}

fn serve() -> Server {
    let opener = || Ok(Arc::new(Ready) as Arc<dyn Link>);
    let boards = vec![BoardSpec { identity: Identity::default(), opener: Box::new(opener) }];
    let options = Options { listen: SocketAddr::from(([127, 0, 0, 1], 0)), ..Options::default() };
    Server::start(options, boards, Arc::new(|_| {})).expect("it starts")
}

/// One thread: a header in, the report out.
fn smallest_server() -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let address = listener.local_addr().expect("it is bound");
    thread::spawn(move || {
        let (mut stream, _) = listener.accept().expect("a client");
        stream.set_nodelay(true).expect("a socket takes it");
        let mut header = [0; HEADER];
        let mut answer = [0; ANSWER];
        answer[3] = 3;
        answer[26] = 2;
        while stream.read_exact(&mut header).is_ok() {
            answer[4..8].copy_from_slice(&header[4..8]);
            if stream.write_all(&answer).is_err() {
                return;
            }
        }
    });
    address
}

/// A board that always has a report.
struct Ready;

impl Link for Ready {
    fn info(&self) -> LinkInfo {
        LinkInfo {
            name: "ready:".into(),
            slot: None,
            virtual_time: false,
            opened_at: Stamp(0),
            read_wait: Wait::Forever,
            write_wait: Wait::Forever,
        }
    }
    fn write(&self, _: &Frame, _: Wait) -> Result<Stamp, LinkError> {
        Ok(Stamp(0))
    }
    fn read(&self, out: &mut Frame, _: Wait) -> Result<ReadMeta, LinkError> {
        out.bytes_mut()[0] = 0xBF;
        Ok(ReadMeta::default())
    }
    fn cancel(&self, _: Dir) {}
    fn close(&self) {}
    fn check(&self) -> Result<(), LinkError> {
        Ok(())
    }
    fn stats(&self) -> LinkStats {
        LinkStats::default()
    }
}

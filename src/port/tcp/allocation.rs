//! Test: a server allocates nothing for a report or a frame.

use std::io::Read as _;
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::time::Duration;

use super::ServeOptions;
use super::board::Board;
use super::client::Client;
use super::hub::{Hub, Joining};
use super::session::Session;
use crate::link::{Layer, Link, LinkError, LinkInfo, ReadMeta, Share, Stamp, Wait};
use crate::sk::Frame;
use crate::tcp::wire::{MESSAGE_MAX, Message, Role};
use crate::tcp::{Channel, Inbox, PROOF_LEN};

/// Frames and reports through a server, with a client that reads and one that does not, allocate nothing.
#[test]
fn a_cycle_allocates_nothing() {
    let link = crate::open::open("sim:?clock=virtual&name=allocation", Share::ByName).unwrap();
    let hub = Arc::new(Hub::new(ServeOptions::default()));
    // The test makes the reports itself and passes them to the hub; the board behind the link only takes the writes.
    let board = hub.attach(Arc::new(Real(link)));
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let mut clients = Vec::new();
    for role in [Role::Writer, Role::Reader] {
        let end = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let channel = Some(Channel::new(listener.accept().unwrap().0).unwrap());
        let keepalive = Duration::from_secs(1);
        let mut joining = Joining { who: String::new(), role, keepalive, proof: &[0; PROOF_LEN], channel };
        let Ok((client, _)) = hub.join(&mut joining) else { panic!("it is taken") };
        clients.push((client, end));
    }
    let mut reads = clients[0].1.try_clone().unwrap();
    std::thread::spawn(move || while reads.read(&mut [0; 4096]).is_ok_and(|count| count > 0) {});
    let mut session = Session::new(&hub, Arc::clone(&board), Arc::clone(&clients[0].0));
    let mut cycles = cycles(&hub, &board, &clients[0].0, &mut session);
    // The second client reads nothing. It takes no more reports once the kernel's buffers, whose size is not known, are
    // full.
    let takes_no_more = || clients[1].0.is_blocked() && clients[1].0.dropped() > 0;
    for _ in 0..100 {
        cycles(1000);
        if takes_no_more() {
            break;
        }
    }
    assert!(takes_no_more());
    let counted = allocation_counter::measure(|| cycles(1000));
    assert_eq!(counted.count_total, 0, "{counted:?}");
    assert!(!clients[0].0.is_over());
}

/// Returns a function that runs as many cycles as its argument says. In each cycle a write of the writer arrives, its
/// answer is sent, and a report goes to all clients.
fn cycles<'a>(
    hub: &'a Hub,
    board: &'a Arc<Board>,
    writer: &'a Client,
    session: &'a mut Session<'_>,
) -> impl FnMut(u64) + 'a {
    let mut inbox = Inbox::default();
    let mut sequence = 0;
    let mut bytes = [0; MESSAGE_MAX];
    move |count| {
        for _ in 0..count {
            let frame = Frame::new();
            let write =
                Message::Write { request: sequence, wait: Wait::For(Duration::from_secs(1)), frame: frame.bytes() };
            let length = write.encode(&mut bytes);
            inbox.room()[..length].copy_from_slice(&bytes[..length]);
            inbox.came(length);
            session.take(&inbox.next().unwrap().unwrap()).unwrap();
            assert!(!session.is_busy());
            hub.publish(board, &frame, ReadMeta { at: Stamp(sequence), sequence, dropped: 0 });
            sequence += 1;
            while writer.is_blocked() {
                std::thread::yield_now();
                writer.flush();
            }
        }
    }
}

/// A link that claims to run in real time, so that the server handles it like a real board.
struct Real(Arc<dyn Link>);

impl Layer for Real {
    fn inner(&self) -> &dyn Link {
        &*self.0
    }

    fn info(&self) -> LinkInfo {
        LinkInfo { virtual_time: false, ..self.0.info() }
    }

    fn pass(&self, _: Duration) -> Result<Option<Stamp>, LinkError> {
        Ok(None)
    }
}

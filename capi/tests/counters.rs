//! Counters at their maximum, through the C functions, which must not panic into their caller.

use std::ffi::{CString, c_char, c_void};
use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::{ptr, thread};

// Links the C functions, which are found by their names.
use NEXTWUSBLib as _;

unsafe extern "C" {
    fn ecmsk_open(uri: *const c_char, board: *mut *mut c_void) -> i32;
    fn ecmsk_read(board: *mut c_void, data: *mut u8, length: usize, timeout_ms: i64) -> i32;
    fn ecmsk_get_stats(board: *mut c_void, stats: *mut Stats) -> i32;
    fn ecmsk_close(board: *mut c_void) -> i32;
}

/// The beginning of `ecmsk_stats`.
#[derive(Default)]
#[repr(C)]
struct Stats {
    size: u32,
    reserved: u32,
    written: u64,
    read: u64,
    reports_dropped: u64,
}

/// Kinds of messages of the protocol.
const COUNT: u8 = 0x05;
const WELCOME: u8 = 0x81;
const REPORT: u8 = 0x83;
const COUNTED: u8 = 0x87;

fn message(kind: u8, payload: &[u8]) -> Vec<u8> {
    let mut bytes = (payload.len() as u16).to_le_bytes().to_vec();
    bytes.extend([kind, 0]);
    bytes.extend(payload);
    bytes
}

/// A server's first messages: its greeting, and the acceptance of the client.
fn welcome() -> Vec<u8> {
    let mut payload = vec![0; 32];
    payload.extend([12, 0]);
    payload.extend([0; 16]);
    payload.extend(1_u16.to_le_bytes());
    payload.push(b'x');
    // No slaves and no units are known.
    payload.extend([0; 4]);
    [&b"ecmsktcp\x04\x00\x00\x01\x00\x00\x00\x00"[..], &message(WELCOME, &payload)].concat()
}

/// A server that has dropped as many reports as can be counted, as it states in every report and every answer.
fn serve(mut socket: TcpStream) {
    let mut said = welcome();
    for _ in 0..4 {
        let meta = [1, u64::MAX, u64::MAX].map(u64::to_le_bytes).concat();
        said.extend(message(REPORT, &[&meta[..], &[0; 512]].concat()));
    }
    socket.write_all(&said).expect("a client");
    let mut header = [0; 4];
    while socket.read_exact(&mut header).is_ok() {
        let mut payload = vec![0; u16::from_le_bytes([header[0], header[1]]).into()];
        socket.read_exact(&mut payload).expect("a whole message");
        if header[2] == COUNT {
            let counts = [&payload[..8], &u64::MAX.to_le_bytes(), &[0]].concat();
            socket.write_all(&message(COUNTED, &counts)).expect("a client");
        }
    }
}

/// LIB-67 Counters of another program or machine may be at their maximum: the library's sums stay there, and neither
/// wrap to 0 nor end the call with an error or a panic. The library drops reports of that server, too, since its queue
/// holds two.
#[test]
fn a_counter_at_its_end_stays_there() {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let uri = format!("tcp://{}?queue=2", listener.local_addr().expect("bound"));
    let server = thread::spawn(move || serve(listener.accept().expect("the client").0));
    let uri = CString::new(uri).expect("no NUL");
    let mut board = ptr::null_mut();
    let mut stats = Stats { size: size_of::<Stats>() as u32, ..Stats::default() };
    let mut report = [0; 512];
    // SAFETY: every pointer is to a variable of that type, and the buffer has the given length.
    unsafe {
        assert_eq!(ecmsk_open(uri.as_ptr(), &mut board), 0);
        for _ in 0..2 {
            assert_eq!(ecmsk_read(board, report.as_mut_ptr(), report.len(), 5000), 0);
            assert_eq!(ecmsk_get_stats(board, &mut stats), 0);
            assert_eq!(stats.reports_dropped, u64::MAX);
        }
        assert_eq!(ecmsk_close(board), 0);
    }
    server.join().expect("it served");
}

//! A cable between a client and a server that a test can cut.

use std::io::{Read as _, Write as _};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;

/// Carries one connection.
pub struct Cable {
    pub address: SocketAddr,
    ends: thread::JoinHandle<[TcpStream; 2]>,
    silent: Arc<AtomicBool>,
    carried: Arc<Mutex<Vec<u8>>>,
}

impl Cable {
    pub fn to(server: SocketAddr) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let silent = Arc::new(AtomicBool::new(false));
        let carried = Arc::new(Mutex::new(Vec::new()));
        let ends = thread::spawn({
            let (silent, carried) = (Arc::clone(&silent), Arc::clone(&carried));
            move || {
                let (client, _) = listener.accept().unwrap();
                let server = TcpStream::connect(server).unwrap();
                for (from, to) in [(&client, &server), (&server, &client)] {
                    from.set_nodelay(true).unwrap();
                    let (from, to) = (from.try_clone().unwrap(), to.try_clone().unwrap());
                    let (silent, carried) = (Arc::clone(&silent), Arc::clone(&carried));
                    thread::spawn(move || carry(from, to, &silent, &carried));
                }
                [client, server]
            }
        });
        Self { address, ends, silent, carried }
    }

    /// The bytes carried so far, both ways.
    pub fn carried(&self) -> Vec<u8> {
        self.carried.lock().unwrap().clone()
    }

    /// Ends the connection, as when a process dies: without a good-bye.
    pub fn cut(self) {
        for end in self.ends.join().unwrap() {
            let _ = end.shutdown(Shutdown::Both);
        }
    }

    /// Stops all bytes without a notice to either side: a pulled cable.
    pub fn pull(&self) {
        self.silent.store(true, Ordering::Release);
    }
}

fn carry(mut from: TcpStream, mut to: TcpStream, silent: &AtomicBool, carried: &Mutex<Vec<u8>>) {
    let mut bytes = [0; 4096];
    while let Ok(count) = from.read(&mut bytes) {
        if count == 0 {
            break;
        }
        carried.lock().unwrap().extend(&bytes[..count]);
        if !silent.load(Ordering::Acquire) && to.write_all(&bytes[..count]).is_err() {
            break;
        }
    }
    if !silent.load(Ordering::Acquire) {
        let _ = to.shutdown(Shutdown::Write);
    }
}

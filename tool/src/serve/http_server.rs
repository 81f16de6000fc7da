//! The HTTP server of the tool: for the page of `serve web`, and for the metrics of any server. One thread accepts
//! connections, and each connection has a thread of its own, up to a limit. Above the limit, the oldest connection that
//! has sent no request is closed for a new one. So idle connections cannot block other clients.

use std::collections::VecDeque;
use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use super::http::{self, Refusal, Request};
use super::http_stream::{Stream, Tls};

/// After an error of accepting a connection, such as too many open files, the server waits this long before it accepts
/// the next one. \[OURS]
const AFTER_ERROR: Duration = Duration::from_millis(100);
/// A connection that was closed for a new one still counts until its thread ends. So there may be this many times the
/// limit of connections for a short time. \[OURS]
const ENDING_MAX: usize = 4;

/// The answer to who speaks HTTP without TLS to a server with TLS.
const NO_TLS: Refusal = Refusal {
    status: "400 Bad Request",
    text: "This server speaks HTTPS alone: open the address that it has printed, which begins with https.",
};

/// A running HTTP server.
pub struct HttpServer {
    address: SocketAddr,
    stop: Arc<AtomicBool>,
    thread: JoinHandle<()>,
}

impl HttpServer {
    /// Starts to accept connections. `serve` is called with the request of each connection, in a thread of its own. If
    /// there are `connections_max` connections, the oldest one that has sent no request yet is closed for a new one. If
    /// all have sent one, the new connection is closed. [`Self::stop`] sets `stop`, which ends long calls of `serve`. With
    /// `tls` the server speaks HTTPS.
    ///
    /// # Errors
    /// The system cannot start a thread, or the listener has no address.
    pub fn start(
        listener: TcpListener,
        name: &str,
        connections_max: usize,
        tls: Option<Tls>,
        stop: Arc<AtomicBool>,
        serve: impl Fn(Stream, Request) -> io::Result<()> + Send + Sync + 'static,
    ) -> io::Result<Self> {
        let address = listener.local_addr()?;
        let (ends, client) = (Arc::clone(&stop), format!("{name} client"));
        // What a connection does, in a thread of its own.
        let serve = Arc::new(move |socket: TcpStream, heard: &dyn Fn()| {
            let mut stream = Stream::new(socket, tls.as_ref()).inspect_err(|_| heard())?;
            let request = http::read(&mut stream);
            heard();
            match request? {
                Some(request) => serve(stream, request),
                None => {
                    let mut plain = stream.without_tls();
                    // Bytes that nobody reads would make the end of the connection a reset, and the answer would be lost.
                    http::read(&mut plain)?;
                    http::refuse(&mut plain, NO_TLS)?;
                    plain.finish()
                }
            }
        });
        let thread = thread::Builder::new()
            .name(name.to_owned())
            .spawn(move || accept(&listener, &client, connections_max, &ends, &serve))?;
        Ok(Self { address, stop, thread })
    }

    /// The address on which the server listens.
    pub const fn address(&self) -> SocketAddr {
        self.address
    }

    /// Ends the server.
    pub fn stop(self) {
        self.stop.store(true, Ordering::Relaxed);
        // The thread blocks in `accept` and checks the stop flag only after the next connection, so a connection is
        // made to wake it. If that fails, the thread runs until the process ends.
        if TcpStream::connect_timeout(&reachable(self.address), AFTER_ERROR).is_ok() {
            // A panic of the thread was already printed.
            let _ = self.thread.join();
        }
    }
}

/// An address at which this machine reaches a server that listens on `address`. If `address` means all addresses
/// (0.0.0.0 or ::), it is replaced by the loopback address.
fn reachable(address: SocketAddr) -> SocketAddr {
    let ip = match address.ip() {
        IpAddr::V4(ip) if ip.is_unspecified() => Ipv4Addr::LOCALHOST.into(),
        IpAddr::V6(ip) if ip.is_unspecified() => Ipv6Addr::LOCALHOST.into(),
        ip => ip,
    };
    SocketAddr::new(ip, address.port())
}

/// The connections that have sent no request yet, each with its number, oldest first.
#[derive(Default)]
struct Silent(Mutex<VecDeque<(u64, TcpStream)>>);

impl Silent {
    fn lock(&self) -> MutexGuard<'_, VecDeque<(u64, TcpStream)>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Closes the oldest of these connections. Returns false if there is none.
    fn close_oldest(&self) -> bool {
        let Some((_, oldest)) = self.lock().pop_front() else { return false };
        // This ends the read in the thread of that connection. An error means that the client has already closed it.
        let _ = oldest.shutdown(Shutdown::Both);
        true
    }

    fn remove(&self, number: u64) {
        self.lock().retain(|(of, _)| *of != number);
    }
}

fn accept<F>(listener: &TcpListener, client: &str, connections_max: usize, stop: &AtomicBool, serve: &Arc<F>)
where
    F: Fn(TcpStream, &dyn Fn()) -> io::Result<()> + Send + Sync + 'static,
{
    let (connections, silent) = (Arc::new(AtomicUsize::new(0)), Arc::new(Silent::default()));
    for (number, stream) in (0..).zip(listener.incoming()) {
        if stop.load(Ordering::Relaxed) {
            return;
        }
        let Ok((stream, copy)) = stream.and_then(|stream| Ok((stream.try_clone()?, stream))) else {
            thread::sleep(AFTER_ERROR);
            continue;
        };
        let before = connections.load(Ordering::Relaxed);
        if before >= connections_max && (before >= connections_max * ENDING_MAX || !silent.close_oldest()) {
            // The new connection is closed without a thread and without an answer, because sending an answer could
            // block this loop.
            continue;
        }
        connections.fetch_add(1, Ordering::Relaxed);
        silent.lock().push_back((number, copy));
        let (serving, count, unheard) = (Arc::clone(serve), Arc::clone(&connections), Arc::clone(&silent));
        let spawned = thread::Builder::new().name(client.to_owned()).spawn(move || {
            // An error of a connection is ignored: it ends only this connection, and the client can no longer be
            // informed.
            let _ = serving(stream, &|| unheard.remove(number));
            count.fetch_sub(1, Ordering::Relaxed);
        });
        if spawned.is_err() {
            silent.remove(number);
            connections.fetch_sub(1, Ordering::Relaxed);
        }
    }
}

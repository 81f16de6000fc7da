//! The HTTP server of the tool: for the page of `serve web`, and for the metrics of any server. A thread accepts
//! connections, and each has a thread of its own, up to a limit.

use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

/// The time before the next connection is accepted after an error, such as too many open files. \[OURS]
const AFTER_ERROR: Duration = Duration::from_millis(100);

/// A running HTTP server.
pub struct HttpServer {
    address: SocketAddr,
    stop: Arc<AtomicBool>,
    thread: JoinHandle<()>,
}

impl HttpServer {
    /// Starts to accept connections. `serve` is called for each in a thread of its own, for at most `connections_max` at a
    /// time; further ones are closed at once. `stop` is set by [`Self::stop`], for calls of `serve` that last.
    ///
    /// # Errors
    /// The system provides no thread, or the listener has no address.
    pub fn start(
        listener: TcpListener,
        name: &str,
        connections_max: usize,
        stop: Arc<AtomicBool>,
        serve: impl Fn(TcpStream) -> io::Result<()> + Send + Sync + 'static,
    ) -> io::Result<Self> {
        let address = listener.local_addr()?;
        let (ends, client) = (Arc::clone(&stop), format!("{name} client"));
        let serve = Arc::new(serve);
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
        // The thread waits in `accept` and sees the request to stop after the next connection, so this one wakes it. If the
        // connection fails, the thread runs until the process ends.
        if TcpStream::connect_timeout(&reachable(self.address), AFTER_ERROR).is_ok() {
            // A panic of the thread was printed already.
            let _ = self.thread.join();
        }
    }
}

/// An address at which this machine reaches a server that listens on `address`, which may stand for all of its addresses.
fn reachable(address: SocketAddr) -> SocketAddr {
    let ip = match address.ip() {
        IpAddr::V4(ip) if ip.is_unspecified() => Ipv4Addr::LOCALHOST.into(),
        IpAddr::V6(ip) if ip.is_unspecified() => Ipv6Addr::LOCALHOST.into(),
        ip => ip,
    };
    SocketAddr::new(ip, address.port())
}

fn accept<F>(listener: &TcpListener, client: &str, connections_max: usize, stop: &AtomicBool, serve: &Arc<F>)
where
    F: Fn(TcpStream) -> io::Result<()> + Send + Sync + 'static,
{
    let connections = Arc::new(AtomicUsize::new(0));
    for stream in listener.incoming() {
        if stop.load(Ordering::Relaxed) {
            return;
        }
        let Ok(stream) = stream else {
            thread::sleep(AFTER_ERROR);
            continue;
        };
        if connections.fetch_add(1, Ordering::Relaxed) >= connections_max {
            // A client that finds too many connections gets no thread and no answer, because sending an answer could block
            // this loop.
            connections.fetch_sub(1, Ordering::Relaxed);
            continue;
        }
        let (serving, count) = (Arc::clone(serve), Arc::clone(&connections));
        let spawned = thread::Builder::new().name(client.to_owned()).spawn(move || {
            // An error of a connection is ignored here: it ends this connection only, and there is nobody to tell.
            let _ = serving(stream);
            count.fetch_sub(1, Ordering::Relaxed);
        });
        if spawned.is_err() {
            connections.fetch_sub(1, Ordering::Relaxed);
        }
    }
}

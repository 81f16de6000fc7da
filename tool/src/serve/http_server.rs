//! The HTTP server of the tool: for the page of `serve web`, and for the metrics of any server. A thread accepts
//! connections, and each has a thread of its own, up to a limit. Beyond it the oldest connection that has sent no request
//! makes room for a new one, so that connections that say nothing keep nobody from an answer.

use std::collections::VecDeque;
use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use super::http::{self, Request};

/// The time before the next connection is accepted after an error, such as too many open files. \[OURS]
const AFTER_ERROR: Duration = Duration::from_millis(100);
/// How many times the limit of connections there may be while those that make room end. \[OURS]
const ENDING_MAX: usize = 4;

/// A running HTTP server.
pub struct HttpServer {
    address: SocketAddr,
    stop: Arc<AtomicBool>,
    thread: JoinHandle<()>,
}

impl HttpServer {
    /// Starts to accept connections. `serve` is called with the request of each in a thread of its own, for at most
    /// `connections_max` at a time. For a further one the oldest that has sent no request yet is closed; without such a
    /// one it is closed itself. `stop` is set by [`Self::stop`], for calls of `serve` that last.
    ///
    /// # Errors
    /// The system provides no thread, or the listener has no address.
    pub fn start(
        listener: TcpListener,
        name: &str,
        connections_max: usize,
        stop: Arc<AtomicBool>,
        serve: impl Fn(TcpStream, Request) -> io::Result<()> + Send + Sync + 'static,
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

/// The connections that have sent no request yet, with their numbers, oldest first.
#[derive(Default)]
struct Silent(Mutex<VecDeque<(u64, TcpStream)>>);

impl Silent {
    fn lock(&self) -> MutexGuard<'_, VecDeque<(u64, TcpStream)>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Closes the oldest of them; false: there is none.
    fn close_oldest(&self) -> bool {
        let Some((_, oldest)) = self.lock().pop_front() else { return false };
        // The thread of that connection sees its end. An error means that the client has gone already.
        let _ = oldest.shutdown(Shutdown::Both);
        true
    }

    fn remove(&self, number: u64) {
        self.lock().retain(|(of, _)| *of != number);
    }
}

fn accept<F>(listener: &TcpListener, client: &str, connections_max: usize, stop: &AtomicBool, serve: &Arc<F>)
where
    F: Fn(TcpStream, Request) -> io::Result<()> + Send + Sync + 'static,
{
    let (connections, silent) = (Arc::new(AtomicUsize::new(0)), Arc::new(Silent::default()));
    for (number, stream) in (0..).zip(listener.incoming()) {
        if stop.load(Ordering::Relaxed) {
            return;
        }
        let Ok((mut stream, copy)) = stream.and_then(|stream| Ok((stream.try_clone()?, stream))) else {
            thread::sleep(AFTER_ERROR);
            continue;
        };
        let before = connections.load(Ordering::Relaxed);
        if before >= connections_max && (before >= connections_max * ENDING_MAX || !silent.close_oldest()) {
            // A client that finds too many connections gets no thread and no answer, because sending an answer could block
            // this loop.
            continue;
        }
        connections.fetch_add(1, Ordering::Relaxed);
        silent.lock().push_back((number, copy));
        let (serving, count, unheard) = (Arc::clone(serve), Arc::clone(&connections), Arc::clone(&silent));
        let spawned = thread::Builder::new().name(client.to_owned()).spawn(move || {
            let request = http::read(&mut stream);
            unheard.remove(number);
            // An error of a connection is ignored here: it ends this connection only, and there is nobody to tell.
            let _ = request.and_then(|request| serving(stream, request));
            count.fetch_sub(1, Ordering::Relaxed);
        });
        if spawned.is_err() {
            silent.remove(number);
            connections.fetch_sub(1, Ordering::Relaxed);
        }
    }
}

//! All pending connections, and the choice of the one to close when there are too many.

use std::collections::VecDeque;
use std::net::IpAddr;
use std::time::{Duration, Instant};

use rustix::event::PollFd;

use super::ServeOptions;
use super::pending::{Look, PendingConnection};

/// The largest number of pending connections. Each needs a socket and some memory, but no thread. \[OURS]
const PENDING_MAX: usize = 256;
/// The largest number of pending connections from one address. Loopback addresses have no such limit, because all
/// clients on this machine share them. \[OURS]
const PENDING_PER_ADDRESS_MAX: usize = 32;
/// Each connection has at least this long for its Hello, however many others arrive after it: those wait in the
/// system's queue meanwhile. A client needs less than 1 ms, and over a slow network 200 ms. \[OURS]
const HELLO_TIME_MIN: Duration = Duration::from_millis(250);

/// Pending connections, oldest first.
#[derive(Default)]
pub(super) struct PendingPool {
    pending: VecDeque<Box<PendingConnection>>,
    /// For each pending connection, in the same order: whether its socket has an event to handle.
    ready: Vec<bool>,
}

impl PendingPool {
    /// Whether another connection can be added: fewer than [`PENDING_MAX`] are pending, or one of them may be closed
    /// for it (a refused one, or one that had [`HELLO_TIME_MIN`] for its Hello).
    pub(super) fn has_room(&self, now: Instant) -> bool {
        self.pending.len() < PENDING_MAX || self.oldest_evictable(now).is_some()
    }

    /// Adds a connection; returns the one that was removed to make room. `None`: none was removed, or a refused one,
    /// whose end needs no log line.
    pub(super) fn add(&mut self, pending: Box<PendingConnection>, now: Instant) -> Option<Box<PendingConnection>> {
        let address = pending.from.ip();
        let evicted = match self.oldest_of_full_address(address) {
            Some(oldest) => Some(oldest),
            None if self.pending.len() >= PENDING_MAX => self.oldest_evictable(now),
            None => None,
        };
        let evicted = evicted.and_then(|index| self.pending.remove(index));
        self.pending.push_back(pending);
        // The end of a refused connection was logged with its refusal, so the caller must not log it again.
        evicted.filter(|evicted| !evicted.is_refused())
    }

    /// Adds a connection again that [`look`](Self::look) has removed and that was then refused: it waits until the
    /// reason is received.
    pub(super) fn put_back(&mut self, pending: Box<PendingConnection>) {
        let place = self.pending.partition_point(|other| other.came <= pending.came);
        self.pending.insert(place, pending);
    }

    /// Closes the oldest pending connection, to free its file descriptor.
    pub(super) fn drop_oldest(&mut self) {
        self.pending.pop_front();
    }

    /// The connection to close to make room: the oldest refused one, or else the oldest that has sent nothing, or else
    /// the oldest one. Only refused connections may be closed before [`HELLO_TIME_MIN`] has passed. `None`: no
    /// connection may be closed at present.
    fn oldest_evictable(&self, now: Instant) -> Option<usize> {
        let oldest =
            |is_one: &dyn Fn(&PendingConnection) -> bool| self.pending.iter().position(|pending| is_one(pending));
        let had_hello_time =
            |pending: &PendingConnection| now.saturating_duration_since(pending.came) >= HELLO_TIME_MIN;
        oldest(&PendingConnection::is_refused)
            .or_else(|| oldest(&|pending| had_hello_time(pending) && !pending.has_sent))
            .or_else(|| oldest(&had_hello_time))
    }

    /// The oldest connection from `address`, if this address has as many connections as allowed. `None`: it has fewer.
    fn oldest_of_full_address(&self, address: IpAddr) -> Option<usize> {
        let its = |pending: &PendingConnection| pending.from.ip() == address;
        if address.is_loopback() || self.pending.iter().filter(|pending| its(pending)).count() < PENDING_PER_ADDRESS_MAX
        {
            return None;
        }
        let silent = self.pending.iter().position(|pending| its(pending) && !pending.has_sent);
        silent.or_else(|| self.pending.iter().position(|pending| its(pending)))
    }

    /// The events to poll for, one for each pending connection in their order.
    pub(super) fn waits_for(&self) -> impl Iterator<Item = PollFd<'_>> {
        self.pending.iter().map(|pending| pending.waits_for())
    }

    /// Stores which connections have an event to handle, in their order.
    pub(super) fn note_ready(&mut self, ready: &[bool]) {
        self.ready.clear();
        self.ready.extend_from_slice(ready);
    }

    /// The next time at which a deadline passes or a connection can be closed to make room. `None`: no
    /// connection is pending.
    pub(super) fn next_time(&self, now: Instant, options: &ServeOptions) -> Option<Instant> {
        let deadline = self.pending.iter().map(|pending| pending.deadline(options)).min();
        let room =
            if self.has_room(now) { None } else { self.pending.front().map(|first| first.came + HELLO_TIME_MIN) };
        deadline.into_iter().chain(room).min()
    }

    /// Handles the connections with events and those whose deadline has passed. Returns those that are no longer
    /// waiting for their Hello.
    pub(super) fn look(&mut self, now: Instant, options: &ServeOptions) -> Vec<(Box<PendingConnection>, Look)> {
        let mut done = Vec::new();
        let mut ready = std::mem::take(&mut self.ready).into_iter();
        for mut pending in std::mem::take(&mut self.pending) {
            let is_ready = ready.next().unwrap_or(false);
            if !is_ready && now < pending.deadline(options) {
                self.pending.push_back(pending);
                continue;
            }
            pending.has_sent |= is_ready;
            match pending.look(now, options) {
                Look::Waits => self.pending.push_back(pending),
                look => done.push((pending, look)),
            }
        }
        done
    }
}

#[cfg(test)]
mod tests {
    use std::net::{SocketAddr, TcpListener, TcpStream};

    use super::*;

    /// A pending connection that seems to come from `from`, and its other end, which must be kept open.
    fn connection_from(listener: &TcpListener, from: SocketAddr, came: Instant) -> (Box<PendingConnection>, TcpStream) {
        let other = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let (socket, _) = listener.accept().unwrap();
        (PendingConnection::greet(socket, from, came, None).unwrap(), other)
    }

    /// TCP-13 When one address makes too many connections, its oldest one that has sent nothing is closed, at once and
    /// even with free places. Other addresses are not affected, and loopback addresses have no limit.
    #[test]
    fn a_crowd_makes_room_for_itself() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let now = Instant::now();
        let (mut pool, mut others) = (PendingPool::default(), Vec::new());
        let mut add = |pool: &mut PendingPool, from: &str, has_sent: bool| {
            let (mut pending, other) = connection_from(&listener, from.parse().unwrap(), now);
            pending.has_sent = has_sent;
            others.push(other);
            pool.add(pending, now).map(|evicted| evicted.from.to_string())
        };
        assert_eq!(add(&mut pool, "192.0.2.2:1", false), None);
        assert_eq!(add(&mut pool, "192.0.2.1:1", true), None);
        for port in 2..=PENDING_PER_ADDRESS_MAX {
            assert_eq!(add(&mut pool, &format!("192.0.2.1:{port}"), false), None);
        }
        for port in 2..=PENDING_PER_ADDRESS_MAX {
            let evicted = add(&mut pool, &format!("192.0.2.1:{}", 1000 + port), true);
            assert_eq!(evicted, Some(format!("192.0.2.1:{port}")), "one that has spoken stays");
        }
        assert_eq!(
            add(&mut pool, "192.0.2.1:5000", true).as_deref(),
            Some("192.0.2.1:1"),
            "all have spoken: the oldest"
        );
        for port in 1..=2 * PENDING_PER_ADDRESS_MAX {
            assert_eq!(add(&mut pool, &format!("127.0.0.1:{port}"), false), None);
        }
        assert_eq!(pool.pending.front().map(|first| first.from.to_string()).as_deref(), Some("192.0.2.2:1"));
    }
}

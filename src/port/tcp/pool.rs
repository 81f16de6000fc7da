//! Connections that have not said what they want, all of them: who makes room when there are too many.

use std::collections::VecDeque;
use std::net::IpAddr;
use std::time::{Duration, Instant};

use rustix::event::PollFd;

use super::ServeOptions;
use super::stranger::{Look, Stranger};

/// Connections that have not said what they want, at the same time. Each is a socket and some memory, no thread. \[OURS]
const STRANGERS_MAX: usize = 256;
/// Of these, from one address; addresses of this machine itself count as one by one, since every client on it has the same.
/// \[OURS]
const PER_ADDRESS_MAX: usize = 32;
/// What each gets to say what it wants, however many come after it: those wait in the system's queue meanwhile. A client says it
/// in less than a millisecond, over a slow network in 200. \[OURS]
const GRACE: Duration = Duration::from_millis(250);

/// The strangers, oldest first.
#[derive(Default)]
pub(super) struct Pool {
    strangers: VecDeque<Box<Stranger>>,
    /// Whether the system has something of each, by their order.
    ready: Vec<bool>,
}

impl Pool {
    /// Whether another one can be taken: there is a place, or somebody there has to make room.
    pub(super) fn has_room(&self, now: Instant) -> bool {
        self.strangers.len() < STRANGERS_MAX || self.evictable(now).is_some()
    }

    /// Takes one in; gives the one that made room for it.
    pub(super) fn add(&mut self, stranger: Box<Stranger>, now: Instant) -> Option<Box<Stranger>> {
        let address = stranger.from.ip();
        let evicted = match self.oldest_of_crowd(address) {
            Some(oldest) => Some(oldest),
            None if self.strangers.len() >= STRANGERS_MAX => self.evictable(now),
            None => None,
        };
        let evicted = evicted.and_then(|index| self.strangers.remove(index));
        self.strangers.push_back(stranger);
        // One that was told why it ends has had its word.
        evicted.filter(|evicted| !evicted.is_leaving())
    }

    /// Puts one back that was looked at.
    pub(super) fn put_back(&mut self, stranger: Box<Stranger>) {
        let place = self.strangers.partition_point(|other| other.came <= stranger.came);
        self.strangers.insert(place, stranger);
    }

    /// Ends the oldest one.
    pub(super) fn drop_oldest(&mut self) {
        self.strangers.pop_front();
    }

    /// Who makes room: of those that were told why they end the oldest; then of those that have said nothing, then of the others
    /// the oldest, but nobody who has not had its time.
    fn evictable(&self, now: Instant) -> Option<usize> {
        let oldest = |is_one: &dyn Fn(&Stranger) -> bool| self.strangers.iter().position(|stranger| is_one(stranger));
        let had_its_time = |stranger: &Stranger| now.saturating_duration_since(stranger.came) >= GRACE;
        oldest(&Stranger::is_leaving)
            .or_else(|| oldest(&|stranger| had_its_time(stranger) && !stranger.has_spoken))
            .or_else(|| oldest(&had_its_time))
    }

    /// The oldest one of an address that has as many as it may have.
    fn oldest_of_crowd(&self, address: IpAddr) -> Option<usize> {
        let its = |stranger: &Stranger| stranger.from.ip() == address;
        if address.is_loopback() || self.strangers.iter().filter(|stranger| its(stranger)).count() < PER_ADDRESS_MAX {
            return None;
        }
        let silent = self.strangers.iter().position(|stranger| its(stranger) && !stranger.has_spoken);
        silent.or_else(|| self.strangers.iter().position(|stranger| its(stranger)))
    }

    /// What is to be waited for, by their order.
    pub(super) fn waits_for(&self) -> impl Iterator<Item = PollFd<'_>> {
        self.strangers.iter().map(|stranger| stranger.waits_for())
    }

    /// Of which the system has something.
    pub(super) fn note_ready(&mut self, ready: &[bool]) {
        self.ready.clear();
        self.ready.extend_from_slice(ready);
    }

    /// When one of them has to be looked at although it says nothing, or may make room.
    pub(super) fn next_time(&self, now: Instant, options: &ServeOptions) -> Option<Instant> {
        let deadline = self.strangers.iter().map(|stranger| stranger.deadline(options)).min();
        let room = if self.has_room(now) { None } else { self.strangers.front().map(|first| first.came + GRACE) };
        deadline.into_iter().chain(room).min()
    }

    /// Looks at those that have something or whose time is over. Those that wait on stay; the others are given away.
    pub(super) fn look(&mut self, now: Instant, options: &ServeOptions) -> Vec<(Box<Stranger>, Look)> {
        let mut done = Vec::new();
        let mut ready = std::mem::take(&mut self.ready).into_iter();
        for mut stranger in std::mem::take(&mut self.strangers) {
            let is_ready = ready.next().unwrap_or(false);
            if !is_ready && now < stranger.deadline(options) {
                self.strangers.push_back(stranger);
                continue;
            }
            stranger.has_spoken |= is_ready;
            match stranger.look(now, options) {
                Look::Waits => self.strangers.push_back(stranger),
                look => done.push((stranger, look)),
            }
        }
        done
    }
}

#[cfg(test)]
mod tests {
    use std::net::{SocketAddr, TcpListener, TcpStream};

    use super::*;

    /// A connection that says it is from there. The other end is kept, else it would have ended.
    fn stranger(listener: &TcpListener, from: SocketAddr, came: Instant) -> (Box<Stranger>, TcpStream) {
        let other = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let (socket, _) = listener.accept().unwrap();
        (Stranger::greet(socket, from, came, None).unwrap(), other)
    }

    /// TCP-13 Of one address that crowds in the oldest that has said nothing makes room, at once and with places left; others are
    /// not touched, and of this machine itself there is no crowd.
    #[test]
    fn a_crowd_makes_room_for_itself() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let now = Instant::now();
        let (mut pool, mut others) = (Pool::default(), Vec::new());
        let mut add = |pool: &mut Pool, from: &str, has_spoken: bool| {
            let (mut stranger, other) = stranger(&listener, from.parse().unwrap(), now);
            stranger.has_spoken = has_spoken;
            others.push(other);
            pool.add(stranger, now).map(|evicted| evicted.from.to_string())
        };
        assert_eq!(add(&mut pool, "192.0.2.2:1", false), None);
        assert_eq!(add(&mut pool, "192.0.2.1:1", true), None);
        for port in 2..=PER_ADDRESS_MAX {
            assert_eq!(add(&mut pool, &format!("192.0.2.1:{port}"), false), None);
        }
        for port in 2..=PER_ADDRESS_MAX {
            let evicted = add(&mut pool, &format!("192.0.2.1:{}", 1000 + port), true);
            assert_eq!(evicted, Some(format!("192.0.2.1:{port}")), "one that has spoken stays");
        }
        assert_eq!(
            add(&mut pool, "192.0.2.1:5000", true).as_deref(),
            Some("192.0.2.1:1"),
            "all have spoken: the oldest"
        );
        for port in 1..=2 * PER_ADDRESS_MAX {
            assert_eq!(add(&mut pool, &format!("127.0.0.1:{port}"), false), None);
        }
        assert_eq!(pool.strangers.front().map(|first| first.from.to_string()).as_deref(), Some("192.0.2.2:1"));
    }
}

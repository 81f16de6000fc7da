//! A bounded queue from the threads of a program to one thread of this crate. No thread waits for another one in it. If
//! a thread is ended by force at any instruction, the others go on: only its own entry is lost, and at most its place
//! in the ring becomes unusable.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use parking_lot::Mutex;

/// The ring buffer. Entries are numbered; the number modulo the length of the ring is the index of the entry's place.
pub(super) struct Ring<E> {
    places: Box<[Place<E>]>,
    /// The number of the next entry.
    next: AtomicU64,
    /// The number of the oldest entry that is still in the queue.
    oldest: AtomicU64,
}

struct Place<E> {
    /// The entry. Its lock is only ever tried, so that no thread waits for it.
    entry: Mutex<Option<E>>,
    /// The number of the newest entry that was stored in this place, plus 1; 0 if none was.
    ready: AtomicU64,
    /// Whether a thread that was ended, or is very late, holds the lock. Entries that would come to this place are then
    /// skipped.
    is_broken: AtomicBool,
}

/// The result of [`Ring::take`].
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Taken<E> {
    Entry(E),
    Nothing,
    /// A thread is still storing the oldest entry.
    Unfinished,
}

impl<E> Ring<E> {
    /// Allocates a queue for `len` entries.
    pub fn new(len: usize) -> Self {
        let place = || Place { entry: Mutex::new(None), ready: AtomicU64::new(0), is_broken: AtomicBool::new(false) };
        let places = std::iter::repeat_with(place).take(len.max(1)).collect();
        Self { places, next: AtomicU64::new(0), oldest: AtomicU64::new(0) }
    }

    fn place(&self, number: u64) -> &Place<E> {
        &self.places[(number % self.places.len() as u64) as usize]
    }

    /// Whether all places of the queue are in use.
    pub fn is_full(&self) -> bool {
        let next = self.next.load(Ordering::SeqCst);
        next.saturating_sub(self.oldest.load(Ordering::SeqCst)) >= self.places.len() as u64
    }

    /// Adds an entry.
    ///
    /// # Errors
    /// Returns the entry if the queue is full.
    pub fn add(&self, mut entry: E) -> Result<(), E> {
        loop {
            let Some(number) = self.begin() else { return Err(entry) };
            match self.store(number, entry) {
                Ok(()) => return Ok(()),
                Err(back) => entry = back,
            }
        }
    }

    /// Stores the entry of the claimed number `number`.
    ///
    /// # Errors
    /// Returns the entry if another thread holds the place, which counts as unusable from now on.
    pub(super) fn store(&self, number: u64, entry: E) -> Result<(), E> {
        let place = self.place(number);
        let Some(mut free) = place.entry.try_lock() else {
            place.is_broken.store(true, Ordering::SeqCst);
            return Err(entry);
        };
        // This thread may have stalled for long. If the place has a newer entry by now, this entry was skipped, and is
        // dropped.
        if place.ready.load(Ordering::SeqCst) <= number {
            *free = Some(entry);
            place.ready.store(number + 1, Ordering::SeqCst);
        }
        Ok(())
    }

    /// Claims the number for a new entry; `None`: the queue is full.
    pub(super) fn begin(&self) -> Option<u64> {
        loop {
            let number = self.next.load(Ordering::SeqCst);
            if number.saturating_sub(self.oldest.load(Ordering::SeqCst)) >= self.places.len() as u64 {
                return None;
            }
            let taken = self.next.compare_exchange(number, number + 1, Ordering::SeqCst, Ordering::Relaxed);
            if taken.is_ok() && !self.place(number).is_broken.load(Ordering::SeqCst) {
                return Some(number);
            }
        }
    }

    /// Takes the oldest entry. Only one thread may call this.
    pub fn take(&self) -> Taken<E> {
        loop {
            let number = self.oldest.load(Ordering::SeqCst);
            if number == self.next.load(Ordering::SeqCst) {
                return Taken::Nothing;
            }
            let place = self.place(number);
            if place.ready.load(Ordering::SeqCst) == number + 1 {
                let Some(mut locked) = place.entry.try_lock() else { return Taken::Unfinished };
                let entry = locked.take();
                // The lock is released before the place is free for a new entry.
                drop(locked);
                self.leave_out();
                if let Some(entry) = entry {
                    return Taken::Entry(entry);
                }
            } else if place.is_broken.load(Ordering::SeqCst) {
                self.leave_out();
            } else {
                return Taken::Unfinished;
            }
        }
    }

    /// Skips the oldest entry, because its thread will not complete it. Only the taking thread may call this.
    pub fn leave_out(&self) {
        self.oldest.fetch_add(1, Ordering::SeqCst);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    /// Entries are taken in the order in which they were added, and a full queue refuses entries.
    #[test]
    fn entries_come_in_their_order() {
        let ring = Ring::new(3);
        for lap in 0..10 {
            for number in 0..3 {
                assert_eq!(ring.add(lap * 3 + number), Ok(()));
            }
            assert!(ring.is_full());
            assert_eq!(ring.add(-1), Err(-1));
            for number in 0..3 {
                assert_eq!(ring.take(), Taken::Entry(lap * 3 + number));
            }
            assert_eq!(ring.take(), Taken::Nothing);
        }
    }

    /// LIB-70 A thread is ended by force while it adds an entry. That entry is skipped, and all others are taken,
    /// although the place of the entry stays locked.
    #[test]
    fn a_thread_that_is_ended_loses_its_own_entry() {
        for keeps_the_place in [false, true] {
            let ring = Ring::new(4);
            assert_eq!(ring.add(0), Ok(()));
            let ended = ring.begin().expect("there is room");
            if keeps_the_place {
                std::mem::forget(ring.place(ended).entry.try_lock().expect("it is free"));
            }
            assert_eq!((ring.add(2), ring.take()), (Ok(()), Taken::Entry(0)));
            assert_eq!((ring.take(), ring.take()), (Taken::Unfinished, Taken::Unfinished));
            ring.leave_out();
            assert_eq!(ring.take(), Taken::Entry(2));
            for number in 3..40 {
                assert_eq!((ring.add(number), ring.add(-number)), (Ok(()), Ok(())));
                assert_eq!((ring.take(), ring.take()), (Taken::Entry(number), Taken::Entry(-number)));
                assert_eq!(ring.take(), Taken::Nothing);
            }
        }
    }

    /// A thread that was late counts as ended, and then goes on: no entry is taken twice, and no newer entry is lost.
    #[test]
    fn a_thread_that_was_left_out_may_go_on() {
        let ring = Ring::new(2);
        let late = ring.begin().expect("there is room");
        ring.leave_out();
        assert_eq!((ring.add(1), ring.add(2)), (Ok(()), Ok(())));
        let place = ring.place(late);
        assert!(place.ready.load(Ordering::SeqCst) > late, "a newer one is there");
        assert_eq!((ring.take(), ring.take()), (Taken::Entry(1), Taken::Entry(2)));
        // The late thread stores its entry in its place, which is empty, since the newer entry was taken from it.
        *place.entry.lock() = Some(-1);
        assert_eq!(ring.take(), Taken::Nothing);
        assert_eq!((ring.add(3), ring.add(4)), (Ok(()), Ok(())));
        assert_eq!((ring.take(), ring.take()), (Taken::Entry(3), Taken::Entry(4)));
    }

    /// Several threads add entries at once: each entry is taken once, and the entries of each thread in order.
    #[test]
    fn every_entry_of_every_thread_comes_once() {
        const THREADS: usize = 4;
        const EACH: u64 = 5000;
        let ring = Arc::new(Ring::new(16));
        let adding: Vec<_> = (0..THREADS)
            .map(|thread| {
                let ring = Arc::clone(&ring);
                std::thread::spawn(move || {
                    for number in 0..EACH {
                        while ring.add((thread, number)).is_err() {
                            std::thread::yield_now();
                        }
                    }
                })
            })
            .collect();
        let mut next = [0; THREADS];
        while next != [EACH; THREADS] {
            match ring.take() {
                Taken::Entry((thread, number)) => {
                    assert_eq!(number, next[thread]);
                    next[thread] += 1;
                }
                Taken::Nothing | Taken::Unfinished => std::thread::yield_now(),
            }
        }
        adding.into_iter().for_each(|thread| thread.join().expect("no panic"));
        assert_eq!(ring.take(), Taken::Nothing);
    }
}

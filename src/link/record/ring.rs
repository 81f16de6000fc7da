//! A bounded queue from the threads of a program to one of this crate. No thread waits for another one in it, and one that is ended by
//! force in any instruction hinders no other: it loses its own entry, and at most the place of that entry.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use parking_lot::Mutex;

/// The queue. What is added gets a number; its place is the remainder.
pub(super) struct Ring<E> {
    places: Box<[Place<E>]>,
    /// The number of the next entry.
    next: AtomicU64,
    /// The number of the oldest entry that was not taken.
    oldest: AtomicU64,
}

struct Place<E> {
    /// Locked by `try_lock` alone.
    entry: Mutex<Option<E>>,
    /// The number of the newest entry that was put here, and 1.
    ready: AtomicU64,
    /// A thread that was ended, or that is very late, has the lock: numbers of this place are left out.
    is_broken: AtomicBool,
}

/// What [`Ring::take`] finds.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Taken<E> {
    Entry(E),
    Nothing,
    /// A thread has begun to add the oldest entry.
    Unfinished,
}

impl<E> Ring<E> {
    /// A queue for that many entries, whose memory is allocated now.
    pub fn new(len: usize) -> Self {
        let place = || Place { entry: Mutex::new(None), ready: AtomicU64::new(0), is_broken: AtomicBool::new(false) };
        let places = std::iter::repeat_with(place).take(len.max(1)).collect();
        Self { places, next: AtomicU64::new(0), oldest: AtomicU64::new(0) }
    }

    fn place(&self, number: u64) -> &Place<E> {
        &self.places[(number % self.places.len() as u64) as usize]
    }

    /// Whether an entry would find no room.
    pub fn is_full(&self) -> bool {
        let next = self.next.load(Ordering::SeqCst);
        next.saturating_sub(self.oldest.load(Ordering::SeqCst)) >= self.places.len() as u64
    }

    /// Adds an entry.
    ///
    /// # Errors
    /// The entry, if the queue is full.
    pub fn add(&self, entry: E) -> Result<(), E> {
        loop {
            let Some(number) = self.begin() else { return Err(entry) };
            let place = self.place(number);
            if let Some(mut free) = place.entry.try_lock() {
                // A thread that stood still for long may find a newer one, and its own was left out.
                if place.ready.load(Ordering::SeqCst) <= number {
                    *free = Some(entry);
                    place.ready.store(number + 1, Ordering::SeqCst);
                }
                return Ok(());
            }
            place.is_broken.store(true, Ordering::SeqCst);
        }
    }

    /// The number of an entry that is begun, unless the queue is full.
    fn begin(&self) -> Option<u64> {
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

    /// Takes the oldest entry; for one thread alone.
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
                // Before the place may be used again.
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

    /// Goes on behind the oldest entry, whose thread will not add it; for the thread that takes.
    pub fn leave_out(&self) {
        self.oldest.fetch_add(1, Ordering::SeqCst);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    /// Entries come in their order; a full queue takes none.
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

    /// LIB-70 A thread that is ended while it adds an entry: that entry is left out, and all others come, also on the place that
    /// it keeps locked.
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

    /// A thread that was taken for ended, and goes on: nothing comes twice, and nothing newer is lost.
    #[test]
    fn a_thread_that_was_left_out_may_go_on() {
        let ring = Ring::new(2);
        let late = ring.begin().expect("there is room");
        ring.leave_out();
        assert_eq!((ring.add(1), ring.add(2)), (Ok(()), Ok(())));
        let place = ring.place(late);
        assert!(place.ready.load(Ordering::SeqCst) > late, "a newer one is there");
        assert_eq!((ring.take(), ring.take()), (Taken::Entry(1), Taken::Entry(2)));
        // It puts its entry where nothing is by now.
        *place.entry.lock() = Some(-1);
        assert_eq!(ring.take(), Taken::Nothing);
        assert_eq!((ring.add(3), ring.add(4)), (Ok(()), Ok(())));
        assert_eq!((ring.take(), ring.take()), (Taken::Entry(3), Taken::Entry(4)));
    }

    /// Threads that add at once: each entry comes once, those of a thread in their order.
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

//! Decides when virtual time advances, and advances it.

use std::sync::atomic::Ordering;

use crate::clock::{self, NEVER};
use crate::task::{self, Task};
use crate::threads::{Entry, Outcome, State, Threads, What};
use crate::{boards, system};

/// How long a thread has to be blocked in the kernel until it counts as waiting \[OURS], in nanoseconds of the real
/// clock: threads block for a moment whenever they use a file. From then on it counts as waiting in each check, until
/// it runs again.
const BLOCKED_NS: u64 = 2_000_000;

/// How long a thread may run while virtual time stands still \[OURS], in nanoseconds of processor time. From then on
/// virtual time advances with the processor time of that thread, so that a thread that waits in a busy loop, without a
/// call, does not hold up the others for ever. A thread that gets no processor on a busy machine does not advance time.
const HELD_UP_MAX_NS: u64 = 50_000_000;

/// How long virtual time stands still at most \[OURS], in nanoseconds of the real clock. From then on it advances with
/// the real clock. This is for threads that only real time wakes every few milliseconds, as timers that send signals
/// do.
const STANDSTILL_MAX_NS: u64 = 5_000_000_000;

/// How far the first step of the boards advances virtual time, in nanoseconds \[OURS]; each further step is twice as
/// long as the one before.
const STEP_NS: u64 = 100_000_000;

/// After this much real time no further step begins, in nanoseconds \[OURS]. The thread then releases the lock of the
/// table, so that a thread that returns from a call outside can continue, however far the boards still have to advance.
const STEPS_REAL_NS: u64 = 1_000_000;

/// Whether all threads wait, so that virtual time may advance.
enum Standstill {
    /// All threads wait.
    Whole,
    /// Some threads run. `for_ns` is the least processor time that one of them has used since virtual time stopped, in
    /// nanoseconds.
    HeldUp { for_ns: u64 },
}

impl Threads {
    /// Advances virtual time towards the earliest deadline, if all threads wait or the running ones have held time up
    /// for too long. Ends the waits whose deadline it reaches. Returns whether any wait has ended.
    pub fn advance(&mut self) -> bool {
        let earliest = self.earliest();
        if earliest == NEVER {
            return false;
        }
        match self.standstill() {
            Standstill::Whole => {
                if self.end_ready() || self.retry_locks() {
                    return true;
                }
                self.end_standstill();
            }
            Standstill::HeldUp { for_ns } => {
                let real = system::real_ns(libc::CLOCK_MONOTONIC);
                let (from, since) = *self.stands_still_from.get_or_insert((clock::now(), real));
                let real = real.saturating_sub(since);
                let passed = if real < STANDSTILL_MAX_NS { for_ns } else { real.max(for_ns) };
                if passed < HELD_UP_MAX_NS || earliest > from.saturating_add(passed) {
                    return false;
                }
            }
        }
        self.entries.iter_mut().for_each(|entry| entry.is_retried = false);
        go_on(earliest);
        let now = clock::now();
        self.end_waits(Outcome::Reached, |deadline, _| deadline <= now) > 0
    }

    fn standstill(&mut self) -> Standstill {
        let mut buffer = std::mem::take(&mut self.buffer);
        let (mut is_gone, mut held_up) = (false, None::<u64>);
        let real = || system::real_ns(libc::CLOCK_MONOTONIC);
        let is_short = self.stands_still_from.is_none_or(|(_, since)| real().saturating_sub(since) < BLOCKED_NS);
        for entry in &mut self.entries {
            let number = entry.thread.number.load(Ordering::Relaxed);
            let task = match entry.state {
                State::Waiting { .. } => continue,
                // The thread continues as soon as it gets the processor, so it counts as running. If it does not
                // continue for a while, its state is read from `/proc`: a signal handler within its wait may be
                // blocked.
                State::Ended(_) if is_short && entry.blocked.is_none() => Task::Runs,
                _ if number == 0 || entry.thread.inside.load(Ordering::Relaxed) > 0 => Task::Runs,
                State::Ending => match task::look(number, &mut buffer) {
                    Task::Gone => Task::Gone,
                    _ => Task::Runs,
                },
                _ => task::look(number, &mut buffer),
            };
            // Checked after the look at `/proc`: a thread that was blocked there and is not back yet is still blocked
            // in its call.
            let task = match task {
                Task::Blocked { .. } if entry.thread.is_back.load(Ordering::Acquire) => Task::Runs,
                task => task,
            };
            let for_ns = match task {
                // Another thread, which was checked before, may have waited for the end of this one and continue now.
                // So time does not advance in this pass.
                Task::Gone => {
                    is_gone = true;
                    0
                }
                Task::Blocked { .. } if matches!(entry.state, State::Outside) => continue,
                Task::Blocked { switches } => {
                    let real = real();
                    let since = entry.blocked.filter(|(known, _)| *known == switches).map_or(real, |(_, since)| since);
                    entry.blocked = Some((switches, since));
                    if real.saturating_sub(since) >= BLOCKED_NS {
                        continue;
                    }
                    0
                }
                Task::Runs => {
                    entry.blocked = None;
                    let used = task::processor_ns(number);
                    used.saturating_sub(*entry.used_ns.get_or_insert(used))
                }
            };
            held_up = Some(held_up.map_or(for_ns, |least| least.min(for_ns)));
        }
        self.buffer = buffer;
        if is_gone {
            self.remove_gone(|_| true);
        }
        held_up.map_or(Standstill::Whole, |for_ns| Standstill::HeldUp { for_ns })
    }

    /// Removes those of the threads selected by `which` that the system has ended.
    pub fn remove_gone(&mut self, which: impl Fn(&Entry) -> bool) {
        let mut buffer = std::mem::take(&mut self.buffer);
        let mut is_there = |number: i32| number == 0 || task::look(number, &mut buffer) != Task::Gone;
        self.entries.retain(|entry| !which(entry) || is_there(entry.thread.number.load(Ordering::Relaxed)));
        self.buffer = buffer;
    }

    /// Called when virtual time advances: forgets since when it stood still.
    fn end_standstill(&mut self) {
        self.stands_still_from = None;
        self.entries.iter_mut().for_each(|entry| entry.used_ns = None);
    }

    /// Ends the waits for locks so that the threads try again, once before time advances: another thread of the program
    /// may have released the locks.
    fn retry_locks(&mut self) -> bool {
        let mut is_any = false;
        for entry in &mut self.entries {
            if matches!(entry.state, State::Waiting { what: What::Lock, .. }) && !entry.is_retried {
                entry.is_retried = true;
                entry.end_wait(Outcome::Woken);
                is_any = true;
            }
        }
        is_any
    }

    /// Ends the waits for words that have changed, and the waits for descriptors that are ready: another thread of the
    /// program may have written to them. Before each advance of time, a wait for descriptors is ended only once. A
    /// descriptor that is ready for poll may not be ready for the call: one that has hung up is no exception for
    /// select.
    fn end_ready(&mut self) -> bool {
        let mut is_any = false;
        for entry in &mut self.entries {
            let State::Waiting { what, .. } = &entry.state else { continue };
            let is_ready = match what {
                What::Descriptors(descriptors) => !entry.is_retried && is_any_ready(descriptors),
                What::Word { address, seen } => system::word_at(*address) != *seen,
                _ => false,
            };
            if is_ready {
                entry.is_retried = true;
                entry.end_wait(Outcome::Woken);
                is_any = true;
            }
        }
        is_any
    }
}

/// Advances virtual time to `time`, or only a part of the way if that takes longer than [`STEPS_REAL_NS`].
fn go_on(time: u64) {
    let began = system::real_ns(libc::CLOCK_MONOTONIC);
    let mut step = STEP_NS;
    while clock::now() < time {
        let next = clock::now().saturating_add(step).min(time);
        boards::pass_to(next);
        clock::set_on(next);
        if system::real_ns(libc::CLOCK_MONOTONIC).saturating_sub(began) >= STEPS_REAL_NS {
            return;
        }
        step = step.saturating_mul(2);
    }
}

/// Whether poll(2) reports a descriptor as ready, hung up or broken.
fn is_any_ready(descriptors: &[libc::pollfd]) -> bool {
    let mut copy = descriptors.to_vec();
    let (to, count, timeout) = (copy.as_mut_ptr(), copy.len() as libc::nfds_t, 0);
    system::real!(poll(to: *mut libc::pollfd, count: libc::nfds_t, timeout: std::ffi::c_int) -> std::ffi::c_int) != 0
}

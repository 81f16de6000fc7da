//! Waits for descriptors, with a time limit. Input from outside the program arrives in real time, so a limit on the
//! virtual clock may expire before it.

use std::ffi::{c_int, c_short};
use std::sync::Arc;

use libc::{epoll_event, fd_set, nfds_t, pollfd, sigset_t, timespec, timeval};

use super::{fail, is_passed_on, test_cancel};
use crate::clock;
use crate::mode::{self, Own};
use crate::signals;
use crate::system::{self, nanoseconds, real};
use crate::threads::{Outcome, What, begin_call, outside, wait};

/// Waits for descriptors. `limit` is in nanoseconds: `None` if there is none, `Some(None)` if it is invalid. `mask` are
/// the signals that are blocked during the wait; NULL: those of the thread. `forever` calls the C library's function
/// with the arguments of the program. `attempt` calls it without a wait, with a mask or NULL.
///
/// Only for calls of the program, whose thread may be cancelled here.
fn limited(
    limit: Option<Option<u64>>,
    mask: *const sigset_t,
    forever: impl FnOnce() -> c_int,
    descriptors: impl FnOnce() -> Arc<[pollfd]>,
    attempt: impl FnMut(*const sigset_t) -> c_int,
) -> c_int {
    test_cancel();
    let Some(limit) = limit else { return outside(forever) };
    let Some(limit_ns) = limit else { return fail(libc::EINVAL) };
    let (result, errno) = {
        let _own = Own::begin();
        attempts(descriptors(), limit_ns, mask, attempt)
    };
    mode::set_errno(errno);
    test_cancel();
    result
}

/// The part of [`limited`] that runs in [`Own`]. Returns the result and errno.
fn attempts(
    descriptors: Arc<[pollfd]>,
    limit_ns: u64,
    mask: *const sigset_t,
    mut attempt: impl FnMut(*const sigset_t) -> c_int,
) -> (c_int, c_int) {
    let (mut result, mut errno) = (attempt(mask), mode::errno());
    if result != 0 || limit_ns == 0 {
        return (result, errno);
    }
    let deadline = clock::in_ns(limit_ns);
    let what = if descriptors.is_empty() { What::Time } else { What::Descriptors(descriptors) };
    begin_call();
    loop {
        let outcome = wait(what.clone(), deadline, || {
            // Not with the mask, which may unblock signals: no handler may run here, where the table is locked.
            (result, errno) = (attempt(std::ptr::null()), mode::errno());
            result != 0 || signals::is_handler_due(mask)
        });
        if result == 0 && outcome == Outcome::Interrupted {
            return (-1, libc::EINTR);
        }
        if result == 0 {
            (result, errno) = (attempt(mask), mode::errno());
        }
        if result != 0 || outcome == Outcome::Reached {
            return (result, errno);
        }
    }
}

/// Converts a limit in milliseconds for [`limited`]; a negative limit is none.
fn milliseconds(limit: c_int) -> Option<Option<u64>> {
    Some(Some(u64::try_from(limit).ok()? * 1_000_000))
}

/// Copies the caller's descriptors.
///
/// # Safety
/// `descriptors` points to `count` descriptors, or is NULL, or `count` is 0.
unsafe fn listed(descriptors: *const pollfd, count: nfds_t) -> Arc<[pollfd]> {
    if descriptors.is_null() || count == 0 {
        return Arc::new([]);
    }
    // SAFETY: the caller guarantees what the section Safety above requires.
    unsafe { std::slice::from_raw_parts(descriptors, count as usize) }.into()
}

/// Replaces poll(2).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn poll(descriptors: *mut pollfd, count: nfds_t, limit_ms: c_int) -> c_int {
    let call = |limit_ms: c_int| real!(poll(descriptors: *mut pollfd, count: nfds_t, limit_ms: c_int) -> c_int);
    if is_passed_on() || limit_ms == 0 {
        return call(limit_ms);
    }
    // SAFETY: the caller gives `count` descriptors.
    let listed = || unsafe { listed(descriptors, count) };
    limited(milliseconds(limit_ms), std::ptr::null(), || call(limit_ms), listed, |_| call(0))
}

/// Replaces __poll_chk, which programs that are compiled with checks (_FORTIFY_SOURCE) call in place of poll(2).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn __poll_chk(descriptors: *mut pollfd, count: nfds_t, limit_ms: c_int, room: usize) -> c_int {
    if room / size_of::<pollfd>() < count as usize {
        return real!(__poll_chk(descriptors: *mut pollfd, count: nfds_t, limit_ms: c_int, room: usize) -> c_int);
    }
    // SAFETY: the arguments are the caller's, who keeps the rules of the replaced function.
    unsafe { poll(descriptors, count, limit_ms) }
}

/// Replaces ppoll(2).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn ppoll(
    descriptors: *mut pollfd,
    count: nfds_t,
    limit: *const timespec,
    mask: *const sigset_t,
) -> c_int {
    let call = |limit: *const timespec, mask: *const sigset_t| {
        real!(
            ppoll(descriptors: *mut pollfd, count: nfds_t, limit: *const timespec, mask: *const sigset_t) -> c_int
        )
    };
    if is_passed_on() {
        return call(limit, mask);
    }
    // SAFETY: the caller gives NULL or a time.
    let ns = unsafe { limit.as_ref() }.map(nanoseconds);
    // SAFETY: the caller gives `count` descriptors.
    let listed = || unsafe { listed(descriptors, count) };
    limited(ns, mask, || call(limit, mask), listed, |mask| call(&NO_TIME, mask))
}

/// Replaces __ppoll_chk, which programs that are compiled with checks call in place of ppoll(2).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn __ppoll_chk(
    descriptors: *mut pollfd,
    count: nfds_t,
    limit: *const timespec,
    mask: *const sigset_t,
    room: usize,
) -> c_int {
    if room / size_of::<pollfd>() < count as usize {
        return real!(
            __ppoll_chk(
                descriptors: *mut pollfd, count: nfds_t, limit: *const timespec, mask: *const sigset_t, room: usize
            ) -> c_int
        );
    }
    // SAFETY: the arguments are the caller's, who keeps the rules of the replaced function.
    unsafe { ppoll(descriptors, count, limit, mask) }
}

const NO_TIME: timespec = timespec { tv_sec: 0, tv_nsec: 0 };

/// The descriptors below `count` that are in the sets of select: to read, to write, and for exceptions.
fn selected(count: c_int, sets: &[fd_set; 3]) -> Arc<[pollfd]> {
    const EVENTS: [c_short; 3] = [libc::POLLIN, libc::POLLOUT, libc::POLLPRI];
    let found = (0..count).filter_map(|fd| {
        // SAFETY: the set is whole, and the descriptor is one that it has room for.
        let is_in = |set: &fd_set| unsafe { libc::FD_ISSET(fd, set) };
        let events = sets.iter().zip(EVENTS).filter(|(set, _)| is_in(set)).fold(0, |all, (_, event)| all | event);
        (events != 0).then_some(pollfd { fd, events, revents: 0 })
    });
    found.collect()
}

/// Waits for sets of descriptors, like [`limited`].
///
/// # Safety
/// Each set is NULL, or has the words with the first `count` descriptors. It need not have more words: the kernel uses
/// no others.
unsafe fn select_limited(
    count: c_int,
    sets: [*mut fd_set; 3],
    limit: Option<Option<u64>>,
    mask: *const sigset_t,
    forever: impl FnOnce() -> c_int,
    mut attempt: impl FnMut(*const sigset_t) -> c_int,
) -> c_int {
    let known = count.clamp(0, libc::FD_SETSIZE as c_int);
    let length = (known as usize).div_ceil(usize::BITS as usize) * size_of::<usize>();
    let wanted = sets.map(|set| {
        // SAFETY: a set is an array of integers.
        let mut copy: fd_set = unsafe { std::mem::zeroed() };
        if !set.is_null() {
            // SAFETY: the caller guarantees the words, and a set has room for the descriptors that are known.
            unsafe { set.cast::<u8>().copy_to_nonoverlapping((&raw mut copy).cast(), length) };
        }
        copy
    });
    limited(
        limit,
        mask,
        forever,
        || selected(known, &wanted),
        |mask| {
            // An attempt overwrites the sets, so they are restored before each.
            for (set, wanted) in sets.into_iter().zip(&wanted) {
                if !set.is_null() {
                    // SAFETY: as above.
                    unsafe { set.cast::<u8>().copy_from_nonoverlapping((&raw const *wanted).cast(), length) };
                }
            }
            attempt(mask)
        },
    )
}

/// Replaces select(2). As the kernel does, it overwrites the limit with the time that is left.
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn select(
    count: c_int,
    reads: *mut fd_set,
    writes: *mut fd_set,
    exceptions: *mut fd_set,
    limit: *mut timeval,
) -> c_int {
    let call = |limit: *mut timeval| {
        real!(
            select(
                count: c_int, reads: *mut fd_set, writes: *mut fd_set, exceptions: *mut fd_set, limit: *mut timeval
            ) -> c_int
        )
    };
    if is_passed_on() {
        return call(limit);
    }
    // SAFETY: the caller gives NULL or a time.
    let ns = unsafe { limit.as_ref() }.map(|given| {
        let (seconds, micros) = (u64::try_from(given.tv_sec).ok()?, u64::try_from(given.tv_usec).ok()?);
        Some(seconds.saturating_mul(1_000_000_000).saturating_add(micros.saturating_mul(1_000)))
    });
    let attempt = |_| call(&mut timeval { tv_sec: 0, tv_usec: 0 });
    let began = clock::now();
    // SAFETY: the caller gives NULL or sets.
    let result =
        unsafe { select_limited(count, [reads, writes, exceptions], ns, std::ptr::null(), || call(limit), attempt) };
    if let Some(Some(ns)) = ns {
        let left = if result == 0 { 0 } else { ns.saturating_sub(clock::now().saturating_sub(began)) };
        let left = system::timespec(left);
        // SAFETY: the caller has given a time.
        unsafe { limit.write(timeval { tv_sec: left.tv_sec, tv_usec: left.tv_nsec / 1000 }) };
    }
    result
}

/// Replaces pselect(2).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn pselect(
    count: c_int,
    reads: *mut fd_set,
    writes: *mut fd_set,
    exceptions: *mut fd_set,
    limit: *const timespec,
    mask: *const sigset_t,
) -> c_int {
    let call = |limit: *const timespec, mask: *const sigset_t| {
        real!(
            pselect(
                count: c_int,
                reads: *mut fd_set,
                writes: *mut fd_set,
                exceptions: *mut fd_set,
                limit: *const timespec,
                mask: *const sigset_t
            ) -> c_int
        )
    };
    if is_passed_on() {
        return call(limit, mask);
    }
    // SAFETY: the caller gives NULL or a time.
    let ns = unsafe { limit.as_ref() }.map(nanoseconds);
    let (forever, attempt) = (|| call(limit, mask), |mask| call(&NO_TIME, mask));
    // SAFETY: the caller gives NULL or sets.
    unsafe { select_limited(count, [reads, writes, exceptions], ns, mask, forever, attempt) }
}

/// Waits on an epoll descriptor, which is ready to be read when it has events.
fn epoll_limited(
    epoll: c_int,
    limit_ms: c_int,
    mask: *const sigset_t,
    call: impl Fn(c_int, *const sigset_t) -> c_int,
) -> c_int {
    let descriptor = || Arc::from([pollfd { fd: epoll, events: libc::POLLIN, revents: 0 }]);
    limited(milliseconds(limit_ms), mask, || call(limit_ms, mask), descriptor, |mask| call(0, mask))
}

/// Replaces epoll_wait(2).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn epoll_wait(epoll: c_int, events: *mut epoll_event, room: c_int, limit_ms: c_int) -> c_int {
    let call = |limit_ms: c_int| real!(epoll_wait(epoll: c_int, events: *mut epoll_event, room: c_int, limit_ms: c_int) -> c_int);
    if is_passed_on() {
        call(limit_ms)
    } else {
        epoll_limited(epoll, limit_ms, std::ptr::null(), |limit_ms, _| call(limit_ms))
    }
}

/// Replaces epoll_pwait(2).
#[unsafe(no_mangle)]
unsafe extern "C-unwind" fn epoll_pwait(
    epoll: c_int,
    events: *mut epoll_event,
    room: c_int,
    limit_ms: c_int,
    mask: *const sigset_t,
) -> c_int {
    let call = |limit_ms: c_int, mask: *const sigset_t| {
        real!(
            epoll_pwait(
                epoll: c_int, events: *mut epoll_event, room: c_int, limit_ms: c_int, mask: *const sigset_t
            ) -> c_int
        )
    };
    if is_passed_on() { call(limit_ms, mask) } else { epoll_limited(epoll, limit_ms, mask, call) }
}

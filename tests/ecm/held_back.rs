//! Axes that do not follow when they are stopped: they hold where they are, and go nowhere when they come free.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::common::{SECOND, SIZE, Tap, enable, script, uri};
use ecmsk::cia402::Statusword;
use ecmsk::coe::ObjectAddress;
use ecmsk::ecm::{Close, Config, Ecm, EcmError, Options};
use ecmsk::link::{self, Layer, Link, Share};
use ecmsk::sk::CommandId;

/// From when on axis 1 is jammed, and for how long.
const JAM: &str = "at 4s jam 1 for 4s\n";
const FREE_NS: u64 = 8_000_000_000;

/// A board of two drives that are on. No following error causes an alarm.
fn board(name: &str) -> (Arc<dyn Link>, Ecm) {
    let keys = format!("slaves=drive*2&name={name}&script={}", script(name, JAM));
    let link = link::open(&uri(&keys), Share::ByName).unwrap();
    let ecm = Ecm::over(Arc::clone(&link), Options::default()).unwrap();
    ecm.configure(&Config::drives(2)).unwrap();
    for slave in [1, 2] {
        ecm.sdo_write(slave, ObjectAddress::new(0x6065, 0), u32::MAX).unwrap();
    }
    (link, enable(ecm, &Config::drives(2)))
}

/// Moves both axes until the jammed one is 20000 counts from its target. Returns the last target.
fn move_into_the_jam(stream: &mut ecmsk::ecm::Stream<'_>) -> i32 {
    for n in 1.. {
        for slave in [1, 2] {
            stream.csp(slave, n * 10).unwrap();
        }
        stream.step().unwrap();
        let seen = stream.snapshot().unwrap();
        if (n * 10).abs_diff(seen.position(1).unwrap()) > 20_000 {
            let word = seen.drive(1).unwrap().statusword;
            assert!(word.0 & Statusword::INTERNAL_LIMIT != 0, "it pushes with all it has: {word:?}");
            return n * 10;
        }
    }
    unreachable!("it is jammed")
}

/// The positions of the axes now, and after the jam.
fn before_and_after(ecm: &Ecm) -> [[i32; 2]; 2] {
    let of = |seen: &ecmsk::ecm::Snapshot| [1, 2].map(|slave| seen.position(slave).unwrap());
    let first = ecm.next_cycle(SECOND).unwrap();
    assert!(first.meta.at.0 < FREE_NS, "it is jammed still");
    let mut last = first.clone();
    while last.meta.at.0 < FREE_NS + 1_000_000_000 {
        last = ecm.next_cycle(SECOND).unwrap();
    }
    assert!([1, 2].iter().all(|slave| last.drive(*slave).unwrap().statusword.is_enabled()));
    [of(&first), of(&last)]
}

/// API-10 The end of a stream holds an axis that is jammed where it is: when it comes free it stays there. The other one
/// has gone to its last target.
#[test]
fn the_end_of_a_stream_holds_a_jammed_axis_where_it_is() {
    let (_link, ecm) = board("held-stream");
    let mut stream = ecm.stream(16).unwrap();
    let target = move_into_the_jam(&mut stream);
    stream.finish().unwrap();
    let held = ecm.take_held_back().unwrap();
    let [first, last] = before_and_after(&ecm);
    assert!((last[0] - first[0]).abs() < 64, "it holds: {first:?} {last:?}");
    assert!((last[1] - target).abs() < 20, "it has followed: {last:?}, {target}");
    let [axis] = held.as_slice() else { panic!("{held:?}") };
    let away = axis.away.expect("this program has set its target");
    assert!(axis.slave == 1 && !axis.is_second && (axis.position - first[0]).abs() < 64, "{axis:?}");
    assert_eq!(away, target.abs_diff(axis.position));
    let said = axis.to_string();
    let rest = format!("axis 1 pushed, {away} counts from its target: its target is now its actual position, ");
    assert!(said.starts_with(&rest), "{said}");
    assert_eq!(ecm.take_held_back(), Ok(Vec::new()), "it was taken");
}

/// A program has left an axis pushing, and what its target was is not known. The drive shows that it is held back.
#[test]
fn a_stop_holds_a_jammed_axis_of_another_program_where_it_is() {
    let (link, mut ecm) = board("held-stop");
    let mut stream = ecm.stream(16).unwrap();
    move_into_the_jam(&mut stream);
    std::mem::forget(stream);
    // The jam would end if the link were opened again.
    let again = Ecm::over(Arc::clone(&link), Options::default()).unwrap();
    std::mem::forget(std::mem::replace(&mut ecm, again));
    // The other axis arrives meanwhile.
    (0..300).for_each(|_| drop(ecm.next_cycle(SECOND).unwrap()));
    assert!(ecm.stop(&Config::drives(2), false).unwrap());
    let held = ecm.take_held_back().unwrap();
    let [first, last] = before_and_after(&ecm);
    assert!((last[0] - first[0]).abs() < 64, "it holds: {first:?} {last:?}");
    assert!(matches!(held.as_slice(), [axis] if axis.slave == 1 && axis.away.is_none()), "{held:?}");
}

/// How far from its target the axis of [`Freed`] is jammed, counts.
const FAR: i32 = 20_000;

/// A stop of one axis that is jammed at 0, and comes free at a time.
struct Freed {
    /// When the stop began, and when it has held the axis, ms; the latter is 0 if it did not.
    began: u64,
    held: u64,
    /// The position and the statusword in each report of the stop, and of half a second after it if the axis stays on.
    trail: Vec<(i32, Statusword)>,
    /// The length of `trail` when the stop ended.
    stopped: usize,
}

impl Freed {
    fn at(free_ms: u64, how: Close) -> Self {
        let file = script(&format!("freed-{free_ms}-{how:?}"), &format!("at 1s jam 1\nat {free_ms}ms end jam 1\n"));
        let tap = Tap::open(&format!("slaves=drive&script={file}"));
        let ecm = tap.ecm(Options::default()).unwrap();
        ecm.configure(&Config::drives(1)).unwrap();
        ecm.sdo_write(1, ObjectAddress::new(0x6065, 0), u32::MAX).unwrap();
        let ecm = enable(ecm, &Config::drives(1));
        until_it_is_jammed(&tap, &ecm);
        let mut stream = ecm.stream(16).unwrap();
        for target in (0..=FAR).step_by(200) {
            stream.csp(1, target).unwrap();
            stream.step().unwrap();
        }
        (0..60).for_each(|_| drop(ecm.next_cycle(SECOND).unwrap()));
        let began = ms(&tap);
        assert!(began < free_ms, "{began} ms: it is jammed still");
        let trail: Arc<Mutex<Vec<_>>> = Arc::default();
        let noted = Arc::clone(&trail);
        tap.bend(move |_, frame| {
            let slot = frame.slot(SIZE, 1);
            noted.lock().unwrap().push((slot.data1 as i32, Statusword(slot.parm)));
        });
        let (held, clock) = (Arc::new(Mutex::new(0)), Arc::downgrade(&tap));
        let noted = Arc::clone(&held);
        tap.lose(move |frame| {
            let slot = frame.slot(SIZE, 1);
            if slot.id == CommandId::Csp.code() && slot.data1 as i32 != FAR {
                *noted.lock().unwrap() = ms(&clock.upgrade().unwrap());
            }
            false
        });
        let seen = Arc::clone(&trail);
        let read = || seen.lock().unwrap().len();
        let stopped = if how == Close::Hold {
            stream.finish().unwrap();
            let stopped = read();
            (0..500).for_each(|_| drop(ecm.next_cycle(SECOND).unwrap()));
            stopped
        } else {
            // Closing stops the axis, too.
            std::mem::forget(stream);
            ecm.close(how).unwrap();
            read()
        };
        let (held, trail) = (*held.lock().unwrap(), trail.lock().unwrap().clone());
        Self { began, held, trail, stopped }
    }

    /// Whether the axis was at rest when it was switched off, or when the stop ended, and rests; and whether it has kept
    /// between its place and its target.
    fn rests(&self) -> bool {
        let end = self.trail.iter().position(|(_, word)| !word.is_enabled()).unwrap_or(self.stopped);
        let (from, to) = (self.trail[end - 2].0, self.trail[end - 1].0);
        let last = self.trail.last().unwrap().0;
        // The end of its way is slow, and it may pass its target by a little. If it comes free in the cycle in which its target
        // steps back to where it is, its drive follows that step for a moment with all the torque that it has.
        from.abs_diff(to) <= 4
            && to.abs_diff(last) <= 100
            && self.trail.iter().all(|(at, _)| (-1000..=FAR + 1000).contains(at))
    }
}

/// The board's time since it was opened, ms, as scripts have it.
fn ms(tap: &Tap) -> u64 {
    let opened_at = Duration::from_nanos(Layer::info(tap).opened_at.0);
    u64::try_from((tap.now() - opened_at).as_millis()).unwrap()
}

/// Waits for the jam at 1 s of a script.
fn until_it_is_jammed(tap: &Tap, ecm: &Ecm) {
    assert!(ms(tap) < 1000, "it is free yet");
    while ms(tap) < 1100 {
        ecm.next_cycle(SECOND).unwrap();
    }
}

/// docs/SAFETY.md: a jammed axis that comes free while a stop decides whether it is jammed goes to its last target. The
/// stop waits until it is there, and only then ends, or switches it off.
#[test]
fn an_axis_that_comes_free_during_a_stop_is_at_rest_at_its_end() {
    let never = Freed::at(60_000, Close::Hold);
    assert!(never.held > never.began + 20 && never.rests(), "{} {}", never.began, never.held);
    // The last ones come free while the frame that holds the axis is on its way.
    for free in never.began + 1..never.held + 6 {
        for how in [Close::Hold, Close::ServoOff] {
            let freed = Freed::at(free, how);
            assert!(freed.rests(), "free at {free} ms, held at {} ms, {how:?}: {:?}", freed.held, freed.trail);
        }
    }
}

/// An axis that springs back when its drive ceases to push gets no ramp in that direction: its target stays the position at
/// which it was held.
#[test]
fn an_axis_that_springs_back_is_not_driven_on() {
    let tap = Tap::open(&format!("slaves=drive&script={}", script("springs", "at 1s jam 1\n")));
    let ecm = tap.ecm(Options::default()).unwrap();
    ecm.configure(&Config::drives(1)).unwrap();
    ecm.sdo_write(1, ObjectAddress::new(0x6065, 0), u32::MAX).unwrap();
    let ecm = enable(ecm, &Config::drives(1));
    until_it_is_jammed(&tap, &ecm);
    let mut stream = ecm.stream(16).unwrap();
    for target in (0..=FAR).step_by(200) {
        stream.csp(1, target).unwrap();
        stream.step().unwrap();
    }
    let is_held = Arc::new(AtomicBool::new(false));
    let noted = Arc::clone(&is_held);
    tap.lose(move |frame| {
        let slot = frame.slot(SIZE, 1);
        noted.fetch_or(slot.id == CommandId::Csp.code() && slot.data1 as i32 != FAR, Ordering::AcqRel);
        false
    });
    // 30 cycles at 40 counts, and then it stands.
    let mut sprung = 0;
    tap.bend_slot(1, move |_, slot| {
        sprung += i32::from(is_held.load(Ordering::Acquire) && sprung < 30);
        slot.data1 = (slot.data1 as i32 - 40 * sprung) as u32;
    });
    stream.finish().unwrap();
    let mut targets: Vec<_> = tap.take_slots(1).iter().map(|slot| slot.data1 as i32).collect();
    targets.dedup();
    let [.., far, held] = targets[..] else { panic!("{targets:?}") };
    assert!(far == FAR && held.abs() < 64, "{targets:?}");
}

/// An axis that is jammed beyond its limit may be held where it is, but not further out. Noise of its position makes a hold lead
/// further out, by the report that the link with the limits has. The stop tries again, and says of no axis that it is held before
/// the board has got that.
#[test]
fn a_hold_that_a_limit_refuses_is_tried_again() {
    let limits = "format = 1\n[axes]\nX = { slave = 1, min = 10000, max = 30000 }\n[limits]\nprogram = \"stop\"\n";
    for (noisy, holds) in [(60, true), (u64::MAX, false)] {
        let jam = script("limit-jam", "at 1s jam 1\n");
        let file = script(&format!("limit-{holds}"), limits);
        let tap = Tap::open(&format!("slaves=drive&script={jam}&axes={file}"));
        let ecm = tap.ecm(Options::default()).unwrap();
        ecm.configure(&Config::drives(1)).unwrap();
        ecm.sdo_write(1, ObjectAddress::new(0x6065, 0), u32::MAX).unwrap();
        let ecm = enable(ecm, &Config::drives(1));
        until_it_is_jammed(&tap, &ecm);
        let mut stream = ecm.stream(16).unwrap();
        for target in (0..=FAR).step_by(200) {
            stream.csp(1, target).unwrap();
            stream.step().unwrap();
        }
        tap.bend_slot(1, move |n, slot| slot.data1 = (slot.data1 as i32 - if n < noisy { 80 } else { 0 }) as u32);
        let ended = stream.finish();
        let held = ecm.take_held_back().unwrap();
        let last = tap.take_slots(1).last().unwrap().data1 as i32;
        if holds {
            assert!(ended.is_ok(), "{ended:?}");
            assert!(matches!(held.as_slice(), [axis] if axis.position == last) && last.abs() < 64, "{held:?} {last}");
        } else {
            let error = ended.unwrap_err();
            assert!(matches!(error, EcmError::Timeout { .. }), "{error}");
            assert!(error.to_string().contains("a limit of the machine file keeps it from being held"), "{error}");
            assert!(held.is_empty() && last == FAR, "{held:?} {last}");
        }
    }
}

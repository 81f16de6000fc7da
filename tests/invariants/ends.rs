//! A writer's end at a server: for every cause, at every message, each axis that it moved stands within the documented
//! time, no brake passes the last accepted target in CSP or turns round, and no entry that it left in the FIFO moves an axis
//! later. The same holds if the server's process stalls at any time. The server has no sockets and no reader of its messages,
//! as one whose log stalls; time is the board's.
//!
//! `cargo xtask soak` runs 10,000 of them. To repeat one: `ECMSK_SOAK_FIRST=<seed> ECMSK_SOAK_SCHEDULES=1`.

mod course;
mod eyes;
mod standstill;
mod writer;

use std::ops::AddAssign;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use ecmsk::cia402::Mode;
use ecmsk::link::Link;
use ecmsk::link::engine::{EngineLink, RunOptions};
use ecmsk::port::tcp::ServeOptions;
use ecmsk::port::tcp::in_memory::{InMemoryClient, InMemoryServer};
use ecmsk::sk::{CycleTime, FIFO_ENTRIES};

use crate::machine::Machine;
use crate::run_all;
use eyes::{Break, Eyes};
use standstill::{End, assert_lasting, heal};
use support::dice::Dice;
use writer::{Bounds, Writer};

/// Schedules of the test; `cargo xtask soak` asks for more.
const SCHEDULES: u64 = 150;
/// The longest time in which a drive that was commanded to stop comes to rest.
const COMES_TO_REST: Duration = Duration::from_millis(50);

/// docs/SAFETY.md: "Usually it takes the time of the entries in the FIFO, and 250 ms more for a velocity". Then axes are
/// watched until they are at rest.
const RAMP: Duration = Duration::from_millis(250);
const COMING_TO_REST: Duration = Duration::from_millis(50);
/// Cycles until the brake begins, and until its last frame is executed.
const AROUND_CYCLES: u32 = 20;

/// Totals of the schedules, so that none passes without events.
#[derive(Debug, Default)]
struct Done {
    moving: u64,
    full: u64,
    thresholds: u64,
    held: u64,
    still: u64,
    homing: u64,
    torn: u64,
    failed: u64,
    slow: u64,
    spoiled: u64,
    broken: u64,
    stopped: u64,
    stood: u64,
    stood_before: u64,
    /// Commands of brakes' own.
    own: u64,
    /// Writers whose brake took the usual time.
    usual: u64,
}

impl AddAssign for Done {
    fn add_assign(&mut self, other: Self) {
        self.moving += other.moving;
        self.full += other.full;
        self.thresholds += other.thresholds;
        self.held += other.held;
        self.still += other.still;
        self.homing += other.homing;
        self.torn += other.torn;
        self.failed += other.failed;
        self.slow += other.slow;
        self.spoiled += other.spoiled;
        self.broken += other.broken;
        self.stopped += other.stopped;
        self.stood += other.stood;
        self.stood_before += other.stood_before;
        self.own += other.own;
        self.usual += other.usual;
    }
}

/// One schedule: a writer runs, dies, and another one comes. Some boards check CRCs, and if `may_break` some networks
/// break while the server stops the axes.
fn schedule(seed: u64, may_break: bool) -> Done {
    let mut dice = Dice(seed ^ 0x656E_6473_2121);
    let mut machine = Machine::new(seed);
    let cycle = dice.pick(&[250, 500, 1000, 1000, 1000, 2000, 4000, 8000, 16_000, 64_000]);
    machine.cycle = CycleTime::from_us(cycle).expect("a cycle of the guide's");
    let host_us = dice.pick(&[0, 1, 10, 125, 125]);
    let set_up = machine.set_up();
    let mut spoils = Dice(seed ^ 0x4352_4321);
    let checks = may_break && spoils.one_in(4);
    if checks {
        machine.check_commands();
    }
    let Machine { board, network, size, units, .. } = machine;
    let run = RunOptions { host_ns: host_us * 1000, queue: dice.pick(&[1, 4, 32]), ..RunOptions::default() };
    let link = EngineLink::open("sim:", board, run, None).expect("it talks");
    let eyes = Arc::new(Eyes::new(link, network, &units));
    let here = thread::current().id();
    let options = ServeOptions {
        tell: Arc::new(move |line| assert_ne!(thread::current().id(), here, "the server waits for its log: {line}")),
        ..ServeOptions::default()
    };
    let server = InMemoryServer::new(Arc::clone(&eyes) as Arc<dyn Link>, options);
    let readers: Vec<InMemoryClient<'_>> = (0..dice.below(3)).map(|_| server.join(false).expect("a reader")).collect();
    let caller = server.join(true).expect("the writer");
    let mut writer = Writer::new(caller, Arc::clone(&eyes), &units, size, cycle, Dice(dice.roll()));
    if checks {
        writer = writer.spoiling(spoils);
    }
    let mut early = Dice(seed ^ 0x4561_726C_7921);
    if may_break && early.one_in(4) {
        let rarely = early.pick(&[20, 200, 1000]);
        eyes.stand_still(early, rarely);
    }
    writer.live(&set_up);
    let stood_before = eyes.stood() > Duration::ZERO;
    let (caller, bounds, life) = writer.dies();
    course::begin(&units);

    // The server's steps must not exceed the writer's.
    let moving = eyes.is_moving();
    let waiting = FIFO_ENTRIES - eyes.newest_free();
    let mut breaks = Dice(seed ^ 0x4361_626C_6521);
    if may_break && breaks.one_in(5) {
        let calls = breaks.pick(&[0, 1, 5, 50, 300]);
        let slave = 1 + breaks.below(1 + units.len() as u64) as u8;
        let what =
            [Break::Cable(0), Break::Cable(slave), Break::Silence(slave), Break::Power(slave), Break::Alarm(slave)];
        eyes.break_in(breaks.below(calls + 1), breaks.pick(&what));
    }
    let mut stalls = Dice(seed ^ 0x5374_616C_6C21);
    if may_break && stalls.one_in(4) {
        eyes.stand_still(stalls, 20);
    }
    let mut stops = Dice(seed ^ 0x5374_6F70_7321);
    let is_stopped = may_break && stops.one_in(4);
    let end = if is_stopped {
        End::of_stop(caller, stops.one_in(2), &server, &eyes, cycle)
    } else {
        End::of(caller, &server, &eyes, cycle)
    };
    let own = course::check(&units, bounds.accepted());
    let was_broken = heal(&eyes, cycle);
    if !was_broken {
        check_bounds(&bounds, &eyes);
    }
    // With a cycle of 64 ms there are 31 in the time, and a homing that is aborted takes its own.
    let failed = end.has_failed();
    let stood = eyes.stood() > Duration::ZERO;
    assert!(
        !failed || was_broken || stood || cycle > 16_000,
        "cycle of {cycle} us, {waiting} waiting, {life:?}, {bounds:?}: {:?}",
        end.told
    );
    // docs/SAFETY.md: waiting entries are executed if that is possible within 2 s: 160 cycles of 8 ms are.
    assert!(
        cycle > 8000
            || life.has_threshold
            || was_broken
            || stood
            || !end.told.iter().any(|line| line.contains("dropped")),
        "cycle of {cycle} us: {:?}",
        end.told
    );
    let coasts = units.iter().any(|unit| unit.mode == Mode::Cst);
    let is_odd = life.has_threshold || life.lost > 0 || life.spoiled > 0 || bounds.jumps() || coasts || cycle > 8000;
    let is_usual = !(is_odd || was_broken || stood || failed);
    if is_usual {
        let cycles = Duration::from_micros(cycle.into()) * (u32::from(waiting) + AROUND_CYCLES);
        let usual = cycles + RAMP + COMING_TO_REST;
        assert!(end.took <= usual, "{:?} instead of {usual:?}, cycle of {cycle} us, {waiting} waiting", end.took);
    }
    assert_lasting(&server, &eyes, &readers, COMES_TO_REST, cycle);
    Done {
        moving: moving.into(),
        full: u64::from(life.lost > 0),
        thresholds: life.has_threshold.into(),
        held: u64::from(life.has_threshold && waiting > 1),
        still: end.was_held.into(),
        homing: life.has_homed.into(),
        torn: life.torn.into(),
        failed: failed.into(),
        slow: u64::from(cycle > 8000),
        spoiled: u64::from(life.spoiled > 0),
        broken: was_broken.into(),
        stopped: is_stopped.into(),
        stood: stood.into(),
        stood_before: stood_before.into(),
        own,
        usual: is_usual.into(),
    }
}

/// A ramp commands no step in CSP and no velocity in CSV that is greater than those of the writer.
fn check_bounds(bounds: &Bounds, eyes: &Eyes) {
    for ((slave, axis, mode), (writer, server)) in bounds.compare(eyes) {
        assert!(server <= writer, "slave {slave}, axis {axis}, {mode:?}: {server} after {writer} of the writer");
    }
}

/// TCP-24: schedules that once found a moving axis, or a server that waited in vain. A threshold at the very moment of
/// the newest report; a target in CSP that is seconds away; axes that fail in their motion; a homing whose begin was in
/// a lost report; an axis that begins to move a cycle of 8 ms after the last entry; a refused reset by a writer that
/// never reads.
#[test]
fn writers_that_died_badly() {
    for seed in [2555, 6392, 6876, 8525, 3028, 4626, 7907, 4275, 3158, 4537, 7226, 8327, 3500, 47306] {
        println!("writer {seed}");
        schedule(seed, false);
    }
    println!("a writer of a board that checks CRCs");
    schedule(4378, true);
}

/// TCP-24 TCP-9 TCP-23: writers that die at any message or in the middle of a message, with any threshold and level of
/// the FIFO, in CSP, CSV, CST and homing, one channel and two, slots of both sizes, with readers.
#[test]
fn writers_that_die() {
    let (schedules, all) = run_all("writers_that_die", SCHEDULES, |seed| schedule(seed, true));
    if schedules >= SCHEDULES {
        let Done { moving, full, thresholds, held, still, homing, torn, slow, spoiled, broken, stood, .. } = all;
        let Done { stood_before, own, usual, stopped, .. } = all;
        for (what, n, of) in [
            ("moving", moving, 3),
            ("full", full, 12),
            ("thresholds", thresholds, 8),
            ("held", held, 40),
            ("still", still, 60),
            ("homing", homing, 12),
            ("torn", torn, 12),
            ("slow", slow, 12),
            ("spoiled", spoiled, 10),
            ("broken", broken, 20),
            ("stopped", stopped, 8),
            ("stood", stood, 8),
            ("stood before", stood_before, 10),
            ("commands of brakes", own, 1),
            ("usual", usual, 75),
        ] {
            assert!(n >= schedules / of, "{what}: only {n} of {schedules}");
        }
    }
}

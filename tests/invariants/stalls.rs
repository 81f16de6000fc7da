//! A process that stalls at any moment, for up to 5 s: stopped, swapped out, on a suspended machine. It may be the program that
//! moves axes, or the server of its board, which stops the axes of a program that was silent for 2 s. It may be the board's
//! runner, also while the board is closed and switches its axes off. (Simulated slaves stand still with their runner.) Whatever the program does, and in whatever phase of its
//! brake another stall comes:
//!
//! - an axis in CSP gets the program's targets, in their order, and no others: no brake goes beyond the last one, or back;
//! - the velocities and torques of a brake have the sign of the last one, and decrease;
//! - the brake of a server, or of a board that is closed, does the same (`serve gadget` brakes by the code of `serve tcp`);
//! - in the end all axes stand, by their shafts, and a velocity is 0;
//! - a board that answers every cycle is never reported as silent, however long the program did not read.
//!
//! This holds on simulated slaves, behind an ECM-XF, and over slave controllers at a network card, which leave OP by themselves
//! if their watchdog expires meanwhile. `cargo xtask soak` runs 10,000 of them. To repeat one: `ECMSK_SOAK_FIRST=<seed>
//! ECMSK_SOAK_SCHEDULES=1`.

mod bus;
mod link;
mod remote;

use std::ops::AddAssign;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use ecmsk::cia402::Mode;
use ecmsk::ecm::{Axis, Close, Config, Ecm, EcmError, Options, Slave, Stream};
use ecmsk::engine::{Board, EngineConfig};
use ecmsk::link::Link;
use ecmsk::link::engine::{EngineLink, Keeper, RunOptions};
use ecmsk::sk::{MasterState, SlaveCommand, SlotSize};
use support::dice::Dice;

use crate::run_all;
use bus::{Net, Runner, Told, net};
use link::Stalling;
use remote::Remote;

/// Schedules of the test; `cargo xtask soak` asks for more.
const SCHEDULES: u64 = 80;
const SERVED_SCHEDULES: u64 = 30;
const SIZE: SlotSize = SlotSize::Bytes12;
const MS: Duration = Duration::from_millis(1);
/// How far noise and friction may move a standing shaft, counts.
const STANDS: i64 = 60;

/// Totals of the schedules, so that none passes without events.
#[derive(Debug, Default)]
struct Done {
    stalls: u64,
    in_brakes: u64,
    moving: u64,
    positions: u64,
    velocities: u64,
    /// Programs that a server has missed, and stalls of servers.
    missed: u64,
    server_stalls: u64,
    /// Boards that were switched off.
    switched_off: u64,
    /// Stalls of runners at a network card, and over a chip.
    runners: [u64; 2],
}

impl AddAssign for Done {
    fn add_assign(&mut self, other: Self) {
        self.stalls += other.stalls;
        self.in_brakes += other.in_brakes;
        self.moving += other.moving;
        self.positions += other.positions;
        self.velocities += other.velocities;
        self.missed += other.missed;
        self.server_stalls += other.server_stalls;
        self.switched_off += other.switched_off;
        self.runners.iter_mut().zip(other.runners).for_each(|(all, one)| *all += one);
    }
}

/// The program's view of an axis.
struct Led {
    mode: Mode,
    /// The position when it was switched on.
    start: i32,
    position: i32,
    speed: i32,
    told: Told,
}

impl Led {
    /// Gives the axis its next target.
    fn aim(&mut self, stream: &mut Stream<'_>, slave: u8, dice: &mut Dice) -> Result<(), EcmError> {
        self.speed = (self.speed + dice.below(21) as i32 - 10).clamp(-300, 300);
        match self.mode {
            Mode::Csv => stream.csv(slave, self.speed * 500),
            // Less than friction: the speed that a torque gives an axis is not checked.
            Mode::Cst => stream.cst(slave, (self.speed % 25) as i16),
            _ => {
                self.position += self.speed;
                stream.csp(slave, self.position)
            }
        }
    }
}

fn value(command: SlaveCommand) -> Option<i32> {
    match command {
        SlaveCommand::Csp(motion) | SlaveCommand::Csv(motion) => Some(motion.first.target),
        SlaveCommand::Cst(torque) => Some(torque.into()),
        _ => None,
    }
}

/// Moves the axes until the program ends its motion or a call has failed.
fn lead(ecm: &Ecm, axes: &mut [Led], depth: u16, dice: &mut Dice) -> Result<(), EcmError> {
    let mut stream = ecm.stream(depth)?;
    let mut steps = || {
        for _ in 0..dice.below(500) {
            for (slave, axis) in (1..).zip(axes.iter_mut()) {
                axis.aim(&mut stream, slave, dice)?;
            }
            stream.step()?;
        }
        Ok(())
    };
    let led = steps();
    if dice.one_in(2) {
        return led.and(stream.finish().map(drop));
    }
    // The stream is dropped, or leaked by a program whose board is dropped next.
    if dice.one_in(2) {
        std::mem::forget(stream);
    }
    led
}

fn schedule(seed: u64, is_served: bool) -> Done {
    let mut dice = Dice(seed ^ if is_served { 0x7374_5345_5256 } else { 0x7374_616C_6C73 });
    let count = 1 + dice.below(3) as usize;
    let modes: Vec<Mode> = (0..count).map(|_| dice.pick(&[Mode::Csp, Mode::Csp, Mode::Csv, Mode::Cst])).collect();
    let Net { bus, network, told, cycle_us, runner } = net(seed, count, &mut dice);
    let mut board = Board::new(EngineConfig { slot: SIZE, ..EngineConfig::default() }, bus);
    assert!(board.boot(60_000_000_000));
    let run =
        RunOptions { queue: dice.pick(&[1, 4, 32]), host_ns: dice.pick(&[1_000, 125_000]), ..RunOptions::default() };
    let kept = Arc::new(Mutex::new(None));
    let keeper: Keeper = {
        let kept = Arc::clone(&kept);
        Box::new(move |board| *kept.lock().expect("no panic") = board)
    };
    let board = Arc::new(EngineLink::open("stalls", board, run, Some(keeper)).expect("it talks"));
    let of_server = is_served.then(|| Arc::new(Stalling::new(Arc::clone(&board), None, Dice(dice.roll()))));
    let remote = of_server.as_ref().map(|link| Remote::new(Arc::clone(link)));
    let link = Arc::new(Stalling::new(Arc::clone(&board), remote, Dice(dice.roll())));

    let options = Options { close: dice.pick(&[Close::Hold, Close::ServoOff]), ..Options::default() };
    let ecm = Ecm::over(Arc::clone(&link) as Arc<dyn Link>, options).expect("it reports");
    let slaves = modes.iter().map(|mode| Slave::Drive(Axis { mode: *mode, ..Axis::CSP })).collect();
    ecm.configure(&Config { slaves, cycle_us }).expect("they are there");
    ecm.set_state(MasterState::Op).expect("it comes up");
    let all: Vec<u8> = (1..=count as u8).collect();
    ecm.servo_on(&all).expect("they are well");
    let start = ecm.snapshot().expect("it reports");
    let axis = |(n, mode): (usize, &Mode)| {
        let start = start.position(n as u8 + 1).expect("an axis");
        Led { mode: *mode, start, position: start, speed: 0, told: Arc::clone(&told[n]) }
    };
    let mut axes: Vec<Led> = modes.iter().enumerate().map(axis).collect();
    told.iter().for_each(|told| told.lock().expect("no panic").values.clear());

    let rarely = dice.pick(&[10, 50, 200]);
    link.stand_still(Some(rarely));
    runner.stand_still(dice.pick(&[None, None, Some(100)]));
    if let Some(link) = &of_server {
        link.stand_still(dice.pick(&[None, Some(20), Some(300)]));
    }
    let server_stood = || of_server.as_ref().map_or(0, |link| link.stood());
    let depth = dice.pick(&[1, 2, 8, 64, 150]);
    let led = lead(&ecm, &mut axes, depth, &mut dice);
    link.begin_to_brake();
    let moving = link.is_moving(&network, count);
    // The library sends nothing when its program closes the board. A board of the program's own then switches itself off.
    let switches_off = !is_served && dice.one_in(4);
    let closed = match dice.one_in(2) {
        _ if switches_off => ecm.close(Close::Leave),
        true => ecm.close(options.close),
        false => drop_it(ecm),
    };
    for ended in [led, closed] {
        let is_late = matches!(ended, Err(EcmError::Timeout { .. }));
        let is_silent = matches!(ended, Err(EcmError::NoReport { .. }));
        assert!(!is_silent || runner.stood() + server_stood() > 0, "a board that answers every cycle: {ended:?}");
        assert!(!is_late || link.stood() + runner.stood() + server_stood() > 0, "{ended:?}");
    }
    let missed = link.is_missed();
    link.stand_still(None);
    of_server.iter().for_each(|link| link.stand_still(None));
    runner.stand_still(None);

    let board = if switches_off { switched_off(&board, &kept, &runner, run) } else { board };
    board.pass(5000 * MS).expect("it is there");
    let before: Vec<_> = (1..=count as u8).map(|slave| network.shaft(slave, 0).expect("an axis")).collect();
    board.pass(500 * MS).expect("it is there");
    for (n, axis) in axes.iter().enumerate() {
        let slave = n as u8 + 1;
        let way = network.shaft(slave, 0).expect("an axis") - before[n];
        let at = format!("slave {slave} in {:?}", axis.mode);
        assert!(way.abs() <= STANDS, "{at} moves {way} counts in 500 ms");
        check(axis, &link.accepted(n + 1), &link.braked(n + 1), missed, &at);
        assert!(!switches_off || !axis.told.lock().expect("no panic").is_on, "{at} is off");
    }
    Done {
        stalls: link.stood() + runner.stood(),
        in_brakes: link.stood_in_brake(),
        moving: moving.into(),
        positions: modes.iter().filter(|mode| **mode == Mode::Csp).count() as u64,
        velocities: modes.iter().filter(|mode| **mode == Mode::Csv).count() as u64,
        missed: missed.into(),
        server_stalls: server_stood(),
        switched_off: switches_off.into(),
        runners: [runner.stood() - runner.stood_over_chip(), runner.stood_over_chip()],
    }
}

/// The board's link is closed, and the board switched off, as at the end of a program whose own it is. Its runner stalls
/// meanwhile. Returns a new link to it, so that its time goes on.
fn switched_off(link: &EngineLink, kept: &Mutex<Option<Board>>, runner: &Runner, run: RunOptions) -> Arc<EngineLink> {
    link.close();
    let mut board = kept.lock().expect("no panic").take().expect("the board");
    runner.stand_still_soon();
    board.switch_off();
    runner.stand_still(None);
    Arc::new(EngineLink::open("switched off", board, run, None).expect("it talks"))
}

fn drop_it(ecm: Ecm) -> Result<(), EcmError> {
    drop(ecm);
    Ok(())
}

/// Checks the commands of an axis against those that the program and its brake have written. `missed`: whether a server
/// has braked it.
fn check(axis: &Led, accepted: &[SlaveCommand], braked: &[SlaveCommand], missed: bool, at: &str) {
    let accepted: Vec<i32> = accepted.iter().copied().filter_map(value).collect();
    let braked: Vec<i32> = braked.iter().copied().filter_map(value).collect();
    let told = axis.told.lock().expect("no panic");
    let last = accepted.last().copied().unwrap_or_default();
    match axis.mode {
        Mode::Csp => {
            assert!(
                braked.iter().all(|target| *target == last),
                "{at}: {last} was the last, the brake wrote {braked:?}"
            );
            let all: Vec<i32> = [axis.start].into_iter().chain(accepted).collect();
            let mut left = all.iter();
            for target in &told.values {
                assert!(left.any(|one| one == target), "{at} was told {target}, which is none of {all:?} in order");
            }
        }
        _ => {
            let falls = |value: i32, before: i32| {
                value.abs() <= before.abs() && (value == 0 || value.signum() == before.signum())
            };
            let mut before = last;
            for value in &braked {
                assert!(falls(*value, before), "{at}: {value} after {before}, in {braked:?} after {last}");
                before = *value;
            }
            // What neither the program nor its brake has written is of the server's brake.
            let mut written = accepted.iter().chain(&braked);
            let values = told.values.iter().copied();
            let of_server: Vec<i32> =
                values.skip_while(|value| *value == 0 || written.any(|one| one == value)).collect();
            assert!(missed || of_server.is_empty(), "{at}: {of_server:?} after {accepted:?} and {braked:?}");
            let all_fall = of_server.windows(2).all(|pair| falls(pair[1], pair[0]));
            // Reports show a velocity that is not quite the commanded one.
            let most = accepted.iter().map(|value| value.abs()).max().unwrap_or_default() * 5 / 4 + 5000;
            let begins = of_server.first().is_none_or(|first| first.abs() <= most);
            assert!(all_fall && begins, "{at}: the server's {of_server:?} after {accepted:?} and {braked:?}");
            if axis.mode == Mode::Csv && told.is_on && last != 0 {
                assert_eq!(told.values.last(), Some(&0), "{at}: the velocity is in force, {braked:?} after {last}");
            }
        }
    }
}

/// API-10: brakes of programs that stall at any moment, and boards whose runner does.
#[test]
fn a_process_that_stands_still() {
    let (schedules, all) = run_all("a_process_that_stands_still", SCHEDULES, |seed| schedule(seed, false));
    if schedules >= SCHEDULES {
        let Done { stalls, in_brakes, moving, positions, velocities, switched_off, runners, .. } = all;
        for (what, n, of) in [
            ("stalls", stalls, 1),
            ("stalls in brakes", in_brakes, 10),
            ("moving when braked", moving, 8),
            ("positions", positions, 2),
            ("velocities", velocities, 4),
            ("switched off", switched_off, 8),
            ("stalls of runners at a card", runners[0], 8),
            ("stalls of runners over a chip", runners[1], 8),
        ] {
            assert!(n >= schedules / of, "{what}: only {n} of {schedules}");
        }
    }
}

/// API-10, TCP-9: the same for programs whose board is served, on each of these buses. A program that stalls for 2 s is
/// missed: the server stops its axes, and may stall meanwhile, too.
#[test]
fn a_client_that_stands_still() {
    let (schedules, all) = run_all("a_client_that_stands_still", SERVED_SCHEDULES, |seed| schedule(seed, true));
    if schedules >= SERVED_SCHEDULES {
        let Done { stalls, moving, missed, server_stalls, .. } = all;
        for (what, n, of) in
            [("stalls", stalls, 1), ("moving", moving, 8), ("missed", missed, 10), ("of servers", server_stalls, 4)]
        {
            assert!(n >= schedules / of, "{what}: only {n} of {schedules}");
        }
    }
}

//! The bus of a schedule, its drives, which record their commands, and a runner that stalls.

use std::sync::{Arc, Mutex, MutexGuard};

use ecmsk::cia402::Controlword;
use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope};
use ecmsk::fieldbus::nic::{ChainWires, NicBus, NicWires};
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::fieldbus::{AlState, CycleDone, Fieldbus, Inputs, Ns};
use ecmsk::master::{FrameBuffer, Settings, Wire, WireDown};
use ecmsk::slave::handle::SimHandle;
use ecmsk::slave::{Drive, DriveConfig, Slave};
use support::dice::Dice;
use support::hand_on;
use support::images::{Images, number};
use support::swift::SWIFT;

use crate::chip::{How, Trouble};
use crate::followed::Setting;

/// The most stalls of a runner.
const STALLS: u64 = 4;
const MS: Ns = 1_000_000;

/// The commands of a drive.
#[derive(Default)]
pub struct Orders {
    /// Targets, velocities or torques while it was enabled, without repetitions.
    pub values: Vec<i32>,
    /// Whether it is still enabled.
    pub is_on: bool,
}

/// The commands of a drive, shared with the schedule.
pub type Told = Arc<Mutex<Orders>>;

/// A drive that records its commands.
struct Noting {
    inner: Drive,
    images: Images,
    told: Told,
}

impl Slave for Noting {
    support::hand_on_slave!(inner: name, state, enter, read_entries, set_sync_managers, step, apply_fault, has_dc, shaft);

    fn write(&mut self, object: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), AbortCode> {
        self.inner.write(object, scope, value)?;
        self.images.take(object, number(value));
        Ok(())
    }

    fn exchange(&mut self, outputs: Option<&[u8]>, inputs: &mut [u8]) {
        let first = outputs.map(|outputs| self.images.outputs(outputs)[0]).filter(|_| self.state() == AlState::Op);
        let on = first.filter(|first| first.controlword == Controlword::ENABLE_OPERATION);
        let mut told = self.told.lock().expect("no panic");
        told.is_on = on.is_some();
        if let Some(on) = on
            && told.values.last() != Some(&on.target)
        {
            told.values.push(on.target);
        }
        drop(told);
        self.inner.exchange(outputs, inputs);
    }
}

/// The runner of a board on a network card, which may stall before any cycle, or of a board over a chip, which may stall before
/// any exchange. It is unused on simulated slaves: they are a part of the runner's process, and stand still with it.
#[derive(Clone)]
pub struct Runner(Arc<Mutex<RunnerInside>>);

struct RunnerInside {
    dice: Dice,
    rarely: Option<u64>,
    stood: u64,
    chip: Option<Arc<Mutex<Trouble>>>,
}

impl Runner {
    fn new(dice: Dice, chip: Option<Arc<Mutex<Trouble>>>) -> Self {
        Self(Arc::new(Mutex::new(RunnerInside { dice, rarely: None, stood: 0, chip })))
    }

    /// Makes it stall soon.
    pub fn stand_still_soon(&self) {
        let mut inside = self.inside();
        inside.rarely = Some(20);
        let most = inside.dice.pick(&[20, 200, 1200, 5000]);
        let late_ns = inside.dice.below(most) * MS;
        if let Some(chip) = &inside.chip {
            chip.lock().expect("no panic").late_ns = late_ns;
        }
    }

    fn inside(&self) -> MutexGuard<'_, RunnerInside> {
        self.0.lock().expect("no panic")
    }

    /// Makes it stall before one of that many cycles; `None`: before none.
    pub fn stand_still(&self, rarely: Option<u64>) {
        self.inside().rarely = rarely;
    }

    pub fn stood(&self) -> u64 {
        self.inside().stood
    }

    /// The same for a board over a chip.
    pub fn stood_over_chip(&self) -> u64 {
        let inside = self.inside();
        if inside.chip.is_some() { inside.stood } else { 0 }
    }

    fn stands(&self) -> Option<Ns> {
        let mut inside = self.inside();
        let rarely = inside.rarely?;
        if inside.stood >= STALLS || !inside.dice.one_in(rarely) {
            return None;
        }
        inside.stood += 1;
        let most = inside.dice.pick(&[20, 200, 1200, 5000]);
        Some(inside.dice.below(most) * MS)
    }
}

/// The wires to slave controllers, whose clock goes on while the runner stalls.
#[derive(Clone)]
struct Shared(Arc<Mutex<ChainWires>>);

impl Shared {
    fn wires(&self) -> MutexGuard<'_, ChainWires> {
        self.0.lock().expect("no panic")
    }
}

impl Wire for Shared {
    fn send(&mut self, frame: &[u8]) -> Result<(), WireDown> {
        Wire::send(&mut *self.wires(), frame)
    }

    fn receive(&mut self, buffer: &mut FrameBuffer) -> Option<usize> {
        Wire::receive(&mut *self.wires(), buffer)
    }
}

impl NicWires for Shared {
    fn now(&self) -> Ns {
        NicWires::now(&*self.wires())
    }

    fn wait(&mut self, until: Ns) {
        NicWires::wait(&mut *self.wires(), until);
    }

    fn is_real_time(&self) -> bool {
        false
    }
}

/// A bus whose runner stalls before some cycles, and skips those that it has missed.
struct Late {
    bus: NicBus<Shared>,
    wires: Shared,
    runner: Runner,
    cycle_ns: Ns,
}

impl Fieldbus for Late {
    hand_on!(bus: pacing, start, start_sdo, poll_job, poll_sdo, cancel_job, cancel_sdo, room, clear_ahead, poll_clear, push);

    fn poll(&mut self, now: Ns, inputs: &mut Inputs) -> Option<CycleDone> {
        if let Some(stood) = self.runner.stands() {
            let left_out = stood.next_multiple_of(self.cycle_ns);
            let until = self.wires.now() + left_out;
            while self.wires.now() < until {
                self.wires.wait(until);
            }
            self.bus.leave_out(left_out);
        }
        self.bus.poll(now, inputs)
    }

    fn leave_out(&mut self, left_out_ns: Ns) {
        self.bus.leave_out(left_out_ns);
    }
}

/// A bus to drives.
pub struct Net {
    pub bus: Box<dyn Fieldbus>,
    pub network: SimHandle,
    /// The commands of each drive.
    pub told: Vec<Told>,
    pub cycle_us: u32,
    pub runner: Runner,
}

/// A bus to that many drives.
pub fn net(seed: u64, count: usize, dice: &mut Dice) -> Net {
    let told: Vec<Told> = (0..count).map(|_| Told::default()).collect();
    let drive = |told: &Told| {
        let (inner, images) = (Drive::new(DriveConfig::default()), Images::default());
        Box::new(Noting { inner, images, told: Arc::clone(told) }) as Box<dyn Slave>
    };
    let slaves: Vec<Box<dyn Slave>> = told.iter().map(drive).collect();
    let cycle_us = dice.pick(&[500, 1000, 1000, 2000]);
    let of_runner = Dice(dice.roll());
    match dice.below(3) {
        0 => {
            let bus = SimBus::new(slaves).with_timing(SWIFT);
            let (network, runner) = (bus.handle(), Runner::new(of_runner, None));
            Net { bus: Box::new(bus), network, told, cycle_us, runner }
        }
        1 => {
            let network = SimHandle::default();
            let wires = ChainWires::new(slaves, network.clone()).expect("they have an EEPROM");
            let wires = Shared(Arc::new(Mutex::new(wires)));
            let bus = NicBus::new(wires.clone(), Settings::default());
            let runner = Runner::new(of_runner, None);
            let bus = Box::new(Late { bus, wires, runner: runner.clone(), cycle_ns: Ns::from(cycle_us) * 1000 });
            Net { bus, network, told, cycle_us, runner }
        }
        _ => {
            let how = How::random(seed);
            let network = SimHandle::default();
            let (bus, trouble) = how.bus(seed, slaves, network.clone());
            let runner = Runner::new(of_runner, Some(Arc::clone(&trouble)));
            let stalling = runner.clone();
            trouble.lock().expect("no panic").stalls = Some(Box::new(move || stalling.stands()));
            Net { bus, network, told, cycle_us: how.cycle_us, runner }
        }
    }
}

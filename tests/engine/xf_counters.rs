//! Wrong working counters behind an ECM-XF, which counts them, but reports neither the cycles nor the slave.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

use ecmsk::cia402::{Controlword, Mode};
use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope};
use ecmsk::engine::{EngineConfig, StateFailure};
use ecmsk::ethercat::SlaveSet;
use ecmsk::fieldbus::xf::{XfBus, XfBusOptions};
use ecmsk::fieldbus::{AlState, Ns};
use ecmsk::sk::{DriveSync, MasterState, Motion, SlaveCommand, StateByte};
use ecmsk::slave::Slave;
use ecmsk::slave::handle::SimHandle;
use ecmsk::xf::chip::{Chip, EnterError, ImageRanges, ImmediateNetwork, Profile, SlaveIdentity, SlaveModels};
use ecmsk::xf::host::HostConfig;
use support::chip_line::ChipLine;

use crate::host::Host;
use crate::probe::drives;
use crate::puppet::{Puppet, SWITCHED_ON};

/// Slaves, one of which does not send its inputs in cycles, though it answers otherwise.
struct Lacking {
    slaves: SlaveModels,
    /// Which one, from 1; 0: all send them.
    mute: Arc<AtomicU8>,
}

impl ImmediateNetwork for Lacking {
    fn has_link(&self) -> bool {
        ImmediateNetwork::has_link(&self.slaves)
    }

    fn scan(&mut self) -> u8 {
        self.slaves.scan()
    }

    fn identity(&self, slave: u8) -> Option<&SlaveIdentity> {
        ImmediateNetwork::identity(&self.slaves, slave)
    }

    fn has_dc(&self, slave: u8) -> bool {
        ImmediateNetwork::has_dc(&self.slaves, slave)
    }

    fn state(&self, slave: u8) -> Option<AlState> {
        ImmediateNetwork::state(&self.slaves, slave)
    }

    fn enter(&mut self, slave: u8, state: AlState) -> Result<(), EnterError> {
        self.slaves.enter(slave, state)
    }

    fn set_sync_managers(&mut self, slave: u8, outputs: u16, inputs: u16) {
        self.slaves.set_sync_managers(slave, outputs, inputs);
    }

    fn set_sync_cycle(&mut self, slave: u8, cycle_ns: Option<Ns>) {
        self.slaves.set_sync_cycle(slave, cycle_ns);
    }

    fn read(
        &mut self,
        slave: u8,
        object: ObjectAddress,
        scope: SdoScope,
        value: &mut [u8],
    ) -> Result<usize, AbortCode> {
        self.slaves.read(slave, object, scope, value)
    }

    fn write(&mut self, slave: u8, object: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), AbortCode> {
        self.slaves.write(slave, object, scope, value)
    }

    fn exchange(&mut self, places: &[ImageRanges], outputs: &[u8], inputs: &mut [u8], lrw: bool) -> u16 {
        let counter = ImmediateNetwork::exchange(&mut self.slaves, places, outputs, inputs, lrw);
        let mute = self.mute.load(Ordering::Relaxed);
        let Some(place) = usize::from(mute).checked_sub(1).and_then(|n| places.get(n)) else { return counter };
        if place.commanded < AlState::SafeOp {
            return counter;
        }
        // These bytes are not from the slave.
        inputs[place.inputs()].fill(0x7D);
        let [low, high] = SWITCHED_ON.to_le_bytes();
        inputs[place.inputs()][..2].copy_from_slice(&[low, high]);
        counter - 1
    }

    fn pass(&mut self, dt_ns: Ns) {
        ImmediateNetwork::pass(&mut self.slaves, dt_ns);
    }
}

/// A board over a chip with these slaves, which are drives in that mode, in OP.
fn in_op(slaves: Vec<Box<dyn Slave>>, mode: Mode) -> (Host, Arc<AtomicU8>, SimHandle) {
    let (network, mute, count) = (SimHandle::default(), Arc::<AtomicU8>::default(), slaves.len());
    let slaves = Lacking { slaves: SlaveModels::new(slaves).reached_by(network.clone()), mute: Arc::clone(&mute) };
    let config = HostConfig { size: Some(Profile::NEW.size), ..HostConfig::DEFAULT };
    let line = ChipLine::new(Chip::new(Profile::NEW, slaves));
    let options = XfBusOptions { clock_hz: Some(24_000_000), ..XfBusOptions::DEFAULT };
    let mut host = Host::new(EngineConfig::default(), XfBus::new(line, config, options));
    host.declare_drives(count);
    for slave in 1..=count {
        host.slave(slave, SlaveCommand::DriveMode { mode, sync: DriveSync::DcSync });
    }
    host.go(MasterState::Op).drained();
    (host, mute, network)
}

/// The working counter of each cycle stays too low, and no slave is lost: the chip does not report whose inputs are
/// missing. All slaves are lost as soon as their states have shown that it is no lost slave, 20 cycles later at the
/// earliest, and stand.
#[test]
fn axes_in_csv_whose_inputs_never_arrive_are_stopped() {
    let (mut host, mute, network) = in_op(drives(2), Mode::Csv);
    host.servo_on(1).servo_on(2);
    host.build(|frame, size| {
        (1..=2).for_each(|slave| frame.put_slave(size, slave, &SlaveCommand::Csv(Motion::to(20_000)).into()));
    });
    host.drained().cycles(300);
    let before = host.drive(2).position;
    mute.store(2, Ordering::Relaxed);
    host.cycles(19);
    assert_eq!(host.state(), StateByte::reached(MasterState::Op));
    let mut more = 0;
    while !host.state().is_failed() {
        host.cycles(1);
        more += 1;
        assert!(more < 40, "{more} cycles more");
    }
    assert_eq!(host.state(), StateByte::failed(Some(MasterState::Op)));
    assert!(matches!(host.board.engine().state_failure(), Some(StateFailure::Stale { .. })));
    assert_eq!((host.board.engine().lost(), host.counters().inputs_stale), (SlaveSet::first(2), 2));
    assert!(host.counters().inputs_held >= 10, "{:?}", host.counters());
    assert!(host.drive(2).position.abs_diff(before) < 200, "{:?}", host.drive(2));
    host.cycles(400);
    for slave in [1, 2] {
        let at = network.shaft(slave, 0);
        host.cycles(50);
        assert_eq!(network.shaft(slave, 0), at, "slave {slave} stands");
    }

    mute.store(0, Ordering::Relaxed);
    host.go(MasterState::Op).servo_on(1).servo_on(2);
    host.cycles(50);
    assert_eq!(host.state(), StateByte::reached(MasterState::Op));
    assert_eq!(host.drive(2).position.abs_diff(network.shaft(2, 0).expect("a shaft") as i32), 0);
}

/// Slaves whose inputs are stale get a quick stop, on whose ramp they brake, and do not lose their torque.
#[test]
fn axes_whose_inputs_are_stale_are_sent_a_quick_stop() {
    let puppets = [Puppet::obedient(), Puppet::obedient()];
    let (mut host, mute, _) = in_op(puppets.iter().map(Puppet::boxed).collect(), Mode::Csv);
    host.servo_on(1).servo_on(2).cycles(20);
    mute.store(2, Ordering::Relaxed);
    while !host.state().is_failed() {
        host.cycles(1);
    }
    host.cycles(10);
    puppets.iter().for_each(Puppet::forget);
    host.cycles(50);
    for puppet in &puppets {
        let sent = puppet.strings().sent.clone();
        assert!(!sent.is_empty() && sent.iter().all(|out| out.controlword == Controlword::QUICK_STOP), "{sent:?}");
    }
}

/// While the working counter is wrong, its inputs enable no servo; when it is right again, the servo is enabled at its
/// position.
#[test]
fn a_counter_that_is_too_low_enables_no_servo() {
    let puppets = [Puppet::obedient(), Puppet::obedient()];
    puppets[1].stand(1234);
    let (mut host, mute, _) = in_op(puppets.iter().map(Puppet::boxed).collect(), Mode::Csp);
    host.cycles(10);
    mute.store(2, Ordering::Relaxed);
    host.cycles(10);
    puppets.iter().for_each(Puppet::forget);
    host.slave(2, SlaveCommand::ServoOn).cycles(100);
    let sent = puppets[1].strings().sent.clone();
    assert!(sent.iter().all(|out| [0, 2].contains(&out.controlword.0)), "{sent:?}");
    mute.store(0, Ordering::Relaxed);
    host.go(MasterState::Op);
    puppets[1].forget();
    host.servo_on(2);
    let sent = puppets[1].strings().sent.clone();
    assert!(sent.iter().all(|out| out.controlword.0 == 0 || out.target == 1234), "{sent:?}");
}

/// One cycle now and then with a wrong working counter is counted, and costs nothing else.
#[test]
fn one_wrong_counter_now_and_then_is_counted_and_nothing_else() {
    let puppets = [Puppet::obedient(), Puppet::obedient()];
    let (mut host, mute, _) = in_op(puppets.iter().map(Puppet::boxed).collect(), Mode::Csp);
    host.servo_on(1).servo_on(2).cycles(20);
    puppets.iter().for_each(Puppet::forget);
    for n in 1..=300 {
        mute.store(if n % 23 == 0 { 2 } else { 0 }, Ordering::Relaxed);
        host.build(|frame, size| {
            [1, 2].into_iter().for_each(|slave| frame.put_slave(size, slave, &SlaveCommand::Csp(Motion::to(n)).into()));
        });
        host.cycles(1);
    }
    mute.store(0, Ordering::Relaxed);
    host.drained().cycles(30);
    let counters = host.counters();
    assert!((10..=80).contains(&counters.inputs_held), "{counters:?}");
    assert_eq!((counters.inputs_stale, counters.for_lost, counters.full), (0, 0, 0), "{counters:?}");
    assert_eq!(host.state(), StateByte::reached(MasterState::Op));
    let all: Vec<i32> = (1..=300).collect();
    for puppet in &puppets {
        assert_eq!(puppet.targets_from(1), all);
    }
}

//! Pulse modules of two channels that are lost and brought back, and SET_FIFO with outputs that a bus had taken ahead.

use ecmsk::cia402::{Controlword, DriveState};
use ecmsk::engine::{EngineConfig, Reason};
use ecmsk::fieldbus::sim::{SimBus, SimHandle};
use ecmsk::sk::{
    AxisTarget, FifoAction, Frame, HspResponse, MasterCommand, MasterState, Motion, SlaveCommand, SlaveKind, SlotSize,
    StateByte,
};
use ecmsk::slave::{Channels, Hsp, HspConfig, Slave};

use crate::host::Host;
use crate::network_rig::buses;
use crate::puppet::Puppet;
use crate::rig::ahead;
use support::ahead_bus::{Ahead, AheadBus};

const FAILED_OP: u8 = 0x18;

/// A board with 16-byte slots in OP, its slaves pulse modules.
fn board(how: Option<Ahead>, slaves: Vec<Box<dyn Slave>>) -> (Host, SimHandle) {
    let config = EngineConfig { slot: SlotSize::Bytes16, ..EngineConfig::default() };
    let count = slaves.len();
    let bus = SimBus::new(slaves);
    let network = bus.handle();
    let mut host = match how {
        None => Host::new(config, bus),
        Some(how) => Host::new(config, AheadBus::new(bus, how)),
    };
    let kinds = std::array::from_fn(|k| if k < count { SlaveKind::Hsp } else { SlaveKind::None });
    host.master(MasterCommand::SetAxis { group: 0, kinds }).go(MasterState::Op).drained();
    (host, network)
}

fn motion(n: i32) -> SlaveCommand {
    let axis = |target: i32, outputs| AxisTarget { target, outputs };
    SlaveCommand::Csp(Motion { first: axis(n, n as u16), second: axis(-n, !n as u16) })
}

fn answer(host: &Host, slave: usize) -> HspResponse {
    HspResponse::decode(&host.slot(slave), host.size)
}

/// SK-4.61 SK-4.62 A module of two channels that loses its power stops with both axes and its outputs; brought back it
/// has two channels as before, and so has the one that stayed. Neither axis starts, and none moves by an old target:
/// SV_ON and CSP act on both again.
#[test]
fn a_module_of_two_channels_is_lost_and_comes_back() {
    for (how, lost) in buses().flat_map(|how| [(how, 1), (how, 2)]) {
        let config = HspConfig { positions: [1000, -1000], ..HspConfig::with(Channels::Two) };
        let modules = (0..2).map(|_| Box::new(Hsp::new(config.clone())) as Box<dyn Slave>).collect();
        let (mut host, network) = board(how, modules);
        let what = format!("{how:?}, {lost} is lost");
        let stays = 3 - lost;
        for slave in [1, 2] {
            host.servo_on(slave).cycles(30);
        }
        let send = |host: &mut Host, n: i32| {
            host.build(|frame, size| (1..=2).for_each(|slave| frame.put_slave(size, slave, &motion(n).into())));
        };
        send(&mut host, 1050);
        host.drained().cycles(30);
        let shafts = |slave: usize| [0, 1].map(|axis| network.shaft(slave as u8, axis).unwrap());
        assert_eq!([shafts(1), shafts(2)], [[1050, -1050]; 2], "{what}");

        network.lose(lost as u8);
        host.until("the loss", |host| host.state().0 == FAILED_OP);
        send(&mut host, 1060);
        host.drained().cycles(30);
        assert_eq!((shafts(lost), shafts(stays)), ([1050, -1050], [1060, -1060]), "{what}");
        assert_eq!(host.counters().for_lost, 1, "{what}");

        network.find(lost as u8);
        host.master(MasterCommand::SetState(MasterState::Op));
        host.until("OP", |host| host.state() == StateByte::reached(MasterState::Op)).cycles(50);
        for object in [0x6041, 0x6841] {
            let word = host.read_object(lost as u8, object, 0).unwrap() as u16;
            let state = ecmsk::cia402::Statusword(word).state();
            assert_eq!(state, Some(DriveState::SwitchOnDisabled), "{what}: {object:04X}");
        }
        send(&mut host, 1070);
        host.drained().cycles(30);
        assert_eq!((shafts(lost), shafts(stays)), ([1050, -1050], [1070, -1070]), "{what}: it is off");
        let seen = answer(&host, lost);
        assert_eq!((seen.first.position, seen.second.position), (1050, -1050), "{what}: two channels in its slot");
        assert_eq!((seen.first.inputs, seen.second.inputs), (1070, !1070), "{what}: outputs need no power stage");

        host.slave(lost, SlaveCommand::ServoOn).cycles(60);
        assert!(answer(&host, lost).statusword.is_enabled(), "{what}");
        assert_eq!(shafts(lost), [1050, -1050], "{what}: nothing jumps");
        send(&mut host, 1080);
        host.drained().cycles(30);
        assert_eq!([shafts(1), shafts(2)], [[1080, -1080]; 2], "{what}: both axes of both follow");
        assert_eq!(host.counters().rejected[Reason::WrongMode.kind()], 0, "{what}");
    }
}

/// SK-5.22 SET_FIFO 1 takes back digital outputs and targets that a bus had taken ahead, of both channels: the last
/// sent outputs stay, also when later frames move others.
#[test]
fn clear_takes_back_outputs_that_lie_ahead() {
    for how in ahead() {
        let puppets = [Puppet::obedient(), Puppet::obedient()].map(|puppet| puppet.with_channels(2));
        let (mut host, _) = board(Some(how), puppets.iter().map(Puppet::boxed).collect());
        for slave in [1, 2] {
            host.servo_on(slave).cycles(50);
        }
        for n in 1..=100 {
            let mut frame = Frame::new();
            frame.put_slave(host.size, 1, &motion(n).into());
            host.arrive(&frame);
        }
        host.cycles(20);
        let mut clear = Frame::new();
        clear.put_master(host.size, &MasterCommand::SetFifo(FifoAction::Clear));
        host.arrive(&clear);
        let [first, second] = puppets[0].last_two();
        assert!((15..=20).contains(&first.target), "{how:?}: {first:?}");
        assert_eq!((first.outputs, second.outputs), (first.target as u16, !first.target as u16), "{how:?}");
        puppets[0].forget();
        host.cycles(100);
        let sent = |channel: usize| {
            let mut sent: Vec<_> = puppets[0].sent_two()[channel].iter().map(|out| (out.target, out.outputs)).collect();
            sent.dedup();
            sent
        };
        // One more target may have been under way.
        let stays: Vec<i32> = sent(0).iter().map(|(target, _)| *target).collect();
        assert!(stays.iter().all(|n| (first.target..=first.target + 1).contains(n)), "{how:?}: {stays:?}");
        let newest = *stays.last().expect("outputs");
        assert_eq!(sent(0).last(), Some(&(newest, newest as u16)), "{how:?}");
        assert_eq!(sent(1).last(), Some(&(-newest, !newest as u16)), "{how:?}");
        puppets[0].forget();
        let mut other = Frame::new();
        other.put_slave(host.size, 2, &motion(-7).into());
        host.arrive(&other);
        host.cycles(50);
        assert_eq!(sent(0), [(newest, newest as u16)], "{how:?}: it stays as it is");
        assert_eq!(sent(1), [(-newest, !newest as u16)], "{how:?}: and so does the other channel");
        assert_eq!(
            puppets[1].last_two().map(|out| (out.target, out.controlword)),
            [(-7, Controlword::ENABLE_OPERATION), (7, Controlword::ENABLE_OPERATION)]
        );
    }
}

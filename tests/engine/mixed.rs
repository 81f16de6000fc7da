//! Networks of all kinds of slaves, up to the most that a board takes.

use ecmsk::cia402::Mode;
use ecmsk::engine::EngineConfig;
use ecmsk::sk::{
    AxisTarget, DriveSync, HspResponse, IoResponse, MasterCommand, MasterState, Motion, SlaveCommand, SlaveKind,
    SlotSize,
};

use allocation_counter::measure;

use crate::models::Model::{self, *};
use crate::models::{MODELS, declare};
use crate::probe::Bench;

const KINDS: [SlaveKind; 4] = [SlaveKind::Drive, SlaveKind::Io, SlaveKind::Hsp, SlaveKind::Step];

/// SK-1.1 SK-1.2 SK-1.3 A board drives 40 slaves (30 with 16-byte slots) of all kinds at once, each by its own slot and
/// with its own layout, by one frame a cycle, which allocates nothing.
#[test]
fn as_many_slaves_as_a_board_takes() {
    for size in SlotSize::ALL {
        let slaves = size.max_slaves();
        let models: Vec<Model> = MODELS.into_iter().cycle().take(slaves).collect();
        let config = EngineConfig { slot: size, ..EngineConfig::default() };
        let Bench { mut host, network, .. } = Bench::new(config, models.iter().map(|model| model.build()).collect());
        assert_eq!(host.board.engine().slaves_found(), slaves as u8);
        declare(&mut host, &models.iter().map(|model| model.kind()).collect::<Vec<_>>());
        host.go(MasterState::Op).drained();

        let axes = || (1..=slaves).filter(|slave| models[slave - 1] != Io);
        host.build(|frame, size| axes().for_each(|slave| frame.put_slave(size, slave, &SlaveCommand::ServoOn.into())));
        // The statusword is at the same place in every slot.
        host.until("all on", |host| axes().all(|slave| host.drive(slave).statusword.is_enabled())).cycles(50);

        let step = |slave: usize| slave as i32 * 5;
        let command = |slave: usize, n: i32| match models[slave - 1] {
            Io => SlaveCommand::IoWrite(slave as u16 * 100),
            _ => SlaveCommand::Csp(Motion {
                first: AxisTarget { target: n * step(slave), outputs: slave as u16 },
                second: AxisTarget { target: -n * step(slave), outputs: !(slave as u16) },
            }),
        };
        let counted = measure(|| {
            for n in 1..=400 {
                host.build(|frame, size| {
                    (1..=slaves)
                        .for_each(|slave| frame.put_slave(size, slave, &command(slave, n).with_index(slave as u8)));
                });
                host.cycle();
            }
            host.drained();
        });
        assert_eq!(counted.count_total, 0, "{size:?}");
        host.cycles(500);

        for slave in 1..=slaves {
            let (raw, way) = (host.slot(slave), 400 * step(slave));
            let what = format!("{size:?} slave {slave}, {:?}", models[slave - 1]);
            assert_eq!(usize::from(raw.index), slave, "{what}");
            let shaft = |axis| network.shaft(slave as u8, axis);
            match models[slave - 1] {
                Io => {
                    assert_eq!((raw.id, IoResponse::decode(&raw).bits), (0x14, slave as u16 * 100), "{what}");
                }
                Servo | Step => {
                    let near = if models[slave - 1] == Servo { 131 } else { 10 };
                    assert_eq!(raw.id, 0x15, "{what}");
                    assert!((host.drive(slave).position - way).abs() <= near, "{what}: {}", host.drive(slave).position);
                    assert_eq!(shaft(0), Some(host.drive(slave).position.into()), "{what}");
                }
                Hsp | Hsp2 => {
                    let two = models[slave - 1] == Hsp2 && size == SlotSize::Bytes16;
                    let HspResponse { head, first, second, .. } = HspResponse::decode(&raw, size);
                    assert_eq!((head.id, first.position, first.inputs), (0x15, way, slave as u16), "{what}");
                    let expected = if two { (-way, !(slave as u16)) } else { (0, 0) };
                    assert_eq!((second.position, second.inputs), expected, "{what}");
                    assert_eq!(shaft(0), Some(way.into()), "{what}");
                    assert_eq!(shaft(1).is_some(), models[slave - 1] == Hsp2, "{what}");
                }
            }
        }
        let counters = host.counters();
        assert_eq!((counters.rejected_total(), counters.discarded_before_enabled), (0, 0), "{size:?}");

        // All off again.
        host.build(|frame, size| axes().for_each(|slave| frame.put_slave(size, slave, &SlaveCommand::ServoOff.into())));
        host.until("all off", |host| axes().all(|slave| host.drive(slave).statusword.0 & 1 == 0));
    }
}

/// Different modes in one network: slaves that have CSV run in it beside those that do not. SK-7.35 SK-7.36 A kind
/// without process data for a mode does not prevent the others' modes.
#[test]
fn every_slave_has_its_mode() {
    let models = [Servo, Hsp, Step, Hsp2, Io, Servo];
    let config = EngineConfig { slot: SlotSize::Bytes16, ..EngineConfig::default() };
    let Bench { mut host, network, .. } = Bench::new(config, models.map(Model::build).into());
    declare(&mut host, &models.map(Model::kind));
    for (slave, mode) in [(1, Mode::Csv), (2, Mode::Csv), (4, Mode::Csp), (5, Mode::Cst), (6, Mode::Cst)] {
        host.slave(slave, SlaveCommand::DriveMode { mode, sync: DriveSync::DcSync });
    }
    host.go(MasterState::Op).drained();
    host.build(|frame, size| {
        [1, 2, 3, 4, 6].iter().for_each(|n| frame.put_slave(size, *n, &SlaveCommand::ServoOn.into()))
    });
    host.until("on", |host| [1, 2, 3, 4, 6].iter().all(|slave| host.drive(*slave).statusword.is_enabled()));
    host.build(|frame, size| {
        frame.put_slave(size, 1, &SlaveCommand::Csv(Motion::to(100_000)).into());
        frame.put_slave(size, 2, &SlaveCommand::Csv(Motion::to(-2000)).into());
        frame.put_slave(size, 3, &SlaveCommand::Csp(Motion::to(50)).into());
        frame.put_slave(size, 4, &SlaveCommand::Csp(Motion::to(77)).into());
        frame.put_slave(size, 5, &SlaveCommand::IoWrite(3).into());
        frame.put_slave(size, 6, &SlaveCommand::Cst(100).into());
    });
    host.drained().cycles(1000);
    assert_eq!(host.counters().rejected_total(), 0);
    let shaft = |slave| network.shaft(slave, 0).unwrap();
    assert!((95_000..105_000).contains(&shaft(1)) && shaft(6) > 1000, "{} {}", shaft(1), shaft(6));
    assert!((-2010..=-1990).contains(&shaft(2)) && (40..=60).contains(&shaft(3)), "{} {}", shaft(2), shaft(3));
    assert_eq!((shaft(4), network.shaft(4, 1)), (77, Some(0)));
}

/// SK-4.58 A slave that is declared as something whose objects it does not have fails PreOP to SafeOP, for every kind and
/// every wrong nibble, wherever it stands; with the right declaration the network starts. So do a drive and a stepper
/// that are declared as each other, which have the same process data in CSP.
#[test]
fn every_wrong_declaration_fails() {
    for model in MODELS {
        for (place, neighbours) in [(0, [Io, Servo]), (1, [Servo, Hsp2])] {
            let mut models = vec![neighbours[0], neighbours[1]];
            models.insert(place, model);
            let slaves = models.iter().map(|model| model.build()).collect();
            let Bench { mut host, .. } = Bench::new(EngineConfig::default(), slaves);
            let right: Vec<SlaveKind> = models.iter().map(|model| model.kind()).collect();
            let has = |kind| match model {
                // SK-7.57 They have the objects of a pulse module, too.
                Servo | Step => matches!(kind, SlaveKind::Drive | SlaveKind::Step | SlaveKind::Hsp),
                _ => kind == model.kind(),
            };
            for kind in KINDS.into_iter().filter(|kind| !has(*kind)) {
                let mut wrong = right.clone();
                wrong[place] = kind;
                declare(&mut host, &wrong);
                host.master(MasterCommand::SetState(MasterState::SafeOp));
                host.until("the failure", |host| host.state().0 == 0x12);
                assert_eq!(host.cycles(100).state().0, 0x12, "{model:?} declared {kind:?}");
            }
            for kind in KINDS.into_iter().filter(|kind| has(*kind)) {
                let mut declared = right.clone();
                declared[place] = kind;
                declare(&mut host, &declared);
                host.go(MasterState::Op).go(MasterState::PreOp);
            }
        }
    }
}

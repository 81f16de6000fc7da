//! Every command in every state for every kind of slave and slot, with right and wrong arguments, in both sizes of a slot
//! and with both firmwares: each is accepted, or counted once with its reason, and all other commands of the frame are
//! executed.

use ecmsk::cia402::Mode;
use ecmsk::coe::SdoSize;
use ecmsk::engine::{Counters, EngineConfig, Firmware, HomingPhase};
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::sk::{CommandId, DriveSync, MasterCommand, MasterState, RawSlot, SlaveCommand, SlaveKind, SlotSize};
use ecmsk::slave::Slave;

use crate::full_table::Place::{self, *};
use crate::full_table::{Outcome, PLACES, Sent, State, commands, outcome};
use crate::homer::{Homer, Script};
use crate::host::Host;
use crate::models::{Model, declare};
use support::swift::SWIFT;

/// The index of the tested commands, and the index of the other commands in the frame.
const INDEX: u8 = 0x5A;
const WITNESS_INDEX: u8 = 0xA6;

/// A board in that state with a slave at every place.
struct Table {
    host: Host,
    state: State,
    firmware: Firmware,
    /// A value that changes with every frame.
    bits: u8,
}

impl Table {
    fn new(size: SlotSize, firmware: Firmware, state: State) -> Self {
        let homer = Homer::new();
        homer.script(Script { takes: u32::MAX, ..Script::default() });
        let servo = || Model::Servo.build();
        let mut slaves: Vec<Box<dyn Slave>> = vec![servo(), servo(), servo(), servo(), Box::new(homer)];
        slaves.extend([Model::Step, Model::Hsp, Model::Hsp2, Model::Io].map(Model::build));
        slaves.extend([servo(), servo(), Model::Io.build(), Model::Io.build()]);
        let bus = SimBus::new(slaves).with_timing(SWIFT);
        let network = bus.handle();
        let config = EngineConfig { slot: size, firmware, state_timeout_ns: 100_000_000, ..EngineConfig::default() };
        let mut host = Host::new(config, bus);
        use SlaveKind::{Drive, None};
        declare(
            &mut host,
            &[
                [Drive; 5].as_slice(),
                &[SlaveKind::Step, SlaveKind::Hsp, SlaveKind::Hsp, SlaveKind::Io, None, Drive],
                &[SlaveKind::Io; 2],
            ]
            .concat(),
        );
        for (place, mode) in [(DriveCsv, Mode::Csv), (DriveCst, Mode::Cst)] {
            host.slave(place as usize, SlaveCommand::DriveMode { mode, sync: DriveSync::DcSync });
        }
        match state.code {
            1 => host.go(MasterState::Init),
            2 => host.go(MasterState::PreOp),
            4 => host.go(MasterState::SafeOp),
            _ => host.go(MasterState::Op).drained(),
        };
        if state.is_op() {
            for place in [Homable, Homing] {
                host.write_object(place as u8, 0x6060, 0, SdoSize::One, 6).expect("a drive takes it");
            }
            host.servo_on(Homing as usize).slave(Homing as usize, SlaveCommand::GoHome).cycles(5);
            assert_eq!(host.board.engine().homing_phase(Homing as u8), HomingPhase::Homing);
        }
        if state.failed {
            [Lost, LostIo].into_iter().for_each(|place| network.lose(place as u8));
            // Below SafeOP a loss is detected only by a request to the slave.
            let next = match state.code {
                1 => Some(MasterState::PreOp),
                2 => Some(MasterState::SafeOp),
                _ => Option::None,
            };
            next.map(|next| host.master(MasterCommand::SetState(next)).cycles(1));
            host.until("the failure", |host| host.state().0 == state.byte()).cycles(5);
        }
        host.idle().cycles(3);
        assert_eq!(host.state().0, state.byte(), "{size:?} {state:?}");
        Self { host, state, firmware, bits: 0 }
    }

    /// Sends a command in a slot, with others in the same frame, and checks all results. Returns whether the board is
    /// unchanged.
    fn send(&mut self, sent: &Sent, place: Place) -> bool {
        let Self { host, state, firmware, bits } = self;
        let (size, state) = (host.size, *state);
        let slot = place.slot(size);
        let command = RawSlot { index: if place.is_slave() { INDEX } else { 0 }, ..sent.slot };
        let id = command.id;
        let what = format!("{size:?} {firmware:?} {:02X}: {command:X?} in {place:?}", state.byte());
        let expected = outcome(sent, place, state, *firmware);
        // In OP another command comes first, so that the answer's id changes.
        let shows = match place {
            _ if place.is_io() => 0x13,
            _ if place.is_slave() => 0x10,
            _ => 0,
        };
        host.raw(
            if state.is_op() { slot } else { 0 },
            RawSlot { id: if state.is_op() { shows } else { 0 }, ..RawSlot::ZERO },
        );
        host.cycle();
        let (before, counted, mark, boots) =
            (host.slot(slot), host.counters(), host.mark(), host.board.engine().boots());

        // Beside it: the chip's outputs, and a command for another slave where there is one in this state.
        *bits = (*bits + 1) & 0x3F;
        let beside = match state.code {
            1 | 2 => Some(RawSlot { id: 0x06, index: WITNESS_INDEX, data1: 8, data2: 1, ..RawSlot::ZERO }),
            8 => Some(RawSlot { id: 0x14, index: WITNESS_INDEX, data1: (*bits).into(), ..RawSlot::ZERO }),
            _ => None,
        };
        host.build(|frame, size| {
            frame.put_master(size, &MasterCommand::LocalWrite(*bits));
            if let Some(beside) = &beside {
                frame.put(size, Witness as usize, beside);
            }
            frame.put(size, slot, &command);
        });
        host.cycle();

        let booted = host.board.engine().boots() > boots;
        assert_eq!(booted, id == 0xBB && expected == Outcome::Accepted, "{what}");
        let mut counters = counted;
        let mut rejections = vec![];
        match expected {
            Outcome::Accepted => {}
            Outcome::Discarded => counters.discarded_before_enabled += 1,
            Outcome::IgnoredHoming => counters.ignored_homing += 1,
            Outcome::ForLost => counters.for_lost += 1,
            Outcome::Rejected(reason) => {
                counters.rejected[reason.kind()] += 1;
                rejections.push((slot as u8, CommandId::from_code(id), reason));
            }
        }
        assert_eq!(host.rejections(mark), rejections, "{what}");
        if booted {
            return false;
        }
        counters.frames += 1;
        assert_eq!(told(&host.counters()), told(&counters), "{what}");
        assert_eq!(host.state().0, state.byte(), "{what}");

        // The other commands in the frame were executed.
        if place != Master {
            assert_eq!(host.board.engine().local_outputs(), *bits, "{what}");
        }
        if let Some(beside) = beside {
            let shown = host.slot(Witness as usize);
            assert_eq!(shown.id, beside.id, "{what}");
            if state.is_op() {
                assert_eq!(shown.data1, u32::from(*bits), "{what}");
            }
            if *firmware == Firmware::V17 {
                assert_eq!(shown.index, WITNESS_INDEX, "{what}");
            }
        }
        self.look_at_answer(place, &command, &before, expected, &what)
    }

    fn look_at_answer(
        &mut self,
        place: Place,
        command: &RawSlot,
        before: &RawSlot,
        expected: Outcome,
        what: &str,
    ) -> bool {
        let Self { host, state, firmware, .. } = self;
        let slot = place.slot(host.size);
        let shown = host.slot(slot);
        let id = command.id;
        let lost = place.is_lost(*state) && state.is_op();
        match (place, expected) {
            (Sdo, Outcome::Accepted) if id != 0 => {
                host.cycles(30);
                let answer = RawSlot { parm: 1, data2: host.slot(slot).data2, id, ..*command };
                assert_eq!(host.slot(slot), answer, "{what}");
                assert!(id == 0x07 || answer.data2 == command.data2, "{what}");
            }
            (Sdo, _) => assert_eq!(shown, *before, "{what}: the answer stays"),
            (Master, _) if state.is_op() => assert_eq!(shown.id, 0xBF, "{what}"),
            (Master, Outcome::Accepted) => assert_eq!(shown.id, id, "{what}"),
            (Master, _) => assert_eq!((shown.id, shown.data1), (before.id, before.data1), "{what}: the answer stays"),
            // The slot of a lost slave does not change.
            _ if lost => assert_eq!(shown, *before, "{what}: the answer stays"),
            // SK-3.32
            (_, Outcome::Accepted) if id == 0 && !state.is_op() => {
                assert_eq!(shown, RawSlot { id, ..*before }, "{what}");
            }
            (_, Outcome::Accepted | Outcome::Discarded) => {
                assert_eq!(shown.id, id, "{what}");
                if *firmware == Firmware::V17 {
                    assert_eq!(shown.index, INDEX, "{what}");
                }
            }
            (_, Outcome::IgnoredHoming) => {
                assert_eq!(host.board.engine().homing_phase(Homing as u8), HomingPhase::Homing, "{what}");
                // SK-7.55 SV_ON is answered.
                let index = if id == 0x11 && *firmware == Firmware::V17 { INDEX } else { before.index };
                let executed = (if id == 0x11 { id } else { before.id }, index);
                assert_eq!((shown.id, shown.index), executed, "{what}: the command executed last");
            }
            (_, Outcome::Rejected(_)) if state.is_op() => assert_eq!(shown.id, 0, "{what}"),
            _ => assert_eq!(shown, *before, "{what}: the answer stays"),
        }
        // These commands end the homing, bring lost slaves back, switch a drive on, or change the conditions of SDOs
        // and targets.
        let lasting = match id {
            0x01 | 0x11 | 0x12 | 0x19 => true,
            0x06 => matches!(place, DriveCsv | DriveCst),
            _ => false,
        };
        !(lasting && expected == Outcome::Accepted)
    }
}

/// Counters that the commands of a table change, without those of the network's time.
fn told(counters: &Counters) -> Counters {
    Counters { reports: 0, executed: 0, idle_cycles: 0, ..*counters }
}

fn go_through(state: State) {
    for size in SlotSize::ALL {
        for firmware in [Firmware::V17, Firmware::V15] {
            let mut table = Table::new(size, firmware, state);
            for place in PLACES {
                for sent in commands(size, state) {
                    if !table.send(&sent, place) {
                        table = Table::new(size, firmware, state);
                    }
                }
            }
        }
    }
}

/// SK-4.1 SK-4.35 SK-4.36 SK-4.39 SK-4.44 The full table in Init, and in Init after a failed change (SK-2.9).
#[test]
fn the_full_table_in_init() {
    go_through(State { code: 1, failed: false });
    go_through(State { code: 1, failed: true });
}

/// SK-4.1 SK-4.35 SK-4.36 SK-4.39 SK-4.41 SK-4.44 In PreOP, and with 0x10.
#[test]
fn the_full_table_in_preop() {
    go_through(State { code: 2, failed: false });
    go_through(State { code: 2, failed: true });
}

/// SK-4.1 SK-4.35 SK-4.36 SK-4.39 SK-4.44 In SafeOP, and with 0x10.
#[test]
fn the_full_table_in_safeop() {
    go_through(State { code: 4, failed: false });
    go_through(State { code: 4, failed: true });
}

/// SK-4.1 SK-4.35 SK-4.36 SK-4.37 SK-4.38 SK-4.39 SK-4.44 SK-7.27 SK-3.30 In OP.
#[test]
fn the_full_table_in_op() {
    go_through(State { code: 8, failed: false });
}

/// SK-4.1 SK-4.35 SK-4.36 SK-4.37 SK-4.38 SK-4.39 SK-4.44 SK-4.61 In OP with a drive and an IO slave lost.
#[test]
fn the_full_table_in_op_with_a_slave_lost() {
    go_through(State { code: 8, failed: true });
}

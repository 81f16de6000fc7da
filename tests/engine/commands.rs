//! Every command id in every state and every kind of slot, against the table of the guide.

use std::ops::RangeInclusive;

use ecmsk::engine::{EngineConfig, Reason};
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::sk::{CommandId, MasterState, RawSlot, SlaveKind, SlotSize};
use ecmsk::slave::Slave;

use support::guide::{self, Column};

use crate::host::Host;
use crate::probe::{AnySlave, drives};

/// A kind of slot; the tests' board has one of each. Its slaves are a drive, an IO slave, a pulse module, a stepper,
/// and a slave declared as none; there are no others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Place {
    Master,
    Drive,
    Io,
    Hsp,
    Step,
    DeclaredNone,
    Empty,
    Sdo,
}
use Place::*;

const PLACES: [Place; 8] = [Master, Drive, Io, Hsp, Step, DeclaredNone, Empty, Sdo];
const KINDS: [SlaveKind; 6] =
    [SlaveKind::Drive, SlaveKind::Io, SlaveKind::Hsp, SlaveKind::Step, SlaveKind::None, SlaveKind::Drive];

impl Place {
    fn slot(self, size: SlotSize) -> usize {
        match self {
            Master => 0,
            Drive => 1,
            Io => 2,
            Hsp => 3,
            Step => 4,
            DeclaredNone => 5,
            Empty => 6,
            Sdo => size.sdo_slot(),
        }
    }

    fn is_slave(self) -> bool {
        !matches!(self, Master | Sdo)
    }

    /// The declared kind of a slave; `None` if it is declared as none, and outside slaves' slots.
    fn kind(self) -> Option<SlaveKind> {
        let kind = KINDS.get(self.slot(SlotSize::Bytes12).checked_sub(1)?).copied();
        kind.filter(|kind| self != Empty && *kind != SlaveKind::None)
    }
}

const STATES: [(MasterState, char); 4] =
    [(MasterState::Init, 'i'), (MasterState::PreOp, 'p'), (MasterState::SafeOp, 's'), (MasterState::Op, 'o')];

/// The possible reasons for a rejection: any of those that hold. Empty: the command is accepted.
fn reasons(id: u8, place: Place, state: char) -> Vec<Reason> {
    let Some((column, states)) = guide::row(id) else { return vec![Reason::UnknownId] };
    let mut reasons = Vec::new();
    if !states.contains(state) {
        reasons.push(Reason::WrongState);
    }
    let why_not = match column {
        Column::Any => None,
        Column::Board => (place != Master).then_some(Reason::WrongSlot),
        Column::Sdo => (place != Sdo).then_some(Reason::WrongSlot),
        Column::AnySlave => (!place.is_slave()).then_some(Reason::WrongSlot),
        Column::Kinds(_) if matches!(place, DeclaredNone | Empty) => Some(Reason::NoSlave),
        Column::Kinds(kinds) => (!place.kind().is_some_and(|kind| kinds.contains(&kind))).then_some(Reason::WrongSlot),
    };
    reasons.extend(why_not);
    // All slaves are in CSP.
    if reasons.is_empty() && matches!(place, Drive | Hsp) && matches!(id, 0x16 | 0x17) {
        reasons.push(Reason::WrongMode);
    }
    if reasons.is_empty() && matches!(place, Drive | Hsp | Step) && id == 0x18 {
        reasons.push(Reason::NotInHomingMode);
    }
    reasons
}

/// The command with arguments that every guide allows and that change nothing.
fn valid(id: u8, state: MasterState) -> RawSlot {
    let slot = RawSlot { id, ..RawSlot::ZERO };
    match id {
        0x01 => RawSlot { data1: state.code().into(), ..slot },
        // Slaves 33 to 40.
        0x02 => RawSlot { parm: 4, data1: 0x1111_1111, ..slot },
        0x03 => RawSlot { data1: 1000, data2: 0xFFFF, ..slot },
        0x04 => RawSlot { data1: 0x10, ..slot },
        0x05 => RawSlot { parm: 2, data1: 160, ..slot },
        0x06 => RawSlot { data1: 8, data2: 1, ..slot },
        0x07 => RawSlot { parm: 1, data1: 0x1000_0000, ..slot },
        0x08 => RawSlot { parm: 0x0401, data1: 0x6065_0000, data2: 30_000, ..slot },
        _ => slot,
    }
}

fn board(slot: SlotSize) -> Host {
    let mut slaves = drives(1);
    slaves.extend((0..4).map(|_| Box::<AnySlave>::default() as Box<dyn Slave>));
    let mut host = Host::new(EngineConfig { slot, ..EngineConfig::default() }, SimBus::new(slaves));
    let nibbles = KINDS.iter().rev().fold(0, |word, kind| word << 4 | u32::from(kind.nibble()));
    host.raw(0, RawSlot { id: 0x02, data1: nibbles, ..RawSlot::ZERO });
    host
}

/// The result of one command.
struct Outcome {
    rejections: Vec<(u8, CommandId, Reason)>,
    counted: u64,
    booted: bool,
}

fn send(host: &mut Host, slot: usize, command: RawSlot) -> Outcome {
    let (mark, counted, boots) = (host.mark(), host.counters().rejected_total(), host.board.engine().boots());
    host.raw(slot, command).cycle();
    let engine = host.board.engine();
    Outcome {
        rejections: host.rejections(mark),
        counted: engine.counters().rejected_total() - counted,
        booted: engine.boots() > boots,
    }
}

/// Sends ids in every place, in one state, and compares.
fn compare(host: &mut Host, (state, letter): (MasterState, char), ids: RangeInclusive<u8>) {
    let size = host.size;
    for id in ids.filter(|id| *id != 0xBB) {
        for place in PLACES {
            let slot = place.slot(size);
            let what = format!("{size:?} {state}: 0x{id:02X} in {place:?}");
            let expected = reasons(id, place, letter);
            // The answer before the command.
            host.idle().cycle();
            let before = host.slot(slot);
            let Outcome { rejections, counted, booted } = send(host, slot, valid(id, state));
            assert!(!booted && host.state().0 == state.code(), "{what}");
            if expected.is_empty() {
                assert_eq!((rejections, counted), (vec![], 0), "{what}: accepted");
                if place == Sdo && id != 0 {
                    host.until(&what, |host| host.slot(slot).id == id);
                    // Another answer in the SDO slot, so that the next one is seen, too.
                    host.read_object(1, 0x1018, 1).unwrap();
                } else if place.is_slave() || place == Master && letter != 'o' {
                    assert_eq!(host.slot(slot).id, id, "{what}: the answer shows it");
                }
            } else {
                let [(at, command, reason)] = rejections[..] else { panic!("{what}: {rejections:?}") };
                assert_eq!((usize::from(at), command, counted), (slot, CommandId::from_code(id), 1), "{what}");
                assert!(expected.contains(&reason), "{what}: {reason:?}, not {expected:?}");
                if letter != 'o' || place == Sdo {
                    assert_eq!(
                        comparable(place, host.slot(slot)),
                        comparable(place, before),
                        "{what}: the answer stays"
                    );
                } else if place.is_slave() {
                    assert_eq!(host.slot(slot).id, 0, "{what}");
                } else {
                    assert_eq!((host.slot(0).id, host.slot(0).data1), (0xBF, before.data1), "{what}");
                }
            }
        }
    }
}

/// Slot 0 without the CRC.
fn comparable(place: Place, slot: RawSlot) -> RawSlot {
    if place == Master { RawSlot { parm: slot.parm & 0xFF, ..slot } } else { slot }
}

fn compare_state(state: (MasterState, char)) {
    for size in SlotSize::ALL {
        let mut host = board(size);
        host.go(state.0);
        compare(&mut host, state, 0..=255);
        // SW_RESET comes last: it acts in slot 0 only, and there in every state.
        for place in PLACES.into_iter().rev() {
            let Outcome { rejections, booted, .. } = send(&mut host, place.slot(size), valid(0xBB, state.0));
            let accepted = reasons(0xBB, place, state.1).is_empty();
            assert_eq!((rejections.is_empty(), booted), (accepted, accepted), "{size:?} {place:?}");
        }
    }
}

/// SK-4.1 SK-4.35 SK-4.36 SK-4.39 Every id in every kind of slot, in Init: the table of UG17 1.8.
#[test]
fn commands_in_init() {
    compare_state(STATES[0]);
}

/// SK-4.1 SK-4.35 SK-4.36 SK-4.39 SK-4.41 In PreOP.
#[test]
fn commands_in_preop() {
    compare_state(STATES[1]);
}

/// SK-4.1 SK-4.35 SK-4.36 SK-4.39 In SafeOP.
#[test]
fn commands_in_safeop() {
    compare_state(STATES[2]);
}

/// SK-4.1 SK-4.35 SK-4.36 SK-4.37 SK-4.38 SK-4.39 In OP.
#[test]
fn commands_in_op() {
    compare_state(STATES[3]);
}

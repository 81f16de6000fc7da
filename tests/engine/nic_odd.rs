//! A board over the software master on a network card, with slaves written independently of the models, each odd in its
//! own way.

use std::collections::BTreeSet;

use ecmsk::engine::{Board, EngineConfig};
use ecmsk::fieldbus::nic::{NicBus, NicWires};
use ecmsk::master::{FrameBuffer, Settings, Wire, WireDown};
use ecmsk::sk::{MasterCommand, MasterState, SlaveCommand, SlaveKind, StateByte};
use support::odd_line::{Device, OddLine, OddSlave, coupler, drive, drive_objects, drive_of, number, sii, terminal};

use crate::host::{BOOT_LIMIT, Host};

/// The time between two checks whether a starting board has failed, ns.
const SLICE: u64 = 1_000_000_000;

/// A board with these slaves, the last of which is a drive and declared as one.
fn board(slaves: Vec<OddSlave>) -> (Host, OddLine, usize) {
    let last = slaves.len();
    let line = OddLine::new(slaves);
    (board_on(line.clone(), last), line, last)
}

fn board_on(line: OddLine, drive: usize) -> Host {
    let mut host = Host::new(EngineConfig::default(), NicBus::new(line, Settings::default()));
    let mut kinds = [SlaveKind::None; 8];
    kinds[drive - 1] = SlaveKind::Drive;
    host.master(MasterCommand::SetAxis { group: 0, kinds });
    host
}

/// The drive at the end of the line comes to OP, is switched on, and gets every target.
#[track_caller]
fn moves(slaves: Vec<OddSlave>) -> OddLine {
    let (mut host, line, last) = board(slaves);
    host.go(MasterState::Op).drained().servo_on(last);
    for n in 1..=50 {
        host.csp(last, n * 10).cycles(1);
    }
    host.drained().cycles(30);
    assert_eq!(line.slave(last, |slave| slave.position()), 500);
    assert_eq!(host.drive(last).position, 500);
    line
}

/// The board's message when the way to OP has failed.
#[track_caller]
fn failure(slaves: Vec<OddSlave>) -> String {
    let line = OddLine::new(slaves);
    let bus = NicBus::new(line.clone(), Settings::default());
    let mut below_preop = Board::new(EngineConfig::default(), Box::new(bus));
    while !below_preop.boot(SLICE) {
        if below_preop.engine().state().is_failed() {
            return below_preop.engine().state_failure().expect("there is one").to_string();
        }
        assert!(below_preop.now() < BOOT_LIMIT, "neither PreOP nor a failure");
    }
    drop(below_preop);
    let mut host = board_on(line, 1);
    host.master(MasterCommand::SetState(MasterState::Op));
    host.until("the failure", |host| host.board.engine().state_failure().is_some());
    host.board.engine().state_failure().expect("there is one").to_string()
}

/// A drive that leaves OP by itself is named with its AL status code. The message blames neither the cable nor SET_AXIS.
#[test]
fn a_drive_that_leaves_op_by_itself() {
    let (mut host, line, last) = board(vec![coupler(), drive()]);
    host.go(MasterState::Op).drained();
    line.slave(last, |slave| slave.fall(4, 0x001D));
    host.until("the failure", |host| host.board.engine().state_failure().is_some());
    let said = host.board.engine().state_failure().expect("there is one").to_string();
    assert!(said.contains("slave 2 has left its state by itself") && said.contains("0x001D"), "{said}");
    assert!(!said.contains("cable") && !said.contains("SET_AXIS"), "{said}");
}

/// MASTER-3.7 NIC-2.1 A coupler whose AL status copies AL control, bit 4 too, stands in front of a drive, and a terminal of that kind behind
/// it; terminals in front are used as IO modules.
#[test]
fn a_coupler_that_copies_the_acknowledgement_blocks_nobody() {
    moves(vec![coupler(), drive()]);
    moves(vec![coupler(), terminal(), coupler(), drive()]);
    let line = OddLine::new([coupler(), terminal()]);
    let mut host = Host::new(EngineConfig::default(), NicBus::new(line.clone(), Settings::default()));
    let mut kinds = [SlaveKind::None; 8];
    kinds[1] = SlaveKind::Io;
    host.master(MasterCommand::SetAxis { group: 0, kinds });
    host.go(MasterState::Op).drained();
    host.slave(2, SlaveCommand::IoWrite(0x5)).drained().cycles(30);
    assert_eq!(line.slave(2, |slave| slave.memory[0x1000]), 0x5);
    assert_eq!(host.state(), StateByte::reached(MasterState::Op));
}

/// MASTER-2.9 NIC-2.1 A drive whose EEPROM gives its sync managers no type, or has none of them, or those of the
/// mailbox alone, is used: the control bytes or object 0x1C00 give the types.
#[test]
fn sync_managers_that_the_eeprom_does_not_name() {
    let untyped = sii::MANAGERS.map(|(start, len, control, enable, _)| (start, len, control, enable, 0));
    for managers in [Some(&untyped[..]), None, Some(&[][..]), Some(&sii::MANAGERS[..2]), Some(&untyped[..2])] {
        moves(vec![drive_of(sii::drive(managers))]);
    }
}

/// A drive without sync managers in its EEPROM, whose object 0x1C00 lists these.
fn saying(uses: &[u8], managers: Option<&[sii::Manager]>) -> OddSlave {
    drive_of(sii::drive(managers)).with(|slave| {
        let coe = slave.mailbox.coe.as_mut().expect("objects");
        (0..=4).for_each(|sub| drop(coe.objects.remove(&(0x1C00, sub))));
        coe.objects.insert((0x1C00, 0), vec![uses.len() as u8]);
        for (sub, one) in (1..).zip(uses) {
            coe.objects.insert((0x1C00, sub), vec![*one]);
        }
        let [outputs, inputs] = coe.process_managers();
        for (manager, pdo) in [(outputs, 0x1600), (inputs, 0x1A00)] {
            let index = 0x1C10 + manager as u16;
            coe.objects.insert((index, 0), vec![1]);
            coe.objects.insert((index, 1), number(2, pdo));
            coe.objects.insert((index, 2), number(2, 0));
        }
        for index in [0x1C12, 0x1C13] {
            if ![outputs, inputs].contains(&(usize::from(index) - 0x1C10)) {
                (0..=2).for_each(|sub| drop(coe.objects.remove(&(index, sub))));
            }
        }
    })
}

/// MASTER-2.9 NIC-2.21 Object 0x1C00 decides the use of sync managers if the EEPROM does not: also of others than 2 and
/// 3, to which the mapping is assigned then.
#[test]
fn object_0x1c00_decides() {
    moves(vec![saying(&[1, 2, 3, 4], None)]);
    moves(vec![saying(&[1, 2, 4, 3], None)]);
    moves(vec![saying(&[1, 2, 0, 3, 0, 4], None)]);
    let swapped: Vec<sii::Manager> =
        vec![sii::MANAGERS[0], sii::MANAGERS[1], (0x1100, 10, 0x20, 1, 4), (0x1180, 6, 0x64, 1, 3)];
    moves(vec![saying(&[1, 2, 4, 3], Some(&swapped))]);
}

/// MASTER-2.3 NIC-2.1 EEPROMs whose commands take 60 to 99 ms only delay the start.
#[test]
fn slow_eeproms() {
    for busy_ms in [60, 99] {
        moves(vec![drive().with(|slave| slave.eeprom.busy_ns = busy_ms * 1_000_000)]);
    }
}

/// A drive with the usual process data, which aborts writes of the mapping with that code.
fn fixed(code: u32) -> OddSlave {
    drive().with(|slave| {
        let coe = slave.mailbox.coe.as_mut().expect("objects");
        coe.fixed = Some(code);
    })
}

/// Fixed process data are used if they are the wanted ones, whatever the abort code of writes; otherwise the message
/// names object and code.
#[test]
fn fixed_process_data() {
    // The board's mapping, read from a drive with free mapping.
    let line = moves(vec![drive()]);
    let wanted = line.slave(1, |slave| {
        let objects = &slave.mailbox.coe.as_ref().expect("objects").objects;
        objects.range((0x1600, 0)..(0x1C30, 0)).map(|(at, value)| (*at, value.clone())).collect::<Vec<_>>()
    });
    for code in [0x0601_0002, 0x0606_0000, 0x0504_0001, 0xDEAD_BEEF] {
        moves(vec![
            fixed(code).with(|slave| slave.mailbox.coe.as_mut().expect("objects").objects.extend(wanted.clone())),
        ]);
        for (at, value, named) in [
            ((0x1C12, 1), number(2, 0x1601), "0x1C12:1"),
            ((0x1A00, 1), number(4, 0x606C_0020), "0x1A00:1"),
            ((0x1600, 0), number(1, 1), "0x1600:0"),
        ] {
            let said = failure(vec![fixed(code).with(|slave| {
                let objects = &mut slave.mailbox.coe.as_mut().expect("objects").objects;
                objects.extend(wanted.clone());
                objects.insert(at, value);
            })]);
            assert!(said.contains("slave 1") && said.contains(named), "{said}");
            assert!(said.contains(&format!("0x{code:08X}")), "{said}");
        }
    }
}

/// A refusal is reported with its AL status code in words; a slave that answers is never reported as silent.
#[test]
fn refusals_are_in_words() {
    for code in [0x0016, 0x001A, 0x001D, 0x001E, 0x002C, 0x002D, 0x0030, 0x0032, 0x0035, 0x0070] {
        let said = failure(vec![drive().with(|slave| slave.states.refuses.push((4, code)))]);
        assert!(said.contains("slave 1 refused SafeOP"), "{said}");
        assert!(said.contains(&format!("AL status 0x{code:04X} (")), "{said}");
    }
    let said = failure(vec![drive().with(|slave| slave.states.refuses.push((2, 0x0016)))]);
    assert!(said.contains("AL status 0x0016 ("), "{said}");
}

/// A slave that answers is never reported as silent or without power, even if parts of it do not answer.
#[test]
fn whoever_answers_is_not_said_not_to() {
    type Change = fn(&mut OddSlave);
    let odd: [(&str, Change); 5] = [
        ("a mute mailbox", |slave| slave.mailbox.is_mute = true),
        ("an EEPROM that is always busy", |slave| slave.eeprom.busy_ns = 400_000_000),
        ("an EEPROM that nobody has written", |slave| slave.eeprom.bytes.fill(0xFF)),
        ("no CoE", |slave| slave.eeprom.bytes[0x38..0x3A].fill(0)),
        ("states that take 30 s", |slave| slave.states.takes_ns = 30_000_000_000),
    ];
    for (what, change) in odd {
        let said = failure(vec![drive().with(change)]);
        assert!(!said.contains("does not answer") && !said.contains("power"), "{what}: {said}");
    }
}

/// PDOs with their entries: index, sub-index, bits.
type Pdos<'a> = [(u16, &'a [(u16, u8, u8)])];

/// An IO module with CoE and these PDOs, outputs and inputs, whose mapping can be written, with the described entries alone.
fn module(outputs: &Pdos<'_>, inputs: &Pdos<'_>) -> OddSlave {
    let bytes = |pdos: &Pdos<'_>| {
        let bits: u32 = pdos.iter().flat_map(|(_, entries)| *entries).map(|(.., bits)| u32::from(*bits)).sum();
        bits.div_ceil(8) as u16
    };
    let (out, into) = (bytes(outputs), bytes(inputs));
    let managers = [
        sii::MANAGERS[0],
        sii::MANAGERS[1],
        (0x1100, out, 0x64, u8::from(out > 0), 3),
        (0x1180, into, 0x20, u8::from(into > 0), 4),
    ];
    let rx: Vec<sii::Pdo<'_>> = outputs.iter().map(|(pdo, entries)| (*pdo, 2, *entries)).collect();
    let tx: Vec<sii::Pdo<'_>> = inputs.iter().map(|(pdo, entries)| (*pdo, 3, *entries)).collect();
    let content = sii::Content::new(4).strings(&[b"IO"]).general(1).fmmus(&[1, 2, 3]).managers(&managers);
    OddSlave::new(content.pdos(50, &tx).pdos(51, &rx).end(), Device::None).with(|slave| {
        let mut coe = drive_objects();
        coe.objects.retain(|(index, _), _| !(0x1600..0x1C00).contains(index) && !matches!(index, 0x1C12 | 0x1C13));
        let entry = |(index, sub, bits): (u16, u8, u8)| u32::from(index) << 16 | u32::from(sub) << 8 | u32::from(bits);
        let mut mappable = BTreeSet::new();
        for (assignment, pdos) in [(0x1C12, outputs), (0x1C13, inputs)] {
            coe.objects.insert((assignment, 0), vec![pdos.len() as u8]);
            for sub in 1..=4_u8 {
                let pdo = pdos.get(usize::from(sub) - 1).map_or(0, |(pdo, _)| *pdo);
                coe.objects.insert((assignment, sub), number(2, pdo.into()));
            }
            for (pdo, entries) in pdos {
                coe.objects.insert((*pdo, 0), vec![entries.len() as u8]);
                for sub in 1..=16_u8 {
                    let value = entries.get(usize::from(sub) - 1).map_or(0, |one| entry(*one));
                    coe.objects.insert((*pdo, sub), number(4, value));
                    mappable.extend(Some(value).filter(|value| *value != 0));
                }
            }
        }
        coe.mappable = Some(mappable);
        slave.mailbox.coe = Some(coe);
    })
}

/// NIC-2.23 An IO module whose mapping can be written, but not as the board wants it, has its own mapping again, and
/// reaches OP with it.
#[test]
fn modules_whose_mapping_cannot_be_the_boards() {
    let bits: [(u16, u8, u8); 8] = std::array::from_fn(|n| (0x6000, n as u8 + 1, 1));
    let out: [(u16, u8, u8); 8] = std::array::from_fn(|n| (0x7000, n as u8 + 1, 1));
    let byte = [(0x6000, 1, 8), (0, 0, 8), (0x6010, 1, 8)];
    let [first, second] = [[(0x6000, 1, 16)], [(0x6010, 1, 16)]];
    type Pdos<'a> = &'a [(u16, &'a [(u16, u8, u8)])];
    let modules: [(Pdos<'_>, Pdos<'_>); 4] = [
        (&[(0x1600, &out)], &[(0x1A00, &bits)]),
        (&[], &[(0x1A00, &byte)]),
        // The first PDO can be mapped as the board wants it; there is no output.
        (&[], &[(0x1A00, &first), (0x1A01, &second)]),
        (&[], &[(0x1A01, &second), (0x1A00, &first)]),
    ];
    for (outputs, inputs) in modules {
        let line = OddLine::new([module(outputs, inputs)]);
        let before = line.slave(1, |slave| slave.mailbox.coe.as_ref().expect("objects").mapped(3));
        let mut host = Host::new(EngineConfig::default(), NicBus::new(line.clone(), Settings::default()));
        let mut kinds = [SlaveKind::None; 8];
        kinds[0] = SlaveKind::Io;
        host.master(MasterCommand::SetAxis { group: 0, kinds });
        host.go(MasterState::Op).drained();
        let now = line.slave(1, |slave| slave.mailbox.coe.as_ref().expect("objects").mapped(3));
        assert_eq!(now, before);
    }
}

/// NIC-2.24 A drive that supports other synchronization types than the wanted one is used, whatever its abort code.
#[test]
fn drives_that_refuse_a_synchronization_type() {
    for code in [0x0609_0030, 0x0601_0000, 0x0604_0043, 0x0800_0022] {
        moves(vec![drive().with(|slave| {
            let coe = slave.mailbox.coe.as_mut().expect("objects");
            coe.set(0x1C32, 1, 1);
            coe.set(0x1C33, 1, 0x22);
            coe.refuses_sync_types = Some(code);
        })]);
    }
}

/// A scan that fails says why: with too many slaves their number.
#[test]
fn a_failed_scan_says_why() {
    let said = failure((0..41).map(|_| coupler()).collect());
    assert!(said.contains("41 slaves are connected"), "{said}");
}

/// A line whose second slave is reached after some frames only, as when it is switched on during the scan.
struct Growing {
    line: OddLine,
    frames: u32,
}

impl Wire for Growing {
    fn send(&mut self, frame: &[u8]) -> Result<(), WireDown> {
        self.frames = self.frames.saturating_sub(1);
        if self.frames == 0 {
            self.line.reach(2);
        }
        self.line.send(frame)
    }

    fn receive(&mut self, buffer: &mut FrameBuffer) -> Option<usize> {
        self.line.receive(buffer)
    }
}

impl NicWires for Growing {
    fn now(&self) -> u64 {
        self.line.now()
    }

    fn wait(&mut self, until: u64) {
        self.line.wait(until);
    }

    fn is_real_time(&self) -> bool {
        false
    }
}

/// A slave that comes during the scan is found by a second one, and the board starts.
#[test]
fn a_slave_that_comes_during_the_scan() {
    for frames in [20, 40, 60] {
        let line = OddLine::new([drive(), drive()]);
        line.reach(1);
        let bus = NicBus::new(Growing { line, frames }, Settings::default());
        let mut board = Board::new(EngineConfig::default(), Box::new(bus));
        while !board.boot(SLICE) {
            assert!(!board.engine().state().is_failed(), "{:?}", board.engine().state_failure());
            assert!(board.now() < BOOT_LIMIT, "not in PreOP");
        }
        assert_eq!(board.engine().slaves_found(), 2);
    }
}

//! IO modules of other makers on a network card: terminals whose EEPROM alone gives their process data, and modules
//! with a fixed mapping.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope};
use ecmsk::engine::EngineConfig;
use ecmsk::ethercat::registers::SmControl;
use ecmsk::ethercat::sii::{
    CategoryKind, SiiIdentity, SiiInfo, SiiPdo, SiiPdoEntry, SiiSmEnable, SiiSmType, SiiSyncManager, SiiWriter,
};
use ecmsk::fieldbus::AlState;
use ecmsk::fieldbus::nic::{ChainWires, NicBus};
use ecmsk::fieldbus::sim::SimHandle;
use ecmsk::master::Settings;
use ecmsk::sk::{MasterCommand, MasterState, SlaveCommand, SlaveKind};
use ecmsk::slave::esc::{CabledChain, Chain, EscSettings, EscSlave};
use ecmsk::slave::{AlStatus, Drive, DriveConfig, Io, Slave};

use crate::host::Host;

/// PDI control word of a controller without a processor behind it: AL status copies AL control.
const DEVICE_EMULATION: u16 = 0x0100;

/// The wiring of a terminal.
#[derive(Clone, Default)]
struct Terminals {
    outputs: Arc<AtomicU32>,
    inputs: Arc<AtomicU32>,
}

/// A terminal: it has no mailbox and no objects.
struct Terminal {
    state: AlState,
    terminals: Terminals,
}

impl Slave for Terminal {
    fn name(&self) -> &str {
        "terminal"
    }

    fn state(&self) -> AlState {
        self.state
    }

    fn enter(&mut self, target: AlState) -> Result<(), AlStatus> {
        self.state = target;
        if target < AlState::Op {
            self.terminals.outputs.store(0, Ordering::Relaxed);
        }
        Ok(())
    }

    fn read(&mut self, object: ObjectAddress, _: SdoScope, _: &mut [u8]) -> Result<usize, AbortCode> {
        panic!("{object} was read without a mailbox");
    }

    fn write(&mut self, object: ObjectAddress, _: SdoScope, _: &[u8]) -> Result<(), AbortCode> {
        panic!("{object} was written without a mailbox");
    }

    fn exchange(&mut self, outputs: Option<&[u8]>, inputs: &mut [u8]) {
        if let Some(outputs) = outputs {
            let mut bits = [0; 4];
            bits[..outputs.len()].copy_from_slice(outputs);
            self.terminals.outputs.store(u32::from_le_bytes(bits), Ordering::Relaxed);
        }
        let bits = self.terminals.inputs.load(Ordering::Relaxed).to_le_bytes();
        let len = inputs.len();
        inputs.copy_from_slice(&bits[..len]);
    }

    fn step(&mut self, _: u64) {}

    fn has_dc(&self) -> bool {
        false
    }
}

/// The EEPROM of a terminal with that many one-bit channels in each direction; 0: none.
fn eeprom(outputs: usize, inputs: usize, pdi_control: u16) -> Vec<u8> {
    let mut bytes = vec![0; 1024];
    let identity = SiiIdentity { vendor: 2, product: (outputs << 8 | inputs) as u32, revision: 1, serial: 0 };
    let info = SiiInfo { pdi_control, identity, ..SiiInfo::default() };
    let mut sii = SiiWriter::new(&mut bytes, &info).expect("room");
    let channel =
        |n: usize, index: u16| SiiPdoEntry { index, sub: n as u8 + 1, name: 0, data_type: 1, bits: 1, flags: 0 };
    let mut managers = Vec::new();
    let mut pdos = Vec::new();
    for (kind, category, channels, control, object, pdo) in [
        (SiiSmType::Outputs, CategoryKind::RxPdos, outputs, SmControl::OUTPUTS, 0x7000, 0x1600),
        (SiiSmType::Inputs, CategoryKind::TxPdos, inputs, SmControl::INPUTS, 0x6000, 0x1A00),
    ] {
        if channels > 0 {
            let number = managers.len() as u8;
            let start = 0x1000 + 0x100 * u16::from(number);
            // As in many terminals, the length comes from the PDOs.
            managers.push(SiiSyncManager { start, len: 0, control, status: 0, enable: SiiSmEnable::ENABLE, kind });
            let entries: Vec<SiiPdoEntry> = (0..channels).map(|n| channel(n, object)).collect();
            pdos.push((category, SiiPdo::new(pdo, number, 0), entries));
        }
    }
    sii.sync_managers(&managers).expect("room");
    for (category, pdo, entries) in &pdos {
        sii.pdos(*category, &[(*pdo, entries)]).expect("room");
    }
    sii.finish();
    bytes
}

/// A board in OP with a drive and terminals behind it with that many outputs and inputs each.
fn board(kinds: &[(usize, usize, u16)]) -> (Host, SimHandle, Vec<Terminals>) {
    let handle = SimHandle::default();
    let drive = Box::new(Drive::new(DriveConfig::default()));
    let mut cable = CabledChain::new(vec![drive], handle.cable().clone()).expect("a drive can be described");
    let mut all = Vec::new();
    for (n, (outputs, inputs, pdi_control)) in kinds.iter().enumerate() {
        let terminals = Terminals::default();
        let device = Box::new(Terminal { state: AlState::Init, terminals: terminals.clone() });
        let eeprom = eeprom(*outputs, *inputs, *pdi_control);
        cable.chain_mut().add(EscSlave::new(device, EscSettings::default(), eeprom, 0), n, 1);
        all.push(terminals);
    }
    let wires = ChainWires::on_cable(cable, handle.clone());
    let mut host = Host::new(EngineConfig::default(), NicBus::new(wires, Settings::default()));
    let mut kinds = [SlaveKind::Io; 8];
    kinds[0] = SlaveKind::Drive;
    host.master(MasterCommand::SetAxis { group: 0, kinds }).go(MasterState::Op).drained();
    (host, handle, all)
}

/// A module without CANopen has the process data that its EEPROM describes, of any length, with one direction alone, and with
/// or without a state machine of its own. IO_WR and IO_RD have the low 16 bits of each direction.
#[test]
fn terminals_without_objects_are_used_as_their_eeprom_says() {
    for pdi_control in [0, DEVICE_EMULATION] {
        let kinds = [
            (8, 0, pdi_control),
            (0, 8, pdi_control),
            (4, 4, pdi_control),
            (16, 16, pdi_control),
            (32, 32, pdi_control),
        ];
        let (mut host, _, terminals) = board(&kinds);
        assert_eq!(host.state().0, 8, "OP");
        for bits in [0xFFFF_u16, 0x5AA5, 0x0001, 0x8000] {
            for slave in 2..=6 {
                terminals[slave - 2].inputs.store(0xFFFF_0000 | u32::from(bits), Ordering::Relaxed);
                host.slave(slave, SlaveCommand::IoWrite(bits));
            }
            host.drained().cycles(3);
            let outputs = terminals.iter().map(|one| one.outputs.load(Ordering::Relaxed));
            let low = u32::from(bits & 0xFF);
            // The smallest unit on the cable is a byte: it has the unused bits of the four channels, too.
            assert_eq!(outputs.collect::<Vec<_>>(), [low, 0, low, bits.into(), bits.into()], "{pdi_control:#x}");
            for slave in 2..=6 {
                host.slave(slave, SlaveCommand::IoRead);
            }
            host.drained().cycles(3);
            let inputs = (2..=6).map(|slave| host.slot(slave).data1);
            assert_eq!(inputs.collect::<Vec<_>>(), [0, low, low, bits.into(), bits.into()], "{pdi_control:#x}");
        }
    }
}

/// MASTER-3.7 A coupler without a state machine and without process data, in front of all others, prevents no slave
/// from reaching OP.
#[test]
fn a_coupler_in_front_keeps_nobody_from_op() {
    let handle = SimHandle::default();
    let mut cable = CabledChain::new(Vec::new(), handle.cable().clone()).expect("nobody");
    let terminals = Terminals::default();
    let coupler = Box::new(Terminal { state: AlState::Init, terminals: Terminals::default() });
    let terminal = Box::new(Terminal { state: AlState::Init, terminals: terminals.clone() });
    let slaves = [
        EscSlave::new(coupler, EscSettings::default(), eeprom(0, 0, DEVICE_EMULATION), 0),
        EscSlave::describe(Box::new(Drive::new(DriveConfig::default())), EscSettings::default(), 0).expect("a drive"),
        EscSlave::new(terminal, EscSettings::default(), eeprom(4, 4, DEVICE_EMULATION), 0),
    ];
    *cable.chain_mut() = Chain::line(slaves);
    let wires = ChainWires::on_cable(cable, handle);
    let mut host = Host::new(EngineConfig::default(), NicBus::new(wires, Settings::default()));
    let mut kinds = [SlaveKind::None; 8];
    (kinds[1], kinds[2]) = (SlaveKind::Drive, SlaveKind::Io);
    host.master(MasterCommand::SetAxis { group: 0, kinds }).go(MasterState::Op).drained();
    host.servo_on(2);
    for n in 1..=50 {
        host.csp(2, n * 10).cycles(1);
    }
    host.slave(3, SlaveCommand::IoWrite(0x5)).drained().cycles(20);
    assert!((host.drive(2).position - 500).abs() <= 1, "{}", host.drive(2).position);
    assert_eq!(terminals.outputs.load(Ordering::Relaxed), 0x5);
    host.go(MasterState::PreOp).go(MasterState::Op);
}

/// A terminal that is lost is named, its outputs are off, and SET_STATE brings it back.
#[test]
fn a_terminal_that_is_lost_comes_back() {
    let (mut host, handle, terminals) = board(&[(8, 8, 0)]);
    host.slave(2, SlaveCommand::IoWrite(0xA5)).drained().cycles(3);
    assert_eq!(terminals[0].outputs.load(Ordering::Relaxed), 0xA5);
    handle.cut_after(1);
    host.cycles(500);
    assert_eq!(terminals[0].outputs.load(Ordering::Relaxed), 0, "its watchdog");
    assert!(host.board.engine().lost().contains(2));
    handle.heal();
    host.cycles(500);
    host.master(MasterCommand::SetState(MasterState::Op)).cycles(2000);
    assert!(host.board.engine().lost().is_empty());
    host.slave(2, SlaveCommand::IoWrite(0x3C)).drained().cycles(3);
    assert_eq!(terminals[0].outputs.load(Ordering::Relaxed), 0x3C);
}

/// A module with fixed PDOs, which have other objects than the board maps.
struct FixedModule {
    io: Io,
    /// Whether the assignment of PDOs can be changed.
    is_assignable: bool,
    /// The aborts of a module that has no assignments at all.
    lacks_assignments: bool,
}

impl Slave for FixedModule {
    support::hand_on_slave!(io: name, state, enter, set_sync_managers, step, apply_fault, has_dc);

    fn exchange(&mut self, outputs: Option<&[u8]>, inputs: &mut [u8]) {
        self.io.exchange(outputs, inputs);
    }

    fn read(&mut self, object: ObjectAddress, scope: SdoScope, value: &mut [u8]) -> Result<usize, AbortCode> {
        let len = self.io.read(object, scope, value)?;
        match (object.index, object.sub) {
            (0x1600, 1) => value[..4].copy_from_slice(&0x7010_0210_u32.to_le_bytes()),
            (0x1A00, 1) => value[..4].copy_from_slice(&0x6010_0210_u32.to_le_bytes()),
            _ => {}
        }
        Ok(len)
    }

    fn write(&mut self, object: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), AbortCode> {
        match object.index {
            0x1C12 | 0x1C13 if self.lacks_assignments => Err(AbortCode::NO_OBJECT),
            0x1C12 | 0x1C13 if self.is_assignable => self.io.write(object, scope, value),
            0x1600..=0x1C13 => Err(AbortCode::READ_ONLY),
            _ => self.io.write(object, scope, value),
        }
    }
}

/// An IO module with CANopen that cannot map the board's objects keeps the PDOs that its EEPROM assigns; these are
/// assigned again if the board's attempt has removed them.
#[test]
fn modules_that_map_nothing_else_keep_their_own_process_data() {
    for (is_assignable, lacks_assignments) in [(false, false), (true, false), (false, true)] {
        let module = || Box::new(FixedModule { io: Io::default(), is_assignable, lacks_assignments }) as Box<dyn Slave>;
        let wires = ChainWires::new(vec![module(), module()], SimHandle::default()).expect("they have an EEPROM");
        let mut host = Host::new(EngineConfig::default(), NicBus::new(wires, Settings::default()));
        host.master(MasterCommand::SetAxis { group: 0, kinds: [SlaveKind::Io; 8] }).go(MasterState::Op).drained();
        for bits in [0x8001_u16, 0x7FFE] {
            host.slave(1, SlaveCommand::IoWrite(bits)).slave(2, SlaveCommand::IoWrite(!bits)).drained().cycles(20);
            host.slave(1, SlaveCommand::IoRead).slave(2, SlaveCommand::IoRead).drained().cycles(3);
            // The outputs of a simulated module are wired to its inputs.
            let inputs = [1, 2].map(|slave| host.slot(slave).data1);
            assert_eq!(inputs, [u32::from(bits), u32::from(!bits)], "{is_assignable} {lacks_assignments}");
        }
    }
}

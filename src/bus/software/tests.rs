//! The scan over simulated slaves.

use super::*;
use crate::ethercat::{DatagramHeader, FrameHeader, FrameWriter};
use crate::fieldbus::nic::ChainWires;
use crate::master::{FrameBuffer, Wire, WireDown};
use crate::slave::cable::Cable;
use crate::slave::esc::{CabledChain, Chain, EscSettings, EscSlave, Predecessor, eeprom_of};
use crate::slave::{Io, Slave};

/// Wires that send each frame back unchanged.
struct Loop(std::collections::VecDeque<Vec<u8>>, Ns);

impl Wire for Loop {
    fn send(&mut self, frame: &[u8]) -> Result<(), WireDown> {
        self.0.push_back(frame.to_vec());
        Ok(())
    }

    fn receive(&mut self, buffer: &mut FrameBuffer) -> Option<usize> {
        let frame = self.0.pop_front()?;
        buffer[..frame.len()].copy_from_slice(&frame);
        Some(frame.len())
    }
}

impl NicWires for Loop {
    fn now(&self) -> Ns {
        self.1
    }

    fn wait(&mut self, until: Ns) {
        self.1 = until;
    }

    fn is_real_time(&self) -> bool {
        false
    }
}

/// A slave that keeps its mailbox counter across Init answers although several masters inspect it, one after the other.
#[test]
fn one_look_after_another_reads_objects() {
    for seed in 0..16 {
        let mut wires = ChainWires::new(vec![Box::new(Io::default())], Default::default()).expect("an EEPROM");
        wires.leave(&mut Predecessor::seeded(seed));
        for look in 0..4 {
            let mut network = SoftwareNetwork::new(wires, Settings::default());
            // The predecessor may have left the slave in OP. `SoftwareNetwork::scan` would take that for a running
            // network and refuse, so the master scans directly.
            let scan = network.master.scan();
            assert_eq!(network.wait_for(scan), Ok(1));
            // Each master makes one request more than the master before it, so that each leaves another mailbox
            // counter in the slave.
            for _ in 0..=look {
                let begin = network.wires.now();
                let value = network.upload(1, ObjectAddress::new(0x1018, 1), SdoScope::Entry);
                assert_eq!(value.expect("a value").len(), 4, "seed {seed}, look {look}");
                assert!(network.wires.now() - begin < 100_000_000, "seed {seed}, look {look}");
            }
            wires = network.wires;
        }
    }
}

/// BUS-2.3 If frames come back unchanged, no slave has handled them, and the error says so.
#[test]
fn frames_that_no_slave_has_changed_are_told() {
    let mut network = SoftwareNetwork::new(Loop(Default::default(), 1_000_000), Settings::default());
    let said = network.scan().expect_err("nobody is there").to_string();
    assert!(said.contains("no slave answers: ") && said.contains("frames came back as they were sent"), "{said}");
}

/// BUS-2.3 A damaged EEPROM is reported with its reason, and the bytes of process data are left out if they are not
/// known.
#[test]
fn what_is_wrong_with_an_eeprom_is_named() {
    let cable = Cable::default();
    let mut line = CabledChain::new(Vec::new(), cable).expect("nobody");
    let good = eeprom_of(&mut Io::default(), &EscSettings::default()).expect("it can be described");
    let mut wrong = good.clone();
    wrong[4] ^= 1;
    let slaves = [vec![0xFF; 512], wrong, good];
    let slaves = slaves.map(|eeprom| EscSlave::new(Box::new(Io::default()), EscSettings::default(), eeprom, 0));
    *line.chain_mut() = Chain::line(slaves);
    let wires = ChainWires::on_cable(line, Default::default());
    let mut network = SoftwareNetwork::new(wires, Settings::default());
    let found = network.scan().expect("slaves");
    let said = |n: usize| found[n].eeprom_error.clone().unwrap_or_default();
    assert!(said(0).contains("the EEPROM is empty: all of its first 64 words are 0xFFFF"), "{}", said(0));
    assert!(said(1).contains("the checksum of the EEPROM's first words is 0x"), "{}", said(1));
    assert_eq!(found[2].eeprom_error, None);
    let bytes: Vec<_> = found.iter().map(|slave| slave.process_bytes).collect();
    assert_eq!(bytes, [(None, None), (Some(2), Some(2)), (Some(2), Some(2))]);
}

/// Wires to which another master sends a frame again and again.
struct Shared {
    wires: ChainWires,
    frame: Option<[u8; 60]>,
}

impl Wire for Shared {
    fn send(&mut self, frame: &[u8]) -> Result<(), WireDown> {
        self.wires.send(frame)
    }

    fn receive(&mut self, buffer: &mut FrameBuffer) -> Option<usize> {
        self.wires.receive(buffer)
    }
}

impl NicWires for Shared {
    fn now(&self) -> Ns {
        NicWires::now(&self.wires)
    }

    fn wait(&mut self, until: Ns) {
        if let Some(frame) = self.frame {
            self.wires.send(&frame).expect("simulated wires are never down");
        }
        NicWires::wait(&mut self.wires, until);
    }

    fn is_real_time(&self) -> bool {
        false
    }
}

/// If a slave in OP gets outputs, another master runs the network: a scan fails and changes nothing in any slave. If it
/// gets no outputs, the scan proceeds.
#[test]
fn a_network_that_runs_is_left_alone() {
    let devices = (0..2).map(|_| Box::new(Io::default()) as Box<dyn Slave>).collect();
    let wires = ChainWires::new(devices, Default::default()).expect("they can be described");
    let mut other = SoftwareNetwork::new(wires, Settings::default());
    other.scan().expect("two slaves");
    let second: SlaveSet = [2].into_iter().collect();
    other.master.configure_as_described(2).expect("process data");
    for state in [AlState::SafeOp, AlState::Op] {
        let change = other.master.request_state(second, state, 1_000_000_000);
        loop {
            let SoftwareNetwork { master, wires, .. } = &mut other;
            if state == AlState::Op {
                master.cycle(wires.now(), wires);
            }
            wires.wait(wires.now() + 500_000);
            master.poll(wires.now(), wires);
            if let Some(ended) = master.take(change) {
                assert_eq!(ended, Ok(()));
                break;
            }
        }
    }
    let outputs = other.master.slave(2).expect("a slave").outputs[0].registers;
    let mut frame = [0; 60];
    let mut writer = FrameWriter::new(&mut frame, FrameHeader::datagrams([0x10; 6])).expect("room");
    let header = DatagramHeader::register(Command::Apwr, 0x55, 1_u16.wrapping_neg(), outputs.start);
    writer.push(header, &vec![0; outputs.len.into()]).expect("room");
    writer.finish();
    let wires = Shared { wires: other.wires, frame: Some(frame) };
    let mut network = SoftwareNetwork::new(wires, Settings::default());
    let refused = network.scan().expect_err("somebody runs it");
    assert!(matches!(refused, BusError::Runs { slave: 2 }), "{refused}");
    let state = |n: usize| network.wires.wires.slaves().chain().slave(n).shown_state();
    assert_eq!([0, 1].map(state), [AlState::Init, AlState::Op].map(RequestedState::State));
    network.wires.frame = None;
    let found = network.scan().expect("nobody runs it");
    assert_eq!(found[1].found.status.state(), RequestedState::State(AlState::Op));
}

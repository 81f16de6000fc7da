//! IO slaves: IO_RD, IO_WR, and outputs that hold.

use ecmsk::engine::EngineConfig;
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::sk::{
    FifoAction, IoResponse, MasterCommand, MasterState, RawSlot, SlaveCommand, SlaveKind, SlotSize, StateByte,
};
use ecmsk::slave::{Drive, DriveConfig, Io, Slave};

use crate::host::Host;
use crate::probe::Bench;
use crate::puppet::Puppet;
use crate::rig::ahead;
use support::ahead_bus::AheadBus;

const PATTERNS: [u16; 6] = [0x0001, 0x8000, 0xFFFF, 0x5AA5, 0x1234, 0x0000];

fn config(slot: SlotSize) -> EngineConfig {
    EngineConfig { slot, ..EngineConfig::default() }
}

/// A board in OP with two puppet IO slaves, whose inputs are 0xA5C3 whatever their outputs.
fn board(slot: SlotSize) -> (Host, [Puppet; 2]) {
    let puppets = [Puppet::new(), Puppet::new()];
    puppets.iter().for_each(|puppet| puppet.strings().shows.inputs = 0xA5C3);
    let mut host = Host::new(config(slot), SimBus::new(puppets.iter().map(Puppet::boxed).collect()));
    host.go(MasterState::Op).drained();
    (host, puppets)
}

fn answer(host: &Host, slave: usize) -> (u8, u8, u16) {
    let slot = host.slot(slave);
    assert_eq!((slot.parm, slot.data1 >> 16, slot.data2, slot.data3), (0, 0, 0, 0), "the rest is 0");
    let IoResponse { head, bits } = IoResponse::decode(&slot);
    (head.id, head.index, bits)
}

/// SK-3.17 SK-3.13 IO_WR sets the outputs and answers the output image, whatever the inputs are; IO_RD answers the inputs and
/// changes no output. Both echo the index.
/// SK-4.23 SK-4.24 IO_RD has no argument, IO_WR's are the low 16 bits of Data1. SK-3.16 The upper half is ignored, and 0.
#[test]
fn io_write_sets_outputs_and_io_read_reads_inputs() {
    for size in SlotSize::ALL {
        let (mut host, puppets) = board(size);
        for (n, bits) in PATTERNS.into_iter().enumerate() {
            let index = n as u8 + 1;
            let write =
                RawSlot { id: 0x14, index, parm: 0xFFFF, data1: 0xABCD_0000 | u32::from(bits), data2: 99, data3: 0 };
            host.raw(1, write).cycle();
            assert_eq!(puppets[0].last().outputs, bits, "{size:?}: in the cycle that took its entry");
            assert_eq!(answer(&host, 1), (0x14, index, bits), "{size:?}");
            host.cycles(3);
            assert_eq!(answer(&host, 1), (0x14, index, bits), "{size:?}: and until the next command");

            let inputs = !bits ^ 0x0F0F;
            puppets[0].strings().shows.inputs = inputs;
            let read = RawSlot { id: 0x13, index: index | 0x80, parm: 7, data1: 0x5555_5555, data2: 1, data3: 0 };
            host.raw(1, read).cycles(2);
            assert_eq!(answer(&host, 1), (0x13, index | 0x80, inputs), "{size:?}");
            assert_eq!(puppets[0].last().outputs, bits, "{size:?}: outputs hold");
        }
        assert_eq!((puppets[1].last().outputs, answer(&host, 2)), (0, (0x00, 0, 0xA5C3)), "{size:?}: its own slave");
        assert_eq!(host.counters().rejected_total(), 0);
    }
}

/// SK-3.18 Under GET_STATUS in OP Data1 shows the inputs of the cycle, and the outputs hold; SK-3.15 byte 0 is 0.
/// SK-5.4 So do they while the FIFO is empty.
#[test]
fn under_get_status_outputs_hold() {
    for size in SlotSize::ALL {
        let (mut host, [puppet, _]) = board(size);
        for bits in PATTERNS {
            host.slave(1, SlaveCommand::IoWrite(bits)).drained();
            puppet.forget();
            for n in 0..100 {
                puppet.strings().shows.inputs = n * 3;
                host.idle().cycle();
                assert_eq!(answer(&host, 1), (0x00, 0, n * 3), "{size:?}");
            }
            host.cycles(100);
            assert!(puppet.strings().sent.iter().all(|out| out.outputs == bits), "{size:?}");
        }
    }
}

/// SK-4.36 A command that is not for IO slaves has no effect: the outputs hold.
#[test]
fn commands_of_drives_leave_outputs_alone() {
    let (mut host, [puppet, _]) = board(SlotSize::Bytes12);
    host.slave(1, SlaveCommand::IoWrite(0x1234)).drained();
    for id in [0x10, 0x11, 0x12, 0x15, 0x16, 0x17, 0x18, 0x19] {
        let rejected = host.counters().rejected_total();
        host.raw(1, RawSlot { id, data1: 0xFFFF, data2: 0xFFFF, ..RawSlot::ZERO }).drained().cycles(2);
        assert_eq!((answer(&host, 1), puppet.last().outputs), ((0, 0, 0xA5C3), 0x1234), "{id:02X}");
        assert_eq!(host.counters().rejected_total(), rejected + 1, "{id:02X}");
    }
}

/// SK-3.17 The simulated module: its inputs return the written outputs, while a drive moves. SK-7.7 It maps 16 digital
/// outputs and 16 digital inputs. SK-4.52 Without SET_AXIS all slaves are IO.
#[test]
fn a_simulated_module_answers() {
    for size in SlotSize::ALL {
        let drive = || Box::new(Drive::new(DriveConfig::default())) as Box<dyn Slave>;
        let Bench { mut host, .. } = Bench::new(config(size), vec![drive(), Box::<Io>::default()]);
        let mut kinds = [SlaveKind::None; 8];
        kinds[..2].copy_from_slice(&[SlaveKind::Drive, SlaveKind::Io]);
        host.master(MasterCommand::SetAxis { group: 0, kinds }).go(MasterState::Op).servo_on(1);
        for (n, bits) in PATTERNS.into_iter().enumerate() {
            let target = 100 * n as i32;
            host.build(|frame, size| {
                frame.put_slave(size, 1, &SlaveCommand::Csp(ecmsk::sk::Motion::to(target)).into());
                frame.put_slave(size, 2, &SlaveCommand::IoWrite(bits).into());
            });
            host.drained().slave(2, SlaveCommand::IoRead).drained().cycles(50);
            assert_eq!((answer(&host, 2), host.drive(1).position), ((0x13, 0, bits), target), "{size:?}");
        }
        assert_eq!(host.read_object(2, 0x1600, 1).map(|entry| entry & 0xFF), Ok(16), "outputs");
        assert_eq!(host.read_object(2, 0x1A00, 1).map(|entry| entry & 0xFF), Ok(16), "inputs");
        assert_eq!((host.read_object(2, 0x1600, 0), host.read_object(2, 0x1A00, 0)), (Ok(1), Ok(1)));

        let modules = (0..3).map(|_| Box::<Io>::default() as Box<dyn Slave>).collect();
        let Bench { mut host, .. } = Bench::new(config(size), modules);
        host.go(MasterState::Op).slave(3, SlaveCommand::IoWrite(0xBEEF)).drained().idle().cycles(2);
        assert_eq!((answer(&host, 2), answer(&host, 3)), ((0, 0, 0), (0, 0, 0xBEEF)), "{size:?}: no SET_AXIS");
    }
}

/// OP begins with all outputs off, also after OP was left.
#[test]
fn op_begins_with_outputs_off() {
    let (mut host, [puppet, _]) = board(SlotSize::Bytes12);
    for back in [MasterState::SafeOp, MasterState::PreOp, MasterState::Init] {
        host.slave(1, SlaveCommand::IoWrite(0xFFFF)).drained();
        assert_eq!(puppet.last().outputs, 0xFFFF);
        host.go(back);
        if back == MasterState::Init {
            host.go(MasterState::PreOp);
        }
        puppet.forget();
        host.go(MasterState::Op).cycles(10);
        assert!(puppet.strings().sent.iter().all(|out| out.outputs == 0), "back from {back}");
    }
}

/// SK-5.3 SK-3.17 On a bus that takes outputs ahead every IO_WR reaches the slave once and in order, and the answer belongs
/// to it. SK-5.22 Commands that the bus has taken ahead when the FIFO is cleared have no effect.
#[test]
fn outputs_ahead() {
    for how in ahead() {
        let puppet = Puppet::new();
        let mut host = Host::new(EngineConfig::default(), AheadBus::new(SimBus::new(vec![puppet.boxed()]), how));
        host.go(MasterState::Op).drained().cycles(30);
        let images = |puppet: &Puppet| {
            let mut images: Vec<u16> = puppet.strings().sent.iter().map(|out| out.outputs).collect();
            images.dedup();
            images
        };
        let write = |host: &mut Host, bits: u16| {
            let mut frame = ecmsk::sk::Frame::new();
            frame.put_slave(host.size, 1, &SlaveCommand::IoWrite(bits).into());
            host.arrive(&frame);
        };
        (1..=100).for_each(|bits| write(&mut host, bits));
        host.drained().cycles(30);
        assert_eq!((images(&puppet), answer(&host, 1)), ((0..=100).collect(), (0x14, 0, 100)), "{how:?}");

        puppet.forget();
        (101..=200).for_each(|bits| write(&mut host, bits));
        host.cycles(20).master(MasterCommand::SetFifo(FifoAction::Clear)).cycles(300);
        let reached = puppet.last().outputs;
        assert!((110..=122).contains(&reached), "{how:?}: {reached}");
        let mut newer = images(&puppet);
        newer.retain(|bits| *bits > 100);
        assert_eq!(newer, (101..=reached).collect::<Vec<_>>(), "{how:?}");
        assert_eq!(answer(&host, 1).0, 0x00, "{how:?}: the clear's own frame was executed");
        write(&mut host, 7);
        host.cycles(50);
        assert_eq!((puppet.last().outputs, answer(&host, 1)), (7, (0x14, 0, 7)), "{how:?}");
    }
}

/// SK-3.14 SK-3.17 The output image of the answer is the real output: in OP again after a lower state the outputs are
/// off until they are written. SK-4.66 Below OP the slot keeps its last values.
#[test]
fn the_image_is_what_is_output() {
    for state in [MasterState::SafeOp, MasterState::PreOp, MasterState::Init] {
        let (mut host, puppets) = board(SlotSize::Bytes12);
        // Every frame carries the command, so that no GET_STATUS replaces it; below OP it is rejected.
        let ask = |host: &mut Host, state| {
            host.build(|frame, size| {
                frame.put_master(size, &MasterCommand::SetState(state));
                frame.put(size, 1, &RawSlot { id: 0x14, index: 7, data1: 0x5AA5, ..RawSlot::ZERO });
            });
            host.until("the state", |host| host.state() == StateByte::reached(state)).cycles(5);
        };
        ask(&mut host, state);
        assert_eq!(answer(&host, 1), (0x14, 7, 0x5AA5), "{state}");
        if state == MasterState::Init {
            ask(&mut host, MasterState::PreOp);
        }
        ask(&mut host, MasterState::Op);
        assert_eq!((puppets[0].last().outputs, answer(&host, 1)), (0, (0x14, 7, 0)), "{state}");
    }
}

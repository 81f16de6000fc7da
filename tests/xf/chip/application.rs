//! Allocations of an exchange, reproducible runs, and random bytes.

use allocation_counter::measure;
use ecmsk::cia402::DriveState;
use ecmsk::ethercat::Ns;
use ecmsk::slave::handle::SimHandle;
use ecmsk::xf::chip::{Chip, ChipPort, Controllers, Profile, SimulatedNetwork, SlaveModels};
use ecmsk::xf::request::{
    FifoEnable, HelperConfigSet, HelperControl, HelperStateGet, HelperStateSet, PdoDataFifo, PdoOperation,
};
use ecmsk::xf::{
    AnswerPacket, CheckRule, CommandHeader, CrcCoverage, EtherCatState, MAX_PACKET, Received, write_request,
};
use proptest::prelude::*;

use super::{Host, MS};
use crate::network::{INIT, drive, to_all};
use crate::{motor, slave};

/// A host with two drives in Operation enabled, and the FIFO on.
fn in_op() -> Host {
    let mut host = Host::new(Profile::NEW, vec![drive(), drive()]);
    host.use_crc();
    host.bring_to(EtherCatState::Op);
    host.run(&FifoEnable { on: true });
    for n in 0..2 {
        host.run(&HelperConfigSet {
            motor: motor(n),
            controlword_offset: 0,
            statusword_offset: 0,
            control: HelperControl::ON | HelperControl::RESET_ONCE,
            slave: slave(n),
        });
        host.run(&HelperStateSet { motor: motor(n), state: DriveState::OperationEnabled });
    }
    host.pass(1000 * MS);
    for n in 0..2 {
        let get = HelperStateGet { motor: motor(n) };
        assert_eq!(host.call(&get).to(&get).state(), Some(DriveState::OperationEnabled));
    }
    host
}

const BOTH: PdoOperation = PdoOperation(PdoOperation::WRITE.0 | PdoOperation::READ.0);

/// The RxPDO of both drives, whose controlwords the helper makes: both have that target.
fn targets(position: i32) -> [u8; 12] {
    let mut rx = [0; 12];
    for axis in rx.chunks_exact_mut(6) {
        axis[2..].copy_from_slice(&position.to_le_bytes());
    }
    rx
}

/// XF-11.59 The same packets at the same times give the same bytes.
#[test]
fn runs_are_the_same() {
    let run = || {
        let mut host = in_op();
        (0..50).map(|n| host.send(&PdoDataFifo { count: 1, operation: BOTH, data: &targets(n) })).collect::<Vec<_>>()
    };
    assert_eq!(run(), run());
}

/// Moves two drives in OP by 200 exchanges of `exchange`, none of which may allocate.
fn exchange_without_allocation(exchange: impl Fn(&mut ChipPort<SlaveModels>, Ns, &[u8], &mut [u8])) {
    let host = in_op();
    let (size, mut now) = (host.chip.size(), host.now);
    let mut port = ChipPort::new(host.chip);
    let (mut command, mut answer) = ([0; MAX_PACKET], [0; MAX_PACKET]);
    let answer = &mut answer[..size.packet_len()];
    let counted = measure(|| {
        for n in 1..=200_u8 {
            let request = PdoDataFifo { count: 1, operation: BOTH, data: &targets(n.into()) };
            let header = CommandHeader::with_index(n);
            let packet = write_request(&mut command, size, CheckRule::CRC32, header, &request).expect("it fits");
            now += MS;
            exchange(&mut port, now, packet, answer);
        }
    });
    assert_eq!(counted.count_total, 0);
    let Ok(Received::Answer(packet)) = AnswerPacket::parse(answer, size, CrcCoverage::All) else { panic!("an answer") };
    assert_eq!((packet.header.index, packet.header.len), (199, 20), "TxPDOs come");
}

/// XF-11.60 In OP an exchange and the cycles before it allocate nothing.
#[test]
fn nothing_is_allocated() {
    exchange_without_allocation(|port, now, packet, answer| port.chip_mut().exchange(now, packet, answer));
}

/// XF-11.60 Neither does a packet that passes the chip's port in two pieces.
#[test]
fn the_port_allocates_nothing() {
    exchange_without_allocation(|port, now, packet, answer| {
        let middle = packet.len() / 2;
        let (first, rest) = answer.split_at_mut(middle);
        assert_eq!(port.transfer(now, &packet[..middle], first), middle);
        assert_eq!(port.transfer(now, &packet[middle..], rest), packet.len() - middle);
    });
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// XF-11.61 Whatever bytes come, the chip does not panic and answers afterwards.
    #[test]
    fn any_commands(
        over_controllers in any::<bool>(),
        packets in prop::collection::vec((any::<u8>(), any::<u8>(), any::<[u8; 4]>(), any::<u16>(), any::<u8>(),
            prop::collection::vec(any::<u8>(), 0..64)), 1..100)
    ) {
        let slaves = vec![drive(), drive()];
        let mut chip = Chip::new(Profile::NEW, if over_controllers {
            SimulatedNetwork::Controllers(Controllers::new(slaves, SimHandle::default()).expect("drives"))
        } else {
            SimulatedNetwork::Models(SlaveModels::new(slaves))
        });
        let mut now = 1000 * MS;
        let mut answer = [0; MAX_PACKET];
        let (mut buffer, size, header) = ([0; MAX_PACKET], chip.size(), CommandHeader::with_index);
        // A network in PreOP, so that commands have an effect.
        let init = write_request(&mut buffer, size, CheckRule::FIXED, header(201), &INIT).expect("it fits").to_vec();
        let state = to_all(EtherCatState::PreOp);
        let preop = write_request(&mut buffer, size, CheckRule::FIXED, header(202), &state).expect("it fits");
        for packet in [&init[..], preop] {
            chip.exchange(now, packet, &mut answer[..size.packet_len()]);
            now += 1000 * MS;
        }
        for (index, (code, par, info, len, control, data)) in (0..=255).cycle().zip(&packets) {
            let size = chip.size();
            let mut bytes = vec![0xA4, 0xA3, 0xA2, 0xA1];
            bytes.extend(info);
            bytes.extend([0, 0, *control, index, *code % 146, *par % 50]);
            bytes.extend((len % 300).to_le_bytes());
            bytes.extend([0; 8]);
            bytes.extend(data);
            bytes.resize(24 + size.bytes(), 0);
            bytes.extend(0x1234_5678_u32.to_le_bytes());
            bytes.extend([0x59, 0x58, 0x57, 0x56]);
            now += 7 * MS;
            chip.exchange(now, &bytes, &mut answer[..size.packet_len()]);
        }
        chip.run_until(now + 1000 * MS);
        prop_assert!(chip.is_ready());
    }

    /// XF-11.61 The same for a stream of random bytes of any length: each byte is answered by one, and the time goes
    /// on.
    #[test]
    fn any_bytes(chunks in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..2000), 1..20)) {
        let mut port = ChipPort::new(Chip::new(Profile::OLD, SlaveModels::new(vec![drive()])));
        let (mut now, mut all) = (1000 * MS, Vec::new());
        for chunk in &chunks {
            now += MS;
            let mut from = vec![0; chunk.len()];
            prop_assert_eq!(port.transfer(now, chunk, &mut from), chunk.len());
            all.extend(from);
        }
        // The chip sends complete packets in a row, whatever it gets.
        for packet in all.chunks_exact(144) {
            prop_assert_eq!((&packet[..4], &packet[140..]), (&[0xA4, 0xA3, 0xA2, 0xA1][..], &[0x59, 0x58, 0x57, 0x56][..]));
        }
        prop_assert!(usize::from(port.chip_mut().size().get()) == 112);
    }
}

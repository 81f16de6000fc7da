//! The usual start of an application, to two drives that move; what an exchange costs; any bytes.

use allocation_counter::measure;
use ecmsk::cia402::DriveState;
use ecmsk::ethercat::Ns;
use ecmsk::slave::handle::SimHandle;
use ecmsk::xf::chip::{Chip, ChipPort, Controllers, Profile, SimulatedNetwork, SlaveModels};
use ecmsk::xf::request::{
    Fifo, FifoClear, FifoEnable, FifoPackSizeGet, Fifos, FirmwareVersionGet, HelperConfigSet, HelperControl,
    HelperStateGet, HelperStateSet, InfoUpdate, MappedObject, PdoAssignment, PdoConfigSet, PdoData, PdoDataFifo,
    PdoMap, PdoOperation, Reconfig, SdoOperation, SlaveCountGet, SpiReconfig,
};
use ecmsk::xf::{
    AnswerPacket, CheckRule, CommandHeader, Coverage, DataSize, Errors, EtherCatState, MAX_PACKET, Received,
    write_request,
};
use proptest::prelude::*;

use super::{Host, INIT, MS, drive, sdo, to_all};
use crate::{motor, slave};

fn position(tx: &[u8], drive: usize) -> i32 {
    i32::from_le_bytes(tx[6 * drive + 2..][..4].try_into().expect("4 bytes"))
}

/// The RxPDO of both drives, whose controlwords the helper makes.
fn targets(positions: [i32; 2]) -> [u8; 12] {
    let mut rx = [0; 12];
    for (axis, position) in rx.chunks_exact_mut(6).zip(positions) {
        axis[2..].copy_from_slice(&position.to_le_bytes());
    }
    rx
}

/// Every step of the usual start, and where the drives stand then.
fn start(host: &mut Host) -> [i32; 2] {
    host.call(&SpiReconfig { size: DataSize::MANUAL });
    host.use_crc();
    assert_eq!(host.call(&FirmwareVersionGet).to(&FirmwareVersionGet).version, 0x22);
    host.wait();
    host.run(&FifoEnable { on: false });
    host.run(&FifoClear { fifos: Fifos::Both });
    host.run(&INIT);
    assert_eq!(host.call(&SlaveCountGet).header.ret, 2);
    host.run(&to_all(EtherCatState::PreOp));
    for n in 0..2 {
        host.run(&sdo(n, 0x6060, 0, SdoOperation::Write(&[8])));
        for (assignment, map, objects) in [
            (PdoAssignment::Rx, 0x1600, [0x6040_0010, 0x607A_0020_u32]),
            (PdoAssignment::Tx, 0x1A00, [0x6041_0010, 0x6064_0020]),
        ] {
            let objects = objects.map(|entry| MappedObject { index: (entry >> 16) as u16, sub: 0, bits: entry as u8 });
            let maps = [PdoMap::new(map, &objects).expect("2 objects")];
            host.run(&PdoConfigSet::new(slave(n), assignment, &maps).expect("1 PDO"));
        }
    }
    host.run(&Reconfig);
    host.run(&to_all(EtherCatState::SafeOp));
    for n in 0..2 {
        host.run(&HelperConfigSet {
            motor: motor(n),
            controlword_offset: 0,
            statusword_offset: 0,
            control: HelperControl::ON | HelperControl::RESET_ONCE,
            slave: slave(n),
        });
    }
    for fifo in [Fifo::Rx, Fifo::Tx] {
        assert_eq!(host.call(&FifoPackSizeGet { fifo }).to(&FifoPackSizeGet { fifo }), 12);
    }
    host.pass(5 * MS);
    let read = PdoData { operation: PdoOperation::VALID | PdoOperation::READ, data: &[] };
    let got = host.call(&read);
    let tx = got.to(&read).data;
    let positions = [position(tx, 0), position(tx, 1)];
    // The drives hold where they are.
    let write = PdoOperation::VALID | PdoOperation::WRITE;
    host.run(&PdoData { operation: write, data: &targets(positions) });
    host.run(&to_all(EtherCatState::Op));
    host.run(&FifoEnable { on: true });
    for n in 0..2 {
        host.run(&HelperStateSet { motor: motor(n), state: DriveState::OperationEnabled });
    }
    host.pass(1000 * MS);
    for n in 0..2 {
        let get = HelperStateGet { motor: motor(n) };
        assert_eq!(host.call(&get).to(&get).state(), Some(DriveState::OperationEnabled));
    }
    positions
}

/// XF-11.58 The usual start of an application ends with two drives in CSP that follow the RxPDOs of the FIFO, and whose
/// positions come back in TxPDOs.
#[test]
fn two_drives_move() {
    let mut host = Host::new(Profile::NEW, vec![drive(), drive()]);
    let begin = start(&mut host);
    host.run(&FifoClear { fifos: Fifos::Both });
    host.pace = MS;
    let both = PdoOperation::WRITE | PdoOperation::READ;
    let (mut newest, mut read) = (begin, 0);
    for n in 1..=1000 {
        let rx = targets([begin[0] + 10 * n, begin[1] - 20 * n]);
        let request = PdoDataFifo { count: 1, operation: both, data: &rx };
        let got = host.send(&request);
        assert_eq!(got.errors(), Errors::NONE);
        if n > 1 && PdoOperation(got.header.ret).contains(PdoOperation::READ) {
            let tx = got.to(&request).data;
            newest = [position(tx, 0), position(tx, 1)];
            read += 1;
        }
    }
    assert!(read > 990, "{read} TxPDOs");
    let moved = [newest[0] - begin[0], newest[1] - begin[1]];
    assert!((9_900..=10_000).contains(&moved[0]) && (-20_000..=-19_800).contains(&moved[1]), "{moved:?}");
    // Nothing new comes: the newest is repeated, and the drives arrive.
    host.pass(100 * MS);
    let shafts = [0, 1].map(|n| host.chip.network().slave(n).and_then(|slave| slave.shaft(0)).expect("an axis"));
    assert!((shafts[0] - 10_000).abs() < 10 && (shafts[1] + 20_000).abs() < 10, "{shafts:?}");
    assert_eq!(host.call(&InfoUpdate).header.wkc_errors, 0);
}

/// XF-11.59 The same packets at the same times give the same bytes.
#[test]
fn runs_are_the_same() {
    let run = || {
        let mut host = Host::new(Profile::NEW, vec![drive(), drive()]);
        let begin = start(&mut host);
        (0..50)
            .map(|n| {
                host.send(&PdoDataFifo {
                    count: 1,
                    operation: PdoOperation::WRITE | PdoOperation::READ,
                    data: &targets([begin[0] + n, begin[1]]),
                })
            })
            .collect::<Vec<_>>()
    };
    assert_eq!(run(), run());
}

/// Moves two drives in OP by 200 exchanges of `exchange`, none of which may allocate.
fn exchange_without_allocation(exchange: impl Fn(&mut ChipPort<SlaveModels>, Ns, &[u8], &mut [u8])) {
    let mut host = Host::new(Profile::NEW, vec![drive(), drive()]);
    start(&mut host);
    let (size, mut now) = (host.chip.size(), host.now);
    let mut port = ChipPort::new(host.chip);
    let (mut command, mut answer) = ([0; MAX_PACKET], [0; MAX_PACKET]);
    let answer = &mut answer[..size.packet_len()];
    let counted = measure(|| {
        for n in 1..=200_u8 {
            let request =
                PdoDataFifo { count: 1, operation: PdoOperation::WRITE | PdoOperation::READ, data: &targets([0, 0]) };
            let header = CommandHeader::with_index(n);
            let packet = write_request(&mut command, size, CheckRule::CRC32, header, &request).expect("it fits");
            now += MS;
            exchange(&mut port, now, packet, answer);
        }
    });
    assert_eq!(counted.count_total, 0);
    let Ok(Received::Answer(packet)) = AnswerPacket::parse(answer, size, Coverage::All) else { panic!("an answer") };
    assert_eq!((packet.header.index, packet.header.len), (199, 12), "TxPDOs come");
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

    /// XF-11.61 Whatever bytes come, the chip goes on: no panic, and it answers afterwards.
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
        // A network in PreOP, of which commands can want something.
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

    /// XF-11.61 Neither do any bytes in a stream, of any length: for each there is one, and the time goes on.
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
        // What comes from the chip are packets one after the other, whatever goes to it.
        for packet in all.chunks_exact(144) {
            prop_assert_eq!((&packet[..4], &packet[140..]), (&[0xA4, 0xA3, 0xA2, 0xA1][..], &[0x59, 0x58, 0x57, 0x56][..]));
        }
        prop_assert!(usize::from(port.chip_mut().size().get()) == 112);
    }
}

//! Process data and FIFOs.

use ecmsk::coe::ObjectAddress;
use ecmsk::xf::Request;
use ecmsk::xf::request::{
    Fifo, FifoClear, FifoEnable, FifoGetRxCount, FifoGetTxCount, FifoInit, FifoPackSizeGet, FifoSetRxCount,
    FifoSetTxCount, FifoThresholdSet, Fifos, MappedObject, PdoAssignment, PdoConfigGet, PdoConfigRequest, PdoConfigSet,
    PdoData, PdoDataFifo, PdoMap, PdoOperation,
};

use super::{case, long, short};
use crate::{Printed, bytes, slave};

fn object(index: u16, sub: u8, bits: u8) -> MappedObject {
    MappedObject::new(ObjectAddress::new(index, sub), bits)
}

/// XF-6.1 Process data through the FIFO, XF-6.2 and past it, XF-4.3 as many as the length says.
/// XF EN 436: par PDOs, i0 bit 0 write, bit 1 read. XF EN 452: i0 bit 1 read, bit 2 valid.
#[test]
pub fn process_data() {
    let data = [1, 2, 3, 4, 5, 6];
    let both = PdoOperation::WRITE | PdoOperation::READ;
    case(
        PdoDataFifo { count: 2, operation: both, data: &data },
        Printed { info: [3, 0, 0, 0], ..long(5, 2, data.to_vec()) },
    );
    case(
        PdoDataFifo { count: 1, operation: PdoOperation::READ, data: &[] },
        Printed { info: [2, 0, 0, 0], ..long(5, 1, vec![]) },
    );
    case(
        PdoData { operation: PdoOperation::VALID | PdoOperation::READ, data: &[] },
        Printed { info: [6, 0, 0, 0], ..long(6, 0, vec![]) },
    );
    case(
        PdoData { operation: PdoOperation::VALID | both, data: &data },
        Printed { info: [7, 0, 0, 0], ..long(6, 0, data.to_vec()) },
    );
    // Bits that only the vendor's header has.
    case(PdoDataFifo { count: 1, operation: PdoOperation(0x0C), data: &[] }, short(5, 1, [0x0C, 0, 0, 0]));
    Printed { len: 3, ..long(5, 1, vec![1, 2, 3, 4]) }.read(|read| match read {
        Ok(Request::PdoDataFifo(fifo)) => assert_eq!(fifo.data, [1, 2, 3]),
        other => panic!("{other:?}"),
    });
    Printed { len: 1025, ..long(6, 0, vec![]) }.read(|read| {
        assert_eq!(
            read.expect_err("beyond n").to_string(),
            "bytes of the data segment is 1024 (0x400), allowed is at least 1025"
        );
    });
}

/// XF-6.3 PDO_CONFIG_SET with 3 PDOs of up to 8 objects; XF-4.3 whatever the length says.
/// XF EN 468: @0 slave, @1 PDO count, @2 assign, @4 mappings, @10 counts, @16, @48, @80 objects.
#[test]
pub fn configured_pdos() {
    let eight: Vec<MappedObject> = (1..=8).map(|sub| object(0x2000, sub, 8)).collect();
    let maps = [
        PdoMap::new(0x1A00, &[object(0x6041, 0, 16), object(0x6064, 0, 32)]),
        PdoMap::new(0x1A01, &eight),
        PdoMap::new(0x1A02, &[]),
    ];
    let maps = maps.map(|map| map.expect("8 objects at most"));
    let mut data = bytes![4_u8, 3_u8, 0x1C13_u16, 0x1A00_u16, 0x1A01_u16, 0x1A02_u16, 2_u16, 8_u16, 0_u16];
    assert_eq!(data.len(), 0x10);
    data.extend([16, 0, 0x41, 0x60, 32, 0, 0x64, 0x60]);
    data.resize(0x30, 0);
    data.extend((1..=8).flat_map(|sub| [8, sub, 0x00, 0x20]));
    assert_eq!(data.len(), 0x50);
    data.resize(112, 0);
    let set = PdoConfigSet::new(slave(4), PdoAssignment::Tx, &maps).expect("3 PDOs");
    case(set, long(7, 0, data));
    case(
        PdoConfigSet::new(slave(0), PdoAssignment::Rx, &[]).expect("no PDO"),
        long(7, 0, [vec![0, 0, 0x12, 0x1C], vec![0; 108]].concat()),
    );
    case(PdoConfigRequest { slave: slave(4), assignment: PdoAssignment::Rx }, long(8, 0, vec![4, 0, 0x12, 0x1C]));
    case(PdoConfigGet, short(9, 0, [0; 4]));
    let nine = [object(0x2000, 1, 8); 9];
    assert_eq!(PdoMap::new(0x1600, &nine), None);
    let map = PdoMap::new(0x1600, &nine[..8]).expect("8 objects");
    assert_eq!(
        (map.index(), map.objects().len(), map.objects()[0].object()),
        (0x1600, 8, ObjectAddress::new(0x2000, 1))
    );
    assert_eq!(PdoConfigSet::new(slave(1), PdoAssignment::Rx, &[map; 4]), None);

    // Drivers send 8 with the length of 7, and of the longer layout.
    for len in [0, 4, 112, 148] {
        Printed { len, ..long(8, 0, vec![4, 0, 0x12, 0x1C]) }
            .read(|read| assert!(matches!(read, Ok(Request::PdoConfigRequest(_)))));
    }
    // Bytes behind the counted objects have no meaning.
    let mut data = bytes![1_u8, 1_u8, 0x1C12_u16, 0x1600_u16, 0x1601_u16, 7_u16, 1_u16, 9_u16, 9_u16];
    data.resize(112, 0xEE);
    long(7, 0, data).read(|read| match read {
        Ok(Request::PdoConfigSet(set)) => {
            let object = MappedObject { index: 0xEEEE, sub: 0xEE, bits: 0xEE };
            assert_eq!(set.config().maps(), [PdoMap::new(0x1600, &[object]).expect("an object")]);
        }
        other => panic!("{other:?}"),
    });
}

/// XF-6.5 The FIFOs. XF EN 674, 685, 1224 to 1273, 1345.
#[test]
pub fn fifo_commands() {
    case(FifoEnable { on: false }, short(18, 0, [0; 4]));
    case(FifoEnable { on: true }, short(18, 1, [0; 4]));
    case(FifoPackSizeGet { fifo: Fifo::Rx }, short(19, 0, [0; 4]));
    case(FifoPackSizeGet { fifo: Fifo::Tx }, short(19, 1, [0; 4]));
    case(FifoClear { fifos: Fifos::Both }, short(51, 0, [0; 4]));
    case(FifoClear { fifos: Fifos::Tx }, short(51, 1, [0; 4]));
    case(FifoClear { fifos: Fifos::Rx }, short(51, 2, [0; 4]));
    case(FifoSetTxCount { entries: 64 }, short(52, 64, [0; 4]));
    case(FifoGetTxCount, short(53, 0, [0; 4]));
    case(FifoSetRxCount { entries: 255 }, short(54, 255, [0; 4]));
    case(FifoGetRxCount, short(55, 0, [0; 4]));
    case(FifoInit, short(66, 0, [0; 4]));
}

/// XF-6.6 Limits of the FIFOs. XF EN 1374: par bit 0 TxFIFO high, bit 1 RxFIFO low, i0 and i1 limits.
#[test]
pub fn fifo_limits() {
    case(FifoThresholdSet { tx_high: None, rx_low: None }, short(70, 0, [0; 4]));
    case(FifoThresholdSet { tx_high: Some(10), rx_low: None }, short(70, 1, [10, 0, 0, 0]));
    case(FifoThresholdSet { tx_high: None, rx_low: Some(11) }, short(70, 2, [0, 11, 0, 0]));
    case(FifoThresholdSet { tx_high: Some(12), rx_low: Some(0) }, short(70, 3, [12, 0, 0, 0]));
}

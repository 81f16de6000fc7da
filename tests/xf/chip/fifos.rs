//! Process data through the FIFOs and past them.

use ecmsk::xf::chip::Profile;
use ecmsk::xf::request::{
    Fifo, FifoClear, FifoEnable, FifoGetRxCount, FifoGetTxCount, FifoInit, FifoPackSizeGet, FifoSetRxCount,
    FifoSetTxCount, Fifos, InfoUpdate, PdoData, PdoDataFifo, PdoOperation, Reconfig,
};
use ecmsk::xf::{Errors, EtherCatState, Status};

use super::{Got, Host, MS, to_all};

/// RxPDO of two drives (controlword and target position) and an IO module.
const RX_BYTES: usize = 14;
/// TxPDO of two drives (statusword, position, torque, error code) and an IO module.
const TX_BYTES: usize = 22;

/// An RxPDO whose IO outputs are `n`.
fn rx(n: u16) -> [u8; RX_BYTES] {
    let mut pdo = [0; RX_BYTES];
    pdo[12..].copy_from_slice(&n.to_le_bytes());
    pdo
}

fn write(pdos: &[u8], count: u8) -> PdoDataFifo<'_> {
    PdoDataFifo { count, operation: PdoOperation::WRITE, data: pdos }
}

const fn read(count: u8) -> PdoDataFifo<'static> {
    PdoDataFifo { count, operation: PdoOperation::READ, data: &[] }
}

fn io_outputs(host: &mut Host) -> u16 {
    use ecmsk::coe::ObjectAddress;
    let slave = host.chip.network_mut().slave_mut(2).expect("the IO module");
    slave.upload(ObjectAddress::new(0x7000, 1)).expect("its outputs").bits as u16
}

fn done(got: &Got) -> PdoOperation {
    PdoOperation(got.header.ret)
}

/// XF-11.16 FIFO_PACK_SIZE_GET tells the bytes of all slaves' process data in each direction, 0 before they are laid
/// out.
#[test]
fn sizes() {
    let mut host = Host::in_state(EtherCatState::PreOp);
    let size = |host: &mut Host, fifo| host.call(&FifoPackSizeGet { fifo }).to(&FifoPackSizeGet { fifo });
    assert_eq!((size(&mut host, Fifo::Rx), size(&mut host, Fifo::Tx)), (0, 0));
    host.run(&Reconfig);
    assert_eq!((size(&mut host, Fifo::Rx), size(&mut host, Fifo::Tx)), (14, 22));
}

/// XF-11.17 With the FIFO on, one RxPDO goes out in each cycle in OP, and the newest is repeated when it is empty; with
/// the FIFO off they are kept.
#[test]
fn one_a_cycle() {
    let mut host = Host::in_state(EtherCatState::Op);
    let pdos: Vec<u8> = [rx(1), rx(2), rx(3)].concat();
    assert_eq!(done(&host.call(&write(&pdos, 3))), PdoOperation::WRITE);
    host.pass(20 * MS);
    assert_eq!(io_outputs(&mut host), 0);
    host.call(&FifoEnable { on: true });
    assert!(host.call(&InfoUpdate).has(Status::FIFO_ON));
    let mut seen = vec![io_outputs(&mut host)];
    for _ in 0..10 {
        host.pass(MS);
        seen.push(io_outputs(&mut host));
    }
    seen.dedup();
    assert!(seen.ends_with(&[1, 2, 3]) || seen == [2, 3], "{seen:?}");
    host.pass(50 * MS);
    assert_eq!(io_outputs(&mut host), 3);
    host.call(&FifoEnable { on: false });
    host.call(&write(&rx(9), 1));
    host.pass(5 * MS);
    assert_eq!(io_outputs(&mut host), 3);
}

/// XF-11.18 Counts in headers lag two exchanges behind: a write with one exchange is seen two later.
#[test]
fn counts_lag() {
    let mut host = Host::in_state(EtherCatState::Op);
    host.call(&FifoClear { fifos: Fifos::Both });
    assert_eq!(host.send(&write(&rx(1), 1)).header.rx_fifo, 0);
    assert_eq!(host.send(&InfoUpdate).header.rx_fifo, 0, "the answer to the write");
    assert_eq!(host.send(&InfoUpdate).header.rx_fifo, 1);
    let tx = host.send(&InfoUpdate).header.tx_fifo;
    host.pass(10 * MS);
    assert!(host.send(&InfoUpdate).header.tx_fifo.abs_diff(tx) < 2);
    assert!(host.send(&InfoUpdate).header.tx_fifo >= tx + 10);
}

/// XF-11.19 A full RxFIFO loses the new RxPDO: a FIFO error, and the answer says failed.
#[test]
fn rx_full() {
    let mut host = Host::in_state(EtherCatState::Op);
    for n in 0..64 {
        assert_eq!(done(&host.call(&write(&rx(n), 1))), PdoOperation::WRITE);
    }
    let got = host.call(&write(&rx(64), 1));
    assert_eq!((done(&got), got.errors()), (PdoOperation::FAILED, Errors::FIFO));
    host.call(&InfoUpdate);
    assert_eq!(host.call(&InfoUpdate).header.rx_fifo, 64);
    host.call(&FifoEnable { on: true });
    host.pass(100 * MS);
    assert_eq!(io_outputs(&mut host), 63);
}

/// XF-11.20 A full TxFIFO loses the oldest TxPDO. It is read in order, at most `par` whole ones; an empty one leaves
/// bit 1 of the answer clear.
#[test]
fn tx_full() {
    let mut host = Host::in_state(EtherCatState::Op);
    host.call(&FifoEnable { on: true });
    host.call(&write(&rx(0x5A5A), 1));
    host.pass(200 * MS);
    // Two exchanges take the lag out of the count.
    host.send(&InfoUpdate);
    host.send(&InfoUpdate);
    assert_eq!(host.send(&InfoUpdate).header.tx_fifo, 64);
    host.pace = 150_000;
    let got = host.call(&read(3));
    assert_eq!((done(&got), got.valid().len()), (PdoOperation::READ, 3 * TX_BYTES));
    for pdo in got.valid().chunks(TX_BYTES) {
        assert_eq!(pdo[20..], [0x5A, 0x5A], "the oldest 64 are all later than the output");
    }
    // As many as the data segment holds: 46 of 22 bytes in 1024.
    assert_eq!(host.call(&read(255)).valid().len(), 46 * TX_BYTES);
    host.call(&FifoClear { fifos: Fifos::Tx });
    let got = (0..3).map(|_| host.call(&read(1))).find(|got| got.valid().is_empty()).expect("empty within a cycle");
    assert_eq!((done(&got), got.errors()), (PdoOperation::NONE, Errors::NONE));
}

/// XF-11.21 Entries are 64 at first, and hold from FIFO_INIT on; 0 and more than 128 are refused. Both FIFOs together
/// have 0x4000 bytes: beyond it FIFO_INIT fails with a FIFO error.
#[test]
fn entries_and_memory() {
    let mut host = Host::in_state(EtherCatState::Op);
    assert_eq!((host.call(&FifoGetRxCount).header.ret, host.call(&FifoGetTxCount).header.ret), (64, 64));
    host.run(&FifoSetRxCount { entries: 2 });
    host.run(&FifoSetTxCount { entries: 128 });
    assert_eq!((host.call(&FifoGetRxCount).header.ret, host.call(&FifoGetTxCount).header.ret), (2, 128));
    host.run(&FifoInit);
    let pdos = [rx(1), rx(2), rx(3)].concat();
    let got = host.call(&write(&pdos, 3));
    assert_eq!((done(&got), got.errors()), (PdoOperation::FAILED, Errors::FIFO));
    let mut host = Host::with_drives();
    for entries in [0, 129] {
        assert_eq!(host.call(&FifoSetRxCount { entries }).errors(), Errors::COMMAND);
    }

    // 128 entries of 9 drives: 128 * (54 + 90) is more than 0x4000.
    let mut host = Host::new(Profile::NEW, (0..9).map(|_| super::drive()).collect());
    host.bring_to(EtherCatState::PreOp);
    host.run(&Reconfig);
    host.run(&FifoSetRxCount { entries: 128 });
    host.run(&FifoSetTxCount { entries: 128 });
    assert_eq!(host.end(&FifoInit).errors(), Errors::FIFO | Errors::NON_IMMEDIATE);
    host.call(&FifoSetRxCount { entries: 100 });
    host.call(&FifoSetTxCount { entries: 100 });
    // 100 * 144 fits.
    host.end(&FifoInit);
    assert_eq!(done(&host.call(&write(&[0; 54], 1))), PdoOperation::WRITE);
    // A layout of process data that does not fit is a FIFO error and no failure.
    let mut host = Host::new(Profile::NEW, (0..9).map(|_| super::drive()).collect());
    host.bring_to(EtherCatState::PreOp);
    host.run(&FifoSetRxCount { entries: 128 });
    host.run(&FifoSetTxCount { entries: 128 });
    let got = host.end(&Reconfig);
    assert_eq!((got.errors(), got.has(Status::PDO_CONFIGURED)), (Errors::FIFO, true));
}

/// XF-11.22 FIFO_CLR_OP empties both FIFOs or one.
#[test]
fn clear() {
    for (fifos, rx_left, tx_left) in [(Fifos::Both, false, false), (Fifos::Tx, true, false), (Fifos::Rx, false, true)] {
        let mut host = Host::in_state(EtherCatState::Op);
        host.call(&write(&rx(1), 1));
        host.pass(50 * MS);
        host.send(&FifoClear { fifos });
        host.send(&InfoUpdate);
        let got = host.send(&InfoUpdate);
        assert_eq!((got.header.rx_fifo > 0, got.header.tx_fifo > 1), (rx_left, tx_left), "{fifos:?}");
    }
}

/// XF-11.23 PDO_DATA_OP goes past the FIFOs: outputs act from the next cycle on, inputs are the newest. "Bits are valid" comes
/// back in the return byte; without it it writes and reads.
#[test]
fn past_the_fifos() {
    let mut host = Host::in_state(EtherCatState::Op);
    let all = PdoOperation::VALID | PdoOperation::WRITE | PdoOperation::READ;
    let got = host.call(&PdoData { operation: all, data: &rx(0x0F0F) });
    assert_eq!((done(&got), got.valid().len()), (all, TX_BYTES));
    host.pass(5 * MS);
    assert_eq!(io_outputs(&mut host), 0x0F0F);
    let got = host.call(&PdoData { operation: PdoOperation::VALID | PdoOperation::READ, data: &[] });
    assert_eq!((done(&got), &got.valid()[20..]), (PdoOperation::VALID | PdoOperation::READ, &[0x0F, 0x0F][..]));
    let got = host.call(&PdoData { operation: PdoOperation::VALID | PdoOperation::WRITE, data: &rx(1) });
    assert_eq!((done(&got), got.header.len), (PdoOperation::VALID | PdoOperation::WRITE, 0));
    let got = host.call(&PdoData { operation: PdoOperation::NONE, data: &rx(2) });
    assert_eq!(done(&got), PdoOperation::WRITE | PdoOperation::READ);
    host.pass(5 * MS);
    assert_eq!(io_outputs(&mut host), 2);
}

/// XF-11.24 Process data of a wrong length, or before they are laid out, fail with bit 7 of the return value and a
/// command error.
#[test]
fn wrong_process_data() {
    for state in [EtherCatState::PreOp, EtherCatState::Op] {
        let mut host = Host::in_state(state);
        let short = &rx(1)[1..];
        let got = host.call(&write(short, 1));
        assert_eq!((done(&got), got.errors()), (PdoOperation::FAILED, Errors::COMMAND));
        let got = host.call(&write(&rx(1), 2));
        assert_eq!((done(&got), got.header.len), (PdoOperation::FAILED, 0));
        let got = host.call(&PdoData { operation: PdoOperation::NONE, data: short });
        assert_eq!(done(&got), PdoOperation::FAILED);
    }
}

/// XF-11.25 Inputs come from SafeOP on, outputs go out in OP alone.
#[test]
fn states_of_process_data() {
    let mut host = Host::in_state(EtherCatState::SafeOp);
    host.call(&FifoEnable { on: true });
    host.call(&write(&rx(7), 1));
    host.pass(10 * MS);
    host.call(&InfoUpdate);
    let got = host.call(&InfoUpdate);
    assert_eq!(got.header.rx_fifo, 1);
    assert!(got.header.tx_fifo > 0);
    assert_eq!(io_outputs(&mut host), 0);
    host.run(&to_all(EtherCatState::Op));
    host.pass(10 * MS);
    assert_eq!(io_outputs(&mut host), 7);
}

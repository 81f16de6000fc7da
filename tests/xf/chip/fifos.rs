//! Headers and return bytes of process data: the counts of the FIFOs, the outcome, and whose errors there are.

use ecmsk::xf::chip::Profile;
use ecmsk::xf::request::{
    FifoClear, FifoInit, FifoSetRxCount, FifoSetTxCount, Fifos, InfoUpdate, PdoData, PdoDataFifo, PdoOperation,
    Reconfig,
};
use ecmsk::xf::{Errors, EtherCatState, Status};

use super::{Got, Host, MS};
use crate::network::drive;

/// RxPDO of two drives (controlword and target position) and an IO module.
const RX: [u8; 14] = [0; 14];
/// TxPDO of two drives (statusword, position, torque, error code) and an IO module.
const TX_BYTES: usize = 22;

fn write(pdos: &[u8], count: u8) -> PdoDataFifo<'_> {
    PdoDataFifo { count, operation: PdoOperation::WRITE, data: pdos }
}

/// The outcome, and the present errors.
fn done(got: &Got) -> (PdoOperation, Errors) {
    (PdoOperation(got.header.ret), got.errors())
}

const WRITTEN: (PdoOperation, Errors) = (PdoOperation::WRITE, Errors::NONE);

/// XF-11.18 Counts in headers lag two exchanges behind: a write with one exchange is seen two later.
#[test]
fn counts_lag() {
    let mut host = Host::in_state(EtherCatState::Op);
    host.call(&FifoClear { fifos: Fifos::Both });
    assert_eq!(host.send(&write(&RX, 1)).header.rx_fifo, 0);
    assert_eq!(host.send(&InfoUpdate).header.rx_fifo, 0, "the answer to the write");
    assert_eq!(host.send(&InfoUpdate).header.rx_fifo, 1);
    let tx = host.send(&InfoUpdate).header.tx_fifo;
    host.pass(10 * MS);
    assert!(host.send(&InfoUpdate).header.tx_fifo.abs_diff(tx) < 2);
    assert!(host.send(&InfoUpdate).header.tx_fifo >= tx + 10);
}

/// XF-11.19 A full RxFIFO loses the new RxPDO: a FIFO error, and the answer is "failed". XF-11.21 So does one whose
/// entries FIFO_INIT has set.
#[test]
fn rx_full() {
    let full = (PdoOperation::FAILED, Errors::FIFO);
    let mut host = Host::in_state(EtherCatState::Op);
    for _ in 0..64 {
        assert_eq!(done(&host.call(&write(&RX, 1))), WRITTEN);
    }
    assert_eq!(done(&host.call(&write(&RX, 1))), full);

    let mut host = Host::in_state(EtherCatState::Op);
    host.run(&FifoSetRxCount { entries: 2 });
    host.run(&FifoInit);
    assert_eq!(done(&host.call(&write(&RX.repeat(3), 3))), full);
}

/// XF-11.20 An empty TxFIFO leaves bit 1 of the answer clear.
#[test]
fn tx_empty() {
    let mut host = Host::in_state(EtherCatState::Op);
    host.pace = 150_000;
    host.call(&FifoClear { fifos: Fifos::Tx });
    let read = PdoDataFifo { count: 1, operation: PdoOperation::READ, data: &[] };
    let mut answers = (0..3).map(|_| host.call(&read));
    let got = answers.find(|got| got.valid().is_empty()).expect("empty within a cycle");
    assert_eq!(done(&got), (PdoOperation::NONE, Errors::NONE));
}

/// XF-11.21 Both FIFOs together have 0x4000 bytes: beyond it FIFO_INIT fails with a FIFO error, and a layout of process
/// data sets that error and is valid none the less.
#[test]
fn memory() {
    // The bytes of both directions of 9 drives, 54 + 90 = 144: 128 of them are more than 0x4000, 100 are not.
    let with_entries = |entries| {
        let mut host = Host::new(Profile::NEW, (0..9).map(|_| drive()).collect());
        host.bring_to(EtherCatState::PreOp);
        host.run(&FifoSetRxCount { entries });
        host.run(&FifoSetTxCount { entries });
        let got = host.end(&Reconfig);
        assert!(got.has(Status::PDO_CONFIGURED));
        (host, got.errors())
    };
    let (mut host, errors) = with_entries(128);
    assert_eq!(errors, Errors::FIFO);
    assert_eq!(host.end(&FifoInit).errors(), Errors::FIFO | Errors::NON_IMMEDIATE);
    let (mut host, errors) = with_entries(100);
    assert_eq!(errors, Errors::NONE);
    host.run(&FifoInit);
    assert_eq!(done(&host.call(&write(&[0; 54], 1))), WRITTEN);
}

/// XF-11.23 The return byte of PDO_DATA_OP: "bits are valid" comes back in it, and without that bit it is a write and a
/// read.
#[test]
fn past_the_fifos() {
    use PdoOperation as Op;
    let mut host = Host::in_state(EtherCatState::Op);
    for (asked, data, wanted, bytes) in [
        (Op::VALID | Op::WRITE | Op::READ, &RX[..], Op::VALID | Op::WRITE | Op::READ, TX_BYTES),
        (Op::VALID | Op::READ, &[], Op::VALID | Op::READ, TX_BYTES),
        (Op::VALID | Op::WRITE, &RX, Op::VALID | Op::WRITE, 0),
        (Op::NONE, &RX, Op::WRITE | Op::READ, TX_BYTES),
    ] {
        let got = host.call(&PdoData { operation: asked, data });
        assert_eq!(done(&got), (wanted, Errors::NONE), "{asked:?}");
        assert_eq!(got.valid().len(), bytes, "{asked:?}");
    }
}

/// XF-11.24 Process data of a wrong length, or before they are laid out, fail with bit 7 of the return value and a
/// command error.
#[test]
fn wrong_process_data() {
    let failed = (PdoOperation::FAILED, Errors::COMMAND);
    let short = &RX[1..];
    for state in [EtherCatState::PreOp, EtherCatState::Op] {
        assert_eq!(done(&Host::in_state(state).call(&write(short, 1))), failed, "{state:?}");
        let got = Host::in_state(state).call(&write(&RX, 2));
        assert_eq!(done(&got), failed, "{state:?}");
        assert_eq!(got.header.len, 0, "{state:?}");
        let past = PdoData { operation: PdoOperation::NONE, data: short };
        assert_eq!(done(&Host::in_state(state).call(&past)), failed, "{state:?}");
    }
}

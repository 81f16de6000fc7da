//! Process data through the FIFOs and past them.

use ecmsk::xf::chip::Profile;
use ecmsk::xf::host::{HostConfig, HostError, ProcessOutcome, ProcessRequest};
use ecmsk::xf::request::{
    FifoClear, FifoEnable, FifoGetRxCount, FifoGetTxCount, FifoInit, FifoSetRxCount, FifoSetTxCount, FifoThresholdSet,
    Fifos, InfoUpdate,
};
use ecmsk::xf::{EtherCatState, Interrupts, Status};

use super::{INIT, MS, Pair, to_all};

/// RxPDO of two drives (controlword and target position) and an IO module.
const RX_BYTES: usize = 14;
/// TxPDO of two drives (statusword, position, torque, error code) and an IO module.
const TX_BYTES: usize = 22;
const READ: ProcessOutcome = ProcessOutcome::Done { read: true };
const NOT_READ: ProcessOutcome = ProcessOutcome::Done { read: false };

/// An RxPDO whose IO outputs are `n`.
fn rx(n: u16) -> [u8; RX_BYTES] {
    let mut pdo = [0; RX_BYTES];
    pdo[12..].copy_from_slice(&n.to_le_bytes());
    pdo
}

/// The IO module's inputs in a TxPDO, which are wired to its outputs.
fn io_inputs(tx: &[u8]) -> u16 {
    u16::from_le_bytes([tx[20], tx[21]])
}

/// The IO module's outputs, cycle by cycle, without an exchange.
fn outputs_of(pair: &mut Pair, cycles: usize) -> Vec<u32> {
    (0..cycles)
        .map(|_| {
            pair.now += MS;
            let now = pair.now;
            pair.chip().run_until(now);
            pair.io_outputs()
        })
        .collect()
}

/// XF-13.1 XF-11.17 FIFO_ENABLE (XF EN 674): off, RxPDOs are kept; on, one goes out in each cycle, and the newest stays
/// when there is none. PDO_DATA_FIFO_OP (XF EN 436) with one RxPDO and with several.
#[test]
pub fn rx_fifo() {
    let mut pair = Pair::in_state(EtherCatState::Op);
    assert_eq!(pair.process(ProcessRequest::Write { count: 1, outputs: &rx(1) }), NOT_READ);
    let outputs = [rx(2), rx(3), rx(4)].concat();
    assert_eq!(pair.process(ProcessRequest::Write { count: 3, outputs: &outputs }), NOT_READ);
    assert_eq!((pair.header().rx_fifo, pair.io_outputs()), (4, 0));
    pair.run(&FifoEnable { on: true });
    assert!(pair.header_now().status.contains(Status::FIFO_ON));
    let mut seen = outputs_of(&mut pair, 10);
    assert_eq!(seen[4..], [4; 6], "the newest is repeated");
    seen.dedup();
    assert!([1, 2, 3, 4].ends_with(&seen) && seen.len() > 1, "{seen:?}");
    assert_eq!(pair.header().rx_fifo, 0);
    pair.run(&FifoEnable { on: false });
    pair.process(ProcessRequest::Write { count: 1, outputs: &rx(9) });
    let header = pair.header();
    assert_eq!((header.rx_fifo, header.status.contains(Status::FIFO_ON)), (1, false));
    assert_eq!(pair.io_outputs(), 4);
}

/// XF-13.1 XF-11.20 PDO_DATA_FIFO_OP (XF EN 436) reads TxPDOs in order, one or several, and reports when there is none;
/// they answer the RxPDOs that were sent.
#[test]
pub fn tx_fifo() {
    let mut pair = Pair::in_state(EtherCatState::Op);
    pair.run(&FifoEnable { on: true });
    pair.run(&FifoClear { fifos: Fifos::Both });
    let outputs: Vec<u8> = (1..=40).flat_map(rx).collect();
    assert!(matches!(
        pair.process(ProcessRequest::Exchange { count: 40, outputs: &outputs }),
        ProcessOutcome::Done { .. }
    ));
    pair.pass(60 * MS);
    assert_eq!(pair.process(ProcessRequest::Read { count: 3 }), READ);
    let mut read = pair.host.inputs().to_vec();
    assert_eq!(read.len(), 3 * TX_BYTES);
    assert_eq!(pair.process(ProcessRequest::Read { count: 255 }), READ);
    read.extend(pair.host.inputs());
    assert_eq!(read.len(), (3 + 46) * TX_BYTES, "as many whole ones as 1024 bytes hold");
    let mut inputs: Vec<u16> = read.chunks(TX_BYTES).map(io_inputs).collect();
    assert!(inputs.is_sorted(), "the oldest first: {inputs:?}");
    inputs.dedup();
    assert!(inputs.len() >= 39, "{inputs:?}");

    // With short packets the FIFO is read faster than cycles fill it.
    let mut pair = Pair::running_with(Profile::OLD, HostConfig::DEFAULT, vec![super::drive()]);
    pair.bring_to(EtherCatState::Op);
    pair.run(&FifoClear { fifos: Fifos::Tx });
    let read = (0..30).map(|_| pair.process(ProcessRequest::Read { count: 3 })).collect::<Vec<_>>();
    assert!(read.contains(&READ) && read.contains(&NOT_READ), "{read:?}");
}

/// XF-13.1 XF-11.19 XF-11.20 A full TxFIFO loses the oldest (XF EN 1236), and a full RxFIFO the new one (XF EN 1262).
/// The driver writes no more than it has room for; a chip with fewer entries than configured in the driver reports
/// that.
#[test]
fn full_fifos() {
    let mut pair = Pair::in_state(EtherCatState::Op);
    for n in 0..64 {
        assert_eq!(pair.process(ProcessRequest::Write { count: 1, outputs: &rx(n) }), NOT_READ);
    }
    assert_eq!(pair.host.rx_free(), 0);
    let refused = pair.host.process(ProcessRequest::Write { count: 1, outputs: &rx(64) });
    assert_eq!(refused, Err(HostError::FifoFull { needed: 1, free: 0 }));
    let header = pair.header();
    assert_eq!((header.rx_fifo, header.tx_fifo), (64, 64));
    pair.run(&FifoEnable { on: true });
    pair.pass(200 * MS);
    assert_eq!(pair.io_outputs(), 63);
    pair.process(ProcessRequest::Read { count: 1 });
    assert_eq!(io_inputs(pair.host.inputs()), 63, "the older ones are lost");

    let config = HostConfig { rx_entries: 128, ..HostConfig::DEFAULT };
    let mut pair = Pair::running_with(Profile::NEW, config, super::drives_and_io());
    pair.bring_to(EtherCatState::Op);
    let outcomes: Vec<_> = (0..66).map(|n| pair.process(ProcessRequest::Write { count: 1, outputs: &rx(n) })).collect();
    assert_eq!(outcomes[..64], [NOT_READ; 64]);
    assert_eq!(outcomes[64..], [ProcessOutcome::Full; 2]);
    assert_eq!(pair.host.counters().rx_full, 2);
    pair.run(&FifoEnable { on: true });
    pair.pass(100 * MS);
    assert_eq!(pair.io_outputs(), 63);
}

/// XF-13.1 XF-11.22 FIFO_CLR_OP (XF EN 1224) empties both FIFOs, 0, the TxFIFO, 1, or the RxFIFO, 2.
#[test]
pub fn clear() {
    for (fifos, rx_left, tx_left) in [(Fifos::Both, false, false), (Fifos::Tx, true, false), (Fifos::Rx, false, true)] {
        let mut pair = Pair::in_state(EtherCatState::Op);
        pair.process(ProcessRequest::Write { count: 1, outputs: &rx(1) });
        pair.pass(100 * MS);
        pair.run(&FifoClear { fifos });
        let header = pair.header();
        assert_eq!((header.rx_fifo > 0, header.tx_fifo > 60), (rx_left, tx_left), "{fifos:?}");
    }
}

/// XF-13.1 XF-11.21 FIFO_SET_TX_CNT and _RX_CNT (XF EN 1236, 1262) set entries, which FIFO_GET_TX_CNT and _RX_CNT (XF
/// EN 1249, 1273) tell, 64 at first; they hold from FIFO_INIT (XF EN 1345) on.
#[test]
pub fn entries() {
    let mut pair = Pair::in_state(EtherCatState::Op);
    let set = |pair: &mut Pair| (pair.get(&FifoGetRxCount, |n| n), pair.get(&FifoGetTxCount, |n| n));
    assert_eq!(set(&mut pair), (64, 64));
    pair.run(&FifoSetRxCount { entries: 2 });
    pair.run(&FifoSetTxCount { entries: 100 });
    assert_eq!(set(&mut pair), (2, 100));
    pair.pass(200 * MS);
    assert_eq!(pair.header().tx_fifo, 64, "not yet");
    pair.run(&FifoInit);
    pair.pass(200 * MS);
    assert_eq!(pair.header().tx_fifo, 100);
    assert_eq!(pair.process(ProcessRequest::Write { count: 2, outputs: &[0; 2 * RX_BYTES] }), NOT_READ);
    pair.header();
    assert_eq!(pair.host.rx_free(), 0, "the driver goes by it");
    for entries in [0, 129] {
        pair.is_refused(&FifoSetRxCount { entries });
    }
    // A failure of a non-immediate command: 128 entries of 9 drives, 128 * (54 + 90) bytes, are more than 0x4000.
    let drives = (0..9).map(|_| super::drive()).collect();
    let mut pair = Pair::running_with(Profile::NEW, HostConfig::DEFAULT, drives);
    pair.bring_to(EtherCatState::SafeOp);
    pair.run(&FifoSetRxCount { entries: 128 });
    pair.run(&FifoSetTxCount { entries: 128 });
    pair.ends_in_failure(&FifoInit);
}

/// XF-13.1 XF-11.49 SET_FIFO_TH (XF EN 1374): interrupt flags 24 and 25 come with the step of the TxFIFO up to its
/// limit, and of the RxFIFO down to its, and not again as long as both stay there.
#[test]
pub fn thresholds() {
    const BOTH: Interrupts = Interrupts(Interrupts::TX_FIFO_HIGH.0 | Interrupts::RX_FIFO_LOW.0);
    for limits in [true, false] {
        let mut pair = Pair::in_state(EtherCatState::Op);
        let limit = |n: u8| limits.then_some(n);
        let or_none = |flags| if limits { flags } else { Interrupts::NONE };
        let flags = |pair: &mut Pair| Interrupts(pair.header_now().interrupts.0 & BOTH.0);
        pair.run(&FifoClear { fifos: Fifos::Both });
        pair.run(&FifoThresholdSet { tx_high: limit(60), rx_low: limit(3) });
        pair.process(ProcessRequest::Write { count: 5, outputs: &[0; 5 * RX_BYTES] });
        assert_eq!(flags(&mut pair), Interrupts::NONE);
        pair.run(&FifoEnable { on: true });
        pair.pass(10 * MS);
        assert_eq!(flags(&mut pair), or_none(Interrupts::RX_FIFO_LOW));
        pair.pass(100 * MS);
        assert_eq!(flags(&mut pair), or_none(BOTH));
        pair.host.clear_interrupts(BOTH, 0);
        pair.run(&InfoUpdate);
        pair.pass(50 * MS);
        assert_eq!(flags(&mut pair), Interrupts::NONE);
    }
}

/// XF-13.1 XF-11.23 PDO_DATA_OP (XF EN 452) goes past the FIFOs: outputs act at once, inputs are the newest.
#[test]
pub fn past_the_fifos() {
    let mut pair = Pair::in_state(EtherCatState::Op);
    assert_eq!(pair.process(ProcessRequest::DirectExchange { outputs: &rx(0x0F0F) }), READ);
    assert_eq!(pair.host.inputs().len(), TX_BYTES);
    pair.pass(5 * MS);
    assert_eq!(pair.io_outputs(), 0x0F0F);
    assert_eq!(pair.process(ProcessRequest::DirectRead), READ);
    assert_eq!(io_inputs(pair.host.inputs()), 0x0F0F);
    assert_eq!(pair.header().rx_fifo, 0);
}

/// XF-13.1 XF-11.24 Process data of a wrong length, or before they are laid out, are refused, and it is reported.
#[test]
fn wrong_process_data() {
    let mut pair = Pair::running();
    pair.run(&INIT);
    assert_eq!(pair.process(ProcessRequest::DirectRead), ProcessOutcome::Refused);
    let mut pair = Pair::in_state(EtherCatState::Op);
    let short = &rx(1)[1..];
    assert_eq!(pair.process(ProcessRequest::Write { count: 1, outputs: short }), ProcessOutcome::Refused);
    assert_eq!(pair.process(ProcessRequest::Exchange { count: 2, outputs: &rx(1) }), ProcessOutcome::Refused);
    assert_eq!(pair.process(ProcessRequest::DirectExchange { outputs: short }), ProcessOutcome::Refused);
}

/// XF-11.25 Inputs come from SafeOP on, outputs go out in OP alone.
#[test]
fn states_of_process_data() {
    let mut pair = Pair::in_state(EtherCatState::SafeOp);
    pair.run(&FifoEnable { on: true });
    assert_eq!(pair.process(ProcessRequest::Write { count: 1, outputs: &rx(7) }), NOT_READ);
    let header = pair.header();
    assert_eq!(header.rx_fifo, 1);
    assert!(header.tx_fifo > 0);
    assert_eq!(pair.io_outputs(), 0);
    pair.run(&to_all(EtherCatState::Op));
    pair.pass(10 * MS);
    assert_eq!(pair.io_outputs(), 7);
}

//! The usual start of an application, and drives along a path by process data.

use ecmsk::cia402::DriveState;
use ecmsk::coe::ObjectAddress;
use ecmsk::ethercat::Ns;
use ecmsk::xf::chip::Profile;
use ecmsk::xf::host::{Budget, HostConfig, ProcessOutcome, ProcessRequest};
use ecmsk::xf::request::{
    DcTiming, EcatInit, Fifo, FifoClear, FifoEnable, FifoPackSizeGet, Fifos, HelperConfigSet, HelperControl,
    HelperStateGet, HelperStateSet, MappedObject, PdoAssignment, PdoConfigSet, PdoMap, PdoWorkingCounterGet, Reconfig,
    SlaveCountGet, SlaveInfoGet, SlaveInfoItem, WorkingCounterItem,
};
use ecmsk::xf::{DataSize, EtherCatState, NetworkState, Status};

use super::{INIT, MS, Pair, S, drive, to_all};
use crate::{motor, slave};

/// Controlword and target position; statusword and actual position.
const PDO: usize = 6;
/// The cycle of the network, and of the program.
const CYCLE: Ns = 2 * MS;

/// The RxPDO of both drives, whose controlwords the helper makes.
fn targets(positions: [i64; 2]) -> [u8; 2 * PDO] {
    let mut rx = [0; 2 * PDO];
    for (axis, position) in rx.chunks_exact_mut(PDO).zip(positions) {
        axis[2..].copy_from_slice(&(position as i32).to_le_bytes());
    }
    rx
}

/// The positions in a TxPDO.
fn positions(tx: &[u8]) -> [i64; 2] {
    [0, 1].map(|n| i32::from_le_bytes(tx[PDO * n + 2..][..4].try_into().expect("4 bytes")).into())
}

/// The real positions of the shafts.
fn shafts(pair: &mut Pair) -> [i64; 2] {
    [0, 1].map(|n| pair.chip().network().slave(n).and_then(|slave| slave.shaft(0)).expect("an axis"))
}

/// Position and statusword; position and controlword.
fn map(pair: &mut Pair, n: u8) {
    for (assignment, index, objects) in
        [(PdoAssignment::Rx, 0x1600, [0x6040, 0x607A]), (PdoAssignment::Tx, 0x1A00, [0x6041, 0x6064])]
    {
        let [word, position] = objects.map(|index| ObjectAddress::new(index, 0));
        let objects = [MappedObject::new(word, 16), MappedObject::new(position, 32)];
        let maps = [PdoMap::new(index, &objects).expect("2 objects")];
        pair.run(&PdoConfigSet::new(slave(n), assignment, &maps).expect("1 PDO"));
    }
}

/// The usual start (OBS), step by step, to two drives that are in Operation enabled at their old positions.
fn start(profile: Profile, config: HostConfig) -> Pair {
    // Data size, CRC-32, version, INFO_UPDATE until not busy, FIFO off and clear are the driver's own start.
    let mut pair = Pair::running_with(profile, config, vec![drive(), drive()]);
    let header = pair.header();
    assert_eq!((header.status.0 & 3, header.state), (3, NetworkState::NONE));
    assert!(!header.status.contains(Status::FIFO_ON) && !header.status.contains(Status::BUSY));

    let dc = DcTiming { sync0_ns: CYCLE as u32, ..INIT.dc };
    pair.run(&EcatInit { dc, ..INIT });
    assert_eq!(pair.get(&SlaveCountGet, |count| count), 2);
    pair.run(&to_all(EtherCatState::PreOp));
    for n in 0..2 {
        pair.write(n, 0x6060, 0, &[8]);
        map(&mut pair, n);
    }
    pair.run(&Reconfig);
    pair.run(&to_all(EtherCatState::SafeOp));
    assert!(pair.has(Status::DC_STABLE) && pair.has(Status::PDO_CONFIGURED));
    for n in 0..2 {
        pair.run(&HelperConfigSet {
            motor: motor(n),
            controlword_offset: 0,
            statusword_offset: 0,
            control: HelperControl::ON | HelperControl::RESET_ONCE,
            slave: slave(n),
        });
    }
    for fifo in [Fifo::Rx, Fifo::Tx] {
        assert_eq!(pair.get(&FifoPackSizeGet { fifo }, usize::from), 2 * PDO);
    }
    assert_eq!(pair.process(ProcessRequest::DirectRead), ProcessOutcome::Done { read: true });
    let found = positions(pair.host.inputs());
    assert_eq!(found, shafts(&mut pair));
    pair.process(ProcessRequest::DirectExchange { outputs: &targets(found) });
    pair.run(&to_all(EtherCatState::Op));
    pair.run(&FifoEnable { on: true });
    for n in 0..2 {
        pair.run(&HelperStateSet { motor: motor(n), state: DriveState::OperationEnabled });
    }
    pair.pass(S);
    for n in 0..2 {
        let state = pair.get(&HelperStateGet { motor: motor(n) }, |state| state.state());
        assert_eq!(state, Some(DriveState::OperationEnabled));
    }
    assert_eq!(shafts(&mut pair), found, "nothing has moved");
    pair
}

/// A cosine ramp from the drives' positions to `[distance, -2 * distance]` counts further, in that many cycles.
fn path(from: [i64; 2], distance: i64, cycles: u32) -> impl Iterator<Item = [i64; 2]> {
    (1..=cycles).map(move |n| {
        let part = (1.0 - (std::f64::consts::PI * f64::from(n) / f64::from(cycles)).cos()) / 2.0;
        let moved = (distance as f64 * part).round() as i64;
        [from[0] + moved, from[1] - 2 * moved]
    })
}

/// Exchanges one RxPDO and one TxPDO a cycle along a path; returns the targets and the positions.
fn run(pair: &mut Pair, targets_of: impl Iterator<Item = [i64; 2]>) -> Vec<([i64; 2], [i64; 2])> {
    let mut seen = Vec::new();
    let mut next = pair.now;
    for target in targets_of {
        next += CYCLE;
        pair.pass(next.saturating_sub(pair.now));
        let rx = targets(target);
        match pair.process(ProcessRequest::Exchange { count: 1, outputs: &rx }) {
            ProcessOutcome::Done { read: true } => seen.push((target, positions(pair.host.inputs()))),
            ProcessOutcome::Done { read: false } => {}
            other => panic!("{other:?}"),
        }
        assert!(pair.now < next + CYCLE, "the cycle is held");
    }
    seen
}

/// Checks that the drives follow a path within some cycles of its fastest part, stop at its end, and report their
/// positions.
fn follows(pair: &mut Pair, distance: i64, cycles: u32) {
    // Old TxPDOs in the FIFO would delay the positions by as many cycles.
    pair.run(&FifoClear { fifos: Fifos::Both });
    let from = shafts(pair);
    let seen = run(pair, path(from, distance, cycles));
    assert!(seen.len() as u32 > cycles * 9 / 10, "{} of {cycles}", seen.len());
    // A ramp is fastest in its middle, pi / 2 times the mean. The entries of both FIFOs and the drive's own loop add a
    // delay.
    let fastest = (std::f64::consts::PI / 2.0 * distance as f64 / f64::from(cycles)).abs();
    let lag = (12.0 * fastest) as i64 + 20;
    for (target, position) in &seen {
        assert!((target[0] - position[0]).abs() <= lag, "{target:?} {position:?} {lag}");
        assert!((target[1] - position[1]).abs() <= 2 * lag, "{target:?} {position:?} {lag}");
    }
    pair.pass(200 * MS);
    let end = shafts(pair);
    assert!((end[0] - from[0] - distance).abs() < 10 && (end[1] - from[1] + 2 * distance).abs() < 10, "{end:?}");
    pair.process(ProcessRequest::DirectRead);
    assert_eq!(positions(pair.host.inputs()), end);
}

/// XF-13.3 XF-11.58 The usual start of an application, step by step, with a size that was chosen for the cycle: two
/// drives with distributed clocks follow a path, there and back.
#[test]
fn two_drives_follow_a_path() {
    let budget =
        Budget { process_bytes: 2 * PDO, clock_hz: 24_000_000, idle_ns: 150_000, cycle_ns: CYCLE, exchanges: 2 };
    let wanted_size = Some(budget.choose_size().expect("it fits"));
    let mut pair = start(Profile::NEW, HostConfig { wanted_size, ..HostConfig::DEFAULT });
    assert_eq!(pair.host.size(), DataSize::MANUAL);
    for distance in [5_000, -5_000] {
        follows(&mut pair, distance, 500);
    }
    let active = SlaveInfoGet { slave: slave(1), item: SlaveInfoItem::DcActive };
    assert_eq!(pair.get(&active, |item| item.number()), Some(1));
    // Inputs + 2 * outputs of two drives.
    let counter = PdoWorkingCounterGet { which: WorkingCounterItem::Counter };
    assert_eq!(pair.get(&counter, |counter| counter), 6);
    let header = pair.header();
    assert_eq!((header.wkc_errors, header.state), (0, EtherCatState::Op.into()));
    let counters = pair.host.counters();
    assert_eq!((counters.rx_full, counters.rx_dropped, counters.rx_unknown, counters.tx_lost), (0, 0, 0, 0));
}

/// XF-13.3 The same with older firmware, which has n = 112 and does not know the bit for LRW, with one write an exchange,
/// and with an ECM-XFU.
#[test]
fn two_drives_follow_a_path_with_other_chips() {
    for (profile, pipelined_writes, n) in
        [(Profile::OLD, false, 112), (Profile::OLD, true, 112), (Profile::XFU, false, 992)]
    {
        let mut pair = start(profile, HostConfig { pipelined_writes, ..HostConfig::DEFAULT });
        let version = pair.host.version().expect("it runs").version;
        assert_eq!((pair.host.size().bytes(), version), (n, profile.version));
        follows(&mut pair, 3_000, 400);
        assert_eq!(pair.header().wkc_errors, 0);
    }
}

/// XF-13.4 The RxFIFO runs empty in the middle of a path: the drives go to the newest target and stand there, each
/// cycle sends it again, and they go on when the FIFO is filled again, first with it off and then on.
#[test]
fn the_fifo_runs_empty() {
    let mut pair = start(Profile::NEW, HostConfig::DEFAULT);
    pair.run(&FifoClear { fifos: Fifos::Both });
    let from = shafts(&mut pair);
    let whole: Vec<_> = path(from, 2_000, 300).collect();
    run(&mut pair, whole[..150].iter().copied());
    pair.pass(300 * MS);
    assert_eq!(pair.header().rx_fifo, 0);
    let [x, y] = shafts(&mut pair);
    assert!((x - whole[149][0]).abs() < 10 && (y - whole[149][1]).abs() < 10, "{x} {y}");
    // Outputs were sent all the time: otherwise the drives' watchdogs would have expired.
    assert_eq!((pair.header().wkc_errors, pair.header().state), (0, EtherCatState::Op.into()));

    pair.run(&FifoEnable { on: false });
    let rest: Vec<u8> = whole[150..].iter().flat_map(|target| targets(*target)).collect();
    for pdos in rest.chunks(30 * 2 * PDO).take(2) {
        pair.process(ProcessRequest::Write { count: 30, outputs: pdos });
    }
    pair.pass(100 * MS);
    assert_eq!((pair.header().rx_fifo, shafts(&mut pair)), (60, [x, y]), "filled, and nothing moves");
    pair.run(&FifoEnable { on: true });
    for pdos in rest.chunks(30 * 2 * PDO).skip(2) {
        pair.until("room in the FIFO", |host| host.rx_free() >= 30);
        let written = pair.process(ProcessRequest::Write { count: 30, outputs: pdos });
        assert_eq!(written, ProcessOutcome::Done { read: false });
    }
    pair.pass(300 * MS);
    let [x, y] = shafts(&mut pair);
    assert!((x - from[0] - 2_000).abs() < 10 && (y - from[1] + 4_000).abs() < 10, "{x} {y}");
}

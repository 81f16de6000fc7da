//! From the scan to OP, and refusals of slaves.

use ecmsk::cia402::Controlword;
use ecmsk::coe::{ObjectAddress, SdoScope};
use ecmsk::ethercat::registers::{AlStatusRegister, Features, RequestedState};
use ecmsk::ethercat::sii::MailboxProtocols;
use ecmsk::ethercat::{AlState, AlStatus, SlaveSet};
use ecmsk::fieldbus::{SlaveIn, SlaveOut};
use ecmsk::master::{ConfigureError, Event, Master, Settings, StateError, StateReason};
use ecmsk::slave::esc::{Chain, EscSettings};
use support::blob::Blob;

use super::rig::{CYCLE, MS, Rig, SECOND, device, kinds, process_data, slave};

/// MASTER-2.1 The scan finds all slaves, gives them station addresses and reads their identity.
#[test]
fn the_scan_reads_who_slaves_are() {
    let kinds = ["drive", "io", "dp3cl", "hsp2"];
    let rig = Rig::scanned(&kinds);
    for (n, (info, kind)) in rig.master.slaves().iter().zip(kinds).enumerate() {
        assert_eq!(info.station, 0x1001 + n as u16);
        assert_eq!(info.name, device(kind).name());
        let (identity, serial) = device(kind).identity().map(|(identity, serial)| (*identity, serial)).expect("one");
        assert_eq!((info.identity.vendor, info.identity.product), (identity.vendor_id, identity.product_code));
        assert_eq!((info.identity.revision, info.identity.serial), (identity.revision, serial));
        let mailbox = info.mailbox.expect("a mailbox");
        assert_eq!((mailbox.areas.receive.start, mailbox.areas.receive.len), (0x1000, 128));
        assert!(mailbox.protocols.contains(MailboxProtocols::COE));
        assert_eq!((info.outputs.len(), info.inputs.len(), info.fmmus), (1, 1, 8));
    }
}

/// A network without slaves, or without a cable, has none.
#[test]
fn no_slaves_are_found_where_there_are_none() {
    assert_eq!(Rig::line(&[]).scan(), 0);
    let mut rig = Rig::line(&["drive"]);
    rig.net.chain.connect(0, false);
    assert_eq!(rig.scan(), 0);
    rig.net.chain.connect(0, true);
    assert_eq!(rig.scan(), 1);
}

/// A second master that has joined sends nothing by itself, and both read correctly in turns.
#[test]
fn a_network_is_joined() {
    let mut rig = Rig::scanned(&["drive", "io"]);
    rig.reach(AlState::PreOp);
    let mut other = Master::new(Settings::default());
    let found = rig.master.slaves().iter().map(|slave| (slave.station, slave.eeprom.as_deref().expect("an EEPROM")));
    other.join(found);
    assert_eq!(other.slaves().iter().map(|slave| &*slave.name).collect::<Vec<_>>(), ["drive", "io"]);
    for n in 0..20 {
        assert!(rig.upload(1, 0x1018, 1).is_ok(), "the first master, {n}");
        std::mem::swap(&mut rig.master, &mut other);
        if n == 0 {
            rig.run_for(SECOND);
            assert_eq!(rig.master.counters().sent, 0);
        }
        // Twice, so that one of them has the counter that the first master has next.
        assert!(rig.upload(1, 0x1018, 2).is_ok() && rig.upload(1, 0x1018, 3).is_ok(), "the one that has joined, {n}");
        std::mem::swap(&mut rig.master, &mut other);
    }
    assert_eq!(rig.master.status(1).and_then(|status| status.state()), Some(AlState::PreOp));
}

/// MASTER-2.3 Slaves whose EEPROM gives 4 bytes a read, or takes its time, are read like others.
#[test]
fn slow_eeproms_are_read() {
    let quick = Rig::scanned(&["drive"]);
    let settings = EscSettings { reads_8_bytes: false, eeprom_ns: 3 * MS, ..EscSettings::default() };
    let chain = Chain::line([slave("drive", settings)]);
    let mut slow = Rig::of(chain);
    assert_eq!(slow.scan(), 1);
    let [quick, slow] = [&quick, &slow].map(|rig| rig.master.slave(1).expect("one").clone());
    assert_eq!(quick, slow);
}

/// MASTER-3.1 Slaves of every kind, from 1 to 40 of them, are brought to OP; then each counts in the working counter.
#[test]
fn slaves_are_brought_to_op() {
    for count in [1, 2, 7, 40] {
        let kinds = kinds(count);
        let mut rig = Rig::in_op(&kinds);
        rig.run_for(10 * CYCLE);
        let expected = 3 * count as u16;
        assert_eq!((rig.last.working_counter, rig.last.expected_working_counter), (expected, expected));
        assert_eq!((rig.last.present, rig.last.all_in_op, rig.last.lost), (Some(count as u16), true, 0));
        assert!(rig.last.short.is_empty() && rig.master.missing().is_empty());
        for n in 0..count {
            assert_eq!(rig.net.chain.slave(n).state(), AlState::Op);
            assert_eq!(rig.master.status(n as u8 + 1).expect("one").state(), Some(AlState::Op));
        }
        assert_eq!(rig.master.take_event(), None);
        let counters = rig.master.counters();
        assert_eq!((counters.lost, counters.late, counters.doubled, counters.mismatched), (0, 0, 0, 0));
    }
}

/// MASTER-4.1 Outputs reach their slaves and inputs come back: axes of all kinds follow their targets.
#[test]
fn axes_follow_their_targets() {
    let kinds = ["drive", "step", "dp3cl", "hsp", "hsp2"];
    let mut rig = Rig::in_op(&kinds);
    let mut outputs = [SlaveOut::default(); 5];
    let mut inputs = [SlaveIn::default(); 5];
    for turn in 0..1500 {
        for (n, kind) in kinds.iter().enumerate() {
            let (data, slave) = (process_data(kind), n as u8 + 1);
            data.take_inputs(rig.master.inputs(slave).expect("inputs"), &mut inputs[n]);
            for (output, input) in outputs[n].iter_mut().zip(&inputs[n]) {
                output.controlword = Controlword([0x06, 0x07, 0x0F][(turn / 100).min(2)]);
                output.target = if turn < 500 { input.position } else { output.target + 5 };
            }
            data.put_outputs(&outputs[n], rig.master.outputs_mut(slave).expect("outputs"));
        }
        rig.run_for(CYCLE);
    }
    for ((kind, outputs), inputs) in kinds.iter().zip(outputs).zip(inputs) {
        let axes = process_data(kind).axes();
        for (output, input) in outputs.iter().zip(&inputs).take(axes) {
            assert_eq!(input.statusword.0 & 0x6F, 0x27, "{kind}: {input:?}");
            let behind = output.target - input.position;
            assert!(input.position > 3000 && behind.abs() < 1000, "{kind}: {output:?} {input:?}");
        }
    }
}

/// MASTER-3.2 A slave that refuses a state is named with its AL status code, and the others reach it.
#[test]
fn a_slave_that_refuses_is_named() {
    let mut rig = Rig::scanned(&["drive", "io", "drive"]);
    rig.reach(AlState::PreOp);
    for slave in [1, 3] {
        rig.master.configure_as_described(slave).expect("it is described");
    }
    // This is longer than the mapping.
    rig.master.configure(2, 4, 2).expect("it has sync managers");
    let state = RequestedState::State(AlState::PreOp);
    let reason = StateReason::Refused { state, code: AlStatus::INVALID_OUTPUTS };
    let error = StateError { slave: 2, target: AlState::SafeOp, reason };
    assert_eq!(rig.request(rig.all(), AlState::SafeOp), Err(error));
    for (n, state) in [AlState::SafeOp, AlState::PreOp, AlState::SafeOp].into_iter().enumerate() {
        assert_eq!(rig.net.chain.slave(n).state(), state);
    }
    // The error is acknowledged with the next request.
    rig.master.configure(2, 2, 2).expect("it has sync managers");
    rig.reach(AlState::SafeOp);
}

/// MASTER-3.3 Single slaves change their state while others stay in OP, up, down, and more than a step at once.
#[test]
fn single_slaves_change_their_state_beside_others_in_op() {
    let mut rig = Rig::in_op(&["drive", "io", "drive"]);
    let second: SlaveSet = [2].into_iter().collect();
    for target in [AlState::SafeOp, AlState::Op, AlState::PreOp, AlState::Op, AlState::Init, AlState::PreOp] {
        assert_eq!(rig.request(second, target), Ok(()));
        rig.run_for(3 * CYCLE);
        assert_eq!(rig.net.chain.slave(1).state(), target);
        assert_eq!([0, 2].map(|n| rig.net.chain.slave(n).state()), [AlState::Op; 2]);
        let expected = if target >= AlState::SafeOp { 9 } else { 6 };
        assert_eq!((rig.last.working_counter, rig.last.expected_working_counter), (expected, expected));
    }
    assert_eq!(rig.master.take_event(), None);
}

/// A change of state ends at its timeout: a slave that gets no outputs does not enter OP.
#[test]
fn a_change_of_state_ends_when_its_time_is_up() {
    let mut rig = Rig::scanned(&["drive"]);
    rig.master.configure_as_described(1).expect("it is described");
    rig.reach(AlState::SafeOp);
    let id = rig.master.request_state(rig.all(), AlState::Op, 100 * MS);
    let begin = rig.net.now;
    let state = RequestedState::State(AlState::SafeOp);
    let error = StateError { slave: 1, target: AlState::Op, reason: StateReason::TimeUp { state } };
    assert_eq!(rig.wait(id), Err(error));
    assert!((100 * MS..110 * MS).contains(&(rig.net.now - begin)));
}

/// A slave that leaves its state is reported with its AL status code: here its outputs have stopped.
#[test]
fn a_slave_that_leaves_its_state_is_told_of() {
    let mut rig = Rig::in_op(&["drive", "drive"]);
    rig.next_cycle = None;
    rig.run_for(300 * MS);
    let status = AlStatusRegister::of(RequestedState::State(AlState::SafeOp)).with(AlStatusRegister::ERROR);
    let mut told: Vec<_> = std::iter::from_fn(|| rig.master.take_event()).collect();
    told.sort_by_key(|event| matches!(event, Event::Status { slave: 2, .. }));
    let event = |slave| Event::Status { slave, status, code: AlStatus::WATCHDOG };
    assert_eq!(told, [event(1), event(2)]);
    // The error is acknowledged on the way back.
    rig.next_cycle = Some(rig.net.now);
    rig.reach(AlState::Op);
}

/// Impossible process data are refused before anything is sent.
#[test]
fn process_data_that_cannot_be_are_refused() {
    let mut rig = Rig::scanned(&["drive"]);
    assert_eq!(rig.master.configure(2, 1, 1), Err(ConfigureError::NoSlave(2)));
    assert_eq!(rig.master.configure(0, 1, 1), Err(ConfigureError::NoSlave(0)));
    let error = ConfigureError::TooLong { slave: 1, bytes: 1453 };
    assert_eq!(rig.master.configure(1, 1453, 0), Err(error));
    let mut rig = Rig::in_op(&["drive"]);
    assert_eq!(rig.master.configure(1, 1, 1), Err(ConfigureError::Active(1)));
}

/// MASTER-4.5 Slaves without LRW are read and written by LRD and LWR beside others.
#[test]
fn slaves_without_lrw_share_lrd_and_lwr() {
    let features = EscSettings::default().features | Features::NO_LRW;
    let kinds = ["io", "drive", "io", "hsp"];
    let chain = Chain::line(kinds.iter().enumerate().map(|(n, kind)| {
        let settings = if n < 2 { EscSettings { features, ..EscSettings::default() } } else { EscSettings::default() };
        slave(kind, settings)
    }));
    let mut rig = Rig::of(chain);
    rig.scan();
    assert_eq!(rig.master.slaves().iter().map(|slave| slave.lacks_lrw).collect::<Vec<_>>(), [true, true, false, false]);
    rig.bring_to_op(&kinds);
    // 2 for each slave without, 3 for each with LRW.
    assert_eq!((rig.last.working_counter, rig.last.expected_working_counter), (10, 10));
    for slave in [1, 3] {
        rig.master.outputs_mut(slave).expect("outputs").copy_from_slice(&[slave, 0x5A]);
    }
    rig.run_for(5 * CYCLE);
    // Output k of these slaves is wired to input k.
    for slave in [1, 3] {
        assert_eq!(rig.master.inputs(slave), Some(&[slave, 0x5A][..]));
    }
}

/// A cycle allocates nothing, with 40 slaves, and neither does a running write of an object beside it.
#[test]
fn a_cycle_allocates_nothing() {
    let kinds = kinds(40);
    let mut rig = Rig::in_op(&kinds);
    rig.run_for(100 * CYCLE);
    let object = ObjectAddress::new(0x6065, 0);
    let id = rig.master.download(1, object, SdoScope::Entry, &[0, 1, 0, 0], SECOND);
    rig.step();
    let allocated = allocation_counter::measure(|| {
        for n in 0..100 {
            rig.master.outputs_mut(2).expect("outputs")[0] = n;
            rig.run_for(CYCLE);
        }
    });
    assert_eq!((allocated.count_total, allocated.bytes_total), (0, 0));
    assert_eq!(rig.wait(id), Ok(()));
    assert_eq!((rig.last.working_counter, rig.last.expected_working_counter), (120, 120));
}

/// Slaves that fit into one datagram share one; others get further datagrams, and none is cut in two.
#[test]
fn process_data_are_cut_at_slaves() {
    let mut rig = Rig::of(Chain::line((0..5).map(|_| Blob::default().slave())));
    rig.scan();
    for slave in 1..=5 {
        rig.master.configure(slave, 200, 200).expect("it has sync managers");
    }
    rig.reach(AlState::PreOp);
    rig.reach(AlState::SafeOp);
    rig.next_cycle = Some(rig.net.now);
    let before = rig.master.counters().sent;
    rig.run_for(CYCLE);
    rig.next_cycle = None;
    // Three slaves in the first datagram, two in the second one, and the watch.
    assert!((2..=3).contains(&(rig.master.counters().sent - before)));
    assert_eq!((rig.last.working_counter, rig.last.expected_working_counter), (15, 15));
}

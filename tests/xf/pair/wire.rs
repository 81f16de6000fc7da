//! Slaves behind controllers, as the wire shows them: slaves that do not answer and come back, clocks, scripts, and
//! reproducible bytes.

use allocation_counter::measure;
use ecmsk::coe::{AbortCode, ObjectAddress};
use ecmsk::ethercat::registers::{self, Fmmu};
use ecmsk::ethercat::{AlState, AlStatus};
use ecmsk::xf::EtherCatState;
use ecmsk::xf::host::ProcessRequest;
use ecmsk::xf::request::*;

use super::registers::{in_state, of, peek};
use super::{INIT, MS, Pair, drive, drives_and_io, sdo, to_all};
use crate::slave;

fn item(pair: &mut Pair, n: u8, item: SlaveInfoItem) -> u32 {
    pair.get(&SlaveInfoGet { slave: slave(n), item }, |info| info.number()).expect("a number")
}

fn states(pair: &mut Pair) -> [u8; 3] {
    pair.run(&StateUpdate);
    [0, 1, 2].map(|n| pair.get(&StateGet { slaves: slave(n).into() }, |state| state.0))
}

fn one(n: u8, state: EtherCatState) -> StateSet {
    StateSet { slaves: slave(n).into(), state }
}

fn errors_in_a_row(pair: &mut Pair) -> u8 {
    pair.get(&WkcErrorCountGet, |count| count)
}

/// XF-11.69 A slave that does not answer is counted in every cycle and reported, while the others go on; when it is in
/// OP again the count of errors in a row is 0.
#[test]
fn a_silent_slave_is_counted() {
    let mut pair = in_state(EtherCatState::Op);
    assert_eq!((errors_in_a_row(&mut pair), states(&mut pair)), (0, [8, 8, 8]));
    pair.silence(1, true);
    pair.pass(50 * MS);
    assert!((30..80).contains(&errors_in_a_row(&mut pair)));
    assert_eq!(states(&mut pair), [8, 0x10, 8]);
    // 3 for each of two slaves.
    assert_eq!(pair.get(&PdoWorkingCounterGet { which: WorkingCounterItem::Counter }, |counter| counter), 6);
    let read = SdoRequest { timeout_us: 30_000, ..sdo(1, 0x1000, 0, SdoOperation::Read { bytes: 4 }) };
    assert_eq!(pair.ends_in_failure(&read), Some(AbortCode::TIMEOUT));
    pair.run(&sdo(0, 0x1000, 0, SdoOperation::Read { bytes: 4 }));
    pair.silence(1, false);
    pair.pass(50 * MS);
    // Its watchdog has expired: its inputs count, and its outputs only when it is in OP again.
    assert_eq!(states(&mut pair), [8, 0x14, 8]);
    assert_eq!(pair.get(&PdoWorkingCounterGet { which: WorkingCounterItem::Counter }, |counter| counter), 7);
    pair.run(&one(1, EtherCatState::Op));
    pair.pass(50 * MS);
    assert_eq!((states(&mut pair), errors_in_a_row(&mut pair)), ([8, 8, 8], 0));
}

/// XF-11.69 A slave that was without power is in Init, and is brought back to OP by its number, mapped as before, while the others
/// stay in OP.
#[test]
fn a_slave_without_power_comes_back() {
    let mut pair = in_state(EtherCatState::Op);
    pair.chip().network().handle().lose(2);
    pair.pass(100 * MS);
    assert_eq!(states(&mut pair), [8, 0x10, 8]);
    pair.chip().network().handle().find(2);
    pair.pass(100 * MS);
    assert_eq!(states(&mut pair), [8, 0x11, 8]);
    assert!(errors_in_a_row(&mut pair) > 100);
    for state in [EtherCatState::PreOp, EtherCatState::SafeOp, EtherCatState::Op] {
        pair.run(&one(1, state));
    }
    pair.pass(50 * MS);
    assert_eq!((states(&mut pair), errors_in_a_row(&mut pair)), ([8, 8, 8], 0));
}

/// XF-11.69 Slaves behind a cut cable are reported; the whole network without its first cable has no link, and none is
/// found.
#[test]
fn a_cut_cable_is_told_of() {
    let mut pair = in_state(EtherCatState::Op);
    pair.chip().network().handle().cut_after(1);
    pair.pass(100 * MS);
    assert_eq!(states(&mut pair), [8, 0x10, 0x10]);
    pair.chip().network().handle().heal();
    // Outputs were missing for longer than the slaves' watchdog time.
    pair.pass(500 * MS);
    let [first, second, third] = states(&mut pair);
    assert_eq!((first, second & 0x10, third & 0x10), (8, 0x10, 0x10));
    assert_eq!(item(&mut pair, 1, SlaveInfoItem::AlStatus), u32::from(AlStatus::WATCHDOG.0));
    pair.run(&to_all(EtherCatState::Op));
    assert_eq!(states(&mut pair), [8, 8, 8]);
    pair.chip().network().handle().cut_after(0);
    pair.ends_in_failure(&INIT);
}

/// XF-11.69 XF-11.33 Without LRW a slave with outputs adds 1 to an LWR, which the chip counts twice, so that the sum
/// stays; FMMUs map the process data to their addresses.
#[test]
fn working_counters_are_those_of_the_frames() {
    let mut pair = in_state(EtherCatState::Op);
    let counter = |pair: &mut Pair| {
        pair.pass(10 * MS);
        pair.get(&PdoWorkingCounterGet { which: WorkingCounterItem::Counter }, |counter| counter)
    };
    assert_eq!(counter(&mut pair), 9);
    pair.run(&EnableLrw { lrw: false });
    assert_eq!(counter(&mut pair), 9);
    assert_eq!(errors_in_a_row(&mut pair), 0);
    for n in 0..3 {
        let fmmus: Vec<u8> = peek(&mut pair, n, registers::FMMU, 32);
        let lens = fmmus.as_chunks().0.iter().map(|fmmu| Fmmu::decode(fmmu).len).collect::<Vec<_>>();
        let said = [SlaveInfoItem::OutputBytes, SlaveInfoItem::InputBytes].map(|what| item(&mut pair, n as u8, what));
        assert_eq!(lens.iter().map(|len| u32::from(*len)).collect::<Vec<_>>(), said);
    }
}

fn u32_at(pair: &mut Pair, n: usize, address: u16) -> u32 {
    u32::from_le_bytes(peek(pair, n, address, 4).try_into().expect("4 bytes"))
}

/// XF-11.70 SYNC0, SYNC1 and shift are in the registers of slaves with clocks: those of ECAT_INIT_OP, or of DCSYNC for one slave;
/// AssignActivate 0 is no signal.
#[test]
fn sync_signals_are_on_the_wire() {
    let mut pair = of(vec![drive(), drive(), drive()]);
    let dc = DcTiming { assign_activate: 0x0700, sync0_ns: 1_000_000, sync1_ns: 250_000, shift_ns: 125_000 };
    pair.run(&EcatInit { dc, ..INIT });
    let other = DcTiming { assign_activate: 0x0300, sync0_ns: 2_000_000, sync1_ns: 0, shift_ns: 0 };
    pair.run(&DcSync { slaves: slave(1).into(), dc: other });
    pair.run(&DcSync { slaves: slave(2).into(), dc: DcTiming { assign_activate: 0, ..other } });
    pair.run(&InitDc);
    pair.run(&to_all(EtherCatState::PreOp));
    pair.run(&to_all(EtherCatState::Op));
    for (n, activation, sync0, sync1, shift) in [(0, 7, 1_000_000, 250_000, 125_000), (1, 3, 2_000_000, 0, 0)] {
        assert_eq!(peek(&mut pair, n, registers::SYNC_ACTIVATION, 1), [activation]);
        assert_eq!(
            (u32_at(&mut pair, n, registers::SYNC0_CYCLE), u32_at(&mut pair, n, registers::SYNC1_CYCLE)),
            (sync0, sync1)
        );
        let start = u64::from_le_bytes(peek(&mut pair, n, registers::SYNC0_START, 8).try_into().expect("8 bytes"));
        assert_eq!(start % u64::from(sync0), shift, "{n}");
    }
    assert_eq!(peek(&mut pair, 2, registers::SYNC_ACTIVATION, 1), [0]);
}

/// XF-11.70 With the bus shift the clocks of all slaves get the chip's own time.
#[test]
fn the_chip_leads_the_clocks_if_it_is_told_to() {
    for reference_clock in [ReferenceClock::FirstSlave, ReferenceClock::Chip] {
        let mut pair = of(vec![drive(), drive()]);
        pair.run(&EcatInit { reference_clock, ..INIT });
        pair.run(&to_all(EtherCatState::PreOp));
        pair.run(&to_all(EtherCatState::Op));
        pair.pass(100 * MS);
        let now = pair.controllers().chain().slave(0).controller().system_time_ns();
        assert!(now.abs_diff(pair.chip().now()) < 2 * MS);
        assert_eq!(pair.header().wkc_errors, 0);
    }
}

/// XF-11.71 A script refuses a state with its AL status code, makes SDOs slow, and aborts those of an object.
#[test]
fn scripts_act_on_controllers() {
    let mut pair = in_state(EtherCatState::PreOp);
    let handle = pair.chip().network().handle();
    handle.refuse(2, Some((AlState::SafeOp, AlStatus::NO_MEMORY)));
    pair.ends_in_failure(&to_all(EtherCatState::SafeOp));
    assert_eq!(states(&mut pair), [4, 0x12, 4]);
    assert_eq!(item(&mut pair, 1, SlaveInfoItem::AlStatus), u32::from(AlStatus::NO_MEMORY.0));
    handle.refuse(2, None);
    pair.run(&to_all(EtherCatState::SafeOp));
    assert_eq!(states(&mut pair), [4, 4, 4]);

    let takes = |pair: &mut Pair| {
        let since = pair.now;
        pair.run(&sdo(0, 0x1000, 0, SdoOperation::Read { bytes: 4 }));
        pair.now - since
    };
    let usual = takes(&mut pair);
    handle.delay_sdo(1, 40 * MS);
    let slow = takes(&mut pair);
    assert!((40 * MS..60 * MS).contains(&slow) && usual < 20 * MS, "{usual} {slow}");
    handle.delay_sdo(1, 0);
    let object = ObjectAddress::new(0x1000, 0);
    handle.abort_object(1, Some((object, AbortCode(0x0800_0021))));
    let abort = pair.ends_in_failure(&sdo(0, 0x1000, 0, SdoOperation::Read { bytes: 4 }));
    assert_eq!(abort, Some(AbortCode(0x0800_0021)));
    pair.run(&sdo(0, 0x1008, 0, SdoOperation::Read { bytes: 4 }));
}

/// XF-11.59 Over controllers, too, the same calls at the same times give the same bytes: answers, registers, process data.
#[test]
fn the_same_calls_give_the_same_bytes() {
    let run = || {
        let mut pair = in_state(EtherCatState::Op);
        pair.chip().network().handle().lose(3);
        pair.pass(50 * MS);
        pair.chip().network().handle().find(3);
        pair.pass(50 * MS);
        let mut bytes = Vec::new();
        for n in 0..3 {
            bytes.extend(peek(&mut pair, n, 0, 0x1000));
        }
        bytes.extend(
            pair.get(&CoeEmergency { count: EmergencyCount::new(8).expect("8") }, |list| format!("{list:?}"))
                .into_bytes(),
        );
        bytes.extend(format!("{} {:?}", pair.now, pair.host.counters()).into_bytes());
        bytes.extend(format!("{:?}", pair.header()).into_bytes());
        bytes
    };
    assert_eq!(run(), run());
}

/// XF-11.60 In OP over controllers a cycle allocates nothing.
#[test]
fn cycles_over_controllers_allocate_nothing() {
    let mut pair = of(drives_and_io());
    pair.bring_to(EtherCatState::Op);
    pair.run(&FifoEnable { on: true });
    let bytes = pair.get(&FifoPackSizeGet { fifo: Fifo::Rx }, usize::from);
    pair.process(ProcessRequest::Write { count: 1, outputs: &vec![0; bytes] });
    pair.pass(200 * MS);
    let (mut now, chip) = (pair.now, pair.chip());
    let counted = measure(|| {
        for _ in 0..200 {
            now += MS;
            chip.run_until(now);
        }
    });
    assert_eq!(counted.count_total, 0);
}

//! Initialisation, states, clocks, process data laid out, working counter.

use ecmsk::ethercat::AlState;
use ecmsk::slave::Io;
use ecmsk::xf::chip::{Profile, SYNC0_MIN_NS};
use ecmsk::xf::host::HostConfig;
use ecmsk::xf::request::{
    AllPins, CoeEmergency, ConfigMap, DcSync, DcTiming, EcatInit, EmergencyCount, EnableLrw, Fifo, FifoEnable,
    FifoPackSizeGet, GpioExtGetValue, GpioExtSetValue, GpioGetValue, GpioIntClearExt, InitDc, PdoWorkingCounterGet,
    Reconfig, SdoGet, SdoOperation, SlaveCountGet, SlaveInfoGet, SlaveInfoItem, Slaves, StateCheck, StateGet, StateSet,
    StateUpdate, WkcErrorCountGet, WkcErrorLimit, WkcErrorMaxGet, WkcErrorMaxSet, WorkingCounterItem,
};
use ecmsk::xf::response::SlaveInfo;
use ecmsk::xf::{AnswerHeader, Errors, EtherCatState, NetworkState, Status};

use super::{INIT, MS, OVER_CONTROLLERS, Pair, S, drive, sdo, to_all};
use crate::slave;

fn state(pair: &mut Pair, slaves: Slaves) -> NetworkState {
    pair.get(&StateGet { slaves }, |state| state)
}

/// The real state of a slave.
fn real_state(pair: &mut Pair, n: u8) -> AlState {
    pair.chip().network().slave(n).expect("the slave").state()
}

fn item(pair: &mut Pair, n: u8, item: SlaveInfoItem) -> Option<u32> {
    pair.get(&SlaveInfoGet { slave: slave(n), item }, |found| found.number())
}

fn counter(pair: &mut Pair, which: WorkingCounterItem) -> u32 {
    pair.get(&PdoWorkingCounterGet { which }, |number| number)
}

/// XF-13.1 XF-11.26 ECAT_INIT_OP (XF EN 375) finds the slaves, which are in Init then, and SLV_CNT_GET (XF EN 661)
/// counts them; @1 says whether the FIFO is on. A cycle that is too short is refused.
#[test]
pub fn initialisation() {
    let mut pair = Pair::running();
    // The port is ready some time after the chip.
    pair.pass(S);
    let header = pair.header();
    assert_eq!((header.state, header.status.contains(Status::PORT_READY)), (NetworkState::NONE, true));
    assert!(header.errors.contains(Errors::LINK_PIN) && !header.errors.contains(Errors::PHY_LINK));
    assert_eq!(pair.get(&SlaveCountGet, |count| count), 0);
    pair.run(&INIT);
    assert_eq!(pair.get(&SlaveCountGet, |count| count), 3);
    let header = pair.header();
    assert_eq!((header.state, header.status.contains(Status::FIFO_ON)), (EtherCatState::Init.into(), false));
    assert!(header.errors.contains(Errors::PHY_LINK));
    pair.run(&EcatInit { fifo_on: true, ..INIT });
    assert!(pair.has(Status::FIFO_ON));
    let short = DcTiming { sync0_ns: SYNC0_MIN_NS - 1, ..INIT.dc };
    pair.is_refused(&EcatInit { dc: short, ..INIT });
}

/// XF-11.26 The chip's cycle is SYNC0: so often the working counter is wrong while a slave is silent.
#[test]
fn the_cycle_is_sync0() {
    for sync0_ns in [250_000, 2_000_000] {
        let mut pair = Pair::running();
        pair.run(&EcatInit { dc: DcTiming { sync0_ns, ..INIT.dc }, ..INIT });
        pair.run(&to_all(EtherCatState::PreOp));
        pair.run(&Reconfig);
        pair.run(&to_all(EtherCatState::SafeOp));
        pair.silence(0, true);
        let (since, before) = (pair.now, pair.header_now().wkc_errors);
        pair.pass(u64::from(sync0_ns) * 20);
        let errors = pair.header_now().wkc_errors - before;
        let most = (pair.now - since) / u64::from(sync0_ns) + 1;
        assert!((20..=most).contains(&errors.into()), "{errors} errors, {most} cycles of {sync0_ns} ns at most");
    }
}

/// XF-13.1 XF-11.27 STATE_SET (XF EN 619) brings slaves, all or one, into a state; STATE_GET (XF EN 627) and the header
/// return it, for all slaves the lowest one.
#[test]
pub fn states() {
    let mut pair = Pair::running();
    pair.run(&INIT);
    for (wanted, real) in [
        (EtherCatState::PreOp, AlState::PreOp),
        (EtherCatState::SafeOp, AlState::SafeOp),
        (EtherCatState::Op, AlState::Op),
        (EtherCatState::Init, AlState::Init),
        (EtherCatState::Op, AlState::Op),
    ] {
        pair.run(&to_all(wanted));
        assert_eq!([0, 1, 2].map(|n| real_state(&mut pair, n)), [real; 3]);
        assert_eq!((state(&mut pair, Slaves::All), pair.header().state), (wanted.into(), wanted.into()));
    }
    pair.run(&StateSet { slaves: slave(1).into(), state: EtherCatState::SafeOp });
    assert_eq!([0, 1].map(|n| real_state(&mut pair, n)), [AlState::Op, AlState::SafeOp]);
    assert_eq!(state(&mut pair, slave(1).into()), EtherCatState::SafeOp.into());
    assert_eq!(state(&mut pair, slave(0).into()), EtherCatState::Op.into());
    assert_eq!(pair.header().state, EtherCatState::SafeOp.into(), "the lowest");
    pair.is_refused(&StateGet { slaves: slave(3).into() });
}

/// XF-11.28 A slave that refuses a state, does not answer, or is asked for Boot, makes the command fail; the state has
/// the error bit and the slave its AL status code.
#[test]
fn refused_states() {
    let mut pair = Pair::in_state(EtherCatState::PreOp);
    pair.run(&Reconfig);
    // Another mapping without RECONFIG_OP: the sync manager has the wrong length.
    pair.write(0, 0x1C12, 0, &[0]);
    pair.ends_in_failure(&to_all(EtherCatState::SafeOp));
    let header = pair.header();
    assert!(header.state.has_error() && header.errors.contains(Errors::STATE), "{header:?}");
    assert_eq!(state(&mut pair, slave(0).into()), NetworkState(0x12));
    assert_eq!(item(&mut pair, 0, SlaveInfoItem::AlStatus), Some(0x1D));

    Pair::in_state(EtherCatState::PreOp).ends_in_failure(&to_all(EtherCatState::Boot));
    let mut pair = Pair::in_state(EtherCatState::PreOp);
    pair.silence(2, true);
    pair.ends_in_failure(&to_all(EtherCatState::SafeOp));
}

/// XF-13.1 XF-11.29 STATE_GET reads the chip's memory, which STATE_UPDATE (XF EN 1304) updates.
#[test]
pub fn states_are_read_anew() {
    let mut pair = Pair::in_state(EtherCatState::Op);
    silence_until_the_watchdog(&mut pair);
    assert_eq!(real_state(&mut pair, 0), AlState::SafeOp);
    assert_eq!(state(&mut pair, Slaves::All), EtherCatState::Op.into(), "from memory");
    pair.run(&StateUpdate);
    assert_eq!(state(&mut pair, Slaves::All), NetworkState(0x14));
    let items = [SlaveInfoItem::AlStatus, SlaveInfoItem::State];
    assert_eq!(items.map(|what| item(&mut pair, 0, what)), [Some(0x1B), Some(0x14)]);
    // The two as a pair do the same.
    let get = StateGet { slaves: slave(0).into() };
    let read = pair.read(&StateUpdate, &get, |state| state.state());
    assert_eq!(read, Ok(Some(EtherCatState::SafeOp)));
}

/// XF-13.1 XF-11.29 STATE_CHECK (XF EN 1187) is STATE_SET, STATE_UPDATE and STATE_GET in one.
#[test]
pub fn states_are_set_and_checked() {
    let mut pair = Pair::in_state(EtherCatState::Op);
    silence_until_the_watchdog(&mut pair);
    pair.run(&StateCheck { slaves: slave(1).into(), state: EtherCatState::SafeOp });
    assert_eq!(real_state(&mut pair, 1), AlState::SafeOp);
    assert_eq!(state(&mut pair, slave(0).into()).state(), Some(EtherCatState::SafeOp), "the memory is renewed");
    pair.run(&StateCheck { slaves: Slaves::All, state: EtherCatState::Op });
    assert_eq!(state(&mut pair, Slaves::All), EtherCatState::Op.into());
}

/// Slave 0 leaves OP by itself, and answers again.
fn silence_until_the_watchdog(pair: &mut Pair) {
    pair.silence(0, true);
    pair.pass(300 * MS);
    pair.silence(0, false);
}

/// XF-13.1 XF-11.32 DCSYNC (XF EN 1201) sets the times of one slave, which INIT_DC (XF EN 413) puts in force; clocks
/// are stable some time after they are initialised.
#[test]
pub fn clocks() {
    let mut pair = Pair::running();
    pair.run(&INIT);
    assert!(!pair.header_now().status.contains(Status::DC_STABLE));
    pair.pass(200 * MS);
    assert!(pair.has(Status::DC_STABLE));
    let dc = DcTiming { assign_activate: 0, sync0_ns: 2_000_000, sync1_ns: 0, shift_ns: -500 };
    pair.run(&DcSync { slaves: slave(1).into(), dc });
    assert_eq!(item(&mut pair, 1, SlaveInfoItem::DcCycle), Some(2_000_000));
    assert_eq!(item(&mut pair, 1, SlaveInfoItem::DcActive), Some(1), "not yet");
    pair.run(&InitDc);
    assert_eq!(item(&mut pair, 1, SlaveInfoItem::DcActive), Some(0));
    assert_eq!(item(&mut pair, 1, SlaveInfoItem::DcShift), Some(-500_i32 as u32));
    assert_eq!(item(&mut pair, 0, SlaveInfoItem::DcActive), Some(1), "that of the others stays");
    assert_eq!(item(&mut pair, 0, SlaveInfoItem::DcCycle), Some(1_000_000));
    assert!(!pair.header_now().status.contains(Status::DC_STABLE), "they settle again");
}

/// XF-11.32 Clocks are never stable if no slave has one.
#[test]
fn a_network_without_clocks() {
    let mut pair = Pair::running_with(Profile::NEW, HostConfig::DEFAULT, vec![Box::new(Io::default())]);
    pair.run(&INIT);
    pair.pass(1000 * MS);
    assert!(!pair.has(Status::DC_STABLE));
}

/// XF-13.1 XF-11.31 SLV_INFO_GET (XF EN 643): identity as in the slave's own objects, name, addresses, state, bytes of
/// process data, and clocks.
#[test]
pub fn slave_info() {
    let mut pair = Pair::in_state(EtherCatState::SafeOp);
    for n in 0..3 {
        for (what, sub) in [(SlaveInfoItem::Vendor, 1), (SlaveInfoItem::Product, 2), (SlaveInfoItem::Revision, 3)] {
            let own = pair.object(n, 0x1018, sub);
            assert_eq!(item(&mut pair, n, what), Some(own), "{what:?}");
        }
    }
    for (n, what, value) in [
        (0, SlaveInfoItem::StationAddress, 0x1001),
        (2, SlaveInfoItem::StationAddress, 0x1003),
        (1, SlaveInfoItem::Alias, 0),
        (0, SlaveInfoItem::State, 4),
        (0, SlaveInfoItem::AlStatus, 0),
        (0, SlaveInfoItem::OutputBytes, 6),
        (0, SlaveInfoItem::InputBytes, 10),
        (2, SlaveInfoItem::OutputBytes, 2),
        (2, SlaveInfoItem::InputBytes, 2),
        (0, SlaveInfoItem::HasDc, 1),
        (2, SlaveInfoItem::HasDc, 0),
        (0, SlaveInfoItem::DcCycle, 1_000_000),
        (0, SlaveInfoItem::DcActive, 1),
    ] {
        assert_eq!(item(&mut pair, n, what), Some(value), "{what:?} of slave {n}");
    }
    let read = sdo(2, 0x1008, 0, SdoOperation::Read { bytes: 64 });
    let object = pair.read(&read, &SdoGet, <[u8]>::to_vec).expect("it has a name");
    // In an EEPROM the name is the kind of slave.
    let name = if OVER_CONTROLLERS.get() { pair.device(2).name().as_bytes().to_vec() } else { object };
    let get = SlaveInfoGet { slave: slave(2), item: SlaveInfoItem::Name };
    pair.get(&get, |found| assert_eq!(found, SlaveInfo::Text(&name)));
    pair.is_refused(&SlaveInfoGet { slave: slave(3), item: SlaveInfoItem::Vendor });
}

fn sizes(pair: &mut Pair) -> [u16; 2] {
    [Fifo::Rx, Fifo::Tx].map(|fifo| pair.get(&FifoPackSizeGet { fifo }, |bytes| bytes))
}

/// XF-13.1 XF-11.16 XF-11.30 RECONFIG_OP (XF EN 402) lays out process data, whose sizes FIFO_PACK_SIZE_GET (XF EN 685)
/// returns; two drives with 6 and 10 bytes and a module with 2 and 2.
#[test]
pub fn layout() {
    let mut pair = Pair::in_state(EtherCatState::PreOp);
    assert_eq!((sizes(&mut pair), pair.has(Status::PDO_CONFIGURED)), ([0, 0], false));
    pair.run(&Reconfig);
    assert_eq!((sizes(&mut pair), pair.has(Status::PDO_CONFIGURED)), ([14, 22], true));
}

/// XF-13.1 XF-11.30 CONFIG_MAP (XF EN 1421) lays them out, too.
#[test]
pub fn layout_of_slaves_that_fall_back() {
    let mut pair = Pair::in_state(EtherCatState::PreOp);
    pair.run(&ConfigMap);
    assert_eq!((sizes(&mut pair), pair.has(Status::PDO_CONFIGURED)), ([14, 22], true));
}

/// XF-11.30 In another state than PreOP a layout fails, and without one it happens on the way to SafeOP.
#[test]
fn layout_in_other_states() {
    for state in [EtherCatState::Init, EtherCatState::SafeOp] {
        Pair::in_state(state).ends_in_failure(&Reconfig);
    }
    let mut pair = Pair::in_state(EtherCatState::PreOp);
    pair.run(&to_all(EtherCatState::SafeOp));
    assert!(pair.has(Status::PDO_CONFIGURED));
}

/// XF-13.1 XF-11.33 PDO_WC_GET (XF EN 421): slaves with inputs, with outputs, and the working counter, which is inputs
/// plus 2 * outputs with LRW; ENABLE_LRW 0 (XF EN 1635) has LRD and LWR, which the chip counts in the same way (XF EN
/// 434).
///
/// Row: WKC of LRD + LWR.
#[test]
pub fn working_counter() {
    use WorkingCounterItem::{Counter, Inputs, Outputs};
    let mut pair = Pair::in_state(EtherCatState::Op);
    assert_eq!([Inputs, Outputs, Counter].map(|which| counter(&mut pair, which)), [3, 3, 9]);
    assert!(pair.chip().uses_lrw());
    pair.run(&EnableLrw { lrw: false });
    pair.pass(5 * MS);
    assert!(!pair.chip().uses_lrw());
    assert_eq!(counter(&mut pair, Counter), 9);
    pair.run(&EnableLrw { lrw: true });
    pair.pass(5 * MS);
    assert_eq!(counter(&mut pair, Counter), 9);
    assert_eq!(pair.header().wkc_errors, 0);
}

/// XF-11.33 ECAT_INIT_OP chooses between them with newer firmware; older firmware ignores its bit.
///
/// Row: WKC of LRD + LWR.
#[test]
fn lrw_of_the_initialisation() {
    for (profile, uses_lrw) in [(Profile::NEW, false), (Profile::OLD, true)] {
        let mut pair = Pair::running_with(profile, HostConfig::DEFAULT, vec![drive()]);
        pair.run(&EcatInit { lrw: false, ..INIT });
        pair.run(&to_all(EtherCatState::Op));
        assert_eq!(pair.chip().uses_lrw(), uses_lrw);
        assert_eq!(counter(&mut pair, WorkingCounterItem::Counter), 3);
    }
}

/// XF-13.1 XF-11.34 WKC_CONTI_ERR_CNT_GET (XF EN 1526), _MAX_GET (XF EN 1538) and _MAX_SET (XF EN 1553): any number of
/// errors in a row at first; beyond the limit process data stop, and status bits 4 and 6 are clear, until they are laid
/// out again. The header counts all of them.
#[test]
pub fn working_counter_errors() {
    let in_a_row = |pair: &mut Pair| pair.get(&WkcErrorCountGet, |count| count);
    let runs = |header: AnswerHeader| [Status::PDO_CONFIGURED, Status::FIFO_ON].map(|bit| header.status.contains(bit));
    let mut pair = Pair::in_state(EtherCatState::Op);
    pair.run(&FifoEnable { on: true });
    assert_eq!(pair.get(&WkcErrorMaxGet, |limit| limit), WkcErrorLimit::NONE);
    // The silence is shorter than the watchdog of its outputs, which would end OP.
    pair.silence(1, true);
    pair.pass(40 * MS);
    assert!(in_a_row(&mut pair) >= 40);
    assert_eq!(runs(pair.header_now()), [true; 2]);
    pair.silence(1, false);
    pair.pass(5 * MS);
    assert_eq!(in_a_row(&mut pair), 0);
    let counted = pair.header().wkc_errors;
    assert!((40..60).contains(&counted), "{counted}");

    let limit = WkcErrorLimit::from_code(20);
    pair.run(&WkcErrorMaxSet::new(limit).expect("1 to 255"));
    assert_eq!(pair.get(&WkcErrorMaxGet, |limit| limit), limit);
    pair.silence(1, true);
    pair.pass(15 * MS);
    assert_eq!(runs(pair.header_now()), [true; 2], "below the limit");
    pair.pass(15 * MS);
    assert_eq!(runs(pair.header_now()), [false; 2]);
    assert_eq!(in_a_row(&mut pair), 21, "it is the one beyond the limit");
    assert_eq!(pair.header_now().wkc_errors, counted + 21, "no cycle is exchanged any more");
    pair.silence(1, false);
    // A slave behind a controller answers again from the next frame on, and no cycle sends one.
    pair.run(&StateUpdate);
    pair.run(&to_all(EtherCatState::PreOp));
    pair.run(&Reconfig);
    pair.run(&to_all(EtherCatState::Op));
    assert!(pair.has(Status::PDO_CONFIGURED));
}

/// XF-13.1 XF-11.35 COE_EMERGENCY (XF EN 1490): as many places as were asked for, none of which is used here.
#[test]
pub fn emergencies() {
    let mut pair = Pair::in_state(EtherCatState::PreOp);
    for n in [1, 3, 8] {
        let call = CoeEmergency { count: EmergencyCount::new(n).expect("1 to 8") };
        let places = pair.get(&call, |list| (list.places().len(), list.iter().count()));
        assert_eq!(places, (usize::from(n), 0));
    }
}

/// XF-13.1 XF-11.13 Functions that older firmware does not have end with the chip's refusal: ENABLE_LRW before 0x22 (XF
/// EN 375), functions of GPIO 16 to 19 before 9 (XF EN 910, 930, 953). XF-11.31 It reports the clocks of slaves as
/// newer firmware does.
#[test]
fn older_firmware() {
    for profile in [Profile::OLD, Profile { version: 8, ..Profile::OLD }] {
        let mut pair = Pair::running_with(profile, HostConfig::DEFAULT, vec![drive()]);
        pair.run(&INIT);
        pair.is_refused(&EnableLrw { lrw: false });
        if profile.version < 9 {
            pair.is_refused(&GpioExtGetValue);
            pair.is_refused(&GpioExtSetValue { values: AllPins::default() });
            pair.is_refused(&GpioIntClearExt { pins: AllPins::default() });
        }
        // Its other functions work.
        assert_eq!(pair.get(&GpioGetValue, |values| values), 0);
        let clock = [SlaveInfoItem::HasDc, SlaveInfoItem::DcCycle].map(|what| item(&mut pair, 0, what));
        assert_eq!(clock, [Some(1), Some(1_000_000)]);
        pair.run(&to_all(EtherCatState::Op));
    }
}

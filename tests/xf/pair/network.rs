//! Initialisation, states, clocks, process data laid out, working counter.

use ecmsk::ethercat::AlState;
use ecmsk::xf::chip::Profile;
use ecmsk::xf::host::HostConfig;
use ecmsk::xf::request::{
    AllPins, CoeEmergency, ConfigMap, DcSync, DcTiming, EcatInit, EmergencyCount, EnableLrw, Fifo, FifoPackSizeGet,
    GpioExtGetValue, GpioExtSetValue, GpioGetValue, GpioIntClearExt, InitDc, PdoWorkingCounterGet, Reconfig, SdoGet,
    SdoOperation, SlaveCountGet, SlaveInfoGet, Slaves, StateCheck, StateGet, StateSet, StateUpdate, WkcErrorCountGet,
    WkcErrorLimit, WkcErrorMaxGet, WkcErrorMaxSet, WorkingCounterItem,
};
use ecmsk::xf::response::SlaveInfo;
use ecmsk::xf::{Errors, EtherCatState, NetworkState, Status};

use super::{INIT, MS, OVER_CONTROLLERS, Pair, SlaveInfoItem, drive, sdo, to_all};
use crate::slave;

fn state(pair: &mut Pair, slaves: Slaves) -> NetworkState {
    pair.get(&StateGet { slaves }, |state| state)
}

/// The state of a slave as it is.
fn real_state(pair: &mut Pair, n: u8) -> AlState {
    pair.chip().network().slave(n).expect("the slave").state()
}

fn item(pair: &mut Pair, n: u8, item: SlaveInfoItem) -> Option<u32> {
    pair.get(&SlaveInfoGet { slave: slave(n), item }, |found| found.number())
}

fn counter(pair: &mut Pair, which: WorkingCounterItem) -> u32 {
    pair.get(&PdoWorkingCounterGet { which }, |number| number)
}

/// XF-13.1 ECAT_INIT_OP (XF EN 375) finds the slaves, which SLV_CNT_GET (XF EN 661) counts; @1 says whether the FIFO is
/// on.
#[test]
pub fn initialisation() {
    let mut pair = Pair::running();
    assert_eq!(pair.header().state, NetworkState::NONE);
    assert_eq!(pair.get(&SlaveCountGet, |count| count), 0);
    pair.run(&INIT);
    assert_eq!(pair.get(&SlaveCountGet, |count| count), 3);
    let header = pair.header();
    assert_eq!((header.state, header.status.contains(Status::FIFO_ON)), (EtherCatState::Init.into(), false));
    assert!(header.errors.contains(Errors::PHY_LINK));
    pair.run(&EcatInit { fifo_on: true, ..INIT });
    assert!(pair.has(Status::FIFO_ON));
}

/// XF-13.1 STATE_SET (XF EN 619) brings slaves, all or one, into a state; STATE_GET (XF EN 627) and the header tell it.
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
}

/// XF-13.1 STATE_GET is from the chip's memory, which STATE_UPDATE (XF EN 1304) renews.
#[test]
pub fn states_are_read_anew() {
    let mut pair = Pair::in_state(EtherCatState::Op);
    silence_until_the_watchdog(&mut pair);
    assert_eq!(real_state(&mut pair, 0), AlState::SafeOp);
    assert_eq!(state(&mut pair, Slaves::All), EtherCatState::Op.into(), "from memory");
    pair.run(&StateUpdate);
    assert_eq!(state(&mut pair, Slaves::All).state(), Some(EtherCatState::SafeOp));
    // As a pair the two do the same.
    let get = StateGet { slaves: slave(0).into() };
    let read = pair.read(&StateUpdate, &get, |state| state.state());
    assert_eq!(read, Ok(Some(EtherCatState::SafeOp)));
}

/// XF-13.1 STATE_CHECK (XF EN 1187) is STATE_SET, STATE_UPDATE and STATE_GET in one.
#[test]
pub fn states_are_set_and_checked() {
    let mut pair = Pair::in_state(EtherCatState::Op);
    silence_until_the_watchdog(&mut pair);
    pair.run(&StateCheck { slaves: slave(1).into(), state: EtherCatState::SafeOp });
    assert_eq!(real_state(&mut pair, 1), AlState::SafeOp);
    assert_eq!(state(&mut pair, slave(0).into()).state(), Some(EtherCatState::SafeOp), "the memory is renewed");
}

/// Slave 0 leaves OP by itself, and answers again.
fn silence_until_the_watchdog(pair: &mut Pair) {
    pair.silence(0, true);
    pair.pass(300 * MS);
    pair.silence(0, false);
}

/// XF-13.1 DCSYNC (XF EN 1201) sets the times of one slave, which INIT_DC (XF EN 413) puts in force.
#[test]
pub fn clocks() {
    let mut pair = Pair::running();
    pair.run(&INIT);
    pair.pass(200 * MS);
    assert!(pair.has(Status::DC_STABLE));
    let dc = DcTiming { assign_activate: 0, sync0_ns: 2_000_000, sync1_ns: 0, shift_ns: -500 };
    pair.run(&DcSync { slaves: slave(1).into(), dc });
    assert_eq!(item(&mut pair, 1, SlaveInfoItem::DcCycle), Some(2_000_000));
    assert_eq!(item(&mut pair, 1, SlaveInfoItem::DcActive), Some(1), "not yet");
    pair.run(&InitDc);
    assert_eq!(item(&mut pair, 1, SlaveInfoItem::DcActive), Some(0));
    assert_eq!(item(&mut pair, 0, SlaveInfoItem::DcActive), Some(1), "that of the others stays");
}

/// XF-13.1 SLV_INFO_GET (XF EN 643): identity as the slave's own objects have it, name, state, bytes of process data.
#[test]
pub fn slave_info() {
    let mut pair = Pair::in_state(EtherCatState::SafeOp);
    for n in 0..3 {
        for (what, sub) in [(SlaveInfoItem::Vendor, 1), (SlaveInfoItem::Product, 2), (SlaveInfoItem::Revision, 3)] {
            let own = pair.object(n, 0x1018, sub);
            assert_eq!(item(&mut pair, n, what), Some(own), "{what:?}");
        }
    }
    assert_eq!(item(&mut pair, 0, SlaveInfoItem::State), Some(4));
    assert_eq!(item(&mut pair, 0, SlaveInfoItem::AlStatus), Some(0));
    let bytes = [SlaveInfoItem::OutputBytes, SlaveInfoItem::InputBytes];
    assert_eq!(bytes.map(|what| item(&mut pair, 2, what)), [Some(2), Some(2)]);
    let addresses = [0, 1].map(|n| item(&mut pair, n, SlaveInfoItem::StationAddress));
    assert_ne!(addresses[0], addresses[1]);
    let read = sdo(2, 0x1008, 0, SdoOperation::Read { bytes: 64 });
    let object = pair.read(&read, &SdoGet, <[u8]>::to_vec).expect("it has a name");
    // An EEPROM has the kind for its name.
    let name = if OVER_CONTROLLERS.get() { pair.device(2).name().as_bytes().to_vec() } else { object };
    let get = SlaveInfoGet { slave: slave(2), item: SlaveInfoItem::Name };
    pair.get(&get, |found| assert_eq!(found, SlaveInfo::Text(&name)));
    pair.is_refused(&SlaveInfoGet { slave: slave(3), item: SlaveInfoItem::Vendor });
}

fn sizes(pair: &mut Pair) -> [u16; 2] {
    [Fifo::Rx, Fifo::Tx].map(|fifo| pair.get(&FifoPackSizeGet { fifo }, |bytes| bytes))
}

/// XF-13.1 RECONFIG_OP (XF EN 402) lays out process data, whose sizes FIFO_PACK_SIZE_GET (XF EN 685) tells; two drives
/// with 6 and 10 bytes and a module with 2 and 2.
#[test]
pub fn layout() {
    let mut pair = Pair::in_state(EtherCatState::PreOp);
    assert_eq!((sizes(&mut pair), pair.has(Status::PDO_CONFIGURED)), ([0, 0], false));
    pair.run(&Reconfig);
    assert_eq!((sizes(&mut pair), pair.has(Status::PDO_CONFIGURED)), ([14, 22], true));
}

/// XF-13.1 CONFIG_MAP (XF EN 1421) lays them out too.
#[test]
pub fn layout_of_slaves_that_fall_back() {
    let mut pair = Pair::in_state(EtherCatState::PreOp);
    pair.run(&ConfigMap);
    assert_eq!((sizes(&mut pair), pair.has(Status::PDO_CONFIGURED)), ([14, 22], true));
}

/// XF-13.1 PDO_WC_GET (XF EN 421): slaves with inputs, with outputs, and the working counter, which is inputs + 2 *
/// outputs with LRW; ENABLE_LRW 0 (XF EN 1635) has LRD and LWR, which the chip counts in the same way (XF EN 434).
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

/// XF-13.1 WKC_CONTI_ERR_CNT_GET (XF EN 1526), _MAX_GET (XF EN 1538) and _MAX_SET (XF EN 1553): any number of errors at
/// first; beyond the limit process data stop, and status bits 4 and 6 are clear.
#[test]
pub fn working_counter_errors() {
    let mut pair = Pair::in_state(EtherCatState::Op);
    assert_eq!(pair.get(&WkcErrorMaxGet, |limit| limit), WkcErrorLimit::NONE);
    // Not for as long as the watchdog of its outputs, which would take it out of OP.
    pair.silence(1, true);
    pair.pass(40 * MS);
    assert!(pair.get(&WkcErrorCountGet, |count| count) >= 40);
    assert!(pair.host.header().expect("it runs").status.contains(Status::PDO_CONFIGURED));
    pair.silence(1, false);
    pair.pass(5 * MS);
    assert_eq!(pair.get(&WkcErrorCountGet, |count| count), 0);

    let limit = WkcErrorLimit::from_code(20);
    pair.run(&WkcErrorMaxSet::new(limit).expect("1 to 255"));
    assert_eq!(pair.get(&WkcErrorMaxGet, |limit| limit), limit);
    pair.silence(1, true);
    pair.pass(100 * MS);
    let status = pair.header().status;
    assert!(!status.contains(Status::PDO_CONFIGURED) && !status.contains(Status::FIFO_ON));
    assert_eq!(pair.get(&WkcErrorCountGet, |count| count), 21, "it is the one beyond the limit");
}

/// XF-13.1 COE_EMERGENCY (XF EN 1490): as many places as were asked for, none of which is used here.
#[test]
pub fn emergencies() {
    let mut pair = Pair::in_state(EtherCatState::PreOp);
    for n in [1, 3, 8] {
        let call = CoeEmergency { count: EmergencyCount::new(n).expect("1 to 8") };
        let places = pair.get(&call, |list| (list.places().len(), list.iter().count()));
        assert_eq!(places, (usize::from(n), 0));
    }
}

/// XF-13.1 What older firmware has not ends with the chip's refusal: ENABLE_LRW before 0x22 (XF EN 375), functions of GPIO 16 to 19 before 9 (XF EN 910, 930, 953).
#[test]
fn older_firmware() {
    let mut pair = Pair::running_with(Profile { version: 8, ..Profile::OLD }, HostConfig::DEFAULT, vec![drive()]);
    pair.run(&INIT);
    pair.is_refused(&EnableLrw { lrw: false });
    pair.is_refused(&GpioExtGetValue);
    pair.is_refused(&GpioExtSetValue { values: AllPins::default() });
    pair.is_refused(&GpioIntClearExt { pins: AllPins::default() });
    // What it has goes on.
    assert_eq!(pair.get(&GpioGetValue, |values| values), 0);
    pair.run(&to_all(EtherCatState::Op));
}

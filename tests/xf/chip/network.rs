//! Initialisation, states, slaves, clocks, working counter.

use ecmsk::slave::{Io, Slave};
use ecmsk::xf::chip::{Profile, SYNC0_MIN_NS};
use ecmsk::xf::request::{
    CoeEmergency, ConfigMap, DcSync, DcTiming, EcatInit, EmergencyCount, EnableLrw, FifoEnable, InfoUpdate, InitDc,
    PdoWorkingCounterGet, Reconfig, SlaveCountGet, SlaveInfoGet, SlaveInfoItem, Slaves, StateCheck, StateGet, StateSet,
    StateUpdate, WkcErrorCountGet, WkcErrorLimit, WkcErrorMaxGet, WkcErrorMaxSet, WorkingCounterItem,
};
use ecmsk::xf::response::SlaveInfo;
use ecmsk::xf::{CommandHeader, Control, Errors, EtherCatState, NetworkState, Status};

use super::{Host, INIT, MS, to_all};
use crate::slave;

fn state(host: &mut Host, slaves: Slaves) -> NetworkState {
    host.call(&StateGet { slaves }).to(&StateGet { slaves })
}

fn item(host: &mut Host, slave: u8, item: SlaveInfoItem) -> Option<u32> {
    let request = SlaveInfoGet { slave: crate::slave(slave), item };
    let got = host.call(&request);
    got.to(&request).number()
}

fn counter(host: &mut Host, which: WorkingCounterItem) -> u32 {
    host.call(&PdoWorkingCounterGet { which }).to(&PdoWorkingCounterGet { which })
}

/// XF-11.26 ECAT_INIT_OP counts the slaves, which are in Init then; before it there is no state and no slave. Byte 1
/// says whether the FIFO is on. Its cycle is SYNC0.
#[test]
fn initialisation() {
    let mut host = Host::with_drives();
    let got = host.call(&InfoUpdate);
    assert_eq!((got.header.state, got.has(Status::PORT_READY)), (NetworkState::NONE, true));
    assert!(got.has(Status::FIFO_ON), "until byte 1 of ECAT_INIT_OP says otherwise");
    assert!(got.header.errors.contains(Errors::LINK_PIN) && !got.header.errors.contains(Errors::PHY_LINK));
    assert_eq!(host.call(&SlaveCountGet).header.ret, 0);
    host.run(&INIT);
    assert_eq!(host.call(&SlaveCountGet).header.ret, 3);
    let got = host.call(&InfoUpdate);
    assert_eq!((got.header.state, got.has(Status::FIFO_ON)), (EtherCatState::Init.into(), false));
    assert!(got.header.errors.contains(Errors::PHY_LINK));
    host.run(&EcatInit { fifo_on: true, ..INIT });
    assert!(host.call(&InfoUpdate).has(Status::FIFO_ON));

    let short = DcTiming { sync0_ns: SYNC0_MIN_NS - 1, ..INIT.dc };
    assert_eq!(host.call(&EcatInit { dc: short, ..INIT }).errors(), Errors::COMMAND);
    for (sync0_ns, cycles) in [(250_000, 400), (2_000_000, 50)] {
        let mut host = Host::with_drives();
        host.run(&EcatInit { dc: DcTiming { sync0_ns, ..INIT.dc }, ..INIT });
        host.run(&to_all(EtherCatState::PreOp));
        host.run(&Reconfig);
        host.run(&to_all(EtherCatState::SafeOp));
        // One slave falls silent: each cycle is an error.
        host.chip.network_mut().silence(0, true);
        let errors = |host: &mut Host| host.call(&InfoUpdate).header.wkc_errors;
        let was = errors(&mut host);
        host.pass(u64::from(sync0_ns) * 20);
        let now = errors(&mut host);
        assert!((20..=24).contains(&(now - was)), "{cycles}: {was} {now}");
    }
}

/// XF-11.27 STATE_SET brings slaves through all states between, or down at once; STATE_GET and the header tell them.
#[test]
fn states() {
    let mut host = Host::with_drives();
    host.run(&INIT);
    host.run(&to_all(EtherCatState::Op));
    assert_eq!(state(&mut host, Slaves::All), EtherCatState::Op.into());
    host.run(&StateSet { slaves: slave(1).into(), state: EtherCatState::SafeOp });
    assert_eq!(state(&mut host, slave(1).into()), EtherCatState::SafeOp.into());
    assert_eq!(state(&mut host, slave(0).into()), EtherCatState::Op.into());
    assert_eq!(host.call(&InfoUpdate).header.state, EtherCatState::SafeOp.into(), "the lowest");
    host.run(&to_all(EtherCatState::Init));
    assert_eq!(host.call(&InfoUpdate).header.state, EtherCatState::Init.into());
    assert_eq!(host.call(&StateGet { slaves: slave(3).into() }).errors(), Errors::COMMAND, "there are three");
}

/// XF-11.28 A slave that refuses a state, does not answer, or is asked for Boot, makes the command fail; the state has
/// the error bit and the slave its AL status code.
#[test]
fn refused_states() {
    let mut host = Host::in_state(EtherCatState::PreOp);
    host.run(&Reconfig);
    // Another mapping without RECONFIG_OP: the sync manager has the wrong length.
    host.write(0, 0x1C12, 0, &[0]);
    let got = host.end(&to_all(EtherCatState::SafeOp));
    assert_eq!(got.errors(), Errors::NON_IMMEDIATE);
    assert!(got.header.state.has_error() && got.header.errors.contains(Errors::STATE));
    assert_eq!(state(&mut host, slave(0).into()), NetworkState(0x12));
    assert_eq!(item(&mut host, 0, SlaveInfoItem::AlStatus), Some(0x1D));

    let mut host = Host::in_state(EtherCatState::PreOp);
    assert_eq!(host.end(&to_all(EtherCatState::Boot)).errors(), Errors::NON_IMMEDIATE);
    let mut host = Host::in_state(EtherCatState::PreOp);
    host.chip.network_mut().silence(2, true);
    assert_eq!(host.end(&to_all(EtherCatState::SafeOp)).errors(), Errors::NON_IMMEDIATE);
}

/// XF-11.29 STATE_GET is from the chip's memory: a slave that leaves a state by itself is seen after STATE_UPDATE
/// alone. STATE_CHECK sets and updates in one.
#[test]
fn states_are_remembered() {
    let mut host = Host::in_state(EtherCatState::Op);
    // Silent for longer than the watchdog of its outputs.
    host.chip.network_mut().silence(0, true);
    host.pass(300 * MS);
    host.chip.network_mut().silence(0, false);
    assert_eq!(state(&mut host, Slaves::All), EtherCatState::Op.into());
    host.run(&StateUpdate);
    assert_eq!(state(&mut host, Slaves::All), NetworkState(0x14));
    assert_eq!(item(&mut host, 0, SlaveInfoItem::AlStatus), Some(0x1B));
    assert_eq!(item(&mut host, 0, SlaveInfoItem::State), Some(0x14));
    host.run(&StateCheck { slaves: Slaves::All, state: EtherCatState::Op });
    assert_eq!(state(&mut host, Slaves::All), EtherCatState::Op.into());
}

/// XF-11.30 RECONFIG_OP and CONFIG_MAP lay out process data in PreOP and set status bit 4; in another state they fail.
/// Without them it happens on the way to SafeOP.
#[test]
fn layout() {
    let mut host = Host::in_state(EtherCatState::PreOp);
    assert!(!host.call(&InfoUpdate).has(Status::PDO_CONFIGURED));
    host.run(&ConfigMap);
    assert!(host.call(&InfoUpdate).has(Status::PDO_CONFIGURED));
    host.run(&to_all(EtherCatState::SafeOp));
    assert_eq!(host.end(&Reconfig).errors(), Errors::NON_IMMEDIATE);

    let mut host = Host::with_drives();
    host.run(&INIT);
    assert_eq!(host.end(&Reconfig).errors(), Errors::NON_IMMEDIATE, "in Init no mailbox answers");
    let mut host = Host::in_state(EtherCatState::PreOp);
    host.run(&to_all(EtherCatState::SafeOp));
    assert!(host.call(&InfoUpdate).has(Status::PDO_CONFIGURED));
}

/// XF-11.31 SLV_INFO_GET: identity, name, addresses, state, bytes of process data, and clocks, these with every firmware.
#[test]
fn slave_info() {
    let mut host = Host::in_state(EtherCatState::SafeOp);
    let mut info = |slave, what| item(&mut host, slave, what);
    assert_eq!(info(0, SlaveInfoItem::Vendor), Some(0x4543_4D53));
    assert_eq!(
        (info(0, SlaveInfoItem::Product), info(2, SlaveInfoItem::Product)),
        (Some(0x5345_5256), Some(0x494F_3136))
    );
    assert_eq!(info(0, SlaveInfoItem::Revision), Some(0x0001_0000));
    assert_eq!(
        (info(0, SlaveInfoItem::StationAddress), info(2, SlaveInfoItem::StationAddress)),
        (Some(0x1001), Some(0x1003))
    );
    assert_eq!(info(1, SlaveInfoItem::Alias), Some(0));
    assert_eq!((info(1, SlaveInfoItem::State), info(1, SlaveInfoItem::AlStatus)), (Some(4), Some(0)));
    assert_eq!((info(0, SlaveInfoItem::OutputBytes), info(0, SlaveInfoItem::InputBytes)), (Some(6), Some(10)));
    assert_eq!((info(2, SlaveInfoItem::OutputBytes), info(2, SlaveInfoItem::InputBytes)), (Some(2), Some(2)));
    assert_eq!((info(0, SlaveInfoItem::HasDc), info(2, SlaveInfoItem::HasDc)), (Some(1), Some(0)));
    assert_eq!((info(0, SlaveInfoItem::DcCycle), info(0, SlaveInfoItem::DcActive)), (Some(1_000_000), Some(1)));
    let name = SlaveInfoGet { slave: slave(2), item: SlaveInfoItem::Name };
    assert_eq!(host.call(&name).to(&name), SlaveInfo::Text(b"IO16 simulated digital IO"));
    let absent = SlaveInfoGet { slave: slave(3), item: SlaveInfoItem::Vendor };
    assert_eq!(host.call(&absent).errors(), Errors::COMMAND);

    let mut old = Host::new(Profile::OLD, vec![super::drive()]);
    old.run(&INIT);
    let dc = SlaveInfoGet { slave: slave(0), item: SlaveInfoItem::HasDc };
    assert_eq!(old.call(&dc).to(&dc), SlaveInfo::U8(1));
    assert_eq!(item(&mut old, 0, SlaveInfoItem::DcCycle), Some(1_000_000));
    // The vendor's header has items up to 40, which nobody describes.
    for code in [14, 40] {
        old.index += 1;
        let mut bytes = old.packet(CommandHeader::with_index(old.index), &dc);
        bytes[0x04] = code;
        old.exchange_bytes(&bytes);
        let got = old.send(&InfoUpdate);
        assert_eq!((got.header.index, got.errors()), (old.index - 1, Errors::COMMAND), "item {code}");
        old.send_with(
            CommandHeader { control: Control::CLEAR_ALL, ..CommandHeader::with_index(100 + code) },
            &InfoUpdate,
        );
    }
}

/// XF-11.32 The clocks are stable some time after ECAT_INIT_OP if a slave has one; DCSYNC sets other times for a slave,
/// which INIT_DC puts in force.
#[test]
fn clocks() {
    let mut host = Host::with_drives();
    host.run(&INIT);
    assert!(!host.call(&InfoUpdate).has(Status::DC_STABLE));
    host.pass(200 * MS);
    assert!(host.call(&InfoUpdate).has(Status::DC_STABLE));
    let dc = DcTiming { assign_activate: 0, sync0_ns: 2_000_000, sync1_ns: 0, shift_ns: -500 };
    host.run(&DcSync { slaves: slave(1).into(), dc });
    assert_eq!(item(&mut host, 1, SlaveInfoItem::DcActive), Some(1), "not yet");
    host.run(&InitDc);
    assert_eq!(item(&mut host, 1, SlaveInfoItem::DcActive), Some(0));
    assert_eq!(item(&mut host, 1, SlaveInfoItem::DcCycle), Some(2_000_000));
    assert_eq!(item(&mut host, 1, SlaveInfoItem::DcShift), Some(-500_i32 as u32));
    assert_eq!(item(&mut host, 0, SlaveInfoItem::DcCycle), Some(1_000_000));
    assert!(!host.call(&InfoUpdate).has(Status::DC_STABLE), "they settle again");

    let io: Box<dyn Slave> = Box::new(Io::default());
    let mut host = Host::new(Profile::NEW, vec![io]);
    host.run(&INIT);
    host.pass(1000 * MS);
    assert!(!host.call(&InfoUpdate).has(Status::DC_STABLE), "no slave has a clock");
}

/// XF-11.33 The working counter is inputs + 2 * outputs, with LRW as with LRD and LWR. INIT_OP chooses with newer firmware,
/// ENABLE_LRW later.
#[test]
fn working_counter() {
    let mut host = Host::in_state(EtherCatState::Op);
    host.pass(5 * MS);
    assert_eq!(counter(&mut host, WorkingCounterItem::Inputs), 3);
    assert_eq!(counter(&mut host, WorkingCounterItem::Outputs), 3);
    assert_eq!(counter(&mut host, WorkingCounterItem::Counter), 3 + 2 * 3);
    host.call(&EnableLrw { lrw: false });
    host.pass(5 * MS);
    assert_eq!(counter(&mut host, WorkingCounterItem::Counter), 3 + 2 * 3);
    assert_eq!(host.call(&InfoUpdate).header.wkc_errors, 0);

    let mut host = Host::with_drives();
    host.run(&EcatInit { lrw: false, ..INIT });
    host.run(&to_all(EtherCatState::Op));
    assert_eq!(counter(&mut host, WorkingCounterItem::Counter), 9);
    // Older firmware does not look at the bit.
    let mut host = Host::new(Profile::OLD, vec![super::drive()]);
    host.run(&EcatInit { lrw: false, ..INIT });
    host.run(&to_all(EtherCatState::Op));
    assert_eq!(counter(&mut host, WorkingCounterItem::Counter), 3);
}

/// XF-11.34 Wrong working counters are counted, all and those in a row. Beyond the limit process data stop, and status
/// bits 4 and 6 fall; there is no limit at first.
#[test]
fn working_counter_errors() {
    let limit = |host: &mut Host| host.call(&WkcErrorMaxGet).to(&WkcErrorMaxGet);
    let in_a_row = |host: &mut Host| host.call(&WkcErrorCountGet).header.ret;
    let twenty = WkcErrorLimit::from_code(20);
    let mut host = Host::in_state(EtherCatState::Op);
    assert_eq!(limit(&mut host), WkcErrorLimit::NONE);
    host.chip.network_mut().silence(1, true);
    host.pass(10 * MS);
    host.chip.network_mut().silence(1, false);
    assert!((10..=12).contains(&host.call(&InfoUpdate).header.wkc_errors));
    host.pass(5 * MS);
    assert_eq!(in_a_row(&mut host), 0);
    assert!(host.call(&InfoUpdate).header.wkc_errors >= 10);

    host.call(&WkcErrorMaxSet::new(twenty).expect("1 to 255"));
    assert_eq!(limit(&mut host), twenty);
    host.call(&FifoEnable { on: true });
    host.chip.network_mut().silence(1, true);
    host.pass(15 * MS);
    let got = host.call(&InfoUpdate);
    assert!(got.has(Status::PDO_CONFIGURED) && got.has(Status::FIFO_ON));
    host.pass(10 * MS);
    let got = host.call(&InfoUpdate);
    assert!(!got.has(Status::PDO_CONFIGURED) && !got.has(Status::FIFO_ON));
    assert_eq!(in_a_row(&mut host), 21);
    let was = got.header.wkc_errors;
    host.pass(50 * MS);
    assert_eq!(host.call(&InfoUpdate).header.wkc_errors, was, "no cycle is exchanged any more");
    // Process data begin again when they are laid out again.
    host.chip.network_mut().silence(1, false);
    host.run(&to_all(EtherCatState::PreOp));
    host.run(&Reconfig);
    host.run(&to_all(EtherCatState::Op));
    assert!(host.call(&InfoUpdate).has(Status::PDO_CONFIGURED));
}

/// XF-11.35 COE_EMERGENCY lists as many places as it is asked for, none of which is used by slave models.
#[test]
fn emergencies() {
    let mut host = Host::in_state(EtherCatState::PreOp);
    for n in [1, 8] {
        let request = CoeEmergency { count: EmergencyCount::new(n).expect("1 to 8") };
        let got = host.call(&request);
        assert_eq!(got.valid().len(), 12 * usize::from(n));
        assert_eq!(got.to(&request).iter().count(), 0);
    }
}

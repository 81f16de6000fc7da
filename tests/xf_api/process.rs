//! Process data with types, and cycles.

use std::time::Duration;

use ecmsk::coe::ObjectAddress;
use ecmsk::slave::{DeviceFault, Fault};
use ecmsk::xf::request::{FifoEnable, Reconfig, Slaves};
use ecmsk::xf::{DataSize, EtherCatState};
use ecmsk::xf_api::{NetworkConfig, XfError};

use super::{MODE, POSITION, TARGET, enabled, opened, safe_op, started};

/// XF-17.6 The layout is the slaves' mappings, one after the other.
#[test]
fn the_layout_is_what_slaves_map() {
    let (mut xf, _) = started("drive,io,drive");
    xf.start_network(&NetworkConfig::default()).unwrap();
    xf.set_state(Slaves::All, EtherCatState::PreOp).unwrap();
    xf.run(&Reconfig).unwrap();
    let layout = xf.layout().unwrap();
    let places: Vec<_> = layout.outputs.iter().map(|slave| (slave.at, slave.bytes)).collect();
    // A drive maps 0x6040 and 0x607A, an IO slave 16 outputs.
    assert_eq!(places, [(0, 6), (6, 2), (8, 6)]);
    let target = layout.outputs[2].fields.iter().find(|field| field.object == TARGET).expect("a target");
    assert_eq!((target.at, target.bits), (16, 32));
    assert_eq!(layout.inputs[1].at, layout.inputs[0].bytes);
}

/// XF-17.6 A mapping changed without a RECONFIG is no valid layout.
#[test]
fn a_changed_mapping_is_an_error_until_reconfig() {
    let (mut xf, _) = started("drive");
    xf.start_network(&NetworkConfig::default()).unwrap();
    xf.set_state(Slaves::All, EtherCatState::PreOp).unwrap();
    xf.run(&Reconfig).unwrap();
    let at = |sub| ObjectAddress::new(0x1600, sub);
    xf.sdo_write(0, at(0), 0_u8).unwrap();
    xf.sdo_write(0, at(1), 0x6040_0010_u32).unwrap();
    xf.sdo_write(0, at(0), 1_u8).unwrap();
    let error = xf.layout().unwrap_err();
    assert!(matches!(error, XfError::OtherLayout { slave: 0, mapped: 2, laid_out: 6, .. }), "{error}");
    xf.run(&Reconfig).unwrap();
    assert_eq!(xf.layout().unwrap().outputs[0].bytes, 2);
    // Without a target in the mapping none can be written.
    xf.set_state(Slaves::All, EtherCatState::SafeOp).unwrap();
    let data = xf.process_data().unwrap();
    let error = data.output::<i32>(0, TARGET).unwrap_err();
    assert!(error.to_string().contains("0x607A:0 among its outputs; it maps 0x6040:0"), "{error}");
    assert!(matches!(data.output::<u32>(0, ObjectAddress::new(0x6040, 0)), Err(XfError::FieldSize { bits: 16, .. })));
    assert_eq!(data.output::<u8>(7, TARGET), Err(XfError::NoSuchSlave { slave: 7, found: 1 }));
}

/// XF-17.7 Both axes follow every target, in the cycle of the network, on every chip.
#[test]
fn axes_follow_their_targets() {
    for keys in ["", "&chip_fw=old", "&chip_fw=xfu", "&int0=yes", "&n=32&use_n=32", "&network=controllers"] {
        let (mut xf, _) = opened(&format!("xf-sim:?clock=virtual&slaves=drive*2{keys}"));
        let mut data = enabled(&mut xf).unwrap_or_else(|error| panic!("{keys}: {error}"));
        let targets = [0, 1].map(|slave| data.output::<i32>(slave, TARGET).unwrap());
        let positions = [0, 1].map(|slave| data.input::<i32>(slave, POSITION).unwrap());
        let starts = positions.map(|position| data.get(position));
        let begin = xf.header();
        let (mut seen, mut last) = (0, starts[0]);
        for n in 1..=1000 {
            data.set(targets[0], starts[0] + 10 * n);
            data.set(targets[1], starts[1] - 20 * n);
            xf.cycle(&mut data).unwrap_or_else(|error| panic!("{keys}: {error}"));
            let position = data.get(positions[0]);
            assert!(position >= last && position - last <= 200, "{keys}: from {last} to {position}");
            seen += i32::from(position != last);
            last = position;
        }
        // Inputs are those of the cycle, not old ones: delayed at most by the targets ahead and the unread inputs.
        assert!(starts[0] + 10_000 - last < 10 * 40, "{keys}: {last}");
        assert!(seen > 800, "{keys}: the position was seen in {seen} cycles");
        xf.finish(&mut data).unwrap();
        // The drives come to rest.
        xf.pass(Duration::from_millis(200)).unwrap();
        xf.read_inputs(&mut data).unwrap();
        assert_eq!(positions.map(|position| data.get(position)), [starts[0] + 10_000, starts[1] - 20_000], "{keys}");
        assert_eq!(xf.header().wkc_errors, begin.wkc_errors, "{keys}");
        let counters = xf.host().counters();
        assert_eq!((counters.rx_full, counters.rx_dropped, counters.rx_unknown), (0, 0, 0), "{keys}");
        xf.close().unwrap();
    }
}

/// XF-17.7 n is adapted to the process data, so that the cycle is kept.
#[test]
fn n_follows_the_process_data() {
    let (mut xf, _) = started("drive*2");
    assert_eq!(xf.host().size(), DataSize::NEWER);
    safe_op(&mut xf, 8).unwrap();
    assert_eq!(xf.host().size(), DataSize::MANUAL);
    let (mut xf, _) = started("drive*30");
    let data = safe_op(&mut xf, 8).unwrap();
    assert_eq!(xf.host().size().bytes(), data.inputs().len());
}

/// XF-17.8 Process data that the chip does not take are reported, instead of an endless wait.
#[test]
fn a_fifo_that_stands_is_told() {
    let (mut xf, _) = started("drive");
    let mut data = safe_op(&mut xf, 8).unwrap();
    xf.set_state(Slaves::All, EtherCatState::Op).unwrap();
    let error = (0..100).find_map(|_| xf.cycle(&mut data).err()).expect("the FIFO is off");
    assert!(matches!(error, XfError::RxFifoStalled { held: 20, .. }), "{error}");
    assert!(error.to_string().contains("FifoEnable"), "{error}");
    xf.run(&FifoEnable { on: true }).unwrap();
    xf.cycle(&mut data).unwrap();
}

/// XF-17.9 An axis that does not switch on is reported with its state; its fault is reset, and it switches on.
#[test]
fn a_fault_is_told_and_reset() {
    let (mut xf, chip) = started("drive*2");
    let mut data = enabled(&mut xf).unwrap();
    let alarm = Fault::Alarm { axis: 0, fault: DeviceFault { code: 0x8611, resettable: true } };
    assert!(chip.chip().chip_mut().network_mut().slave_mut(1).unwrap().apply_fault(alarm));
    xf.cycle(&mut data).unwrap();
    xf.pass(Duration::from_millis(500)).unwrap();
    assert_eq!(xf.axis_state(1).unwrap(), Some(ecmsk::cia402::DriveState::Fault));
    assert_eq!(xf.axis_state(0).unwrap(), Some(ecmsk::cia402::DriveState::OperationEnabled));
    let error = xf.enable(1).unwrap_err();
    assert!(error.to_string().contains("axis 1 is in Fault after"), "{error}");
    xf.reset_fault(1).unwrap();
    xf.enable(1).unwrap();
    assert_eq!(xf.enable(9).unwrap_err(), XfError::NoAxis { motor: 9 });
    assert!(xf.add_axis(128, 0, &data).unwrap_err().to_string().contains("127"));
    assert_eq!(xf.sdo_read::<i8>(1, MODE).unwrap(), 8);
}

//! An axis behind an ECM-XF, from the start of the network to the end of its movement.

use ecmsk::coe::ObjectAddress;
use ecmsk::link::chip::ChipLink;
use ecmsk::xf::EtherCatState;
use ecmsk::xf::request::{FifoEnable, Reconfig, Slaves};
use ecmsk::xf_api::{NetworkConfig, Xf, XfError};

/// The distance of the axis' motion, in counts.
const DISTANCE: i32 = 5000;

/// Brings a network of one drive to OP, enables the axis and moves it by some thousand counts in CSP, with as many
/// RxPDOs. At the end it is within a few counts of the target, as a servo drive at rest.
///
/// # Errors
/// The first one.
pub fn move_axis<L: ChipLink>(xf: &mut Xf<L>) -> Result<(), XfError> {
    assert_eq!(xf.start_network(&NetworkConfig::default())?, 1);
    xf.set_state(Slaves::All, EtherCatState::PreOp)?;
    let mode = ObjectAddress::new(0x6060, 0);
    xf.sdo_write(0, mode, 8_i8)?;
    assert_eq!(xf.sdo_read::<i8>(0, mode)?, 8);
    xf.run(&Reconfig)?;
    xf.set_state(Slaves::All, EtherCatState::SafeOp)?;
    let mut data = xf.process_data()?;
    let target = data.output::<i32>(0, ObjectAddress::new(0x607A, 0))?;
    let position = data.input::<i32>(0, ObjectAddress::new(0x6064, 0))?;
    let start = data.get(position);
    data.set(target, start);
    xf.add_axis(0, 0, &data)?;
    xf.set_state(Slaves::All, EtherCatState::Op)?;
    xf.run(&FifoEnable { on: true })?;
    xf.cycle(&mut data)?;
    xf.enable(0)?;
    for at in (10..=DISTANCE).step_by(10) {
        data.set(target, start + at);
        xf.cycle(&mut data)?;
    }
    xf.finish(&mut data)?;
    let moved = data.get(position) - start;
    assert!((moved - DISTANCE).abs() <= 3, "{moved}");
    Ok(())
}

//! The object dictionary of pulse modules (CiA 402-2, ETG.6010). Positions are in pulses, speeds in pulses/s.

use super::{Channels, Hsp};
use crate::slave::AXES_MAX;
use crate::slave::axis::Settings;
use crate::slave::axis_objects::{AxisSlots, axis_objects, index, target_velocity, velocity_offset};
use crate::slave::device::{Identity, VENDOR_ID, description, identity, synchronization};
use crate::slave::dictionary::{Object, Values, check, join, only_if, rows};
use crate::slave::plant::PulseTrain;
use crate::slave::process_data::{Pdo, rx_pdo, tx_pdo};

/// Product codes, 0x1018:2, of modules with one channel and with two. \[OURS] "HSP1", "HSP2".
pub const PRODUCT_CODES: [u32; AXES_MAX] = [0x4853_5031, 0x4853_5032];
/// Revision, 0x1018:3.
pub const REVISION: u32 = 0x0001_0000;

const ONE: Identity = Identity {
    // The device profile is 402 (0x0192); 0x0004 stands for a stepper.
    device_type: 0x0004_0192,
    name: "HSP1 simulated pulse module",
    vendor_id: VENDOR_ID,
    product_code: PRODUCT_CODES[0],
    revision: REVISION,
};
const TWO: Identity = Identity { name: "HSP2 simulated pulse module", product_code: PRODUCT_CODES[1], ..ONE };

pub(super) const fn identity_of(channels: Channels) -> &'static Identity {
    match channels {
        Channels::One => &ONE,
        Channels::Two => &TWO,
    }
}

/// 0x6502, supported drive modes: homing, CSP, CSV.
const SUPPORTED_MODES: i64 = 1 << 5 | 1 << 7 | 1 << 8;

const AXES: [AxisSlots; AXES_MAX] = [AxisSlots::of::<_, 0>(OBJECTS), AxisSlots::of::<_, 1>(OBJECTS)];

/// The default values of all objects. \[OURS] Some depend on the maximum pulse rate: a channel brakes from that rate to 0 in
/// 0.1 s, and with a quick stop in 0.01 s. Homing searches for a switch at two turns/s and for zero at 0.2 turns/s.
pub(super) fn defaults(train: &PulseTrain, pulses_per_turn: u32) -> Values {
    let mut values = Values::new(OBJECTS);
    let turn = pulses_per_turn.max(5);
    for axis in &AXES {
        values.set(axis.max_velocity, train.max_rate);
        values.set(axis.slow_down, train.max_rate.saturating_mul(10).max(1));
        values.set(axis.quick_stop, train.max_rate.saturating_mul(100).max(1));
        values.set(axis.homing_speed_switch, turn.saturating_mul(2));
        values.set(axis.homing_speed_zero, turn / 5);
        values.set(axis.homing_acceleration, turn.saturating_mul(100));
    }
    values
}

/// The settings of a channel's axis, such as limits and ramps, from the values of the objects.
pub(super) fn settings(values: &Values, channel: usize) -> Settings {
    AXES[channel].settings(values)
}

type Row = Object<Hsp>;

/// The object dictionary.
pub(super) const OBJECTS: &[Row] = &join::<_, { rows(&PARTS) }>(&PARTS);
const _: () = check(OBJECTS);
const PARTS: [&[Row]; 7] = [
    &description(),
    &identity(),
    &synchronization(),
    &only_if(has::<0>, axis_objects::<_, 0>()),
    &channel::<0>(),
    &only_if(has::<1>, axis_objects::<_, 1>()),
    &channel::<1>(),
];

/// The PDOs at power-on. \[OURS] The indices of the second axis's PDOs are 16 higher than those of the first one, as in
/// ETG.6010. The PDOs for CSP are assigned. Some PDOs are empty, for masters that map objects into other PDOs than the first
/// ones. Only the low 16 bits of the digital inputs and outputs are used.
pub(super) const PDOS: &[Pdo<Hsp>] = &[
    rx_pdo!(OBJECTS, 0x1600, true, [0x6040_0010, 0x607A_0020, 0x60FE_0120]),
    rx_pdo!(OBJECTS, 0x1601, false, [0x6040_0010, 0x60FF_0020, 0x60FE_0120]),
    tx_pdo!(OBJECTS, 0x1A00, true, [0x6041_0010, 0x6064_0020, 0x60FD_0020]),
    Pdo::empty(0x1602),
    Pdo::empty(0x1603),
    Pdo::empty(0x1A01),
    Pdo::empty(0x1A02),
    Pdo::empty(0x1A03),
    rx_pdo!(OBJECTS, 0x1610, true, [0x6840_0010, 0x687A_0020, 0x68FE_0120]),
    rx_pdo!(OBJECTS, 0x1611, false, [0x6840_0010, 0x68FF_0020, 0x68FE_0120]),
    tx_pdo!(OBJECTS, 0x1A10, true, [0x6841_0010, 0x6864_0020, 0x68FD_0020]),
    Pdo::empty(0x1612),
    Pdo::empty(0x1613),
    Pdo::empty(0x1A11),
    Pdo::empty(0x1A12),
    Pdo::empty(0x1A13),
];

pub(super) const fn pdos_of(channels: Channels) -> &'static [Pdo<Hsp>] {
    match channels {
        Channels::One => PDOS.split_at(8).0,
        Channels::Two => PDOS,
    }
}

/// Whether the module has channel `N` (from 0).
fn has<const N: usize>(hsp: &Hsp) -> bool {
    hsp.axes.len() > N
}

/// The objects of channel `N` (from 0) that a pulse module has in addition to the objects of every CiA 402 axis.
const fn channel<const N: usize>() -> [Row; 6] {
    only_if(
        has::<N>,
        [
            Row::u32(index::<N>(0x60FD), 0, "Digital inputs").tx().live(|hsp| hsp.lines[N].inputs().into()),
            Row::u8(index::<N>(0x60FE), 0, "Digital outputs").default(1),
            // [OURS] Bits 16 to 31 are not wired: writes to them are ignored, and they read 0.
            Row::u32(index::<N>(0x60FE), 1, "Physical outputs")
                .rw()
                .rx()
                .live(|hsp| hsp.lines[N].outputs().into())
                .setter(|hsp, bits| {
                    hsp.lines[N].set_outputs(bits as u16);
                    Ok(())
                }),
            velocity_offset::<_, N>(),
            target_velocity::<_, N>(),
            Row::u32(index::<N>(0x6502), 0, "Supported drive modes").default(SUPPORTED_MODES),
        ],
    )
}

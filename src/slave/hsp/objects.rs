//! The object dictionary of pulse modules (CiA 402-2, ETG.6010). Positions in pulses, speeds in pulses/s.

use super::{Channels, Hsp};
use crate::cia402::{Controlword, SECOND_AXIS_OFFSET};
use crate::slave::AXES_MAX;
use crate::slave::axis::{Axis, NO_FOLLOWING_WINDOW, Settings, rounded};
use crate::slave::device::{Identity, VENDOR_ID, identity, synchronization};
use crate::slave::dictionary::{Object, Slot, Values, check, join, only_if, rows, slot};
use crate::slave::homing::HomingSettings;
use crate::slave::plant::PulseTrain;
use crate::slave::process_data::{Pdo, rx_pdo, tx_pdo};
use crate::slave::state_machine::OptionCodes;

/// Product codes, 0x1018:2, of modules with one channel and with two. \[OURS] "HSP1", "HSP2".
pub const PRODUCT_CODES: [u32; AXES_MAX] = [0x4853_5031, 0x4853_5032];
/// Revision, 0x1018:3.
pub const REVISION: u32 = 0x0001_0000;

const ONE: Identity = Identity {
    // Device profile 402, stepper.
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

/// 0x6502: homing, CSP, CSV.
const SUPPORTED_MODES: i64 = 1 << 5 | 1 << 7 | 1 << 8;

/// The slots of an object of both axes.
macro_rules! of_each_axis {
    ($index:literal) => {
        of_each_axis!($index, 0)
    };
    ($index:literal, $sub:literal) => {
        [slot(OBJECTS, $index, $sub), slot(OBJECTS, $index + SECOND_AXIS_OFFSET, $sub)]
    };
}

type Slots<T> = [Slot<T>; AXES_MAX];
const QUICK_STOP_OPTION: Slots<i16> = of_each_axis!(0x605A);
const SHUTDOWN_OPTION: Slots<i16> = of_each_axis!(0x605B);
const DISABLE_OPTION: Slots<i16> = of_each_axis!(0x605C);
const FAULT_OPTION: Slots<i16> = of_each_axis!(0x605E);
const MAX_VELOCITY: Slots<u32> = of_each_axis!(0x607F);
const PROFILE_DECELERATION: Slots<u32> = of_each_axis!(0x6084);
const QUICK_STOP_DECELERATION: Slots<u32> = of_each_axis!(0x6085);
const HALT_OPTION: Slots<i16> = of_each_axis!(0x605D);
const HOME_OFFSET: Slots<i32> = of_each_axis!(0x607C);
const HOMING_METHOD: Slots<i8> = of_each_axis!(0x6098);
const HOMING_SPEED_SWITCH: Slots<u32> = of_each_axis!(0x6099, 1);
const HOMING_SPEED_ZERO: Slots<u32> = of_each_axis!(0x6099, 2);
const HOMING_ACCELERATION: Slots<u32> = of_each_axis!(0x609A);

/// The default values of the table, and \[OURS] those that depend on the greatest rate: from that rate the channel brakes in a
/// tenth of a second, and by a quick stop in a hundredth. Homing searches a switch with two turns a second, and zero with a fifth
/// of a turn a second.
pub(super) fn defaults(train: &PulseTrain, pulses_per_turn: u32) -> Values {
    let mut values = Values::new(OBJECTS);
    let turn = pulses_per_turn.max(5);
    for n in 0..AXES_MAX {
        values.set(MAX_VELOCITY[n], train.max_rate);
        values.set(PROFILE_DECELERATION[n], train.max_rate.saturating_mul(10).max(1));
        values.set(QUICK_STOP_DECELERATION[n], train.max_rate.saturating_mul(100).max(1));
        values.set(HOMING_SPEED_SWITCH[n], turn.saturating_mul(2));
        values.set(HOMING_SPEED_ZERO[n], turn / 5);
        values.set(HOMING_ACCELERATION[n], turn.saturating_mul(100));
    }
    values
}

/// The settings of the axis of a channel. Its following error is not monitored.
pub(super) fn settings(values: &Values, channel: usize) -> Settings {
    Settings {
        following_window: NO_FOLLOWING_WINDOW,
        following_timeout_ms: 0,
        position_limits: (0, 0),
        max_velocity: values.get(MAX_VELOCITY[channel]),
        max_torque: 0,
        slow_down: values.get(PROFILE_DECELERATION[channel]),
        quick_stop: values.get(QUICK_STOP_DECELERATION[channel]),
        options: OptionCodes {
            quick_stop: values.get(QUICK_STOP_OPTION[channel]),
            shutdown: values.get(SHUTDOWN_OPTION[channel]),
            disable_operation: values.get(DISABLE_OPTION[channel]),
            fault_reaction: values.get(FAULT_OPTION[channel]),
        },
        homing: HomingSettings {
            method: values.get(HOMING_METHOD[channel]),
            offset: values.get(HOME_OFFSET[channel]),
            switch_speed: values.get(HOMING_SPEED_SWITCH[channel]),
            zero_speed: values.get(HOMING_SPEED_ZERO[channel]),
            acceleration: values.get(HOMING_ACCELERATION[channel]),
            halt_option: values.get(HALT_OPTION[channel]),
        },
    }
}

type Row = Object<Hsp>;

/// The object dictionary. 0x605D, halt, acts in homing. 0x6098 takes any value: a method that is not supported ends in a homing
/// error when it is started \[OURS].
pub(super) const OBJECTS: &[Row] = &join::<_, { rows(&PARTS) }>(&PARTS);
const _: () = check(OBJECTS);
const PARTS: [&[Row]; 4] = [&identity(), &synchronization(), &channel::<0>(), &channel::<1>()];

/// The PDOs at power-on. \[OURS] Those of the second axis are 16 higher, as in ETG.6010; those of CSP are assigned. Of the digital
/// inputs and outputs the low 16 bits are used.
pub(super) const PDOS: &[Pdo<Hsp>] = &[
    rx_pdo!(OBJECTS, 0x1600, true, [0x6040_0010, 0x607A_0020, 0x60FE_0120]),
    rx_pdo!(OBJECTS, 0x1601, false, [0x6040_0010, 0x60FF_0020, 0x60FE_0120]),
    tx_pdo!(OBJECTS, 0x1A00, true, [0x6041_0010, 0x6064_0020, 0x60FD_0020]),
    rx_pdo!(OBJECTS, 0x1610, true, [0x6840_0010, 0x687A_0020, 0x68FE_0120]),
    rx_pdo!(OBJECTS, 0x1611, false, [0x6840_0010, 0x68FF_0020, 0x68FE_0120]),
    tx_pdo!(OBJECTS, 0x1A10, true, [0x6841_0010, 0x6864_0020, 0x68FD_0020]),
];

pub(super) const fn pdos_of(channels: Channels) -> &'static [Pdo<Hsp>] {
    match channels {
        Channels::One => PDOS.split_at(3).0,
        Channels::Two => PDOS,
    }
}

/// Whether the module has channel `N` (from 0).
fn has<const N: usize>(hsp: &Hsp) -> bool {
    hsp.axes.len() > N
}

fn axis<const N: usize>(hsp: &Hsp) -> &Axis {
    &hsp.axes[N]
}

fn changed<const N: usize>(hsp: &mut Hsp) {
    hsp.settings_changed(N);
}

/// Objects of the axis of channel `N` (from 0).
const fn channel<const N: usize>() -> [Row; 28] {
    const fn index(of_axis_1: u16, channel: usize) -> u16 {
        of_axis_1 + SECOND_AXIS_OFFSET * channel as u16
    }
    only_if(
        has::<N>,
        [
            Row::u16(index(0x603F, N), 0, "Error code").tx().live(|hsp| axis::<N>(hsp).measured().error_code.into()),
            Row::u16(index(0x6040, N), 0, "Controlword")
                .rw()
                .rx()
                .live(|hsp| axis::<N>(hsp).machine().controlword().0.into())
                .setter(|hsp, word| {
                    hsp.axes[N].machine_mut().command(Controlword(word as u16));
                    Ok(())
                }),
            Row::u16(index(0x6041, N), 0, "Statusword").tx().live(|hsp| axis::<N>(hsp).measured().statusword.0.into()),
            Row::i16(index(0x605A, N), 0, "Quick stop option code").rw().range(0, 8).default(2).changed(changed::<N>),
            Row::i16(index(0x605B, N), 0, "Shutdown option code").rw().range(0, 1).changed(changed::<N>),
            Row::i16(index(0x605C, N), 0, "Disable operation option code")
                .rw()
                .range(0, 1)
                .default(1)
                .changed(changed::<N>),
            Row::i16(index(0x605D, N), 0, "Halt option code").rw().range(1, 4).default(1).changed(changed::<N>),
            Row::i16(index(0x605E, N), 0, "Fault reaction option code")
                .rw()
                .range(0, 4)
                .default(2)
                .changed(changed::<N>),
            Row::i8(index(0x6060, N), 0, "Modes of operation")
                .rw()
                .rx()
                .live(|hsp| axis::<N>(hsp).mode().code().into())
                .setter(|hsp, code| hsp.set_mode(N, code)),
            Row::i8(index(0x6061, N), 0, "Modes of operation display")
                .tx()
                .live(|hsp| axis::<N>(hsp).mode().code().into()),
            Row::i32(index(0x6062, N), 0, "Position demand value").tx().live(|hsp| axis::<N>(hsp).demand()),
            Row::i32(index(0x6064, N), 0, "Position actual value")
                .tx()
                .live(|hsp| axis::<N>(hsp).measured().position.into()),
            Row::i32(index(0x606C, N), 0, "Velocity actual value")
                .tx()
                .live(|hsp| rounded(axis::<N>(hsp).plant().velocity())),
            Row::i32(index(0x607A, N), 0, "Target position")
                .rw()
                .rx_by(|hsp, position| hsp.axes[N].take_target_position(position as i32))
                .live(|hsp| axis::<N>(hsp).targets().position.into())
                .setter(|hsp, position| {
                    hsp.axes[N].targets_mut().position = position as i32;
                    Ok(())
                }),
            Row::i32(index(0x607C, N), 0, "Home offset").rw().changed(changed::<N>),
            Row::u32(index(0x607F, N), 0, "Max profile velocity").rw().rx().changed(changed::<N>),
            Row::u32(index(0x6084, N), 0, "Profile deceleration")
                .rw()
                .rx()
                .range(1, u32::MAX as i64)
                .default(1)
                .changed(changed::<N>),
            Row::u32(index(0x6085, N), 0, "Quick stop deceleration")
                .rw()
                .rx()
                .range(1, u32::MAX as i64)
                .default(1)
                .changed(changed::<N>),
            Row::i8(index(0x6098, N), 0, "Homing method").rw().rx().default(35).changed(changed::<N>),
            Row::u8(index(0x6099, N), 0, "Homing speeds").default(2),
            Row::u32(index(0x6099, N), 1, "Speed during search for switch").rw().rx().changed(changed::<N>),
            Row::u32(index(0x6099, N), 2, "Speed during search for zero").rw().rx().changed(changed::<N>),
            Row::u32(index(0x609A, N), 0, "Homing acceleration")
                .rw()
                .rx()
                .range(1, u32::MAX as i64)
                .default(1)
                .changed(changed::<N>),
            Row::u32(index(0x60FD, N), 0, "Digital inputs").tx().live(|hsp| hsp.lines[N].inputs().into()),
            Row::u8(index(0x60FE, N), 0, "Digital outputs").default(1),
            // [OURS] Bits 16 to 31 are not wired: they are ignored, and read as 0.
            Row::u32(index(0x60FE, N), 1, "Physical outputs")
                .rw()
                .rx()
                .live(|hsp| hsp.lines[N].outputs().into())
                .setter(|hsp, bits| {
                    hsp.lines[N].set_outputs(bits as u16);
                    Ok(())
                }),
            Row::i32(index(0x60FF, N), 0, "Target velocity")
                .rw()
                .rx()
                .live(|hsp| axis::<N>(hsp).targets().velocity.into())
                .setter(|hsp, velocity| {
                    hsp.axes[N].targets_mut().velocity = velocity as i32;
                    Ok(())
                }),
            Row::u32(index(0x6502, N), 0, "Supported drive modes").default(SUPPORTED_MODES),
        ],
    )
}

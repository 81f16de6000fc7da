//! The objects that every CiA 402 axis has, whatever the kind of its device: their rows in the object dictionary, and the
//! settings that an axis reads from them.
//!
//! To add an object for all axes, add a row to [`axis_objects`]. If the object changes the behaviour of the axis, add a
//! slot to [`AxisSlots`] too.

use super::axis::{NO_FOLLOWING_WINDOW, Settings, rounded};
use super::device::Model;
use super::dictionary::{Object, Slot, Values, slot};
use super::homing::HomingSettings;
use super::state_machine::OptionCodes;
use crate::ethercat::cia402::{Controlword, Mode, SECOND_AXIS_OFFSET};
use crate::ethercat::coe::AbortCode;

/// A device model with CiA 402 axes.
pub(super) trait AxisModel: Model {
    /// Whether the axes of the device support this mode of operation.
    fn has_mode(&self, mode: Mode) -> bool;

    /// The settings of an axis (from 0), from the stored values.
    fn settings(&self, axis: usize) -> Settings;
}

/// The index of an object of axis `N` (from 0); `of_axis_1` is the index of the same object of the first axis.
pub(super) const fn index<const N: usize>(of_axis_1: u16) -> u16 {
    of_axis_1 + SECOND_AXIS_OFFSET * N as u16
}

/// Reads the settings of axis `N` from the objects again and applies them to the axis. Called after one of these
/// objects was written.
pub(super) fn changed<M: AxisModel, const N: usize>(device: &mut M) {
    let settings = device.settings(N);
    device.axes_mut()[N].apply_settings(settings);
}

fn set_mode<M: AxisModel, const N: usize>(device: &mut M, code: i64) -> Result<(), AbortCode> {
    let mode = u8::try_from(code).ok().and_then(Mode::from_code).filter(|mode| device.has_mode(*mode));
    device.axes_mut()[N].set_mode(mode.ok_or(AbortCode::VALUE_RANGE)?);
    Ok(())
}

/// The dictionary row of an acceleration or deceleration, counts/s².
const fn ramp<M: AxisModel, const N: usize>(of_axis_1: u16, name: &'static str) -> Object<M> {
    Object::u32(index::<N>(of_axis_1), 0, name).rw().rx().range(1, u32::MAX as i64).default(1).changed(changed::<M, N>)
}

/// The objects of axis `N` (from 0). The halt option code 0x605D acts in homing. 0x6098 accepts any value: an unsupported
/// method causes a homing error when homing is started \[OURS].
pub(super) const fn axis_objects<M: AxisModel, const N: usize>() -> [Object<M>; 27] {
    [
        Object::u16(index::<N>(0x603F), 0, "Error code")
            .tx()
            .live(|device: &M| device.axes()[N].measured().error_code.into()),
        Object::u16(index::<N>(0x6040), 0, "Controlword")
            .rw()
            .rx()
            .live(|device: &M| device.axes()[N].machine().controlword().0.into())
            .setter(|device: &mut M, word| {
                device.axes_mut()[N].machine_mut().command(Controlword(word as u16));
                Ok(())
            }),
        Object::u16(index::<N>(0x6041), 0, "Statusword")
            .tx()
            .live(|device: &M| device.axes()[N].measured().statusword.0.into()),
        Object::i16(index::<N>(0x605A), 0, "Quick stop option code")
            .rw()
            .range(0, 8)
            .default(2)
            .changed(changed::<M, N>),
        Object::i16(index::<N>(0x605B), 0, "Shutdown option code").rw().range(0, 1).changed(changed::<M, N>),
        Object::i16(index::<N>(0x605C), 0, "Disable operation option code")
            .rw()
            .range(0, 1)
            .default(1)
            .changed(changed::<M, N>),
        Object::i16(index::<N>(0x605D), 0, "Halt option code").rw().range(1, 4).default(1).changed(changed::<M, N>),
        Object::i16(index::<N>(0x605E), 0, "Fault reaction option code")
            .rw()
            .range(0, 4)
            .default(2)
            .changed(changed::<M, N>),
        Object::i8(index::<N>(0x6060), 0, "Modes of operation")
            .rw()
            .rx()
            .live(|device: &M| device.axes()[N].mode().code().into())
            .setter(set_mode::<M, N>),
        Object::i8(index::<N>(0x6061), 0, "Modes of operation display")
            .tx()
            .live(|device: &M| device.axes()[N].mode().code().into()),
        Object::i32(index::<N>(0x6062), 0, "Position demand value").tx().live(|device: &M| device.axes()[N].demand()),
        Object::i32(index::<N>(0x6063), 0, "Position actual internal value")
            .tx()
            .live(|device: &M| device.axes()[N].plant().position()),
        Object::i32(index::<N>(0x6064), 0, "Position actual value")
            .tx()
            .live(|device: &M| device.axes()[N].measured().position.into()),
        Object::i32(index::<N>(0x606B), 0, "Velocity demand value")
            .tx()
            .live(|device: &M| device.axes()[N].velocity_demand()),
        Object::i32(index::<N>(0x606C), 0, "Velocity actual value")
            .tx()
            .live(|device: &M| rounded(device.axes()[N].plant().velocity())),
        Object::i32(index::<N>(0x607A), 0, "Target position")
            .rw()
            .rx_by(|device: &mut M, position| device.axes_mut()[N].take_target_position(position as i32))
            .live(|device: &M| device.axes()[N].targets().position.into())
            .setter(|device: &mut M, position| {
                device.axes_mut()[N].targets_mut().position = position as i32;
                Ok(())
            }),
        Object::i32(index::<N>(0x607C), 0, "Home offset").rw().changed(changed::<M, N>),
        Object::u32(index::<N>(0x607F), 0, "Max profile velocity").rw().rx().changed(changed::<M, N>),
        ramp::<M, N>(0x6084, "Profile deceleration"),
        ramp::<M, N>(0x6085, "Quick stop deceleration"),
        Object::i8(index::<N>(0x6098), 0, "Homing method").rw().rx().default(35).changed(changed::<M, N>),
        Object::u8(index::<N>(0x6099), 0, "Homing speeds").default(2),
        Object::u32(index::<N>(0x6099), 1, "Speed during search for switch").rw().rx().changed(changed::<M, N>),
        Object::u32(index::<N>(0x6099), 2, "Speed during search for zero").rw().rx().changed(changed::<M, N>),
        ramp::<M, N>(0x609A, "Homing acceleration"),
        Object::i32(index::<N>(0x60B0), 0, "Position offset")
            .rw()
            .rx()
            .live(|device: &M| device.axes()[N].offsets().position.into())
            .setter(|device: &mut M, counts| {
                device.axes_mut()[N].offsets_mut().position = counts as i32;
                Ok(())
            }),
        Object::i32(index::<N>(0x60FC), 0, "Position demand internal value")
            .tx()
            .live(|device: &M| device.axes()[N].shaft_demand()),
    ]
}

/// The velocity offset of axis `N` (from 0), for devices with CSV.
pub(super) const fn velocity_offset<M: AxisModel, const N: usize>() -> Object<M> {
    Object::i32(index::<N>(0x60B1), 0, "Velocity offset")
        .rw()
        .rx()
        .live(|device: &M| device.axes()[N].offsets().velocity.into())
        .setter(|device: &mut M, velocity| {
            device.axes_mut()[N].offsets_mut().velocity = velocity as i32;
            Ok(())
        })
}

/// The target velocity of axis `N` (from 0), for devices with CSV.
pub(super) const fn target_velocity<M: AxisModel, const N: usize>() -> Object<M> {
    Object::i32(index::<N>(0x60FF), 0, "Target velocity")
        .rw()
        .rx()
        .live(|device: &M| device.axes()[N].targets().velocity.into())
        .setter(|device: &mut M, velocity| {
            device.axes_mut()[N].targets_mut().velocity = velocity as i32;
            Ok(())
        })
}

/// Where a device stores the values of [`axis_objects`], one [`Slot`] for each object that the axis reads.
pub(super) struct AxisSlots {
    pub(super) max_velocity: Slot<u32>,
    pub(super) slow_down: Slot<u32>,
    pub(super) quick_stop: Slot<u32>,
    pub(super) homing_speed_switch: Slot<u32>,
    pub(super) homing_speed_zero: Slot<u32>,
    pub(super) homing_acceleration: Slot<u32>,
    homing_method: Slot<i8>,
    home_offset: Slot<i32>,
    halt_option: Slot<i16>,
    quick_stop_option: Slot<i16>,
    shutdown_option: Slot<i16>,
    disable_option: Slot<i16>,
    fault_option: Slot<i16>,
}

impl AxisSlots {
    /// Finds the slots of axis `N` (from 0) in an object dictionary, at compile time.
    pub(super) const fn of<D, const N: usize>(objects: &[Object<D>]) -> Self {
        Self {
            max_velocity: slot(objects, index::<N>(0x607F), 0),
            slow_down: slot(objects, index::<N>(0x6084), 0),
            quick_stop: slot(objects, index::<N>(0x6085), 0),
            homing_speed_switch: slot(objects, index::<N>(0x6099), 1),
            homing_speed_zero: slot(objects, index::<N>(0x6099), 2),
            homing_acceleration: slot(objects, index::<N>(0x609A), 0),
            homing_method: slot(objects, index::<N>(0x6098), 0),
            home_offset: slot(objects, index::<N>(0x607C), 0),
            halt_option: slot(objects, index::<N>(0x605D), 0),
            quick_stop_option: slot(objects, index::<N>(0x605A), 0),
            shutdown_option: slot(objects, index::<N>(0x605B), 0),
            disable_option: slot(objects, index::<N>(0x605C), 0),
            fault_option: slot(objects, index::<N>(0x605E), 0),
        }
    }

    /// The axis settings from the stored values. Position limits and the monitoring of the following error are off; a
    /// kind of device that has their objects sets them itself.
    pub(super) fn settings(&self, values: &Values) -> Settings {
        Settings {
            following_window: NO_FOLLOWING_WINDOW,
            following_timeout_ms: 0,
            position_limits: (0, 0),
            max_velocity: values.get(self.max_velocity),
            max_torque: 0,
            homing_exit: None,
            slow_down: values.get(self.slow_down),
            quick_stop: values.get(self.quick_stop),
            options: OptionCodes {
                quick_stop: values.get(self.quick_stop_option),
                shutdown: values.get(self.shutdown_option),
                disable_operation: values.get(self.disable_option),
                fault_reaction: values.get(self.fault_option),
            },
            homing: HomingSettings {
                method: values.get(self.homing_method),
                offset: values.get(self.home_offset),
                switch_speed: values.get(self.homing_speed_switch),
                zero_speed: values.get(self.homing_speed_zero),
                acceleration: values.get(self.homing_acceleration),
                halt_option: values.get(self.halt_option),
                stays_beyond_home: false,
            },
        }
    }
}

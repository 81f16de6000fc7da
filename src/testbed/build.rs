//! Builds the simulated slaves that a link names in `slaves=`: the model of each kind, with its manufacturer-specific objects
//! and with the travel of its axes (switches, end stops and start position).

use super::manufacturer_objects;
use crate::address::slaves::{SlaveModel, SlaveSpec};
use crate::address::travel::{PositionRange, TravelSpec};
use crate::fieldbus::MAX_AXES;
use crate::link::machine_error::ManufacturerObjectsError;
use crate::slave::{
    Channels, Dp3cl, Dp3clConfig, Drive, DriveConfig, HomeSwitch, Hsp, HspConfig, Io, ManufacturerObjects, Slave,
    Travel,
};

/// Builds the slaves that a link names in `slaves=`, with their manufacturer-specific objects.
///
/// # Errors
/// [`ManufacturerObjectsError`] if a file of manufacturer-specific objects cannot be used.
pub(crate) fn slaves(specs: &[SlaveSpec]) -> Result<Vec<Box<dyn Slave>>, ManufacturerObjectsError> {
    Ok(models(specs, manufacturer_objects::of_slaves(specs)?))
}

pub(super) fn models(
    specs: &[SlaveSpec],
    manufacturer_objects: Vec<Option<ManufacturerObjects>>,
) -> Vec<Box<dyn Slave>> {
    let one = |(spec, objects): (&SlaveSpec, Option<ManufacturerObjects>)| {
        let mut slave = build(spec.model, &spec.travel);
        slave.set_identity(spec.identity.vendor, spec.identity.product, spec.identity.revision);
        if let Some(objects) = objects {
            slave.add_manufacturer_objects(objects);
        }
        slave
    };
    specs.iter().zip(manufacturer_objects).map(one).collect()
}

/// A slave of this kind in its power-on state, with the given travel of its axes.
fn build(model: SlaveModel, travel: &TravelSpec) -> Box<dyn Slave> {
    match model {
        SlaveModel::Drive => drive(DriveConfig::default(), travel),
        SlaveModel::Step => drive(DriveConfig::stepper(), travel),
        SlaveModel::Dp3cl => dp3cl(Dp3clConfig::default(), travel),
        SlaveModel::Hsp => hsp(Channels::One, travel),
        SlaveModel::Hsp2 => hsp(Channels::Two, travel),
        SlaveModel::Io => Box::<Io>::default(),
    }
}

/// A drive whose switches, end stops and start position are those that the link gives, or else the defaults.
fn drive(config: DriveConfig, said: &TravelSpec) -> Box<dyn Slave> {
    let (position, travel) = (said.start.unwrap_or(0), travel(said, config.travel));
    Box::new(Drive::new(DriveConfig { position, travel, ..config }))
}

/// A DP3CL whose switches, end stops and start position are those that the link gives, or else the defaults.
fn dp3cl(config: Dp3clConfig, said: &TravelSpec) -> Box<dyn Slave> {
    let (position, travel) = (said.start.unwrap_or(0), travel(said, config.travel));
    Box::new(Dp3cl::new(Dp3clConfig { position, travel, ..config }))
}

/// A pulse module whose switches, end stops and start position are those that the link gives, or else the defaults.
fn hsp(channels: Channels, said: &TravelSpec) -> Box<dyn Slave> {
    let config = HspConfig::with(channels);
    let travels = config.travels.map(|usual| travel(said, usual));
    let positions = [said.start.unwrap_or(0); MAX_AXES];
    Box::new(Hsp::new(HspConfig { positions, travels, ..config }))
}

/// The travel that the link gives; a missing value is taken from `usual`, the default of the kind of slave.
fn travel(said: &TravelSpec, usual: Travel) -> Travel {
    let home = |span: PositionRange| match span {
        PositionRange { from: Some(first), to: Some(last) } => Some(HomeSwitch::Cam { first, last }),
        PositionRange { from: Some(first), to: None } => Some(HomeSwitch::From(first)),
        PositionRange { from: None, to: Some(last) } => Some(HomeSwitch::UpTo(last)),
        PositionRange { from: None, to: None } => None,
    };
    Travel {
        negative_limit: said.limits.map_or(usual.negative_limit, |limits| limits?.from),
        positive_limit: said.limits.map_or(usual.positive_limit, |limits| limits?.to),
        home: said.home.map_or(usual.home, |span| span.and_then(home)),
        index: said.index.unwrap_or(usual.index),
        stops: said.stops.and_then(|stops| stops.from.zip(stops.to)),
        search_limit: said.search.unwrap_or(usual.search_limit),
        // [OURS] Limit switches that a link gives stop the axis in every mode. The default ones act only in homing: an axis may
        // turn endlessly, and they must not stop it.
        limits_stop_motion: said.limits.flatten().is_some(),
    }
}

//! Units in the comparisons of `ecmsk find`. An axis given by name has the unit of the machine file, and one given by
//! slave number has counts. A unit after a literal number applies to the whole comparison.

use ecmsk::machine_file::{MachineFile, Unit};

use super::condition::{Leaf, Number, OfAxis, What};
use crate::machine_option::label;
use crate::motion::Quantity;

/// What a literal number with a unit measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Measure {
    Distance(Unit),
    Speed(Unit),
    Percent,
}

/// A kind of number; only numbers of the same kind may be compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Distance,
    Speed,
    Percent,
    Code,
    State,
    Entries,
}

impl Kind {
    const fn words(self) -> &'static str {
        match self {
            Self::Distance => "a position or distance",
            Self::Speed => "a velocity",
            Self::Percent => "a torque in %",
            Self::Code => "an error code",
            Self::State => "a state of the network",
            Self::Entries => "a number of entries",
        }
    }
}

impl Leaf {
    /// The kind of the number; `None` for a literal number without a unit, which fits any kind.
    const fn kind(&self) -> Option<Kind> {
        Some(match self.what {
            What::Literal { measure: None, .. } => return None,
            What::Literal { measure: Some(Measure::Percent), .. } => Kind::Percent,
            What::Literal { measure: Some(Measure::Distance(_)), .. } => Kind::Distance,
            What::Literal { measure: Some(Measure::Speed(_)), .. } => Kind::Speed,
            What::OfAxis { quantity, .. } => match quantity {
                OfAxis::Moving(Quantity::Velocity) => Kind::Speed,
                OfAxis::Moving(Quantity::Torque) => Kind::Percent,
                OfAxis::Alarm => Kind::Code,
                OfAxis::Position | OfAxis::Target | OfAxis::Moving(_) => Kind::Distance,
            },
            What::State | What::StateWord(_) => Kind::State,
            What::Fifo => Kind::Entries,
        })
    }

    /// The unit after a literal number of a distance or a speed.
    const fn written(&self) -> Option<Unit> {
        match self.what {
            What::Literal { measure: Some(Measure::Distance(unit) | Measure::Speed(unit)), .. } => Some(unit),
            _ => None,
        }
    }

    /// The axis of a quantity, and whether the axis is given by its name.
    const fn axis(&self) -> Option<(u8, bool)> {
        match self.what {
            What::OfAxis { slave, is_named, .. } => Some((slave, is_named)),
            _ => None,
        }
    }
}

/// Converts all values of a comparison to one unit. `at` is the position of the comparison in the expression.
///
/// # Errors
/// The position, and why the numbers cannot be compared.
pub fn settle(at: usize, sides: [&mut Number; 2], machine: Option<&MachineFile>) -> Result<(), (usize, String)> {
    let mut leaves: Vec<&mut Leaf> = sides.into_iter().flat_map(Number::leaves).collect();
    if leaves.iter().all(|leaf| matches!(leaf.what, What::Literal { .. } | What::StateWord(_))) {
        return Err((at, "it compares nothing of the recording; name a quantity, as in position(1) > 500".to_owned()));
    }
    let Some(kind) = leaves.iter().find_map(|leaf| leaf.kind()) else { return Ok(()) };
    if let Some((leaf, other)) =
        leaves.iter().find_map(|leaf| Some((leaf, leaf.kind().filter(|other| *other != kind)?)))
    {
        let (this, first) = (other.words(), kind.words());
        return Err((leaf.at, format!("this is {this}, and what it is compared with is {first}; compare each alone")));
    }
    match kind {
        Kind::Percent => {
            let torques = leaves.into_iter().filter(|leaf| leaf.axis().is_some());
            torques.for_each(|leaf| leaf.divisor = 10.0);
            Ok(())
        }
        Kind::Distance | Kind::Speed => in_one_unit(&mut leaves, machine),
        Kind::Code | Kind::State | Kind::Entries => Ok(()),
    }
}

fn in_one_unit(leaves: &mut [&mut Leaf], machine: Option<&MachineFile>) -> Result<(), (usize, String)> {
    let unit_in_file = |slave| machine.and_then(|machine| machine.axis_of(slave)).map(|axis| axis.unit);
    let own = |slave, is_named: bool| unit_in_file(slave).filter(|_| is_named).unwrap_or_default();
    let written = leaves.iter().find_map(|leaf| leaf.written());
    let first = leaves.iter().find_map(|leaf| leaf.axis()).map(|(slave, is_named)| own(slave, is_named));
    let unit = written.or(first).unwrap_or_default();
    let is_usual = leaves.iter().filter_map(|leaf| leaf.axis()).all(|(slave, is_named)| own(slave, is_named) == unit);
    for leaf in leaves {
        match leaf.what {
            What::Literal { measure: Some(_), .. } if leaf.written() != Some(unit) => {
                return Err((leaf.at, format!("this is not in {unit} as the other number is; write both in one unit")));
            }
            What::Literal { value, measure: None } if written.is_some() && !is_usual && value != 0.0 => {
                return Err((leaf.at, format!("the unit is missing behind {value}; write {value}{unit}")));
            }
            What::OfAxis { quantity, slave, is_named } => {
                let axis = label(machine, slave);
                let in_file = unit_in_file(slave).unwrap_or_default();
                if written.is_none() && own(slave, is_named) != unit {
                    let own = own(slave, is_named);
                    let why = format!("axis {axis} is in {own} here, and the one before in {unit}");
                    return Err((leaf.at, format!("{why}; write units behind numbers, or both axes by name")));
                }
                if unit == Unit::Counts {
                    continue;
                }
                let Some(found) = machine.and_then(|machine| machine.axis_of(slave)).filter(|_| in_file == unit) else {
                    return Err((leaf.at, format!("axis {axis} is not in {unit} by a machine file; see --machine")));
                };
                let counts = found.scale.counts_per_unit;
                leaf.divisor = if quantity.is_magnitude() { counts.abs() } else { counts };
            }
            _ => {}
        }
    }
    Ok(())
}

//! Where a network differs from a machine file.

use std::fmt;

use ecmsk::link::slaves::{SlaveModel, word};
use ecmsk::machine_file::MachineFile;
use ecmsk::sk::SlaveKind;
use serde_json::{Value, json};

use super::network::FoundSlave;

/// One difference.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Difference {
    /// The file has more slaves.
    Missing { slave: usize },
    /// The network has more slaves.
    Unexpected { slave: usize, vendor: u32, product: u32 },
    /// The slave is another device.
    Identity { slave: usize, what: &'static str, file: u32, found: u32 },
    /// The slave is of another kind.
    Kind { slave: usize, file: &'static str, found: &'static str },
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Missing { slave } => {
                write!(f, "slave {slave}: it is in the file, and does not answer; check its cable and power")
            }
            Self::Unexpected { slave, vendor, product } => write!(
                f,
                "slave {slave}: it is there, and not in the file: vendor 0x{vendor:08X}, product 0x{product:08X}; add [slaves.{slave}]"
            ),
            Self::Identity { slave, what, file, found } => write!(
                f,
                "slave {slave}: its {what} is 0x{found:08X}, the file says 0x{file:08X}; correct the order of the cable, or the file"
            ),
            Self::Kind { slave, file, found } => {
                write!(f, "slave {slave}: it is of kind {found}, the file says {file}; correct the file")
            }
        }
    }
}

impl Difference {
    /// Adds the difference to a line of JSON.
    pub fn put(&self, line: &mut Value) {
        let (slave, what, file, found) = match self {
            Self::Missing { slave } => (slave, "missing", Value::Null, Value::Null),
            Self::Unexpected { slave, vendor, product } => {
                (slave, "unexpected", Value::Null, json!({"vendor": vendor, "product": product}))
            }
            Self::Identity { slave, what, file, found } => (slave, *what, (*file).into(), (*found).into()),
            Self::Kind { slave, file, found } => (slave, "kind", (*file).into(), (*found).into()),
        };
        line["slave"] = (*slave).into();
        line["difference"] = what.into();
        line["expected"] = file;
        line["found"] = found;
    }
}

/// The differences, by the numbers of the slaves.
pub fn differences(machine: &MachineFile, found: &[FoundSlave]) -> Vec<Difference> {
    let mut all = Vec::new();
    for (slave, expected) in (1..).zip(&machine.slaves) {
        let Some(found) = found.get(slave - 1) else {
            all.push(Difference::Missing { slave });
            continue;
        };
        let ids = [
            ("vendor", expected.expected.vendor, found.vendor),
            ("product", expected.expected.product, found.product),
            ("revision", expected.expected.revision, found.revision),
        ];
        let wrong =
            ids.into_iter().filter_map(|(what, file, found)| Some((what, file.filter(|file| *file != found)?, found)));
        all.extend(wrong.map(|(what, file, found)| Difference::Identity { slave, what, file, found }));
        // A pulse module has the device type of a stepper.
        let axis = |kind| matches!(kind, SlaveKind::Step | SlaveKind::Hsp);
        let kind = found.kind.map(SlaveModel::kind).filter(|_| expected.kind != SlaveKind::None);
        if let Some(kind) = kind.filter(|kind| *kind != expected.kind && !(axis(*kind) && axis(expected.kind))) {
            all.push(Difference::Kind { slave, file: word(expected.kind), found: word(kind) });
        }
    }
    let more = (1..).zip(found).skip(machine.slaves.len());
    all.extend(more.map(|(slave, found)| Difference::Unexpected {
        slave,
        vendor: found.vendor,
        product: found.product,
    }));
    all
}

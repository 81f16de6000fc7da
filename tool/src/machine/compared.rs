//! Compares the slaves of a network with those of a machine file.

use std::fmt;

use ecmsk::link::slaves::{SlaveModel, word};
use ecmsk::machine_file::MachineFile;
use ecmsk::sk::SlaveKind;
use serde_json::{Value, json};

use super::network::FoundSlave;

/// A difference between the slaves of a machine file and those that answer on the network.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Difference {
    /// The machine file has a slave with this number, but the network has fewer slaves.
    Missing { slave: usize },
    /// The network has a slave with this number, but the machine file has fewer slaves.
    Unexpected { slave: usize, vendor: u32, product: u32 },
    /// The slave on the network has another vendor, product code or revision than in the machine file.
    Identity { slave: usize, what: &'static str, file: u32, found: u32 },
    /// The slave on the network is of another kind (such as drive or io) than in the machine file.
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
    /// Adds the difference as fields of a JSON object.
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

/// Returns the differences, sorted by slave number; unexpected slaves come last.
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
        // A pulse module reports the device type of a stepper, so these two kinds do not count as a difference.
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

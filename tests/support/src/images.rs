//! The process image of a test's own slave, by the mapping that the board has written to it.

use ecmsk::cia402::Mode;
use ecmsk::coe::ObjectAddress;
use ecmsk::fieldbus::pdo::ProcessData;
use ecmsk::fieldbus::{Role, SlaveIn, SlaveOut};
use ecmsk::sk::DriveSync;

/// Objects by which process data are mapped.
const MAPPING: std::ops::Range<u16> = 0x1600..0x1C14;

/// The identity object; all numbers in it are 0.
const IDENTITY: u16 = 0x1018;

/// All roles that the board maps.
const ROLES: [Role; 6] = [
    Role::Drive(Mode::Csp),
    Role::Drive(Mode::Csv),
    Role::Drive(Mode::Cst),
    Role::Hsp(Mode::Csp),
    Role::Hsp(Mode::Csv),
    Role::Io,
];

/// The number that an SDO's bytes encode.
pub fn number(value: &[u8]) -> u32 {
    value.iter().rev().fold(0, |number, byte| number << 8 | u32::from(*byte))
}

/// The objects that were mapped.
#[derive(Clone, Debug, Default)]
pub struct Images {
    written: Vec<(ObjectAddress, u32)>,
    mapped: Option<(Role, ProcessData)>,
}

impl Images {
    /// Takes an SDO download. Returns whether it is one by which a bus configures a slave, including modes and
    /// synchronisation.
    pub fn take(&mut self, object: ObjectAddress, value: u32) -> bool {
        let is_mapping = MAPPING.contains(&object.index);
        if (object, value) == (ObjectAddress::new(0x1C12, 0), 0) {
            (self.written, self.mapped) = (Vec::with_capacity(64), None);
        }
        if is_mapping {
            self.written.push((object, value));
        }
        if object == ObjectAddress::new(0x1C12, 0) && value != 0 {
            self.mapped = mapped(&self.written);
        }
        let is_mode = object.index & !0x800 == 0x6060 && self.mapped.is_none() && !self.written.is_empty();
        is_mapping || is_mode || matches!(object.index, 0x1C32 | 0x1C33)
    }

    /// Writes the answer to a read of the identity to `value`, and returns its length; `None`: it is another object.
    pub fn read_identity(object: ObjectAddress, value: &mut [u8]) -> Option<usize> {
        (object.index == IDENTITY).then(|| {
            value.fill(0);
            size_of::<u32>()
        })
    }

    /// Writes the answer to a read of the mapping to `value`, and returns its length; `None`: the object does not
    /// belong to the mapping.
    pub fn read(&self, object: ObjectAddress, value: &mut [u8]) -> Option<usize> {
        if !MAPPING.contains(&object.index) {
            return None;
        }
        let newest = self.written.iter().rev().find(|(written, _)| *written == object);
        let bytes = match (object.sub, object.index) {
            (0, _) => 1,
            (_, 0x1C12 | 0x1C13) => 2,
            _ => 4,
        };
        let number = newest.map_or(0, |(_, number)| *number);
        value.iter_mut().zip(&number.to_le_bytes()[..bytes]).for_each(|(to, byte)| *to = *byte);
        Some(bytes)
    }

    /// The role that the slave was configured for.
    pub fn role(&self) -> Option<Role> {
        self.mapped.map(|(role, _)| role)
    }

    /// The outputs that were sent to the slave.
    pub fn outputs(&self, image: &[u8]) -> SlaveOut {
        self.mapped.map(|(_, data)| data.take_outputs(image)).unwrap_or_default()
    }

    /// The inputs that the slave has sent.
    pub fn inputs(&self, image: &[u8]) -> SlaveIn {
        let mut inputs = SlaveIn::default();
        if let Some((_, data)) = &self.mapped {
            data.take_inputs(image, &mut inputs);
        }
        inputs
    }

    /// Writes the slave's inputs to the image.
    pub fn put_inputs(&self, inputs: &SlaveIn, image: &mut [u8]) {
        if let Some((_, data)) = &self.mapped {
            data.put_inputs(inputs, image);
        }
    }
}

/// The role with that mapping.
fn mapped(written: &[(ObjectAddress, u32)]) -> Option<(Role, ProcessData)> {
    let all = ROLES.into_iter().flat_map(|role| [false, true].map(|second| (role, second)));
    all.filter_map(|(role, second)| Some((role, ProcessData::of(role, second)?))).find(|(_, data)| {
        let downloads = data.downloads(DriveSync::DcSync).into_iter();
        let mapping = downloads.filter(|download| MAPPING.contains(&download.object.index));
        mapping.map(|download| (download.object, download.value)).eq(written.iter().copied())
    })
}

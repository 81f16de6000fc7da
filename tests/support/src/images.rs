//! What a slave that is no device of ours knows of the images of its process data: what the board has mapped.

use ecmsk::cia402::Mode;
use ecmsk::coe::ObjectAddress;
use ecmsk::fieldbus::pdo::ProcessData;
use ecmsk::fieldbus::{Role, SlaveIn, SlaveOut};
use ecmsk::sk::DriveSync;

/// Objects by which process data are mapped.
const MAPPING: std::ops::Range<u16> = 0x1600..0x1C14;

/// The object that says who a slave is; all numbers in it are 0.
const IDENTITY: u16 = 0x1018;

/// Everything that the board maps.
const ROLES: [Role; 6] = [
    Role::Drive(Mode::Csp),
    Role::Drive(Mode::Csv),
    Role::Drive(Mode::Cst),
    Role::Hsp(Mode::Csp),
    Role::Hsp(Mode::Csv),
    Role::Io,
];

/// The number of an SDO's bytes.
pub fn number(value: &[u8]) -> u32 {
    value.iter().rev().fold(0, |number, byte| number << 8 | u32::from(*byte))
}

/// What was mapped.
#[derive(Clone, Debug, Default)]
pub struct Images {
    written: Vec<(ObjectAddress, u32)>,
    mapped: Option<(Role, ProcessData)>,
}

impl Images {
    /// An SDO download has come. Whether it is one of those by which a bus configures a slave, modes and synchronisation
    /// included.
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

    /// What a read of who the slave is puts into `value`, and its length; `None`: it is another object.
    pub fn read_identity(object: ObjectAddress, value: &mut [u8]) -> Option<usize> {
        (object.index == IDENTITY).then(|| {
            value.fill(0);
            size_of::<u32>()
        })
    }

    /// What a read of the mapping puts into `value`, and its length; `None`: the object is none of the mapping.
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

    /// What it was configured for.
    pub fn role(&self) -> Option<Role> {
        self.mapped.map(|(role, _)| role)
    }

    /// What was sent to it.
    pub fn outputs(&self, image: &[u8]) -> SlaveOut {
        self.mapped.map(|(_, data)| data.take_outputs(image)).unwrap_or_default()
    }

    /// What it has sent.
    pub fn inputs(&self, image: &[u8]) -> SlaveIn {
        let mut inputs = SlaveIn::default();
        if let Some((_, data)) = &self.mapped {
            data.take_inputs(image, &mut inputs);
        }
        inputs
    }

    /// What it sends.
    pub fn put_inputs(&self, inputs: &SlaveIn, image: &mut [u8]) {
        if let Some((_, data)) = &self.mapped {
            data.put_inputs(inputs, image);
        }
    }
}

/// The role whose mapping that is.
fn mapped(written: &[(ObjectAddress, u32)]) -> Option<(Role, ProcessData)> {
    let all = ROLES.into_iter().flat_map(|role| [false, true].map(|second| (role, second)));
    all.filter_map(|(role, second)| Some((role, ProcessData::of(role, second)?))).find(|(_, data)| {
        let downloads = data.downloads(DriveSync::DcSync).into_iter();
        let mapping = downloads.filter(|download| MAPPING.contains(&download.object.index));
        mapping.map(|download| (download.object, download.value)).eq(written.iter().copied())
    })
}

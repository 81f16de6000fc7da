//! Decides which objects of a drive are parameters, and in which order objects of the PDO mapping are written.

use std::collections::BTreeSet;

use ecmsk::coe::ObjectAddress;
use ecmsk::slave::ManufacturerObject;
use ecmsk::slave::dictionary::Access;

/// Objects of CiA 402 that command the drive at the moment: targets, offsets, modes and outputs. They are no settings,
/// so they are not parameters. The list also has the commands of frequency inverters (vl target velocity) and the
/// outputs of IO modules (CiA 401). The indexes are those of the first axis. \[OURS]
const COMMANDS: [u16; 17] = [
    0x6040, 0x6042, 0x6060, 0x6071, 0x607A, 0x60B0, 0x60B1, 0x60B2, 0x60B8, 0x60C1, 0x60FE, 0x60FF, 0x6200, 0x6220,
    0x6300, 0x6320, 0x6411,
];
/// The index range of the CiA 402 profile for all axes of a device. For each further axis the indexes are higher by
/// [`AXIS`].
const PROFILE: std::ops::RangeInclusive<u16> = 0x6000..=0x9FFF;
const AXIS: u16 = 0x800;
/// Objects that start an action when they are written: clear the error history, store, restore defaults, download software,
/// reset. They are not parameters. \[OURS]
const ACTIONS: [u16; 6] = [0x1003, 0x1010, 0x1011, 0x10F0, 0x1F50, 0x1F51];
/// The first index of an object with a value. Lower indexes define data types.
const VALUES_FROM: u16 = 0x1000;

/// The PDO mapping objects. The next constant has the objects that assign PDOs to the sync managers 2 and 3. Both
/// together define the process data of a slave.
const MAPPINGS: std::ops::RangeInclusive<u16> = 0x1600..=0x1BFF;
const ASSIGNMENTS: [u16; 2] = [0x1C12, 0x1C13];

/// Whether an object that can be read and written is a parameter, which a backup saves and a restore writes.
pub fn is_parameter(address: ObjectAddress) -> bool {
    let index = address.index;
    let of_first_axis = if PROFILE.contains(&index) { 0x6000 + (index - 0x6000) % AXIS } else { index };
    index >= VALUES_FROM && !COMMANDS.contains(&of_first_axis) && !ACTIONS.contains(&index)
}

/// Whether an object defines the process data of a slave (PDO mapping or assignment). A slave accepts writes to such objects
/// only in a certain order, see [`mapping_writes`].
pub fn is_mapping(address: ObjectAddress) -> bool {
    MAPPINGS.contains(&address.index) || ASSIGNMENTS.contains(&address.index)
}

/// The objects of a file that a restore compares and writes.
#[derive(Debug, Default)]
pub struct Chosen<'f> {
    pub parameters: Vec<&'f ManufacturerObject>,
    /// Entries of mappings and assignments whose number of entries (sub-index 0) is missing in the file. They are not
    /// written, because without that number the list would stay empty.
    pub without_length: Vec<&'f ManufacturerObject>,
}

impl<'f> Chosen<'f> {
    /// Chooses from all objects of a file. Read-only objects are left out, and so are entries of a list beyond its
    /// number of entries, which have no meaning.
    pub fn of(objects: &'f [ManufacturerObject]) -> Self {
        let count = |index| {
            let length = objects.iter().find(|object| object.address == ObjectAddress::new(index, 0));
            length.map(|length| length.value.bits())
        };
        let mut chosen = Self::default();
        let writable = objects.iter().filter(|object| object.access != Access::ReadOnly);
        for object in writable.filter(|object| is_parameter(object.address)) {
            match count(object.address.index) {
                _ if !is_mapping(object.address) => chosen.parameters.push(object),
                None => chosen.without_length.push(object),
                Some(count) if u64::from(object.address.sub) <= count => chosen.parameters.push(object),
                Some(_) => {}
            }
        }
        chosen
    }
}

/// One SDO write: the object, and its new value as bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Write {
    pub address: ObjectAddress,
    pub bytes: Vec<u8>,
}

/// The writes that change the process data of a slave to that of a file (ETG.1020 6.4). `wanted`: all mapping and
/// assignment objects among the chosen parameters of the file. `changed`: the indexes at which the slave differs. First
/// the assignments are set to 0 PDOs. Then each changed mapping is set to 0 entries, its entries are written, and then
/// its number of entries. The assignments come last.
pub fn mapping_writes(wanted: &[&ManufacturerObject], changed: &BTreeSet<u16>) -> Vec<Write> {
    let empty = |index| Write { address: ObjectAddress::new(index, 0), bytes: vec![0] };
    let of = |index: u16| wanted.iter().filter(move |object| object.address.index == index);
    let filled = |index| {
        // Sub-index 0, the number of entries, is written after the entries.
        let length = of(index).find(|object| object.address.sub == 0);
        let entries = of(index).filter(|object| object.address.sub > 0);
        let write =
            |object: &&ManufacturerObject| Write { address: object.address, bytes: object.value.bytes().to_vec() };
        entries.chain(length).map(write).collect::<Vec<_>>()
    };
    let mut writes: Vec<Write> =
        ASSIGNMENTS.into_iter().filter(|index| of(*index).next().is_some()).map(empty).collect();
    let mappings = changed.iter().copied().filter(|index| MAPPINGS.contains(index));
    writes.extend(mappings.flat_map(|index| [vec![empty(index)], filled(index)].concat()));
    writes.extend(ASSIGNMENTS.into_iter().flat_map(filled));
    writes
}

#[cfg(test)]
mod tests {
    use ecmsk::slave::ManufacturerObjects;

    use super::*;

    #[test]
    fn commands_and_actions_are_no_parameters() {
        let is = |index| is_parameter(ObjectAddress::new(index, 0));
        for index in [0x0005, 0x1010, 0x1011, 0x6040, 0x6042, 0x607A, 0x6200, 0x6411, 0x687A, 0x70FF, 0x8040] {
            assert!(!is(index), "0x{index:04X}");
        }
        for index in [0x1600, 0x1C12, 0x2000, 0x5FFF, 0x6081, 0x6098, 0x6881, 0xA040] {
            assert!(is(index), "0x{index:04X}");
        }
    }

    /// ETG.1020 6.4: a mapping is changed while no PDO is assigned. First its sub-index 0 is set to 0, and at the end
    /// to the number of entries.
    #[test]
    fn a_mapping_is_emptied_filled_and_assigned() {
        let text = "0x1600:0 u8 rw 2\n0x1600:1 u32 rw 0x60400010\n0x1600:2 u32 rw 0x607A0020\n0x1600:3 u32 rw 0\n0x1601:0 u8 rw 0\n\
                    0x1C12:0 u8 rw 1\n0x1C12:1 u16 rw 0x1600\n";
        let objects = ManufacturerObjects::parse(text).unwrap();
        let wanted = Chosen::of(objects.objects()).parameters;
        let writes = mapping_writes(&wanted, &BTreeSet::from([0x1600]));
        let shown: Vec<String> = writes.iter().map(|write| format!("{} {:X?}", write.address, write.bytes)).collect();
        assert_eq!(
            shown,
            [
                "0x1C12:0 [0]",
                "0x1600:0 [0]",
                "0x1600:1 [10, 0, 40, 60]",
                "0x1600:2 [20, 0, 7A, 60]",
                "0x1600:0 [2]",
                "0x1C12:1 [0, 16]",
                "0x1C12:0 [1]",
            ]
        );
    }
}

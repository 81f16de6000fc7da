//! Which objects of a drive are parameters, and the order in which they are written.

use std::collections::BTreeSet;

use ecmsk::coe::ObjectAddress;
use ecmsk::slave::ManufacturerObject;

/// Objects that command a drive at the moment, which is nothing to keep: those of CiA 402 that set targets, modes and
/// outputs, without the offset of a further axis. \[OURS]
const COMMANDS: [u16; 11] = [0x6040, 0x6060, 0x6071, 0x607A, 0x60B0, 0x60B1, 0x60B2, 0x60B8, 0x60C1, 0x60FE, 0x60FF];
/// The first and the last index of CiA 402 for all axes of a device, and the distance between two axes.
const PROFILE: std::ops::RangeInclusive<u16> = 0x6000..=0x9FFF;
const AXIS: u16 = 0x800;
/// Objects whose writing does something: error history, store, restore defaults, download of software, reset. \[OURS]
const ACTIONS: [u16; 6] = [0x1003, 0x1010, 0x1011, 0x10F0, 0x1F50, 0x1F51];
/// The first object that is a value and not a type.
const VALUES_FROM: u16 = 0x1000;

/// The objects that say which process data a slave has: the mapping of its PDOs, and their assignment to the sync
/// managers 2 and 3.
const MAPPINGS: std::ops::RangeInclusive<u16> = 0x1600..=0x1BFF;
const ASSIGNMENTS: [u16; 2] = [0x1C12, 0x1C13];

/// Whether an object that can be read and written is a parameter, so that it is kept and put back.
pub fn is_parameter(address: ObjectAddress) -> bool {
    let index = address.index;
    let of_first_axis = if PROFILE.contains(&index) { 0x6000 + (index - 0x6000) % AXIS } else { index };
    index >= VALUES_FROM && !COMMANDS.contains(&of_first_axis) && !ACTIONS.contains(&index)
}

/// Whether an object says which process data a slave has. It can be written in a certain order alone.
pub fn is_mapping(address: ObjectAddress) -> bool {
    MAPPINGS.contains(&address.index) || ASSIGNMENTS.contains(&address.index)
}

/// A write of a number to an object, with the bytes of the object.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Write {
    pub address: ObjectAddress,
    pub bytes: Vec<u8>,
}

/// The writes that change the process data of a slave to those of `wanted`, all mapping objects of a file, where the indices
/// `changed` differ (ETG.1020 6.4): the assignment is taken back first; each mapping is emptied, filled, and gets its length;
/// the assignment comes last.
pub fn mapping_writes(wanted: &[&ManufacturerObject], changed: &BTreeSet<u16>) -> Vec<Write> {
    let empty = |index| Write { address: ObjectAddress::new(index, 0), bytes: vec![0] };
    let of = |index: u16| wanted.iter().filter(move |object| object.address.index == index);
    let filled = |index| {
        // The length, sub-index 0, is written behind the entries; those beyond it mean nothing.
        let length = of(index).find(|object| object.address.sub == 0);
        let count = length.map_or(0, |object| object.value.bits());
        let entries = of(index).filter(|object| (1..=count).contains(&object.address.sub.into()));
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
        for index in [0x0005, 0x1010, 0x1011, 0x6040, 0x607A, 0x687A, 0x70FF, 0x8040] {
            assert!(!is(index), "0x{index:04X}");
        }
        for index in [0x1600, 0x1C12, 0x2000, 0x5FFF, 0x6081, 0x6098, 0x6881, 0xA040] {
            assert!(is(index), "0x{index:04X}");
        }
    }

    /// ETG.1020 6.4: a mapping is changed while nothing is assigned, from sub-index 0 = 0 to its length.
    #[test]
    fn a_mapping_is_emptied_filled_and_assigned() {
        let text = "0x1600:0 u8 rw 2\n0x1600:1 u32 rw 0x60400010\n0x1600:2 u32 rw 0x607A0020\n0x1600:3 u32 rw 0\n0x1601:0 u8 rw 0\n\
                    0x1C12:0 u8 rw 1\n0x1C12:1 u16 rw 0x1600\n";
        let objects = ManufacturerObjects::parse(text).unwrap();
        let wanted: Vec<&ManufacturerObject> = objects.objects().iter().collect();
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

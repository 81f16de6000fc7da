//! Compares the parameters of a file with those of a drive, and writes those that differ.

use std::collections::BTreeSet;

use ecmsk::coe::{AbortCode, ObjectAddress};
use ecmsk::slave::{ManufacturerObject, ManufacturerValue};

use super::ParamsError;
use super::choice::{self, Chosen, is_mapping};
use super::drive::{Answer, Drive, write_any};
use super::kept::{LeftOut, Why};

/// A parameter whose value on the drive is not the value in the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Difference {
    /// The object in the file, with the value that the drive should have.
    pub wanted: ManufacturerObject,
    /// The value on the drive, or the abort code if it cannot be read.
    pub present: Answer<Vec<u8>>,
}

/// The result of comparing the parameters of a drive with those of a file.
#[derive(Debug, Default)]
pub struct Compared {
    pub different: Vec<Difference>,
    /// The number of parameters that have the value in the file.
    pub same: usize,
    /// Parameters that were not compared, each with the reason, such as a value that the link cannot transfer.
    pub left_out: Vec<LeftOut>,
}

/// Compares a drive with those objects of a file that are parameters.
///
/// # Errors
/// The drive no longer answers.
pub fn compare(
    drive: &mut dyn Drive,
    objects: &[ManufacturerObject],
    at: &mut dyn FnMut(u16),
) -> Result<Compared, ParamsError> {
    let carries = drive.carries();
    let chosen = Chosen::of(objects);
    let left_out = chosen.without_length.iter().map(|object| LeftOut::of(object, Why::NoLength)).collect();
    let mut compared = Compared { left_out, ..Compared::default() };
    for wanted in chosen.parameters {
        at(wanted.address.index);
        if let Some(why) = carries.obstacle(wanted.data, wanted.value.bytes().len()) {
            compared.left_out.push(LeftOut::of(wanted, why));
            continue;
        }
        let present = drive.read(wanted.address)?;
        match &present {
            Ok(bytes) if carries.is_same(wanted, bytes) => compared.same += 1,
            _ => compared.different.push(Difference { wanted: wanted.clone(), present }),
        }
    }
    Ok(compared)
}

/// The outcome of the restore for a parameter that differed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Fate {
    /// The parameter was written, and reads back with the value in the file.
    Written,
    /// The drive has refused the write.
    Refused(AbortCode),
    /// The parameter was written but reads back with this other value: the drive has limited it, or applies it only
    /// after the next power-on.
    ReadsBack(Vec<u8>),
}

/// A callback that is called with each parameter and its outcome.
pub type Done<'d> = &'d mut dyn FnMut(&Difference, Fate) -> Result<(), ParamsError>;

/// A restore: writes the parameters that differ. If it ends early, it still knows which parameters were written.
#[derive(Debug, Default)]
pub struct Restore {
    /// Parameters that were sent to the drive and not refused by it.
    sent: BTreeSet<ObjectAddress>,
    decided: BTreeSet<ObjectAddress>,
}

/// How far a restore has come with a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// The outcome of the parameter is known.
    Decided,
    /// The parameter was sent but not read back, so it may be written or not.
    Sent,
    /// The parameter was not written.
    NotWritten,
}

impl Restore {
    /// The stage of the parameter at this address.
    pub fn stage(&self, address: ObjectAddress) -> Stage {
        match (self.decided.contains(&address), self.sent.contains(&address)) {
            (true, _) => Stage::Decided,
            (false, true) => Stage::Sent,
            (false, false) => Stage::NotWritten,
        }
    }

    /// Writes the parameters that differ, and calls `done` with the outcome of each. Refused writes are retried after
    /// the other ones, because a limit may depend on another parameter. Retries go on as long as at least one write
    /// succeeds. The PDO mapping comes last.
    ///
    /// # Errors
    /// The drive no longer answers. [`Self::stage`] then says for each parameter whether it was written.
    pub fn run(
        &mut self,
        drive: &mut dyn Drive,
        objects: &[ManufacturerObject],
        different: &[Difference],
        done: Done<'_>,
    ) -> Result<(), ParamsError> {
        let (mapping, mut waiting): (Vec<&Difference>, Vec<&Difference>) =
            different.iter().partition(|difference| is_mapping(difference.wanted.address));
        let mut written = Vec::new();
        loop {
            let mut refused = Vec::new();
            let before = waiting.len();
            for difference in waiting {
                let address = difference.wanted.address;
                self.sent.insert(address);
                match write_any(drive, address, difference.wanted.value.bytes())? {
                    Ok(()) => written.push(difference),
                    Err(code) => {
                        self.sent.remove(&address);
                        refused.push((difference, code));
                    }
                }
            }
            if refused.is_empty() || refused.len() == before {
                for (difference, code) in refused {
                    self.decide(difference, Fate::Refused(code), done)?;
                }
                break;
            }
            waiting = refused.into_iter().map(|(difference, _)| difference).collect();
        }
        self.read_back(drive, &written, done)?;
        self.mapping(drive, objects, &mapping, done)
    }

    fn decide(&mut self, difference: &Difference, fate: Fate, done: Done<'_>) -> Result<(), ParamsError> {
        self.decided.insert(difference.wanted.address);
        done(difference, fate)
    }

    fn read_back(&mut self, drive: &mut dyn Drive, written: &[&Difference], done: Done<'_>) -> Result<(), ParamsError> {
        for difference in written {
            let fate = match drive.read(difference.wanted.address)? {
                Ok(bytes) if drive.carries().is_same(&difference.wanted, &bytes) => Fate::Written,
                Ok(bytes) => Fate::ReadsBack(bytes),
                Err(code) => Fate::Refused(code),
            };
            self.decide(difference, fate, done)?;
        }
        Ok(())
    }

    fn mapping(
        &mut self,
        drive: &mut dyn Drive,
        objects: &[ManufacturerObject],
        mapping: &[&Difference],
        done: Done<'_>,
    ) -> Result<(), ParamsError> {
        if mapping.is_empty() {
            return Ok(());
        }
        let changed: BTreeSet<u16> = mapping.iter().map(|difference| difference.wanted.address.index).collect();
        let mut wanted = Chosen::of(objects).parameters;
        wanted.retain(|object| is_mapping(object.address));
        self.sent.extend(mapping.iter().map(|difference| difference.wanted.address));
        for write in choice::mapping_writes(&wanted, &changed) {
            if let Err(code) = drive.write(write.address, &write.bytes)? {
                // A half-written mapping is worse than the old one, so the old one is written back.
                let old: Vec<ManufacturerObject> = wanted.iter().map(|object| present(object, mapping)).collect();
                for write in choice::mapping_writes(&old.iter().collect::<Vec<_>>(), &changed) {
                    let _refused_again = drive.write(write.address, &write.bytes)?;
                }
                return mapping.iter().try_for_each(|difference| self.decide(difference, Fate::Refused(code), done));
            }
        }
        self.read_back(drive, mapping, done)
    }
}

/// The object of the file with the value that the drive had before the restore, if that is known.
fn present(object: &ManufacturerObject, different: &[&Difference]) -> ManufacturerObject {
    let difference = different.iter().find(|difference| difference.wanted.address == object.address);
    let bytes = difference.and_then(|difference| difference.present.as_ref().ok());
    let value = bytes.map_or_else(|| object.value.clone(), |bytes| ManufacturerValue::of_bytes(bytes));
    ManufacturerObject { value, ..object.clone() }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use ecmsk::coe::ObjectAddress;
    use ecmsk::slave::ManufacturerObjects;

    use super::super::kept::{Carries, Kept};
    use super::*;

    type Refuses = fn(&Table, ObjectAddress, &[u8]) -> Option<AbortCode>;

    /// A fake drive, with its values and the writes that it refuses.
    #[derive(Default)]
    struct Table {
        values: BTreeMap<ObjectAddress, Vec<u8>>,
        /// Decides from the present values whether the drive refuses a write.
        refuses: Option<Refuses>,
        /// The number of calls after which the drive no longer answers; `None` if it always answers.
        calls_left: Option<usize>,
        writes: Vec<(ObjectAddress, Vec<u8>)>,
    }

    impl Table {
        fn of(text: &str) -> Self {
            let objects = ManufacturerObjects::parse(text).unwrap();
            let values = objects.objects().iter().map(|object| (object.address, object.value.bytes().to_vec()));
            Self { values: values.collect(), ..Self::default() }
        }

        fn call(&mut self) -> Result<(), ParamsError> {
            match &mut self.calls_left {
                Some(0) => Err(ecmsk::bus::BusError::Gone { slave: 1 }.into()),
                Some(left) => {
                    *left -= 1;
                    Ok(())
                }
                None => Ok(()),
            }
        }
    }

    impl Drive for Table {
        fn slaves(&mut self) -> Result<Vec<u8>, ParamsError> {
            Ok(vec![1])
        }

        fn choose(&mut self, _: u8) -> Result<(), ParamsError> {
            Ok(())
        }

        fn read(&mut self, object: ObjectAddress) -> Result<Answer<Vec<u8>>, ParamsError> {
            self.call()?;
            Ok(self.values.get(&object).cloned().ok_or(AbortCode::NO_OBJECT))
        }

        fn write(&mut self, object: ObjectAddress, value: &[u8]) -> Result<Answer<()>, ParamsError> {
            self.call()?;
            self.writes.push((object, value.to_vec()));
            if let Some(code) = self.refuses.and_then(|refuses| refuses(self, object, value)) {
                return Ok(Err(code));
            }
            match self.values.get_mut(&object) {
                None => Ok(Err(AbortCode::NO_OBJECT)),
                Some(old) if old.len() != value.len() => Ok(Err(AbortCode::LENGTH)),
                Some(old) => {
                    *old = value.to_vec();
                    Ok(Ok(()))
                }
            }
        }

        fn parameters(&mut self, _: &mut dyn FnMut(u16)) -> Result<Kept, ParamsError> {
            Ok(Kept::default())
        }

        fn carries(&self) -> Carries {
            Carries::AtMost(usize::MAX)
        }
    }

    /// The outcome of each parameter, with its address.
    type Fates = Vec<(String, Fate)>;

    fn run(drive: &mut Table, file: &str) -> (Fates, Result<(), ParamsError>) {
        let (fates, _, result) = run_staged(drive, file);
        (fates, result)
    }

    /// As `run`; also returns the stage of each parameter that differs, in the order of the file.
    fn run_staged(drive: &mut Table, file: &str) -> (Fates, Vec<Stage>, Result<(), ParamsError>) {
        let objects = ManufacturerObjects::parse(file).unwrap();
        let compared = compare(drive, objects.objects(), &mut |_| ()).unwrap();
        let (mut fates, mut restore) = (Vec::new(), Restore::default());
        let result = restore.run(drive, objects.objects(), &compared.different, &mut |difference, fate| {
            fates.push((difference.wanted.address.to_string(), fate));
            Ok(())
        });
        let stages = compared.different.iter().map(|difference| restore.stage(difference.wanted.address)).collect();
        (fates, stages, result)
    }

    #[test]
    fn only_what_differs_is_written_and_read_back() {
        let mut drive = Table::of("0x2000:0 u16 rw 1\n0x2001:0 u32 rw 2\n0x607A:0 i32 rw 0\n");
        let (fates, result) = run(&mut drive, "0x2000:0 u16 rw 1\n0x2001:0 u32 rw 5\n0x607A:0 i32 rw 900\n");
        result.unwrap();
        assert_eq!(fates, [("0x2001:0".to_owned(), Fate::Written)]);
        assert_eq!(drive.writes, [(ObjectAddress::new(0x2001, 0), vec![5, 0, 0, 0])]);
    }

    /// The lower limit 0x2000 must not be above the upper limit 0x2001, which comes later in the file. So the lower
    /// limit is refused at first and written when it is retried.
    #[test]
    fn what_depends_on_a_later_object_is_tried_again() {
        let mut drive = Table::of("0x2000:0 u8 rw 1\n0x2001:0 u8 rw 2\n0x2002:0 u8 rw 0\n");
        drive.refuses = Some(|drive, object, value| {
            let upper = drive.values[&ObjectAddress::new(0x2001, 0)][0];
            (object.index == 0x2000 && value[0] > upper || object.index == 0x2002).then_some(AbortCode::VALUE_HIGH)
        });
        let (fates, result) = run(&mut drive, "0x2000:0 u8 rw 8\n0x2001:0 u8 rw 9\n0x2002:0 u8 rw 1\n");
        result.unwrap();
        let written = |object: &str| (object.to_owned(), Fate::Written);
        let refused = ("0x2002:0".to_owned(), Fate::Refused(AbortCode::VALUE_HIGH));
        assert_eq!(fates, [refused, written("0x2001:0"), written("0x2000:0")]);
    }

    /// Whenever the drive is lost during a restore, each parameter is decided, possibly written, or not written.
    #[test]
    fn a_drive_that_vanishes_leaves_each_parameter_at_a_stage() {
        use Stage::{Decided, NotWritten, Sent};
        let file = "0x1600:0 u8 rw 1\n0x1600:1 u32 rw 8\n0x2000:0 u8 rw 8\n0x2001:0 u8 rw 9\n0x2002:0 u8 rw 7\n";
        // The comparison makes five reads before the restore. The drive refuses 0x2002.
        for (calls, stages) in [
            (0, [NotWritten, Sent, NotWritten, NotWritten]),
            (1, [NotWritten, Sent, Sent, NotWritten]),
            (2, [NotWritten, Sent, Sent, Sent]),
            (3, [NotWritten, Sent, Sent, Sent]),
            (4, [NotWritten, Sent, Sent, Decided]),
            (5, [NotWritten, Decided, Sent, Decided]),
            (6, [Sent, Decided, Decided, Decided]),
            (8, [Sent, Decided, Decided, Decided]),
        ] {
            let text = file.replace(" 8\n", " 1\n").replace(" 9\n", " 2\n").replace(" 7\n", " 3\n");
            let mut drive = Table::of(&text);
            drive.refuses = Some(|_, object, _| (object.index == 0x2002).then_some(AbortCode::VALUE_HIGH));
            drive.calls_left = Some(5 + calls);
            let (fates, found, result) = run_staged(&mut drive, file);
            assert_eq!(found, stages, "{calls}");
            assert_eq!(fates.len(), stages.iter().filter(|stage| **stage == Decided).count(), "{calls}");
            assert!(result.unwrap_err().to_string().contains("slave 1 does not answer any more"));
        }
    }

    /// If the numbers of entries are missing in a file, the lists in the drive are not changed. Entries beyond the
    /// number of entries have no meaning, and read-only objects are not written.
    #[test]
    fn lists_without_a_length_stay() {
        let drive = "0x1600:0 u8 rw 2\n0x1600:1 u32 rw 8\n0x1600:2 u32 rw 9\n0x1C12:0 u8 rw 1\n0x1C12:1 u16 rw 0x1600\n\
                     0x2000:0 u8 rw 1\n";
        for (file, left_out) in [
            ("0x1600:1 u32 rw 5\n0x1C12:1 u16 rw 0x1601\n", 2),
            ("0x1600:0 u8 rw 2\n0x1600:1 u32 rw 8\n0x1600:2 u32 rw 9\n0x1600:3 u32 rw 7\n0x2000:0 u8 ro 4\n", 0),
        ] {
            let mut table = Table::of(drive);
            let objects = ManufacturerObjects::parse(file).unwrap();
            let compared = compare(&mut table, objects.objects(), &mut |_| ()).unwrap();
            assert_eq!((compared.left_out.len(), compared.different), (left_out, Vec::new()), "{file}");
            let (fates, result) = run(&mut table, file);
            result.unwrap();
            assert_eq!((fates, table.writes), (Vec::new(), Vec::new()), "{file}");
        }
    }

    /// A file that was read behind a board has values of type `any` with 4 bytes each. They are written with the length
    /// of the object in the drive.
    #[test]
    fn a_value_of_unknown_length_fits_a_shorter_object() {
        let mut drive = Table::of("0x2000:0 u16 rw 1\n0x2001:0 u8 rw 7\n0x2002:0 u32 rw 1\n");
        let (fates, result) = run(&mut drive, "0x2000:0 any rw 2\n0x2001:0 any rw 7\n0x2002:0 any rw 0x12345\n");
        result.unwrap();
        let written = |object: &str| (object.to_owned(), Fate::Written);
        assert_eq!(fates, [written("0x2000:0"), written("0x2002:0")]);
        assert_eq!(drive.values[&ObjectAddress::new(0x2000, 0)], [2, 0]);
    }

    /// The mapping is written after all other parameters. If the drive refuses one entry, the whole mapping counts as refused.
    #[test]
    fn a_mapping_comes_last() {
        let file = "0x1600:0 u8 rw 1\n0x1600:1 u32 rw 0x60400010\n0x1C12:0 u8 rw 1\n0x1C12:1 u16 rw 0x1600\n0x2000:0 u8 rw 1\n";
        let mut drive =
            Table::of(&file.replace("0x60400010", "0x60FF0020").replace("0x2000:0 u8 rw 1", "0x2000:0 u8 rw 0"));
        let (fates, result) = run(&mut drive, file);
        result.unwrap();
        assert_eq!(fates, [("0x2000:0".to_owned(), Fate::Written), ("0x1600:1".to_owned(), Fate::Written)]);
        let order: Vec<String> = drive.writes.iter().map(|(object, _)| object.to_string()).collect();
        assert_eq!(order, ["0x2000:0", "0x1C12:0", "0x1600:0", "0x1600:1", "0x1600:0", "0x1C12:1", "0x1C12:0"]);
        // If the new mapping is refused, the old one is restored.
        drive.refuses = Some(|_, object, value| {
            (object == ObjectAddress::new(0x1600, 1) && value[2] == 0x60).then_some(AbortCode::NOT_MAPPABLE)
        });
        let (values, new) = (drive.values.clone(), file.replace("0x60400010", "0x60600008"));
        let (fates, _) = run(&mut drive, &new);
        assert_eq!(fates, [("0x1600:1".to_owned(), Fate::Refused(AbortCode::NOT_MAPPABLE))]);
        assert_eq!(drive.values, values);
    }
}

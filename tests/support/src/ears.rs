//! Drives that record each target, and a judge of these records: targets that are missing, late or repeated.

use std::sync::{Arc, Mutex, MutexGuard};

use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope};
use ecmsk::fieldbus::AlState;
use ecmsk::slave::{AlStatus, Drive, DriveConfig, Slave};

use crate::images::{Images, number};

/// The record of a drive.
#[derive(Debug, Default)]
pub struct Notes {
    /// The target of each cycle in which it was on.
    pub targets: Vec<i32>,
    /// Whether the motor is on.
    pub is_on: bool,
    /// The drive's AL state.
    pub state: AlState,
}

/// A handle of a drive's record; clones share it.
#[derive(Clone, Debug, Default)]
pub struct Ear(Arc<Mutex<Notes>>);

impl Ear {
    /// A servo drive that writes to this record.
    pub fn drive(&self) -> Box<dyn Slave> {
        Box::new(Listening { drive: Drive::new(DriveConfig::default()), images: Images::default(), ear: self.clone() })
    }

    /// The record.
    pub fn notes(&self) -> MutexGuard<'_, Notes> {
        self.0.lock().expect("nobody panics with it")
    }
}

/// A path as it was sent, compared with the targets that the drive got in each cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Way {
    /// Targets of the path, without repeats.
    pub targets: u64,
    /// Targets that never came.
    pub lost: u64,
    /// Targets that came after a later one, and targets that were never sent.
    pub out_of_order: u64,
    /// Cycles between the first and the last target in which the previous target came again, less those for which it
    /// was sent again.
    pub repeated: u64,
}

impl Way {
    /// Compares the targets of each cycle, with the standstill before and after, with those that were sent. The path
    /// may not cross itself.
    pub fn judge(sent: &[i32], came: &[i32]) -> Self {
        let start = came.first().copied();
        let sent = &sent[sent.iter().take_while(|target| Some(**target) == start).count()..];
        let end = sent.last().copied();
        let moving = |targets: &[i32]| {
            let first = targets.iter().position(|target| Some(*target) != start).unwrap_or(targets.len());
            let rest = &targets[first..];
            let standing = rest.iter().rev().take_while(|target| Some(**target) == end).count();
            rest[..(rest.len() - standing + 1).min(rest.len())].to_vec()
        };
        let distinct = |targets: &[i32]| {
            let mut targets = targets.to_vec();
            targets.dedup();
            targets
        };
        let (sent, came) = (moving(sent), moving(came));
        let (told, got) = (distinct(&sent), distinct(&came));
        let mut way = Self { targets: told.len() as u64, ..Self::default() };
        let mut expected = told.iter();
        for target in &got {
            let ahead = expected.clone().position(|other| other == target);
            match ahead {
                Some(skipped) => {
                    way.lost += skipped as u64;
                    expected.nth(skipped);
                }
                None => way.out_of_order += 1,
            }
        }
        way.lost += expected.len() as u64;
        let repeats = |all: &[i32], distinct: &[i32]| (all.len() - distinct.len()) as u64;
        way.repeated = repeats(&came, &got).saturating_sub(repeats(&sent, &told));
        way
    }
}

struct Listening {
    drive: Drive,
    images: Images,
    ear: Ear,
}

impl Slave for Listening {
    crate::hand_on_slave!(drive: name, state, read_entries, set_sync_managers, step, begin_step, end_step, has_dc);

    fn enter(&mut self, target: AlState) -> Result<(), AlStatus> {
        let entered = self.drive.enter(target);
        self.ear.notes().state = self.drive.state();
        entered
    }

    fn write(&mut self, object: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), AbortCode> {
        self.drive.write(object, scope, value)?;
        self.images.take(object, number(value));
        Ok(())
    }

    fn exchange(&mut self, outputs: Option<&[u8]>, inputs: &mut [u8]) {
        self.drive.exchange(outputs, inputs);
        let Some(outputs) = outputs else { return };
        let mut notes = self.ear.notes();
        notes.is_on = self.images.inputs(inputs)[0].statusword.is_enabled();
        if notes.is_on {
            notes.targets.push(self.images.outputs(outputs)[0].target);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn way(targets: u64, lost: u64, out_of_order: u64, repeated: u64) -> Way {
        Way { targets, lost, out_of_order, repeated }
    }

    /// A judge that accepts a wrong path would show nothing.
    #[test]
    fn what_is_wrong_with_a_way_is_seen() {
        let sent = [5, 5, 6, 7, 7, 8, 9, 9];
        for (came, expected) in [
            (&[5, 5, 5, 6, 7, 7, 8, 9, 9, 9][..], way(4, 0, 0, 0)),
            (&[5, 6, 7, 7, 7, 8, 8, 9], way(4, 0, 0, 2)),
            (&[5, 6, 8, 9, 9], way(4, 1, 0, 0)),
            (&[5, 6, 7, 8, 8], way(4, 1, 0, 0)),
            (&[5, 7, 7, 6, 8, 9], way(4, 1, 1, 0)),
            (&[5, 6, 7, 4, 7, 8, 9], way(4, 0, 2, 0)),
            (&[5, 5], way(4, 4, 0, 0)),
            (&[], way(5, 5, 0, 0)),
        ] {
            assert_eq!(Way::judge(&sent, came), expected, "{came:?}");
        }
    }
}

//! Answers of mailboxes that other masters accept although they are late, or otherwise than the standard says.

use ecmsk::coe::{AbortCode, ObjectListType};
use ecmsk::fieldbus::nic::NicWires;
use ecmsk::master::{MailboxError, SdoError};
use support::odd_line::{Change, OddSlave, drive, number};

use super::odd_rig::Rig;
use super::rig::{MS, SECOND};

fn with_coe(change: impl FnOnce(&mut support::odd_line::Coe)) -> OddSlave {
    drive().with(|slave| change(slave.mailbox.coe.as_mut().expect("it has objects")))
}

/// MASTER-5.10 An abort that answers a transfer which was given up ends neither the next transfer nor a request for SDO
/// information. An abort of another object ends a transfer if no such answer is awaited.
#[test]
fn an_abort_that_comes_too_late() {
    for aborts_as_answer in [false, true] {
        for asks_for_a_list in [false, true] {
            let mut rig = Rig::in_preop(with_coe(|coe| coe.aborts_as_answer = aborts_as_answer));
            rig.upload(0x1018, 1).expect("a value");
            rig.line.slave(1, |slave| slave.mailbox.takes_ns = 3 * SECOND / 2);
            assert_eq!(rig.download(0x1018, 1, &[0; 4]), Err(MailboxError::TimeUp.into()));
            rig.line.slave(1, |slave| slave.mailbox.takes_ns = 0);
            if asks_for_a_list {
                let id = rig.master.object_list(1, ObjectListType::All, SECOND);
                assert!(rig.wait(id).is_ok_and(|list| list.contains(&0x6041)));
            }
            assert_eq!(rig.upload(0x1018, 2), Ok(number(4, 0x5678)));
            assert_eq!(rig.upload(0x1018, 1), Ok(number(4, 0x1234)));
        }
    }
    let mut rig = Rig::in_preop(drive());
    rig.upload(0x1018, 1).expect("a value");
    let of_nothing: Change = Box::new(|message| message[9..12].fill(0));
    rig.line.slave(1, |slave| slave.mailbox.change = Some(of_nothing));
    let begin = rig.line.now();
    assert_eq!(rig.upload(0x5555, 0), Err(SdoError::Abort(AbortCode::NO_OBJECT)));
    assert!(rig.line.now() - begin < 20 * MS);
}

/// MASTER-5.7 Fragments of SDO information that do not have the bit for more to come are joined by their number.
#[test]
fn fragments_that_are_only_counted() {
    let mut rig = Rig::in_preop(with_coe(|coe| {
        (0x3000..0x3100).for_each(|index| drop(coe.objects.insert((index, 0), number(2, 7))));
        coe.marks_no_fragments = true;
    }));
    let id = rig.master.object_list(1, ObjectListType::All, SECOND);
    let list = rig.wait(id).expect("a list");
    assert!(list.len() > 256 && list.contains(&0x30FF), "{}", list.len());
}

/// MASTER-5.1 A longer value whose answer lacks the bit for its size is read.
#[test]
fn values_without_the_bit_for_their_size() {
    for len in [5, 10, 112, 113, 300] {
        let value: Vec<u8> = (0..len).map(|n: u32| n as u8).collect();
        let mut rig = Rig::in_preop(with_coe(|coe| drop(coe.objects.insert((0x2000, 0), value.clone()))));
        rig.upload(0x1018, 1).expect("a value");
        let without_bit: Change = Box::new(|message| message[8] = if message[8] == 0x41 { 0x40 } else { message[8] });
        rig.line.slave(1, |slave| slave.mailbox.change = Some(without_bit));
        assert_eq!(rig.upload(0x2000, 0), Ok(value));
    }
}

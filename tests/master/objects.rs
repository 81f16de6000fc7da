//! Objects by SDO.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use ecmsk::coe::{
    AbortCode, Emergency, EntryDescription, EntryRequest, ObjectAddress, ObjectCode, ObjectDescription, ObjectListType,
    SdoScope, ValueInfo,
};
use ecmsk::ethercat::AlState;
use ecmsk::master::{Event, MailboxError, SdoError};
use ecmsk::slave::esc::Chain;
use support::blob::{BLOB, Blob, bytes};

use super::rig::{MS, Rig, SECOND, device};

fn blob(len: usize) -> Rig {
    let mut rig = Rig::of(Chain::line([Blob::of(len).slave()]));
    rig.scan();
    rig.reach(AlState::PreOp);
    rig
}

/// MASTER-5.1 Values of every length are read and written: expedited up to 4 bytes, then normal, then in segments.
#[test]
fn values_of_any_length_are_read_and_written() {
    for len in (1..=300).chain([1_000, 4_095, 65_535]) {
        let mut rig = blob(len);
        assert_eq!(rig.upload(1, BLOB.index, BLOB.sub), Ok(bytes(len)), "{len}");
        let mut other = bytes(len);
        other.reverse();
        assert_eq!(rig.download(1, BLOB.index, BLOB.sub, &other), Ok(()), "{len}");
        assert_eq!(rig.upload(1, BLOB.index, BLOB.sub), Ok(other), "{len}");
    }
    let mut rig = blob(3);
    assert_eq!(rig.download(1, BLOB.index, BLOB.sub, &[]), Ok(()));
    assert_eq!(rig.upload(1, BLOB.index, BLOB.sub), Ok(Vec::new()));
}

/// MASTER-2.8 The answer to the first request to a mailbox, which reads an object that this slave does not have, is not
/// taken for the second one's if it comes late.
#[test]
fn a_late_first_answer_is_none_to_another_request() {
    let mut rig = blob(3);
    rig.net.chain.delay_sdo(0, 50 * MS);
    assert_eq!(rig.upload(1, BLOB.index, BLOB.sub), Ok(bytes(3)));
    assert_eq!(rig.upload(1, 0x1000, 0), Err(SdoError::Abort(AbortCode::NO_OBJECT)));
}

/// MASTER-5.1 An upload of a number reads the whole value in any kind of transfer, and returns its first 4 bytes;
/// missing ones are 0. A download of up to 4 bytes transfers exactly these.
#[test]
fn a_number_is_the_beginning_of_a_value() {
    for len in (0..=20).chain([113, 120, 121, 1_000]) {
        let mut rig = blob(len);
        let value = bytes(len);
        let mut first = [0; 4];
        first.iter_mut().zip(&value).for_each(|(to, byte)| *to = *byte);
        let id = rig.master.upload_number(1, BLOB, SdoScope::Entry, SECOND);
        assert_eq!(rig.wait(id), Ok(u32::from_le_bytes(first)), "{len}");
        let begin = &value[..len.min(4)];
        assert_eq!(rig.download(1, BLOB.index, BLOB.sub, begin), Ok(()), "{len}");
        assert_eq!(rig.upload(1, BLOB.index, BLOB.sub).as_deref(), Ok(begin), "{len}");
    }
}

/// MASTER-5.2 A transfer that the slave aborts ends with the slave's abort code.
#[test]
fn an_abort_has_its_code() {
    let mut rig = Rig::scanned(&["drive"]);
    rig.reach(AlState::PreOp);
    let abort = |code| Err(SdoError::Abort(code));
    assert_eq!(rig.upload(1, 0x2FFF, 0), abort(AbortCode::NO_OBJECT));
    assert_eq!(rig.upload(1, 0x6040, 7).map(drop), abort(AbortCode::NO_SUB_INDEX).map(drop));
    assert_eq!(rig.download(1, 0x6041, 0, &[0; 2]), abort(AbortCode::READ_ONLY).map(drop));
    assert_eq!(rig.download(1, 0x6060, 0, &[0; 4]), abort(AbortCode::TOO_LONG).map(drop));
    // In the middle of a value.
    let mut rig = blob(0);
    let far = vec![0; 0x1_0001];
    assert_eq!(rig.download(1, BLOB.index, BLOB.sub, &far), abort(AbortCode::OUT_OF_MEMORY).map(drop));
    assert_eq!(rig.download(1, BLOB.index, BLOB.sub, &far[1..]), Ok(()));
}

/// A slave that gives no answer, has no mailbox or is not there is not waited for longer than the given time.
#[test]
fn every_transfer_ends() {
    let mut rig = Rig::scanned(&["drive"]);
    // In Init there is no mailbox.
    assert_eq!(rig.upload(1, 0x1000, 0).map_err(SdoError::abort_code), Err(AbortCode::TIMEOUT));
    rig.reach(AlState::PreOp);
    rig.net.chain.slave_mut(0).delay_sdo(2 * SECOND);
    let begin = rig.net.now;
    assert_eq!(rig.upload(1, 0x1000, 0), Err(MailboxError::TimeUp.into()));
    assert!((SECOND..2 * SECOND + 100 * MS).contains(&(rig.net.now - begin)));
    // The answer that comes after all is none to the next request.
    rig.net.chain.slave_mut(0).delay_sdo(0);
    rig.run_for(2 * SECOND);
    assert_eq!(rig.upload(1, 0x1018, 0).map(|value| value.len()), Ok(1));
    rig.net.chain.connect(0, false);
    assert_eq!(rig.upload(1, 0x1000, 0), Err(MailboxError::NoAnswer.into()));
    assert_eq!(rig.upload(9, 0x1000, 0), Err(MailboxError::NoMailbox.into()));
}

/// Transfers of several slaves run side by side, beside changes of state; one slave has one at a time.
#[test]
fn transfers_run_side_by_side() {
    let mut rig = Rig::of(Chain::line((0..3).map(|n| Blob::of(500 + n).slave())));
    rig.scan();
    rig.reach(AlState::PreOp);
    let mut reads: Vec<_> = (1..=3).map(|slave| rig.master.upload(slave, BLOB, SdoScope::Entry, SECOND)).collect();
    let again = rig.master.upload(2, BLOB, SdoScope::Entry, SECOND);
    let mut change = Some(rig.master.request_state([3].into_iter().collect(), AlState::SafeOp, SECOND));
    assert_eq!(rig.wait(again), Err(MailboxError::Busy.into()));
    while !reads.is_empty() || change.is_some() {
        rig.step();
        reads.retain(|read| {
            let value = rig.master.take(*read);
            let is_left = value.is_none();
            assert!(is_left || value.is_some_and(|value| value.is_ok_and(|value| value.len() >= 500)));
            is_left
        });
        if let Some(ended) = change.and_then(|job| rig.master.take(job)) {
            assert_eq!(ended, Ok(()));
            change = None;
        }
        assert_eq!(rig.master.ended().next(), None, "it was started");
    }
}

/// MASTER-5.5 An emergency becomes an event, in front of an answer, behind it, and while nothing is asked.
#[test]
fn emergencies_are_events() {
    let mut rig = Rig::scanned(&["drive"]);
    rig.reach(AlState::PreOp);
    let emergency = |code| Emergency { code, register: 1, data: [1, 2, 3, 4, 5] };
    rig.net.chain.slave_mut(0).send_emergency(emergency(0x1000));
    rig.run_for(20 * MS);
    assert_eq!(rig.master.take_event(), Some(Event::Emergency { slave: 1, emergency: emergency(0x1000) }));
    for n in 0..5 {
        let id = rig.master.upload(1, ObjectAddress::new(0x1018, 1), SdoScope::Entry, SECOND);
        (0..n).for_each(|_| rig.step());
        rig.net.chain.slave_mut(0).send_emergency(emergency(n));
        assert!(rig.wait(id).is_ok(), "{n}");
        rig.run_for(20 * MS);
        assert_eq!(rig.master.take_event(), Some(Event::Emergency { slave: 1, emergency: emergency(n) }));
    }
    assert_eq!(rig.master.take_event(), None);
}

/// MASTER-5.7 A slave's dictionary is read, in fragments if its mailbox is short.
#[test]
fn objects_are_listed_and_described() {
    let mut rig = Rig::scanned(&["dp3cl"]);
    rig.reach(AlState::PreOp);
    let id = rig.master.object_list(1, ObjectListType::All, SECOND);
    let Ok(all) = rig.wait(id) else { panic!("no list") };
    assert_eq!(all, device("dp3cl").object_list(ObjectListType::All));
    assert!(all.len() > 60, "it does not fit into a mailbox");
    let id = rig.master.object_list(1, ObjectListType::Lengths, SECOND);
    let Ok(lengths) = rig.wait(id) else { panic!("no lengths") };
    assert_eq!((lengths.len(), usize::from(lengths[0])), (5, all.len()));
    let id = rig.master.describe_object(1, 0x1018, SECOND);
    let Ok(description) = rig.wait(id) else { panic!("no description") };
    let description = ObjectDescription::decode(&description).expect("a description");
    assert_eq!((description.index, description.max_sub, description.code), (0x1018, 4, ObjectCode::Record));
    let request = EntryRequest { object: ObjectAddress::new(0x6041, 0), wanted: ValueInfo(7) };
    let id = rig.master.describe_entry(1, request, SECOND);
    let Ok(description) = rig.wait(id) else { panic!("no description") };
    let description = EntryDescription::decode(&description).expect("a description");
    assert_eq!((description.object, description.bits), (request.object, 16));
    let id = rig.master.describe_object(1, 0x2FFF, SECOND);
    assert_eq!(rig.wait(id), Err(SdoError::Abort(AbortCode::NO_OBJECT)));
}

/// MASTER-5.8 An object is read and written as a whole by complete access.
#[test]
fn objects_are_read_as_a_whole() {
    let mut rig = Rig::scanned(&["drive"]);
    rig.reach(AlState::PreOp);
    let id = rig.master.upload(1, ObjectAddress::new(0x1018, 0), SdoScope::Complete, SECOND);
    let Ok(whole) = rig.wait(id) else { panic!("no value") };
    let mut expected = vec![4, 0];
    for sub in 1..=4 {
        expected.extend(rig.upload(1, 0x1018, sub).expect("it can be read"));
    }
    assert_eq!(whole, expected);
    let mapping = [1, 0, 0x00, 0x1A];
    let object = ObjectAddress::new(0x1C13, 0);
    let id = rig.master.download(1, object, SdoScope::Complete, &mapping, SECOND);
    assert_eq!(rig.wait(id), Ok(()));
    let id = rig.master.upload(1, object, SdoScope::Complete, SECOND);
    assert_eq!(rig.wait(id), Ok(mapping.to_vec()));
}

/// A transfer that was given up leaves the mailbox to the next one.
#[test]
fn a_transfer_can_be_given_up() {
    let writes = Arc::default();
    let blob = Blob { writes: Arc::clone(&writes), ..Blob::of(2000) };
    let mut rig = Rig::of(Chain::line([blob.slave()]));
    rig.scan();
    rig.reach(AlState::PreOp);
    for n in 0..40 {
        let id = rig.master.upload(1, BLOB, SdoScope::Entry, SECOND);
        (0..n).for_each(|_| rig.step());
        rig.master.cancel(id);
        assert_eq!(rig.upload(1, BLOB.index, 0), Ok(bytes(2000)), "{n}");
    }
    assert_eq!(rig.download(1, BLOB.index, 0, &[1]), Ok(()));
    assert_eq!(writes.load(Ordering::Relaxed), 1);
}

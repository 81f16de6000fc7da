//! What a flight recorder does when its folder has odd files, when segments are gone or cannot be read, and when it fails itself.

use super::super::helper::Helper;
use super::super::keeper::{Done, Job, Keeper};
use super::super::ring::Ring;
use super::memory::Op;
use super::*;

/// A file in the folder whose name has the largest number does not end the recording.
#[test]
fn names_with_the_largest_number_are_left_alone() {
    let odd = [folder::segment(u64::MAX), folder::moment(u64::MAX), folder::note(u64::MAX)];
    let memory = Memory::of(odd.iter().map(|name| (name.clone(), vec![0; 1000])).collect());
    let mut recorder = Recorder::begin(&memory, LARGE, &[(10, Kind::Alarm)]);
    recorder.frames(20);
    assert_eq!(recorder.end().1.lacks(), None);
    let files = memory.files();
    assert!(ring(&files).0.into_iter().eq(0..20) && moment(&files, 1).is_some());
    assert!(odd.iter().all(|name| files.contains_key(name)));
}

/// If the keeper's thread panics, the user is told.
#[test]
fn a_panic_of_the_thread_is_said() {
    let memory = Memory::default();
    let keeper = Keeper::new(Arc::new(memory.clone()), LARGE.kept, Vec::new());
    let mut helper = Helper::thread(keeper).unwrap();
    // This panic poisons the folder's lock, so every later use of the folder panics.
    std::thread::spawn(move || memory.with(|inside| assert!(inside.frame > 0, "on purpose"))).join().unwrap_err();
    helper.post(Job::Finished { number: 1, is_packed: false });
    assert!(helper.end());
    assert!(matches!(&helper.done()[..], [Done::NotKept(why)] if why.contains("has failed")));
}

/// Lets a keeper keep a moment whose last segment is `last`; returns the results of the keeper.
fn keep(memory: &Memory, bounds: Bounds, moment: Moment, last: u64) -> Vec<Done> {
    let kept = memory
        .files()
        .into_iter()
        .filter_map(|(name, bytes)| folder::number(&name, folder::moment).map(|number| (number, bytes.len() as u64)));
    let mut keeper = Keeper::new(Arc::new(memory.clone()), bounds.kept, kept.collect());
    let mut said = Vec::new();
    keeper.work(Job::Keep(moment, last), &mut |done| said.push(done));
    said
}

/// A moment of all frames from a segment on.
fn all_from(number: u64, segment: u64, kind: Kind) -> Moment {
    let reason = Reason { at_ns: BEGIN_NS, kind, text: "why".to_owned() };
    Moment { number, segment, to_ns: u64::MAX, reasons: vec![reason], ..Moment::default() }
}

/// A ring of four segments.
fn four_segments() -> Memory {
    let memory = Memory::default();
    let mut recorder = Recorder::begin(&memory, LARGE, &[]);
    recorder.frames(1200);
    recorder.end();
    memory
}

/// If the ring has deleted the first segment of a moment meanwhile, the moment says so. Numbers that no segment has are not
/// looked for one by one.
#[test]
fn a_moment_without_its_beginning_says_so() {
    let memory = four_segments();
    let lacks = |moment: Moment, last| {
        let number = moment.number;
        assert!(keep(&memory, LARGE, moment, last).is_empty());
        read(&memory.files()[&folder::moment(number)]).unwrap().1
    };
    assert!(lacks(all_from(1, 1, Kind::Alarm), 4).is_nothing());
    assert_eq!(lacks(all_from(2, 0, Kind::Alarm), u64::MAX).missing, 1);
    memory.with(|inside| inside.files.remove(&folder::segment(1)));
    let lacks = lacks(all_from(3, 1, Kind::Alarm), 4);
    assert!(lacks.to_string().contains("1 frames are missing: and more, at the beginning"), "{lacks}");
}

/// A segment that cannot be read to its end makes a moment one that was not ended.
#[test]
fn a_segment_that_cannot_be_read_is_noticed() {
    let memory = four_segments();
    let length = memory.files()[&folder::segment(2)].len() as u64;
    memory.with(|inside| inside.reads_max = Some(length - 20));
    assert!(keep(&memory, LARGE, all_from(1, 2, Kind::Alarm), 2).is_empty());
    memory.with(|inside| inside.reads_max = None);
    let (_, lacks) = read(&memory.files()[&folder::moment(1)]).unwrap();
    assert_eq!(lacks.not_ended, 1, "{lacks}");
}

/// No moment is deleted for a new one that has no room even so.
#[test]
fn a_moment_without_room_deletes_none() {
    let memory = four_segments();
    for (number, kind) in [(1, Kind::Gap), (2, Kind::Mark)] {
        assert!(keep(&memory, LARGE, all_from(number, number, kind), number).is_empty());
    }
    let files = memory.files();
    let length = |name: String| files[&name].len() as u64;
    // Beside the moment of the mark one byte is missing, even if the moment of the gap is deleted.
    let bounds = Bounds { kept: length(folder::moment(2)) + length(folder::segment(3)) - 1, ..LARGE };
    assert!(keep(&memory, bounds, all_from(3, 3, Kind::Alarm), 3).is_empty());
    let files = memory.files();
    assert_eq!([1, 2, 3].map(|number| files.contains_key(&folder::moment(number))), [true, true, false]);
}

/// The compressed form of a segment is deleted first: the keeper may be renaming it to the name of the segment.
#[test]
fn a_compressed_form_is_deleted_first() {
    let names = [folder::segment(1), folder::packed(1), folder::segment(2)];
    let memory = Memory::of(names.iter().map(|name| (name.clone(), vec![0; 100])).collect());
    Ring::new(Arc::new(memory.clone()), 150, vec![(1, 100), (2, 100)]).make_room(0).unwrap();
    let log = memory.with(|inside| std::mem::take(&mut inside.log));
    let removed: Vec<&String> =
        log.iter().filter_map(|(_, op)| if let Op::Remove(name) = op { Some(name) } else { None }).collect();
    assert_eq!(removed, [&names[1], &names[0]]);
}

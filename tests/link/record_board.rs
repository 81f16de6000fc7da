//! A simulated board, recorded by its link's key.

use ecmsk::link::options::Clock;
use ecmsk::link::{self, Dir, Link, LinkError, Share, Wait};
use ecmsk::sk::{Frame, MasterCommand, MasterState, SlotSize};
use support::recording::read_file;

/// Writes one command, reads one report, and notes both.
fn exchange(board: &dyn Link, command: &MasterCommand, seen: &mut Vec<(Dir, Frame)>) -> Result<(), LinkError> {
    let mut frame = Frame::new();
    frame.put_master(SlotSize::Bytes12, command);
    frame.fill_crc(SlotSize::Bytes12);
    board.write(&frame, Wait::Forever)?;
    seen.push((Dir::Write, frame.clone()));
    board.read(&mut frame, Wait::Forever)?;
    seen.push((Dir::Read, frame));
    Ok(())
}

/// SK-4.34 SW_RESET drops the connection: the frames before it stay in the recording when the board is opened again
#[test]
fn the_recording_of_a_board_goes_on_after_sw_reset() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a board & more.pcapng");
    let encoded = path.display().to_string().replace(' ', "%20").replace('&', "%26");
    let uri = format!("sim:?slaves=drive&clock=virtual&name=recorded&record={encoded}");

    let mut seen = Vec::new();
    let board = link::open(&uri, Share::ByName).unwrap();
    for state in [MasterState::PreOp, MasterState::SafeOp, MasterState::Op] {
        for _ in 0..200 {
            exchange(&*board, &MasterCommand::SetState(state), &mut seen).unwrap();
        }
    }
    let mut reset = Ok(());
    while reset.is_ok() {
        reset = exchange(&*board, &MasterCommand::SoftReset, &mut seen);
    }
    assert!(matches!(reset, Err(LinkError::Lost { .. })), "{reset:?}");
    board.close();
    let before = seen.len();

    let board = std::iter::repeat_with(|| link::open(&uri, Share::ByName)).find_map(Result::ok).unwrap();
    exchange(&*board, &MasterCommand::SetState(MasterState::PreOp), &mut seen).unwrap();
    assert_eq!(board.stats().record_dropped, 0);
    board.close();

    let recorded = read_file(&path);
    assert_eq!((recorded.len(), seen.len()), (before + 2, before + 2));
    for (recorded, (dir, frame)) in recorded.iter().zip(&seen) {
        assert_eq!((recorded.dir, &*recorded.frame), (*dir, frame));
    }
    let sent = |dir| recorded.iter().filter(move |recorded| recorded.dir == dir);
    for dir in [Dir::Write, Dir::Read] {
        assert!(sent(dir).zip(sent(dir).skip(1)).all(|(a, b)| a.at_ns < b.at_ns), "{dir} times go on across the reset");
    }
    let file = std::fs::File::open(&path).unwrap();
    let recording = ecmsk::recording::Recording::new(file, "file").unwrap();
    let meta = recording.meta().unwrap();
    assert_eq!((meta.slot, meta.clock, meta.base_ns), (Some(SlotSize::Bytes12), Clock::Virtual, 0));
    assert!(meta.link.starts_with("sim:?slaves=drive&clock=virtual&name=recorded&record="), "{}", meta.link);
}

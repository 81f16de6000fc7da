//! The functions call by call: the programs of `tests/c/` that do not need Unix, each of which checks itself.

use ecmsk::link::Dir;
use ecmsk::recording::Recording;
use ecmsk::sk::{CommandId, SlotSize};

use crate::fixture::{Folder, Toolchain, Width, lines, source};
use support::root;

const VIRTUAL: &str = "sim:?slaves=drive*2&clock=virtual";
const CLOCKS: [&str; 2] = [VIRTUAL, "sim:?slaves=drive*2&clock=real"];
/// The slots of the programs.
const SIZE: SlotSize = SlotSize::Bytes12;

/// A folder with the program of `tests/c/` and the DLL.
fn with_program(width: Width, name: &str) -> (Folder, String) {
    let folder = Folder::with_dll(width, &format!("habit-{name}"));
    let program = format!("{name}.exe");
    folder.build(Toolchain::MinGw, &root().join("tests/c").join(name).with_extension("c"), &program);
    (folder, program)
}

fn passes(width: Width, name: &str, links: &[&str]) {
    let (folder, program) = with_program(width, name);
    for link in links {
        folder.passes(&program, link, &[]);
    }
}

crate::for_each_width! {
    /// LIB-41, LIB-47, LIB-20 Calls before Open and after Close return false and have no effect.
    #[test]
    fn calls_while_nothing_is_open(width: Width) {
        passes(width, "not_open", &CLOCKS);
    }

    /// LIB-54 A read that fails returns the last transferred frame.
    #[test]
    fn a_read_that_fails(width: Width) {
        passes(width, "last_frame", &CLOCKS);
    }

    /// LIB-70 After a thread is ended by TerminateThread in a read, all other calls work: with a board that sends
    /// reports and one that sends none, with one that is recorded and one that another machine serves; also if many threads
    /// read at once.
    #[test]
    fn a_thread_that_is_terminated(width: Width) {
        let folder = Folder::with_dll(width, "habit-terminated");
        folder.build(Toolchain::MinGw, &source("terminated.c"), "terminated.exe");
        let (server, _) = support::tcp::serve("sim:?slaves=io&clock=real");
        for (link, says) in [
            ("sim:?slaves=io&clock=real", "reports"),
            ("sim:?slaves=io&clock=real", "crowd"),
            ("sim:?slaves=io&clock=real&fault.drop.read=1", "silent"),
            ("sim:?slaves=io&clock=real&record=terminated.pcapng", "reports"),
            (&support::tcp::uri(&server, "record=terminated_tcp.pcapng"), "reports"),
            (&support::tcp::uri(&server, ""), "crowd"),
        ] {
            folder.passes("terminated.exe", link, &[says]);
        }
    }

    /// LIB-27, LIB-28, LIB-51, LIB-52, LIB-53 Lengths and addresses; no byte outside is accessed.
    #[test]
    fn lengths_and_addresses(width: Width) {
        passes(width, "lengths", &CLOCKS);
    }

    /// LIB-44, LIB-47 Open twice, close twice, open again.
    #[test]
    fn open_twice_close_twice(width: Width) {
        passes(width, "open_close", &CLOCKS);
    }

    /// SK-4.34, LIB-43, LIB-49 A board that was reset is unusable until Open.
    #[test]
    fn a_reset_board(width: Width) {
        passes(width, "reset", &CLOCKS);
    }

    /// LIB-40, LIB-64 GetLastError after each call.
    #[test]
    fn windows_last_error(width: Width) {
        let folder = Folder::with_dll(width, "habit-last-error");
        folder.build(Toolchain::MinGw, &source("last_error.c"), "last_error.exe");
        for link in CLOCKS {
            folder.passes("last_error.exe", link, &["reset"]);
        }
        folder.passes("last_error.exe", "sim:?slaves=io&fault.drop.read=1", &["closed"]);
        folder.passes("last_error.exe", "sim:?slaves=none&clock=virtual", &["fails"]);
    }

    /// LIB-36, LIB-54 A read with a limit ends.
    #[test]
    fn a_read_with_a_limit(width: Width) {
        passes(width, "timeout", &CLOCKS.map(|link| format!("{link}&read_timeout_ms=20")).each_ref().map(String::as_str));
    }

    /// LIB-55 The newest 32 reports are kept.
    #[test]
    fn unread_reports(width: Width) {
        passes(width, "unread", &["sim:?slaves=drive&clock=virtual"]);
    }

    /// LIB-24, LIB-55 SDO requests of a program that is starved: each has its answer, also in the recording.
    #[test]
    fn a_starved_program_gets_its_answers(width: Width) {
        let (folder, program) = with_program(width, "starved_sdo");
        folder.passes(&program, &format!("{VIRTUAL}&record=starved.pcapng"), &[]);
        let (mut asked, mut requests) = (None, 0);
        let mut recording = Recording::open(&folder.path().join("starved.pcapng")).expect("a recording");
        let frames: Result<Vec<_>, _> = (&mut recording).collect();
        assert!(recording.lacks().is_nothing(), "{}", recording.lacks());
        for recorded in frames.expect("it is whole") {
            let sdo = recorded.frame.slot(SIZE, SIZE.sdo_slot());
            let what = (sdo.id, sdo.data1, sdo.data2);
            if recorded.dir == Dir::Read {
                asked.take_if(|asked| *asked == what);
            } else if [CommandId::SdoRead, CommandId::SdoWrite].iter().any(|id| id.code() == sdo.id) {
                assert_eq!(asked.replace(what), None, "without an answer");
                requests += 1;
            }
        }
        assert_eq!((asked, requests), (None, 80));
    }

    /// Several boards by URI, handles, statistics, names.
    #[test]
    fn functions_beside_the_vendors(width: Width) {
        passes(width, "boards", &[VIRTUAL]);
    }

    /// SK-1.23 The caller's bytes go to the board and to a recording unchanged.
    #[test]
    fn bytes_as_they_are(width: Width) {
        let (folder, program) = with_program(width, "untouched");
        folder.passes(&program, "sim:?clock=virtual&record=untouched.pcapng", &[]);
        let frames: Result<Vec<_>, _> =
            Recording::open(&folder.path().join("untouched.pcapng")).expect("a recording").collect();
        let mut expected: [u8; 512] = std::array::from_fn(|i| (0x80 + i * 7) as u8);
        let mut count = 0;
        for (frame, crc) in frames.expect("whole").iter().filter(|frame| frame.dir == Dir::Write).zip([0, 0xEE]) {
            expected[3] = crc;
            assert_eq!(frame.frame.bytes(), &expected);
            count += 1;
        }
        assert_eq!(count, 2);
    }

    /// LIB-42, WIN-7 An Open that fails returns false, with a text that says why and what to do.
    #[test]
    fn an_open_that_fails(width: Width) {
        let folder = Folder::with_dll(width, "habit-fails");
        folder.build(Toolchain::MinGw, &source("which_link.c"), "which_link.exe");
        for (link, parts) in [
            ("sim:?slaves=none&clock=virtual", &["no slave"][..]),
            ("can:eth1", &["from ECMSK_LINK", "unknown scheme `can`", "sim:?slaves=drive*2"]),
            ("sim:?slaves=drive&colour=red", &["from ECMSK_LINK", "colour"]),
            ("nonsense", &["from ECMSK_LINK", "nonsense"]),
            ("tcp://127.0.0.1:1", &["from ECMSK_LINK", "127.0.0.1:1"]),
        ] {
            let ended = folder.run("which_link.exe", link, ["NEXTWUSBLib.dll"]);
            assert_eq!((ended.status.code(), ended.stderr.as_str()), (Some(1), ""), "{link}");
            let said = lines(&ended.stdout);
            assert!(parts.iter().all(|part| said.contains(part)), "{link}: {said}");
        }
    }

    /// WIN-8 A caller's floating-point state does no harm and is preserved.
    #[test]
    fn floating_point_of_the_caller(width: Width) {
        let folder = Folder::with_dll(width, "habit-floats");
        folder.build(Toolchain::MinGw, &source("floats.c"), "floats.exe");
        let sum = |state: [&str; 2]| {
            let ended = folder.run("floats.exe", "sim:?slaves=drive&clock=virtual", state);
            assert_eq!(ended.stderr, "", "{state:?}");
            lines(&ended.success())
        };
        let usual = sum(["1F80", "037F"]);
        // Invalid, divide by zero and overflow raise exceptions; rounding down, denormals as 0, single precision;
        // rounding towards zero.
        for other in [["1900", "0372"], ["BFC0", "047F"], ["7F80", "0C7F"]] {
            assert_eq!(sum(other), usual, "{other:?}");
        }
    }
}

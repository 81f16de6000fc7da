//! A move whose process stands still early: stopped in a debugger, or on a machine that is suspended.

mod needs_network_namespace {
    use std::io::BufReader;
    use std::process::Command;
    use std::thread;
    use std::time::Duration;

    use ecmsk::coe::{ObjectAddress, SdoScope};
    use ecmsk::link::Dir;
    use ecmsk::recording::Recording;
    use ecmsk::sk::{CommandId, DriveResponse, SlotSize};
    use masters::Rig;

    use crate::card::{by_library, ends, file, started, tool, until};

    const SIZE: SlotSize = SlotSize::Bytes12;
    /// How far a simulated drive may be from its target, counts.
    const NEAR: i32 = 4;

    /// The differences of successive numbers.
    fn steps(of: &[i32]) -> impl Iterator<Item = i32> {
        of.windows(2).map(|pair| pair[1] - pair[0])
    }

    /// Stops the process of a move to `end` for 1.2 s, some 250 ms after its axis was switched on. A slave leaves OP meanwhile. However that
    /// ends, no target and no axis goes beyond `end`, back, or faster than `speed`, in counts/s.
    fn stalled(end: i32, speed: i32) {
        let name = format!("tool_stalled_{end}");
        let _rig = Rig::new("drive*2", &name);
        let tape = file(&format!("{name}.pcapng"));
        let _ = std::fs::remove_file(&tape);
        let link = format!("nic:veth0?priority=20&record={}", tape.display());
        let (target, velocity) = (format!("1={end}"), speed.to_string());
        let line = ["move", &target, "--velocity", &velocity, "--yes", "--up", "--slaves", "drive*2", "--link", &link];
        let mut child = started(&mut tool(&line));
        let mut err = BufReader::new(child.stderr.take().expect("a pipe"));
        until(&mut err, "switched on: axis 1");
        thread::sleep(Duration::from_millis(250));
        let pid = child.id().to_string();
        let signal = |name: &str| support::succeed(Command::new("kill").args([name, &pid]));
        signal("-STOP");
        thread::sleep(Duration::from_millis(1200));
        signal("-CONT");
        let ran = ends(child, err);
        assert!(matches!(ran.code, Some(0 | 1)), "{ran:?}");

        let (mut targets, mut reports) = (Vec::new(), Vec::new());
        for recorded in Recording::open(&tape).expect("a recording") {
            let recorded = recorded.expect("a frame");
            let slot = recorded.frame.slot(SIZE, 1);
            match recorded.dir {
                Dir::Write if slot.id == CommandId::Csp.code() => targets.push(slot.data1 as i32),
                Dir::Write => {}
                Dir::Read => reports.push((recorded.at_ns, DriveResponse::decode(&slot).position)),
            }
        }
        let fastest = speed / 1000 + 1;
        assert!(targets.len() > 1 && steps(&targets).all(|step| (0..=fastest).contains(&step)), "{ran:?}: {targets:?}");
        assert!(targets.iter().all(|target| *target <= end), "{ran:?}: {targets:?}");
        let is_on_its_way = |at: &i32| (-NEAR..=end + NEAR).contains(at);
        let positions: Vec<i32> = reports.iter().map(|(_, position)| *position).collect();
        assert!(positions.iter().all(is_on_its_way) && steps(&positions).all(|step| step >= -NEAR), "{positions:?}");
        // A report was measured after the one before it was made: with the time since the one before that, a busy machine
        // shows no step as too long.
        for three in reports.windows(3) {
            let [(began, _), (_, from), (at, to)] = [three[0], three[1], three[2]];
            let cycles = (at - began).div_ceil(1_000_000);
            let most = i64::from(fastest) * (cycles as i64 + 1) + i64::from(NEAR);
            assert!(i64::from(to - from) <= most, "{ran:?}: from {from} to {to} in {cycles} cycles");
        }
        let at = by_library(|network| network.upload(1, ObjectAddress::new(0x6064, 0), SdoScope::Entry));
        let at = i32::from_le_bytes(at.try_into().expect("four bytes"));
        assert!(is_on_its_way(&at), "{ran:?}: at {at}");
    }

    /// A short move, stopped in its first counts.
    #[test]
    fn a_short_move_goes_no_further() {
        stalled(500, 1000);
    }

    /// A longer one, stopped while it accelerates.
    #[test]
    fn a_longer_move_goes_no_further() {
        stalled(20_000, 10_000);
    }
}

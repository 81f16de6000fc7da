//! The Nth system call of `ecmsk move` on a network card fails, with each error that it may give, or the process is killed
//! there: the run ends, it ends with status 0 only at its target, and afterwards the axis stands. The test makes a share
//! of all failures, `cargo xtask soak` a larger one.
#![cfg(all(target_os = "linux", target_arch = "x86_64"))]

mod needs_network_namespace {
    use std::thread;
    use std::time::{Duration, Instant};

    use ecmsk::ethercat::{Command as Datagram, DatagramHeader, ETHERTYPE, Frame, FrameHeader, FrameWriter};
    use ecmsk::io::ethernet::{DefaultRoute, EthernetSocket, check};
    use masters::{MASTER, Rig};
    use support::failing_calls::{self, Blow, Run, Struck, Whose};

    /// A run takes a second. The limit ends a run that hangs.
    const LIMIT: Duration = Duration::from_secs(120);
    /// The default number of failures.
    const SHARE: usize = 8;
    const TARGET: i32 = 500;
    /// By then the watchdog of a slave has expired and the ramp of a drive has ended.
    const AT_REST: Duration = Duration::from_secs(1);
    /// The time between two looks.
    const APART: Duration = Duration::from_millis(100);
    /// Sync manager 3, which has the inputs: address and length.
    const INPUTS: u16 = 0x0818;

    /// Reads the slave's memory without changing it.
    struct Eye(EthernetSocket);

    impl Eye {
        fn open() -> Self {
            let interface = check(MASTER, DefaultRoute::Allowed).expect("an interface");
            Self(EthernetSocket::open(&interface, ETHERTYPE).expect("root"))
        }

        /// Bytes of the first slave; `None`: they cannot be read, as inputs below SafeOP.
        fn read(&self, address: u16, len: usize) -> Option<Vec<u8>> {
            let mut frame = [0; 128];
            let mut writer = FrameWriter::new(&mut frame, FrameHeader::datagrams([2, 0, 0, 0, 0, 1])).expect("room");
            writer.push(DatagramHeader::register(Datagram::Aprd, 0xE7, 0, address), &vec![0; len]).expect("room");
            let sent = writer.finish().len().max(60);
            self.0.send(&frame[..sent]).expect("it is sent");
            let began = Instant::now();
            let mut answer = [0; 1514];
            while began.elapsed() < Duration::from_secs(20) {
                let Ok(Some(taken)) = self.0.take(&mut answer) else {
                    thread::sleep(Duration::from_millis(1));
                    continue;
                };
                let datagrams = Frame::decode(&answer[..taken]).ok().and_then(|frame| frame.datagrams());
                let ours = datagrams.into_iter().flatten().flatten().find(|datagram| datagram.header.index == 0xE7);
                if let Some(datagram) = ours {
                    return (datagram.working_counter > 0).then(|| datagram.data.to_vec());
                }
            }
            panic!("the slave answers nothing");
        }

        fn inputs(&self) -> Option<Vec<u8>> {
            let area = self.read(INPUTS, 4)?;
            let [address, len] = [0, 2].map(|at| u16::from_le_bytes([area[at], area[at + 1]]));
            (len > 0).then(|| self.read(address, len.into()))?
        }

        /// Checks that the inputs of the slave, which include its position, do not change.
        fn stands(&self) -> Result<(), String> {
            thread::sleep(AT_REST);
            let before = self.inputs();
            thread::sleep(APART);
            let after = self.inputs();
            if before == after { Ok(()) } else { Err(format!("the axis moves: {before:?}, {after:?}")) }
        }
    }

    fn moves(blow: Option<Blow>) -> Struck {
        let words =
            ["move", "1=500", "--up", "--velocity", "20000", "--slaves", "drive", "--link", "nic:veth0?priority=20"];
        failing_calls::run(&mut support::tool_without_link(&words), Whose::Program, blow, LIMIT, None)
    }

    #[test]
    fn a_move_on_a_card() {
        let again = "cargo test -p masters --test failing_calls_on_card";
        failing_calls::strike(again, "a_move_on_a_card", SHARE, |blow| {
            let rig = Rig::new("drive", "failing_calls");
            let run = Run::judge(moves(blow), |struck| {
                let said = &struck.ended.stdout;
                let is_closed = struck.dealt.is_some_and(|dealt| dealt.is_write_to(1));
                let position: Option<i32> =
                    said.strip_prefix("axis 1: at ").and_then(|number| number.trim_end().parse().ok());
                let is_there = position.is_some_and(|position| (position - TARGET).abs() <= 2);
                if is_there || is_closed { Ok(()) } else { Err(format!("it says `{said}`")) }
            });
            let run = run.and(|_| Eye::open().stands());
            rig.end();
            run
        });
    }
}

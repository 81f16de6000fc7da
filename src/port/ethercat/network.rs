//! The simulated slaves on one cable, and the fault script (`script=`) that acts on them. The caller passes the time to
//! every call, so that tests need no clock; no network interface is used here.

use super::ServeError;
use super::told::Told;
use crate::engine::Script as _;
use crate::ethercat::{AlStatus, CableEnd, FRAME_LEN_MIN, Frame, Ns};
use crate::slave::Slave;
use crate::slave::cable::Cable;
use crate::slave::esc::{CabledChain, Chain, FrameFate};
use crate::testbed::script::{RunningScript, Script, ScriptOrigin};
use crate::testbed::simulated_slaves;

/// Slaves in a line, with the cable by which scripts and tests cause faults.
pub struct Network {
    slaves: CabledChain,
    script: Option<RunningScript>,
    told: Told,
    /// Log lines that [`Self::take_lines`] has not returned yet.
    lines: Vec<String>,
    /// The time of the newest frame or of the newest call of [`Self::advance`], ns since the slaves were switched on.
    now: Ns,
}

impl Network {
    /// Slaves in a line, switched on at time 0, when the script begins. The clock of the first slave is `drift_ppm`
    /// parts per million too fast, that of the last one is too slow by as much, and the others are evenly distributed
    /// in between.
    ///
    /// # Errors
    /// [`ServeError::Description`]: the model of one of the slaves does not define the content of its EEPROM.
    pub fn new(devices: Vec<Box<dyn Slave>>, script: Option<Script>, drift_ppm: u16) -> Result<Self, ServeError> {
        let slaves = CabledChain::with_drift(devices, Cable::default(), u32::from(drift_ppm) * 1000)?;
        let told = Told::new(slaves.chain().len());
        let script = script.map(|script| simulated_slaves::start(script, slaves.cable().clone(), 0));
        Ok(Self { slaves, script, told, lines: Vec::new(), now: 0 })
    }

    /// The simulated cable. Tests and scripts cause faults with it.
    pub const fn cable(&self) -> &Cable {
        self.slaves.cable()
    }

    /// The simulated slaves, in network order.
    pub const fn chain(&self) -> &Chain {
        self.slaves.chain()
    }

    /// Whether a received frame comes from an EtherCAT master: it contains datagrams.
    pub fn is_masters(frame: &[u8]) -> bool {
        Frame::decode(frame).is_ok_and(|frame| frame.datagrams().is_some())
    }

    /// Connects or disconnects the cable at one end of the line of slaves. At the beginning only the first end is
    /// connected.
    pub fn connect(&mut self, end: CableEnd, is_connected: bool) {
        match end {
            CableEnd::First => self.slaves.connect_first(is_connected),
            CableEnd::Last => self.slaves.connect_second(is_connected),
        }
    }

    /// Processes a frame of `len` bytes that comes in at `end` at time `now`, in place. Returns the length of the
    /// answer, padded with zeros to the minimum of Ethernet, and the end at which it comes out; `None`: the frame does
    /// not come back. `frame` must have room for the padding, and times must not decrease. Call [`Self::look`] once the
    /// answer is sent.
    pub fn answer(&mut self, end: CableEnd, frame: &mut [u8], len: usize, now: Ns) -> Option<(usize, CableEnd)> {
        if let Some(script) = &mut self.script {
            script.begin(ScriptOrigin::Frame, now);
        }
        self.now = now;
        self.run_script(now);
        let (fate, end) = self.slaves.process_from(end, &mut frame[..len], now);
        let padded = len.max(FRAME_LEN_MIN);
        frame[len..padded].fill(0);
        matches!(fate, FrameFate::Returned(_)).then_some((padded, end))
    }

    /// Logs each slave that has an AL status code other than 0 after the newest frame. Call this after each frame: the
    /// next one may acknowledge the error, and the code would then never be logged.
    pub fn look(&mut self) {
        self.told.look_at_states(self.slaves.chain(), self.now, |(_, code)| code != AlStatus::NONE, &mut self.lines);
    }

    /// Advances the time of the slaves and of the script to `now`, and logs what has changed.
    pub fn advance(&mut self, now: Ns) {
        self.now = now;
        self.run_script(now);
        self.slaves.advance(now);
        self.told.look_at_states(self.slaves.chain(), now, |_| true, &mut self.lines);
        self.told.look_at_faults(self.slaves.chain(), now, &mut self.lines);
        if let Some(script) = &mut self.script
            && self.told.has_op()
        {
            script.begin(ScriptOrigin::Op, now);
        }
    }

    /// Called at the end of the server: logs state changes that were held back because there were too many.
    pub fn finish(&mut self) {
        self.told.tell_rest(self.slaves.chain(), self.now, &mut self.lines);
    }

    /// Takes the log lines since the last call.
    pub fn take_lines(&mut self) -> impl Iterator<Item = String> {
        self.lines.drain(..)
    }

    /// Carries out the actions of the script that are due by `now`.
    fn run_script(&mut self, now: Ns) {
        let lines = &mut self.lines;
        if let Some(script) = &mut self.script {
            script.run(now, &mut |event| lines.push(event.to_string()));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::address::slaves;
    use crate::ethercat::registers::{AL_CONTROL, AL_STATUS, LATCH_TIMES, RequestedState};
    use crate::ethercat::{
        AlState, Command, DATAGRAM_OVERHEAD, DatagramHeader, FRAME_HEADER_LEN, FRAME_LEN_MAX, FrameHeader, FrameWriter,
    };
    use crate::port::ethercat::told::state_of;

    const MS: Ns = 1_000_000;
    /// Registers 0x0800 to 0x080F: sync managers 0 and 1 as mailboxes, 128 bytes at 0x1000 and at 0x1080. A slave goes
    /// to PreOP only with valid mailboxes; these are the ones that its EEPROM describes.
    const MAILBOXES: [u8; 16] = [0x00, 0x10, 0x80, 0x00, 0x26, 0, 1, 0, 0x80, 0x10, 0x80, 0x00, 0x22, 0, 1, 0];

    /// The test bench: a network of slaves with its time and log lines, and a master that sends one datagram at a time.
    struct Wire {
        network: Network,
        now: Ns,
        lines: Vec<String>,
    }

    impl Wire {
        fn new(list: &str, script: &str) -> Self {
            Self::with_drift(list, script, 0)
        }

        fn with_drift(list: &str, script: &str, drift_ppm: u16) -> Self {
            let specs = slaves::parse(list).expect("a list");
            let devices = simulated_slaves::build(&specs).expect("slaves");
            let script = Script::parse("the test", script, &specs).expect("a script");
            let network = Network::new(devices, Some(script), drift_ppm).expect("a network");
            Self { network, now: 0, lines: Vec::new() }
        }

        fn wait(&mut self, ms: Ns) {
            for _ in 0..ms {
                self.now += MS;
                self.network.advance(self.now);
                self.lines.extend(self.network.take_lines());
            }
        }

        /// Sends a datagram. Returns data and working counter of the answer; `None`: the frame is lost.
        fn send(&mut self, command: Command, address: u32, data: &[u8]) -> Option<(Vec<u8>, u16)> {
            let mut frame = [0xEE; FRAME_LEN_MAX];
            let mut writer = FrameWriter::new(&mut frame, FrameHeader::datagrams([0x10; 6])).expect("room");
            let (reserved, circulating, more) = (0, false, false);
            let header = DatagramHeader { command, index: 0, address, len: 0, reserved, circulating, more, irq: 0 };
            writer.push(header, data).expect("room");
            writer.finish();
            // A pair of virtual interfaces (veth) delivers frames without padding, so the test sends them without
            // padding too.
            let len = FRAME_HEADER_LEN + DATAGRAM_OVERHEAD + data.len();
            frame[len..].fill(0xEE);
            self.now += 1000;
            let back = self.network.answer(CableEnd::First, &mut frame, len, self.now);
            self.network.look();
            let (padded, end) = back?;
            assert_eq!(end, CableEnd::First);
            self.lines.extend(self.network.take_lines());
            assert_eq!((padded, frame[6]), (len.max(FRAME_LEN_MIN), 0x12));
            assert!(frame[len..padded].iter().all(|byte| *byte == 0), "padded with zeros");
            let decoded = Frame::decode(&frame[..len]).expect("a frame");
            let datagram = decoded.datagrams().expect("datagrams").next().expect("one").expect("whole");
            Some((datagram.data.to_vec(), datagram.working_counter))
        }

        /// The number of slaves that answer a broadcast. `None`: the frame does not come back.
        fn count(&mut self) -> Option<u16> {
            Some(self.send(Command::Brd, u32::from(AL_STATUS) << 16, &[0; 2])?.1)
        }
    }

    /// ECAT-15.1 Answers have at least 60 bytes, padded with zeros. A frame without EtherCAT datagrams does not count
    /// as a master's frame, so the server ignores it.
    #[test]
    fn answers_are_padded_and_other_frames_ignored() {
        let mut wire = Wire::new("drive*3", "");
        assert_eq!(wire.count(), Some(3));
        assert_eq!(
            wire.send(Command::Brd, u32::from(AL_STATUS) << 16, &[0; 300]).map(|(data, _)| data.len()),
            Some(300)
        );
        let mut frame = [0; 60];
        frame[12..14].copy_from_slice(&[0x08, 0x00]);
        assert!(!Network::is_masters(&frame) && !Network::is_masters(&frame[..10]), "IPv4, and less than a header");
        frame[12..16].copy_from_slice(&[0x88, 0xA4, 0x0C, 0x40]);
        assert!(!Network::is_masters(&frame), "network variables");
        frame[15] = 0x10;
        assert!(Network::is_masters(&frame), "datagrams");
    }

    /// ECAT-15.18 Clocks drift as requested: the first one is too fast by the requested value, the last one too slow by
    /// the same value.
    #[test]
    fn crystals_drift() {
        let mut wire = Wire::with_drift("drive*3", "", 100);
        let times = |wire: &mut Wire| {
            [0_u32, 0xFFFF, 0xFFFE].map(|adp| {
                let (data, _) = wire.send(Command::Aprd, adp | 0x0910 << 16, &[0; 8]).expect("it answers");
                u64::from_le_bytes(data.try_into().expect("8 bytes"))
            })
        };
        let before = times(&mut wire);
        wire.wait(1000);
        let after = times(&mut wire);
        let passed = [0, 1, 2].map(|n| (after[n] - before[n]) as i64 - (after[1] - before[1]) as i64);
        assert_eq!(passed.map(|ns| ns / 1000), [100, 0, -100]);
    }

    /// ECAT-15.2 A cut cable separates the slaves behind the cut. A slave without power (`lose`) and one that does not
    /// answer (`mute`) still pass frames on to the slaves behind them. A cut before the first slave loses all frames.
    #[test]
    fn a_script_cuts_mutes_and_loses() {
        let script =
            "at 10ms cut 3 for 10ms\nat 30ms lose 2 for 10ms\nat 50ms mute 1 for 10ms\nat 70ms cut 1 for 10ms\n";
        let mut wire = Wire::new("drive*4", script);
        let mut counted = Vec::new();
        for _ in 0..9 {
            counted.push(wire.count());
            wire.wait(10);
        }
        let all = Some(4);
        assert_eq!(counted, [all, Some(2), all, Some(3), all, Some(3), all, None, all]);
        assert!(
            wire.lines.iter().any(|line| line.starts_with("script, line 2: `lose 2` at 0.030 s")),
            "{:?}",
            wire.lines
        );
    }

    /// ECAT-15.20 An alarm is logged with its code and text when it appears or replaces another one, and when it is
    /// gone; for a module of two axes also with the axis.
    #[test]
    fn alarms_are_told() {
        let script = "at 10ms alarm 1 0x7500\nat 20ms alarm 1 0x8611\nat 30ms alarm 3.2 0x7500\nat 40ms alarm 2 0x3220\nat 50ms lose 2 for 5ms\n";
        let mut wire = Wire::new("drive,dp3cl,hsp2", script);
        wire.wait(60);
        let alarms: Vec<&String> = wire.lines.iter().filter(|line| line.starts_with("slave")).collect();
        assert_eq!(
            alarms,
            [
                "slave 1: alarm 0x7500 (communication)",
                "slave 1: alarm 0x8611 (following error)",
                "slave 3.2: alarm 0x7500 (communication)",
                "slave 2: alarm 0x3220 (under voltage)",
                "slave 2: alarm 0x3220 is cleared",
            ]
        );
        assert!(
            wire.lines.iter().any(|line| line.starts_with("script, line 1: `alarm 1 0x7500` at 0.010 s")),
            "{:?}",
            wire.lines
        );
    }

    /// ECAT-15.24 In a script, the times below the line `from frame` count from the first frame, those below `from op`
    /// from the moment when a slave reaches OP.
    #[test]
    fn a_script_waits_for_the_master() {
        let script =
            "from op\nat 10ms alarm 1 0x7500\nfrom frame\nat 10ms cut 2 for 10ms\nfrom start\nat 5ms mute 2 for 5ms\n";
        let mut wire = Wire::new("io,drive", &script.replace("alarm 1", "alarm 2"));
        let scripted = |wire: &Wire| wire.lines.iter().filter(|line| line.starts_with("script")).count();
        wire.wait(50);
        assert_eq!(scripted(&wire), 2, "{:?}", wire.lines);
        assert_eq!(wire.count(), Some(2));
        wire.wait(5);
        assert_eq!((wire.count(), scripted(&wire)), (Some(2), 2));
        wire.wait(6);
        assert_eq!((wire.count(), scripted(&wire)), (Some(1), 3));
        wire.wait(100);
        assert_eq!((wire.count(), scripted(&wire)), (Some(2), 4), "nobody is in OP");
        // The terminal `io` reaches OP if the master only requests the states and writes the outputs. It needs neither
        // PDO mapping nor distributed clocks, if its sync managers are set as in its EEPROM.
        assert_eq!(wire.send(Command::Apwr, 0x0800 << 16, &MAILBOXES).map(|(_, counter)| counter), Some(1));
        let outputs = [0x00, 0x11, 0x02, 0x00, 0x64, 0, 1, 0, 0x80, 0x11, 0x02, 0x00, 0x20, 0, 1, 0];
        assert_eq!(wire.send(Command::Apwr, 0x0810 << 16, &outputs).map(|(_, counter)| counter), Some(1));
        for state in [2, 4] {
            wire.send(Command::Apwr, u32::from(AL_CONTROL) << 16, &[state, 0]);
            wire.wait(2);
        }
        wire.send(Command::Apwr, 0x1100 << 16, &[0, 0]);
        wire.send(Command::Apwr, u32::from(AL_CONTROL) << 16, &[8, 0]);
        wire.wait(5);
        assert!(wire.lines.iter().any(|line| line == "slave 1 is in OP"), "{:?}", wire.lines);
        assert_eq!(scripted(&wire), 4);
        wire.wait(11);
        assert_eq!(scripted(&wire), 5, "{:?}", wire.lines);
    }

    /// ECAT-15.25 While the network interface before the first slave has no link, no frame comes back. A cut of a
    /// script at the same place ends after the time in the script, a missing link only when the link returns.
    #[test]
    fn a_dead_link_is_no_cut() {
        let mut wire = Wire::new("io*2", "at 10ms cut 1 for 20ms\n");
        let mut counted = Vec::new();
        for is_connected in [true, true, false, true, false, true] {
            wire.network.connect(CableEnd::First, is_connected);
            counted.push(wire.count());
            wire.wait(10);
        }
        assert_eq!(counted, [Some(2), None, None, Some(2), None, Some(2)]);
        wire.network.connect(CableEnd::Last, true);
        wire.network.connect(CableEnd::Last, false);
        assert_eq!(wire.count(), Some(2), "frames turn at the last slave again");
    }

    /// ECAT-15.2 The script line `refuse` makes a slave refuse a state with an AL status code; the refusal is logged. A
    /// slave whose power returns starts in Init.
    #[test]
    fn a_script_refuses_states() {
        let mut wire = Wire::new("io*2", "refuse 2 preop 0x8001 for 20ms\nat 40ms lose 1 for 1ms\n");
        wire.wait(1);
        for n in [0_u32, 0xFFFF] {
            assert_eq!(wire.send(Command::Apwr, n | 0x0800 << 16, &MAILBOXES).map(|(_, counter)| counter), Some(1));
        }
        let states = |wire: &Wire| [0, 1].map(|n| state_of(wire.network.chain().slave(n)));
        let [init, preop] = [AlState::Init, AlState::PreOp].map(RequestedState::State);
        wire.send(Command::Bwr, u32::from(AL_CONTROL) << 16, &[2, 0]);
        wire.wait(2);
        assert_eq!(states(&wire), [(preop, AlStatus::NONE), (init, AlStatus(0x8001))]);
        assert!(
            wire.lines.iter().any(|line| line.starts_with("slave 2 is in Init with AL status 0x8001")),
            "{:?}",
            wire.lines
        );
        wire.wait(20);
        wire.send(Command::Bwr, u32::from(AL_CONTROL) << 16, &[0x12, 0]);
        wire.wait(2);
        assert_eq!(states(&wire), [(preop, AlStatus::NONE); 2]);
        wire.wait(30);
        assert_eq!(states(&wire), [(init, AlStatus::NONE), (preop, AlStatus::NONE)]);
    }

    /// ECAT-15.26 If a slave changes its state too often, some changes are not logged, but their number is. Lines about
    /// another slave are never suppressed because of it, and the final state is always logged.
    #[test]
    fn no_state_is_swallowed() {
        let mut wire = Wire::new("io*2", "");
        for n in [0_u32, 0xFFFF] {
            assert_eq!(wire.send(Command::Apwr, n | 0x0800 << 16, &MAILBOXES).map(|(_, counter)| counter), Some(1));
        }
        let request = |wire: &mut Wire, n: u32, state: u8| {
            wire.send(Command::Apwr, n | u32::from(AL_CONTROL) << 16, &[state, 0]);
            wire.wait(5);
        };
        // For two seconds one slave goes to PreOP and back to Init, again and again.
        for _ in 0..200 {
            request(&mut wire, 0, 2);
            request(&mut wire, 0, 1);
        }
        request(&mut wire, 0xFFFF, 2);
        request(&mut wire, 0, 2);
        let of = |wire: &Wire, who: &str| {
            wire.lines.iter().filter(|line| line.starts_with(who)).cloned().collect::<Vec<_>>()
        };
        assert_eq!(of(&wire, "slave 2"), ["slave 2 is in PreOP"], "the other one is told at once");
        assert_eq!(of(&wire, "slave 1").len(), 20);
        wire.wait(10_000);
        let told = of(&wire, "slave 1");
        assert_eq!(told.len(), 21, "{told:?}");
        assert_eq!(told[20], "slave 1 is in PreOP (380 changes before were not told)", "401 in all");
        request(&mut wire, 0, 1);
        assert_eq!(of(&wire, "slave 1").last().map(String::as_str), Some("slave 1 is in Init"), "told anew");
        // The slave changes its state again and again while the server ends.
        for _ in 0..30 {
            request(&mut wire, 0, 2);
            request(&mut wire, 0, 1);
        }
        wire.network.finish();
        wire.lines.extend(wire.network.take_lines());
        let last = wire.lines.last().expect("a line");
        assert!(last.starts_with("slave 1 is in Init (") && last.ends_with("changes before were not told)"), "{last}");
    }

    /// ECAT-15.27 A network may have more slaves than a board: 254, all of which scripts can address.
    #[test]
    fn a_network_has_more_slaves_than_a_board() {
        let script =
            "at 10ms lose 150 for 10ms\nat 30ms cut 201 for 10ms\nat 50ms mute 254 for 10ms\nat 70ms lose 1 for 5ms\n";
        let specs = slaves::parse_for_network("io*254").expect("a list");
        assert!(slaves::parse_for_network("io*255").is_err() && slaves::parse_for_network("io*250,drive*5").is_err());
        assert!(slaves::parse("io*41").is_err(), "a board has 40");
        let devices = simulated_slaves::build(&specs).expect("slaves");
        let script = Script::parse("the test", script, &specs).expect("a script");
        let network = Network::new(devices, Some(script), 0).expect("a network");
        let mut wire = Wire { network, now: 0, lines: Vec::new() };
        let mut counted = Vec::new();
        for _ in 0..9 {
            counted.push(wire.count());
            wire.wait(10);
        }
        let all = Some(254);
        assert_eq!(counted, [all, Some(253), all, Some(200), all, Some(253), all, Some(253), all]);
    }

    /// DP3CL-8.5 A script that switches an input terminal of a DP3CL on and off (`io`) causes edges at the latch inputs
    /// of the slave controller, which stores their times.
    #[test]
    fn a_script_makes_edges() {
        let mut wire = Wire::new("dp3cl", "at 5ms io 1 inputs 1 for 10ms\n");
        wire.wait(30);
        let times = wire.send(Command::Aprd, u32::from(LATCH_TIMES) << 16, &[0; 32]).expect("it answers").0;
        let times: Vec<Ns> = times.as_chunks().0.iter().map(|time| Ns::from_le_bytes(*time)).collect();
        assert!((4 * MS..=6 * MS).contains(&times[0]) && (14 * MS..=16 * MS).contains(&times[1]), "{times:?}");
        assert_eq!(times[2..], [0, 0]);
    }

    /// ECAT-8.13 Each frame of a master gets exactly one answer, unless the cable loses the frame: of 1000 frames, 100
    /// of which are lost, 900 are answered.
    #[test]
    fn s40_each_frame_is_answered_once() {
        let mut wire = Wire::new("drive*2", "at 500ms cut 1 for 100ms\n");
        let answers = (0..1000).filter(|_| {
            wire.wait(1);
            wire.count().is_some()
        });
        assert_eq!(answers.count(), 900);
    }

    /// ECAT-15.2 The answers to SDOs take longer by the time that a script sets.
    #[test]
    fn a_script_delays_sdos() {
        let mut wire = Wire::new("io", "sdo-delay 1 50ms for 100ms\n");
        wire.wait(1);
        assert_eq!(wire.send(Command::Apwr, 0x0800 << 16, &MAILBOXES).map(|(_, counter)| counter), Some(1));
        wire.send(Command::Bwr, u32::from(AL_CONTROL) << 16, &[2, 0]);
        wire.wait(2);
        // Uploads 0x1018:1. Returns how long its answer takes, ms.
        let took = |wire: &mut Wire, counter: u8| {
            let mut request = [0; 128];
            request[..12].copy_from_slice(&[10, 0, 0, 0, 0, 0x03 | counter << 4, 0, 0x20, 0x40, 0x18, 0x10, 1]);
            assert_eq!(wire.send(Command::Apwr, 0x1000 << 16, &request).map(|(_, counter)| counter), Some(1));
            let full =
                |wire: &mut Wire| wire.send(Command::Aprd, 0x080D << 16, &[0]).expect("it answers").0[0] & 8 != 0;
            let waited = (0..200)
                .find(|_| {
                    full(wire) || {
                        wire.wait(1);
                        false
                    }
                })
                .expect("an answer");
            let (answer, _) = wire.send(Command::Aprd, 0x1080 << 16, &[0; 128]).expect("it is read");
            assert_eq!(answer[8..16], [0x43, 0x18, 0x10, 1, 0x53, 0x4D, 0x43, 0x45], "the vendor");
            waited
        };
        assert!((49..=52).contains(&took(&mut wire, 1)));
        wire.wait(100);
        assert_eq!(took(&mut wire, 2), 0);
    }
}

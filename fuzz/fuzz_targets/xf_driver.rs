//! The ECM-XF's driver against a chip that answers whatever it likes, often with right check words and to the command that was
//! sent: nothing panics, no wait is over already, packets are whole, each command and each RxPDO ends once, and all of that
//! with a deadline.

#![no_main]

use ecmsk::xf::host::{
    Host, HostConfig, HostError, HostPacing, HostState, IMMEDIATE_SLOTS, NON_IMMEDIATE_SLOTS, Next, ProcessRequest,
    Ticket, Timeouts,
};
use ecmsk::xf::packet::write_not_ready;
use ecmsk::xf::request::{Mdio, SdoGet, SdoOperation, SdoRequest, SlaveCountGet, SlaveNumber, WarmReset};
use ecmsk::xf::{AnswerHeader, CheckRule, CheckType, CommandCode, DataSize, MAX_PACKET, Status, write_answer};
use libfuzzer_sys::fuzz_target;

/// Bytes of a step.
const STEP: usize = 12;
/// How long an exchange takes.
const EXCHANGE_NS: u64 = 50_000;
/// More than all timeouts of a command together, a start and a search among them.
const END_NS: u64 = 60_000_000_000;

fuzz_target!(|bytes: &[u8]| {
    let Some((&kind, bytes)) = bytes.split_first() else { return };
    let mut rig = Rig::new(kind);
    let mut steps = bytes.chunks_exact(STEP);
    for step in &mut steps {
        rig.program(step);
        rig.turn(step);
    }
    rig.end();
});

struct Rig {
    host: Host,
    size: DataSize,
    now: u64,
    tickets: Vec<Ticket>,
    /// The newest process data, and how many reports there are to come.
    sequence: u32,
    reports: u32,
    /// The packet that goes out, and the one before it.
    sent: [Vec<u8>; 2],
}

impl Rig {
    fn new(kind: u8) -> Self {
        let size = if kind & 1 == 0 { DataSize::MIN } else { DataSize::MANUAL };
        let timeouts = Timeouts { busy_ns: 100_000_000, queue_ns: 1_000_000_000, ..Timeouts::DEFAULT };
        let config = HostConfig {
            size: (kind & 2 == 0).then_some(size),
            wanted_size: if kind & 4 == 0 { None } else { DataSize::new(64) },
            pacing: if kind & 8 == 0 { HostPacing::Idle } else { HostPacing::Int0 },
            pipelined_writes: kind & 16 == 0,
            timeouts,
            ..HostConfig::DEFAULT
        };
        let host = Host::new(0, config);
        Self { host, size, now: 0, tickets: Vec::new(), sequence: 0, reports: 0, sent: [Vec::new(), Vec::new()] }
    }

    /// What a program may do.
    fn program(&mut self, step: &[u8]) {
        let (now, data) = (self.now, [step[1]; 4]);
        let object = ecmsk::coe::ObjectAddress::new(0x6040, 0);
        let sdo = |operation| SdoRequest {
            slave: SlaveNumber::new(1).expect("1"),
            object,
            scope: ecmsk::coe::SdoScope::Entry,
            timeout_us: 1000,
            operation,
        };
        let submitted = match step[0] % 16 {
            0 => self.host.submit(now, &sdo(SdoOperation::Write(&data))),
            1 => self.host.submit_pair(now, &sdo(SdoOperation::Read { bytes: 4 }), &SdoGet, 50_000_000),
            2 => self.host.submit(now, &Mdio::Write { phy: 1, register: 2, value: 3 }),
            3 => self.host.submit(now, &SlaveCountGet),
            4 => self.host.submit(now, &WarmReset),
            5 => return self.process(ProcessRequest::Exchange { count: step[1] % 3, outputs: &[step[1]; 12] }),
            6 => return self.process(ProcessRequest::Write { count: 1, outputs: &[step[1]; 12] }),
            7 => return self.process(ProcessRequest::Read { count: step[1] }),
            8 => return self.process(ProcessRequest::DirectExchange { outputs: &[step[1]; 12] }),
            9 => {
                if let HostState::Stopped(_) = self.host.state() {
                    self.host.restart(now);
                }
                return;
            }
            _ => return,
        };
        match submitted {
            Ok(ticket) => self.tickets.push(ticket),
            Err(error) => assert!(!error.to_string().is_empty()),
        }
        if let HostState::Stopped(error) = self.host.state() {
            assert_eq!(submitted, Err(error), "a driver that has stopped takes nothing");
        }
        assert!(self.tickets.len() <= IMMEDIATE_SLOTS + NON_IMMEDIATE_SLOTS);
    }

    fn process(&mut self, data: ProcessRequest<'_>) {
        match self.host.process(data) {
            Ok(sequence) => {
                assert_eq!(sequence, self.sequence + 1);
                self.sequence = sequence;
                self.reports += 1;
            }
            Err(HostError::ProcessBusy { .. } | HostError::FifoFull { .. } | HostError::TooLong { .. }) => {}
            Err(error) => assert_eq!(self.host.state(), HostState::Stopped(error)),
        }
    }

    /// The driver goes on by one exchange or one wait.
    fn turn(&mut self, step: &[u8]) {
        let packet = match self.host.next(self.now) {
            Ok(Next::Exchange(packet)) => packet.to_vec(),
            Ok(Next::WaitUntil(time)) => {
                assert!(time > self.now, "a wait that is over");
                self.now = time;
                return;
            }
            Ok(Next::WaitForReady { until }) => {
                assert!(until > self.now, "a wait that is over");
                if step[2] & 0x80 == 0 {
                    self.host.ready(self.now);
                } else {
                    self.now = until;
                }
                return;
            }
            Err(error) => {
                assert_eq!(self.host.state(), HostState::Stopped(error));
                assert!(!error.to_string().is_empty());
                return;
            }
        };
        assert!((1..=MAX_PACKET).contains(&packet.len()));
        if self.host.state() == HostState::Running {
            assert_eq!(packet.len(), self.host.size().packet_len(), "whole packets");
        }
        self.sent.swap(0, 1);
        self.sent[1] = packet;
        let back = self.back(step);
        self.now += EXCHANGE_NS;
        self.host.received(self.now, &back);
        self.take();
    }

    /// What the chip answers.
    fn back(&mut self, step: &[u8]) -> Vec<u8> {
        if step[2] & 0x40 != 0 {
            self.size = DataSize::new(32 + usize::from(step[3])).expect("32 to 287");
        }
        let to = &self.sent[usize::from(step[2] & 1)];
        let mut header = [0; 24];
        header[4..][..8].copy_from_slice(&step[4..]);
        let mut header = AnswerHeader::decode(&header).1;
        if to.len() > 24 {
            (header.index, header.code) = (to[11], CommandCode::from_code(to[12]));
        }
        let kind = if step[2] & 2 == 0 { CheckType::Crc32 } else { CheckType::Fixed };
        header.status = Status(step[10]).with_check_type(kind);
        let data = [step[9]; 12];
        let data = &data[..usize::from(step[11] % 13)];
        let mut buffer = [0; MAX_PACKET];
        let rule = CheckRule { kind, ..CheckRule::FIXED };
        let answer = match step[2] >> 2 & 15 {
            0 => return Vec::new(),
            1 => write_not_ready(&mut buffer, self.size, header),
            2 => return step.iter().copied().cycle().take(self.sent[1].len()).collect(),
            _ if header.code == CommandCode::SpiPackSizeGet => {
                write_answer(&mut buffer, self.size, rule, header, &self.size)
            }
            _ => write_answer(&mut buffer, self.size, rule, header, &data),
        };
        let mut answer = answer.expect("it fits").to_vec();
        if step[2] >> 2 & 15 == 3 {
            let at = usize::from(step[3]) % answer.len();
            answer[at] ^= 1 << (step[1] % 8);
        }
        // As many as went out; the rest of a packet is lost.
        answer.resize(self.sent[1].len(), 0);
        answer
    }

    fn take(&mut self) {
        while let Some(report) = self.host.take_report() {
            assert!(self.reports > 0 && report.sequence <= self.sequence, "a report of nothing: {report:?}");
            self.reports -= 1;
        }
        let host = &mut self.host;
        self.tickets.retain(|ticket| {
            if !host.is_done(*ticket) {
                return true;
            }
            let taken = host.take(*ticket, &SlaveCountGet).or(Some(Ok(0)));
            if let Some(Err(HostError::OtherCommand { .. })) = taken {
                let _ = host.take(*ticket, &SdoGet);
                let _ = host.take(*ticket, &WarmReset);
                let _ = host.take(*ticket, &Mdio::Read { phy: 1, register: 2 });
                let write = SdoOperation::Write(&[]);
                let _ = host.take(*ticket, &sdo_of(write));
            }
            false
        });
    }

    /// Nothing comes back any more: all ends.
    fn end(&mut self) {
        let end = self.now + END_NS;
        while !self.tickets.is_empty() || self.reports > 0 {
            assert!(self.now < end, "{} commands and {} reports do not end", self.tickets.len(), self.reports);
            self.turn(&[15, 0, 0x80, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
            if let HostState::Stopped(_) = self.host.state() {
                self.take();
                assert!(self.tickets.is_empty() && self.reports == 0, "a driver that has stopped has ended all");
            }
        }
    }
}

fn sdo_of(operation: SdoOperation<'_>) -> SdoRequest<'_> {
    SdoRequest {
        slave: SlaveNumber::new(1).expect("1"),
        object: ecmsk::coe::ObjectAddress::new(0x6040, 0),
        scope: ecmsk::coe::SdoScope::Entry,
        timeout_us: 1000,
        operation,
    }
}

//! The model of the chip, against the manuals: every command with its effect and its errors.
//!
//! - `exchanges.rs`: packets, answers, errors, check words, sizes, resets, the stream of bytes
//! - `fifos.rs`, `units.rs`: process data and GPIOs in single packets
//! - `application.rs`: allocations of an exchange, random bytes
//!
//! `pair/` shows the effects of commands with the driver; these files show what a driver does not show.

mod application;
mod exchanges;
mod fifos;
mod units;

use ecmsk::ethercat::Ns;
use ecmsk::slave::Slave;
use ecmsk::xf::chip::{Chip, ChipTiming, Profile, SlaveModels};
use ecmsk::xf::request::{Call, CrcTypeSet, Encode, InfoUpdate, Reconfig};
use ecmsk::xf::response::Returned;
use ecmsk::xf::{
    AnswerHeader, AnswerPacket, CheckRule, CheckType, CommandHeader, CrcCoverage, Errors, EtherCatState, MAX_PACKET,
    NOT_READY, Received, Status, write_request,
};

use crate::network::{INIT, drives_and_io, to_all};

const MS: Ns = 1_000_000;
/// The time between two exchanges: more than the chip needs for a packet, and less than its cycle of 1 ms.
const PACE: Ns = 250_000;

/// A host with its chip.
struct Host {
    chip: Chip<SlaveModels>,
    now: Ns,
    /// The index of the last packet.
    index: u8,
    rule: CheckRule,
    pace: Ns,
}

/// An answer as it was received.
#[derive(Clone, Debug, PartialEq)]
struct Got {
    header: AnswerHeader,
    /// The whole data segment.
    data: Vec<u8>,
}

impl Got {
    /// The result for that request.
    fn to<'a, C: Call<'a>>(&'a self, request: &C) -> C::Answer<'a> {
        assert!(!self.header.status.contains(Status::NOP), "a NOP answer: {:?}", self.header);
        assert_eq!(self.header.code, C::CODE);
        let AnswerHeader { ret, len, .. } = self.header;
        request.answer(Returned { ret, len }, &self.data).expect("an answer as the manual has it")
    }

    fn valid(&self) -> &[u8] {
        &self.data[..self.header.len.into()]
    }

    fn has(&self, status: Status) -> bool {
        self.header.status.contains(status)
    }

    /// The error bits, without the levels beside them.
    fn errors(&self) -> Errors {
        Errors(self.header.errors.0 & Errors::ALL.0)
    }
}

impl Host {
    /// A host whose chip has started, a second ago.
    fn new(profile: Profile, slaves: Vec<Box<dyn Slave>>) -> Self {
        let mut chip = Chip::with_timing(profile, ChipTiming::default(), SlaveModels::new(slaves));
        chip.run_until(1000 * MS);
        Self { chip, now: 1000 * MS, index: 0, rule: CheckRule::FIXED, pace: PACE }
    }

    /// With two servo drives and an IO module.
    fn with_drives() -> Self {
        Self::new(Profile::NEW, drives_and_io())
    }

    /// The same network, initialised, in a state.
    fn in_state(state: EtherCatState) -> Self {
        let mut host = Self::with_drives();
        host.bring_to(state);
        host
    }

    /// Initialises the network, brings it to a state, and lays out its process data.
    fn bring_to(&mut self, state: EtherCatState) {
        self.run(&INIT);
        if state == EtherCatState::Init {
            return;
        }
        self.run(&to_all(EtherCatState::PreOp));
        if state == EtherCatState::PreOp {
            return;
        }
        self.run(&Reconfig);
        self.run(&to_all(state));
    }

    /// The bytes of a command packet.
    fn packet(&self, header: CommandHeader, request: &impl Encode) -> Vec<u8> {
        let mut buffer = [0xA5; MAX_PACKET];
        write_request(&mut buffer, self.chip.size(), self.rule, header, request).expect("it fits").to_vec()
    }

    /// Exchanges bytes, a while after the last ones.
    fn exchange_bytes(&mut self, bytes: &[u8]) -> Vec<u8> {
        self.now += self.pace;
        let mut answer = vec![0xA5; self.chip.size().packet_len()];
        self.chip.exchange(self.now, bytes, &mut answer);
        answer
    }

    /// Sends a request with that header, and returns the answer to the packet before.
    fn send_with(&mut self, header: CommandHeader, request: &impl Encode) -> Got {
        let bytes = self.packet(header, request);
        let size = self.chip.size();
        let answer = self.exchange_bytes(&bytes);
        match AnswerPacket::parse(&answer, size, CrcCoverage::All).expect("an answer packet") {
            Received::Answer(packet) => Got { header: packet.header, data: packet.data.to_vec() },
            Received::NotReady => panic!("the chip is not ready"),
        }
    }

    /// Sends a request with a new index, and returns the answer to the packet before.
    fn send(&mut self, request: &impl Encode) -> Got {
        self.index = self.index.wrapping_add(1);
        self.send_with(CommandHeader::with_index(self.index), request)
    }

    /// Sends a request, and returns the answer to it.
    fn call(&mut self, request: &impl Encode) -> Got {
        self.send(request);
        let index = self.index;
        let got = self.send(&InfoUpdate);
        assert_eq!(got.header.index, index);
        got
    }

    /// Sets the check words to CRC-32 from the next packet on.
    fn use_crc(&mut self) {
        self.send(&CrcTypeSet { kind: CheckType::Crc32 });
        self.rule = CheckRule::CRC32;
    }

    /// Polls until no command runs any more.
    fn wait(&mut self) -> Got {
        for _ in 0..100_000 {
            let got = self.call(&InfoUpdate);
            if !got.has(Status::BUSY) {
                return got;
            }
        }
        panic!("the command does not end");
    }

    /// Runs a request that may take time to its end; returns the last answer.
    fn end(&mut self, request: &impl Encode) -> Got {
        let got = self.call(request);
        if got.has(Status::BUSY) { self.wait() } else { got }
    }

    /// The same, and nothing may fail.
    fn run(&mut self, request: &impl Encode) {
        let got = self.end(request);
        assert_eq!(got.errors(), Errors::NONE);
    }

    /// Lets time pass without a packet.
    fn pass(&mut self, ns: Ns) {
        self.now += ns;
        self.chip.run_until(self.now);
    }
}

/// The check word of a packet.
fn check_word(packet: &[u8]) -> u32 {
    let end = packet.len() - 8;
    u32::from_le_bytes([packet[end], packet[end + 1], packet[end + 2], packet[end + 3]])
}

fn is_not_ready(packet: &[u8]) -> bool {
    check_word(packet) == NOT_READY
}

//! The driver over a pipe in this process, and the bare loop beside it.

use std::convert::Infallible;
use std::hint::black_box;

use ecmsk::xf::chip::{Chip, ChipPort, Profile, SlaveModels};
use ecmsk::xf::host::{Host, HostConfig, HostError, HostState, ProcessKind, ProcessOutcome, Wires};
use ecmsk::xf::request::{PdoDataFifo, PdoOperation};
use ecmsk::xf::response::PdoExchange;
use ecmsk::xf::{
    AnswerHeader, CheckRule, CommandCode, CommandHeader, DataSize, HEADER_LEN, MAX_PACKET, Status, TRAILER_LEN,
    write_answer, write_request,
};

/// Where the index stands in a header.
const INDEX: usize = 0x0B;
/// How long an exchange takes.
const EXCHANGE_NS: u64 = 480_000;

/// What is done with each packet.
const OPERATION: PdoOperation = PdoOperation(PdoOperation::WRITE.0 | PdoOperation::READ.0);

/// What a chip answers to process data with each index: the first time, and when it has taken them already.
struct Answers {
    results: Vec<Vec<u8>>,
    nops: Vec<Vec<u8>>,
}

impl Answers {
    fn new(size: DataSize) -> Self {
        let inputs = vec![0x5A; size.bytes()];
        let all = |status, result: PdoExchange<'_>| {
            let answer = |index| {
                let code = CommandCode::PdoDataFifo;
                let header = AnswerHeader { index, code, status, ..AnswerHeader::default() };
                let mut buffer = [0; MAX_PACKET];
                write_answer(&mut buffer, size, CheckRule::CRC32, header, &result).expect("it fits").to_vec()
            };
            (0..=u8::MAX).map(answer).collect()
        };
        Self {
            results: all(Status::FIFO_ON, PdoExchange { done: OPERATION, data: &inputs }),
            nops: all(Status::FIFO_ON | Status::NOP, PdoExchange { done: PdoOperation::NONE, data: &[] }),
        }
    }
}

/// The end of the pipe that a chip is at: it keeps a packet, and gives the answer to the one before.
struct Pipe {
    answers: Answers,
    kept: [u8; MAX_PACKET],
    previous: u8,
    is_repeated: bool,
}

impl Pipe {
    fn new(size: DataSize) -> Self {
        Self { answers: Answers::new(size), kept: [0; MAX_PACKET], previous: 0, is_repeated: false }
    }

    fn exchange(&mut self, to_chip: &[u8], from_chip: &mut [u8]) {
        self.kept[..to_chip.len()].copy_from_slice(to_chip);
        black_box(&self.kept);
        let answers = if self.is_repeated { &self.answers.nops } else { &self.answers.results };
        from_chip.copy_from_slice(&answers[usize::from(self.previous)]);
        self.is_repeated = to_chip[INDEX] == self.previous;
        self.previous = to_chip[INDEX];
    }
}

/// What the wires of the driver lead to.
struct Line {
    /// The model of a chip, with which the driver starts.
    chip: Option<ChipPort<SlaveModels>>,
    pipe: Pipe,
    now: u64,
}

impl Wires for Line {
    type Error = Infallible;

    fn now(&self) -> u64 {
        self.now
    }

    fn exchange(&mut self, to_chip: &[u8], from_chip: &mut [u8]) -> Result<(), Infallible> {
        self.now += EXCHANGE_NS;
        match &mut self.chip {
            Some(chip) => {
                chip.transfer(self.now, to_chip, from_chip);
            }
            None => self.pipe.exchange(to_chip, from_chip),
        }
        Ok(())
    }

    fn wait_until(&mut self, time: u64) -> Result<(), Infallible> {
        self.now = self.now.max(time);
        Ok(())
    }

    fn wait_ready(&mut self, _: u64) -> Result<bool, Infallible> {
        Ok(false)
    }
}

/// The program: what it puts into each packet.
struct Program {
    outputs: Vec<u8>,
}

impl Program {
    fn new(size: DataSize) -> Self {
        Self { outputs: vec![0xA5; size.bytes()] }
    }

    fn put_outputs(&self, place: &mut [u8]) {
        place.copy_from_slice(black_box(&self.outputs));
    }
}

/// The driver with a program that has process data for each exchange.
pub struct Driver {
    host: Host,
    line: Line,
    program: Program,
}

impl Driver {
    /// A driver that has started.
    pub fn running(size: DataSize) -> Self {
        let chip = Chip::new(Profile { size, ..Profile::NEW }, SlaveModels::new(Vec::new()));
        let config = HostConfig { size: Some(size), pipelined_writes: true, ..HostConfig::DEFAULT };
        let mut driver = Self {
            host: Host::new(0, config),
            line: Line { chip: Some(ChipPort::new(chip)), pipe: Pipe::new(size), now: 0 },
            program: Program::new(size),
        };
        while driver.host.state() != HostState::Running {
            driver.step();
        }
        driver.line.chip = None;
        driver
    }

    fn step(&mut self) {
        self.host.step(&mut self.line, u64::MAX).expect("nothing goes wrong");
    }

    /// One exchange, the idle time before it and new process data for it; time passes at once.
    pub fn exchange(&mut self) {
        let (kind, len) = (ProcessKind::Exchange { count: 1 }, self.program.outputs.len());
        match self.host.process_in_place(kind, len, |place| self.program.put_outputs(place)) {
            // Behind the start, which has none, process data are sent twice.
            Ok(_) | Err(HostError::ProcessBusy { .. }) => {}
            Err(error) => panic!("{error}"),
        }
        let before = self.host.counters().exchanges;
        while self.host.counters().exchanges == before {
            self.step();
        }
        while let Some(report) = self.host.take_report() {
            assert_eq!(report.outcome, ProcessOutcome::Done { read: true });
        }
        black_box(self.host.inputs());
    }

    /// Each exchange had process data of its own, and an answer.
    pub fn assert_well(&self) {
        let counters = self.host.counters();
        assert!(counters.rx_written > 10_000, "{counters:?}");
        assert!(counters.exchanges - counters.rx_written < counters.exchanges / 100, "{counters:?}");
        assert_eq!((counters.damaged, counters.rx_unknown), (0, 0), "{counters:?}");
    }
}

/// A loop with the same program that copies the packets and computes their check words.
pub struct PlainLoop {
    program: Program,
    pipe: Pipe,
    command: Vec<u8>,
    back: [u8; MAX_PACKET],
}

impl PlainLoop {
    pub fn new(size: DataSize) -> Self {
        let program = Program::new(size);
        let request = PdoDataFifo { count: 1, operation: OPERATION, data: &program.outputs };
        let mut buffer = [0; MAX_PACKET];
        let header = CommandHeader::default();
        let command = write_request(&mut buffer, size, CheckRule::CRC32, header, &request).expect("it fits").to_vec();
        Self { program, pipe: Pipe::new(size), command, back: [0; MAX_PACKET] }
    }

    pub fn exchange(&mut self) {
        let checked = self.command.len() - TRAILER_LEN;
        let (covered, word) = self.command.split_at_mut(checked);
        self.program.put_outputs(&mut covered[HEADER_LEN..]);
        covered[INDEX] = covered[INDEX].wrapping_add(1);
        word[..4].copy_from_slice(&crc32fast::hash(covered).to_le_bytes());
        let back = &mut self.back[..self.command.len()];
        self.pipe.exchange(&self.command, back);
        let (covered, word) = back.split_at(checked);
        assert_eq!(word[..4], crc32fast::hash(covered).to_le_bytes(), "what came back is right");
        black_box(&self.back);
    }
}

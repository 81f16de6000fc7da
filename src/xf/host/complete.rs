//! Ends a packet in flight: passes its answer, or the loss of its answer, to the command, to the process data, or to
//! the step of the chip's start for which it was sent.

use super::flight::{AnswerMatch, CommandPart, Flight, Purpose};
use super::process::{NOT_TAKEN, Overtaken, ProcessOutcome};
use super::received::running_since;
use super::slots::{SlotState, has_result, only_reads};
use super::{Host, HostError, HostState, StartStep};
use crate::ethercat::Ns;
use crate::ethercat::coe::AbortCode;
use crate::xf::request::{CrcTypeSet, FirmwareVersionGet, PdoOperation, SpiPackSizeGet};
use crate::xf::response::Returned;
use crate::xf::{AnswerHeader, AnswerPacket, CheckRule, CheckType, CommandCode, DataSize, Errors, Status};

impl Host {
    /// Ends the packet `flight`: its answer has come, or the answer is lost and `header` shows that the command ran.
    pub(super) fn complete(&mut self, now: Ns, flight: &Flight, matched: AnswerMatch, header: &AnswerHeader) {
        let lost = matched == AnswerMatch::Lost;
        match flight.purpose {
            Purpose::Start(step) if !lost => self.started(now, step, header),
            // Nothing to do: a step of the chip's start whose answer is lost is repeated.
            Purpose::Start(_) => {}
            // An answered INFO_UPDATE counts as an attempt to clear errors if the errors are still there.
            Purpose::Info => self.clear_tries += u32::from(self.cleared.intersects(header.errors)),
            Purpose::Slot(slot, part) => self.complete_slot(now, slot, part, lost, header),
            Purpose::Process { sequence, written, reads, clears, others, .. } => {
                self.complete_overtaken_by(flight, header);
                if lost && written > 0 && self.is_doubtful(clears, others, header) {
                    self.complete_unknown(sequence, written);
                } else {
                    self.complete_process(sequence, flight.code, written, reads, lost, header);
                }
            }
        }
    }

    /// Evaluates the answer to a step of the chip's start.
    fn started(&mut self, now: Ns, step: StartStep, header: &AnswerHeader) {
        let answer = AnswerPacket { header: *header, data: self.receive_buffer.data(self.size) };
        let next = match step {
            StartStep::PackSize => match answer.answer_to(&SpiPackSizeGet) {
                Ok(size) if size != self.size => {
                    self.stop(HostError::DataSizeMismatch { expected: self.size, found: size });
                    return;
                }
                Ok(size) if self.config.wanted_size.is_some_and(|wanted| wanted != size) => Some(StartStep::Resize),
                Ok(_) if self.rule.kind == CheckType::Crc32 && self.coverages.is_open() => Some(StartStep::Coverage),
                Ok(_) => step.next(),
                Err(_) => return,
            },
            StartStep::FixedWord => {
                if answer.header.status.check_type() != Ok(CheckType::Fixed) {
                    return;
                }
                step.next()
            }
            StartStep::CheckType => {
                if answer.answer_to(&CrcTypeSet { kind: CheckType::Crc32 }).is_err()
                    || answer.header.status.check_type() != Ok(CheckType::Crc32)
                {
                    return;
                }
                self.rule = CheckRule { kind: CheckType::Crc32, coverage: self.coverages.of_commands() };
                self.crc_on = true;
                self.gave_crc_up = false;
                step.next()
            }
            StartStep::Version => {
                self.version = answer.answer_to(&FirmwareVersionGet).ok();
                if self.version.is_none() {
                    return;
                }
                step.next()
            }
            StartStep::NotBusy if self.busy => return,
            StartStep::NotBusy if self.config.keep_fifo => None,
            _ => step.next(),
        };
        self.completed_at = now;
        self.state = next.map_or(HostState::Running, HostState::Starting);
    }

    fn complete_slot(&mut self, now: Ns, slot: usize, part: CommandPart, lost: bool, header: &AnswerHeader) {
        let data = self.receive_buffer.data(self.size);
        let refused = header.errors.without(self.stuck).contains(Errors::COMMAND);
        let this = &mut self.slots.all[slot];
        let (code, arguments) = (this.code, this.arguments);
        let immediate = code.is_immediate(arguments.parameter);
        this.state = match part {
            CommandPart::AbortCode if lost => SlotState::Waiting(CommandPart::AbortCode),
            CommandPart::AbortCode => {
                let word = data.first_chunk::<4>().filter(|_| header.len >= 4 && !refused);
                let abort = word.map(|word| AbortCode(u32::from_le_bytes(*word)));
                SlotState::Done(Err(HostError::Failed { code, abort, waited_ns: this.failed_after }))
            }
            CommandPart::Read | CommandPart::Request if refused => {
                let code = if part == CommandPart::Read { this.answering() } else { code };
                SlotState::Done(Err(HostError::Refused { code }))
            }
            CommandPart::Request if !immediate => {
                self.accepted = self.exchange;
                self.busy = true;
                SlotState::Running(now)
            }
            CommandPart::Read if lost => SlotState::Waiting(CommandPart::Read),
            CommandPart::Request if lost && only_reads(code, &arguments) => SlotState::Waiting(CommandPart::Request),
            CommandPart::Request if lost => {
                (this.returned, this.held) = (Returned::NONE, 0);
                let has_result = has_result(code, &arguments);
                SlotState::Done(if has_result { Err(HostError::AnswerLost { code }) } else { Ok(()) })
            }
            CommandPart::Read | CommandPart::Request => {
                this.keep(header, data);
                SlotState::Done(Ok(()))
            }
        };
        match this.state {
            SlotState::Waiting(_) => self.counters.asked_again += 1,
            _ => self.counters.answers_lost += u64::from(lost),
        }
        if this.state == SlotState::Done(Ok(())) && part == CommandPart::Request {
            self.learn(code, arguments.parameter, header.ret, lost);
        }
    }

    /// Updates the RxFIFO estimate from a command that has run.
    fn learn(&mut self, code: CommandCode, parameter: u8, ret: u8, lost: bool) {
        match code {
            CommandCode::FifoSetRxCount => self.rx_estimate.entries = parameter,
            CommandCode::FifoGetRxCount if !lost => self.rx_estimate.entries = ret,
            CommandCode::FifoClear if parameter != 1 => self.rx_estimate.cleared(),
            _ => {}
        }
    }

    /// Checks whether the non-immediate command has ended. It has ended if a packet was sent after the command had been
    /// accepted, and the busy flag in the answer to that packet is clear.
    pub(super) fn look_for_end(&mut self, now: Ns, flight: &Flight, header: &AnswerHeader) {
        let Some((slot, since)) = running_since(&self.slots) else { return };
        if flight.first <= self.accepted || header.status.contains(Status::BUSY) {
            return;
        }
        let failed = header.errors.without(self.stuck).contains(Errors::NON_IMMEDIATE);
        let this = &mut self.slots.all[slot];
        (this.returned, this.held) = (Returned::NONE, 0);
        this.failed_after = now.saturating_sub(since);
        this.submitted = now;
        let code = this.code;
        this.state = match this.read {
            _ if failed && code == CommandCode::SdoRequest => SlotState::Waiting(CommandPart::AbortCode),
            _ if failed => SlotState::Done(Err(HostError::Failed { code, abort: None, waited_ns: this.failed_after })),
            Some(_) => SlotState::Waiting(CommandPart::Read),
            None => SlotState::Done(Ok(())),
        };
    }

    fn complete_process(
        &mut self,
        sequence: u32,
        code: CommandCode,
        written: u8,
        reads: bool,
        lost: bool,
        header: &AnswerHeader,
    ) {
        let errors = header.errors.without(self.stuck);
        let pdos = u64::from(written);
        let done = PdoOperation(header.ret);
        let fifo = code == CommandCode::PdoDataFifo;
        // No manual says what the return byte of command 6 (PDO_DATA_OP) means. So the length of the answer's data
        // shows whether the command did anything: it is 0 if the chip refused the command.
        let refusable = if fifo {
            !done.contains(PdoOperation::WRITE) && !done.contains(PdoOperation::READ)
        } else {
            header.len == 0
        };
        let nothing = lost || refusable;
        let outcome = if nothing && errors.contains(Errors::COMMAND) {
            ProcessOutcome::Refused
        } else if lost && fifo && written > 0 && errors.contains(Errors::FIFO) {
            ProcessOutcome::Full
        } else if lost {
            ProcessOutcome::AnswerLost
        } else if done.contains(PdoOperation::FAILED) || fifo && written > 0 && !done.contains(PdoOperation::WRITE) {
            ProcessOutcome::Full
        } else {
            let read = reads && if fifo { done.contains(PdoOperation::READ) } else { header.len > 0 };
            ProcessOutcome::Done { read }
        };
        match outcome {
            ProcessOutcome::Done { read } => {
                self.counters.rx_written += pdos;
                if read {
                    let data = self.receive_buffer.data(self.size);
                    self.receive_buffer.keep_inputs(data.len().min(header.len.into()));
                }
            }
            ProcessOutcome::AnswerLost => {
                self.counters.rx_written += pdos;
                self.counters.answers_lost += 1;
                self.counters.tx_lost += u64::from(reads);
            }
            _ => {
                self.counters.rx_full += if outcome == ProcessOutcome::Full { pdos } else { 0 };
                self.rx_estimate.not_written(sequence);
            }
        }
        self.report(sequence, outcome);
    }

    /// Whether it is unknown if the chip took the RxPDOs of a packet whose answer is lost. The error bits [`NOT_TAKEN`]
    /// show it only if no copy of the packet clears them and no other packet can have set them.
    fn is_doubtful(&self, clears: bool, others: bool, header: &AnswerHeader) -> bool {
        let others = others || self.stuck.intersects(NOT_TAKEN);
        clears || others && header.errors.intersects(NOT_TAKEN)
    }

    /// Reports that it is unknown whether RxPDOs were written.
    pub(super) fn complete_unknown(&mut self, sequence: u32, written: u8) {
        self.counters.rx_unknown += u64::from(written);
        self.report(sequence, ProcessOutcome::Unknown);
    }

    /// Completes the overtaken process data, whose answer had not come yet when the next process data were sent, if
    /// `header` is the header of that answer. If `header` is `None`, the answer cannot come any more, and the outcome
    /// is unknown. Returns whether `header` belongs to the answer.
    pub(super) fn complete_overtaken(&mut self, header: Option<&AnswerHeader>) -> bool {
        let Some(overtaken) = self.process.overtaken else { return false };
        let Overtaken { sequence, index, code, written, reads, .. } = overtaken;
        match header {
            Some(header) if header.index == index && header.code == code => {
                self.process.overtaken = None;
                self.complete_process(sequence, code, written, reads, false, header);
                true
            }
            Some(_) => false,
            None => {
                self.process.overtaken = None;
                self.complete_unknown(sequence, written);
                false
            }
        }
    }

    /// Completes the overtaken process data, whose own answer is missing although the answer to the next ones
    /// (`flight`) has come. If an error bit of [`NOT_TAKEN`] is set, their outcome is unknown. Otherwise the number of
    /// packets that the chip has rejected since the next process data were sent decides.
    ///
    /// If the chip has rejected no packet, the overtaken process data were written. Copies of `flight` may have been
    /// rejected too, except two: the one that ran, and the newest one, which the chip's count does not include yet. If
    /// more packets were rejected than there are other copies, the overtaken process data were rejected. If not, their
    /// outcome is unknown.
    fn complete_overtaken_by(&mut self, flight: &Flight, header: &AnswerHeader) {
        let Some(overtaken) = self.process.overtaken.take() else { return };
        let Overtaken { sequence, written, reads, rejections, unclear, .. } = overtaken;
        let rejected = self.rejections - rejections;
        let others = u64::from(flight.copies.saturating_sub(2));
        let pdos = u64::from(written);
        let unclear = unclear || header.errors.intersects(NOT_TAKEN);
        let outcome = if rejected == 0 && !unclear {
            self.counters.rx_written += pdos;
            self.counters.answers_lost += 1;
            self.counters.tx_lost += u64::from(reads);
            ProcessOutcome::AnswerLost
        } else if rejected > others && !unclear {
            self.counters.rx_dropped += pdos;
            self.rx_estimate.not_written(sequence);
            ProcessOutcome::NotWritten
        } else {
            self.counters.rx_unknown += pdos;
            ProcessOutcome::Unknown
        };
        self.report(sequence, outcome);
    }
}

const _: () = assert!(DataSize::MIN.bytes() >= 20, "the longest answer of the start fits into the least packet");

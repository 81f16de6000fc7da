//! Chooses what the driver sends next: a command, process data, INFO_UPDATE (which only fetches an answer header, with the
//! chip's busy flag, error bits and FIFO levels), or nothing yet.

use super::flight::{CommandPart, Flight, Purpose};
use super::pace::ExchangePace;
use super::process::{NOT_TAKEN, OutgoingProcessData, Overtaken, ProcessOutcome, ProcessReport};
use super::search::Search;
use super::slots::SlotState;
use super::{Host, HostError, HostState, Next, PendingExchange, StartStep};
use crate::ethercat::Ns;
use crate::xf::packet::write_around;
use crate::xf::request::{Arguments, InfoUpdate};
use crate::xf::{CommandCode, CommandHeader, Control, Errors, Request, Reserve, WriteError, write_request};

/// After this many attempts to clear an error bit, its error counts as permanent. The bit is then ignored until it
/// disappears.
const CLEAR_TRIES: u32 = 3;

/// The next action, like [`Next`] but without the bytes.
pub(super) enum ExchangePlan {
    Exchange(PendingExchange),
    WaitUntil(Ns),
    WaitForReady { until: Ns },
}

/// The content of the next exchange, or the time until which there is none.
enum Choice {
    Filler,
    /// A packet, which is in `packets[current]`.
    Packet,
    Nothing {
        until: Ns,
    },
}

impl Host {
    /// Returns the next action. This may be called at any time; the result is valid until something is submitted or
    /// received. An exchange whose end was not reported counts as failed.
    ///
    /// # Errors
    /// The reason why the driver has stopped.
    pub fn next(&mut self, now: Ns) -> Result<Next<'_>, HostError> {
        Ok(match self.plan(now)? {
            ExchangePlan::Exchange(PendingExchange::Filler) => Next::Exchange(self.search.filler()),
            ExchangePlan::Exchange(PendingExchange::Packet) => {
                Next::Exchange(&self.packets[self.current][..self.size.packet_len()])
            }
            ExchangePlan::WaitUntil(time) => Next::WaitUntil(time),
            ExchangePlan::WaitForReady { until } => Next::WaitForReady { until },
        })
    }

    /// The result of [`Self::next`], without the bytes.
    pub(super) fn plan(&mut self, now: Ns) -> Result<ExchangePlan, HostError> {
        if self.pending_exchange.is_some() {
            self.came(now, 0);
        }
        self.expire(now);
        self.running_or_error()?;
        match self.pacer.pace(now, &self.config) {
            ExchangePace::Go => {}
            ExchangePace::Until(until) => return Ok(ExchangePlan::WaitUntil(until)),
            ExchangePace::Int0(until) => return Ok(ExchangePlan::WaitForReady { until }),
            ExchangePace::Missed => {
                self.counters.int0_missed += 1;
                if self.pacer.misses >= self.config.int0_misses && self.bad_in_row > 0 {
                    // A chip that was reset and now has another data segment size waits for the rest of a packet, so
                    // INT0 stays inactive.
                    self.pacer.misses = 0;
                    self.search_anew(now);
                } else if self.pacer.misses >= self.config.int0_misses {
                    let waited_ns = self.config.timeouts.int0_ns;
                    self.stop(HostError::Int0Missing { waited_ns, times: self.pacer.misses });
                }
                self.running_or_error()?;
            }
        }
        let what = match self.choose(now) {
            Choice::Filler => PendingExchange::Filler,
            Choice::Packet => PendingExchange::Packet,
            Choice::Nothing { until } => return Ok(ExchangePlan::WaitUntil(until)),
        };
        self.begin(what);
        Ok(ExchangePlan::Exchange(what))
    }

    pub(super) fn running_or_error(&self) -> Result<(), HostError> {
        match self.state {
            HostState::Stopped(error) => Err(error),
            _ => Ok(()),
        }
    }

    fn begin(&mut self, what: PendingExchange) {
        self.pending_exchange = Some(what);
        self.ready_seen = false;
        self.in_step = false;
        self.pacer.began();
    }

    /// Stops the driver: all pending commands end with this error.
    pub(super) fn stop(&mut self, error: HostError) {
        self.slots.fail_all(error);
        self.forget_all();
        self.state = HostState::Stopped(error);
    }

    /// Begins a search for packets, because too many answers in a row were damaged. A start that is not complete begins
    /// again.
    pub(super) fn search_anew(&mut self, now: Ns) {
        let running = self.state == HostState::Running;
        let state = if running { HostState::Searching } else { HostState::Starting(StartStep::Search) };
        self.begin_search(now, state);
    }

    /// Begins a search for packets; `state` is the driver's state meanwhile.
    pub(super) fn begin_search(&mut self, now: Ns, state: HostState) {
        self.search = Search::new(now);
        if let Some(overtaken) = &mut self.process.overtaken {
            // The chip also counts the bytes sent during the search as rejected packets. So its error count no longer
            // shows whether it rejected the overtaken process data.
            overtaken.unclear = true;
        }
        self.counters.searches += 1;
        self.bad_in_row = 0;
        self.state = state;
    }

    /// Ends everything whose timeout has passed: the start, queued commands, the packet in flight.
    fn expire(&mut self, now: Ns) {
        if let HostState::Starting(step) = self.state {
            let waited_ns = now.saturating_sub(self.started);
            if waited_ns >= self.config.timeouts.start_ns {
                self.stop(HostError::StartTooLong { step, waited_ns, last: self.last_error });
                return;
            }
        }
        self.slots.expire(now, self.config.timeouts.queue_ns);
        let searching = matches!(self.state, HostState::Searching | HostState::Starting(StartStep::Search));
        let Some(flight) = self.flight.filter(|flight| flight.is_expired(now) && !searching) else { return };
        self.flight = None;
        self.completed_at = now;
        if self.state == HostState::Running && self.answered < flight.first {
            // The packet got no answer but "not ready", which may be due to a wrong data segment size n. After a reset
            // from n = 1408 to n = 112, ten packets of the chip are exactly as long as one packet of the assumed size.
            // So the end word of the tenth packet is at the expected position, and the answer does not look damaged.
            self.begin_search(now, HostState::Searching);
        }
        match flight.purpose {
            Purpose::Start(_) => self.begin_search(now, HostState::Starting(StartStep::Search)),
            Purpose::Info => {}
            Purpose::Slot(slot, _) => {
                let Flight { code, index, copies, since, .. } = flight;
                let waited_ns = now.saturating_sub(since);
                let error = HostError::NoAnswer { code, index, copies, waited_ns, last: self.last_error };
                self.slots.all[slot].state = SlotState::Done(Err(error));
                // The command may be running although its answer is missing.
                self.busy |= !code.is_immediate(self.slots.all[slot].arguments.parameter);
            }
            Purpose::Process { sequence, written, .. } => {
                self.complete_overtaken(None);
                self.complete_unknown(sequence, written);
            }
        }
    }

    pub(super) fn report(&mut self, sequence: u32, outcome: ProcessOutcome) {
        let lost = self.process.report(ProcessReport { sequence, outcome });
        self.counters.reports_overwritten += u64::from(lost);
    }

    fn choose(&mut self, now: Ns) -> Choice {
        match self.state {
            HostState::Searching | HostState::Starting(StartStep::Search) | HostState::Stopped(_) => Choice::Filler,
            _ if self.flight.is_some() => self.go_on(now),
            HostState::Starting(step) => self.start(now, step),
            HostState::Running => self.run(now),
        }
    }

    /// Sends the packet in flight again or, with pipelined writes, the next process data.
    fn go_on(&mut self, now: Ns) -> Choice {
        if let Some(overtaken) = self.may_be_overtaken() {
            self.process.overtaken = Some(overtaken);
            self.flight = None;
            return self.send_process(now);
        }
        let exchange = self.exchange + 1;
        if let Some(flight) = &mut self.flight {
            self.exchange = exchange;
            flight.copies += 1;
            self.sent = [self.sent[1], (flight.index, flight.code, flight.copies)];
            // The second copy is no retry: it fetches the answer to the first copy.
            self.counters.repeated += u64::from(flight.copies > 2);
            if let Purpose::Process { sequence, queued, .. } = flight.purpose {
                self.rx_estimate.wrote(sequence, queued, exchange);
            }
        }
        Choice::Packet
    }

    /// The process data in flight, if the next ones may be sent before their answer has come. The conditions: the chip was
    /// ready for them, all earlier rejections are counted, and no command is waiting.
    fn may_be_overtaken(&self) -> Option<Overtaken> {
        let flight = self.flight.as_ref()?;
        let Purpose::Process { sequence, written, reads, .. } = flight.purpose else { return None };
        let clean = flight.copies == 1 && self.in_step && self.process.overtaken.is_none();
        let alone = self.process.waiting().is_some() && self.waiting_command().is_none();
        let (index, code, rejections) = (flight.index, flight.code, self.rejections);
        (self.config.pipelined_writes && clean && alone).then_some(Overtaken {
            sequence,
            index,
            code,
            written,
            reads,
            rejections,
            unclear: false,
        })
    }

    fn start(&mut self, now: Ns, step: StartStep) -> Choice {
        let due = self.completed_at.saturating_add(self.config.busy_poll_ns);
        if step == StartStep::NotBusy && self.header.is_some() && self.busy && now < due {
            return Choice::Nothing { until: due };
        }
        let wanted = self.config.wanted_size.unwrap_or(self.size);
        let request = step.request(wanted);
        if step.len() == 0 {
            return self.send_short(now, Purpose::Start(step), step.control(), &request);
        }
        let header = self.new_header(step.control());
        let arguments = Arguments { len: step.len(), ..Arguments::NONE };
        self.packets[self.current].fill(0);
        match write_around(&mut self.packets[self.current], self.size, self.rule, header, request.code(), arguments) {
            Ok(_) => self.launch(now, Purpose::Start(step), request.code()),
            Err(_) => Choice::Nothing { until: now + 1 },
        }
    }

    fn run(&mut self, now: Ns) -> Choice {
        let command = self.waiting_command();
        let process = self.process.waiting().is_some();
        if process && !(self.process_last && command.is_some()) {
            return self.send_process(now);
        }
        if let Some((slot, part)) = command {
            let to_clear = self.to_clear();
            if !self.cleared.contains(to_clear) {
                (self.cleared, self.clear_tries) = (self.cleared | to_clear, 0);
            }
            if !self.bits_known || to_clear != Errors::NONE && self.clear_tries < CLEAR_TRIES {
                return self.send_info(now);
            }
            self.stuck = self.stuck | to_clear;
            return self.send_slot(now, slot, part);
        }
        let running = self.slots.running().is_some();
        let blocked = self.busy && self.slots.first_waiting(false).is_some();
        let poll_ns = if running || blocked { self.config.busy_poll_ns } else { self.config.poll_ns };
        let due = self.completed_at.saturating_add(poll_ns);
        if now >= due {
            return self.send_info(now);
        }
        let deadline = self.slots.next_deadline(self.config.timeouts.queue_ns).unwrap_or(due);
        Choice::Nothing { until: due.min(deadline.max(now + 1)) }
    }

    /// The next queued command that may be sent now: the index of its slot, and whether the command, the read of its
    /// result or the read of its abort code is sent.
    fn waiting_command(&self) -> Option<(usize, CommandPart)> {
        let request = |slot| (slot, CommandPart::Request);
        let other = || self.slots.first_waiting(false).filter(|_| self.slots.running().is_none() && !self.busy);
        self.slots
            .waiting_read()
            .or_else(|| self.slots.first_waiting(true).map(request))
            .or_else(|| other().map(request))
    }

    /// The errors to clear before a command is sent, since they would otherwise be taken for the command's own.
    fn to_clear(&self) -> Errors {
        self.seen().without(self.stuck)
    }

    /// The error bits of the newest answer that the next header clears, including those that remained after earlier
    /// attempts.
    fn seen(&self) -> Errors {
        self.own_errors(self.header.map_or(Errors::NONE, |header| header.errors))
    }

    /// Removes from the error bits `seen` bits 0 to 2, which show present conditions and cannot be cleared, and the
    /// error bit that may belong to the running command.
    pub(super) fn own_errors(&self, seen: Errors) -> Errors {
        let own = Errors(seen.0 & Errors::ALL.0);
        // While a non-immediate command runs, its error bit 3 is not cleared: it may be set already, and would be lost
        // before an answer shows that the command failed.
        if self.slots.running().is_some() { own.without(Errors::NON_IMMEDIATE) } else { own }
    }

    /// The header of a new packet. The index counts from 1 to 255 and wraps, so that two consecutive packets never have
    /// the same index.
    fn new_header(&mut self, control: Control) -> CommandHeader {
        self.index = if self.index == u8::MAX { 1 } else { self.index + 1 };
        let (interrupt_clear, gpio_interrupt_clear) = core::mem::take(&mut self.interrupts_to_clear);
        let (reserve, gpio_outputs) = match self.gpio_outputs {
            Some(outputs) => (Reserve::GPIO_OUTPUTS_VALID, outputs),
            None => (Reserve::NONE, 0),
        };
        let header = CommandHeader::with_index(self.index);
        CommandHeader { control, interrupt_clear, gpio_interrupt_clear, reserve, gpio_outputs, ..header }
    }

    /// Records that the packet in the buffer is sent now and is in flight.
    fn launch(&mut self, now: Ns, purpose: Purpose, code: CommandCode) -> Choice {
        self.exchange += 1;
        self.bits_known = false;
        self.sent = [self.sent[1], (self.index, code, 1)];
        let flight = Flight::new(purpose, self.index, code, self.exchange);
        self.flight = Some(flight.within(now, self.config.timeouts.answer_ns));
        Choice::Packet
    }

    /// Sends INFO_UPDATE or a request of the chip's start. These are short enough for the smallest packet, so an error
    /// in building the packet is not reported.
    fn send_short(&mut self, now: Ns, purpose: Purpose, control: Control, request: &Request<'_>) -> Choice {
        let header = self.new_header(control);
        match write_request(&mut self.packets[self.current], self.size, self.rule, header, request) {
            Ok(_) => self.launch(now, purpose, request.code()),
            Err(_) => Choice::Nothing { until: now + 1 },
        }
    }

    fn send_info(&mut self, now: Ns) -> Choice {
        // Each bit of the control byte clears the error bit of the same number.
        let control = Control(self.seen().0);
        self.send_short(now, Purpose::Info, control, &InfoUpdate.into())
    }

    fn send_slot(&mut self, now: Ns, slot: usize, part: CommandPart) -> Choice {
        self.process_last = false;
        let header = self.new_header(Control::NONE);
        let request = self.slots.all[slot].request(part);
        let code = request.code();
        let error = match write_request(&mut self.packets[self.current], self.size, self.rule, header, &request) {
            Ok(_) => {
                self.slots.all[slot].state = SlotState::Sent(part);
                return self.launch(now, Purpose::Slot(slot, part), code);
            }
            Err(WriteError::Malformed(malformed)) => malformed.into(),
            // Cannot happen: the buffer holds the longest packet.
            Err(WriteError::Buffer { needed, found }) => HostError::TooLong { code, found: needed, most: found },
        };
        self.slots.all[slot].state = SlotState::Done(Err(error));
        Choice::Nothing { until: now + 1 }
    }

    fn send_process(&mut self, now: Ns) -> Choice {
        self.process_last = true;
        let cleared = self.seen();
        let others = !self.bits_known;
        let header = self.new_header(Control(cleared.0));
        let clears = cleared.intersects(NOT_TAKEN);
        if let Some(overtaken) = &mut self.process.overtaken {
            overtaken.unclear |= clears;
        }
        let Some(outgoing) = self.process.sent() else { return Choice::Nothing { until: now + 1 } };
        let OutgoingProcessData { sequence, code, arguments, written, queued, reads } = outgoing;
        // `Process::submit` has written the outputs into the packet that is not being sent.
        let packet = &mut self.packets[1 - self.current];
        let sent = write_around(packet, self.size, self.rule, header, code, arguments).is_ok();
        if !sent {
            // The outputs no longer fit, because the data segment has become smaller since they were submitted.
            self.report(sequence, ProcessOutcome::Refused);
            return Choice::Nothing { until: now + 1 };
        }
        self.current = 1 - self.current;
        let choice = self.launch(now, Purpose::Process { sequence, written, queued, reads, clears, others }, code);
        self.rx_estimate.wrote(sequence, queued, self.exchange);
        choice
    }
}

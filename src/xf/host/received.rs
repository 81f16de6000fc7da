//! Interprets the received bytes: a damaged packet, "not ready", or an answer with its header.

use super::flight::{AnswerMatch, Flight, Purpose};
use super::process::ProcessOutcome;
use super::slots::{CommandSlots, SlotState};
use super::{Host, HostError, HostState, PendingExchange, StartStep};
use crate::ethercat::Ns;
use crate::xf::packet::PacketKind;
use crate::xf::{
    AnswerHeader, AnswerPacket, CheckRule, CheckType, CommandHeader, Errors, MAX_PACKET, PacketError, Status,
};

impl Host {
    /// Takes the bytes received in the exchange that [`Self::next`] requested: as many as were sent, or none if the
    /// exchange failed. `now` is the end of the exchange.
    pub fn received(&mut self, now: Ns, bytes: &[u8]) {
        let (place, len) = (self.receive_buffer.packet(), bytes.len().min(MAX_PACKET));
        place[..len].copy_from_slice(&bytes[..len]);
        self.came(now, bytes.len());
    }

    /// Like [`Self::received`], for `len` bytes that are already in the receive buffer.
    pub(super) fn came(&mut self, now: Ns, len: usize) {
        let ready = core::mem::take(&mut self.ready_seen);
        match self.pending_exchange.take() {
            None => self.counters.stray += 1,
            Some(PendingExchange::Filler) => {
                self.pacer.ended(now, &self.config, ready, false);
                self.searched(now, len);
            }
            Some(PendingExchange::Packet) if self.is_resize() => self.resized(now, len, ready),
            Some(PendingExchange::Packet) => {
                self.counters.exchanges += 1;
                let kind = self.classify(len);
                match kind {
                    Ok(PacketKind::NotReady) => self.pacer.slower(&self.config),
                    Ok(PacketKind::Answer) => self.pacer.faster(&self.config),
                    Err(_) => {}
                }
                self.pacer.ended(now, &self.config, ready, true);
                match kind {
                    Ok(PacketKind::Answer) => self.answered(now, &self.receive_buffer.header()),
                    Ok(PacketKind::NotReady) => self.counters.not_ready += 1,
                    Err(error) => self.damaged(now, error),
                }
            }
        }
    }

    /// Evaluates bytes that were received during the search for packets.
    fn searched(&mut self, now: Ns, len: usize) {
        let bytes = self.receive_buffer.received(len.min(MAX_PACKET)).unwrap_or_default();
        let Some(size) = self.search.take(bytes) else {
            let waited_ns = now.saturating_sub(self.search.since);
            if waited_ns >= self.config.timeouts.search_ns {
                self.stop(HostError::Silent { waited_ns, bytes: self.search.bytes() });
            }
            return;
        };
        match self.state {
            HostState::Searching if size == self.size => self.state = HostState::Running,
            HostState::Searching => {
                self.size = size;
                self.chip_was_reset(now);
            }
            _ => {
                self.size = size;
                self.flight = None;
                self.state = HostState::Starting(StartStep::CheckType);
            }
        }
        if let Some(flight) = &mut self.flight {
            flight.deadline = flight.deadline.saturating_add(now.saturating_sub(self.search.since));
        }
    }

    fn is_resize(&self) -> bool {
        matches!(self.flight, Some(flight) if flight.purpose == Purpose::Start(StartStep::Resize))
    }

    /// Handles the answer to SPI_RECONFIG_OP. The answer is ignored, as in the vendor's driver, and the new data
    /// segment size n is tried. If the chip was not ready, it has not taken the command, which is sent again.
    fn resized(&mut self, now: Ns, len: usize, ready: bool) {
        self.counters.exchanges += 1;
        self.flight = None;
        if self.classify(len) == Ok(PacketKind::NotReady) {
            self.counters.not_ready += 1;
            self.pacer.slower(&self.config);
            self.pacer.ended(now, &self.config, ready, true);
            return;
        }
        self.size = self.config.wanted_size.unwrap_or(self.size);
        self.pacer.hold(now.saturating_add(self.config.timeouts.resize_ns));
        // After this command the chip may use the fixed word again, which must not be taken for a reset.
        self.crc_on = false;
        self.state = HostState::Starting(StartStep::CheckType);
    }

    /// Checks whether the received packet is an answer. A CRC-32 is tried with every coverage that answers may have.
    fn classify(&mut self, len: usize) -> Result<PacketKind, PacketError> {
        let expected = self.size.packet_len();
        let bytes = self.receive_buffer.received(len).ok_or(PacketError::Length { expected, found: len })?;
        let mut kind = Err(PacketError::Length { expected, found: len });
        for coverage in self.coverages.of_answers() {
            kind = AnswerPacket::classify(bytes, self.size, coverage);
            match kind {
                Err(PacketError::CheckWord { kind: CheckType::Crc32, .. }) => {}
                Ok(PacketKind::Answer) if !self.coverages.answers_are_known() => {
                    let AnswerHeader { status, len, .. } = self.receive_buffer.header();
                    if status.check_type() == Ok(CheckType::Crc32) {
                        self.coverages.answer_fits(coverage, self.size, len);
                    }
                    break;
                }
                _ => break,
            }
        }
        kind
    }

    fn damaged(&mut self, now: Ns, error: PacketError) {
        self.counters.damaged += 1;
        self.pacer.excuse_int0();
        self.last_error = Some(error);
        self.bad_in_row += 1;
        let is_unfit = matches!(error, PacketError::CheckWord { kind: CheckType::Crc32, .. });
        if is_unfit && matches!(self.state, HostState::Starting(_)) && self.coverages.answer_is_unfit() {
            self.give_crc_up();
        }
        if self.bad_in_row >= self.config.resync_after {
            self.search_anew(now);
        }
    }

    fn answered(&mut self, now: Ns, header: &AnswerHeader) {
        self.counters.answers += 1;
        self.found.get_or_insert(*header);
        self.answered = self.exchange;
        self.counters.nops += u64::from(header.status.contains(Status::NOP));
        self.bad_in_row = 0;
        if self.crc_on && header.status.check_type() == Ok(CheckType::Fixed) {
            self.chip_was_reset(now);
            self.header = Some(*header);
            return;
        }
        // If index, code and NOP flag are the same as in the previous answer, this answer may be a duplicate. Then it
        // does not show which packet it answers.
        let tells = |header: &AnswerHeader| (header.index, header.code, header.status.contains(Status::NOP));
        let new = self.header.is_none_or(|before| tells(&before) != tells(header));
        let (index, code, copies) = self.sent[0];
        self.in_step = new && copies <= 2 && (header.index, header.code) == (index, code);
        let rejected = self.count_rejections(header);
        self.header = Some(*header);
        self.stuck = Errors(self.stuck.0 & header.errors.0);
        if self.own_errors(header.errors).without(self.stuck) == Errors::NONE {
            (self.cleared, self.clear_tries) = (Errors::NONE, 0);
        }
        self.rx_estimate.answer(self.exchange, header.rx_fifo);
        self.give_to_flight(now, header, rejected);
        self.follow_check_type(header);
    }

    /// Counts packets that the chip has rejected since the previous answer; returns whether there were any.
    ///
    /// `[OURS]` A rejected packet raises the chip's CRC error count or sets an error bit for packets. The number of
    /// rejected packets is unclear in three cases: the count fell, since the answer is late or the count was cleared;
    /// an error bit is new although the count is the same; or the count is 255, where it stops. At 255, an error bit
    /// that is set may mean one more rejected packet.
    fn count_rejections(&mut self, header: &AnswerHeader) -> bool {
        let Some(before) = self.header else { return false };
        let rose = header.crc_errors.wrapping_sub(before.crc_errors);
        let bits = Errors(header.errors.0 & (Errors::SPI | Errors::CRC).0);
        let appeared = bits.without(before.errors) != Errors::NONE;
        let at_its_end = header.crc_errors == u8::MAX;
        let unclear = rose > u8::MAX / 2 || rose == 0 && (appeared || at_its_end);
        if unclear {
            if let Some(overtaken) = &mut self.process.overtaken {
                overtaken.unclear = true;
            }
            return rose > 0 || appeared || at_its_end && bits != Errors::NONE;
        }
        self.rejections += u64::from(rose);
        self.counters.rejected += u64::from(rose);
        rose > 0
    }

    fn give_to_flight(&mut self, now: Ns, header: &AnswerHeader, rejected: bool) {
        let nop = header.status.contains(Status::NOP);
        if !nop && self.complete_overtaken(Some(header)) {
            return;
        }
        if rejected && self.tries_coverage(header) {
            return;
        }
        let Some(flight) = &mut self.flight else {
            self.counters.stray += 1;
            return;
        };
        let matched = flight.match_answer(header, rejected);
        let flight = *flight;
        match matched {
            AnswerMatch::Open => {
                // An answer with NOP is not stray: it answers another copy of a packet that has its answer already, or
                // a rejected copy.
                self.counters.stray += u64::from(!nop);
            }
            AnswerMatch::Result | AnswerMatch::Lost => {
                self.learn_coverage(&flight);
                self.flight = None;
                self.completed_at = now;
                self.bits_known = true;
                self.busy = header.status.contains(Status::BUSY);
                self.complete(now, &flight, matched, header);
                self.look_for_end(now, &flight, header);
            }
        }
    }

    /// Makes commands use the check type that the status of an answer names. While the chip is being started, a packet in
    /// flight with the other check type is dropped and its step is sent again.
    fn follow_check_type(&mut self, header: &AnswerHeader) {
        let Ok(kind) = header.status.check_type() else { return };
        let follows = matches!(self.state, HostState::Starting(step) if step != StartStep::FixedWord);
        if follows && kind != self.rule.kind {
            self.rule = CheckRule { kind, coverage: self.coverages.of_commands() };
            self.flight = None;
        }
    }

    /// Handles a packet that the chip has rejected during its start. If it is the packet in flight and no command with
    /// a CRC-32 was accepted yet, the packet is replaced by one with another coverage. Returns whether that was done.
    fn tries_coverage(&mut self, header: &AnswerHeader) -> bool {
        let Some(flight) = self.flight.filter(|flight| matches!(flight.purpose, Purpose::Start(_))) else {
            return false;
        };
        // If the answer belongs to an earlier packet, that packet may be the rejected one.
        let is_this = flight.matches(header) || flight.copies > 2;
        let is_open = self.coverages.is_open() || !self.coverages.commands_fit();
        if self.rule.kind != CheckType::Crc32 || !is_this || !is_open {
            return false;
        }
        if self.coverages.command_is_rejected(self.rule.coverage) {
            self.give_crc_up();
        } else {
            self.rule.coverage = self.coverages.of_commands();
            self.flight = None;
        }
        true
    }

    /// Learns from a packet of the chip's start that has run: if it had a CRC-32, its coverage is right.
    fn learn_coverage(&mut self, flight: &Flight) {
        if self.rule.kind == CheckType::Crc32
            && matches!(flight.purpose, Purpose::Start(_))
            && let Some(head) = self.packets[self.current].first_chunk()
        {
            self.coverages.command_ran(self.rule.coverage, self.size, CommandHeader::decode(head).1.len);
            self.rule.coverage = self.coverages.of_commands();
        }
    }

    /// Sets the chip to the fixed check word. The chip accepts this command whatever its CRC-32 covers.
    fn give_crc_up(&mut self) {
        self.gave_crc_up = true;
        self.crc_on = false;
        self.rule = CheckRule::FIXED;
        self.flight = None;
        self.bad_in_row = 0;
        self.state = HostState::Starting(StartStep::FixedWord);
    }

    /// Handles a reset of the chip: its pending commands are lost, and it is started again.
    pub(super) fn chip_was_reset(&mut self, now: Ns) {
        self.counters.chip_resets += 1;
        self.forget_all();
        self.started = now;
        self.state = HostState::Starting(StartStep::CheckType);
    }

    /// Ends everything pending or in flight, and forgets the chip's present state: header, errors, RxFIFO level and
    /// check type. The data segment size n and the coverages are kept.
    pub(super) fn forget_all(&mut self) {
        // The overtaken process data come first, so that reports are in the order of submission.
        self.complete_overtaken(None);
        if let Some(flight) = self.flight.take()
            && let Purpose::Process { sequence, written, .. } = flight.purpose
        {
            self.complete_unknown(sequence, written);
        }
        if let Some(sequence) = self.process.waiting() {
            self.process.sent();
            self.report(sequence, ProcessOutcome::NotWritten);
        }
        self.slots.fail_all(HostError::ChipReset);
        self.rx_estimate = super::RxFreeEstimate::new(self.config.rx_entries);
        self.header = None;
        self.bits_known = false;
        self.busy = true;
        self.crc_on = false;
        self.rule.kind = CheckType::Fixed;
        self.stuck = Errors::NONE;
        (self.cleared, self.clear_tries) = (Errors::NONE, 0);
    }
}

/// The slot of the running command and the time of its beginning, if a command runs.
pub(super) fn running_since(slots: &CommandSlots) -> Option<(usize, Ns)> {
    let slot = slots.running()?;
    match slots.all[slot].state {
        SlotState::Running(since) => Some((slot, since)),
        _ => None,
    }
}

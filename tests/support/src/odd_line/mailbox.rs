//! The mailbox: requests in, answers out.

use std::collections::VecDeque;

use super::{Coe, Device, Foe, Ns, OddSlave};

/// A function that changes each message on its way out.
pub type Change = Box<dyn FnMut(&mut Vec<u8>) + Send>;

/// A mailbox.
#[derive(Default)]
pub struct Mailbox {
    /// Objects; `None`: no CoE.
    pub coe: Option<Coe>,
    /// Files; `None`: no FoE.
    pub foe: Option<Foe>,
    /// Duration of an answer, ns.
    pub takes_ns: Ns,
    /// The slave keeps the counter of the last request in Init.
    pub keeps_counter: bool,
    /// A fixed counter of all its own messages; `None`: they are counted.
    pub counts: Option<u8>,
    /// The slave takes requests and answers none.
    pub is_mute: bool,
    /// Changes each message on its way out: header and body, as they are sent.
    pub change: Option<Change>,
    /// Messages that wait for the mailbox, and the times from which they may go into it.
    waiting: VecDeque<(Ns, Vec<u8>)>,
    /// The last message in the mailbox.
    last: Vec<u8>,
    /// The counter of the last request.
    pub heard: u8,
    said: u8,
    /// Requests that were dropped as repeats.
    pub dropped: usize,
}

impl Mailbox {
    fn put_in_line(&mut self, now: Ns, kind: u8, body: &[u8]) {
        self.said = self.said % 7 + 1;
        let counter = self.counts.unwrap_or(self.said);
        let mut message = (body.len() as u16).to_le_bytes().to_vec();
        message.extend([0, 0, 0, kind | counter << 4]);
        message.extend(body);
        if let Some(change) = &mut self.change {
            change(&mut message);
        }
        self.waiting.push_back((now + self.takes_ns, message));
    }
}

impl OddSlave {
    /// The slave has gone to Init: its mail is dropped.
    pub(super) fn forget_mail(&mut self) {
        self.mailbox.waiting.clear();
        if !self.mailbox.keeps_counter {
            self.mailbox.heard = 0;
        }
    }

    pub(super) fn advance_mailbox(&mut self) {
        if self.state() < 2 || self.eeprom.word(0x1C) == 0 {
            return;
        }
        let [receive, send] = [0, 1].map(|n| self.manager(n));
        if receive.is_on() && receive.is_full() {
            self.set_full(0, false);
            let request = self.memory[receive.start..receive.start + receive.len].to_vec();
            self.take_request(&request, send.len);
        }
        if send.is_on() && !send.is_full() && self.mailbox.waiting.front().is_some_and(|(at, _)| *at <= self.now) {
            let (_, message) = self.mailbox.waiting.pop_front().expect("it is there");
            self.put_into_box(message);
        }
    }

    fn put_into_box(&mut self, message: Vec<u8>) {
        let send = self.manager(1);
        let mut bytes = message.clone();
        bytes.resize(send.len, 0);
        self.put(send.start, &bytes);
        self.mailbox.last = message;
        self.set_full(1, true);
    }

    /// The master asks for the last message once more; a message that waits in the mailbox comes after it.
    pub(super) fn repeat_message(&mut self, n: usize) {
        if n != 1 || self.mailbox.last.is_empty() {
            return;
        }
        let last = self.mailbox.last.clone();
        self.put_into_box(last);
    }

    fn take_request(&mut self, request: &[u8], room: usize) {
        let len = usize::from(u16::from_le_bytes([request[0], request[1]])).min(request.len() - 6);
        let (kind, counter) = (request[5] & 0x0F, request[5] >> 4 & 7);
        if counter != 0 && counter == self.mailbox.heard {
            self.mailbox.dropped += 1;
            return;
        }
        self.mailbox.heard = counter;
        let body = &request[6..6 + len];
        let Mailbox { coe, foe, .. } = &mut self.mailbox;
        let answers = match (kind, coe, foe) {
            (3, Some(coe), _) => coe.answer(body, room, self.memory[0x0130] & 0x0F),
            (4, _, Some(foe)) => foe.answer(body, room),
            // Protocol not supported.
            _ => vec![vec![1, 0, 2, 0]],
        };
        let is_error = !matches!((kind, &self.mailbox.coe, &self.mailbox.foe), (3, Some(_), _) | (4, _, Some(_)));
        if !self.mailbox.is_mute {
            for body in answers {
                self.mailbox.put_in_line(self.now, if is_error { 0 } else { kind }, &body);
            }
        }
        if let (Device::Drive(drive), Some(coe)) = (&mut self.device, &mut self.mailbox.coe) {
            drive.look(coe);
        }
    }
}

//! The AL state machine: steps, refusals, the watchdog.

use super::{Ns, OddSlave};

const INIT: u8 = 1;
const PREOP: u8 = 2;
const BOOT: u8 = 3;
const SAFEOP: u8 = 4;
const OP: u8 = 8;
/// In AL control: acknowledge; in AL status: error.
const BIT_4: u8 = 1 << 4;

/// The AL state machine and its oddities.
#[derive(Default)]
pub struct States {
    /// Device emulation: AL status copies AL control, bit 4 too, and there is no state machine.
    pub copies_control: bool,
    /// Duration of a step, ns.
    pub takes_ns: Ns,
    /// How often the firmware reads AL control, ns; 0: at once. Until then the controller refuses further writes to it.
    pub polls_ns: Ns,
    /// On its way down from OP the slave shows SafeOP for so long, ns.
    pub passes_safeop_ns: Ns,
    /// The slave ignores that many requests for a lower state: each time it goes to SafeOP by itself first, as if its
    /// watchdog had expired.
    pub expires_first: u32,
    /// States that are refused, with their AL status codes.
    pub refuses: Vec<(u8, u16)>,
    /// A request that the firmware has not read yet, and the time at which it does.
    unread: Option<(u8, Ns)>,
    /// The step under way: its target state, and the time of its end.
    step: Option<(u8, Ns)>,
    /// All requests so far.
    pub requests: Vec<u8>,
}

impl OddSlave {
    /// The state without the error bit.
    pub fn state(&self) -> u8 {
        self.memory[0x0130] & 0x0F
    }

    /// The AL status code.
    pub fn al_status(&self) -> u16 {
        self.word(0x0134)
    }

    fn show(&mut self, state: u8, code: u16) {
        self.put(0x0134, &code.to_le_bytes());
        self.memory[0x0130] = state | if code == 0 { 0 } else { BIT_4 };
        if state == INIT {
            self.forget_mail();
        }
    }

    /// Falls back with an error.
    pub fn fall(&mut self, state: u8, code: u16) {
        self.states.step = None;
        self.show(state, code);
    }

    /// Whether the controller refuses writes to AL control, because the firmware has not read the last one.
    pub(super) const fn refuses_requests(&self) -> bool {
        self.states.unread.is_some()
    }

    pub(super) fn ask_for_state(&mut self, control: u8) {
        self.states.requests.push(control);
        if self.states.copies_control {
            self.memory[0x0130] = control & 0x1F;
            return;
        }
        match self.states.polls_ns {
            0 => self.read_request(control),
            polls_ns => self.states.unread = Some((control, (self.now / polls_ns + 1) * polls_ns)),
        }
    }

    fn read_request(&mut self, control: u8) {
        let asked = control & 0x0F;
        if asked < self.state() && self.states.expires_first > 0 {
            self.states.expires_first -= 1;
            self.fall(SAFEOP, 0x001B);
        }
        let (asked, now) = (control & 0x0F, self.memory[0x0130]);
        if now & BIT_4 != 0 && control & BIT_4 == 0 && asked != INIT {
            return;
        }
        if control & BIT_4 != 0 {
            self.show(self.state(), 0);
        }
        if asked < SAFEOP || asked < self.state() {
            self.outputs_at = None;
        }
        self.states.step = Some((asked, self.now + self.states.takes_ns));
        if self.state() == OP && asked < SAFEOP && self.states.passes_safeop_ns > 0 {
            self.show(SAFEOP, 0);
            self.states.step = Some((asked, self.now + self.states.passes_safeop_ns));
        }
        self.advance_state();
    }

    pub(super) fn advance_state(&mut self) {
        if let Some((control, _)) = self.states.unread.take_if(|(_, at)| *at <= self.now) {
            self.read_request(control);
        }
        if let Some((to, at)) = self.states.step
            && self.now >= at
        {
            match self.check(to) {
                // The slave waits for outputs first.
                Ok(false) => {}
                Ok(true) => {
                    self.states.step = None;
                    self.show(to, 0);
                }
                Err(code) => {
                    self.states.step = None;
                    self.show(self.state(), code);
                }
            }
        }
        let watched =
            (0..4).map(|n| self.manager(n)).any(|one| one.is_on() && one.is_written() && one.control & 0x40 != 0);
        let unit_ns = (u64::from(self.word(0x0400)) + 2) * 40;
        let limit_ns = unit_ns * u64::from(self.word(0x0420));
        if self.state() == OP
            && !self.states.copies_control
            && watched
            && limit_ns > 0
            && self.outputs_at.is_some_and(|at| self.now > at + limit_ns)
        {
            self.show(SAFEOP, 0x001B);
        }
    }

    /// Whether the step is possible now.
    fn check(&self, to: u8) -> Result<bool, u16> {
        let from = self.state();
        if let Some((_, code)) = self.states.refuses.iter().find(|(state, _)| *state == to) {
            return Err(*code);
        }
        match (from, to) {
            _ if from == to => Ok(true),
            (_, INIT) | (SAFEOP | OP, PREOP) | (OP, SAFEOP) => Ok(true),
            (INIT, PREOP) => {
                let [receive, send] = [0, 1].map(|n| self.manager(n));
                let has_mailbox = self.eeprom.word(0x1C) != 0;
                let is_right = receive.is_on() && receive.is_mailbox() && receive.is_written();
                let is_right = is_right && send.is_on() && send.is_mailbox() && !send.is_written();
                let lens = [receive.len, send.len] == [self.eeprom.word(0x19), self.eeprom.word(0x1B)].map(usize::from);
                if !has_mailbox || is_right && lens { Ok(true) } else { Err(0x0016) }
            }
            (PREOP, SAFEOP) => self.check_process_data().map(|()| true),
            (SAFEOP, OP) => {
                let has_outputs =
                    (0..8).map(|n| self.manager(n)).any(|one| one.is_on() && one.is_written() && !one.is_mailbox());
                Ok(!has_outputs || self.outputs_at.is_some())
            }
            (_, BOOT) => Err(0x0013),
            (_, PREOP | SAFEOP | OP) => Err(0x0011),
            _ => Err(0x0012),
        }
    }

    fn check_process_data(&self) -> Result<(), u16> {
        let Some(coe) = &self.mailbox.coe else { return Ok(()) };
        let [outputs, inputs] = coe.process_managers();
        for (n, is_written, code) in [(inputs, false, 0x001E), (outputs, true, 0x001D)] {
            let (wanted, manager) = (coe.mapped_bytes(n), self.manager(n));
            let is_right = manager.is_on() && manager.len == wanted && manager.is_written() == is_written;
            if wanted > 0 && !is_right || wanted == 0 && manager.is_on() {
                return Err(code);
            }
        }
        let wants_sync = coe.value(0x1C32, 1).is_some_and(|value| value[0] == 2);
        if wants_sync && self.memory[0x0981] & 3 != 3 { Err(0x0030) } else { Ok(()) }
    }
}

//! The watch over the slaves while nothing is asked of them: who is gone, who is back, who has left a state, and whose
//! mailbox has something to say.

use super::bus::{Bus, Ticket};
use super::mailbox::Mailbox;
use super::{Event, SlaveInfo, clocks, sii};
use crate::ethercat::registers::{
    AL_CONTROL, AL_STATUS, AlControl, AlStatusRegister, AlStatusWithCode, RequestedState, SII_CONFIGURATION,
    STATION_ADDRESS, STATION_ALIAS, SmStatus, TYPE, sync_manager_status,
};
use crate::ethercat::sii::{SII_INFO_LEN, Sii};
use crate::ethercat::{AlState, Command, Ns, SlaveSet};

/// \[OURS] The station address that a slave has while it is not known which one it is.
const UNKNOWN_STATION: u16 = 0x0FFF;
/// \[OURS] How often slaves that have come back are looked for.
const RETURN_NS: Ns = 20_000_000;
/// The sync manager of answers.
const ANSWERS: u8 = 1;

/// The watch.
pub(super) struct Watch {
    bus: Bus,
    slaves: Vec<SlaveInfo>,
    tickets: Vec<(u8, Ticket)>,
    /// When slaves that have come back are looked for next.
    next_return: Ns,
}

impl Watch {
    pub(super) fn new(bus: Bus, slaves: Vec<SlaveInfo>) -> Self {
        let tickets = Vec::with_capacity(slaves.len());
        Self { bus, slaves, tickets, next_return: 0 }
    }

    /// Watches for ever.
    pub(super) async fn run(mut self) {
        loop {
            self.bus.wait_for_alarm().await;
            if self.bus.with(|shared| !shared.is_all_in_op || !shared.has_cycles()) {
                self.read_states().await;
            }
            self.look_for_mail().await;
            if self.bus.with(|shared| !shared.has_cycles()) {
                clocks::distribute(&self.bus).await;
            }
            let now = self.bus.now();
            if now >= self.next_return && self.bus.with(|shared| !shared.missing.is_empty()) {
                self.next_return = now.saturating_add(RETURN_NS);
                self.find_returned().await;
            }
        }
    }

    fn station(&self, slave: u8) -> Option<u16> {
        self.slaves.get(usize::from(slave).checked_sub(1)?).map(|info| info.station)
    }

    /// Reads the AL status of all slaves.
    async fn read_states(&mut self) {
        for (slave, info) in (1..).zip(&self.slaves) {
            self.tickets.push((slave, self.bus.queue(Command::Fprd, info.station, AL_STATUS, &[0; 6])));
        }
        while let Some((slave, ticket)) = self.tickets.pop() {
            let mut bytes = [0; 6];
            match ticket.answer(&mut bytes).await {
                Ok(1) => {
                    let status = AlStatusWithCode::decode(&bytes);
                    self.bus.with(|shared| shared.see_status(slave, status));
                }
                Ok(_) => self.bus.with(|shared| shared.lose(slave)),
                // Nobody knows.
                Err(_) => {}
            }
        }
    }

    /// Reads the mailboxes that are full although nobody waits for an answer.
    async fn look_for_mail(&mut self) {
        for (slave, info) in (1..).zip(&self.slaves) {
            if info.mailbox.is_some() && self.bus.with(|shared| shared.has_idle_mailbox(slave)) {
                let ticket = self.bus.queue_with(Command::Fprd, info.station, sync_manager_status(ANSWERS), &[0], 1);
                self.tickets.push((slave, ticket));
            }
        }
        let mut full = SlaveSet::EMPTY;
        while let Some((slave, ticket)) = self.tickets.pop() {
            let mut status = [0];
            if ticket.answer(&mut status).await == Ok(1) && SmStatus(status[0]).contains(SmStatus::FULL) {
                full.insert(slave);
            }
        }
        for slave in full.iter() {
            let Some(SlaveInfo { station, mailbox: Some(mailbox), .. }) = self.slaves.get(usize::from(slave) - 1)
            else {
                continue;
            };
            if let Some(mut mailbox) = Mailbox::open(self.bus.clone(), slave, *station, *mailbox) {
                // What cannot be read now is there next time.
                let _ = mailbox.drain().await;
            }
        }
    }

    /// Looks for slaves that have lost their station address: they were without power.
    async fn find_returned(&mut self) {
        let Ok(count) = self.bus.exchange(Command::Brd, 0, TYPE, &mut [0]).await else { return };
        for position in 0..count.min(self.slaves.len() as u16) {
            let adp = position.wrapping_neg();
            let mut station = [0; 2];
            let answer = self.bus.exchange(Command::Aprd, adp, STATION_ADDRESS, &mut station).await;
            let is_unknown = matches!(u16::from_le_bytes(station), 0 | UNKNOWN_STATION);
            if answer == Ok(1) && is_unknown {
                self.identify(adp).await;
            }
        }
    }

    /// Gives a slave without a station address its own again, if it is one that is missing.
    async fn identify(&self, adp: u16) -> Option<()> {
        let unknown = UNKNOWN_STATION.to_le_bytes();
        // No other one may have it.
        self.bus.queue(Command::Fpwr, UNKNOWN_STATION, STATION_ADDRESS, &[0; 2]).answer(&mut []).await.ok()?;
        self.bus.queue(Command::Apwr, adp, STATION_ADDRESS, &unknown).answer(&mut []).await.ok()?;
        self.bus.write(UNKNOWN_STATION, SII_CONFIGURATION, &[2]).await.ok()?;
        self.bus.write(UNKNOWN_STATION, SII_CONFIGURATION, &[0]).await.ok()?;
        let alias = u16::from_le_bytes(self.bus.read(UNKNOWN_STATION, STATION_ALIAS).await.ok()?);
        let mut bytes = Vec::new();
        sii::read_up_to(&self.bus, UNKNOWN_STATION, &mut bytes, SII_INFO_LEN).await.ok()?;
        let identity = Sii::new(&bytes).ok()?.info().identity;
        let missing = self.bus.with(|shared| shared.missing);
        let is_it = |slave: &u8| {
            let info = self.slaves.get(usize::from(*slave) - 1);
            info.is_some_and(|info| info.identity == identity && info.alias == alias)
        };
        // The same position is the likeliest among equal ones.
        let same = u8::try_from(adp.wrapping_neg() + 1).ok().filter(|slave| missing.contains(*slave));
        let slave = same.filter(is_it).or_else(|| missing.iter().find(is_it))?;
        let station = self.station(slave)?;
        let init = AlControl::request(RequestedState::State(AlState::Init)).with(AlControl::ACKNOWLEDGE);
        self.bus.write(UNKNOWN_STATION, AL_CONTROL, &init.0.to_le_bytes()).await.ok()?;
        self.bus.write(UNKNOWN_STATION, STATION_ADDRESS, &station.to_le_bytes()).await.ok()?;
        let status = AlStatusRegister::of(RequestedState::State(AlState::Init));
        self.bus.with(|shared| {
            shared.note_status(slave, AlStatusWithCode { status, ..AlStatusWithCode::default() });
            shared.clocks.set.remove(slave);
            shared.tell(Event::PowerCycled { slave });
        });
        Some(())
    }
}

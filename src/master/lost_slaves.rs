//! The watch over the slaves: detects slaves that are missing, are back, have left a state, or send no inputs, and
//! reads unsolicited mailbox messages. `acyclic.rs` decides how soon the datagrams of the watch are sent.

use super::bus::{Bus, Ticket};
use super::mailbox::Mailbox;
use super::topology::{Upstream, is_open};
use super::{Event, SEGMENT_BYTES_MAX, SlaveInfo, clocks, sii, states};
use crate::ethercat::registers::{
    AL_CONTROL, AL_STATUS, AlControl, AlStatusRegister, AlStatusWithCode, DL_STATUS, DlStatus, RequestedState,
    SII_CONFIGURATION, STATION_ADDRESS, STATION_ALIAS, SmStatus, TYPE, sync_manager_status,
};
use crate::ethercat::sii::SiiIdentity;
use crate::ethercat::{AlState, Command, MAX_SLAVES, Ns, SlaveSet};

/// \[OURS] A temporary station address for the slave that is just being identified.
const UNKNOWN_STATION: u16 = 0x0FFF;
/// \[OURS] The interval in which the watch searches for slaves that have come back.
const RETURN_NS: Ns = 20_000_000;
/// The sync manager of the mailbox for answers.
const ANSWERS: u8 = 1;

/// Reads the AL status of all slaves. `tickets` is memory that calls reuse: it is empty before and after.
pub(super) async fn read_states(bus: &Bus, stations: &[u16], tickets: &mut Vec<(u8, Ticket)>) {
    let (asked, mut is_complete) = (bus.now(), true);
    for (slave, station) in (1..).zip(stations) {
        tickets.push((slave, bus.queue(Command::Fprd, *station, AL_STATUS, &[0; 6])));
    }
    while let Some((slave, ticket)) = tickets.pop() {
        let mut bytes = [0; 6];
        match ticket.answer(&mut bytes).await {
            Ok(1) => {
                let status = AlStatusWithCode::decode(&bytes);
                bus.with(|shared| shared.see_status(slave, status));
            }
            Ok(0) => bus.with(|shared| shared.lose(slave)),
            // The state stays unknown: several slaves have answered, or the frame was lost.
            Ok(_) | Err(_) => is_complete = false,
        }
    }
    if is_complete {
        bus.with(|shared| shared.states_read = Some(asked));
    }
}

/// The watch over the slaves, with its state between two checks.
pub(super) struct Watch {
    bus: Bus,
    slaves: Vec<SlaveInfo>,
    stations: Vec<u16>,
    tickets: Vec<(u8, Ticket)>,
    /// The slaves whose inputs are to be read, with their logical address and length, bytes.
    asked: Vec<(u8, u32, usize)>,
    /// When to search next for slaves that have come back.
    next_return: Ns,
}

impl Watch {
    pub(super) fn new(bus: Bus, slaves: Vec<SlaveInfo>) -> Self {
        let (tickets, asked) = (Vec::with_capacity(slaves.len()), Vec::with_capacity(slaves.len()));
        let stations = slaves.iter().map(|slave| slave.station).collect();
        Self { bus, slaves, stations, tickets, asked, next_return: 0 }
    }

    /// Watches the slaves. This future never ends.
    pub(super) async fn run(mut self) {
        loop {
            self.bus.wait_for_alarm().await;
            if self.bus.with(|shared| !shared.is_all_in_op || !shared.has_cycles()) {
                let asked = self.bus.now();
                read_states(&self.bus, &self.stations, &mut self.tickets).await;
                let are_known = self.bus.with(|shared| shared.states_read == Some(asked));
                if self.find_mute().await && are_known {
                    self.bus.with(|shared| shared.searched = Some(asked));
                }
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

    /// Finds slaves whose inputs cannot be read, when a cycle had a wrong working counter that missing slaves do not
    /// explain. It reads the inputs of each doubtful slave alone, outside the cycle, at their logical address. Nothing
    /// is written, and the inputs stay in the slave for the cycle. Returns whether all reads were answered.
    async fn find_mute(&mut self) -> bool {
        self.bus.with(|shared| {
            let asked = shared.doubtful.union(shared.mute).intersection(shared.active).difference(shared.missing);
            asked.iter().for_each(|slave| self.asked.extend(shared.inputs_of(slave).map(|(at, len)| (slave, at, len))));
        });
        for (slave, at, len) in self.asked.drain(..) {
            let (adp, ado, nothing) = (at as u16, (at >> 16) as u16, &[0; SEGMENT_BYTES_MAX][..len]);
            self.tickets.push((slave, self.bus.queue_with(Command::Lrd, adp, ado, nothing, 1)));
        }
        let mut is_complete = true;
        while let Some((slave, ticket)) = self.tickets.pop() {
            match ticket.answer(&mut []).await {
                Ok(0) => self.bus.with(|shared| shared.mute.insert(slave)),
                Ok(1) => self.bus.with(|shared| shared.mute.remove(slave)),
                Ok(_) | Err(_) => is_complete = false,
            }
        }
        is_complete
    }

    /// Drains mailboxes that have a message without a waiting request, except those that a user reads.
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
        let kept = self.bus.with(|shared| shared.note_mail(full));
        for slave in full.difference(kept).iter() {
            let Some(SlaveInfo { station, mailbox: Some(mailbox), .. }) = self.slaves.get(usize::from(slave) - 1)
            else {
                continue;
            };
            if let Some(mut mailbox) = Mailbox::open(self.bus.clone(), slave, *station, *mailbox) {
                // A message that cannot be read now is read the next time.
                let _ = mailbox.drain().await;
            }
        }
    }

    /// Searches for slaves that have lost their station address, because they were without power.
    async fn find_returned(&mut self) {
        let Ok(count) = self.bus.exchange(Command::Brd, 0, TYPE, &mut [0]).await else { return };
        let count = count.min(self.slaves.len() as u16) as u8;
        for position in 0..count {
            let adp = u16::from(position).wrapping_neg();
            self.tickets.push((position, self.bus.queue(Command::Aprd, adp, STATION_ADDRESS, &[0; 2])));
        }
        // The slave at each position of the cable; 0: not known yet.
        let mut order = [0; MAX_SLAVES];
        let mut is_known = true;
        while let Some((position, ticket)) = self.tickets.pop() {
            let mut station = [0; 2];
            let answer = ticket.answer(&mut station).await;
            let station = u16::from_le_bytes(station);
            let known = (1..).zip(&self.slaves).find(|(_, info)| info.station == station).map(|(slave, _)| slave);
            order[usize::from(position)] = known.unwrap_or(0);
            is_known &= answer == Ok(1) && (known.is_some() || matches!(station, 0 | UNKNOWN_STATION));
        }
        // The order is known only if all answers have come, and no slave has a station address that this master did not
        // assign.
        if !is_known {
            return;
        }
        let order = &order[..usize::from(count)];
        for place in (1..=count).filter(|place| order[usize::from(*place) - 1] == 0) {
            let candidates = candidates(order, place, self.slaves.len() as u8);
            let absent = (1..=self.slaves.len() as u8).filter(|slave| !order.contains(slave)).collect();
            // If this fails, the next search tries it again.
            let _ = self.identify(place, candidates, absent).await;
        }
    }

    /// Identifies the slave at position `place` (from 1) of the cable, which has lost its station address, and assigns
    /// the address to it again. The slave must be one of `candidates` and missing. `absent`: the slaves whose station
    /// address no slave has now. `None`: the slave could not be identified, or an access to it has failed.
    async fn identify(&self, place: u8, candidates: SlaveSet, absent: SlaveSet) -> Option<()> {
        let adp = (u16::from(place) - 1).wrapping_neg();
        let unknown = UNKNOWN_STATION.to_le_bytes();
        // First the temporary address is taken from any slave that still has it.
        self.bus.queue(Command::Fpwr, UNKNOWN_STATION, STATION_ADDRESS, &[0; 2]).answer(&mut []).await.ok()?;
        self.bus.queue(Command::Apwr, adp, STATION_ADDRESS, &unknown).answer(&mut []).await.ok()?;
        self.bus.write(UNKNOWN_STATION, SII_CONFIGURATION, &[2]).await.ok()?;
        self.bus.write(UNKNOWN_STATION, SII_CONFIGURATION, &[0]).await.ok()?;
        let alias = u16::from_le_bytes(self.bus.read(UNKNOWN_STATION, STATION_ALIAS).await.ok()?);
        let identity = sii::identity(&self.bus, UNKNOWN_STATION).await.ok()?;
        let slave = self.one_of(candidates, absent, identity, alias).await?;
        let station = self.station(slave)?;
        let init = AlControl::request(RequestedState::State(AlState::Init)).with(AlControl::ACKNOWLEDGE);
        self.bus.write(UNKNOWN_STATION, AL_CONTROL, &init.0.to_le_bytes()).await.ok()?;
        states::take_acknowledgement_back(&self.bus, UNKNOWN_STATION).await.ok()?;
        self.bus.write(UNKNOWN_STATION, STATION_ADDRESS, &station.to_le_bytes()).await.ok()?;
        let status = AlStatusRegister::of(RequestedState::State(AlState::Init));
        self.bus.with(|shared| {
            shared.note_status(slave, AlStatusWithCode { status, ..AlStatusWithCode::default() });
            shared.clocks.set.remove(slave);
            shared.mapped.remove(slave);
            shared.tell(Event::PowerCycled { slave });
        });
        Some(())
    }

    /// The candidate with that identity and alias, if it is missing. If several candidates have the same identity and
    /// alias, the slave is the one whose upstream slave answers with an open port towards it.
    ///
    /// `None` if this holds for no candidate or for several: then other slaves have to get their addresses back first.
    /// Also `None` if the slave was not known to be missing.
    async fn one_of(&self, candidates: SlaveSet, absent: SlaveSet, identity: SiiIdentity, alias: u16) -> Option<u8> {
        let is_equal = |slave: &u8| {
            let info = self.slaves.get(usize::from(*slave) - 1);
            info.is_some_and(|info| info.identity == identity && info.alias == alias)
        };
        let is_missing = |slave: &u8| self.bus.with(|shared| shared.missing.contains(*slave));
        let equal: SlaveSet = candidates.iter().filter(is_equal).collect();
        if equal.len() <= 1 {
            return equal.iter().next().filter(is_missing);
        }
        let mut reached = SlaveSet::EMPTY;
        for slave in equal.iter() {
            let upstream = self.slaves.get(usize::from(slave) - 1)?.upstream;
            let is_reached = match upstream {
                None => true,
                Some(upstream) if absent.contains(upstream.slave) => false,
                Some(Upstream { slave, port }) => {
                    let status = self.bus.read(self.station(slave)?, DL_STATUS).await.ok()?;
                    is_open(DlStatus(u16::from_le_bytes(status)), port.into())
                }
            };
            if is_reached {
                reached.insert(slave);
            }
        }
        reached.iter().next().filter(|slave| reached.len() == 1 && is_missing(slave))
    }
}

/// The slaves that can be at position `place` (from 1), whose slave is not identified. In network order they are
/// between the nearest known neighbours. If several positions there are unknown, their slaves are in ascending order.
fn candidates(order: &[u8], place: u8, slaves: u8) -> SlaveSet {
    let at = usize::from(place) - 1;
    let begin = order[..at].iter().rposition(|slave| *slave != 0).map_or(0, |known| known + 1);
    let end = order[at..].iter().position(|slave| *slave != 0).map_or(order.len(), |known| known + at);
    let before = begin.checked_sub(1).map_or(0, |known| order[known]);
    let behind = order.get(end).copied().unwrap_or(slaves + 1);
    // Unknown positions before and after this one, between the same known slaves, belong to other slaves.
    let (first, last) = (before + 1 + (at - begin) as u8, behind.saturating_sub((end - at) as u8));
    (first..=last).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The candidates for a position follow from the known slaves around it.
    #[test]
    fn a_slave_is_known_by_its_neighbours() {
        let of = |order: &[u8], place| candidates(order, place, 5).iter().collect::<Vec<_>>();
        assert_eq!(of(&[1, 0, 3, 4, 5], 2), [2]);
        assert_eq!(of(&[0, 2, 0, 4, 0], 1), [1]);
        assert_eq!(of(&[0, 2, 0, 4, 0], 3), [3]);
        assert_eq!(of(&[0, 2, 0, 4, 0], 5), [5]);
        assert_eq!([of(&[0, 0, 0, 0, 0], 1), of(&[0, 0, 0, 0, 0], 4)], [[1], [4]]);
        assert_eq!([of(&[1, 0, 0, 4, 5], 2), of(&[1, 0, 0, 4, 5], 3)], [[2], [3]]);
        // One of the slaves between the known ones is missing, so each unknown position has several candidates.
        assert_eq!(of(&[0, 3, 4, 5], 1), [1, 2]);
        assert_eq!(of(&[1, 0], 2), [2, 3, 4, 5]);
        assert_eq!([of(&[0, 0], 1), of(&[0, 0], 2)], [[1, 2, 3, 4], [2, 3, 4, 5]]);
        assert_eq!(of(&[1, 0, 5], 2), [2, 3, 4]);
        // The slaves are in another order than at the scan.
        assert!(of(&[5, 0, 1], 2).is_empty());
    }
}

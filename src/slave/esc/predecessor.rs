//! Simulates another master that has run before and has left the slaves powered: any register may differ from its power-on
//! value. Tests start masters on such slaves.
//!
//! A seed determines the AL state of each slave, and which of the writable registers were written, with which values. The
//! writes also have their effects: a closed port hides the slaves behind it, a watchdog with a divider of 0 expires at
//! once, a busy EEPROM accepts no command.
//!
//! Not generated: writes to the fixed words of an EEPROM, which would break the slave for every master; and a closed port
//! 0, because the slave could not be reached again before it loses its power.

use oorandom::Rand64;

use super::EscSlave;
use crate::ethercat::mailbox::{MailboxCounter, MailboxHeader, MailboxProtocol, encode_around};
use crate::ethercat::registers::{
    self, AL_CONTROL, CYCLIC_UNIT_CONTROL, DL_CONTROL, DlControl, ESC_WRITE_ENABLE, ESC_WRITE_PROTECTION, FMMU_LEN,
    Fmmu, FmmuDirections, LoopControl, MAP, PORTS, RAM, RegisterAccess, SII_CONFIGURATION, SII_CONTROL,
    STATION_ADDRESS, STATION_ALIAS, SYNC0_START, SmControl, SyncManager, WRITE_REGISTER_ENABLE,
    WRITE_REGISTER_PROTECTION, sync_manager,
};
use crate::ethercat::sii::{CategoryKind, MailboxAreas, Sii, SiiSmType};
use crate::ethercat::{AlState, Ns};

/// The number of bytes of the RAM that are filled with random data.
const GARBAGE_LEN: usize = 0x800;

/// A previous master that has ended, with the random generator for the states in which it leaves slaves.
#[derive(Clone, Debug)]
pub struct Predecessor {
    dice: Rand64,
}

/// What the EEPROM of a slave describes: its mailboxes and its process data areas.
#[derive(Default)]
struct Described {
    mailbox: Option<MailboxAreas>,
    /// The sync managers that the EEPROM describes, in the order of their numbers.
    managers: Vec<SyncManager>,
    outputs: Option<SyncManager>,
}

impl Described {
    fn of(eeprom: &[u8]) -> Self {
        let Ok(sii) = Sii::new(eeprom) else { return Self::default() };
        let info = sii.info();
        let mailbox = (info.protocols.0 != 0).then_some(info.mailbox);
        let mut described = Self { mailbox, ..Self::default() };
        let Some(category) = sii.category(CategoryKind::SyncManagers) else { return described };
        for one in category.sync_managers() {
            let manager = SyncManager::enabled(one.start, one.len, one.control);
            if one.kind == SiiSmType::Outputs && one.len > 0 {
                described.outputs = Some(manager);
            }
            described.managers.push(manager);
        }
        described
    }
}

impl Predecessor {
    /// A predecessor; the seed determines the random states in which it leaves slaves.
    pub fn seeded(seed: u64) -> Self {
        Self { dice: Rand64::new(seed.into()) }
    }

    fn below(&mut self, end: u64) -> u64 {
        self.dice.rand_range(0..end)
    }

    fn one_in(&mut self, many: u64) -> bool {
        self.below(many) == 0
    }

    fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.below(from.len() as u64) as usize]
    }

    fn bytes(&mut self, len: usize) -> Vec<u8> {
        (0..len).map(|_| self.dice.rand_u64() as u8).collect()
    }

    /// Leaves a running slave at `now` in a random state.
    pub fn leave(&mut self, slave: &mut EscSlave, now: Ns) {
        let target = self.pick(&[AlState::Init, AlState::PreOp, AlState::PreOp, AlState::SafeOp, AlState::Op]);
        let described = Described::of(slave.controller().eeprom());
        let garbage = self.bytes(GARBAGE_LEN);
        slave.controller_mut().fill(RAM, &garbage);
        bring(slave, &described, target, now);
        self.leave_mailbox(slave, &described, now);
        for register in MAP.iter().filter(|register| register.access == RegisterAccess::Write) {
            if !self.one_in(4) {
                self.leave_register(slave, register.address, register.len, now);
            }
        }
        if self.one_in(4) {
            let wrong = self.pick(&[0x05, 0x08, 0x03, 0x14]);
            slave.write_unseen(AL_CONTROL, &[wrong, 0], now);
        }
        if self.one_in(2) {
            // Assigns the SYNC unit and the latch inputs at random to the master or the slave's processor.
            let owned = self.bytes(1);
            slave.write_unseen(CYCLIC_UNIT_CONTROL, &owned, now);
        }
        if self.one_in(3) {
            slave.write_unseen(SII_CONFIGURATION, &[1], now);
            slave.controller_mut().take_eeprom(true);
        }
        // Write protection comes last, because it blocks the other writes.
        if self.one_in(3) {
            slave.write_unseen(WRITE_REGISTER_PROTECTION, &[1], now);
        }
        if self.one_in(3) {
            slave.write_unseen(ESC_WRITE_PROTECTION, &[1], now);
        }
    }

    /// Leaves traces of mailbox traffic, each in half of the cases: an SDO request in the mailbox, or message counters and a
    /// last read response as after a transfer. The slave repeats that response as soon as the repeat bit of sync manager 1
    /// differs from the repeat acknowledge.
    fn leave_mailbox(&mut self, slave: &mut EscSlave, described: &Described, now: Ns) {
        let Some(areas) = described.mailbox else { return };
        let counter = MailboxCounter::new(self.below(8) as u8).unwrap_or_default();
        let mut message = vec![0; usize::from(areas.receive.len)];
        // An SDO upload of 0x1018:1, and its response.
        let [request, answer] = [[0, 0x20, 0x40], [0, 0x30, 0x43]]
            .map(|[low, high, command]| [low, high, command, 0x18, 0x10, 1, 0x5A, 0xA5, 0x5A, 0xA5]);
        let header = MailboxHeader::new(MailboxProtocol::Coe, counter);
        let put = |data: &[u8; 10], message: &mut [u8]| {
            let room = message.get_mut(6..16).map(|room| room.copy_from_slice(data));
            room.is_some() && encode_around(header, data.len(), message).is_ok()
        };
        if self.one_in(2) && put(&request, &mut message) {
            slave.write_unseen(areas.receive.start, &message, now);
        }
        if self.one_in(2) {
            let mut read = vec![0; usize::from(areas.send.len)];
            put(&answer, &mut read);
            slave.mailbox_mut().remember(counter, &read);
        }
    }

    /// Writes random values to a register, or to a group of adjacent registers of the same kind. Registers for which
    /// most random values would have no effect, such as FMMUs and the station address, get values that have an effect.
    fn leave_register(&mut self, slave: &mut EscSlave, address: u16, len: u16, now: Ns) {
        let bytes = match address {
            STATION_ADDRESS => self.station().to_le_bytes().to_vec(),
            registers::RESET_ECAT => vec![b'R'],
            DL_CONTROL => return self.leave_ports(slave, now),
            registers::WATCHDOG_DIVIDER | registers::WATCHDOG_PDI | registers::WATCHDOG_PROCESS_DATA => {
                let any = self.dice.rand_u64() as u16;
                self.pick(&[0, 1, 2498, 1000, u16::MAX, any]).to_le_bytes().to_vec()
            }
            SII_CONTROL => return self.leave_eeprom(slave, now),
            registers::FMMU => return self.leave_fmmus(slave, now),
            registers::SYNC_MANAGER => return self.leave_managers(slave, now),
            SYNC0_START => {
                let ahead = self.below(1_000_000_000);
                slave.controller().system_time_ns().wrapping_add(ahead).to_le_bytes().to_vec()
            }
            // `leave` writes some of these registers itself, before or after all others. `leave_eeprom` writes the
            // EEPROM address together with the command.
            AL_CONTROL | SII_CONFIGURATION | registers::SII_ADDRESS | registers::SII_DATA | CYCLIC_UNIT_CONTROL => {
                return;
            }
            WRITE_REGISTER_ENABLE | WRITE_REGISTER_PROTECTION | ESC_WRITE_ENABLE | ESC_WRITE_PROTECTION => return,
            _ => self.bytes(len.into()),
        };
        slave.write_unseen(address, &bytes, now);
    }

    /// A random station address: in half of the cases 0x1001 to 0x1008, which the next master may assign to another
    /// slave if its addresses begin at 0x1001, like the addresses of SOEM.
    fn station(&mut self) -> u16 {
        let near = 0x1001 + self.below(8) as u16;
        let any = self.dice.rand_u64() as u16;
        self.pick(&[near, near, 0, any])
    }

    /// Leaves random loop settings of the ports, permanent or for one second, and a random station alias that may be
    /// enabled.
    fn leave_ports(&mut self, slave: &mut EscSlave, now: Ns) {
        let alias = self.station();
        slave.controller_mut().fill(STATION_ALIAS, &alias.to_le_bytes());
        for _ in 0..2 {
            let any = DlControl(self.dice.rand_u64() as u32);
            let first = self.pick(&[LoopControl::Auto, LoopControl::AutoClose, LoopControl::Open]);
            let others = [LoopControl::Auto, LoopControl::AutoClose, LoopControl::Open, LoopControl::Closed];
            let control = (1..PORTS).fold(any.with_loop(0, first), |control, port| {
                let other = self.pick(&others);
                control.with_loop(port, other)
            });
            slave.write_unseen(DL_CONTROL, &control.0.to_le_bytes(), now);
        }
    }

    /// Leaves a refused EEPROM write, a read that is still running, both or neither.
    fn leave_eeprom(&mut self, slave: &mut EscSlave, now: Ns) {
        const READ: u8 = 1;
        const WRITE: u8 = 2;
        if self.one_in(2) {
            // The write is refused, because the write-enable bit is missing.
            slave.write_unseen(SII_CONTROL, &[0, WRITE, 8, 0, 0, 0], now);
        }
        if self.one_in(2) {
            let word = self.below(64) as u8;
            slave.write_unseen(SII_CONTROL, &[0, READ, word, 0, 0, 0], now);
        }
    }

    fn leave_fmmus(&mut self, slave: &mut EscSlave, now: Ns) {
        for n in 0..slave.controller().settings().fmmus.min(16) {
            let logical = self.below(64) as u32;
            let (len, physical) = (1 + self.below(64) as u16, RAM + self.below(0x1000) as u16);
            let directions = self.pick(&[FmmuDirections::READ, FmmuDirections::WRITE]);
            let mut fmmu = Fmmu::bytes(logical, len, physical, directions).encode();
            if self.one_in(4) {
                fmmu = self.bytes(FMMU_LEN).try_into().unwrap_or(fmmu);
            }
            slave.write_unseen(registers::fmmu(n), &fmmu, now);
        }
    }

    /// Leaves random sync managers, with areas, control bytes and repeat bits that the EEPROM does not describe.
    fn leave_managers(&mut self, slave: &mut EscSlave, now: Ns) {
        let first = self.pick(&[0, 2, 4]);
        for n in first..slave.controller().settings().sync_managers.min(16) {
            let (start, len) = (RAM + self.below(0x1000) as u16, self.below(300) as u16);
            let control = SmControl(self.dice.rand_u64() as u8);
            let mut manager = SyncManager::enabled(start, len, control).encode();
            manager[6] = self.dice.rand_u64() as u8;
            slave.write_unseen(sync_manager(n), &SyncManager::default().encode(), now);
            slave.write_unseen(sync_manager(n), &manager, now);
        }
    }
}

/// Brings a slave to an AL state with the settings that its EEPROM describes.
fn bring(slave: &mut EscSlave, described: &Described, target: AlState, now: Ns) {
    let request = |slave: &mut EscSlave, state: AlState| slave.write_unseen(AL_CONTROL, &[state as u8, 0], now);
    for state in [AlState::PreOp, AlState::SafeOp, AlState::Op].into_iter().filter(|state| *state <= target) {
        match (state, described.mailbox) {
            (AlState::PreOp, Some(MailboxAreas { receive, send })) => {
                let boxes = [(receive, SmControl::MAILBOX_OUT), (send, SmControl::MAILBOX_IN)];
                for (n, (area, control)) in (0..).zip(boxes) {
                    let manager = SyncManager::enabled(area.start, area.len, control);
                    slave.write_unseen(sync_manager(n), &manager.encode(), now);
                }
            }
            (AlState::SafeOp, mailbox) => {
                let process_data = (0..).zip(&described.managers).skip(if mailbox.is_some() { 2 } else { 0 });
                for (n, manager) in process_data.filter(|(_, manager)| manager.len > 0) {
                    slave.write_unseen(sync_manager(n), &manager.encode(), now);
                }
            }
            (AlState::Op, _) => {
                if let Some(SyncManager { start, len, .. }) = described.outputs {
                    slave.write_unseen(start, &vec![0; len.into()], now);
                }
            }
            _ => {}
        }
        request(slave, state);
    }
}

//! The network of an ECM-XF, seen with the chip's own commands. If the chip runs the network already, nothing in it is
//! changed.

use std::time::Duration;

use super::chip_wire::{ChipWire, bytes_max, datagram};
use super::mailboxes::{self, Mailboxes};
use super::{BusError, FoundSlave, Network, SlaveState, eeprom};
use crate::address::uri::LinkUri;
use crate::ethercat::AlStatus;
use crate::ethercat::coe::{EntryRequest, ObjectAddress, SdoScope};
use crate::ethercat::registers::{AlStatusRegister, DL_STATUS, DlStatus, PORT_DESCRIPTOR};
use crate::ethercat::sii::SiiIdentity;
use crate::fieldbus::RingState;
use crate::link::chip_link::ChipLink;
use crate::master::{DatagramError, Ending, FrameCounters, Job, MailboxInfo, Master, SdoError, Settings, upstreams};
use crate::xf::EtherCatState;
use crate::xf::host::{HostConfig, HostError};
use crate::xf::request::{
    EepromGet, EepromOperation, EepromRequest, RAW_DATA_MAX, RawOperation, SDO_DATA_MAX, SDO_HEAD, SlaveNumber, Slaves,
};
use crate::xf::response::EepromAnswer;
use crate::xf_api::{NetworkConfig, Xf, XfError};

/// \[OURS] Timeout of the chip for reading or writing one word of an EEPROM.
const EEPROM_MAX: Duration = Duration::from_millis(500);
/// \[OURS] The maximum number of attempts: to send a datagram that does not come back, and to read a word of an EEPROM.
const TRIES: u32 = 3;
/// \[OURS] Interval between the long datagrams that put load on the cables. They read from register 0x0000, the type of
/// the slave controller, where reading has no effect.
const LOAD_INTERVAL: Duration = Duration::from_millis(1);
const LOAD_ADDRESS: u32 = 0x0000_0000;
/// \[OURS] Interval at which this crate's own master is polled while it waits for a slave.
const POLL_INTERVAL: Duration = Duration::from_micros(500);
/// The number of the slave [`XfNetwork::joined`] in this crate's own master. It is 1, because that master is given one
/// slave at a time.
const JOINED: u8 = 1;

/// The network behind an ECM-XF.
pub(super) struct XfNetwork {
    xf: Xf,
    is_virtual: bool,
    stations: Vec<u16>,
    /// This crate's own master, which handles the mailboxes. It knows only the slave of `joined`.
    master: Master,
    joined: Option<u8>,
}

impl XfNetwork {
    /// The network of the chip behind a link. Opening changes nothing in the network.
    pub(super) fn open(uri: &LinkUri) -> Result<Self, BusError> {
        let (link, config) = crate::open::chip::open(&uri.to_string()).map_err(XfError::Link)?;
        Self::over(link, config)
    }

    pub(super) fn over(link: Box<dyn ChipLink>, config: HostConfig) -> Result<Self, BusError> {
        let is_virtual = link.info().virtual_time;
        let xf = Xf::over(link, HostConfig { keep_fifo: true, ..config })?;
        let master = Master::new(Settings::default());
        Ok(Self { xf, is_virtual, stations: Vec::new(), master, joined: None })
    }

    /// Converts the number of a slave, from 1, to the number in the chip's commands, from 0.
    ///
    /// # Errors
    /// [`BusError::NoSuchSlave`]: the last scan has found no slave with this number.
    fn number(&self, slave: u8) -> Result<SlaveNumber, BusError> {
        let found = self.stations.len();
        let number = slave.checked_sub(1).filter(|place| usize::from(*place) < found).and_then(SlaveNumber::new);
        number.ok_or(BusError::NoSuchSlave { slave, found })
    }

    fn station(&self, slave: u8) -> Result<u16, BusError> {
        let place = usize::from(self.number(slave)?.get());
        Ok(self.stations[place])
    }

    fn access(&mut self, operation: RawOperation, slave: u8, address: u16, data: &[u8]) -> Result<Vec<u8>, BusError> {
        let station = self.station(slave)?;
        let failed = |error| BusError::Register { slave, address, error };
        for _ in 0..TRIES {
            match datagram(&mut self.xf, operation, u32::from(station) | u32::from(address) << 16, data)? {
                Some((1, read)) => return Ok(read),
                Some((counter, _)) => return Err(failed(DatagramError::WorkingCounter(counter))),
                None => {}
            }
        }
        Err(failed(DatagramError::Lost))
    }

    /// Refuses to write an EEPROM or a file of a slave while the chip's network is in SafeOP or OP.
    fn expect_not_running(&self) -> Result<(), BusError> {
        match self.xf.header().state.state() {
            Some(EtherCatState::SafeOp | EtherCatState::Op) => Err(BusError::Runs { slave: 1 }),
            _ => Ok(()),
        }
    }

    fn eeprom(&mut self, slave: u8, position: u16, operation: EepromOperation) -> Result<Vec<u8>, BusError> {
        let timeout_us = u32::try_from(EEPROM_MAX.as_micros()).unwrap_or(u32::MAX);
        let request = EepromRequest { slave: self.number(slave)?, position, timeout_us, operation };
        // On a bad cable a second read may succeed. A write is sent only once, since it may have changed the EEPROM even
        // if its answer was lost.
        let mut tries = if operation == EepromOperation::Read { TRIES } else { 1 };
        loop {
            tries -= 1;
            match self.xf.run_pair(&request, &EepromGet, 2 * EEPROM_MAX) {
                Ok(EepromAnswer { error: 0, data }) => return Ok(data.to_vec()),
                Ok(_) | Err(XfError::Chip(HostError::Failed { .. })) if tries > 0 => {}
                Ok(EepromAnswer { error, .. }) => return Err(BusError::ChipEeprom { slave, error }),
                Err(error) => return Err(error.into()),
            }
        }
    }

    /// The DL status and the port descriptor of a slave; each is 0 if the chip cannot read it.
    fn ports(&mut self, slave: u8) -> (DlStatus, u8) {
        let mut read = |address: u16, len: usize| {
            let read = self.access(RawOperation::Fprd, slave, address, &vec![0; len]).unwrap_or_default();
            read.get(..2)
                .or(read.get(..len))
                .map_or(0, |bytes| bytes.iter().rev().fold(0u16, |word, byte| word << 8 | u16::from(*byte)))
        };
        (DlStatus(read(DL_STATUS, 2)), read(PORT_DESCRIPTOR, 1) as u8)
    }
}

impl Mailboxes for XfNetwork {
    fn mailbox(&mut self, slave: u8) -> Result<Option<MailboxInfo>, BusError> {
        let station = self.station(slave)?;
        if self.joined != Some(slave) {
            self.joined = None;
            let eeprom = eeprom::read_whole(self, slave)?;
            self.master.join([(station, &*eeprom)]);
            self.joined = Some(slave);
        }
        Ok(self.master.slave(JOINED).and_then(|info| info.mailbox))
    }

    fn run<T: Ending>(&mut self, _: u8, start: impl FnOnce(&mut Master, u8) -> Job<T>) -> Result<T, BusError> {
        let job = start(&mut self.master, JOINED);
        let mut wire = ChipWire::new(&mut self.xf);
        loop {
            self.master.poll(wire.now(), &mut wire);
            if let Some(end) = self.master.take(job) {
                return Ok(end);
            }
            // Events of this master are dropped, among them emergencies of slaves. This master reads an emergency from
            // the mailbox together with the answers, so the chip cannot list it any more.
            while self.master.take_event().is_some() {}
            if let Err(error) = wire.wait(POLL_INTERVAL) {
                self.master.cancel(job);
                return Err(error.into());
            }
        }
    }
}

impl Network for XfNetwork {
    fn scan(&mut self) -> Result<Vec<FoundSlave>, BusError> {
        let is_up = self.xf.header().state.0 & 0x0F != 0;
        let found = match is_up {
            true => self.xf.count_slaves()?,
            false => match self.xf.start_network(&NetworkConfig::default()) {
                Ok(found) => found,
                // The command also fails if there is no slave at all. Then the count is 0, and the error below is
                // [`BusError::NoSlave`].
                Err(error) => match self.xf.count_slaves()? {
                    0 => 0,
                    _ => return Err(error.into()),
                },
            },
        };
        if found == 0 {
            return Err(BusError::NoSlave);
        }
        self.xf.state()?;
        let described: Vec<_> = (0..found).map(|slave| self.xf.slave_description(slave)).collect::<Result<_, _>>()?;
        // Until its network is configured, the chip reports 0 bytes for every slave. The lengths count as unknown then.
        let is_laid_out = described.iter().any(|slave| slave.output_bytes > 0 || slave.input_bytes > 0);
        self.joined = None;
        self.stations = described.iter().map(|slave| slave.station_address).collect();
        let ports: Vec<(DlStatus, u8)> = (1..=found).map(|slave| self.ports(slave)).collect();
        let upstreams = upstreams(&ports.iter().map(|(status, _)| *status).collect::<Vec<_>>());
        let slaves = described.into_iter().zip(ports).zip(upstreams).map(|((slave, (ports, port_types)), upstream)| {
            let status = AlStatusRegister(slave.state.0.into());
            let bytes = |bytes: u32| is_laid_out.then_some(u16::try_from(bytes).unwrap_or(u16::MAX));
            let identity =
                SiiIdentity { vendor: slave.vendor, product: slave.product, revision: slave.revision, serial: 0 };
            FoundSlave {
                slave: slave.slave + 1,
                station: slave.station_address,
                alias: slave.alias,
                identity,
                name: slave.name,
                found: SlaveState { status, code: AlStatus(slave.al_status) },
                ports,
                port_types,
                upstream,
                entry_port: 0,
                has_clock: slave.has_dc == Some(true),
                protocols: None,
                process_bytes: (bytes(slave.output_bytes), bytes(slave.input_bytes)),
                eeprom_error: None,
            }
        });
        Ok(slaves.collect())
    }

    fn is_virtual(&self) -> bool {
        self.is_virtual
    }

    fn resets_slaves(&self) -> bool {
        false
    }

    /// \[OURS] One byte less than an SDO request of the chip can carry. A read that returns the full length may have
    /// returned only the first bytes of a longer value.
    fn value_bytes_max(&self) -> usize {
        (SDO_DATA_MAX - 1).min(self.xf.host().size().bytes().saturating_sub(SDO_HEAD))
    }

    fn wait(&mut self, time: Duration) -> Result<(), BusError> {
        Ok(self.xf.pass(time)?)
    }

    fn load(&mut self, time: Duration) -> Result<(), BusError> {
        let mut left = time;
        while !left.is_zero() {
            // Lost datagrams are no error: a bad cable loses some, and its error counters show that.
            let len = bytes_max(&self.xf);
            let _ = datagram(&mut self.xf, RawOperation::Brd, LOAD_ADDRESS, &[0; RAW_DATA_MAX][..len])?;
            let step = LOAD_INTERVAL.min(left);
            self.wait(step)?;
            left -= step;
        }
        Ok(())
    }

    fn read(&mut self, slave: u8, address: u16, data: &mut [u8]) -> Result<(), BusError> {
        let read = self.access(RawOperation::Fprd, slave, address, data)?;
        data.iter_mut().zip(read).for_each(|(to, from)| *to = from);
        Ok(())
    }

    fn write(&mut self, slave: u8, address: u16, data: &[u8]) -> Result<(), BusError> {
        self.access(RawOperation::Fpwr, slave, address, data).map(|_| ())
    }

    fn bring_to_preop(&mut self, slave: u8) -> Result<(), BusError> {
        let number = self.number(slave)?;
        if self.xf.slave_description(number.get())?.state.state() == Some(EtherCatState::Init) {
            self.xf.set_state(Slaves::One(number), EtherCatState::PreOp)?;
        }
        Ok(())
    }

    fn upload(&mut self, slave: u8, object: ObjectAddress, scope: SdoScope) -> Result<Vec<u8>, BusError> {
        self.bring_to_preop(slave)?;
        let value = self.xf.sdo_read_bytes(slave - 1, object, scope);
        value.map_err(|error| sdo_error(slave, error))
    }

    fn download(&mut self, slave: u8, object: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), BusError> {
        self.bring_to_preop(slave)?;
        self.xf.sdo_write_bytes(slave - 1, object, scope, value).map_err(|error| sdo_error(slave, error))
    }

    fn object_list(&mut self, slave: u8) -> Result<Vec<u16>, BusError> {
        mailboxes::object_list(self, slave)
    }

    fn describe_object(&mut self, slave: u8, index: u16) -> Result<Vec<u8>, BusError> {
        mailboxes::describe_object(self, slave, index)
    }

    fn describe_entry(&mut self, slave: u8, request: EntryRequest) -> Result<Vec<u8>, BusError> {
        mailboxes::describe_entry(self, slave, request)
    }

    fn read_eeprom(&mut self, slave: u8) -> Result<Vec<u8>, BusError> {
        eeprom::read_whole(self, slave)
    }

    fn read_eeprom_words(&mut self, slave: u8, first: u16, count: usize) -> Result<Vec<u16>, BusError> {
        let mut words: Vec<u16> = Vec::with_capacity(count);
        while words.len() < count {
            let Some(position) = u16::try_from(words.len()).ok().and_then(|read| first.checked_add(read)) else {
                break;
            };
            let read = self.eeprom(slave, position, EepromOperation::Read)?;
            let read = read.as_chunks().0;
            if read.is_empty() {
                return Err(BusError::Eeprom { slave, error: crate::master::SiiError::NoAnswer });
            }
            words.extend(read.iter().map(|word| u16::from_le_bytes(*word)));
        }
        words.truncate(count);
        Ok(words)
    }

    fn write_eeprom_words(&mut self, slave: u8, first: u16, words: &[u16]) -> Result<(), BusError> {
        self.expect_not_running()?;
        for (position, word) in (first..=u16::MAX).zip(words) {
            self.eeprom(slave, position, EepromOperation::Write(*word))?;
        }
        Ok(())
    }

    fn read_file(&mut self, slave: u8, name: &str, password: u32) -> Result<Vec<u8>, BusError> {
        mailboxes::read_file(self, slave, name, password)
    }

    fn write_file(&mut self, slave: u8, name: &str, password: u32, content: &[u8]) -> Result<(), BusError> {
        self.expect_not_running()?;
        mailboxes::write_file(self, slave, name, password, content)
    }

    fn reference_clock(&self) -> Option<u8> {
        None
    }

    fn ring(&self) -> Option<RingState> {
        None
    }

    fn frames(&self) -> Option<FrameCounters> {
        None
    }
}

fn sdo_error(slave: u8, error: XfError) -> BusError {
    match error {
        XfError::SdoAborted { object, abort, .. } => BusError::Sdo { slave, object, error: SdoError::Abort(abort) },
        error => error.into(),
    }
}

//! A network that an ECM-XF has, by the chip's own commands. A network that it runs is joined as it is, and nothing of it is
//! changed.

use std::time::Duration;

use super::{BusError, FoundSlave, Network, SlaveState, eeprom};
use crate::coe::{EntryRequest, ObjectAddress, SdoScope};
use crate::ethercat::AlStatus;
use crate::ethercat::registers::{AlStatusRegister, DL_STATUS, DlStatus, PORT_DESCRIPTOR};
use crate::ethercat::sii::SiiIdentity;
#[cfg(feature = "sim")]
use crate::link::chip::ChipOptions;
use crate::link::chip::{self, ChipLink};
#[cfg(feature = "sim")]
use crate::link::keys::Scheme;
use crate::link::uri::LinkUri;
use crate::master::{DatagramError, FrameCounters, SdoError, upstreams};
use crate::xf::EtherCatState;
use crate::xf::host::{HostConfig, HostError};
use crate::xf::request::{
    EepromGet, EepromOperation, EepromRequest, RAW_DATA_MAX, RawGet, RawOperation, RawRequest, SlaveNumber, Slaves,
};
use crate::xf_api::{NetworkConfig, Xf, XfError};

/// \[OURS] How long the chip may take for a datagram, and for a word of an EEPROM.
const DATAGRAM_MAX: Duration = Duration::from_millis(100);
const EEPROM_MAX: Duration = Duration::from_millis(500);
/// \[OURS] How often a datagram is sent at most that does not come back.
const TRIES: u32 = 3;
/// The working counter of one that does not.
const LOST: i32 = -1;
/// \[OURS] How often a long datagram is sent to put load on the cables. It reads what says which controller it is, where a read
/// changes nothing.
const LOAD_INTERVAL: Duration = Duration::from_millis(1);
const LOAD_ADDRESS: u16 = 0x0000;

/// A network with an ECM-XF.
pub(super) struct XfNetwork {
    xf: Xf,
    is_virtual: bool,
    stations: Vec<u16>,
}

impl XfNetwork {
    /// The network of the chip behind a link. A simulated one is in virtual time, with a controller for each slave. Nothing of it
    /// is changed.
    pub(super) fn open(uri: &LinkUri) -> Result<Self, BusError> {
        #[cfg(feature = "sim")]
        if uri.scheme() == Scheme::XfSim {
            let link = super::simulated::ScriptedChip::new(uri)?;
            let config = chip::host_config(&link.info(), &ChipOptions::from_uri(uri)?);
            return Self::over(Box::new(link), config);
        }
        let (link, config) = chip::open(&uri.to_string()).map_err(XfError::Link)?;
        Self::over(link, config)
    }

    fn over(link: Box<dyn ChipLink>, config: HostConfig) -> Result<Self, BusError> {
        let is_virtual = link.info().virtual_time;
        let xf = Xf::over(link, HostConfig { keep_fifo: true, ..config })?;
        Ok(Self { xf, is_virtual, stations: Vec::new() })
    }

    /// The chip's number of a slave.
    fn number(&self, slave: u8) -> Result<SlaveNumber, BusError> {
        let found = self.stations.len();
        let number = slave.checked_sub(1).filter(|place| usize::from(*place) < found).and_then(SlaveNumber::new);
        number.ok_or(BusError::NoSuchSlave { slave, found })
    }

    fn station(&self, slave: u8) -> Result<u16, BusError> {
        let place = usize::from(self.number(slave)?.get());
        Ok(self.stations[place])
    }

    fn datagram(
        &mut self,
        operation: RawOperation,
        adp: u16,
        ado: u16,
        data: &[u8],
    ) -> Result<(i32, Vec<u8>), BusError> {
        let timeout_us = i32::try_from(DATAGRAM_MAX.as_micros()).unwrap_or(i32::MAX);
        let request = RawRequest { operation, adp, ado, logical: 0, timeout_us, data };
        match self.xf.run_pair(&request, &RawGet, 2 * DATAGRAM_MAX) {
            Ok(answer) => Ok((answer.working_counter, answer.data.to_vec())),
            // It did not come back.
            Err(XfError::Chip(HostError::Failed { .. })) => Ok((LOST, Vec::new())),
            Err(error) => Err(error.into()),
        }
    }

    fn access(&mut self, operation: RawOperation, slave: u8, address: u16, data: &[u8]) -> Result<Vec<u8>, BusError> {
        let station = self.station(slave)?;
        let failed = |error| BusError::Register { slave, address, error };
        for _ in 0..TRIES {
            match self.datagram(operation, station, address, data)? {
                (1, read) => return Ok(read),
                (counter @ 0.., _) => return Err(failed(DatagramError::WorkingCounter(counter as u16))),
                (_, _) => {}
            }
        }
        Err(failed(DatagramError::Lost))
    }

    /// Refuses to write to the slaves of a network that runs.
    fn expect_rest(&self) -> Result<(), BusError> {
        match self.xf.header().state.state() {
            Some(EtherCatState::SafeOp | EtherCatState::Op) => Err(BusError::Runs { slave: 1 }),
            _ => Ok(()),
        }
    }

    fn eeprom(&mut self, slave: u8, position: u16, operation: EepromOperation) -> Result<Vec<u8>, BusError> {
        let timeout_us = u32::try_from(EEPROM_MAX.as_micros()).unwrap_or(u32::MAX);
        let request = EepromRequest { slave: self.number(slave)?, position, timeout_us, operation };
        let answer = self.xf.run_pair(&request, &EepromGet, 2 * EEPROM_MAX)?;
        match answer.error {
            0 => Ok(answer.data.to_vec()),
            error => Err(BusError::ChipEeprom { slave, error }),
        }
    }

    /// What is known of the ports: nothing if the chip sends no datagrams for others.
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

/// What an ECM-XF has no command for.
const fn cannot(what: &'static str) -> BusError {
    BusError::Cannot { what, instead: "take the slaves' cable into a network card, e.g. --link nic:eth1" }
}

impl Network for XfNetwork {
    fn scan(&mut self) -> Result<Vec<FoundSlave>, BusError> {
        let is_up = self.xf.header().state.0 & 0x0F != 0;
        let found = match is_up {
            true => self.xf.count_slaves()?,
            false => match self.xf.start_network(&NetworkConfig::default()) {
                Ok(found) => found,
                // The chip fails where it finds none.
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
        self.stations = described.iter().map(|slave| slave.station_address).collect();
        let ports: Vec<(DlStatus, u8)> = (1..=found).map(|slave| self.ports(slave)).collect();
        let upstreams = upstreams(&ports.iter().map(|(status, _)| *status).collect::<Vec<_>>());
        let slaves = described.into_iter().zip(ports).zip(upstreams).map(|((slave, (ports, port_types)), upstream)| {
            let status = AlStatusRegister(slave.state.0.into());
            let bytes = |bytes: u32| u16::try_from(bytes).unwrap_or(u16::MAX);
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

    fn wait(&mut self, time: Duration) -> Result<(), BusError> {
        Ok(self.xf.pass(time)?)
    }

    fn load(&mut self, time: Duration) -> Result<(), BusError> {
        let mut left = time;
        while !left.is_zero() {
            // Lost datagrams are what this is for.
            let _ = self.datagram(RawOperation::Brd, 0, LOAD_ADDRESS, &[0; RAW_DATA_MAX])?;
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

    fn object_list(&mut self, _: u8) -> Result<Vec<u16>, BusError> {
        Err(cannot("ask a slave for its dictionary"))
    }

    fn describe_object(&mut self, _: u8, _: u16) -> Result<Vec<u8>, BusError> {
        Err(cannot("ask a slave for its dictionary"))
    }

    fn describe_entry(&mut self, _: u8, _: EntryRequest) -> Result<Vec<u8>, BusError> {
        Err(cannot("ask a slave for its dictionary"))
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
        self.expect_rest()?;
        for (position, word) in (first..=u16::MAX).zip(words) {
            self.eeprom(slave, position, EepromOperation::Write(*word))?;
        }
        Ok(())
    }

    fn read_file(&mut self, _: u8, _: &str, _: u32) -> Result<Vec<u8>, BusError> {
        Err(cannot("read a file without its length, which passes through the chip's own flash memory"))
    }

    fn write_file(&mut self, _: u8, _: &str, _: u32, _: &[u8]) -> Result<(), BusError> {
        Err(cannot("write a file without erasing a part of the chip's own flash memory"))
    }

    fn reference_clock(&self) -> Option<u8> {
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

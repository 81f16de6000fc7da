//! SDO transfers, and the PDOs of a slave by its mapping objects.

use super::{Progress, SdoJob};
use crate::coe::{AbortCode, ObjectAddress, SdoScope};
use crate::xf::chip::Chip;
use crate::xf::chip::network::{Network, each_pdo, read_entry};
use crate::xf::request::{MappedObject, PdoConfig, PdoConfigRequest, PdoMap};

impl<N: Network> Chip<N> {
    /// A slave that does not answer is waited for until the time limit; then the abort code is that of a timeout.
    ///
    /// `[OURS]` The abort code is kept until the next transfer, and is 0 after one that succeeds.
    pub(super) fn end_sdo(&mut self, job: &SdoJob) -> Progress {
        let result = if job.deadline <= self.now { Err(AbortCode::TIMEOUT) } else { self.transfer(job) };
        match result {
            Err(AbortCode::TIMEOUT) if self.now < job.deadline => Progress::Next(job.deadline),
            Err(abort) => {
                self.sdo.abort = abort;
                Progress::Failed
            }
            Ok(()) => {
                self.sdo.abort = AbortCode(0);
                Progress::Done
            }
        }
    }

    /// `[OURS]` Of a value that is longer than the bytes asked for, these are given; 0 asks for all that a data segment
    /// holds.
    fn transfer(&mut self, job: &SdoJob) -> Result<(), AbortCode> {
        if let Some(code) = self.network.sdo_abort(job.slave, job.object) {
            return Err(code);
        }
        if job.writes {
            return self.network.write(job.slave, job.object, job.scope, &job.data[..job.bytes]);
        }
        let room = self.sdo.data.len();
        let asked = if job.bytes == 0 { room } else { job.bytes.min(room) };
        let len = self.network.read(job.slave, job.object, job.scope, &mut self.sdo.data[..asked])?;
        self.sdo.len = Some(len.min(asked));
        Ok(())
    }

    pub(super) fn end_pdo_config_set(&mut self, config: &PdoConfig) -> Progress {
        let set = self.set_pdos(config);
        self.end_pdo_transfer(set)
    }

    pub(super) fn end_pdo_config_request(&mut self, request: &PdoConfigRequest) -> Progress {
        let read = self.read_pdos(request).map(|config| self.pdo_config = Some(config));
        self.end_pdo_transfer(read)
    }

    /// `[OURS]` A mapping that fails leaves the abort code of its SDO.
    fn end_pdo_transfer(&mut self, result: Result<(), AbortCode>) -> Progress {
        self.sdo.abort = result.err().unwrap_or(AbortCode(0));
        if result.is_ok() { Progress::Done } else { Progress::Failed }
    }

    /// The usual order of CoE: the assignment is emptied, then each PDO is, filled and counted, then they are assigned.
    ///
    /// `[OURS]` A PDO without objects is assigned as it is, for slaves whose PDOs are fixed.
    fn set_pdos(&mut self, config: &PdoConfig) -> Result<(), AbortCode> {
        let (slave, assignment) = (config.slave.get(), config.assignment.code());
        self.write_number(slave, assignment, 0, &[0])?;
        for map in config.maps().iter().filter(|map| !map.objects().is_empty()) {
            self.write_number(slave, map.index(), 0, &[0])?;
            for (sub, object) in (1..).zip(map.objects()) {
                self.write_number(slave, map.index(), sub, &object.to_bytes())?;
            }
            self.write_number(slave, map.index(), 0, &[map.objects().len() as u8])?;
        }
        for (sub, map) in (1..).zip(config.maps()) {
            self.write_number(slave, assignment, sub, &map.index().to_le_bytes())?;
        }
        self.write_number(slave, assignment, 0, &[config.maps().len() as u8])
    }

    fn write_number(&mut self, slave: u8, index: u16, sub: u8, value: &[u8]) -> Result<(), AbortCode> {
        self.network.write(slave, ObjectAddress::new(index, sub), SdoScope::Entry, value)
    }

    /// `[OURS]` More PDOs or objects than the answer has room for are an error, with abort code 0x06040042.
    fn read_pdos(&mut self, request: &PdoConfigRequest) -> Result<PdoConfig, AbortCode> {
        let (mut maps, mut count) = ([PdoMap::default(); 4], 0);
        each_pdo(&mut self.network, request.slave.get(), request.assignment, |network, index, objects| {
            let mut entries = [MappedObject::default(); PdoMap::OBJECTS];
            let entries = entries.get_mut(..objects.into()).ok_or(AbortCode::PDO_LENGTH)?;
            for (sub, entry) in (1..).zip(entries.iter_mut()) {
                *entry = read_entry(network, request.slave.get(), index, sub)?;
            }
            let place = maps.get_mut(count).ok_or(AbortCode::PDO_LENGTH)?;
            *place = PdoMap::new(index, entries).ok_or(AbortCode::PDO_LENGTH)?;
            count += 1;
            Ok(())
        })?;
        PdoConfig::new(request.slave, request.assignment, self.profile.pdo_config, &maps[..count])
            .ok_or(AbortCode::PDO_LENGTH)
    }
}

//! Reading and writing objects of slaves by SDO.

use std::time::Duration;

use super::layout::FieldType;
use super::{Xf, XfError};
use crate::ethercat::coe::{ObjectAddress, SdoScope};
use crate::link::chip_link::ChipLink;
use crate::xf::host::HostError;
use crate::xf::request::{SDO_DATA_MAX, SdoGet, SdoOperation, SdoRequest};

/// How long the chip waits for the slave's answer. \[OURS]
const SDO_TIMEOUT: Duration = Duration::from_secs(1);
/// How long the driver waits for the chip, which may repeat its request to the slave. \[OURS]
const SDO_LIMIT: Duration = Duration::from_secs(5);

impl<L: ChipLink> Xf<L> {
    /// Reads an object of a slave, in PreOP, SafeOP or OP.
    ///
    /// The type has to be as long as the object. For a longer object the chip returns, as far as is known, the first
    /// bytes.
    ///
    /// # Errors
    /// [`XfError::SdoAborted`] if the slave aborts the transfer, [`XfError::SdoSize`] if the chip returns another
    /// number of bytes than the type has, [`XfError::NoSuchSlave`] if the network has no slave with this number;
    /// otherwise as with [`Xf::run`].
    pub fn sdo_read<T: FieldType>(&mut self, slave: u8, object: ObjectAddress) -> Result<T, XfError> {
        let bytes = self.upload(slave, object, SdoScope::Entry, T::BYTES as u16)?;
        let (found, wanted) = (bytes.len(), T::BYTES);
        T::from_le(bytes).ok_or(XfError::SdoSize { slave, object, found, wanted })
    }

    /// Reads an object of up to 256 bytes.
    ///
    /// # Errors
    /// As with [`Self::sdo_read`], except [`XfError::SdoSize`].
    pub fn sdo_read_bytes(&mut self, slave: u8, object: ObjectAddress, scope: SdoScope) -> Result<Vec<u8>, XfError> {
        let most = SDO_DATA_MAX.min(self.host.size().bytes());
        Ok(self.upload(slave, object, scope, most as u16)?.to_vec())
    }

    /// Writes an object of a slave, in PreOP, SafeOP or OP.
    ///
    /// # Errors
    /// [`XfError::SdoAborted`] if the slave aborts the transfer, [`XfError::NoSuchSlave`] if the network has no slave
    /// with this number; otherwise as with [`Xf::run`].
    pub fn sdo_write<T: FieldType>(&mut self, slave: u8, object: ObjectAddress, value: T) -> Result<(), XfError> {
        let mut bytes = [0; 8];
        value.put_le(&mut bytes[..T::BYTES]);
        self.sdo_write_bytes(slave, object, SdoScope::Entry, &bytes[..T::BYTES])
    }

    /// Writes an object of up to 256 bytes, and of at most n - 12 bytes, n being the size of the data segment.
    ///
    /// # Errors
    /// As with [`Self::sdo_write`].
    pub fn sdo_write_bytes(
        &mut self,
        slave: u8,
        object: ObjectAddress,
        scope: SdoScope,
        bytes: &[u8],
    ) -> Result<(), XfError> {
        let request = self.sdo(slave, object, scope, SdoOperation::Write(bytes))?;
        self.run_within(&request, SDO_LIMIT).map_err(|error| aborted(slave, object, error))
    }

    fn upload(&mut self, slave: u8, object: ObjectAddress, scope: SdoScope, bytes: u16) -> Result<&[u8], XfError> {
        let request = self.sdo(slave, object, scope, SdoOperation::Read { bytes })?;
        self.run_pair(&request, &SdoGet, SDO_LIMIT).map_err(|error| aborted(slave, object, error))
    }

    fn sdo<'d>(
        &self,
        slave: u8,
        object: ObjectAddress,
        scope: SdoScope,
        operation: SdoOperation<'d>,
    ) -> Result<SdoRequest<'d>, XfError> {
        let timeout_us = SDO_TIMEOUT.as_micros() as u32;
        Ok(SdoRequest { slave: self.slave(slave)?, object, scope, timeout_us, operation })
    }
}

fn aborted(slave: u8, object: ObjectAddress, error: XfError) -> XfError {
    match error {
        XfError::Chip(HostError::Failed { abort: Some(abort), .. }) => XfError::SdoAborted { slave, object, abort },
        error => error,
    }
}

//! CoE: the jobs that read and write objects of a slave, and those that list and describe them.
//!
//! Files: `sdo.rs` transfers a value by SDO; `information.rs` is SDO information.

mod information;
mod sdo;

pub(in crate::master) use sdo::NumberTransfer;
pub use sdo::{SdoError, VALUE_BYTES_MAX};

use crate::ethercat::Ns;
use crate::ethercat::coe::{EntryRequest, ObjectAddress, ObjectListType, SdoScope};
use crate::master::{Job, Master};

impl Master {
    /// Starts to read an object, of at most [`VALUE_BYTES_MAX`] bytes. `timeout_ns`: how long
    /// the slave may take for each answer.
    pub fn upload(
        &mut self,
        slave: u8,
        object: ObjectAddress,
        scope: SdoScope,
        timeout_ns: Ns,
    ) -> Job<Result<Vec<u8>, SdoError>> {
        self.start(sdo::upload(self.bus.clone(), self.peer(slave, timeout_ns), object, scope))
    }

    /// Starts to read an object of any length and returns its first 4 bytes as a number. The rest is not kept, so that
    /// the transfer allocates nothing. `timeout_ns`: as for [`Self::upload`].
    pub fn upload_number(
        &mut self,
        slave: u8,
        object: ObjectAddress,
        scope: SdoScope,
        timeout_ns: Ns,
    ) -> Job<Result<u32, SdoError>> {
        self.start_number(NumberTransfer::Upload, slave, object, scope, timeout_ns)
    }

    /// Starts to write an object. Values of up to 4 bytes allocate nothing. `timeout_ns`: how long the slave may take
    /// for each answer.
    pub fn download(
        &mut self,
        slave: u8,
        object: ObjectAddress,
        scope: SdoScope,
        value: &[u8],
        timeout_ns: Ns,
    ) -> Job<Result<(), SdoError>> {
        if let Some(transfer) = NumberTransfer::download(value) {
            return self.start_number(transfer, slave, object, scope, timeout_ns);
        }
        let (bus, peer, value) = (self.bus.clone(), self.peer(slave, timeout_ns), value.to_vec());
        self.start(async move { sdo::download(bus, peer, object, scope, &value).await })
    }

    /// Starts to read a list of a slave's objects. `timeout_ns`: how long the slave may take for each part of the
    /// answer.
    pub fn object_list(&mut self, slave: u8, list: ObjectListType, timeout_ns: Ns) -> Job<Result<Vec<u16>, SdoError>> {
        self.start(information::list(self.bus.clone(), self.peer(slave, timeout_ns), list))
    }

    /// Starts to read the description of an object, an encoded
    /// [`ObjectDescription`](crate::ethercat::coe::ObjectDescription).
    pub fn describe_object(&mut self, slave: u8, index: u16, timeout_ns: Ns) -> Job<Result<Vec<u8>, SdoError>> {
        self.start(information::object(self.bus.clone(), self.peer(slave, timeout_ns), index))
    }

    /// Starts to read the description of a sub-index, an encoded
    /// [`EntryDescription`](crate::ethercat::coe::EntryDescription).
    pub fn describe_entry(
        &mut self,
        slave: u8,
        request: EntryRequest,
        timeout_ns: Ns,
    ) -> Job<Result<Vec<u8>, SdoError>> {
        self.start(information::entry(self.bus.clone(), self.peer(slave, timeout_ns), request))
    }
}

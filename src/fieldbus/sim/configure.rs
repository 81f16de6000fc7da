//! Configures a simulated slave by the SDO downloads of the board. All downloads are made at one simulated time, after
//! the job has waited for the time that they would take on a network.

use crate::fieldbus::pdo::{self, ProcessData};
use crate::fieldbus::{AlState, Refusal, Role, SlaveConfig};
use crate::slave::{AlStatus, Slave};

/// Maps the process data of a slave in PreOP and writes its mode of operation. Returns the mapped process data; `None`: the
/// slave is not used. An upload shows whether a pulse module has a second axis.
///
/// # Errors
/// The refusal, with 0 in place of the slave number: the slave is not in PreOP, or has aborted a download. After an aborted
/// download nothing is mapped; a slave that is not in PreOP keeps its mapping.
pub fn configure(slave: &mut dyn Slave, config: &SlaveConfig) -> Result<Option<ProcessData>, Refusal> {
    let SlaveConfig { role, sync } = *config;
    if slave.state() != AlState::PreOp {
        return Err(Refusal::of(0, AlStatus::INVALID_CHANGE));
    }
    slave.set_sync_managers(0, 0);
    if role == Role::Unused {
        return Ok(None);
    }
    let is_there = ProcessData::probe(role).is_some_and(|object| slave.upload(object).is_ok());
    let data = ProcessData::of(role, is_there).ok_or(pdo::NO_SUCH_MODE)?;
    // Not by value: that would put several copies of the list on the stack of the program's thread, which may be small.
    let downloads = data.downloads(sync);
    for download in downloads.iter() {
        if let Err(code) = slave.download(download.object, download.size, download.value)
            && !download.may_fail_with(code)
        {
            return Err(download.refused(code));
        }
    }
    slave.set_sync_managers(data.output_bytes() as u16, data.input_bytes() as u16);
    Ok(Some(data))
}

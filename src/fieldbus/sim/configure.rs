//! The board's SDOs on the way to SafeOP, done at once: how long they take is the job's matter.

use crate::fieldbus::pdo::{self, ProcessData};
use crate::fieldbus::{AlState, Refusal, Role, SlaveConfig};
use crate::slave::{AlStatus, Slave};

/// Maps a slave's process data and writes its mode, in PreOP. What is mapped then; `None`: it is not used. Of a pulse module is
/// read how many axes it has.
///
/// # Errors
/// Why it refuses, without its number: it is not in PreOP, or it has aborted a download. Nothing is mapped then, but of a slave
/// that is not in PreOP.
pub fn configure(slave: &mut dyn Slave, config: &SlaveConfig) -> Result<Option<ProcessData>, Refusal> {
    let SlaveConfig { role, sync } = *config;
    if slave.state() != AlState::PreOp {
        let AlStatus(al_status) = AlStatus::INVALID_CHANGE;
        return Err(Refusal { slave: 0, al_status, abort: None });
    }
    slave.set_sync_managers(0, 0);
    if role == Role::Unused {
        return Ok(None);
    }
    let has_second_axis = matches!(role, Role::Hsp(_)) && slave.upload(pdo::SECOND_CONTROLWORD).is_ok();
    let data = ProcessData::of(role, has_second_axis).ok_or(pdo::NO_SUCH_MODE)?;
    for download in data.downloads(sync) {
        if let Err(code) = slave.download(download.object, download.size, download.value)
            && !download.may_fail_with(code)
        {
            return Err(download.refused(code));
        }
    }
    slave.set_sync_managers(data.output_bytes() as u16, data.input_bytes() as u16);
    Ok(Some(data))
}

//! What becomes of moving axes when their writer is gone: the server brings them to a standstill, as the native API does
//! when a program closes it.

use std::sync::Arc;

use super::OnVanish;
use super::hub::{Board, Hub};
use super::seat::{Queue, Seat};
use crate::ecm::{Close, Ecm, EcmError, Options};
use crate::link::{Link, Wait};
use crate::sk::{Frame, MasterState, SlaveCommand};

/// Brings axes to a standstill; within the limits of [`Ecm::close`].
pub(super) fn settle(hub: &Arc<Hub>, board: &Arc<Board>, queue: Arc<Queue>, who: &str) {
    let close = match hub.options.on_vanish {
        OnVanish::Leave => return hub.tell("axes are left as they are (on-vanish=leave)"),
        OnVanish::Ramp => Close::Hold,
        OnVanish::ServoOff => Close::ServoOff,
    };
    let seat = Arc::new(Seat { hub: Arc::clone(hub), board: Arc::clone(board), queue });
    if seat.check().is_err() {
        return;
    }
    match stop(&seat, close) {
        Ok(Stopped::Axes) => hub.tell(&format!("axes stand still after {who}")),
        Ok(Stopped::Nothing) => {}
        Ok(Stopped::Unknown) => hub.tell(
            "the network was configured before this server came: what moves is not known to it and goes on; \
             use the emergency stop if axes move",
        ),
        Err(error) => hub.tell(&format!("axes may still move after {who}: {error}; use the emergency stop")),
    }
}

enum Stopped {
    Axes,
    Nothing,
    Unknown,
}

fn stop(seat: &Arc<Seat>, close: Close) -> Result<Stopped, EcmError> {
    let watch = seat.board.watch();
    // Motion ends with OP: the slaves hold or are off.
    if watch.state() != Some(MasterState::Op) {
        return Ok(Stopped::Nothing);
    }
    if watch.config().is_none() {
        return Ok(Stopped::Unknown);
    }
    let options = Options { close: Close::Leave, ..Options::default() };
    let ecm = Ecm::over(Arc::clone(seat) as Arc<dyn Link>, options)?;
    let size = ecm.slot_size()?;
    let mut abort = Frame::new();
    watch.homing().for_each(|slave| abort.put_slave(size, slave, &SlaveCommand::AbortHome.into()));
    if watch.homing().next().is_some() {
        abort.fill_crc(size);
        seat.write(&abort, Wait::For(options.write_limit))?;
    }
    ecm.take_over(&watch)?;
    // How fast axes move shows between two reports.
    ecm.next_cycle(options.read_limit)?;
    ecm.close(close)?;
    Ok(Stopped::Axes)
}

//! The scan: which slaves there are, who they are, and their station addresses.

use super::bus::{Bus, Unanswered, join};
use super::exchange::Lost;
use super::topology::{Upstream, is_open, loose_ends, upstreams};
use super::{SlaveInfo, clocks, sii, states, watchdog};
use crate::ethercat::registers::{
    AL_CONTROL, AL_STATUS, AlControl, AlStatusWithCode, CYCLIC_UNIT_CONTROL, DL_CONTROL, DL_STATUS, DlControl,
    DlStatus, ESC_WRITE_ENABLE, FEATURES, FMMU, FMMU_LEN, FMMUS, Features, LoopControl, RequestedState,
    SII_CONFIGURATION, SPEED_COUNTER_START, STATION_ADDRESS, STATION_ALIAS, SYNC_MANAGER, SYNC_MANAGER_LEN,
    SYNC_MANAGERS, TIME_DIFFERENCE_FILTER, TYPE, WATCHDOG_DIVIDER, WATCHDOG_PROCESS_DATA, WRITE_REGISTER_ENABLE,
};
use crate::ethercat::{AlState, Command, MAX_SLAVES, Ns};

/// The station address of the first slave; those of others follow (most masters give these).
pub(super) const FIRST_STATION: u16 = 0x1001;
/// \[OURS] How long slaves may take to enter Init.
const INIT_MAX_NS: Ns = 2_000_000_000;

/// \[OURS] How often the ports are opened in a row, each time with all tries, while no frame comes back: one that is open without a link
/// loses the frame behind its slave, which has had it.
const LOST_MAX: u32 = 2;

/// Why a scan has failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ScanError {
    /// A frame did not come back in the course of the scan.
    #[error("frames get lost during the scan; check the cables")]
    Lost,
    /// There are more slaves than the master can have.
    #[error("{found} slaves are connected, and the master has room for {MAX_SLAVES}; connect fewer")]
    TooMany {
        /// How many slaves were found.
        found: u16,
    },
    /// The number of slaves has changed in the course of the scan.
    #[error("{first} slaves were counted, then {then}; check the cables and the slaves' power, and scan again")]
    Changed {
        /// How many slaves were counted first.
        first: u16,
        /// How many were counted then.
        then: u16,
    },
}

impl From<Lost> for ScanError {
    fn from(_: Lost) -> Self {
        Self::Lost
    }
}

/// How many slaves are connected; 0, too, if no frame comes back.
async fn count(bus: &Bus) -> u16 {
    bus.exchange(Command::Brd, 0, TYPE, &mut [0]).await.unwrap_or(0)
}

/// Opens the ports of all slaves as at power-on, behind which others may be hidden whose ports are closed, too; how many slaves there
/// are then.
async fn uncover(bus: &Bus) -> u16 {
    let (mut found, mut lost) = (None, 0);
    for _ in 0..=MAX_SLAVES {
        match uncover_next(bus).await {
            Ok(seen) if found == Some(seen) => break,
            Ok(seen) => found = Some(seen),
            Err(Lost) if lost < LOST_MAX => lost += 1,
            Err(Lost) => break,
        }
    }
    found.unwrap_or(0)
}

/// Lets all slaves that frames reach be written, opens their ports, and has them hear their station address alone; how many they are
/// before that.
async fn uncover_next(bus: &Bus) -> Result<u16, Lost> {
    // Ports as their links are, for good: all slaves destroy frames of others, as they come.
    const AUTOMATIC: [u8; 2] = [DlControl::DESTROYS_OTHERS as u8, 0];
    const WITHOUT_ALIAS: [u8; 1] = [0];
    let count = bus.queue(Command::Brd, 0, TYPE, &[0]);
    bus.write_all_of([
        // Protection ends in the frame that has given leave to write: that is the byte before.
        (ESC_WRITE_ENABLE, &[0; 2]),
        (WRITE_REGISTER_ENABLE, &[0; 2]),
        (DL_CONTROL, &AUTOMATIC),
        (DL_CONTROL + 3, &WITHOUT_ALIAS),
    ])
    .await?;
    count.answer(&mut [0]).await
}

/// Finds the slaves. All of them go to Init and lose what they were configured with.
pub(super) async fn scan(bus: Bus) -> Result<Vec<SlaveInfo>, ScanError> {
    let found = uncover(&bus).await;
    if found == 0 {
        return Ok(Vec::new());
    }
    if usize::from(found) > MAX_SLAVES {
        return Err(ScanError::TooMany { found });
    }
    reset(&bus).await?;
    for position in 0..found {
        let station = (FIRST_STATION + position).to_le_bytes();
        bus.exchange(Command::Apwr, position.wrapping_neg(), STATION_ADDRESS, &mut station.clone()).await?;
    }
    let slaves = join((0..found).map(|position| identify(&bus, FIRST_STATION + position))).await;
    let slaves: Result<Vec<SlaveInfo>, _> = slaves.into_iter().collect();
    let then = count(&bus).await;
    if then != found {
        return Err(ScanError::Changed { first: found, then });
    }
    let mut slaves = slaves.map_err(|_| ScanError::Lost)?;
    let ports: Vec<DlStatus> = slaves.iter().map(|slave| slave.ports).collect();
    slaves.iter_mut().zip(upstreams(&ports)).for_each(|(slave, upstream)| slave.upstream = upstream);
    bus.with(|shared| shared.begin(&slaves));
    let clocks = bus.with(|shared| shared.clocks.all);
    if !clocks.is_empty() {
        // In a ring a frame does not come back the way that it went, and only a way back tells how long it is. If the ring is
        // broken already, slaves behind the gap are reached by that end alone.
        let mut ends = if ports.iter().all(|ports| is_open(*ports, 0)) { loose_ends(&ports) } else { Vec::new() };
        if !ends.is_empty() {
            let entries = clocks::entries(&bus).await?;
            slaves.iter_mut().zip(&entries).for_each(|(slave, port)| slave.entry_port = *port);
            // Where IN and OUT are swapped frames come in by such a port, and no frame would come back any more.
            ends.retain(|end| entries.get(usize::from(end.slave) - 1) != Some(&end.port));
        }
        close(&bus, &slaves, &ends, true).await?;
        bus.with(|shared| ends.iter().for_each(|end| shared.clocks.close(*end)));
        let set = clocks::set(&bus, clocks).await;
        close(&bus, &slaves, &ends, false).await?;
        let measured = set?;
        let delays = measured.delays().to_vec();
        if ends.is_empty() {
            slaves.iter_mut().zip(measured.entries()).for_each(|(slave, port)| slave.entry_port = port);
        }
        drop(measured);
        bus.with(|shared| shared.clocks.ring_delays = Some(delays).filter(|_| !ends.is_empty()));
    }
    Ok(slaves)
}

/// Closes ports of slaves, or lets them be open again by themselves.
async fn close(bus: &Bus, slaves: &[SlaveInfo], ends: &[Upstream], is_closed: bool) -> Result<(), Lost> {
    for Upstream { slave, port } in ends {
        let Some(SlaveInfo { station, .. }) = slaves.get(usize::from(*slave) - 1) else { continue };
        let Ok(control) = bus.read(*station, DL_CONTROL).await else { return Err(Lost) };
        let loops = if is_closed { LoopControl::Closed } else { LoopControl::Auto };
        let control = DlControl(u32::from_le_bytes(control)).with_loop(usize::from(*port), loops);
        // The answer to a write that closes a port may be lost with the frame that was there.
        let _ = bus.queue(Command::Fpwr, *station, DL_CONTROL, &control.0.to_le_bytes()).answer(&mut []).await?;
    }
    Ok(())
}

/// Brings all slaves to Init, without addresses and without a configuration, whatever another master has left there.
async fn reset(bus: &Bus) -> Result<(), Lost> {
    let init = AlControl::request(RequestedState::State(AlState::Init)).with(AlControl::ACKNOWLEDGE);
    bus.write_all_of([
        (AL_CONTROL, &init.0.to_le_bytes()),
        (STATION_ADDRESS, &[0; 2]),
        (FMMU, &[0; 16 * FMMU_LEN]),
        (SYNC_MANAGER, &[0; 16 * SYNC_MANAGER_LEN]),
        // The units for SYNC are off, and the master's.
        (CYCLIC_UNIT_CONTROL, &[0; 2]),
        // As all known masters set the filters of the clocks; and receive times are those of frames that come by port 0.
        (TIME_DIFFERENCE_FILTER, &[0x00, 0x0C, 0x00]),
        (SPEED_COUNTER_START, &0x1000_u16.to_le_bytes()),
        (WATCHDOG_DIVIDER, &watchdog::DIVIDER.to_le_bytes()),
        (WATCHDOG_PROCESS_DATA, &watchdog::UNITS.to_le_bytes()),
        (SII_CONFIGURATION, &[2]),
    ])
    .await?;
    bus.write_all(SII_CONFIGURATION, &[0]).await?;
    Ok(())
}

/// What there is to know about a slave.
async fn identify(bus: &Bus, station: u16) -> Result<SlaveInfo, Unanswered> {
    let until = bus.now() + INIT_MAX_NS;
    loop {
        let status = AlStatusWithCode::decode(&bus.read(station, AL_STATUS).await?).status;
        // One that stays elsewhere says so when it is asked for a state.
        if status.state() == RequestedState::State(AlState::Init) || bus.now() >= until {
            break;
        }
        bus.sleep(states::STATE_POLL_NS).await;
    }
    states::take_acknowledgement_back(bus, station).await?;
    let [fmmus] = bus.read(station, FMMUS).await?;
    let [sync_managers] = bus.read(station, SYNC_MANAGERS).await?;
    let features = Features(u16::from_le_bytes(bus.read(station, FEATURES).await?));
    let alias = u16::from_le_bytes(bus.read(station, STATION_ALIAS).await?);
    let ports = DlStatus(u16::from_le_bytes(bus.read(station, DL_STATUS).await?));
    let mut info = SlaveInfo::new(station, sii::read(bus, station).await);
    if info.assumes_managers() {
        for list in [&mut info.outputs, &mut info.inputs] {
            list.retain(|one| one.number < sync_managers);
        }
    }
    let lacks_lrw = info.lacks_lrw || features.contains(Features::NO_LRW);
    Ok(SlaveInfo { alias, features, fmmus, sync_managers, ports, lacks_lrw, ..info })
}

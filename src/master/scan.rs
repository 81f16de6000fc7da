//! The scan: finds the slaves, identifies them, and assigns station addresses.

use super::bus::{Bus, Unanswered, join};
use super::exchange::Lost;
use super::topology::{Upstream, is_open, loose_ends, upstreams};
use super::{SlaveInfo, clocks, sii, states, watchdog};
use crate::ethercat::registers::{
    AL_CONTROL, AL_STATUS, AlControl, AlStatusWithCode, CYCLIC_UNIT_CONTROL, DL_CONTROL, DL_STATUS, DlControl,
    DlStatus, ESC_WRITE_ENABLE, FEATURES, FMMU, FMMU_LEN, FMMUS, Features, LoopControl, RequestedState,
    SII_CONFIGURATION, SPEED_COUNTER_START, STATION_ADDRESS, STATION_ALIAS, SYNC_MANAGER, SYNC_MANAGER_LEN,
    SYNC_MANAGERS, SYSTEM_TIME, TIME_DIFFERENCE_FILTER, TYPE, WATCHDOG_DIVIDER, WATCHDOG_PROCESS_DATA,
    WRITE_REGISTER_ENABLE,
};
use crate::ethercat::{AlState, Command, MAX_SLAVES, Ns};

/// The station address of the first slave; the others follow in network order. Most masters assign these.
pub(super) const FIRST_STATION: u16 = 0x1001;
/// \[OURS] How long slaves may take to reach Init.
const INIT_MAX_NS: Ns = 2_000_000_000;
/// \[OURS] How long the device of a slave may take to read the last request of an earlier master. Until then the controller
/// takes no request for Init.
const UNREAD_MAX_NS: Ns = 100_000_000;

/// \[OURS] How often the scan tries again to open all ports after no frame has come back in any of
/// [`Settings::tries`](super::Settings::tries). A slave that opens a port without a link executes the write, but loses
/// the frame that carried it; so the next attempt may succeed.
const LOST_MAX: u32 = 2;

/// Why a scan has failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ScanError {
    /// A frame was lost during the scan.
    #[error("frames get lost during the scan; check the cables")]
    Lost,
    /// There are more slaves than the master supports.
    #[error("{found} slaves are connected, and the master has room for {MAX_SLAVES}; connect fewer")]
    TooMany {
        /// The number of slaves found.
        found: u16,
    },
    /// The number of slaves has changed during the scan.
    #[error("{first} slaves were counted, then {then}; check the cables and the slaves' power, and scan again")]
    Changed {
        /// The number of slaves at the first count.
        first: u16,
        /// The number of slaves at the later count.
        then: u16,
    },
}

impl From<Lost> for ScanError {
    fn from(_: Lost) -> Self {
        Self::Lost
    }
}

/// The number of connected slaves; also 0 if no frame comes back.
async fn count(bus: &Bus) -> u16 {
    bus.exchange(Command::Brd, 0, TYPE, &mut [0]).await.unwrap_or(0)
}

/// Opens the ports of all slaves, as at power-on, until no further slaves appear: slaves behind a closed port may have
/// closed ports, too. Returns the number of slaves that can be reached after that.
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

/// Makes all reachable slaves writable, opens their ports, and disables their alias addresses. Returns the number of
/// slaves reachable before.
async fn uncover_next(bus: &Bus) -> Result<u16, Lost> {
    // All ports automatic, permanently, and frames without EtherCAT are destroyed, as after power-on.
    const AUTOMATIC: [u8; 2] = [DlControl::DESTROYS_OTHERS as u8, 0];
    const WITHOUT_ALIAS: [u8; 1] = [0];
    let count = bus.queue(Command::Brd, 0, TYPE, &[0]);
    bus.write_all_of([
        // Each write has two bytes: the first one (0x0030, 0x0020) enables writes within this frame, the second one
        // (0x0031, 0x0021) ends the write protection.
        (ESC_WRITE_ENABLE, &[0; 2]),
        (WRITE_REGISTER_ENABLE, &[0; 2]),
        (DL_CONTROL, &AUTOMATIC),
        (DL_CONTROL + 3, &WITHOUT_ALIAS),
    ])
    .await?;
    count.answer(&mut [0]).await
}

/// Finds the slaves. All of them go to Init, and their configuration is deleted.
pub(super) async fn scan(bus: Bus) -> Result<Vec<SlaveInfo>, ScanError> {
    let found = uncover(&bus).await;
    if found == 0 {
        return Ok(Vec::new());
    }
    if usize::from(found) > MAX_SLAVES {
        return Err(ScanError::TooMany { found });
    }
    let is_init_requested = reset(&bus).await? == found;
    for position in 0..found {
        let station = (FIRST_STATION + position).to_le_bytes();
        bus.exchange(Command::Apwr, position.wrapping_neg(), STATION_ADDRESS, &mut station.clone()).await?;
    }
    let slaves = join((0..found).map(|position| identify(&bus, FIRST_STATION + position, is_init_requested))).await;
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
        // In a closed ring a frame returns by another path than it went, but delays are measured with frames that
        // return by the same path. So the ring is opened by closing the ports `ends`. If the ring is broken already, no
        // port is closed, because the slaves beyond the gap can be reached only by that end.
        let mut ends = if ports.iter().all(|ports| is_open(*ports, 0)) { loose_ends(&ports) } else { Vec::new() };
        if !ends.is_empty() {
            let entries = clocks::entries(&bus).await?;
            slaves.iter_mut().zip(&entries).for_each(|(slave, port)| slave.entry_port = *port);
            // If IN and OUT are swapped, frames enter the slave by this port: closing it would stop all frames.
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

/// Closes the ports `ends`, or makes them automatic again if not `is_closed`.
async fn close(bus: &Bus, slaves: &[SlaveInfo], ends: &[Upstream], is_closed: bool) -> Result<(), Lost> {
    for Upstream { slave, port } in ends {
        let Some(SlaveInfo { station, .. }) = slaves.get(usize::from(*slave) - 1) else { continue };
        let Ok(control) = bus.read(*station, DL_CONTROL).await else { return Err(Lost) };
        let loops = if is_closed { LoopControl::Closed } else { LoopControl::Auto };
        let control = DlControl(u32::from_le_bytes(control)).with_loop(usize::from(*port), loops);
        // Closing a port may destroy the very frame that would come back with the answer. The write is then repeated.
        // Its working counter is not used.
        let _ = bus.queue(Command::Fpwr, *station, DL_CONTROL, &control.0.to_le_bytes()).answer(&mut []).await?;
    }
    Ok(())
}

/// Brings all slaves to Init without addresses and without configuration, whatever another master has left in them.
/// Returns how many slaves have taken the request for Init.
async fn reset(bus: &Bus) -> Result<u16, Lost> {
    let init = AlControl::request(RequestedState::State(AlState::Init)).with(AlControl::ACKNOWLEDGE);
    let taken = bus.queue(Command::Bwr, 0, AL_CONTROL, &init.0.to_le_bytes());
    bus.write_all_of([
        (STATION_ADDRESS, &[0; 2]),
        (FMMU, &[0; 16 * FMMU_LEN]),
        (SYNC_MANAGER, &[0; 16 * SYNC_MANAGER_LEN]),
        // SYNC signals are off, and the master controls the SYNC unit.
        (CYCLIC_UNIT_CONTROL, &[0; 2]),
        // The filter depths that all known masters write. The last byte (0x0936) is 0: receive times are those of frames
        // that enter by port 0.
        (TIME_DIFFERENCE_FILTER, &[0x00, 0x0C, 0x00]),
        (SPEED_COUNTER_START, &0x1000_u16.to_le_bytes()),
        (WATCHDOG_DIVIDER, &watchdog::DIVIDER.to_le_bytes()),
        (WATCHDOG_PROCESS_DATA, &watchdog::UNITS.to_le_bytes()),
        (SII_CONFIGURATION, &[2]),
    ])
    .await?;
    bus.write_all(SII_CONFIGURATION, &[0]).await?;
    taken.answer(&mut []).await
}

/// Reads the registers and the EEPROM of a slave that has just got its station address. `is_init_requested`: whether each
/// slave has taken the request for Init.
async fn identify(bus: &Bus, station: u16, is_init_requested: bool) -> Result<SlaveInfo, Unanswered> {
    if !is_init_requested {
        states::request_init(bus, station, bus.now() + UNREAD_MAX_NS).await?;
    }
    let until = bus.now() + INIT_MAX_NS;
    loop {
        let status = AlStatusWithCode::decode(&bus.read(station, AL_STATUS).await?).status;
        // A slave that does not reach Init reports an error later, when a change of state is requested.
        if status.state() == RequestedState::State(AlState::Init) || bus.now() >= until {
            break;
        }
        bus.sleep(states::STATE_POLL_NS).await;
    }
    states::take_acknowledgement_back(bus, station).await?;
    let [fmmus] = bus.read(station, FMMUS).await?;
    let [sync_managers] = bus.read(station, SYNC_MANAGERS).await?;
    let mut features = Features(u16::from_le_bytes(bus.read(station, FEATURES).await?));
    // Some controllers with this feature have receive times alone, for the measurement of delays, and no clock that could
    // be set.
    if features.contains(Features::CLOCK) && bus.read::<4>(station, SYSTEM_TIME).await == Err(Unanswered::Counter(0)) {
        features = features.without(Features::CLOCK);
    }
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

//! Measures the round-trip times of frames on a network card: to its slaves and back.

use std::time::Duration;

use super::BusError;
use crate::address::uri::LinkUri;
use crate::ethercat::Command;
use crate::ethercat::registers::AL_STATUS;
use crate::fieldbus::nic::NicWires;
use crate::master::{Master, Settings};
use crate::own_board::nic::{CardWires, wires};

/// \[OURS] Longest wait for a frame between two polls of the master, ns.
const TURN_NS: u64 = 1_000_000;

/// The round-trip times of the frames of one measurement. Percentiles are nearest ranks, so each is a measured value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RoundTrips {
    /// The number of slaves on the network: the working counter of the last frame that came back.
    pub slaves: u16,
    /// The number of frames that did not come back.
    pub lost: u32,
    /// The median round-trip time.
    pub p50: Duration,
    /// The 99th percentile of the round-trip times.
    pub p99: Duration,
    /// The longest round-trip time.
    pub max: Duration,
}

impl RoundTrips {
    /// The percentiles of the measured times; `None` if there are none.
    fn of(slaves: u16, lost: u32, mut took: Vec<Duration>) -> Option<Self> {
        took.sort_unstable();
        let max = *took.last()?;
        let rank = |percent: usize| took[(took.len() * percent).div_ceil(100).max(1) - 1];
        Some(Self { slaves, lost, p50: rank(50), p99: rank(99), max })
    }
}

/// Sends `times` frames to the slaves of a link `nic:`, one after the other, and measures their round-trip times. The
/// frames only read AL states. `None` if no frame came back: if the first three are lost, no more are sent. The checks of
/// `nic:` come first: nothing is sent on a card that another program has, that belongs to another network, or on which
/// another master sends.
///
/// # Errors
/// [`BusError::Link`]: the network card cannot be opened, or a check refuses it.
pub fn round_trips(link: &LinkUri, times: u32) -> Result<Option<RoundTrips>, BusError> {
    Ok(match wires(link)? {
        (CardWires::Line(card), settings) => measure(card, settings, times),
        (CardWires::Ring(ring), settings) => measure(ring, settings, times),
    })
}

fn measure(mut wires: impl NicWires, settings: Settings, times: u32) -> Option<RoundTrips> {
    let mut master = Master::new(settings);
    let (mut took, mut lost, mut slaves) = (Vec::with_capacity(times as usize), 0, 0);
    for _ in 0..times {
        let begin = wires.now();
        let job = master.datagram(Command::Brd, u32::from(AL_STATUS) << 16, &[0; 2]);
        let answer = loop {
            master.poll(wires.now(), &mut wires);
            if let Some(answer) = master.take(job) {
                break answer;
            }
            wires.wait(wires.now().saturating_add(TURN_NS));
        };
        match answer {
            Ok(answer) => {
                slaves = answer.working_counter;
                took.push(Duration::from_nanos(wires.now() - begin));
            }
            Err(_) => lost += 1,
        }
        if took.is_empty() && lost >= 3 {
            return None;
        }
    }
    RoundTrips::of(slaves, lost, took)
}

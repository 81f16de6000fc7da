//! How long frames take to the slaves at the end of a network card and back.

use std::time::Duration;

use super::BusError;
use crate::address::uri::LinkUri;
use crate::ethercat::Command;
use crate::ethercat::registers::AL_STATUS;
use crate::fieldbus::nic::NicWires;
use crate::master::{Master, Settings};
use crate::own_board::nic::{Wires, wires};

/// \[OURS] How long a poll waits for a frame at most, ns.
const TURN_NS: u64 = 1_000_000;

/// How long frames took, by nearest ranks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RoundTrips {
    /// How many slaves they have passed.
    pub slaves: u16,
    /// How many did not come back.
    pub lost: u32,
    /// The median.
    pub p50: Duration,
    /// The 99th percentile.
    pub p99: Duration,
    /// The greatest value.
    pub max: Duration,
}

impl RoundTrips {
    /// What of these times is told; `None`: there are none.
    fn of(slaves: u16, lost: u32, mut took: Vec<Duration>) -> Option<Self> {
        took.sort_unstable();
        let max = *took.last()?;
        let rank = |percent: usize| took[(took.len() * percent).div_ceil(100).max(1) - 1];
        Some(Self { slaves, lost, p50: rank(50), p99: rank(99), max })
    }
}

/// Sends that many frames to the slaves of a link `nic:`, which read their AL states, one after the other; `None`: none came back.
/// Nothing of a slave is changed. The checks of `nic:` come first: on a card that other programs have, that people use, or on
/// which another master sends, nothing is sent.
///
/// # Errors
/// [`BusError::Link`]
pub fn round_trips(link: &LinkUri, times: u32) -> Result<Option<RoundTrips>, BusError> {
    Ok(match wires(link)? {
        (Wires::Line(card), settings) => measure(card, settings, times),
        (Wires::Ring(ring), settings) => measure(ring, settings, times),
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

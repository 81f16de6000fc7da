//! Random frames in a row against one board of every kind of network, with the checks of `random` after each.
//!
//! The test sends a share; `cargo xtask soak` sends 100,000 to each. One network again:
//! `ECMSK_SOAK_FIRST=<seed> ECMSK_SOAK_FRAMES=<frames>`.

use ecmsk::engine::{EngineConfig, Firmware};
use ecmsk::fieldbus::Fieldbus;
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::sk::SlotSize::{self, Bytes12, Bytes16};

use crate::models::MODELS;
use crate::models::Model::{self, *};
use crate::random::{Run, Totals};
use support::ahead_bus::{Ahead, AheadBus};
use support::dice::Dice;
use support::swift::SWIFT;

/// A network and the board at it.
struct Network {
    name: &'static str,
    size: SlotSize,
    firmware: Firmware,
    /// The slaves: these models, repeated.
    of: &'static [Model],
    slaves: usize,
    ahead: Option<Ahead>,
    /// Whether the cable is cut and healed, and slaves come and go.
    breaks: bool,
}

const AHEAD: Option<Ahead> = Some(Ahead::kind(64, 4, 333_333, 700));

const fn network(
    name: &'static str,
    (size, firmware): (SlotSize, Firmware),
    of: &'static [Model],
    slaves: usize,
) -> Network {
    Network { name, size, firmware, of, slaves, ahead: None, breaks: false }
}

const NETWORKS: [Network; 14] = [
    network("drives", (Bytes12, Firmware::V17), &[Servo], 4),
    network("drives", (Bytes16, Firmware::V15), &[Servo], 4),
    network("IO", (Bytes12, Firmware::V15), &[Io], 4),
    network("IO", (Bytes16, Firmware::V17), &[Io], 4),
    network("pulse modules", (Bytes12, Firmware::V17), &[Hsp, Hsp2], 4),
    network("pulse modules", (Bytes16, Firmware::V17), &[Hsp2, Hsp], 4),
    network("pulse modules", (Bytes16, Firmware::V15), &[Hsp2], 3),
    network("steppers", (Bytes12, Firmware::V15), &[Step], 3),
    network("steppers", (Bytes16, Firmware::V17), &[Step], 3),
    network("all kinds", (Bytes12, Firmware::V17), &MODELS, 40),
    network("all kinds", (Bytes16, Firmware::V15), &MODELS, 30),
    Network { ahead: AHEAD, ..network("a bus that takes ahead", (Bytes12, Firmware::V15), &MODELS, 10) },
    Network {
        ahead: Some(Ahead::kind(8, 1, 999_999, 0)),
        ..network("a bus that takes ahead", (Bytes16, Firmware::V17), &[Hsp2, Servo], 4)
    },
    Network {
        ahead: Some(Ahead::kind(16, 3, 333_333, 700)),
        breaks: true,
        ..network("a bus that takes ahead and breaks", (Bytes12, Firmware::V17), &MODELS, 5)
    },
];

/// Frames for each network by default.
const SHARE: u64 = 1000;

fn asked(variable: &str) -> Option<u64> {
    let text = std::env::var(variable).ok()?;
    Some(text.parse().unwrap_or_else(|_| panic!("{variable} is `{text}`, not a number")))
}

/// Frames in a row against one network.
fn throw(network: &Network, seed: u64, frames: u64, all: &mut Totals) -> Totals {
    let models: Vec<Model> = network.of.iter().copied().cycle().take(network.slaves).collect();
    let bus = SimBus::new(models.iter().map(|model| model.build()).collect()).with_timing(SWIFT);
    let handle = bus.handle();
    let bus: Box<dyn Fieldbus> = match network.ahead {
        Some(how) => Box::new(AheadBus::new(bus, how)),
        None => Box::new(bus),
    };
    let config = EngineConfig {
        slot: network.size,
        firmware: network.firmware,
        state_timeout_ns: 400_000_000,
        ..EngineConfig::default()
    };
    let what = format!("{}, {:?}, {:?}, seed {seed}", network.name, network.size, network.firmware);
    let mut run = Run::new(config, bus, models.iter().map(|model| model.kind()).collect(), what);
    let mut dice = Dice(seed);
    run.switch_crc(dice.pick(&[0x00, 0x01, 0x10, 0x11]));
    let start = run.board.engine().counters().frames;
    while run.board.engine().counters().frames - start < frames {
        run.step(&mut dice, &handle, network.breaks);
    }
    let mut totals = Totals::default();
    totals.add(&run);
    all.add(&run);
    totals
}

/// SK-4.44 SK-2.9 SK-2.10 SK-2.20 SK-2.21 SK-3.2 SK-3.7 SK-5.7 SK-5.8 For all frames and slaves, in both sizes of a
/// slot, with both firmwares and on both kinds of bus: nothing panics, every report is sound, every frame is executed
/// or counted.
#[test]
fn random_frames_against_every_network() {
    let frames = asked("ECMSK_SOAK_FRAMES").unwrap_or(SHARE);
    let first = asked("ECMSK_SOAK_FIRST").unwrap_or(0);
    let mut all = Totals::default();
    for (network, seed) in NETWORKS.iter().zip(first..) {
        let started = std::time::Instant::now();
        let totals = throw(network, seed, frames, &mut all);
        println!(
            "{} x {} ({:?}, {:?}): {totals:?} in {:.1} s",
            network.slaves,
            network.name,
            network.size,
            network.firmware,
            started.elapsed().as_secs_f64()
        );
    }
    // There were enough executed, dropped and lost frames.
    all.at_least(&[frames, frames / 2, frames / 10, frames / 10, 1, frames / 50, 0]);
}

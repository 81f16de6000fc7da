//! How a chip has to be set up for a network and its host: `ahead=`, the packets, the links.

use super::Setting;
use super::chip::Needs;
use super::network::Network;
use super::row::{Row, Verdict};
use super::start::Start;
use super::survey::Survey;
use super::timing::{HostTiming, Stall};
use super::usage::{Subject, Usage};
use crate::fieldbus::xf::XfBusOptions;
use crate::recording::Clock;
use crate::sk::{CommandId, SlotSize};

/// The key of a link for the board's own inputs, if the program uses them. The pins of the chip are an example.
const LOCAL_IN: &str = "&local_in=6,7,8,9,10,11";
/// The key of a link for the board's own outputs, if the program uses them. The pins of the chip are an example.
const LOCAL_OUT: &str = "&local_out=0,1,2,3,4,5";

/// How many cycles of a stall the outputs in the chip have to bridge.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ahead {
    /// The host's longest stall; `None` if there was none, or if nothing is known.
    pub stall: Option<Stall>,
    /// Whether the frames show the host's timing. They do not on a virtual clock, or if the program was never in OP.
    pub is_known: bool,
    /// The length of the stall in cycles, rounded up.
    pub stall_cycles: u16,
    /// The number of process images that a board over the chip keeps in the chip's FIFO in addition to those of
    /// `ahead=`. It needs them because it learns the FIFO level late: from answers that are some cycles old.
    pub transport_sets: u16,
    /// The value for `ahead=`: the cycles of the stall, at least the default, and at most what fits into the chip's
    /// FIFO.
    pub value: u16,
    /// Whether the stall is bridged: by the default, by a larger `ahead=`, or not at all.
    pub verdict: Verdict,
}

/// The links with which the program opens a chip.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Links {
    /// The link to the chip on the machine. The line of INT0 (24) is only an example. So are the pins of the board's
    /// own inputs and outputs, which the link has if the program uses them.
    pub machine: String,
    /// The link to a model of the chip whose simulated slaves are of the same kinds as the recorded ones.
    pub model: String,
}

/// How a chip has to be set up for the network of a program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Plan {
    /// The slaves that the program declares, which the chip has to serve.
    pub network: Network,
    /// What the chip needs to exchange the process data of that network: packets, SPI clock, FIFO entries.
    pub needs: Needs,
    /// How many cycles of a host stall the outputs in the chip have to bridge.
    pub ahead: Ahead,
    /// How long the start to OP took in the recording, and how long it takes over a chip.
    pub start: Start,
    /// The links to the chip and to its model, with all settings of this plan as keys.
    pub links: Links,
}

impl Plan {
    pub(super) fn of(network: &Network, survey: &Survey, setting: &Setting) -> Self {
        let needs = Needs::of(network, setting.clock_hz);
        let ahead = Ahead::of(&needs, survey.timing(), setting);
        let start = Start::of(network, survey.way.longest());
        let links = Links::of(network, &needs, &ahead, &start, &survey.usage, setting);
        Self { network: *network, needs, ahead, start, links }
    }
}

impl Ahead {
    fn of(needs: &Needs, timing: &HostTiming, setting: &Setting) -> Self {
        let cycle_ns = i64::from(needs.cycle.us()) * 1000;
        let is_known = setting.clock == Clock::Real && timing.op_ns > 0;
        let stall = if is_known { timing.stall(cycle_ns) } else { None };
        let stall_cycles = stall.map_or(0, |stall| (stall.ns + cycle_ns - 1) / cycle_ns);
        let stall_cycles = u16::try_from(stall_cycles).unwrap_or(u16::MAX);
        let transport_sets = needs.transport_sets();
        let default = XfBusOptions::DEFAULT.ahead;
        let value = stall_cycles.max(default).min(needs.ahead_max);
        let verdict = if stall_cycles > needs.ahead_max {
            Verdict::No {
                row: Row::Stall,
                reason: format!(
                    "the host stood still for {stall_cycles} cycles, and what the chip holds beside the transport bridges \
                     {}",
                    needs.ahead_max
                ),
                next: "give the process real-time priority and a quiet machine (`ecmsk doctor`), or record again with nothing \
                       else running"
                    .to_owned(),
            }
        } else if value > default {
            Verdict::Differs(Row::Stall)
        } else {
            Verdict::Yes
        };
        Self { stall, is_known, stall_cycles, transport_sets, value, verdict }
    }
}

impl Links {
    fn of(network: &Network, needs: &Needs, ahead: &Ahead, start: &Start, usage: &Usage, setting: &Setting) -> Self {
        let use_n =
            needs.with_int0.map_or_else(|_| String::new(), |packets| format!("&use_n={}", packets.size.bytes()));
        let pins = [(CommandId::LocalRead, LOCAL_IN), (CommandId::LocalWrite, LOCAL_OUT)];
        let pins: String =
            pins.into_iter().filter(|(id, _)| usage.has(Subject::Command(*id))).map(|(_, key)| key).collect();
        let slot = if setting.slot == SlotSize::Bytes16 { "&slot=16" } else { "" };
        let timeout = start.timeout_ms.map_or_else(String::new, |ms| format!("&state_timeout_ms={ms}"));
        let keys = format!("ahead={}{use_n}&speed={}{timeout}{pins}{slot}", ahead.value, hertz(needs.clock_hz));
        Self {
            machine: format!("xf-spi:/dev/spidev0.0?int0=gpiochip0/24&{keys}"),
            model: format!("xf-sim:?slaves={}&int0=yes&{keys}", network.models()),
        }
    }

    /// Replaces the slaves of the link to the model by `slaves`, in the syntax of the key `slaves=`: the recorded
    /// slaves with the travel of their axes (switches, index pulse, end stops), and with their manufacturer-specific
    /// objects.
    pub fn with_slaves(&mut self, slaves: &str) {
        if let Some((_, keys)) = self.model.split_once("&int0=") {
            self.model = format!("xf-sim:?slaves={slaves}&int0={keys}");
        }
    }
}

/// A frequency as links write it: `24M`, `500k`, or the plain number.
fn hertz(hz: u32) -> String {
    match hz {
        hz if hz > 0 && hz.is_multiple_of(1_000_000) => format!("{}M", hz / 1_000_000),
        hz if hz > 0 && hz.is_multiple_of(1000) => format!("{}k", hz / 1000),
        hz => hz.to_string(),
    }
}

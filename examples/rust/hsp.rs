//! A pulse module (HSP) of two channels in one slot of 16 bytes: both go their ways by CSP, with an output of each on in
//! the middle half, and the inputs that this shows.

mod common;

use ecmsk::coe::ObjectAddress;
use ecmsk::ecm::{Axis, Config, EcmError, Failure, Slave, SlaveView, Stream};
use ecmsk::sk::{AxisTarget, HspResponse};

const WAY: [i32; 2] = [100_000, -60_000];
const VALVE: [u16; 2] = [0x0001, 0x0100];
const CYCLES: u32 = 1000;

fn main() -> Result<(), Failure> {
    let config = Config { slaves: vec![Slave::Hsp(Axis::CSP)], ..Config::default() };
    let ecm = common::board("sim:?slaves=hsp2&slot=16&clock=virtual", &config)?;
    let mut stream = ecm.stream(common::AHEAD)?;
    for way in [WAY, WAY.map(|way| -way)] {
        go(&mut stream, way)?;
        let hsp = channels(&stream)?;
        println!("channels at {}, {}", hsp.first.position, hsp.second.position);
    }
    let stats = stream.finish()?;
    // The objects of channel 2 are those of channel 1 plus 0x800.
    let position = |index| ecm.sdo_read::<i32>(1, ObjectAddress::new(index, 0));
    println!("0x6064: {}, 0x6864: {}; {stats:?}", position(0x6064)?, position(0x6864)?);
    Ok(())
}

/// Moves both channels by `way`, and says when inputs change.
fn go(stream: &mut Stream<'_>, way: [i32; 2]) -> Result<(), EcmError> {
    let from = channels(stream)?;
    let mut inputs = [from.first.inputs, from.second.inputs];
    for n in 1..=CYCLES + u32::from(common::AHEAD) + 100 {
        let share = common::smooth(n.min(CYCLES), CYCLES);
        let target = |start: i32, i: usize| AxisTarget {
            target: start + (f64::from(way[i]) * share).round() as i32,
            outputs: if (0.25..0.75).contains(&share) { VALVE[i] } else { 0 },
        };
        stream.csp_hsp(1, target(from.first.position, 0), target(from.second.position, 1))?;
        stream.step()?;
        let now = channels(stream)?;
        for (i, axis) in [now.first, now.second].into_iter().enumerate() {
            if std::mem::replace(&mut inputs[i], axis.inputs) != axis.inputs {
                println!("  channel {} at {}: inputs 0x{:04X}", i + 1, axis.position, axis.inputs);
            }
        }
    }
    Ok(())
}

fn channels(stream: &Stream<'_>) -> Result<HspResponse, EcmError> {
    match stream.snapshot()?.slave(1) {
        Some(SlaveView::Hsp(hsp)) => Ok(hsp),
        _ => unreachable!("slave 1 is configured as an HSP"),
    }
}

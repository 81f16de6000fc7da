//! Two axes: configure, switch on, move both by a smooth profile, stop, switch off.
//!
//! Run it with `cargo run --example two_axes`, or name the board: `cargo run --example two_axes -- 'sim:?slaves=drive*2'`.

use std::process::ExitCode;

use ecmsk::ecm::{Axis, Close, Config, Ecm, EcmError, News, Scale, Slave};
use ecmsk::sk::MasterState;

/// Without a board of one's own: two simulated drives, on virtual time.
const DEFAULT_LINK: &str = "sim:?slaves=drive*2&clock=virtual";
/// Frames that the program may be ahead of the board, so that a stutter of its own does no harm.
const AHEAD: u16 = 20;
/// Cycles of 1 ms that the motion takes.
const CYCLES: u32 = 2000;
/// How far both axes go, in degrees.
const WAY: [f64; 2] = [90.0, -45.0];

fn main() -> ExitCode {
    let link = std::env::args().nth(1).unwrap_or_else(|| DEFAULT_LINK.to_owned());
    match run(&link) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn run(link: &str) -> Result<(), EcmError> {
    // A 17-bit encoder on the axis itself: positions below are in degrees.
    let axis = Axis { scale: Scale::per_unit(131_072.0 / 360.0), ..Axis::CSP };
    let config = Config { slaves: vec![Slave::Drive(axis); 2], cycle_us: 1000 };

    let ecm = Ecm::open(link)?;
    ecm.configure(&config)?;
    ecm.set_state(MasterState::Op)?;
    ecm.servo_on(&[1, 2])?;
    println!("on");

    let start = ecm.snapshot()?;
    let mut stream = ecm.stream(AHEAD)?;
    for n in 1..=CYCLES {
        // 0 to 1, without a step in speed or acceleration.
        let t = f64::from(n) / f64::from(CYCLES);
        let share = t * t * t * (10.0 - 15.0 * t + 6.0 * t * t);
        for (slave, way) in (1..).zip(WAY) {
            let from = start.position_units(slave).unwrap_or_default();
            stream.csp_units(slave, from + way * share)?;
        }
        stream.step()?;
    }
    let done = stream.finish()?;

    let end = ecm.snapshot()?;
    for slave in [1, 2] {
        println!("axis {slave}: {:.1} degrees", end.position_units(slave).unwrap_or_default());
    }
    println!("{} frames, {} underruns, {} losses", done.frames, done.underruns, done.losses);
    for news in ecm.take_news()? {
        // Reports that came while nobody read are no harm.
        if !matches!(news, News::ReportsLost { .. }) {
            println!("{news:?}");
        }
    }
    ecm.close(Close::ServoOff)
}

//! Two axes behind an ECM-XF: the network is started, both axes are switched on, go round a rounded square and stop.
//!
//! Run it with `cargo run --example xf_two_axes`, or name the chip: `cargo run --example xf_two_axes -- 'xf-sim:'`. With
//! `--csv` behind the link it prints the path instead: time in s, then target and position of both axes in mm.

use std::f64::consts::TAU;
use std::process::ExitCode;

use ecmsk::coe::ObjectAddress;
use ecmsk::xf::EtherCatState;
use ecmsk::xf::request::{FifoEnable, Reconfig, Slaves};
use ecmsk::xf_api::{Input, NetworkConfig, Output, ProcessData, Xf, XfError};

/// Without a chip of one's own: a simulated one with two drives, on virtual time.
const DEFAULT_LINK: &str = "xf-sim:?slaves=drive*2&clock=virtual";
/// Cycles of 1 ms that the motion takes.
const CYCLES: u32 = 3000;
/// 17-bit encoders on spindles of 5 mm a turn.
const COUNTS_PER_MM: f64 = 131_072.0 / 5.0;

const MODE: ObjectAddress = ObjectAddress::new(0x6060, 0);
const TARGET: ObjectAddress = ObjectAddress::new(0x607A, 0);
const POSITION: ObjectAddress = ObjectAddress::new(0x6064, 0);

/// An axis: where it was, and its places in the process data.
struct Axis {
    start: i32,
    target: Output<i32>,
    position: Input<i32>,
}

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let link = arguments.next().unwrap_or_else(|| DEFAULT_LINK.to_owned());
    let csv = arguments.next().as_deref() == Some("--csv");
    match run(&link, csv) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn run(link: &str, csv: bool) -> Result<(), XfError> {
    let mut xf = Xf::open(link)?;
    let slaves = xf.start_network(&NetworkConfig::default())?;
    xf.set_state(Slaves::All, EtherCatState::PreOp)?;
    for slave in 0..2 {
        xf.sdo_write(slave, MODE, 8_i8)?; // CSP
    }
    xf.run(&Reconfig)?;
    xf.set_state(Slaves::All, EtherCatState::SafeOp)?;

    // In SafeOP the positions can be read, so that the first targets are where the axes stand.
    let mut data = xf.process_data()?;
    let axes = [axis(&mut data, 0)?, axis(&mut data, 1)?];
    for slave in 0..2 {
        xf.add_axis(slave, slave, &data)?;
    }
    xf.set_state(Slaves::All, EtherCatState::Op)?;
    xf.run(&FifoEnable { on: true })?;
    xf.cycle(&mut data)?;
    for motor in 0..2 {
        xf.enable(motor)?;
    }

    let begin = xf.link().now();
    for n in 1..=CYCLES {
        for (axis, way) in axes.iter().zip(path(f64::from(n) / f64::from(CYCLES))) {
            data.set(axis.target, axis.start + (way * COUNTS_PER_MM).round() as i32);
        }
        xf.cycle(&mut data)?;
        if csv {
            let mm = |axis: &Axis, at: i32| f64::from(at - axis.start) / COUNTS_PER_MM;
            let values = axes.iter().map(|axis| {
                let (target, position) = (data.get_output(axis.target), data.get(axis.position));
                format!("{:.4},{:.4}", mm(axis, target), mm(axis, position))
            });
            let seconds = (xf.link().now() - begin) as f64 / 1e9;
            println!("{seconds:.4},{}", values.collect::<Vec<_>>().join(","));
        }
    }
    xf.finish(&mut data)?;
    if !csv {
        println!("{slaves} slaves");
        for (motor, axis) in (0..).zip(&axes) {
            let off = data.get(axis.position) - data.get_output(axis.target);
            println!("axis {motor}: {off} counts from its target");
        }
        let counters = xf.host().counters();
        println!(
            "damaged answers {}, lost process data {}",
            counters.damaged,
            counters.rx_full + counters.rx_dropped + counters.rx_unknown
        );
    }
    xf.close()
}

fn axis(data: &mut ProcessData, slave: u8) -> Result<Axis, XfError> {
    let (target, position) = (data.output(slave, TARGET)?, data.input(slave, POSITION)?);
    let start = data.get(position);
    data.set(target, start);
    Ok(Axis { start, target, position })
}

/// Where both axes are at `t`, 0..=1, in mm: a square of 40 mm with round corners, from standstill to standstill.
fn path(t: f64) -> [f64; 2] {
    let angle = TAU * t * t * t * (10.0 - 15.0 * t + 6.0 * t * t) - TAU / 8.0;
    let squircle = |x: f64, y: f64| x / (x.powi(8) + y.powi(8)).powf(0.125);
    let [x, y] = [squircle(angle.cos(), angle.sin()), squircle(angle.sin(), angle.cos())];
    let corner = squircle(1.0, 1.0);
    [20.0 * (x - corner), 20.0 * (y + corner)]
}

//! Profile velocity of a DP3CL.

use ecmsk::slave::dp3cl::{Dp3clConfig, Dp3clVariants};

use super::bench::{Bench, MS};

fn bench(config: Dp3clConfig) -> Bench {
    let mut bench = Bench::enabled_with(config, 3);
    for (index, value) in [(0x6083, 100_000), (0x6084, 50_000)] {
        bench.write(index, 0, value);
    }
    bench
}

/// DP3CL-6.11 0.1 rpm, or u/s in the variant; the ramps; the greatest speed.
#[test]
fn speeds() {
    let mut bench_of = bench(Dp3clConfig::default());
    let bench = &mut bench_of;
    bench.write(0x60FF, 0, 600);
    bench.run_for(50 * MS);
    assert_eq!((bench.velocity(), bench.read(0x606B, 0)), (5000, 300));
    bench.run_for(100 * MS);
    assert_eq!((bench.velocity(), bench.read(0x606B, 0)), (10_000, 600));
    bench.write(0x60FF, 0, -300);
    bench.run_for(100 * MS);
    assert_eq!(bench.velocity(), 5000);
    bench.run_for(100 * MS);
    assert_eq!(bench.velocity(), 0);
    bench.run_for(100 * MS);
    assert_eq!(bench.velocity(), -5000);
    bench.write(0x607F, 0, 6000);
    bench.write(0x60FF, 0, 600);
    bench.run_for(500 * MS);
    assert_eq!(bench.velocity(), 6000);
    let variants = Dp3clVariants { speeds_in_units: true, ..Dp3clVariants::default() };
    let mut bench = self::bench(Dp3clConfig { variants, ..Dp3clConfig::default() });
    bench.write(0x60FF, 0, 4321);
    bench.run_for(200 * MS);
    assert_eq!((bench.velocity(), bench.read(0x606B, 0)), (4321, 4321));
}

/// DP3CL-6.12 Target reached and speed zero.
#[test]
fn windows() {
    let mut bench = bench(Dp3clConfig::default());
    for (index, value) in [(0x606D, 60), (0x606E, 20), (0x606F, 30), (0x6070, 10)] {
        bench.write(index, 0, value);
    }
    bench.run_for(50 * MS);
    assert!(bench.bit(12) && bench.bit(10), "it stands, as it is to");
    bench.write(0x60FF, 0, 600);
    bench.cycle();
    assert!(!bench.bit(10) && bench.bit(12));
    let fast = bench.run_until(200, |bench| !bench.bit(12));
    assert!((4..=6).contains(&fast), "500 u/s after 5 ms, {fast}");
    bench.run_until(200, |bench| bench.read(0x606B, 0) >= 540);
    let waited = bench.run_until(200, |bench| bench.bit(10));
    assert!((19..=21).contains(&waited), "{waited}");
    assert!(!bench.bit(13));
    bench.write(0x60FF, 0, 0);
    bench.run_until(500, |bench| bench.velocity() <= 500);
    let waited = bench.run_until(200, |bench| bench.bit(12));
    assert!((9..=11).contains(&waited), "{waited}");
}

/// DP3CL-6.13 Halt brakes, and the speed comes back without it.
#[test]
fn halt() {
    let mut bench = bench(Dp3clConfig::default());
    bench.write(0x60FF, 0, 600);
    bench.run_for(200 * MS);
    bench.word = 0x010F;
    bench.cycle();
    assert!(!bench.bit(10));
    bench.run_for(100 * MS);
    assert!(!bench.bit(10));
    bench.run_for(110 * MS);
    assert_eq!((bench.bit(10), bench.velocity()), (true, 0));
    bench.word = 0x0F;
    bench.run_for(200 * MS);
    assert_eq!(bench.velocity(), 10_000);
}

//! `ecmsk plot`: recordings as pictures.
#![cfg(feature = "cli")]

mod cli_support;

use cli_support::motion::Run;
use ecmsk::sk::SlotSize;

#[test]
fn look() {
    let dir = std::path::Path::new("/tmp/look");
    std::fs::create_dir_all(dir).unwrap();
    for axes in [2, 8] {
        let mut run = Run::new(SlotSize::Bytes12, axes);
        for i in 0..4000 {
            let t = f64::from(i) / 1000.0;
            let burst = if i == 2500 { 170 } else { 1 };
            for k in 0..burst {
                let t = t + f64::from(k) / 1000.0;
                let targets: Vec<i32> = (0..axes)
                    .map(|a| (f64::from(20_000 * (a as i32 + 1)) * (1.0 - (t * (1.0 + 0.3 * a as f64)).cos())) as i32)
                    .collect();
                run.send(&targets);
            }
            if i > 30 {
                run.cycle();
            }
        }
        run.script.record(
            &dir.join(format!("{axes}.pcapng")),
            "sim:?slaves=drive*2&clock=virtual",
            Some(SlotSize::Bytes12),
        );
    }
}

//! `nic_40`: the processor's time of a cycle of 1 ms with 40 drives in CSP over `nic:`, runner, board and master together, which
//! is the board's thread. The baselines do the same process data in the same kind of cycle, each on a pair of virtual interfaces
//! with slaves of its own: `nic_40` against ethercrab 0.7.1, all its threads; `nic_40_soem` against SOEM; `nic_40_bare` against a bare loop that sleeps,
//! sends and receives. The program that makes the targets counts on no side but ethercrab's, where it is a copy of 6 bytes.
//!
//! `nic_250us`: how late the frame of a cycle of 250 us goes out, the time that 999 of 1000 do not exceed; the baseline is a bare
//! loop with absolute sleeps that sends the same frame. Both are seen by the kernel's time stamps at the slaves' end.
//! `nic_250us_lost`: cycles that were left out, or whose answer did not come in time, while that was measured; `nic_250us_lost_bare`: those of
//! the bare loop, of which ours may have no more. Where that loses some the machine is not quiet: a virtual one stands still when its
//! host has no time for it.
//! `ECMSK_BENCH_MINUTES` says for how long each side runs, a minute by default.
//!
//! `nic_40_others`, `nic_250us_others`: how much of all processors something else used meanwhile. Figures of a busy machine are worth
//! little.
//!
//! Masters run with SCHED_FIFO on one processor, slaves on another one. Needs Linux, root and `ip`: otherwise it says so and is
//! left out; the baseline ethercrab needs the crates of `tests/masters/ethercrab`, SOEM its sources, which `cargo xtask bench` fetches, or
//! is left out.

#[cfg(target_os = "linux")]
#[path = "../common/mod.rs"]
mod common;
#[cfg(target_os = "linux")]
#[path = "../common/drives.rs"]
mod drives;
#[cfg(target_os = "linux")]
#[path = "../common/namespace.rs"]
mod namespace;
#[cfg(target_os = "linux")]
#[path = "../common/places.rs"]
mod places;
#[cfg(target_os = "linux")]
#[path = "../common/wire.rs"]
mod wire;

#[cfg(target_os = "linux")]
mod bare;
#[cfg(target_os = "linux")]
mod board;
#[cfg(target_os = "linux")]
mod other;
#[cfg(target_os = "linux")]
mod processor;
#[cfg(target_os = "linux")]
mod sniffer;

#[cfg(not(target_os = "linux"))]
fn main() {
    eprintln!("nic: left out: network namespaces need Linux");
}

#[cfg(target_os = "linux")]
fn main() {
    namespace::run("nic", bench::measure);
}

#[cfg(target_os = "linux")]
mod bench {
    use std::time::Duration;

    use ecmsk::engine::RealTime;

    use super::bare::Bare;
    use super::board::OnCard;
    use super::common::{self, Demand};
    use super::other::Other;
    use super::places::Places;
    use super::processor::Others;
    use super::sniffer::{SETTLING, Sniffer};
    use super::{drives, namespace};

    /// The ends of the pairs: the master's, and that of its slaves.
    const OURS: (&str, &str) = ("master0", "slaves0");
    const BARE: (&str, &str) = ("master1", "slaves1");
    const OTHERS: (&str, &str) = ("master2", "slaves2");
    /// SCHED_FIFO of masters, and of slaves.
    pub const PRIORITY: u8 = 20;
    const SLAVES_PRIORITY: u8 = 10;
    const MILLISECOND: Duration = Duration::from_millis(1);
    const QUARTER: Duration = Duration::from_micros(250);
    /// Blocks of each side.
    const BLOCKS: usize = 7;
    const LATE_BLOCKS: usize = 3;
    /// Cycles that count of a block, and before that others that do not.
    pub const MEASURED: u64 = 2000;
    pub const WARM_UP: u64 = 500;
    /// The time that so many of 1000 cycles do not exceed is shown.
    const SHARE: usize = 999;
    const ALLOWANCE: Duration = Duration::from_micros(20);

    pub fn measure() {
        let places = Places::find();
        for (near, far) in [OURS, BARE, OTHERS] {
            namespace::make_pair(near, far);
            let real_time = RealTime { priority: Some(SLAVES_PRIORITY), ..RealTime::default() };
            // They are served until the program ends.
            std::mem::forget(places.server(|| drives::serve(far, real_time)));
        }
        let mut bare = Bare::new(BARE.0);
        processor_time(&mut bare);
        lateness(&places, &mut bare);
    }

    fn processor_time(bare: &mut Bare) {
        let ours = || OnCard::open(OURS.0, MILLISECOND).processor_ns();
        let demand =
            |name, target, against| Demand { name, target: Some(target), allowance: None, against: Some(against) };
        let others = Others::begin();
        common::pair_of_blocks(demand("nic_40_bare", 1.5, "a bare loop of AF_PACKET"), BLOCKS, ours, || {
            bare.processor_ns(MILLISECOND)
        });
        let masters = [("nic_40", "ethercrab 0.7.1", Other::ethercrab()), ("nic_40_soem", "SOEM", Other::soem())];
        for (name, against, other) in masters {
            match other {
                Ok(other) => {
                    common::pair_of_blocks(demand(name, 1.0, against), BLOCKS, ours, || other.processor_ns(OTHERS.0))
                }
                Err(reason) => eprintln!("{name}: left out: {reason}"),
            }
        }
        common::fact("nic_40_others", others.percent(), "% of all processors");
    }

    fn lateness(places: &Places, bare: &mut Bare) {
        let minutes = std::env::var("ECMSK_BENCH_MINUTES").map_or(1.0, |text| text.parse().expect("a number"));
        let time = Duration::from_secs_f64(minutes * 60.0 / LATE_BLOCKS as f64);
        let late = |sniffer: Sniffer| sniffer.late_ns(QUARTER, SHARE);
        let demand = Demand {
            name: "nic_250us",
            target: Some(1.2),
            allowance: Some(ALLOWANCE),
            against: Some("a bare loop with absolute sleeps"),
        };
        let (mut lost, mut lost_bare) = (0, 0);
        let others = Others::begin();
        common::pair_of_blocks(
            demand,
            LATE_BLOCKS,
            || {
                let mut board = OnCard::open(OURS.0, QUARTER);
                let sniffer = places.server(|| Sniffer::start(OURS.1));
                lost += board.run(time);
                late(sniffer)
            },
            || {
                let sniffer = places.server(|| Sniffer::start(BARE.1));
                lost_bare += bare.run(SETTLING, time, QUARTER);
                late(sniffer)
            },
        );
        common::limited("nic_250us_lost", lost as f64, "cycles", lost_bare as f64);
        common::fact("nic_250us_lost_bare", lost_bare as f64, "cycles");
        common::fact("nic_250us_others", others.percent(), "% of all processors");
    }
}

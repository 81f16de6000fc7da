//! `xf_crc32_1440`: the check word of the longest packet against the loop of the crate that computes it.
//!
//! `xf_host_1440`, `xf_host_144`: an exchange of the driver with process data, over a pipe in this process, in the longest
//! packet and in that of the manuals. The baseline is a bare loop over the same pipe with the same packets: it copies them
//! both ways and computes both check words. Both have the same program, which puts its outputs into each packet.
//!
//! `xf_chip_40`: an exchange with the process data of 40 drives, a cycle after the one before, through the model of the
//! chip; the baseline is the same cycle of the same drives on the simulated bus. `xf_chip_40_controllers`: what such an exchange
//! takes over controllers (`network=controllers`), where nothing is demanded.
//!
//! `xf_cycle_40`: a cycle of the modelled board with 40 drives in CSP behind the model of the chip, driver and all; the
//! baseline is the same program on the board over the simulated bus.
//!
//! `xf_ahead`: what a PC costs that stands still for 7 cycles once a second, counted over a minute of virtual time with 40
//! drives that get a target in each cycle of 1 ms, with `ahead=8`: targets that a drive has not got, or not in order, and
//! (`xf_ahead_repeated`) cycles without a new target; `xf_ahead_repeated_default`: those with the `ahead=` that links have
//! if nothing else is said, which is less than the stall.

#[path = "../common/board.rs"]
mod board;
#[path = "../common/mod.rs"]
mod common;
mod drives;
mod pipe;

use std::hint::black_box;

use ecmsk::fieldbus::xf::XfBusOptions;
use ecmsk::xf::{CheckRule, DataSize, HEADER_LEN, MAX_PACKET};
use support::late_host::{LateHost, Stalls};

fn main() {
    check_word();
    host("xf_host_1440", DataSize::MAX, Some(1.5));
    host("xf_host_144", DataSize::MANUAL, None);
    chip();
    cycle();
    ahead();
}

fn check_word() {
    let packet: [u8; MAX_PACKET] = std::array::from_fn(|i| (i * 37 + 11) as u8);
    let covered = &packet[..HEADER_LEN + DataSize::MAX.bytes()];
    let ours = |covered| CheckRule::CRC32.word(covered, DataSize::MAX.get());
    assert_eq!(ours(covered), crc32fast::hash(covered), "the two do not compute the same");
    common::pair(
        "xf_crc32_1440",
        1.1,
        || {
            black_box(ours(black_box(covered)));
        },
        || {
            black_box(crc32fast::hash(black_box(covered)));
        },
    );
}

fn host(name: &'static str, size: DataSize, target: Option<f64>) {
    let mut driver = pipe::Driver::running(size);
    let mut plain = pipe::PlainLoop::new(size);
    let demand = common::Demand { name, target, allowance: None, against: None };
    common::pair_of_calls(demand, || driver.exchange(), || plain.exchange());
    driver.assert_well();
}

fn chip() {
    let mut chip = drives::ChipWithDrives::in_op(drives::models());
    let mut bus = drives::BusWithDrives::in_op();
    common::pair("xf_chip_40", 2.0, || chip.cycle(), || bus.cycle());
    chip.assert_well();
    bus.assert_well();
    let mut chip = drives::ChipWithDrives::in_op(drives::controllers());
    let block = || common::per_call_ns(200, &mut || chip.cycle());
    common::fact("xf_chip_40_controllers", common::median(std::iter::repeat_with(block).take(31).collect()), "ns");
    chip.assert_well();
}

fn cycle() {
    const DRIVES: usize = 40;
    let (mut behind, mut direct) = (board::drives_in_op_behind_xf(DRIVES), board::drives_in_op(DRIVES));
    let mut behind = board::Program::new(&mut behind, DRIVES);
    let mut direct = board::Program::new(&mut direct, DRIVES);
    (0..8).for_each(|_| behind.send());
    common::pair("xf_cycle_40", 2.5, || behind.cycle(), || direct.cycle());
    behind.assert_well();
    direct.assert_well();
}

fn ahead() {
    const STALLS: Stalls = Stalls { cycles: 7, every: 1000 };
    const MINUTE: u64 = 60_000;
    let [outcome, of_default] =
        [8, XfBusOptions::DEFAULT.ahead].map(|ahead| LateHost::new(40, ahead).lead(MINUTE, STALLS));
    for outcome in [outcome, of_default] {
        assert!(outcome.stalls >= 58 && outcome.targets > MINUTE - 600, "{outcome:?}");
    }
    let lost = [outcome, of_default].map(|outcome| outcome.lost + outcome.out_of_order + outcome.counted_lost);
    common::limited("xf_ahead", (lost[0] + lost[1]) as f64, "targets lost", 0.0);
    common::limited("xf_ahead_repeated", outcome.repeated as f64, "cycles", 0.0);
    common::fact("xf_ahead_repeated_default", of_default.repeated as f64, "cycles");
}

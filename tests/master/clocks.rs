//! Distributed clocks: delays, offsets, drift, SYNC0, and cycles that keep step.

use ecmsk::ethercat::registers::{self, Features};
use ecmsk::ethercat::{AlState, Command, DatagramHeader, FRAME_LEN_MIN, FrameHeader, FrameWriter, Ns, SlaveSet};
use ecmsk::master::{Pace, Upstream};
use ecmsk::sk::DriveSync;
use ecmsk::slave::esc::{Chain, EscSettings, HOP_NS};

use super::predecessor::write;
use super::rig::{CYCLE, MS, Rig, SECOND, US, slave};

fn clock(local_time_ns: u64, drift_ppb: i32) -> EscSettings {
    EscSettings { local_time_ns, drift_ppb, ports: [3; 4], ..EscSettings::default() }
}

fn without_clock() -> EscSettings {
    let clocks = Features::CLOCK | Features::CLOCK_64_BITS;
    EscSettings { features: EscSettings::default().features.without(clocks), ..EscSettings::default() }
}

fn register<const N: usize>(rig: &Rig, slave: usize, address: u16) -> [u8; N] {
    rig.net.chain.slave(slave).controller().peek(address, N).try_into().expect("so many bytes")
}

/// The delay that each slave was given.
pub fn delays(rig: &Rig) -> Vec<Ns> {
    let delay = |n| u32::from_le_bytes(register(rig, n, registers::SYSTEM_TIME_DELAY)).into();
    (0..rig.net.chain.len()).map(delay).collect()
}

/// The difference of the greatest and the least system time, ns.
fn spread(rig: &mut Rig) -> u64 {
    let now = rig.net.now;
    rig.net.chain.advance(now);
    let has_clock = |n: &usize| rig.master.slaves()[*n].features.contains(Features::CLOCK);
    let times =
        (0..rig.net.chain.len()).filter(has_clock).map(|n| rig.net.chain.slave(n).controller().system_time_ns());
    let times: Vec<u64> = times.collect();
    times.iter().max().expect("some") - times.iter().min().expect("some")
}

/// MASTER-6.1 MASTER-6.2 On a line each slave gets its propagation delay, across slaves without a clock, and all clocks
/// show the same time then.
#[test]
fn delays_on_a_line() {
    let locals = [7_000_000_000, 1, 0xFFFF_FF00, u64::MAX - 1_000];
    let mut chain = Chain::line(locals.into_iter().map(|local| slave("drive", clock(local, 0))));
    chain.add(slave("drive", without_clock()), 3, 1);
    chain.add(slave("drive", clock(99, 0)), 4, 1);
    chain.set_hop(2, 450);
    chain.set_hop(5, 1_000);
    let mut rig = Rig::of(chain);
    assert_eq!(rig.scan(), 6);
    assert_eq!(rig.master.reference_clock(), Some(1));
    assert_eq!(delays(&rig), [0, 310, 760, 1070, 0, 2380]);
    assert!(spread(&mut rig) <= 1, "{}", spread(&mut rig));
}

/// MASTER-2.4 MASTER-6.1 In a tree a frame comes to a branch when it has come back from those before.
#[test]
fn delays_in_a_tree() {
    let mut chain = Chain::line([slave("drive", clock(5, 0)), slave("drive", clock(1 << 40, 0))]);
    // The second slave has branches of two slaves at port 3, one at port 1, two at port 2.
    for (parent, port, hop_ns) in [(1, 3, 100), (2, 1, 200), (1, 1, 300), (1, 2, 400), (5, 3, 500)] {
        let n = chain.add(slave("drive", clock(77 << port, 0)), parent, port);
        chain.set_hop(n, hop_ns);
    }
    let mut rig = Rig::of(chain);
    assert_eq!(rig.scan(), 7);
    let upstreams: Vec<_> =
        rig.master.slaves().iter().map(|slave| slave.upstream.map(|Upstream { slave, port }| (slave, port))).collect();
    assert_eq!(upstreams, [None, Some((1, 1)), Some((2, 3)), Some((3, 1)), Some((2, 1)), Some((2, 2)), Some((6, 3))]);
    let second = HOP_NS;
    let behind_3 = second + 2 * (100 + 200);
    let behind_1 = behind_3 + 2 * 300;
    let expected = [0, second, second + 100, second + 300, behind_3 + 300, behind_1 + 400, behind_1 + 900];
    assert_eq!(delays(&rig), expected);
    assert!(spread(&mut rig) <= 1);
}

/// MASTER-6.3 Clocks that drift by 100 ppm are held within a microsecond, before there are cycles and with them.
#[test]
fn clocks_that_drift_are_held() {
    let drifts = [0, 100_000, -100_000, 50_000];
    let kinds = ["drive", "hsp", "step", "drive"];
    let chain = Chain::line(kinds.iter().zip(drifts).map(|(kind, drift)| slave(kind, clock(123, drift))));
    let mut rig = Rig::of(chain);
    rig.scan();
    let mut worst = 0;
    for _ in 0..100 {
        rig.run_for(10 * MS);
        worst = worst.max(spread(&mut rig));
    }
    assert!((1..2_000).contains(&worst), "{worst}");
    rig.bring_to_op(&kinds);
    rig.run_for(200 * MS);
    worst = 0;
    for _ in 0..1_000 {
        rig.run_for(CYCLE);
        worst = worst.max(spread(&mut rig));
    }
    assert!((1..1_000).contains(&worst), "{worst}");
    assert!(rig.last.reference_time.is_some());
}

/// MASTER-6.4 SYNC0 comes to all slaves at the same multiple of the cycle, and the slaves reach OP with it.
#[test]
fn sync0_comes_to_all_slaves_at_once() {
    let kinds = ["drive", "io", "dp3cl", "hsp2", "step"];
    let drifts = [20_000, 0, -30_000, 50_000, -10_000];
    let chain = Chain::line(kinds.iter().zip(drifts).map(|(kind, drift)| slave(kind, clock(9_999, drift))));
    let mut rig = Rig::of(chain);
    rig.scan();
    rig.bring_to_op_with(&kinds, DriveSync::DcSync);
    rig.run_for(SECOND);
    assert!(rig.last.all_in_op);
    let with_clock = (0..5).filter(|n| rig.master.slaves()[*n].features.contains(Features::CLOCK));
    let now = rig.net.chain.slave(0).controller().system_time_ns();
    let mut count = 0;
    for n in with_clock {
        assert_eq!(register::<1>(&rig, n, registers::SYNC_ACTIVATION), [3]);
        assert_eq!(u32::from_le_bytes(register(&rig, n, registers::SYNC0_CYCLE)), CYCLE as u32);
        let start = u64::from_le_bytes(register(&rig, n, registers::SYNC0_START));
        assert_eq!(start % CYCLE, 0, "slave {n}");
        assert!(start.abs_diff(now) < 2 * SECOND);
        count += 1;
    }
    assert!(count >= 3);
    // Without cycles they leave OP, and SYNC0 stops on the way down.
    rig.reach(AlState::PreOp);
    assert_eq!(register::<1>(&rig, 0, registers::SYNC_ACTIVATION), [0]);
}

/// MASTER-6.4, MASTER-2.8 A clock that has missed the frame that sets it would take minutes to converge: it is set anew,
/// also if another master has left a filter with which the difference of a clock is shown much later.
#[test]
fn a_clock_that_is_far_away_is_set_anew() {
    let kinds = ["drive", "drive", "drive"];
    let mut rig = Rig::line(&kinds);
    write(&mut rig, registers::TIME_DIFFERENCE_FILTER, &[15]);
    rig.scan();
    let offset = u64::from_le_bytes(register(&rig, 1, registers::SYSTEM_TIME_OFFSET)) + 50 * MS;
    let mut frame = [0; FRAME_LEN_MIN];
    let mut writer = FrameWriter::new(&mut frame, FrameHeader::datagrams([0x10; 6])).expect("room");
    let header = DatagramHeader::register(Command::Apwr, 0, 1_u16.wrapping_neg(), registers::SYSTEM_TIME_OFFSET);
    writer.push(header, &offset.to_le_bytes()).expect("room");
    writer.finish();
    let now = rig.net.now;
    rig.net.chain.process(&mut frame, now);
    rig.run_for(100 * MS);
    assert!(spread(&mut rig) > 40 * MS, "{}", spread(&mut rig));
    rig.bring_to_op_with(&kinds, DriveSync::DcSync);
    assert!(spread(&mut rig) < 10 * US, "{}", spread(&mut rig));
}

/// The next deadline keeps the frames at their phase of the reference clock, whatever its drift.
#[test]
fn cycles_keep_step_with_the_reference() {
    for (drift, local, phase_ns) in [(100_000, 123_456_789, 0), (-80_000, 5, 400 * US), (0, u64::MAX - 9, 999 * US)] {
        let mut rig = Rig::of(Chain::line([slave("drive", clock(local, drift)), slave("drive", clock(3, -drift))]));
        rig.scan();
        rig.master.set_pace(Some(Pace { cycle_ns: CYCLE, phase_ns }));
        let mut worst = 0;
        for turn in 0..3_000 {
            let now = rig.net.now;
            rig.master.cycle(now, &mut rig.net);
            rig.net.now += 100 * US;
            let now = rig.net.now;
            rig.master.poll(now, &mut rig.net);
            let done = rig.master.take_cycle().expect("it is back");
            let time = done.reference_time.expect("a reference");
            if turn > 1_000 {
                worst = worst.max(((time + CYCLE / 2 - phase_ns) % CYCLE).abs_diff(CYCLE / 2));
            }
            let next = done.next_deadline.expect("a pace is set");
            assert!(next.abs_diff(done.sent_at + CYCLE) < CYCLE / 10);
            rig.net.now = next;
        }
        assert!(worst < 20, "{drift}: {worst}");
    }
}

/// A reference clock of 32 bits is extended when it wraps.
#[test]
fn a_clock_of_32_bits_is_extended() {
    let features = EscSettings::default().features.without(Features::CLOCK_64_BITS);
    let mut rig = Rig::of(Chain::line([slave("drive", EscSettings { features, ..clock(0, 0) })]));
    rig.net.now = u64::from(u32::MAX) - 300 * MS;
    rig.scan();
    rig.next_cycle = Some(rig.net.now);
    let mut last = 0;
    for _ in 0..600 {
        rig.run_for(CYCLE);
        let time = rig.last.reference_time.unwrap_or(last + CYCLE);
        assert!(last == 0 || time.abs_diff(last + CYCLE) < 10 * US, "{last} {time}");
        last = time;
    }
    assert!(last > u64::from(u32::MAX));
}

/// MASTER-6.4 MASTER-7.5 SYNC0 of a clock with 32 bits comes at the multiples of the cycle of the 64 bits in which frames are
/// paced, however long it has run. A clock with 64 bits that was without power gets the time of such a reference.
#[test]
fn clocks_of_32_bits_beside_others() {
    let features = EscSettings::default().features.without(Features::CLOCK_64_BITS);
    let short = || slave("drive", EscSettings { features, ..clock(0, 0) });
    for first_is_short in [true, false] {
        let [first, second] = if first_is_short {
            [short(), slave("drive", clock(0, 0))]
        } else {
            [slave("drive", clock(0, 0)), short()]
        };
        let mut rig = Rig::of(Chain::line([first, second]));
        rig.net.now = 20 * SECOND;
        let now = rig.net.now;
        rig.net.chain.advance(now);
        rig.scan();
        let kinds = ["drive", "drive"];
        rig.bring_to_op_with(&kinds, DriveSync::DcSync);
        let check = |rig: &mut Rig| {
            rig.run_for(3 * CYCLE);
            let paced = rig.last.reference_time.expect("a reference");
            for n in 0..2 {
                let of = |time: u64| match first_is_short == (n == 0) {
                    true => paced.wrapping_add_signed((time as u32).wrapping_sub(paced as u32).cast_signed().into()),
                    false => time,
                };
                let time = of(rig.net.chain.slave(n).controller().system_time_ns());
                assert!(time.abs_diff(paced) < 2 * CYCLE, "slave {n}: {time} {paced}");
                let start = of(u64::from_le_bytes(register(rig, n, registers::SYNC0_START)));
                assert!(start % CYCLE == 0 && start.abs_diff(paced) < 2 * SECOND, "slave {n}: {start} {paced}");
            }
        };
        check(&mut rig);
        let now = rig.net.now;
        rig.net.chain.power(1, false, now);
        rig.run_for(50 * MS);
        let now = rig.net.now;
        rig.net.chain.power(1, true, now);
        rig.run_for(100 * MS);
        let second: SlaveSet = [2].into_iter().collect();
        assert_eq!(rig.request(second, AlState::PreOp), Ok(()));
        rig.map(2, "drive", DriveSync::DcSync);
        assert_eq!(rig.request(second, AlState::Op), Ok(()));
        check(&mut rig);
    }
}

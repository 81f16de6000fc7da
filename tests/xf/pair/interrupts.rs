//! INT0 and INT1.

use ecmsk::xf::chip::Profile;
use ecmsk::xf::host::{HostConfig, HostPacing};
use ecmsk::xf::request::{
    GpioChannel, GpioIntEnable, GpioTrigger, InfoUpdate, InterruptEnable, InterruptGetEnable, InterruptSetEnable,
    PeripheralInterrupts, Polarity,
};
use ecmsk::xf::{EtherCatState, Interrupts};

use super::{MS, Pair, drive};

fn enable(polarity: Polarity, sources: Interrupts) -> InterruptSetEnable {
    InterruptSetEnable {
        enable: InterruptEnable { polarity, sources, gpio: 0, peripherals: PeripheralInterrupts::NONE },
    }
}

pub fn int1(pair: &mut Pair) -> bool {
    let now = pair.now;
    pair.chip().int1(now)
}

/// XF-13.1 XF-11.46 XF-11.47 XF-11.48 INT_SET_ENABLE (XF EN 1310): INT1 is active, low at first, while a flag that is
/// enabled is set; the header of the next packet clears it. INT_GET_ENABLE (XF EN 1327) returns the setting.
#[test]
pub fn int1_and_its_flags() {
    let mut pair = Pair::running();
    let cleared = |pair: &mut Pair| {
        pair.host.clear_interrupts(Interrupts::CRC, 0);
        pair.run(&InfoUpdate);
        !pair.header().interrupts.contains(Interrupts::CRC)
    };
    let first = pair.get(&InterruptGetEnable, |enable| enable);
    assert_eq!(first, enable(Polarity::INT0_HIGH, Interrupts::NONE).enable);
    pair.damages_next = true;
    pair.run(&InfoUpdate);
    assert!(pair.header().interrupts.contains(Interrupts::CRC), "it is set whether it is enabled or not");
    assert!(int1(&mut pair), "and INT1 is inactive, high");
    for (polarity, active) in [(Polarity::INT0_HIGH, false), (Polarity::INT0_HIGH | Polarity::INT1_HIGH, true)] {
        let set = enable(polarity, Interrupts::CRC);
        pair.run(&set);
        assert_eq!(pair.get(&InterruptGetEnable, |enable| enable), set.enable);
        assert_eq!(int1(&mut pair), active);
        assert!(cleared(&mut pair));
        assert_eq!(int1(&mut pair), !active);
        pair.damages_next = true;
        pair.run(&InfoUpdate);
        assert_eq!(int1(&mut pair), active);
    }
    pair.run(&enable(Polarity::INT0_HIGH, Interrupts::ETHERCAT));
    assert!(int1(&mut pair), "another one is enabled");
    let peripherals = PeripheralInterrupts::GPIO_9;
    let all = InterruptEnable { polarity: Polarity::INT1_HIGH, sources: Interrupts::CRC, gpio: 0x81, peripherals };
    pair.run(&InterruptSetEnable { enable: all });
    assert_eq!(pair.get(&InterruptGetEnable, |enable| enable), all);
}

/// XF-11.46 XF-11.48 Each cycle raises the flag of the process data, each wrong working counter its own; the header
/// clears both.
#[test]
fn flags_of_cycles() {
    let mut pair = Pair::in_state(EtherCatState::SafeOp);
    let flags = |pair: &mut Pair| pair.header_now().interrupts;
    pair.run(&enable(Polarity::INT0_HIGH, Interrupts::WORKING_COUNTER));
    assert!(flags(&mut pair).contains(Interrupts::ETHERCAT));
    for is_silent in [false, true, false] {
        pair.silence(0, is_silent);
        pair.pass(2 * MS);
        pair.host.clear_interrupts(Interrupts::ETHERCAT | Interrupts::WORKING_COUNTER, 0);
        pair.run(&InfoUpdate);
        pair.pass(5 * MS);
        let flags = flags(&mut pair);
        assert!(flags.contains(Interrupts::ETHERCAT), "the next cycle sets it again");
        assert_eq!(flags.contains(Interrupts::WORKING_COUNTER), is_silent);
        assert_eq!(int1(&mut pair), !is_silent, "active is low");
    }
}

/// XF-13.1 XF-11.52 Masks of INT_SET_ENABLE for GPIO 0 to 7 and 8 to 11 (XF EN 1310): a channel raises INT1 by its own
/// bit alone.
#[test]
fn int1_and_gpio() {
    for (channel, gpio, peripherals) in
        [(3, 1 << 3, PeripheralInterrupts::NONE), (10, 0, PeripheralInterrupts::GPIO_10)]
    {
        for other in [false, true] {
            let mut pair = Pair::running();
            let wired = if other { channel + 1 } else { channel };
            let edges =
                GpioIntEnable { channel: GpioChannel::new(wired).expect("0 to 19"), trigger: GpioTrigger::Both };
            pair.run(&edges);
            let enable =
                InterruptEnable { polarity: Polarity::INT0_HIGH, sources: Interrupts::NONE, gpio, peripherals };
            pair.run(&InterruptSetEnable { enable });
            let now = pair.now;
            pair.chip().wire_gpio(now, wired, Some(true));
            assert_eq!(int1(&mut pair), other, "active is low");
            pair.host.clear_interrupts(Interrupts::NONE, 1 << wired);
            pair.run(&InfoUpdate);
            assert!(int1(&mut pair));
        }
    }
}

/// XF-13.1 XF-11.47 INT0 (XF EN 1706) is high when the chip is ready: a driver that uses it exchanges faster than one
/// with 150 us of idle time, and none of its packets meets a chip that is not ready; while the chip starts it does not
/// come, and the driver waits.
#[test]
fn int0_paces() {
    let exchanges = |pacing, skips_to: EtherCatState| {
        let config = HostConfig { pacing, ..HostConfig::DEFAULT };
        let mut pair = Pair::running_with(Profile::OLD, config, vec![drive()]);
        pair.bring_to(skips_to);
        let (before, since) = (pair.host.counters(), pair.now);
        for _ in 0..50 {
            pair.run(&InterruptGetEnable);
        }
        let counters = pair.host.counters();
        assert_eq!((counters.not_ready, counters.int0_missed), (before.not_ready, before.int0_missed));
        pair.now - since
    };
    let (idle, int0) = (exchanges(HostPacing::Idle, EtherCatState::Op), exchanges(HostPacing::Int0, EtherCatState::Op));
    assert!(int0 < idle, "{int0} {idle}");
}

/// XF-13.1 With bit 1 of INT_SET_ENABLE's parameter clear INT0 is low when the chip is ready (XF EN 1310).
#[test]
fn int0_of_the_other_polarity() {
    let low = enable(Polarity::NONE, Interrupts::NONE);
    let config = HostConfig { pacing: HostPacing::Int0, ..HostConfig::DEFAULT };
    let mut pair = Pair::running_with(Profile::OLD, config, vec![]);
    pair.int0_active = false;
    let ticket = pair.submit(&low);
    // Until the chip has taken the command, its line keeps the old polarity.
    for _ in 0..3 {
        let now = pair.now + MS;
        pair.turn(now);
        pair.host.ready(pair.now);
    }
    pair.result(ticket, &low, |()| ()).expect("it was taken");
    let counters = pair.host.counters();
    for _ in 0..50 {
        pair.run(&InterruptGetEnable);
    }
    assert_eq!(pair.host.counters().int0_missed, counters.int0_missed);

    // Wired for the other polarity the driver takes "busy" for "ready": the chip answers "not ready", and nothing is
    // lost.
    pair.int0_active = true;
    let before = pair.host.counters();
    for _ in 0..50 {
        pair.run(&InterruptGetEnable);
    }
    let after = pair.host.counters();
    assert!(after.not_ready > before.not_ready && after.answers_lost == 0, "{after:?}");
}

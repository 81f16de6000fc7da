//! The latch inputs of distributed clocks: the system times of their edges.

use ecmsk::ethercat::registers::{self, LatchEdge, latch_time};
use ecmsk::ethercat::{Command, Ns};
use ecmsk::slave::esc::EscSettings;

use super::rig::{FIRST, MS, Rig, US, drive};

use LatchEdge::{Negative, Positive};

/// Switches the input on or off at that time.
fn set(rig: &mut Rig, input: usize, is_on: bool, at: Ns) {
    rig.chain.slave_mut(0).controller_mut().set_latch_input(input, is_on, at);
}

fn time(rig: &mut Rig, input: usize, edge: LatchEdge) -> u64 {
    rig.read_u64(FIRST, latch_time(input, edge))
}

fn status(rig: &mut Rig) -> [u8; 2] {
    [0, 1].map(|input| rig.read_u8(FIRST, registers::LATCH_STATUS + input))
}

/// Whether the masters', and the device's, event of a latch is set.
fn events(rig: &mut Rig) -> (bool, bool) {
    let of_master = rig.read_u16(FIRST, registers::ECAT_EVENT) & 1;
    let of_device = rig.read_u32(FIRST, registers::AL_EVENT) >> 1 & 1;
    (of_master == 1, of_device == 1)
}

/// ECAT-13.6 In the continuous mode the time of each edge is kept, of each input and direction on its own; there is no event.
#[test]
fn each_edge_is_kept() {
    let mut rig = Rig::drives(1);
    let at = rig.now + 10 * MS;
    for (n, input) in [(0, 0), (1, 1), (2, 0)] {
        let at = at + n * MS;
        rig.now = at;
        set(&mut rig, input, true, at + 3);
        set(&mut rig, input, true, at + 5);
        assert_eq!(status(&mut rig)[input] & 0b100, 0b100, "the level of the input");
        set(&mut rig, input, false, at + 7);
        assert_eq!(status(&mut rig)[input], 0);
        assert_eq!((time(&mut rig, input, Positive), time(&mut rig, input, Negative)), (at + 3, at + 7));
        assert_eq!(events(&mut rig), (false, false));
    }
    assert_eq!((time(&mut rig, 1, Positive), time(&mut rig, 1, Negative)), (at + MS + 3, at + MS + 7));
}

/// ECAT-13.6 The times are those of the distributed clock: an offset counts, the delay from the reference does not.
#[test]
fn times_are_system_times() {
    let mut rig = Rig::drives(1);
    rig.write(FIRST, registers::SYSTEM_TIME_OFFSET, &(1_u64 << 40).to_le_bytes());
    rig.write(FIRST, registers::SYSTEM_TIME_DELAY, &777_u32.to_le_bytes());
    let at = rig.now;
    set(&mut rig, 0, true, at);
    assert_eq!(time(&mut rig, 0, Positive), (1 << 40) + at);
}

/// ECAT-13.7 In the single mode the first edge is kept until its time is read: its bit of the status and the event for the master
/// are set until then, and the next edge counts after it.
#[test]
fn the_first_edge_waits_until_it_is_read() {
    for (input, edge) in [(0, Positive), (0, Negative), (1, Positive), (1, Negative)] {
        let mut rig = Rig::drives(1);
        rig.write(FIRST, registers::LATCH_CONTROL + input as u16, &[edge.bit()]);
        rig.write(FIRST, registers::ECAT_EVENT_MASK, &[1, 0]);
        let at = rig.now + MS;
        rig.now = at;
        for n in 0..4 {
            set(&mut rig, input, n % 2 == 0, at + n * US);
        }
        let first = if edge == Positive { at } else { at + US };
        let mut expected = [0; 2];
        expected[input] = edge.bit();
        assert_eq!((status(&mut rig), events(&mut rig)), (expected, (true, false)), "{input} {edge:?}");
        assert_eq!(rig.one(Command::Nop, 0, 0, &[]).header.irq, 1, "each datagram tells it");
        // The other direction is continuous, and reading its time acknowledges nothing.
        let other = if edge == Positive { Negative } else { Positive };
        assert_eq!(time(&mut rig, input, other), at + if edge == Positive { 3 } else { 2 } * US);
        assert_eq!(status(&mut rig), expected);
        // Without the first byte nothing is acknowledged.
        rig.read(FIRST, latch_time(input, edge) + 1, 7);
        assert_eq!(status(&mut rig), expected);
        assert_eq!(time(&mut rig, input, edge), first);
        assert_eq!((status(&mut rig), events(&mut rig)), ([0; 2], (false, false)));
        let again = at + 10 * US;
        set(&mut rig, input, true, again);
        set(&mut rig, input, false, again + 1);
        let again = if edge == Positive { again } else { again + 1 };
        assert_eq!(time(&mut rig, input, edge), again, "{input} {edge:?}");
    }
}

/// ECAT-13.7 The mode is changed to continuous: a waiting edge is no event any more.
#[test]
fn back_to_the_continuous_mode() {
    let mut rig = Rig::drives(1);
    rig.write(FIRST, registers::LATCH_CONTROL, &[3, 0]);
    let at = rig.now;
    set(&mut rig, 0, true, at);
    assert_eq!((status(&mut rig), events(&mut rig)), ([5, 0], (true, false)));
    rig.write(FIRST, registers::LATCH_CONTROL, &[0]);
    assert_eq!((status(&mut rig), events(&mut rig)), ([4, 0], (false, false)));
}

/// ECAT-13.8 An input of the slave's own controller reports its edges to that, and the master neither sets nor
/// acknowledges them; times and status can be read, and never written.
#[test]
fn an_input_of_the_slaves_own_controller() {
    let mut rig = Rig::drives(1);
    rig.write(FIRST, registers::LATCH_CONTROL, &[1, 1]);
    rig.write(FIRST, registers::CYCLIC_UNIT_CONTROL, &[0x10]);
    rig.write(FIRST, registers::LATCH_CONTROL, &[0, 0]);
    assert_eq!(rig.read(FIRST, registers::LATCH_CONTROL, 2), [1, 0]);
    let at = rig.now;
    set(&mut rig, 0, true, at);
    assert_eq!((status(&mut rig), events(&mut rig)), ([5, 0], (false, true)));
    assert_eq!(time(&mut rig, 0, Positive), at);
    assert_eq!(status(&mut rig), [5, 0], "reading acknowledges nothing");
    rig.write(FIRST, registers::CYCLIC_UNIT_CONTROL, &[0]);
    assert_eq!(events(&mut rig), (true, false), "it is the master's now");
    for address in [registers::LATCH_STATUS, registers::LATCH_TIMES, registers::EVENT_TIMES] {
        assert_eq!(rig.one(Command::Fpwr, FIRST, address, &[0xFF]).wkc, 0, "0x{address:04X}");
    }
    // Times of the events of sync managers are not kept.
    assert_eq!(rig.read(FIRST, registers::EVENT_TIMES, 16), [0; 16]);
}

/// ECAT-13.6 A controller without distributed clocks, and a missing input, have none.
#[test]
fn no_such_input() {
    let mut rig = Rig::drives(1);
    let before = rig.read(FIRST, registers::LATCH_CONTROL, 40);
    let at = rig.now;
    set(&mut rig, 2, true, at);
    assert_eq!(rig.read(FIRST, registers::LATCH_CONTROL, 40), before);
    let features = registers::Features::NONE;
    let mut rig = Rig::with_stations([drive(EscSettings { features, ..EscSettings::default() })]);
    set(&mut rig, 0, true, 0);
    assert_eq!(rig.one(Command::Fprd, FIRST, registers::LATCH_STATUS, &[0; 2]).wkc, 0);
}

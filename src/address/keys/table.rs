//! The table of all keys of link URIs. The options structs that hold the values are in files named `options.rs` and
//! `*_options.rs`, see `keys.rs`.

use super::{Fraction, Key, Scheme, Syntax};
use crate::fieldbus::xf::{LocalPins, XfBusOptions};
use crate::xf::DataSize;

/// The largest value of keys for short times, in milliseconds: one hour. \[OURS]
const HOUR_MS: u64 = 3_600_000;
const DAY_MS: u64 = 24 * HOUR_MS;

/// Links to a board that determines the slot size itself, by a jumper or through its server. The key `slot` then only
/// checks it.
const USB_AND_TCP: &[Scheme] = &[Scheme::Usb, Scheme::Tcp];
/// The slowest rate of a board's clock: 0.001, at which a cycle of 250 us takes a quarter of a second. \[OURS]
const RATE_MIN: Fraction = Fraction::from_billionths(1_000_000);
/// Boards that are modelled in this process, with simulated slaves.
const SIMULATED: &[Scheme] = &[Scheme::Sim, Scheme::XfSim];
const SPI: &[Scheme] = &[Scheme::Spi];
const TCP: &[Scheme] = &[Scheme::Tcp];
const USB: &[Scheme] = &[Scheme::Usb];
const XF_SIM: &[Scheme] = &[Scheme::XfSim];
const XF_SPI: &[Scheme] = &[Scheme::XfSpi];
const XF_USB: &[Scheme] = &[Scheme::XfUsb];
/// Boards whose EC01M is a model in this process, with simulated slaves, slaves behind a chip, or slaves on a network card.
const MODELLED: &[Scheme] = &[Scheme::Sim, Scheme::XfSim, Scheme::XfSpi, Scheme::XfUsb, Scheme::Nic];
const NIC: &[Scheme] = &[Scheme::Nic];
/// Links that contain an ECM-XF chip.
const XF: &[Scheme] = &[Scheme::XfSim, Scheme::XfSpi, Scheme::XfUsb];
/// Links to a chip with a selectable packet size; an ECM-XFU has a fixed one.
const XF_ON_SPI: &[Scheme] = &[Scheme::XfSim, Scheme::XfSpi];
/// The number of a USB endpoint for packets; endpoint 0 is the control endpoint (USB 2.0 9.6.6).
const ENDPOINT: Syntax = Syntax::Number(1, 15);
/// The number of data bytes in a packet of an ECM-XF.
const DATA_SIZE: Syntax = Syntax::Number(DataSize::MIN.bytes() as u64, DataSize::MAX.bytes() as u64);

/// The range of the bounds of a flight recorder. With a board of few slaves the smallest bound, 16 MB, has room for the
/// 40 s of a moment. \[OURS]
const FLIGHT_BYTES: Syntax = Syntax::Bytes(16_000_000, 1_000_000_000_000);

const SLOT: Syntax = Syntax::Choice(&["12", "16"]);

/// The table of all keys, in the order in which a URI's normal form writes them.
///
/// The following values are in no manual; this project chose them \[OURS]: the defaults of `slaves`, `host_us` (one USB
/// microframe), `state_timeout_ms` (rules SK-4), `sdo_timeout_ms` (rules SK-6), `catch_up_ms`, `transfers`, `prefill`,
/// `fault.seed`, `fault.delay_ms` and of the keys of `tcp:`; the lower limit of `speed`; and the limits of all ranges.
#[rustfmt::skip]
pub const KEYS: &[Key] = &[
    Key {
        name: "slaves", schemes: SIMULATED, syntax: Syntax::Slaves, default: Some("drive*2"), example: "drive*2,io",
        meaning: "the slaves on the network, in order, e.g. drive*2,io; none: a board that finds no slave; a kind may have its \
                  travel behind it, e.g. drive:limits@-200000..300000, and the objects of its maker, drive:objects@FILE (see below)",
    },
    Key {
        name: "machine", schemes: SIMULATED, syntax: Syntax::File, default: None, example: "machine.toml",
        meaning: "a machine file, whose slaves are simulated, in the place of slaves=; not given: none",
    },
    Key {
        name: "slot", schemes: MODELLED, syntax: SLOT, default: Some("12"), example: "16",
        meaning: "bytes of a slot (CONFIG2): 12 for up to 40 slaves, 16 for up to 30",
    },
    Key {
        name: "slot", schemes: SPI, syntax: SLOT, default: Some("12"), example: "16",
        meaning: "bytes of a slot (CONFIG2) and so of an exchange, 504 or 512; an error proposes what fits the answers",
    },
    Key {
        name: "slot", schemes: USB_AND_TCP, syntax: SLOT, default: None, example: "16",
        meaning: "bytes of a slot (CONFIG2); not given: the link does not say",
    },
    Key {
        name: "clock", schemes: SIMULATED, syntax: Syntax::Choice(&["real", "virtual"]), default: Some("real"),
        example: "virtual",
        meaning: "virtual: the board's time passes by calls only, so that hours pass in seconds",
    },
    Key {
        name: "fw", schemes: MODELLED, syntax: Syntax::Choice(&["1.7", "1.5"]), default: Some("1.7"), example: "1.5",
        meaning: "the firmware that is modelled",
    },
    Key {
        name: "test", schemes: MODELLED, syntax: Syntax::Choice(&["0", "1"]), default: Some("0"), example: "1",
        meaning: "1: test mode (CONFIG1 high): the board goes to OP by itself and walks the outputs of all io slaves",
    },
    Key {
        name: "name", schemes: SIMULATED, syntax: Syntax::Name, default: None, example: "left-arm",
        meaning: "a name of its own for this board; not given: the board without a name",
    },
    Key {
        name: "host_us", schemes: MODELLED, syntax: Syntax::Number(0, 1_000_000), default: Some("125"), example: "0",
        meaning: "how long a write takes, in us",
    },
    Key {
        name: "state_timeout_ms", schemes: MODELLED, syntax: Syntax::Number(1, HOUR_MS), default: Some("10000"),
        example: "2000",
        meaning: "how long a change of state may take, in ms",
    },
    Key {
        name: "sdo_timeout_ms", schemes: MODELLED, syntax: Syntax::Number(1, HOUR_MS), default: Some("1000"),
        example: "100",
        meaning: "how long a slave may take for an SDO, in ms",
    },
    Key {
        name: "priority", schemes: MODELLED, syntax: Syntax::Number(1, 99), default: None, example: "50",
        meaning: "real-time priority (SCHED_FIFO) of the cycle's thread; not given: an ordinary thread",
    },
    Key {
        name: "cpu", schemes: MODELLED, syntax: Syntax::Number(0, 1023), default: None, example: "3",
        meaning: "the processor that the cycle's thread runs on, from 0, such as one that isolcpus= keeps free; not given: any",
    },
    Key {
        name: "second", schemes: NIC, syntax: Syntax::Name, default: None, example: "eth2",
        meaning: "a second network card, at the other end of the slaves' cable: a cable may be cut then without loss; not \
                  given: none",
    },
    Key {
        name: "lock_memory", schemes: MODELLED, syntax: Syntax::Choice(&["no", "yes"]), default: Some("no"),
        example: "yes",
        meaning: "keep the process in memory (mlockall), so that no cycle waits for a page",
    },
    Key {
        name: "catch_up_ms", schemes: SIMULATED, syntax: Syntax::Number(0, DAY_MS), default: Some("60000"),
        example: "0",
        meaning: "how much of the time that a board was closed it runs through when opened again, in ms",
    },
    Key {
        name: "rate", schemes: SIMULATED, syntax: Syntax::Fraction(RATE_MIN, Fraction::ONE), default: Some("1"),
        example: "0.1",
        meaning: "how fast the board's time passes on clock=real, e.g. 0.1: ten times slower than the machine's, for \
                  hosts that are too slow for its cycle; all times of frames stay board time",
    },
    Key {
        name: "script", schemes: SIMULATED, syntax: Syntax::File, default: None, example: "/tmp/cut.ecmscript",
        meaning: "a text file of what happens when, such as `at 2s alarm 1 0x7500` (see below); not given: nothing",
    },
    Key {
        name: "control", schemes: SIMULATED, syntax: Syntax::File, default: None, example: "press",
        meaning: "a name, or the path of a Unix socket, by which `ecmsk fault` makes the events of scripts happen while a program \
                  runs; for a board, not on Windows; not given: none",
    },
    Key {
        name: "role", schemes: TCP, syntax: Syntax::Choice(&["writer", "reader"]), default: Some("writer"),
        example: "reader",
        meaning: "writer: the one client that sends commands, refused while there is another; reader: gets every report \
                  and sends nothing",
    },
    Key {
        name: "secret_file", schemes: TCP, syntax: Syntax::File, default: None, example: "ecmsk.secret",
        meaning: "the file with the secret that the server has too: the connection is encrypted, and both ends show that \
                  they know it; not given: the variable ECMSK_TCP_SECRET, which stays in the process (its children and \
                  a core dump of it have that, too), and without that no secret",
    },
    Key {
        name: "keepalive_ms", schemes: TCP, syntax: Syntax::Number(50, HOUR_MS), default: Some("500"), example: "2000",
        meaning: "each end says at least this often that it is there, in ms; the connection is lost after four times \
                  that without a word",
    },
    Key {
        name: "hang_ms", schemes: TCP, syntax: Syntax::Number(0, HOUR_MS), default: Some("0"), example: "5000",
        meaning: "a writer whose program makes no call for that long, in ms, while a velocity or a torque that it has \
                  commanded is in force counts as dead: its axes are braked; 0: however long, for a program may set a \
                  velocity and sleep",
    },
    Key {
        name: "connect_timeout_ms", schemes: TCP, syntax: Syntax::Number(1, HOUR_MS), default: Some("3000"),
        example: "500",
        meaning: "how long connecting may take, in ms",
    },
    Key {
        name: "reconnect_ms", schemes: TCP, syntax: Syntax::Number(0, DAY_MS), default: Some("0"), example: "60000",
        meaning: "how long a reader whose connection is lost tries to connect again, in ms; a writer never does",
    },
    Key {
        name: "chip_fw", schemes: XF_SIM, syntax: Syntax::Choice(&["new", "old", "xfu"]), default: Some("new"),
        example: "old",
        meaning: "the chip: new, firmware 0x22 with packets of 1024 bytes of data; old, firmware 0x0E with 112 and \
                  without LRW; xfu, an ECM-XFU with 992",
    },
    Key {
        name: "network", schemes: XF_SIM, syntax: Syntax::Choice(&["models", "controllers"]), default: None,
        example: "controllers",
        meaning: "what is between the chip and its slaves: models, calls, which are fast; controllers, frames and a slave \
                  controller for each, with registers, EEPROMs, files and mailboxes; not given: models under a board, controllers \
                  for a program of the chip",
    },
    Key {
        name: "n", schemes: XF_SIM, syntax: DATA_SIZE, default: None, example: "112",
        meaning: "bytes of data in a packet when the chip has got its power; not given: what chip_fw has",
    },
    Key {
        name: "crc_over", schemes: XF_SIM,
        syntax: Syntax::Choice(&[
            "all", "valid", "valid4", "all,valid", "all,valid4", "valid,all", "valid,valid4", "valid4,all", "valid4,valid",
        ]),
        default: Some("all"), example: "all,valid",
        meaning: "what a CRC-32 of the chip covers of a packet's data: all of them; valid, as many as its header says; valid4, the \
                  same up to the next multiple of 4; A,B: A in commands and B in answers",
    },
    Key {
        name: "use_n", schemes: XF_ON_SPI, syntax: DATA_SIZE, default: None, example: "256",
        meaning: "bytes of data in a packet that the chip is set to at the start; not given, as it has to be for chip_fw=xfu: it keeps \
                  what it has",
    },
    Key {
        name: "idle_us", schemes: XF, syntax: Syntax::Number(0, 1_000_000), default: Some("150"), example: "100",
        meaning: "how long nothing is sent after a packet, in us, while INT0 does not say when the chip is ready",
    },
    Key {
        name: "ahead", schemes: XF, syntax: Syntax::Number(1, XfBusOptions::AHEAD_MAX as u64), default: Some("4"),
        example: "16",
        meaning: "for how many cycles a machine may be late while a program streams: as many cycles' outputs lie in the \
                  chip, and 3 to 6 more for the transport, so that they were computed so many cycles ago",
    },
    Key {
        name: "local_in", schemes: XF, syntax: Syntax::Pins(LocalPins::INPUT_MAX), default: None,
        example: "4,5,6,7,8,9",
        meaning: "the chip's GPIO numbers of the board's local inputs 0 to 5 (LIO_RD), - for one that is not wired; not given: \
                  none is, and they read 0",
    },
    Key {
        name: "local_out", schemes: XF, syntax: Syntax::Pins(LocalPins::OUTPUT_MAX), default: None,
        example: "0,1,2,-,10,11",
        meaning: "the chip's GPIO numbers of the board's local outputs 0 to 5 (LIO_WR), - for one that is not wired; not given: \
                  what is written goes nowhere",
    },
    Key {
        name: "int0", schemes: XF_SIM, syntax: Syntax::Choice(&["no", "yes"]), default: Some("no"), example: "yes",
        meaning: "yes: INT0 is wired, which says when the chip is ready for the next packet",
    },
    Key {
        name: "int0", schemes: XF_SPI, syntax: Syntax::Line, default: None, example: "gpiochip0/24",
        meaning: "the line that INT0 is connected to, by number or name: it says when the chip is ready for the next \
                  packet; not given: idle_us= is left behind each packet",
    },
    Key {
        name: "int0_active", schemes: XF_SPI, syntax: Syntax::Choice(&["high", "low"]), default: Some("high"),
        example: "low",
        meaning: "the level of int0= while the chip is ready: high, as it starts; low, if something inverts it on the \
                  way, or the program sets that (INT_SET_ENABLE)",
    },
    Key {
        name: "int1", schemes: XF_SPI, syntax: Syntax::Line, default: None, example: "gpiochip0/25",
        meaning: "the line that INT1 (pin 7) is connected to, by number or name; not given: the program cannot read it",
    },
    Key {
        name: "reset", schemes: XF_SPI, syntax: Syntax::Line, default: None, example: "gpiochip0/23",
        meaning: "the line that the chip's reset is connected to, by number or name, low for 100 ms to reset it, whoever opens the \
                  link, `ecmsk xf` too; not given: the chip is taken as it is",
    },
    Key {
        name: "reset_at", schemes: XF_SPI, syntax: Syntax::Choice(&["open", "close", "both"]), default: Some("open"),
        example: "both",
        meaning: "when reset= resets the chip: when the link is opened, when it is closed, so that nothing is sent to the slaves any \
                  more, or both",
    },
    Key {
        name: "speed", schemes: XF_ON_SPI, syntax: Syntax::Hertz(100_000, 96_000_000), default: Some("24M"),
        example: "12M",
        meaning: "frequency of the clock of SPI, in Hz",
    },
    Key {
        name: "vid", schemes: XF_USB, syntax: Syntax::UsbId, default: None, example: "1234",
        meaning: "idVendor of the ECM-XFU as `lsusb` shows it, which no manual tells; it has to be given",
    },
    Key {
        name: "pid", schemes: XF_USB, syntax: Syntax::UsbId, default: None, example: "abcd",
        meaning: "idProduct of the ECM-XFU as `lsusb` shows it, which no manual tells; it has to be given",
    },
    Key {
        name: "ep_out", schemes: XF_USB, syntax: ENDPOINT, default: None, example: "2",
        meaning: "the number of its endpoint that takes packets, as `lsusb -v` shows it, which no manual tells; it has to \
                  be given",
    },
    Key {
        name: "ep_in", schemes: XF_USB, syntax: ENDPOINT, default: None, example: "1",
        meaning: "the number of its endpoint that gives packets, as `lsusb -v` shows it, which no manual tells; it has to \
                  be given",
    },
    Key {
        name: "queue", schemes: &Scheme::ALL, syntax: Syntax::Number(1, 65_536), default: Some("32"), example: "1",
        meaning: "reports kept while nobody reads: the newest ones",
    },
    Key {
        name: "record", schemes: &Scheme::ALL, syntax: Syntax::File, default: None, example: "/tmp/board.pcapng",
        meaning: "write every frame to that file, for Wireshark and `ecmsk`; where a chip is opened and no board (`ecmsk xf`), \
                  every exchange; not given: no recording",
    },
    Key {
        name: "axes", schemes: &Scheme::ALL, syntax: Syntax::File, default: None, example: "/tmp/machine.toml",
        meaning: "a machine file: recordings carry it, and a target of a program beyond the limits of an axis is reported, or not sent if \
                  the file says so; not given: the one of machine=, if there is one",
    },
    Key {
        name: "flight", schemes: &Scheme::ALL, syntax: Syntax::Folder, default: None, example: "/tmp/flight",
        meaning: "keep the frames of the last hours in that folder, and what surrounds an alarm, a lost slave or a mark for longer \
                  (`ecmsk flight`); not given: no flight recorder",
    },
    Key {
        name: "flight_bytes", schemes: &Scheme::ALL, syntax: FLIGHT_BYTES, default: Some("1G"), example: "500M",
        meaning: "the most bytes of those frames; the oldest are deleted",
    },
    Key {
        name: "flight_kept_bytes", schemes: &Scheme::ALL, syntax: FLIGHT_BYTES, default: Some("1G"), example: "4G",
        meaning: "the most bytes of what is kept for longer",
    },
    Key {
        name: "flight_following_error", schemes: &Scheme::ALL, syntax: Syntax::Number(1, u32::MAX as u64), default: None,
        example: "500",
        meaning: "a following error of more counts is kept for longer, too; not given: however large it is",
    },
    Key {
        name: "read_timeout_ms", schemes: &Scheme::ALL, syntax: Syntax::Number(0, DAY_MS), default: None,
        example: "100",
        meaning: "a read fails after that time, in ms; not given: it waits until there is a report",
    },
    Key {
        name: "write_timeout_ms", schemes: &Scheme::ALL, syntax: Syntax::Number(0, DAY_MS), default: Some("5000"),
        example: "100",
        meaning: "a write that the board does not accept fails after that time, in ms",
    },
    Key {
        name: "speed", schemes: SPI, syntax: Syntax::Hertz(100_000, 24_000_000), default: Some("24M"), example: "8M",
        meaning: "the clock in Hz; a cycle of 250 us needs 24M, one of 1 ms 6M; with jumper wires less than 10M",
    },
    Key {
        name: "mode", schemes: SPI, syntax: Syntax::Choice(&["0", "1", "2", "3"]), default: Some("0"), example: "1",
        meaning: "SPI mode",
    },
    Key {
        name: "busy", schemes: SPI, syntax: Syntax::Line, default: None, example: "gpiochip0/25",
        meaning: "the line that BUSY is connected to (J3/J2 pin 5), by number or name; not given: exchanges begin 800 us \
                  apart, and cycles below 1 ms are refused",
    },
    Key {
        name: "reset", schemes: SPI, syntax: Syntax::Line, default: None, example: "gpiochip0/24",
        meaning: "the line that RESETN is connected to (J3/J2 pin 11): the board is reset when the link is opened; not \
                  given: it is taken as it is",
    },
    Key {
        name: "cycle_us", schemes: SPI, syntax: Syntax::Number(250, 1_000_000), default: Some("1000"), example: "500",
        meaning: "the cycle in OP until a SET_DC passes, in us: 250, 500, 1000 and so on; for a board that is in OP already",
    },
    Key {
        name: "prefill", schemes: SPI, syntax: Syntax::Number(0, 120), default: Some("0"), example: "16",
        meaning: "entries kept in the board's FIFO against gaps, so that the program may be late by so many cycles: the \
                  first motion waits for them; 0: none",
    },
    Key {
        name: "serial", schemes: USB, syntax: Syntax::Text, default: None, example: "7",
        meaning: "the board with this serial number; not given: the only one there is",
    },
    Key {
        name: "path", schemes: USB, syntax: Syntax::Name, default: None, example: "1-2.3",
        meaning: "the board at this place, bus and ports as Linux names them, on Windows the name that the error for several boards \
                  shows; not given: the only one there is",
    },
    Key {
        name: "transfers", schemes: USB, syntax: Syntax::Number(1, 64), default: Some("8"), example: "16",
        meaning: "transfers that wait for reports at a time, so that none is missed between two reads",
    },
    Key {
        name: "fault.seed", schemes: &Scheme::ALL, syntax: Syntax::Number(0, u64::MAX), default: Some("1"),
        example: "7",
        meaning: "which of all sequences of random faults; the same seed gives the same sequence in either direction",
    },
    fault_rate("fault.drop", "share of frames that are lost on the way, both directions"),
    fault_rate_one_direction(
        "fault.drop.write",
        "share of command frames that are lost: the write succeeds, the board gets nothing; not given: that for both",
    ),
    fault_rate_one_direction("fault.drop.read", "share of reports that are lost; not given: that for both"),
    fault_rate("fault.corrupt", "share of frames in which one bit is turned over, both directions"),
    fault_rate_one_direction(
        "fault.corrupt.write",
        "share of command frames with a bit turned over; not given: that for both",
    ),
    fault_rate_one_direction("fault.corrupt.read", "share of reports with a bit turned over; not given: that for both"),
    fault_rate("fault.duplicate", "share of frames that arrive twice, both directions"),
    fault_rate_one_direction(
        "fault.duplicate.write",
        "share of command frames that arrive twice; not given: that for both",
    ),
    fault_rate_one_direction("fault.duplicate.read", "share of reports that arrive twice; not given: that for both"),
    fault_rate("fault.delay", "share of frames that are held up for fault.delay_ms, both directions"),
    fault_rate_one_direction(
        "fault.delay.write",
        "share of command frames that are held up: the write takes longer, or reaches its limit; not given: that for both",
    ),
    fault_rate_one_direction(
        "fault.delay.read",
        "share of reports that are held up, and those behind them; none overtakes another; not given: that for both",
    ),
    Key {
        name: "fault.delay_ms", schemes: &Scheme::ALL, syntax: Syntax::Number(1, HOUR_MS), default: Some("10"),
        example: "200",
        meaning: "how long a frame is held up, in ms",
    },
    Key {
        name: "fault.disconnect_after", schemes: &Scheme::ALL, syntax: Syntax::Number(1, u64::MAX), default: None,
        example: "1000",
        meaning: "the board is lost after that many frames in both directions, until it is opened again; \
                  not given: never",
    },
    Key {
        name: "fault.disconnect_ms", schemes: &Scheme::ALL, syntax: Syntax::Number(1, DAY_MS), default: None,
        example: "2000",
        meaning: "the board is lost that long after it was opened, in ms, until it is opened again; not given: never",
    },
];

/// A key that sets how many frames of both directions a fault hits, as a fraction of all frames: 0 none, 1 every frame.
const fn fault_rate(name: &'static str, meaning: &'static str) -> Key {
    let syntax = Syntax::Fraction(Fraction::ZERO, Fraction::ONE);
    Key { name, schemes: &Scheme::ALL, syntax, default: Some("0"), example: "0.01", meaning }
}

/// A key like that of [`fault_rate`], for one direction only. For this direction it replaces the fraction of the key for
/// both.
const fn fault_rate_one_direction(name: &'static str, meaning: &'static str) -> Key {
    let syntax = Syntax::Fraction(Fraction::ZERO, Fraction::ONE);
    Key { name, schemes: &Scheme::ALL, syntax, default: None, example: "0.01", meaning }
}

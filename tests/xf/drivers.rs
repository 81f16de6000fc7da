//! Hosts like other drivers for the chip, on its model. They are written from what is known of those drivers, with their own
//! packet code, and use none of this project's encoders.
//!
//! | host | what is its own |
//! | --- | --- |
//! | driver 0.1 | its CRC-32 covers up to the next multiple of 4; of a return byte it looks at bit 1; no 402_CONFIG_SET |
//! | driver 1.60 | takes inputs only with bits 1 and 2 of the return byte; its CRC-32 covers all or the valid bytes |
//! | a closed client | clears all errors in every packet; covers all in commands and the valid bytes in answers; n is 512; takes NOP answers for answers; maps three PDOs |
//!
//! `drivers/peer.rs` is the host that they share; `drivers/rows.rs` lists all that is known of these drivers, each row with its
//! tests.

#[path = "drivers/peer.rs"]
mod peer;
#[path = "drivers/rows.rs"]
mod rows;

use ecmsk::xf::chip::Profile;
use ecmsk::xf::{CrcCoverage, CrcCoverages};

use peer::{
    Back, Command, Cover, DRIVES, MODES, MS, Peer, THREE_PDOS, WORDS, all, begin, command, over, settle, u32_at, valid,
    valid4, with_data,
};

/// Codes of driver 1.60 that the manuals leave out: EMAC_RESET, RTA, EMAC_INIT, extra PDO data, SPI_PACK_SIZE_SET.
const LEFT_OUT: [u8; 13] = [40, 60, 61, 62, 63, 64, 65, 128, 133, 134, 135, 136, 141];

/// The kinds of chip, and n at power-on.
const PROFILES: [(Profile, usize); 3] = [(Profile::OLD, 112), (Profile::NEW, 1024), (Profile::XFU, 992)];

/// XF-13.6 Driver 0.1 (2020): CRC-32 up to the next multiple of 4, inputs by bit 1 of the return byte, and the helper
/// controlled by 402_CTL_SET alone. The words are first in the PDOs; a mode that is mapped behind them stays the host's.
///
/// Rows: CRC-32 covers; 402_CTL_SET without 402_CONFIG_SET.
#[test]
fn driver_0_1() {
    for map in [&WORDS, &MODES] {
        let mut peer = Peer::new(over(CrcCoverage::Valid4, Profile::OLD), valid4, valid4);
        begin(&mut peer, 112);
        peer.init(0);
        peer.state(2);
        peer.map(map);
        peer.state(4);
        for motor in 0..DRIVES {
            peer.call(&command(29, motor, [1 << 4, 0x5A, DRIVES, motor]));
            assert_eq!(peer.errors, 0, "402_CTL_SET without 402_CONFIG_SET");
        }
        peer.switch_on_and_move(1 << 1);
    }
}

/// XF-13.6 Driver 1.60: CRC-32 over all, or over the valid bytes in one of its builds; inputs only with bits 1 and 2 of the
/// return byte. It asks for the clocks of slaves, and sends codes at start that the manuals leave out.
///
/// Rows: CRC-32 covers; PDO_DATA_OP, op 6; codes 40, 60..65, 128, 133..136, 141.
#[test]
fn driver_1_60() {
    for (coverage, cover) in [(CrcCoverage::All, all as Cover), (CrcCoverage::Valid, valid)] {
        let mut peer = Peer::new(over(coverage, Profile::NEW), cover, cover);
        begin(&mut peer, 1024);
        for code in LEFT_OUT {
            peer.call(&command(code, 0, [0; 4]));
            assert_eq!(peer.errors, 1 << 7, "code {code}: the command error");
            peer.control = 0x80;
            peer.well(&Command::default());
            peer.control = 0;
        }
        assert_eq!(peer.port.chip().unknown_commands(), LEFT_OUT.len() as u64);
        peer.init(0);
        peer.state(2);
        peer.map(&WORDS);
        peer.state(4);
        assert_eq!(peer.call(&command(15, 0, [13, 0, 0, 0])), [1], "the clock of slave 0 is on");
        for motor in 0..DRIVES {
            peer.call(&command(26, motor, [0, 0, 1 << 4 | 1 << 3, motor]));
            assert_eq!(peer.errors, 0);
        }
        peer.switch_on_and_move(1 << 1 | 1 << 2);
    }
}

/// XF-13.6 A closed client library: all of a command is covered and the valid bytes of an answer, n is set to 512 after a search
/// byte by byte, control 0xF8 stands in every packet, and an answer with the NOP flag is taken for one. A failed SDO is seen, and
/// none gives the bytes of the one before. It maps three PDOs of each direction, and reads 0x606B and 0x6074.
///
/// Rows: error bits of 0x09; CRC by direction; three PDOs of each direction.
#[test]
fn a_closed_client() {
    let coverages = CrcCoverages { commands: CrcCoverage::All, answers: CrcCoverage::Valid };
    let mut peer = Peer::new(Profile { coverages, ..Profile::NEW }, all, valid);
    (peer.control, peer.takes_nops) = (0xF8, true);
    peer.find_n();
    peer.exchange(&peer.packet(&Command { code: 23, len: 512, ..Command::default() }));
    peer.now += 100 * MS;
    peer.n = 512;
    peer.set_crc();
    settle(&mut peer);
    peer.call(&command(132, 20, [0; 4]));
    peer.init(500_000);
    peer.state(2);
    peer.map(&THREE_PDOS);
    for slave in 0..DRIVES {
        for (object, bytes) in [(0x606B, 4), (0x6074, 2)] {
            assert_eq!(peer.sdo(slave, object, &[], bytes), 0, "0x{object:04X} of slave {slave}");
            assert_eq!(peer.call(&command(11, 0, [0; 4])).len(), usize::from(bytes));
        }
    }
    assert_eq!(peer.sdo(0, 0x1000, &[], 4), 0);
    assert_eq!(peer.call(&command(11, 0, [0; 4])).len(), 4);
    assert_eq!(peer.sdo(0, 0x5FFF, &[], 4), 1 << 3, "the failure is shown once");
    assert_eq!(peer.call(&command(11, 0, [0; 4])), [0; 0], "and has no bytes");
    assert_eq!(peer.errors, 0);
    assert_eq!(u32_at(&peer.call(&command(69, 0, [0; 4])), 0), 0x0602_0000);
    peer.call(&command(54, 32, [0; 4]));
    peer.call(&command(52, 1, [0; 4]));
    peer.well(&command(66, 0, [0; 4]));
    peer.well(&command(41, 0xFF, [4, 0, 0, 0]));
    for motor in 0..DRIVES {
        peer.call(&command(26, motor, [0, 0, 0x90, motor]));
    }
    peer.switch_on_and_move(1 << 1);
}

/// XF-13.6 STATE_SET 0x12 after an error, as an application sends it to a chip of any kind: the error is acknowledged, and
/// PreOP reached.
///
/// Row: STATE_SET 0x12.
#[test]
fn a_state_with_the_acknowledge_bit() {
    for (profile, n) in PROFILES {
        let mut peer = Peer::new(profile, all, all);
        begin(&mut peer, n);
        peer.init(0);
        peer.state(2);
        assert_eq!(peer.run(&command(12, 0, [3, 0, 0, 0])), 1 << 3, "no slave knows Boot");
        peer.control = 1 << 3;
        peer.call(&command(13, 0, [0; 4]));
        peer.control = 0;
        assert_eq!(peer.ret, 0x12, "an error");
        peer.well(&command(12, 0, [0x12, 0, 0, 0]));
        peer.call(&command(13, 0, [0; 4]));
        assert_eq!(peer.ret, 2);
    }
}

/// XF-13.6 The items 10 to 13 of SLV_INFO_GET, which driver 0.1 knows and driver 1.60 uses, are there on a chip of any kind:
/// clock, cycle, shift, and whether the clock is active. Those above, of which the vendor's header has 27, are command errors.
///
/// Row: SLV_INFO items 10..13.
#[test]
fn items_of_the_clock() {
    for (profile, n) in PROFILES {
        let mut peer = Peer::new(profile, all, all);
        begin(&mut peer, n);
        peer.init(250_000);
        peer.state(2);
        peer.map(&WORDS);
        peer.state(4);
        let items = [10, 11, 12, 13].map(|item| {
            let answer = peer.call(&command(15, 1, [item, 0, 0, 0]));
            (peer.errors, answer.iter().rev().fold(0_u32, |value, byte| value << 8 | u32::from(*byte)))
        });
        assert_eq!(items, [(0, 1), (0, 1_000_000), (0, 250_000), (0, 1)]);
        for item in 14..=40 {
            assert_eq!(peer.call(&command(15, 1, [item, 0, 0, 0])), [0; 0]);
            assert_eq!(peer.errors, 1 << 7, "item {item}: the command error");
            peer.control = 0x80;
            peer.well(&Command::default());
            peer.control = 0;
        }
    }
}

/// XF-13.6 What the wire carries is not known of two points, which `docs/HARDWARE.md` asks. The model refuses PDO_CONFIG_SET with
/// vendor and product id first, of 156 bytes, and leaves the map as it is; a NOP answer to a command that is repeated has the
/// return byte 0, where driver 1.60 takes it for the value.
///
/// Rows: PDO_CONFIG with VID and PID first; NOP answer to the driver's own repeat.
#[test]
fn what_is_not_known() {
    let page = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/HARDWARE.md")).expect("the page");
    let page = page.split_whitespace().collect::<Vec<_>>().join(" ");
    for asked in ["take 156 bytes, vendor and product id first", "Does a NOP answer's return byte carry the value"] {
        assert!(page.contains(asked), "{asked}");
    }
    let mut peer = Peer::new(Profile::NEW, all, all);
    begin(&mut peer, 1024);
    peer.init(0);
    peer.state(2);
    peer.map(&WORDS);
    let mut data = vec![0; 156];
    data[12..14].copy_from_slice(&[0x12, 0x1C]);
    assert_eq!(peer.run(&with_data(7, 0, [0; 4], &data)), 1 << 7, "the command error");
    peer.control = 0x80;
    peer.well(&Command::default());
    peer.control = 0;

    peer.call(&command(132, 20, [0; 4]));
    peer.call(&command(131, 0, [0; 4]));
    assert_eq!(peer.ret, 20);
    let packet = peer.packet(&command(131, 0, [0; 4]));
    let Back::Answer(answer) = peer.exchange(&packet) else { panic!("no answer") };
    assert_eq!((answer[0x0A] >> 5 & 1, answer[0x0C], answer[0x0D]), (1, 131, 0), "a NOP answer");
}

//! FMMUs: logical addresses, to the bit.

use ecmsk::ethercat::registers::{self, Fmmu, FmmuDirections, SmControl, SyncManager};
use ecmsk::ethercat::{AlState, Command, DatagramHeader};
use ecmsk::slave::esc::EscSettings;
use ecmsk::slave::{Io, IoConfig};
use proptest::prelude::*;

use super::rig::{FIRST, OUTPUTS, Rig, slave};

const IMAGE: [u8; 6] = [1, 2, 3, 4, 5, 6];

/// ECAT-10.1 An FMMU gives the bytes of its area at its logical address; bytes around them pass, and an FMMU that is off, or
/// for the other direction, does nothing.
#[test]
fn s18_an_fmmu_maps_bytes() {
    let mut rig = Rig::drives(1);
    rig.write(FIRST, 0x1180, &IMAGE);
    let fmmu = Fmmu::bytes(0x0100_0002, 6, 0x1180, FmmuDirections::READ);
    rig.set_fmmu(FIRST, 3, fmmu);
    let answer = rig.logical(Command::Lrd, 0x0100_0000, &[0xEE; 10]);
    assert_eq!((answer.wkc, answer.data), (1, vec![0xEE, 0xEE, 1, 2, 3, 4, 5, 6, 0xEE, 0xEE]));
    // A part of it, from either side.
    let answer = rig.logical(Command::Lrd, 0x0100_0006, &[0xEE; 4]);
    assert_eq!((answer.wkc, answer.data), (1, vec![5, 6, 0xEE, 0xEE]));
    let answer = rig.logical(Command::Lrd, 0x0100_0000, &[0xEE; 3]);
    assert_eq!((answer.wkc, answer.data), (1, vec![0xEE, 0xEE, 1]));
    assert_eq!(rig.logical(Command::Lwr, 0x0100_0000, &[0xEE; 10]).wkc, 0);
    assert_eq!(rig.logical(Command::Lrd, 0x0100_0008, &[0xEE; 10]).wkc, 0);
    rig.set_fmmu(FIRST, 3, Fmmu { enabled: false, ..fmmu });
    let answer = rig.logical(Command::Lrd, 0x0100_0000, &[0xEE; 10]);
    assert_eq!((answer.wkc, answer.data), (0, vec![0xEE; 10]));
    // The last addresses there are.
    rig.set_fmmu(FIRST, 3, Fmmu::bytes(0xFFFF_FFFE, 6, 0x1180, FmmuDirections::READ));
    let answer = rig.logical(Command::Lrd, 0xFFFF_FFFC, &[0xEE; 6]);
    assert_eq!((answer.wkc, answer.data), (1, vec![0xEE, 0xEE, 1, 2, 3, 4]));
}

/// ECAT-10.1 Logical addresses end: a datagram at the last ones does not have the first ones.
#[test]
fn logical_addresses_end() {
    let mut rig = Rig::drives(1);
    rig.bring_to_op(FIRST, 0);
    let (outputs, inputs) = rig.lens(FIRST);
    let all = vec![0x55; 64];
    assert_eq!(rig.logical(Command::Lrw, 0_u32.wrapping_sub(16), &all).wkc, 0);
    assert_eq!(rig.logical(Command::Lrw, u32::from(outputs + inputs), &all).wkc, 0);
    assert_eq!(rig.logical(Command::Lrw, 0, &all).wkc, 3);
}

/// ECAT-10.1, ECAT-10.8 Areas that one datagram exchanges whole behave like those that come in parts: the same data,
/// registers of sync managers and watchdog, and the drive moves alike.
#[test]
fn whole_areas_are_exchanged_as_parts_are() {
    for control in [SmControl::OUTPUTS, SmControl::OUTPUTS.without(SmControl::WATCHDOG)] {
        let mut rigs = [Rig::drives(1), Rig::drives(1)];
        for rig in &mut rigs {
            rig.bring_to_preop(FIRST);
            assert_eq!(rig.set_process_data(FIRST, 0x20), 16);
            rig.write(FIRST, registers::sync_manager_activate(2), &[0]);
            rig.set_manager(FIRST, 2, SyncManager::enabled(OUTPUTS, 6, control));
            rig.reach(FIRST, AlState::SafeOp);
            rig.logical(Command::Lrw, 0x20, &[0; 16]);
            rig.reach(FIRST, AlState::Op);
        }
        for n in 0_u32..600 {
            let word = [0x06, 0x07, 0x0F][n.min(599) as usize / 200];
            let mut image = [0xEE; 16];
            image[..6].copy_from_slice(&[word, 0, n as u8, (n >> 8) as u8, 0, 0]);
            let whole = rigs[0].logical(Command::Lrw, 0x20, &image);
            let (first, last) =
                (DatagramHeader::new(Command::Lrw, 1, 0x20), DatagramHeader::new(Command::Lrw, 2, 0x28));
            let [first, last] = rigs[1].frame(&[(first, &image[..8]), (last, &image[8..])]).try_into().expect("two");
            assert_eq!(whole.data, [&first.data[..], &last.data].concat(), "cycle {n}");
            // Outputs and some inputs; the rest of the inputs.
            assert_eq!((whole.wkc, first.wkc, last.wkc), (3, 3, 1));
            if n % 50 == 7 {
                // A buffer that was begun and not completed.
                rigs.iter_mut().for_each(|rig| rig.write(FIRST, OUTPUTS, &[0x0F]));
            }
            let shown = |rig: &mut Rig| {
                let managers = rig.read(FIRST, registers::SYNC_MANAGER, 64);
                let watchdog = rig.read_u16(FIRST, registers::WATCHDOG_STATUS);
                (managers, watchdog, rig.read_u16(FIRST, registers::ECAT_EVENT), rig.read(FIRST, OUTPUTS + 18, 1))
            };
            let [of_whole, of_parts] = rigs.each_mut().map(shown);
            assert_eq!(of_whole, of_parts, "cycle {n}");
        }
        let shafts = rigs.each_ref().map(|rig| rig.chain.slave(0).device().shaft(0));
        assert_eq!(shafts[0], shafts[1]);
        assert!(shafts[0].is_some_and(|shaft| shaft > 500), "{shafts:?}");
    }
}

/// ECAT-10.2 An FMMU of one bit shows whether a mailbox is full; the bits of other slaves stay.
#[test]
fn s19_bits_of_several_slaves_share_a_byte() {
    let mut rig = Rig::drives(3);
    for n in 0..3 {
        rig.bring_to_preop(FIRST + n);
        let fmmu = Fmmu {
            first_bit: n as u8,
            last_bit: n as u8,
            physical_bit: 3,
            ..Fmmu::bytes(0x0900_0000, 1, registers::sync_manager_status(1), FmmuDirections::READ)
        };
        rig.set_fmmu(FIRST + n, 2, fmmu);
    }
    let upload =
        rig.message(ecmsk::ethercat::mailbox::MailboxProtocol::Coe, &[0, 0x20, 0x40, 0x18, 0x10, 1, 0, 0, 0, 0]);
    assert_eq!(rig.post(FIRST + 1, &upload), 1);
    let answer = rig.logical(Command::Lrd, 0x0900_0000, &[0xF5, 0xEE]);
    assert_eq!((answer.wkc, answer.data), (3, vec![0xF2, 0xEE]));
    rig.collect(FIRST + 1).expect("an answer");
    assert_eq!(rig.logical(Command::Lrd, 0x0900_0000, &[0xFF, 0xEE]).data, [0xF8, 0xEE]);
}

/// ECAT-10.2 Bits are written where they are mapped, and the others of their bytes stay.
#[test]
fn s19_bits_are_written() {
    let mut rig = Rig::drives(1);
    rig.write(FIRST, registers::DIGITAL_OUTPUTS, &[0xFF, 0xFF, 0xFF, 0xFF]);
    let fmmu = Fmmu {
        first_bit: 3,
        last_bit: 0,
        physical_bit: 1,
        ..Fmmu::bytes(0x0001_0011, 3, registers::DIGITAL_OUTPUTS + 1, FmmuDirections::WRITE)
    };
    rig.set_fmmu(FIRST, 0, fmmu);
    assert_eq!(rig.logical(Command::Lwr, 0x0001_0010, &[0xFF, 0x00, 0b0101_0101, 0x00]).wkc, 1);
    // 14 bits: 0000 0 from the first byte, 0101 0101 from the second, 0 from the third one.
    assert_eq!(rig.read(FIRST, registers::DIGITAL_OUTPUTS, 4), [0xFF, 0b0100_0001, 0b1001_0101, 0xFF]);
}

/// ECAT-10.3 LRW counts 2 for outputs and 1 for inputs of a slave; with both on the same logical bytes the slave gets the
/// master's bytes and the master the inputs.
#[test]
fn s20_outputs_and_inputs_in_one_datagram() {
    let io = |_| slave(Box::new(Io::new(IoConfig::default())), EscSettings::default());
    let mut rig = Rig::with_stations((0..2).map(io));
    let lens = rig.lens(FIRST);
    for n in 0..2 {
        rig.bring_to_op(FIRST + n, u32::from(n) * 100);
        // Both directions on the same bytes.
        let (outputs, inputs) = lens;
        let logical = u32::from(n) * u32::from(outputs.max(inputs));
        rig.set_fmmu(FIRST + n, 0, Fmmu::bytes(logical, outputs, super::rig::OUTPUTS, FmmuDirections::WRITE));
        rig.set_fmmu(FIRST + n, 1, Fmmu::bytes(logical, inputs, super::rig::INPUTS, FmmuDirections::READ));
    }
    let len = 2 * usize::from(lens.0.max(lens.1));
    let mut wanted = vec![0; len];
    (wanted[0], wanted[len / 2]) = (0x21, 0x43);
    let mut seen = Vec::new();
    for _ in 0..5 {
        let answer = rig.logical(Command::Lrw, 0, &wanted);
        assert_eq!(answer.wkc, 6);
        seen = answer.data;
    }
    // The outputs of an IO module are wired to its inputs.
    assert_eq!((seen[0], seen[len / 2]), (0x21, 0x43));
    assert_eq!(rig.logical(Command::Lrd, 0, &vec![0; len]).wkc, 2);
    assert_eq!(rig.logical(Command::Lwr, 0, &vec![0; len]).wkc, 2);
    assert_eq!(rig.chain.slave(1).state(), AlState::Op);
}

/// The bits that an FMMU maps, one by one, for reading.
fn read_by_bits(fmmu: &Fmmu, ram: &[u8], address: u32, data: &mut [u8]) {
    for bit in 0..u64::from(fmmu.bits()) {
        let logical = u64::from(fmmu.logical) * 8 + u64::from(fmmu.first_bit) + bit;
        let physical = u64::from(fmmu.physical) * 8 + u64::from(fmmu.physical_bit) + bit;
        let Some(at) = (logical / 8).checked_sub(u64::from(address)) else { continue };
        if let Some(byte) = data.get_mut(at as usize) {
            let value = ram[(physical / 8) as usize - 0x1000] >> (physical % 8) & 1;
            *byte = *byte & !(1 << (logical % 8)) | value << (logical % 8);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// ECAT-10.1, ECAT-10.2 Whatever an FMMU maps, a datagram over any part of it gets those bits, and a write changes no others.
    #[test]
    fn any_fmmu_maps_its_bits(
        logical in 0u32..40, len in 1u16..8, bits in [0u8..8, 0..8, 0..8], address in 0u32..50, data_len in 1usize..30,
    ) {
        let mut rig = Rig::drives(1);
        let ram: Vec<u8> = (0..64).map(|n: u8| n.wrapping_mul(37) ^ 0x5A).collect();
        rig.write(FIRST, 0x1000, &ram);
        let [first_bit, last_bit, physical_bit] = bits;
        let fmmu = Fmmu {
            logical, len, first_bit, last_bit, physical: 0x1010, physical_bit,
            directions: FmmuDirections::READ | FmmuDirections::WRITE, enabled: true,
        };
        rig.set_fmmu(FIRST, 5, fmmu);
        let sent: Vec<u8> = (0..data_len as u8).map(|n| n.wrapping_mul(91)).collect();
        let mut expected = sent.clone();
        read_by_bits(&fmmu, &ram, address, &mut expected);
        prop_assert_eq!(rig.logical(Command::Lrd, address, &sent).data, expected);

        // Written bits are read back, and their neighbours stay.
        rig.logical(Command::Lwr, address, &sent);
        let after = rig.read(FIRST, 0x1000, 64);
        let mut back = vec![0; data_len];
        read_by_bits(&fmmu, &after, address, &mut back);
        let mut mapped = vec![0; data_len];
        read_by_bits(&fmmu, &[0xFF; 64], address, &mut mapped);
        prop_assert!(back.iter().zip(&sent).zip(&mapped).all(|((back, sent), mapped)| *back == sent & mapped));
        let first = 16 * 8 + usize::from(physical_bit);
        for bit in (0..first).chain(first + fmmu.bits() as usize..64 * 8) {
            prop_assert_eq!(after[bit / 8] >> (bit % 8) & 1, ram[bit / 8] >> (bit % 8) & 1);
        }
    }
}

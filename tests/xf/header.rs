//! The place of every field in the two headers, and the meaning of its bits.

use ecmsk::xf::header::swap_gpio_12_and_13;
use ecmsk::xf::{
    AnswerHeader, CommandCode, CommandHeader, Control, Errors, EtherCatState, HEADER_LEN, Interrupts, NetworkState,
    Reserve, Status,
};
use proptest::prelude::*;

/// A header whose byte k is k.
const COUNTED: [u8; HEADER_LEN] = {
    let (mut bytes, mut i) = ([0; HEADER_LEN], 0);
    while i < HEADER_LEN {
        bytes[i] = i as u8;
        i += 1;
    }
    bytes
};

/// XF-1.7 Every field of a command's header stands where the manual's table 1 has it.
#[test]
fn fields_of_a_command() {
    let (start, header) = CommandHeader::decode(&COUNTED);
    let wanted = CommandHeader {
        info: [4, 5, 6, 7],
        reserve: Reserve(0x0908),
        control: Control(0x0A),
        index: 0x0B,
        code: CommandCode::FifoEnable,
        parameter: 0x0D,
        len: 0x0F0E,
        interrupt_clear: Interrupts(0x1312_1110),
        gpio_interrupt_clear: 0x1514,
        gpio_outputs: 0x1716,
    };
    // Code 12 is ECAT_STATE_SET.
    let wanted = CommandHeader { code: CommandCode::StateSet, ..wanted };
    assert_eq!((start, header), (0x0302_0100, wanted));
    assert_eq!(header.encode()[4..], COUNTED[4..]);
    assert_eq!(header.encode()[..4], [0xA4, 0xA3, 0xA2, 0xA1]);
}

/// XF-1.8 Every field of an answer's header stands where the manual's table 2 has it.
#[test]
fn fields_of_an_answer() {
    let (start, header) = AnswerHeader::decode(&COUNTED);
    let wanted = AnswerHeader {
        crc_errors: 4,
        wkc_errors: 5,
        tx_fifo: 6,
        rx_fifo: 7,
        state: NetworkState(8),
        errors: Errors(9),
        status: Status(0x0A),
        index: 0x0B,
        code: CommandCode::StateSet,
        ret: 0x0D,
        len: 0x0F0E,
        interrupts: Interrupts(0x1312_1110),
        gpio_interrupts: 0x1514,
        gpio_inputs: 0x1716,
    };
    assert_eq!((start, header), (0x0302_0100, wanted));
    assert_eq!(header.encode()[4..], COUNTED[4..]);
    assert_eq!(header.encode()[..4], [0xA4, 0xA3, 0xA2, 0xA1]);
}

/// XF-1.9 The bits of the header as the manuals number them.
#[test]
fn bits_have_their_places() {
    let reserve = [Reserve::GPIO_OUTPUTS_VALID, Reserve::MASTER_SHIFT, Reserve::LRW];
    assert_eq!(reserve.map(|bit| bit.0), [1 << 15, 1 << 12, 1 << 11]);
    let control = [
        Control::BIT_0,
        Control::UPDATE_STATE,
        Control::CLEAR_NON_IMMEDIATE,
        Control::CLEAR_SPI,
        Control::CLEAR_FIFO,
        Control::CLEAR_CRC,
        Control::CLEAR_COMMAND,
    ];
    assert_eq!(control.map(|bit| bit.0), [0, 1, 3, 4, 5, 6, 7].map(|n| 1 << n));
    assert_eq!(Control::CLEAR_ALL.0, 0xF8);
    let errors = [
        Errors::LINK_PIN,
        Errors::PHY_LINK,
        Errors::STATE,
        Errors::NON_IMMEDIATE,
        Errors::SPI,
        Errors::FIFO,
        Errors::CRC,
        Errors::COMMAND,
    ];
    assert_eq!(errors.map(|bit| bit.0), [0, 1, 2, 3, 4, 5, 6, 7].map(|n| 1 << n));
    let status =
        [Status::DC_STABLE, Status::PORT_READY, Status::PDO_CONFIGURED, Status::NOP, Status::FIFO_ON, Status::BUSY];
    assert_eq!(status.map(|bit| bit.0), [2, 3, 4, 5, 6, 7].map(|n| 1 << n));
    let interrupts = [
        Interrupts::ETHERCAT,
        Interrupts::ENCODER,
        Interrupts::RX_FIFO_LOW,
        Interrupts::TX_FIFO_HIGH,
        Interrupts::CRC,
        Interrupts::WORKING_COUNTER,
    ];
    assert_eq!(interrupts.map(|bit| bit.0), [31, 29, 25, 24, 23, 22].map(|n| 1 << n));
    // Clearing an error has the bit of the error.
    assert_eq!(Control::CLEAR_ALL.0, Errors::ALL.0);
    assert_eq!((Errors::FIFO | Errors::CRC).without(Errors::CRC), Errors::FIFO);
    assert!(!Errors::FIFO.contains(Errors::FIFO | Errors::CRC));
}

/// XF-1.11 Errors are cleared by their own bits, levels by none; XF-1.12 bits 12 and 13 of the header's outputs stand
/// for GPIO 13 and 12.
#[test]
fn errors_are_cleared_and_outputs_swapped() {
    let errors = Errors::SPI | Errors::CRC | Errors::LINK_PIN | Errors::STATE;
    assert_eq!(Control::clearing(errors), Control::CLEAR_SPI | Control::CLEAR_CRC);
    assert_eq!(Control::clearing(Errors(0xFF)), Control::CLEAR_ALL);
    for bit in 0..16 {
        let gpio = match bit {
            12 => 13,
            13 => 12,
            same => same,
        };
        assert_eq!(swap_gpio_12_and_13(1 << bit), 1 << gpio);
    }
    assert_eq!(swap_gpio_12_and_13(0xFFFF), 0xFFFF);
}

/// XF-1.10 The state with and without the error bit, and invalid states.
#[test]
fn states_may_have_an_error_beside_them() {
    use EtherCatState::{Boot, Init, Op, PreOp, SafeOp};
    for (code, state) in [(1, Init), (2, PreOp), (3, Boot), (4, SafeOp), (8, Op)] {
        assert_eq!(NetworkState(code).state(), Some(state));
        assert_eq!(NetworkState::from(state), NetworkState(code));
        let failed = NetworkState(code | 0x10);
        assert_eq!((failed.state(), failed.has_error()), (Some(state), true));
    }
    for code in [0, 5, 6, 7, 9, 15] {
        assert_eq!(NetworkState(code).state(), None);
    }
    assert_eq!((NetworkState::NONE.state(), NetworkState::NONE.has_error()), (None, false));
    assert!(NetworkState(0x10).has_error());
}

proptest! {
    /// XF-1.9 Every header survives decoding and encoding byte by byte: no bit is lost, with a meaning or without.
    #[test]
    fn headers_keep_every_bit(bytes: [u8; HEADER_LEN]) {
        let mut wanted = bytes;
        wanted[..4].copy_from_slice(&[0xA4, 0xA3, 0xA2, 0xA1]);
        prop_assert_eq!(CommandHeader::decode(&bytes).1.encode(), wanted);
        prop_assert_eq!(AnswerHeader::decode(&bytes).1.encode(), wanted);
    }
}

//! Requests for the interrupt lines. INT0 shows whether the chip is ready for a packet; the enabled interrupts raise
//! INT1.

use crate::ethercat::bits;
use crate::xf::Interrupts;
use crate::xf::fields::FieldKind;
use crate::xf::layout::{field_values, layout};

layout! {
    /// ECAT_INT_GET_ENABLE, command code 59: reads the settings of [`InterruptSetEnable`] (XF EN 1327).
    pub struct InterruptGetEnable;
}

bits! {
    /// The active level of the lines INT0 and INT1.
    Polarity(u8) {
        /// Bit 0: INT1 is active high. Clear at power-on: INT1 is active low.
        INT1_HIGH = 1 << 0;
        /// Bit 1: INT0 is active high; INT0 is active while the chip is ready for a packet. Set at power-on.
        INT0_HIGH = 1 << 1;
    }

    /// Bits that enable the interrupts of GPIO 8 to 11 and of the encoder.
    PeripheralInterrupts(u8) {
        /// Bit 0: the interrupt of GPIO 8.
        GPIO_8 = 1 << 0;
        /// Bit 1: the interrupt of GPIO 9.
        GPIO_9 = 1 << 1;
        /// Bit 2: the interrupt of GPIO 10.
        GPIO_10 = 1 << 2;
        /// Bit 3: the interrupt of GPIO 11.
        GPIO_11 = 1 << 3;
        /// Bit 4: the encoder's index pulse.
        ENCODER_INDEX = 1 << 4;
        /// Bit 5: the encoder's count has reached the comparison value.
        ENCODER_COMPARE = 1 << 5;
        /// Bit 6: the encoder's counter overflowed or underflowed.
        ENCODER_OVERFLOW = 1 << 6;
    }
}

layout! {
    /// The interrupts that raise INT1, and the polarity of both lines.
    pub struct InterruptEnable {
        /// The polarity: the parameter of the command, the return byte of the answer.
        pub polarity: Polarity = par(),
        /// Bytes 0..3 of the data: the enabled interrupts.
        pub sources: Interrupts = at(0),
        /// Byte 4 of the data: the enabled interrupts of GPIO 0 to 7; bit k is GPIO k.
        pub gpio: u8 = at(4).hex().or(0),
        /// Byte 5 of the data: the enabled interrupts of GPIO 8 to 11 and of the encoder.
        pub peripherals: PeripheralInterrupts = at(5).or(0),
    }

    /// ECAT_INT_SET_ENABLE, command code 58: sets which interrupts raise INT1, and the polarity of both lines
    /// (XF EN 1310). Parameter byte: polarity. Data, 6 bytes (@offset): @0 u32 interrupts, @4 GPIO 0 to 7, @5 GPIO 8 to
    /// 11 and the encoder.
    pub struct InterruptSetEnable {
        /// The new settings of interrupts and polarity.
        pub enable: InterruptEnable,
    }
}

field_values! {
    Polarity, 1, FieldKind::Bits(Polarity::NAMES), |bits| bits.0.into(), |bits| Ok(Polarity(bits as u8));
    Interrupts, 4, FieldKind::Bits(Interrupts::NAMES), |bits| bits.0, |bits| Ok(Interrupts(bits));
    PeripheralInterrupts, 1, FieldKind::Bits(PeripheralInterrupts::NAMES), |bits| bits.0.into(),
        |bits| Ok(PeripheralInterrupts(bits as u8));
}

//! The interrupt lines: INT0 says whether the chip is ready for a packet, INT1 is raised by what is enabled.

use bytemuck::{Pod, Zeroable};

use super::{Arguments, Call, plain};
use crate::ethercat::U32Le;
use crate::ethercat::bits;
use crate::xf::{CommandCode, Interrupts, Malformed, segment};

plain! {
    /// ECAT_INT_GET_ENABLE, code 59: what [`InterruptSetEnable`] has set (XF EN 1327).
    InterruptGetEnable, InterruptGetEnable -> InterruptEnable;
}

bits! {
    /// Which level of a line is its active one.
    Polarity(u8) {
        /// Bit 0: INT1 is active when high; at first when low.
        INT1_HIGH = 1 << 0;
        /// Bit 1: INT0 is active, which is ready for a packet, when high; so at first.
        INT0_HIGH = 1 << 1;
    }

    /// Interrupts of GPIO 8 to 11 and of the encoder.
    PeripheralInterrupts(u8) {
        /// Bit 0: GPIO 8.
        GPIO_8 = 1 << 0;
        /// Bit 1: GPIO 9.
        GPIO_9 = 1 << 1;
        /// Bit 2: GPIO 10.
        GPIO_10 = 1 << 2;
        /// Bit 3: GPIO 11.
        GPIO_11 = 1 << 3;
        /// Bit 4: the encoder's index.
        ENCODER_INDEX = 1 << 4;
        /// Bit 5: the encoder's comparison.
        ENCODER_COMPARE = 1 << 5;
        /// Bit 6: the encoder's counter overflowed or underflowed.
        ENCODER_OVERFLOW = 1 << 6;
    }
}

/// What raises INT1, and the polarity of both lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct InterruptEnable {
    /// `par` of the command, `ret` of the answer.
    pub polarity: Polarity,
    /// @0 u32.
    pub sources: Interrupts,
    /// @4: bit k is GPIO k, 0 to 7.
    pub gpio: u8,
    /// @5.
    pub peripherals: PeripheralInterrupts,
}

/// The data segment of [`InterruptEnable`].
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct InterruptLayout {
    /// @0.
    sources: U32Le,
    /// @4.
    gpio: u8,
    /// @5.
    peripherals: u8,
}

const _: () = assert!(size_of::<InterruptLayout>() == 6 && align_of::<InterruptLayout>() == 1);

impl InterruptEnable {
    pub(in crate::xf) fn write(&self, data: &mut [u8]) -> Result<u16, Malformed> {
        let layout =
            InterruptLayout { sources: self.sources.0.into(), gpio: self.gpio, peripherals: self.peripherals.0 };
        segment::put(data, &layout)
    }

    pub(in crate::xf) fn read(polarity: u8, data: &[u8]) -> Result<Self, Malformed> {
        let layout: InterruptLayout = segment::get(data)?;
        Ok(Self {
            polarity: Polarity(polarity),
            sources: Interrupts(layout.sources.get()),
            gpio: layout.gpio,
            peripherals: PeripheralInterrupts(layout.peripherals),
        })
    }
}

/// ECAT_INT_SET_ENABLE, code 58: what raises INT1, and the polarity of both lines (XF EN 1310). `par` polarity; 6
/// bytes: @0 u32 sources, @4 GPIO 0 to 7, @5 GPIO 8 to 11 and the encoder.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct InterruptSetEnable {
    /// What is set.
    pub enable: InterruptEnable,
}

impl Call<'_> for InterruptSetEnable {
    const CODE: CommandCode = CommandCode::InterruptSetEnable;
    type Answer<'a> = ();

    fn encode(&self, data: &mut [u8]) -> Result<Arguments, Malformed> {
        Ok(Arguments::NONE.parameter(self.enable.polarity.0).len(self.enable.write(data)?))
    }

    fn decode(arguments: &Arguments, data: &[u8]) -> Result<Self, Malformed> {
        Ok(Self { enable: InterruptEnable::read(arguments.parameter, data)? })
    }
}

//! Interrupt flags, the flags that raise INT1, and the polarity of the interrupt lines.

use crate::xf::Interrupts;
use crate::xf::request::{InterruptEnable, PeripheralInterrupts, Polarity};

/// The interrupt flags (word 0x10 of an answer's header) except those of the encoder, and the settings that enable
/// interrupts.
pub(super) struct InterruptUnit {
    flags: Interrupts,
    pub enable: InterruptEnable,
}

impl InterruptUnit {
    pub const fn new() -> Self {
        let enable = InterruptEnable {
            polarity: Polarity::INT0_HIGH,
            sources: Interrupts::NONE,
            gpio: 0,
            peripherals: PeripheralInterrupts::NONE,
        };
        Self { flags: Interrupts::NONE, enable }
    }

    /// Sets flags, whether they are enabled or not.
    pub const fn raise(&mut self, flags: Interrupts) {
        self.flags = self.flags.with(flags);
    }

    /// Clears flags. The manuals name only bits 31 and 29 as flags that a header clears; `[OURS]` bits 22 to 25 are cleared in
    /// the same way.
    pub const fn clear(&mut self, flags: Interrupts) {
        self.flags = self.flags.without(flags);
    }

    /// The interrupt flags, word 0x10 of an answer's header. Bit 29 is set if at least one interrupt flag of the encoder
    /// is set. `[OURS]`
    pub fn word(&self, encoder: PeripheralInterrupts) -> Interrupts {
        if encoder == PeripheralInterrupts::NONE { self.flags } else { self.flags | Interrupts::ENCODER }
    }

    /// Whether INT1 is active: at least one enabled interrupt flag of the chip, a GPIO or the encoder is set (XF EN,
    /// figure 8).
    pub const fn is_active(&self, gpio: u32, encoder: PeripheralInterrupts) -> bool {
        let pins_8_to_11 = (gpio >> 8) as u8 & 0x0F;
        let peripherals = (encoder.0 | pins_8_to_11) & self.enable.peripherals.0;
        self.flags.0 & self.enable.sources.0 != 0 || gpio as u8 & self.enable.gpio != 0 || peripherals != 0
    }
}

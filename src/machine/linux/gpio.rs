//! GPIO chips, for the BUSY and the reset line of a board on SPI.

use super::{Access, Machine};

/// The folder of all GPIO chips.
const CHIPS: &str = "/sys/bus/gpio/devices";
/// Names in a device tree that mean "no name", as an empty one does.
const NO_NAME: [&str; 2] = ["NC", "-"];

/// A GPIO chip of the machine, whose lines the links `spi:` and `xf-spi:` can use.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GpioChip {
    /// The name that a link uses, such as `gpiochip0`.
    pub name: String,
    /// Whether this user may use the lines of the chip.
    pub access: Access,
    /// The offsets and names of the lines that have a name in the device tree.
    pub named_lines: Vec<(usize, String)>,
}

impl Machine {
    /// All GPIO chips.
    pub fn gpio_chips(&self) -> Vec<GpioChip> {
        let is_chip = |name: &String| {
            let number = name.strip_prefix("gpiochip");
            number.is_some_and(|number| !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit()))
        };
        let names = self.names(CHIPS).into_iter().filter(is_chip);
        let chip = |name: String| GpioChip {
            access: self.access(&format!("/dev/{name}")),
            named_lines: self.named_lines(&name),
            name,
        };
        names.map(chip).collect()
    }

    /// The named lines of a chip. In the device tree their names are a list of zero-terminated texts.
    fn named_lines(&self, chip: &str) -> Vec<(usize, String)> {
        let text = self.text(&format!("{CHIPS}/{chip}/of_node/gpio-line-names")).unwrap_or_default();
        let lines = text.split_terminator('\0').map(super::printable).enumerate();
        lines.filter(|(_, name)| !name.is_empty() && !NO_NAME.contains(&name.as_str())).collect()
    }
}

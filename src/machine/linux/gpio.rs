//! GPIO chips, for the lines BUSY and RESET of a board on SPI.

use super::{Access, Machine};

/// The chips.
const CHIPS: &str = "/sys/bus/gpio/devices";
/// What a line without a name is called in a device tree; and an empty text, too.
const NO_NAME: [&str; 2] = ["NC", "-"];

/// A GPIO chip.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GpioChip {
    /// `gpiochip0`, as a link names it.
    pub name: String,
    /// Whether this user may use its lines.
    pub access: Access,
    /// Lines that have a name (of the device tree): number and name.
    pub named_lines: Vec<(usize, String)>,
}

impl Machine {
    /// All chips. Names of lines are known where a device tree gives them.
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

    /// A list of texts, each with a zero behind it.
    fn named_lines(&self, chip: &str) -> Vec<(usize, String)> {
        let text = self.text(&format!("{CHIPS}/{chip}/of_node/gpio-line-names")).unwrap_or_default();
        let lines = text.split_terminator('\0').map(super::printable).enumerate();
        lines.filter(|(_, name)| !name.is_empty() && !NO_NAME.contains(&name.as_str())).collect()
    }
}

//! The rule that lets users open a board: ours, and whether there is one.

use super::Machine;

/// The rule, as it is shipped: `share/udev/60-ecmsk.rules`.
pub const RULE: &str = include_str!("../../../share/udev/60-ecmsk.rules");
/// Where it goes. Before 73-seat-late.rules, which acts on the tag uaccess.
pub const PLACE: &str = "/etc/udev/rules.d/60-ecmsk.rules";
/// What makes udev use it, for devices that are there already, too.
pub const RELOAD: [&str; 2] = [
    "udevadm control --reload",
    "udevadm trigger --subsystem-match=usb --subsystem-match=hidraw --subsystem-match=spidev --subsystem-match=gpio",
];

/// Where udev looks for rules (udev(7)).
const FOLDERS: [&str; 5] = [
    "/etc/udev/rules.d",
    "/run/udev/rules.d",
    "/usr/local/lib/udev/rules.d",
    "/usr/lib/udev/rules.d",
    "/lib/udev/rules.d",
];

/// A rule for the board's ids.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Rule {
    /// There is none.
    None,
    /// Ours, as this version ships it.
    Ours(String),
    /// That of another version, or one that was changed.
    OtherVersion(String),
    /// Somebody's own.
    Other(String),
}

impl Machine {
    /// The rule that there is for the board's ids, with its file.
    pub fn udev_rule(&self) -> Rule {
        let mut other = None;
        for folder in FOLDERS {
            for name in self.names(folder).into_iter().filter(|name| name.ends_with(".rules")) {
                let file = format!("{folder}/{name}");
                let Some(text) = self.text(&file).filter(|text| is_for_the_board(text)) else { continue };
                match text == RULE {
                    true => return Rule::Ours(file),
                    false if PLACE.ends_with(&format!("/{name}")) => return Rule::OtherVersion(file),
                    false => other = other.or(Some(file)),
                }
            }
        }
        other.map_or(Rule::None, Rule::Other)
    }
}

/// Whether a line that is no comment has both ids.
fn is_for_the_board(text: &str) -> bool {
    let rules = text.lines().map(str::trim_start).filter(|line| !line.starts_with('#'));
    rules.map(str::to_ascii_lowercase).any(|line| line.contains("16c0") && line.contains("05df"))
}

/// What a user types who may not write the rule: it is written, and used at once.
pub fn by_hand() -> String {
    let reload: Vec<String> = RELOAD.iter().map(|line| format!("sudo {line}\n")).collect();
    format!("sudo tee {PLACE} >/dev/null <<'END'\n{RULE}END\n{}", reload.concat())
}

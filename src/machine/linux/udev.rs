//! The udev rule that lets users open a board: the one that this project ships, and whether one is installed.

use super::Machine;

/// The rule that this project ships, `share/udev/60-ecmsk.rules`.
pub const RULE: &str = include_str!("../../../share/udev/60-ecmsk.rules");
/// Where the rule is installed. Its number has to be below 73, so that it sets the tag uaccess before
/// 73-seat-late.rules acts on that tag.
pub const PLACE: &str = "/etc/udev/rules.d/60-ecmsk.rules";
/// The commands that make udev apply new rules, also to devices that are connected already.
pub const RELOAD: [&str; 2] = [
    "udevadm control --reload",
    "udevadm trigger --subsystem-match=usb --subsystem-match=hidraw --subsystem-match=spidev --subsystem-match=gpio",
];

/// The folders that udev reads rules from (udev(7)).
const FOLDERS: [&str; 5] = [
    "/etc/udev/rules.d",
    "/run/udev/rules.d",
    "/usr/local/lib/udev/rules.d",
    "/usr/lib/udev/rules.d",
    "/lib/udev/rules.d",
];

/// A udev rule for the board's ids, with the file where it was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Rule {
    /// No rule is installed.
    None,
    /// The rule that this version ships.
    Ours(String),
    /// The rule of another version of this project, or a changed one.
    OtherVersion(String),
    /// A rule that somebody else wrote.
    Other(String),
}

impl Machine {
    /// Searches the installed rules for those with the board's ids. If there are several, the first rule of this
    /// project takes precedence over rules that somebody else wrote.
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

/// Whether a line of the file other than a comment contains the board's vendor id and product id.
fn is_for_the_board(text: &str) -> bool {
    let rules = text.lines().map(str::trim_start).filter(|line| !line.starts_with('#'));
    rules.map(str::to_ascii_lowercase).any(|line| line.contains("16c0") && line.contains("05df"))
}

/// The shell commands that install and apply the rule, for a user who is not root.
pub fn by_hand() -> String {
    let reload: Vec<String> = RELOAD.iter().map(|line| format!("sudo {line}\n")).collect();
    format!("sudo tee {PLACE} >/dev/null <<'END'\n{RULE}END\n{}", reload.concat())
}

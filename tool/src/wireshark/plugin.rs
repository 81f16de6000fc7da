//! The text of the Wireshark plugin, which is a single file.

use super::{board, chip, table};

/// The beginning of the plugin, which comes before the tables: a comment and the first Lua code.
const HEAD: &str = include_str!("lua/head.lua");

/// The other parts of the plugin's code, in the order in which Lua reads them.
const PARTS: &[&str] = &[
    include_str!("lua/places.lua"),
    include_str!("lua/fields.lua"),
    include_str!("lua/commands.lua"),
    include_str!("lua/responses.lua"),
    include_str!("lua/size.lua"),
    include_str!("lua/frame.lua"),
    include_str!("lua/chip_fields.lua"),
    include_str!("lua/packet.lua"),
    include_str!("lua/tail.lua"),
];

/// The whole text of the plugin, which the release contains as `share/wireshark/ecmsk.lua`.
pub fn text() -> String {
    let mut text = HEAD.to_owned();
    for (name, tables) in [("board", board::tables()), ("chip", chip::tables())] {
        let begin = format!("T.{name} = ");
        text.push_str(&format!("\n{begin}{}\n", table::expression(&tables, begin.len(), 0)));
    }
    for part in PARTS {
        text.push('\n');
        text.push_str(part);
    }
    text
}

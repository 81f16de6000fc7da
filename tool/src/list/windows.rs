//! Lists the USB boards that the HID driver of Windows has found.

use ecmsk::link::keys::Scheme;
use ecmsk::machine::{Board, Machine};
use serde_json::json;

use super::Row;

/// The beginning of the note that is printed if there is no board.
pub const NONE: &str = "no board on USB";

// No options on Windows. A doc comment would become the help of the verb.
#[derive(clap::Args)]
pub struct SystemArgs {}

/// Always `None`: slaves on a network card are not supported on Windows.
pub const fn scanned(_: &SystemArgs) -> Option<&str> {
    None
}

/// A row for each device with the vendor and product id of the board, or a single row with the error.
pub fn rows(_: &SystemArgs) -> Vec<Row> {
    match Machine::here().boards() {
        Ok(boards) => boards.iter().map(row).collect(),
        Err(why) => {
            let (found, next) = why.rsplit_once("; ").unwrap_or((why.as_str(), "start Windows anew"));
            vec![Row {
                scheme: Scheme::Usb,
                link: None,
                what: "USB".to_owned(),
                obstacle: Some(found.to_owned()),
                but: Vec::new(),
                next: vec![next.to_owned()],
                facts: json!({ "board": null }),
            }]
        }
    }
}

fn row(board: &Board) -> Row {
    let obstacle = board.obstacle();
    let facts = json!({
        "path": board.path, "name": board.name, "serial": board.serial, "board": board.why_no_board.is_none(),
    });
    let row = |link, what, why| Row {
        scheme: Scheme::Usb,
        link,
        what,
        obstacle: why,
        but: Vec::new(),
        next: Vec::new(),
        facts,
    };
    match board.why_no_board {
        Some(why) => row(None, format!("{} at {}", board.shown(), board.path), Some(why.to_string())),
        None => Row {
            next: obstacle.iter().filter_map(|finding| finding.next.clone()).collect(),
            ..row(Some(board.link()), board.shown(), obstacle.map(|finding| finding.found))
        },
    }
}

//! The table of all functions.

use super::FunctionFields;
use super::{chip, network, units};
use crate::xf::Request;

/// All functions, by ascending code and parameter.
pub static FUNCTIONS: [FunctionFields; Request::FUNCTIONS] = all();

const fn all() -> [FunctionFields; Request::FUNCTIONS] {
    let mut all = [network::ROWS[0]; Request::FUNCTIONS];
    let parts = [network::ROWS, chip::ROWS, units::ROWS];
    let (mut count, mut part) = (0, 0);
    while part < parts.len() {
        let mut row = 0;
        while row < parts[part].len() {
            // By insertion. With a row too many or too few the table does not compile.
            let mut at = count;
            while at > 0 && all[at - 1].order() > parts[part][row].order() {
                all[at] = all[at - 1];
                at -= 1;
            }
            all[at] = parts[part][row];
            (count, row) = (count + 1, row + 1);
        }
        part += 1;
    }
    assert!(count == Request::FUNCTIONS);
    all
}

impl FunctionFields {
    const fn order(&self) -> u16 {
        let parameter = match self.function {
            Some(parameter) => parameter,
            None => 0,
        };
        (self.code.code() as u16) << 8 | parameter as u16
    }
}

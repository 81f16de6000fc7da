//! Every request byte by byte, as the manuals print it, both ways.

mod bus;
mod chip;
mod io;
mod pdo;
mod transfers;

use std::collections::BTreeSet;

use crate::codes::functions;
use crate::{Printed, check};

/// A function: its code and, with codes 31 to 35, its parameter.
type Function = (u8, Option<u8>);

/// A request with what the manual prints for it: checks it and says which function it is.
fn case<'d>(request: impl Into<ecmsk::xf::Request<'d>>, printed: Printed) -> Function {
    check(request, &printed);
    (printed.code, (31..=35).contains(&printed.code).then_some(printed.par))
}

/// A command that has `par` and information bytes alone.
fn short(code: u8, par: u8, info: [u8; 4]) -> Printed {
    Printed { code, par, info, ..Printed::default() }
}

/// A command that has data alone, all of which the length counts.
fn long(code: u8, par: u8, data: Vec<u8>) -> Printed {
    Printed { code, par, len: data.len() as u16, data, ..Printed::default() }
}

/// XF-4.1 Every function of the manuals is among those whose bytes these tests know.
#[test]
fn every_function_is_checked_byte_by_byte() {
    let all = [bus::cases(), chip::cases(), io::cases(), pdo::cases(), transfers::cases()].concat();
    let checked: BTreeSet<Function> = all.into_iter().collect();
    assert_eq!(checked, functions().into_iter().collect());
}

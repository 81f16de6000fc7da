//! The help on links, made from the tables of schemes, keys, kinds of slaves and verbs of scripts.

use std::fmt::Write as _;

use crate::address::keys::{KEYS, Scheme};
use crate::address::{slaves, travel};

/// The text of `ecmsk link help`: the form of a link, every scheme, and every key with its default.
pub fn help() -> String {
    let mut text = String::from(
        "A link names a board, or a chip ECM-XF, and the way to it:\n\n    \
         scheme:path?key=value&key=value        for example  sim:?slaves=drive*3&clock=virtual\n\n\
         In a value, write % & ? # and blanks as %25 %26 %3F %23 %20.\n\nSchemes:\n",
    );
    for scheme in Scheme::ALL {
        let form = format!("{scheme}:{}", scheme.path().unwrap_or_default());
        let later = scheme.note();
        // Writing to a String cannot fail.
        let _ = writeln!(text, "  {form:<24} {}{later}", scheme.meaning());
    }
    text.push_str("\nKeys:\n");
    for key in KEYS {
        let form = format!("{}={}", key.name, key.syntax.placeholder());
        let whose = if key.schemes == Scheme::ALL {
            "any board".to_owned()
        } else {
            key.schemes.iter().map(|scheme| format!("{scheme}:")).collect::<Vec<_>>().join(" ")
        };
        let default = key.default.map(|value| format!("; default {value}")).unwrap_or_default();
        let _ = writeln!(text, "  {form}\n      {} [{whose}{default}]", key.meaning);
    }
    let _ = writeln!(text, "\nA list of slaves is {}.", slaves::form());
    let _ = write!(text, "\n{}", slaves::kinds_help());
    let _ = write!(text, "\n{}", travel::help());
    let _ = write!(text, "\n{}", slaves::manufacturer_objects_help());
    #[cfg(feature = "sim")]
    let _ = write!(text, "\n{}", crate::testbed::script::help());
    text
}

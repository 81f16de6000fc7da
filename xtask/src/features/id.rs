//! Rule ids: `SK-5.3` (prefix, section, number) for rules of the board, and `LIB-7` (prefix, number) for rules that have no
//! sections.

use std::fmt;
use std::iter;

/// The prefixes of rule ids, and whether a section comes before the number. Their subjects in this order: the board, the chip
/// ECM-XF, EtherCAT, the software master, a board on a network card, the bus tools, the drive DP3CL, the library for
/// applications, the native API, the tool, names of boards, a board served over the network, a board on its wires, .NET,
/// Windows, packages.
pub const PREFIXES: [(&str, bool); 15] = [
    ("SK-", true),
    ("XF-", true),
    ("ECAT-", true),
    ("MASTER-", true),
    ("NIC-", true),
    ("BUS-", true),
    ("DP3CL-", true),
    ("LIB-", false),
    ("API-", false),
    ("TOOL-", false),
    ("LINK-", false),
    ("TCP-", false),
    ("WIRE-", false),
    ("NET-", false),
    ("WIN-", false),
];

/// A well-formed rule id. A rule with this id need not exist.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct RuleId(String);

impl fmt::Display for RuleId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// All rule ids in `text`. Only complete ids count: `SK-5.25` does not contain SK-5.2, and `SK-5` is a section.
pub fn ids_in(text: &str) -> impl Iterator<Item = RuleId> + '_ {
    let mut rest = text;
    iter::from_fn(move || {
        loop {
            let start = PREFIXES.iter().filter_map(|(prefix, _)| rest.find(prefix)).min()?;
            let joined = rest[..start].ends_with(|c: char| c.is_alphanumeric() || c == '-' || c == '_');
            let len = id_len(&rest[start..]);
            let (word, after) = rest[start..].split_at(len.unwrap_or(3));
            rest = after;
            if len.is_some() && !joined {
                return Some(RuleId(word.to_owned()));
            }
        }
    })
}

/// The rule id, if the whole text is one.
pub fn id_of(text: &str) -> Option<RuleId> {
    (id_len(text) == Some(text.len())).then(|| RuleId(text.to_owned()))
}

/// The length in bytes of the rule id at the beginning of `text`; `None` if there is none.
fn id_len(text: &str) -> Option<usize> {
    let &(prefix, dotted) = PREFIXES.iter().find(|(prefix, _)| text.starts_with(prefix))?;
    let mut len = prefix.len() + number_len(text.strip_prefix(prefix)?)?;
    let mut dots = 0;
    while let Some(more) = text[len..].strip_prefix('.').and_then(number_len) {
        len += 1 + more;
        dots += 1;
    }
    let ends = !text[len..].starts_with(|c: char| c.is_alphanumeric() || c == '_');
    (ends && (dots > 0) == dotted).then_some(len)
}

/// The length in bytes of the decimal number at the beginning of `text`; `None` if there is none.
fn number_len(text: &str) -> Option<usize> {
    let len = text.bytes().take_while(u8::is_ascii_digit).count();
    (len > 0).then_some(len)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(text: &str) -> Vec<String> {
        ids_in(text).map(|id| id.to_string()).collect()
    }

    #[test]
    fn ids_are_found_whole() {
        assert_eq!(
            found("SK-5.3 A full FIFO takes no entry; see also LIB-12, SK-1.1."),
            ["SK-5.3", "LIB-12", "SK-1.1"]
        );
        assert_eq!(found("SK-5.25"), ["SK-5.25"]);
        assert_eq!(found("API-1, TOOL-22, TCP-3 and WIRE-4"), ["API-1", "TOOL-22", "TCP-3", "WIRE-4"]);
        assert_eq!(found("(SK-5.3)(LIB-7):SK-11.10"), ["SK-5.3", "LIB-7", "SK-11.10"]);
    }

    #[test]
    fn what_only_looks_like_an_id_is_none() {
        for text in ["SK-5 [OURS]", "ECM-SK-5.3", "TASK-5.3", "SK-5.3a", "SK-5.3_x", "SK-x.1", "LIB-", "LIB-3x", "SK-"]
        {
            assert_eq!(found(text), [""; 0], "{text}");
        }
    }

    #[test]
    fn an_id_with_a_part_too_many_is_kept_so_that_it_is_reported_as_unknown() {
        assert_eq!(found("SK-5.3.1"), ["SK-5.3.1"]);
        assert_eq!(id_of("SK-5.3").map(|id| id.to_string()).as_deref(), Some("SK-5.3"));
        assert_eq!(id_of("SK-5.3 "), None);
    }
}

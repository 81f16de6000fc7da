//! Replaces unused attributes by blanks, in XML elements with a very large number of attributes. The XML parser
//! compares each attribute of an element with all previous ones, so such a file would take it very long.

use std::collections::HashSet;

/// Elements with at most this many attributes are not changed. \[OURS] Elements of an ESI file have at most ten.
const ATTRIBUTES_MAX: usize = 64;

/// The error for an attribute that occurs twice in an element, which XML forbids.
#[derive(Debug, PartialEq, Eq)]
pub struct Twice {
    /// The name of the attribute.
    pub name: String,
    /// The line of its second occurrence, from 1.
    pub line: u32,
}

/// In elements with more than [`ATTRIBUTES_MAX`] attributes, replaces the attributes whose names are not in `read` by
/// blanks. Returns `None` if there is nothing to replace. Text that is not XML is not changed.
///
/// # Errors
/// [`Twice`]. It is checked only in these elements, because the parser checks all others.
pub fn without_unread(text: &str, read: &[&str]) -> Result<Option<String>, Twice> {
    let mut blanks: Vec<(usize, usize)> = Vec::new();
    let mut at = 0;
    while let Some(begin) = find(text, at, "<") {
        let rest = &text[begin..];
        let skipped = [("<!--", "-->"), ("<![CDATA[", "]]>"), ("<?", "?>"), ("<!", ">")];
        at = match skipped.iter().find(|(head, _)| rest.starts_with(head)) {
            Some((head, end)) => find(text, begin + head.len(), end).map_or(text.len(), |at| at + end.len()),
            None => {
                let (attributes, end) = attributes(text, begin + 1);
                if attributes.len() > ATTRIBUTES_MAX {
                    let mut names = HashSet::new();
                    for (name, span) in attributes {
                        if !names.insert(name) {
                            let line = text[..span.0].matches('\n').count() as u32 + 1;
                            return Err(Twice { name: name.to_owned(), line });
                        }
                        if !read.contains(&name) {
                            blanks.push(span);
                        }
                    }
                }
                end
            }
        };
    }
    if blanks.is_empty() {
        return Ok(None);
    }
    let mut left = String::with_capacity(text.len());
    let mut from = 0;
    for (begin, end) in blanks {
        left.push_str(&text[from..begin]);
        left.extend(text[begin..end].bytes().map(|byte| if byte == b'\n' { '\n' } else { ' ' }));
        from = end;
    }
    left.push_str(&text[from..]);
    Ok(Some(left))
}

fn find(text: &str, from: usize, what: &str) -> Option<usize> {
    text.get(from..)?.find(what).map(|at| from + at)
}

/// An attribute: its name, and the byte range from the name to the byte after the value.
type Attribute<'a> = (&'a str, (usize, usize));

/// The attributes of a start tag, and the position after them. `at` is the position of the tag's name.
fn attributes(text: &str, at: usize) -> (Vec<Attribute<'_>>, usize) {
    let bytes = text.as_bytes();
    let skip = |mut at: usize, goes_on: fn(u8) -> bool| {
        while bytes.get(at).is_some_and(|byte| goes_on(*byte)) {
            at += 1;
        }
        at
    };
    let is_space = |byte: u8| byte.is_ascii_whitespace();
    let is_name = |byte: u8| !byte.is_ascii_whitespace() && !matches!(byte, b'=' | b'>' | b'/' | b'<' | b'"' | b'\'');
    let mut found = Vec::new();
    let mut at = skip(at, is_name);
    loop {
        let begin = skip(at, is_space);
        let end = skip(begin, is_name);
        let equals = skip(end, is_space);
        let value = skip(equals + 1, is_space);
        let (Some(b'='), Some(quote @ (b'"' | b'\''))) = (bytes.get(equals), bytes.get(value)) else {
            return (found, begin);
        };
        let Some(close) = bytes[value + 1..].iter().position(|byte| byte == quote) else { return (found, text.len()) };
        at = value + 1 + close + 1;
        found.push((&text[begin..end], (begin, at)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// In an element with very many attributes, the used attributes stay on their lines and all others are replaced by
    /// blanks. Other elements, comments and texts are not changed.
    #[test]
    fn attributes_that_nobody_reads_are_taken_out() {
        let many: String = (0..100).map(|n| format!(" a{n}='>'\n")).collect();
        let text =
            format!("<?xml x?><!-- <b{many}> --><a{many} Code = \"1\"/><b c='1'>{many}<![CDATA[<a{many}>]]></b>");
        let left = without_unread(&text, &["Code"]).expect("no name twice").expect("there are many");
        assert_eq!((left.len(), left.matches('\n').count()), (text.len(), text.matches('\n').count()));
        let element = &left[left.find("<a").unwrap()..left.find("/><b").unwrap()];
        assert_eq!(element.split_whitespace().collect::<Vec<_>>(), ["<a", "Code", "=", "\"1\""]);
        assert_eq!(left[left.find("<b c").unwrap()..], text[text.find("<b c").unwrap()..]);
        assert_eq!(without_unread("<a b='1' c='2'><d/></a", &[]), Ok(None));
        let twice = format!("<a>\n<b{many} a7='1'/></a>");
        assert_eq!(without_unread(&twice, &[]), Err(Twice { name: "a7".into(), line: 102 }));
        for broken in ["<", "<a", "<a b", "<a b=", "<a b='", "<!--", "<a b='1' =", "<?", "<é ü='1'"] {
            assert_eq!(without_unread(broken, &[]), Ok(None), "{broken}");
        }
    }
}

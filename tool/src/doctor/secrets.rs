//! Removes secrets from data that are packed for other people.

use ecmsk::link::tcp::SECRET;
use ecmsk::link::uri::LinkUri;

/// The text that replaces a secret.
const REMOVED: &str = "[removed]";
/// The largest size of a file that is read as a secret, in bytes; no secret is longer.
const FILE_BYTES_MAX: u64 = 4096;
/// Secrets shorter than this are not searched for, because such short texts would be found everywhere. The secret of a
/// server has at least 32 bytes. \[OURS]
const LEN_MIN: usize = 6;
/// A text that follows one of these words and `=` or `:` counts as a secret. \[OURS]
const WORDS: [&str; 5] = ["secret", "password", "passwd", "passphrase", "token"];

/// The known secrets, the longest first.
pub struct Secrets(Vec<Vec<u8>>);

impl Secrets {
    /// Collects the secrets in environment variables, and in the file that the link names.
    pub fn find(link: Option<&LinkUri>) -> Self {
        let of_variable = std::env::vars_os().filter(|(name, _)| {
            let name = name.to_string_lossy().to_lowercase();
            name == SECRET.to_lowercase() || WORDS.iter().any(|word| name.contains(word))
        });
        let mut secrets: Vec<Vec<u8>> = of_variable.map(|(_, value)| value.into_encoded_bytes()).collect();
        let file = link.and_then(|link| link.value("secret_file"));
        let is_small = |file: &&str| std::fs::metadata(file).is_ok_and(|there| there.len() <= FILE_BYTES_MAX);
        secrets.extend(file.filter(is_small).and_then(|file| std::fs::read(file).ok()));
        Self::of(secrets)
    }

    fn of(secrets: Vec<Vec<u8>>) -> Self {
        let mut secrets: Vec<Vec<u8>> = secrets.into_iter().map(|secret| secret.trim_ascii().to_vec()).collect();
        secrets.retain(|secret| secret.len() >= LEN_MIN);
        // The longest secrets are removed first: if a shorter one is a part of a longer one, the rest of the longer one
        // would stay.
        secrets.sort_by_key(|secret| std::cmp::Reverse(secret.len()));
        Self(secrets)
    }

    /// Removes secrets from a text: the known ones, and values that follow a word such as `password=`.
    pub fn without(&self, text: &str) -> String {
        let text = self.0.iter().fold(text.to_owned(), |text, secret| match std::str::from_utf8(secret) {
            Ok(secret) => text.replace(secret, REMOVED),
            Err(_) => text,
        });
        without_named(&without_passwords(&text))
    }

    /// Whether the bytes contain one of the known secrets.
    pub fn are_in(&self, bytes: &[u8]) -> bool {
        self.0.iter().any(|secret| bytes.windows(secret.len()).any(|part| part == secret))
    }
}

/// Removes the values after `secret=`, `password: ` and the like from a text. The value of `secret_file=` stays,
/// because it is the name of a file.
fn without_named(text: &str) -> String {
    let lower = text.to_ascii_lowercase();
    let (mut clean, mut from) = (String::new(), 0);
    while let Some(at) = WORDS.iter().filter_map(|word| Some(from + lower[from..].find(word)? + word.len())).min() {
        clean.push_str(&text[from..at]);
        from = at;
        let is_between = |c: char| matches!(c, ' ' | '"' | '\'' | '\t');
        let behind = text[at..].trim_start_matches(is_between);
        let Some(value) = behind.strip_prefix(['=', ':']).map(|rest| rest.trim_start_matches(is_between)) else {
            continue;
        };
        let begin = text.len() - value.len();
        let end = match quote_before(&text[at..begin]) {
            Some(quote) => end_of_quoted(value, quote),
            None => value.find(|c: char| matches!(c, '&' | '"' | '\'') || c.is_whitespace()).unwrap_or(value.len()),
        };
        if end > 0 {
            clean.push_str(&text[at..begin]);
            clean.push_str(REMOVED);
            from = begin + end;
        }
    }
    clean.push_str(&text[from..]);
    clean
}

/// The quote at the end of `text`, which is the text before a value. It is one character, or three for a value of
/// several lines.
fn quote_before(text: &str) -> Option<&str> {
    let of = |quote: &str| ["\"\"\"", "'''", "\"", "'"].into_iter().find(|known| *known == quote);
    let sign = text.find(['=', ':'])?;
    let tail = |length| text[sign + 1..].len().checked_sub(length).and_then(|from| text[sign + 1..].get(from..));
    tail(3).and_then(of).or_else(|| tail(1).and_then(of))
}

/// The position at which a quoted value ends: at its closing quote, or without one at the end of its line. In double
/// quotes, a quote after a backslash does not end the value.
fn end_of_quoted(value: &str, quote: &str) -> usize {
    let mut escaped = false;
    for (at, c) in value.char_indices() {
        if !escaped && value[at..].starts_with(quote) || c == '\n' && quote.len() == 1 {
            return at;
        }
        escaped = !escaped && c == '\\' && quote.starts_with('"');
    }
    value.len()
}

/// Removes the `NAME:PASSWORD` before the `@` of addresses from a text.
fn without_passwords(text: &str) -> String {
    let mut parts = text.split("://");
    let mut clean = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let end = part.find(|c: char| matches!(c, '/' | '?' | '"') || c.is_whitespace()).unwrap_or(part.len());
        let rest = match part[..end].rfind('@') {
            Some(at) => format!("{REMOVED}{}", &part[at..]),
            None => part.to_owned(),
        };
        clean.push_str("://");
        clean.push_str(&rest);
    }
    clean
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Known secrets, values after a word such as `password=`, and passwords in addresses are removed. The name of a
    /// secret's file stays.
    #[test]
    fn no_secret_is_left() {
        let secrets = Secrets::of(vec![b"0123456789abcdef\n".to_vec(), b"9abc".to_vec(), b"789abc".to_vec()]);
        assert_eq!(secrets.without("x 0123456789abcdef y 789abc"), "x [removed] y [removed]");
        assert!(secrets.are_in(b"\0\x010123456789abcdef") && !secrets.are_in(b"9abc"));
        let none = Secrets::of(Vec::new());
        for (text, clean) in [
            ("tcp://host?secret=hunter2&role=reader", "tcp://host?secret=[removed]&role=reader"),
            ("link = \"tcp://me:pass@host:1?x=1\"", "link = \"tcp://[removed]@host:1?x=1\""),
            ("Password: 'a b'", "Password: '[removed]'"),
            (r#"password = "correct horse battery" # x"#, r#"password = "[removed]" # x"#),
            (r#"{"password":"correct \"horse\" battery","x":1}"#, r#"{"password":"[removed]","x":1}"#),
            ("passphrase = 'a \" b\\'\nx", "passphrase = '[removed]'\nx"),
            ("token = \"\"\"\na \"b\"\n\"\"\"\nx", "token = \"\"\"[removed]\"\"\"\nx"),
            ("password = \"no end\nx = \"y\"", "password = \"[removed]\nx = \"y\""),
            ("password: one two", "password: [removed] two"),
            ("link = \"tcp://host?token=a\" 'b'", "link = \"tcp://host?token=[removed]\" 'b'"),
            ("tcp://host?secret_file=/etc/a", "tcp://host?secret_file=/etc/a"),
            ("token", "token"),
            ("a secret and a token=x", "a secret and a token=[removed]"),
            ("secret=", "secret="),
        ] {
            assert_eq!(none.without(text), clean);
        }
    }
}

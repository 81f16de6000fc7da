//! Keeps secrets out of what is packed for others.

use ecmsk::link::tcp::SECRET;
use ecmsk::link::uri::LinkUri;

/// What stands where a secret was.
const REMOVED: &str = "[removed]";
/// The longest file that is read for a secret, bytes: no secret is longer.
const FILE_BYTES_MAX: u64 = 4096;
/// Shorter texts are not looked for: they would be found everywhere. A secret of a server has 32 bytes at least. \[OURS]
const LEN_MIN: usize = 6;
/// A text that follows one of these words and `=` or `:` is a secret, whatever it is. \[OURS]
const WORDS: [&str; 5] = ["secret", "password", "passwd", "passphrase", "token"];

/// The secrets that are known here.
pub struct Secrets(Vec<Vec<u8>>);

impl Secrets {
    /// The secrets of the environment, and of the files that the link names.
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
        // A secret that is a part of another one must not leave the rest of that.
        secrets.sort_by_key(|secret| std::cmp::Reverse(secret.len()));
        Self(secrets)
    }

    /// A text without secrets: neither those that are known, nor what the text itself calls one.
    pub fn without(&self, text: &str) -> String {
        let text = self.0.iter().fold(text.to_owned(), |text, secret| match std::str::from_utf8(secret) {
            Ok(secret) => text.replace(secret, REMOVED),
            Err(_) => text,
        });
        without_named(&without_passwords(&text))
    }

    /// Whether bytes have one of the known secrets.
    pub fn are_in(&self, bytes: &[u8]) -> bool {
        self.0.iter().any(|secret| bytes.windows(secret.len()).any(|part| part == secret))
    }
}

/// A text without what stands behind `secret=`, `password: ` and the like. `secret_file=` names a file and stays.
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
        let end = value.find(|c: char| matches!(c, '&' | '"' | '\'') || c.is_whitespace()).unwrap_or(value.len());
        if end > 0 {
            clean.push_str(&text[at..begin]);
            clean.push_str(REMOVED);
            from = begin + end;
        }
    }
    clean.push_str(&text[from..]);
    clean
}

/// A text without the `NAME:PASSWORD@` of addresses.
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

    /// Known secrets, what the text calls one, and passwords in addresses are left out. The name of a secret's file stays.
    #[test]
    fn no_secret_is_left() {
        let secrets = Secrets::of(vec![b"0123456789abcdef\n".to_vec(), b"9abc".to_vec(), b"789abc".to_vec()]);
        assert_eq!(secrets.without("x 0123456789abcdef y 789abc"), "x [removed] y [removed]");
        assert!(secrets.are_in(b"\0\x010123456789abcdef") && !secrets.are_in(b"9abc"));
        let none = Secrets::of(Vec::new());
        for (text, clean) in [
            ("tcp://host?secret=hunter2&role=reader", "tcp://host?secret=[removed]&role=reader"),
            ("link = \"tcp://me:pass@host:1?x=1\"", "link = \"tcp://[removed]@host:1?x=1\""),
            ("Password: 'a b'", "Password: '[removed] b'"),
            ("tcp://host?secret_file=/etc/a", "tcp://host?secret_file=/etc/a"),
            ("token", "token"),
            ("a secret and a token=x", "a secret and a token=[removed]"),
            ("secret=", "secret="),
        ] {
            assert_eq!(none.without(text), clean);
        }
    }
}

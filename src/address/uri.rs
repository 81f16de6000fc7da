//! The URI that names a link: `scheme:path?key=value&key=value`.
//!
//! Parsing accepts only valid URIs: known keys, each at most once, each with a value that its row in the table of keys
//! ([`KEYS`]) allows. A parsed URI is kept in its normal form, so two URIs with the same meaning are equal and print
//! the same text:
//!
//! ```
//! use ecmsk::link::uri::LinkUri;
//!
//! let uri = LinkUri::parse("sim:?fw=1.7&clock=virtual&slaves=drive,drive,drive")?;
//! assert_eq!(uri.to_string(), "sim:?slaves=drive*3&clock=virtual");
//! # Ok::<(), ecmsk::link::uri::UriError>(())
//! ```
//!
//! [`KEYS`]: super::keys::KEYS

use std::fmt;
use std::hash::{Hash, Hasher};
use std::str::FromStr;

use percent_encoding::{AsciiSet, CONTROLS, percent_decode_str, utf8_percent_encode};

use super::keys::{Key, Scheme, WHERE_TO_LOOK};
use super::slaves::{self, SlaveSpec};
use super::text::{suggestion, visible};
use crate::sk::SlotSize;

/// The characters that are percent-encoded between the colon and the question mark.
const IN_PATH: &AsciiSet = &CONTROLS.add(b' ').add(b'"').add(b'#').add(b'%').add(b'<').add(b'>').add(b'?').add(b'`');
/// The characters that are percent-encoded in a key or a value.
const IN_VALUE: &AsciiSet = &IN_PATH.add(b'&').add(b'=').add(b'\'').add(b'{').add(b'}').add(b'|').add(b'^');

/// The URI of a link in its normal form.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct LinkUri {
    scheme: Scheme,
    path: String,
    /// The keys in the order of the table, without keys that have their default value.
    keys: Vec<(String, String)>,
    lists_slaves: ListsSlaves,
}

/// Whether the URI has the key `slaves`, even with the default list, which the normal form leaves out. A machine file
/// replaces only the slaves of a link that lists none. Not compared, so that links with the same meaning are equal.
#[derive(Clone, Copy, Debug, Default)]
struct ListsSlaves(bool);

impl PartialEq for ListsSlaves {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Eq for ListsSlaves {}

impl Hash for ListsSlaves {
    fn hash<H: Hasher>(&self, _: &mut H) {}
}

/// Why the URI of a link is invalid. The messages name the key, its value and what is allowed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs, reason = "the message of a variant explains its fields")]
pub enum UriError {
    /// The text has no colon.
    #[error("link `{text}` has no scheme; allowed: {allowed}, e.g. sim:?slaves=drive*2; {WHERE_TO_LOOK}")]
    NoScheme { text: String, allowed: String },
    /// The word before the colon is not a scheme.
    #[error(
        "link `{text}`: unknown scheme `{scheme}`;{suggestion} allowed: {allowed}, e.g. sim:?slaves=drive*2; {WHERE_TO_LOOK}"
    )]
    UnknownScheme {
        text: String,
        scheme: String,
        /// The text ` did you mean ..?`, or an empty text.
        suggestion: String,
        allowed: String,
    },
    /// A caller has asked for the options of one scheme, and the link has another one.
    #[error("link `{uri}` is no `{expected}:` link; allowed here: {expected}:; {WHERE_TO_LOOK}")]
    OtherScheme { uri: String, expected: Scheme },
    /// There is text between the colon and the question mark, where this scheme allows none.
    #[error("`{scheme}:` takes nothing but keys, found `{path}`; allowed: {scheme}:?key=value; {WHERE_TO_LOOK}")]
    UnexpectedPath { scheme: Scheme, path: String },
    /// The scheme does not allow this text between the colon and the question mark.
    #[error("`{scheme}:` does not take `{}` as its place; allowed: {allowed}; {WHERE_TO_LOOK}", visible(.path))]
    BadPath { scheme: Scheme, path: String, allowed: &'static str },
    /// One of the texts after the question mark, which `&` separates, has no `=`.
    #[error("`{part}` in a `{scheme}:` link is no `key=value`; {hint}; {WHERE_TO_LOOK}")]
    NotKeyValue {
        scheme: Scheme,
        part: String,
        /// What is allowed: the values of the key, or all keys of the scheme.
        hint: String,
    },
    /// Links of this scheme do not have that key.
    #[error("`{scheme}:` has no key `{key}` (value `{value}`);{hint} allowed: {allowed}; {WHERE_TO_LOOK}")]
    UnknownKey {
        scheme: Scheme,
        key: String,
        value: String,
        /// The text ` did you mean ..?`, or an empty text.
        hint: String,
        allowed: String,
    },
    /// A key is given twice.
    #[error("key `{key}` is given twice, with `{first}` and `{second}`; allowed: once; {WHERE_TO_LOOK}")]
    DuplicateKey { key: String, first: String, second: String },
    /// The key does not allow that value.
    #[error("key `{key}` does not take `{}`; {}; {WHERE_TO_LOOK}", visible(.value), visible(.why))]
    BadValue {
        key: String,
        value: String,
        /// Why the value is invalid, and the allowed values.
        why: String,
    },
    /// A mandatory key is missing.
    #[error("`{scheme}:` needs the key `{key}`: {meaning}; {allowed}; {WHERE_TO_LOOK}")]
    MissingKey { scheme: Scheme, key: String, meaning: &'static str, allowed: String },
    /// Some text of the link is not UTF-8 once its `%XX` are decoded.
    #[error("`{part}` is not UTF-8 once %XX are decoded; allowed: UTF-8; {WHERE_TO_LOOK}")]
    NotUtf8 {
        /// The path, the key or the value as the link writes it, with its `%XX`.
        part: String,
    },
}

impl LinkUri {
    /// Parses a URI; white space around it is ignored.
    ///
    /// A scheme that this build does not support is accepted here and refused when the link is opened.
    ///
    /// # Errors
    /// [`UriError`], which names the key, its value and what is allowed.
    pub fn parse(text: &str) -> Result<Self, UriError> {
        let text = text.trim();
        let Some((scheme, rest)) = text.split_once(':') else {
            return Err(UriError::NoScheme { text: text.to_owned(), allowed: scheme_names() });
        };
        let scheme = Scheme::from_name(scheme).ok_or_else(|| UriError::UnknownScheme {
            text: text.to_owned(),
            scheme: scheme.to_owned(),
            suggestion: suggestion(scheme, Scheme::ALL.map(Scheme::name)),
            allowed: scheme_names(),
        })?;
        let (path, query) = rest.split_once('?').unwrap_or((rest, ""));
        let path = decode(path)?;
        if !path.is_empty() && scheme.path().is_none() {
            return Err(UriError::UnexpectedPath { scheme, path });
        }
        let mut uri = Self { scheme, path, keys: Vec::new(), lists_slaves: ListsSlaves::default() };
        if !query.is_empty() {
            for part in query.split('&') {
                uri.add(part)?;
            }
        }
        uri.check_slaves()?;
        uri.check_machine()?;
        uri.check_clock()?;
        let lists_slaves = uri.keys().any(|(key, _)| key == "slaves");
        uri.lists_slaves = ListsSlaves(lists_slaves);
        uri.normalize();
        Ok(uri)
    }

    /// The scheme: the way to reach the board.
    pub const fn scheme(&self) -> Scheme {
        self.scheme
    }

    /// The decoded text between the colon and the question mark; empty for `sim:`.
    pub fn path(&self) -> &str {
        &self.path
    }

    /// The keys with a value other than the default, decoded, in the order of the normal form.
    pub fn keys(&self) -> impl Iterator<Item = (&str, &str)> {
        self.keys.iter().map(|(key, value)| (key.as_str(), value.as_str()))
    }

    /// The value of a key: the given value or else the default; `None` if there is neither.
    pub fn value(&self, key: &str) -> Option<&str> {
        let given = self.keys().find(|(name, _)| *name == key).map(|(_, value)| value);
        given.or_else(|| Key::find(self.scheme, key)?.default)
    }

    /// Gets the value of a key and converts it with `read`; `None` if the key is not given and has no default.
    pub(crate) fn typed<T>(&self, key: &str, read: impl FnOnce(&str) -> Option<T>) -> Result<Option<T>, UriError> {
        let Some(value) = self.value(key) else { return Ok(None) };
        // The table allows the value. `read` fails only if the type of the option has a smaller range than the table; the
        // error then shows what the table allows.
        let why = || Key::find(self.scheme, key).map(|row| row.syntax.allowed()).unwrap_or_default();
        let bad = || UriError::BadValue { key: key.to_owned(), value: value.to_owned(), why: why() };
        read(value).map(Some).ok_or_else(bad)
    }

    /// As [`typed`](Self::typed), for a key with a default.
    pub(crate) fn required<T>(&self, key: &str, read: impl FnOnce(&str) -> Option<T>) -> Result<T, UriError> {
        self.typed(key, read)?.ok_or_else(|| self.unknown_key(key, ""))
    }

    /// As [`typed`](Self::typed), for a mandatory key without a default.
    #[cfg(all(feature = "usb", unix))]
    pub(crate) fn given<T>(&self, key: &str, read: impl FnOnce(&str) -> Option<T>) -> Result<T, UriError> {
        let Some(row) = Key::find(self.scheme, key) else { return Err(self.unknown_key(key, "")) };
        self.typed(key, read)?.ok_or_else(|| UriError::MissingKey {
            scheme: self.scheme,
            key: key.to_owned(),
            meaning: row.meaning,
            allowed: row.syntax.allowed(),
        })
    }

    /// As [`required`](Self::required), for a key whose value is one of these words.
    pub(crate) fn choice<T, const N: usize>(&self, key: &str, words: [(&str, T); N]) -> Result<T, UriError> {
        self.required(key, |value| words.into_iter().find(|(word, _)| *word == value).map(|(_, meaning)| meaning))
    }

    /// The slaves that the URI lists, for a simulated network.
    pub(crate) fn slaves(&self) -> Result<Vec<SlaveSpec>, UriError> {
        self.required("slaves", |value| slaves::parse(value).ok())
    }

    /// Returns an error if the link has another scheme than `expected`.
    pub(crate) fn expect_scheme(&self, expected: Scheme) -> Result<(), UriError> {
        if self.scheme == expected {
            return Ok(());
        }
        Err(UriError::OtherScheme { uri: self.to_string(), expected })
    }

    fn add(&mut self, part: &str) -> Result<(), UriError> {
        let scheme = self.scheme;
        let Some((key, value)) = part.split_once('=') else {
            let part = decode(part)?;
            let hint = match Key::find(scheme, &part) {
                Some(row) => format!("write {part}=VALUE; {}", row.syntax.allowed()),
                None => format!("allowed: {}", key_names(scheme)),
            };
            return Err(UriError::NotKeyValue { scheme, part, hint });
        };
        let (key, value) = (decode(key)?, decode(value)?);
        let row = Key::find(scheme, &key).ok_or_else(|| self.unknown_key(&key, &value))?;
        let value = row.syntax.normal(&value).map_err(|why| UriError::BadValue { key: key.clone(), value, why })?;
        if let Some((_, first)) = self.keys.iter().find(|(name, _)| *name == key) {
            return Err(UriError::DuplicateKey { key, first: first.clone(), second: value });
        }
        self.keys.push((key, value));
        Ok(())
    }

    /// Checks the number of slaves against the slot size: a frame has room for 40 slaves with 12-byte slots and for 30
    /// slaves with 16-byte slots.
    fn check_slaves(&self) -> Result<(), UriError> {
        let Some(list) = self.value("slaves") else { return Ok(()) };
        let bad = |why| UriError::BadValue { key: "slaves".to_owned(), value: list.to_owned(), why };
        self.check_count(slaves::parse(list).map_err(bad)?.len()).map_err(bad)
    }

    /// Checks that a frame with the slot size of this link has room for that many slaves.
    pub(crate) fn check_count(&self, slaves: usize) -> Result<(), String> {
        let slot = self.typed("slot", slot_size).ok().flatten().unwrap_or_default();
        if slaves <= slot.max_slaves() { Ok(()) } else { Err(slaves::too_many(slot)) }
    }

    /// Rejects the key `slaves` beside the key `machine`, since a machine file lists slaves, too.
    fn check_machine(&self) -> Result<(), UriError> {
        let given = |key: &str| self.keys().find(|(name, _)| *name == key).map(|(_, value)| value.to_owned());
        match (given("machine"), given("slaves")) {
            (Some(_), Some(value)) => Err(UriError::BadValue {
                key: "slaves".to_owned(),
                value,
                why: "the machine file says which slaves there are; allowed: slaves= or machine=".to_owned(),
            }),
            _ => Ok(()),
        }
    }

    /// This link with the slaves of the machine file `file`. `None` if the link has no simulated slaves, lists its own,
    /// or names a machine file already.
    pub(crate) fn with_machine(&self, file: &str) -> Option<Self> {
        let has_slaves = self.lists_slaves.0 || self.keys().any(|(key, _)| key == "machine");
        if has_slaves || !self.scheme.is_model() {
            return None;
        }
        let mut uri = self.clone();
        uri.keys.push(("machine".to_owned(), file.to_owned()));
        uri.normalize();
        Some(uri)
    }

    /// This link with the machine file `file` for its axes (`axes=`), unless it names a machine file already.
    pub fn with_axes(&self, file: &str) -> Self {
        let mut uri = self.clone();
        if !uri.keys().any(|(key, _)| matches!(key, "axes" | "machine")) {
            uri.keys.push(("axes".to_owned(), file.to_owned()));
            uri.normalize();
        }
        uri
    }

    /// \[OURS] Rejects keys that have no effect on a virtual clock.
    fn check_clock(&self) -> Result<(), UriError> {
        if self.value("clock") != Some("virtual") {
            return Ok(());
        }
        for (key, why) in REAL_CLOCK_ONLY {
            let default = Key::find(self.scheme, key).and_then(|row| row.default);
            if let Some(value) = self.value(key).filter(|value| Some(*value) != default) {
                let instead = default.map(|value| format!(", or {key}={value}")).unwrap_or_default();
                let why = format!("{why}; allowed: {key}= with clock=real{instead}");
                return Err(UriError::BadValue { key: (*key).to_owned(), value: value.to_owned(), why });
            }
        }
        Ok(())
    }

    fn normalize(&mut self) {
        let scheme = self.scheme;
        self.keys.retain(|(key, value)| Key::find(scheme, key).is_some_and(|row| row.default != Some(value.as_str())));
        self.keys.sort_by_key(|(key, _)| Key::of(scheme).position(|row| row.name == key));
    }

    fn unknown_key(&self, key: &str, value: &str) -> UriError {
        UriError::UnknownKey {
            scheme: self.scheme,
            key: key.to_owned(),
            value: value.to_owned(),
            hint: suggestion(key, Key::of(self.scheme).map(|row| row.name)),
            allowed: key_names(self.scheme),
        }
    }
}

impl FromStr for LinkUri {
    type Err = UriError;

    fn from_str(text: &str) -> Result<Self, UriError> {
        Self::parse(text)
    }
}

/// Writes the normal form: keys in the order of the table, defaults left out. Parsing the result yields an equal URI.
impl fmt::Display for LinkUri {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.scheme, utf8_percent_encode(&self.path, IN_PATH))?;
        for (i, (key, value)) in self.keys.iter().enumerate() {
            let before = if i == 0 { '?' } else { '&' };
            write!(f, "{before}{}={}", utf8_percent_encode(key, IN_VALUE), utf8_percent_encode(value, IN_VALUE))?;
        }
        Ok(())
    }
}

/// Keys without effect on a virtual clock, each with the reason why it has none, for the error message.
const REAL_CLOCK_ONLY: &[(&str, &str)] = &[
    ("rate", "with clock=virtual time passes by calls alone, at no rate"),
    ("priority", "with clock=virtual there is no thread of the cycle"),
    ("cpu", "with clock=virtual there is no thread to keep somewhere"),
    ("lock_memory", "with clock=virtual no cycle has a time to keep"),
];

/// Parses a slot size as links write it, in bytes.
pub(crate) fn slot_size(value: &str) -> Option<SlotSize> {
    SlotSize::from_bytes(value.parse().ok()?)
}

fn decode(part: &str) -> Result<String, UriError> {
    let decoded = percent_decode_str(part).decode_utf8();
    decoded.map(Into::into).map_err(|_| UriError::NotUtf8 { part: part.to_owned() })
}

fn scheme_names() -> String {
    Scheme::ALL.map(|scheme| format!("{scheme}:")).join(", ")
}

fn key_names(scheme: Scheme) -> String {
    Key::of(scheme).map(|row| row.name).collect::<Vec<_>>().join(", ")
}

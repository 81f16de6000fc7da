//! Any bytes as `ecmsk.toml`: a link, which is the same when it is written again and when the variable names it, or an error
//! that names the file and the line.

#![no_main]

#[path = "support/folder.rs"]
mod folder;

use ecmsk::link::config::{ConfigError, Configured, Environment, FILE_NAME, Source, find};
use ecmsk::link::uri::LinkUri;
use folder::Folder;
use libfuzzer_sys::fuzz_target;

/// Longest file that is read, bytes.
const LONGEST: usize = 1 << 16;

fuzz_target!(|bytes: &[u8]| {
    let folder = Folder::make();
    let file = folder.write(FILE_NAME, bytes);
    let environment = Environment { program_dir: Some(folder.path().into()), ..Environment::default() };
    let found = find(&environment);
    match &found {
        Ok(Configured { link, source }) => {
            assert_eq!(*source, Source::File(file));
            let parsed = LinkUri::parse(link);
            match &parsed {
                Ok(uri) => assert_eq!(LinkUri::parse(&uri.to_string()).as_ref(), Ok(uri), "{link}"),
                Err(error) => assert!(!error.to_string().is_empty()),
            }
            folder.write(FILE_NAME, format!("# written again\r\n\"link\"={}", quoted(link)));
            assert_eq!(find(&environment), found);
            // A variable that is empty is as one that is not set.
            let variable = Environment { link: Some(link.into()), ..environment };
            let named = find(&variable).expect("a variable in UTF-8");
            assert_eq!(LinkUri::parse(&named.link), parsed);
            assert_eq!(named.source == Source::Variable, !link.is_empty());
        }
        Err(error @ ConfigError::Content { path, line, message }) => {
            let text = std::str::from_utf8(bytes).expect("text, or it is unreadable");
            assert_eq!(*path, file);
            assert!((1..=1 + text.matches('\n').count()).contains(line), "line {line} of {text:?}");
            assert!(!message.is_empty() && error.to_string().contains(FILE_NAME));
        }
        Err(error @ ConfigError::Unreadable { path, .. }) => {
            assert_eq!(*path, file);
            assert!(bytes.len() > LONGEST || std::str::from_utf8(bytes).is_err(), "{error}");
        }
        Err(error) => panic!("nobody named a variable, and everybody has the same rights: {error}"),
    }
});

/// As TOML has it, in one line.
fn quoted(text: &str) -> String {
    let escape = |letter: char| match letter {
        '"' | '\\' => format!("\\{letter}"),
        letter if letter.is_control() => format!("\\u{:04X}", u32::from(letter)),
        letter => letter.to_string(),
    };
    format!("\"{}\"", text.chars().map(escape).collect::<String>())
}

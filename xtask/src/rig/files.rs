//! Receives files that the guest prints on its console as hexadecimal digits.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use super::packages;
use crate::error::Error;

/// The first word of a line that a test in the guest prints on the console to hand over bytes of a file. The name of the
/// file and the bytes in hexadecimal digits follow; a file may take several lines, in order.
pub const MARK: &str = "FILE ";

/// Writes the files that these console lines contain into `folder`. What earlier runs have left in the folder is removed.
pub fn keep(lines: &[String], folder: &Path) -> Result<(), Error> {
    packages::empty(folder)?;
    for (name, content) in files(lines) {
        let path = folder.join(name);
        fs::write(&path, content).map_err(Error::file("write", &path))?;
    }
    Ok(())
}

fn files(lines: &[String]) -> BTreeMap<&str, Vec<u8>> {
    let mut files: BTreeMap<&str, Vec<u8>> = BTreeMap::new();
    for line in lines {
        let part = line.strip_prefix(MARK).and_then(|rest| rest.split_once(' '));
        if let Some((name, bytes)) = part.and_then(|(name, digits)| Some((name, bytes(digits)?))) {
            files.entry(name).or_default().extend(bytes);
        }
    }
    files
}

/// The bytes of hexadecimal digits; `None` for other text.
fn bytes(digits: &str) -> Option<Vec<u8>> {
    let pairs = digits.as_bytes().chunks(2);
    pairs.map(|pair| u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_put_together_of_its_lines() {
        let lines = ["FILE a 0001", "FILE b ff", "test a ... ok", "FILE a 02", "FILE a no digits"].map(str::to_owned);
        assert_eq!(files(&lines), BTreeMap::from([("a", vec![0, 1, 2]), ("b", vec![0xFF])]));
    }
}

//! An error type for the `main` of programs.

use std::error::Error;
use std::fmt;

/// Any error, as the return type of `main`: `Result<(), Failure>` ends a program with exit code 1 and the message of
/// the error. `main` would show any other error type in its debug format. A text can be converted to a failure, too:
/// `Err("the door is open")?`.
///
/// ```
/// use ecmsk::ecm::{Ecm, Failure};
///
/// fn program() -> Result<(), Failure> {
///     Ecm::open("sim:?slaves=none&clock=virtual").map(|_| ())?;
///     Ok(())
/// }
/// let said = program().unwrap_err().to_string();
/// assert!(said.ends_with("it finds no slave; give it some with `slaves=`"), "{said}");
/// ```
pub struct Failure(String);

// `Failure` must not implement std::error::Error: then this `From` would overlap with `From<Failure> for Failure` of
// the standard library.
impl<E: Into<Box<dyn Error + Send + Sync>>> From<E> for Failure {
    fn from(error: E) -> Self {
        Self(error.into().to_string())
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// `main` prints an error in its debug format, which is therefore the message.
impl fmt::Debug for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `?` converts errors and texts, and both formats show the message alone.
    #[test]
    fn errors_and_texts_become_failures() {
        let number = |text: &str| -> Result<u8, Failure> { Ok(text.parse()?) };
        let even = |text: &str| match number(text)? {
            odd if odd % 2 == 1 => Err(format!("{odd} is odd"))?,
            0 => Err("nothing")?,
            even => Ok::<u8, Failure>(even),
        };
        let said = |text| even(text).map_err(|failure| format!("{failure} {failure:?}"));
        assert_eq!(said("4"), Ok(4));
        assert_eq!(said("3"), Err("3 is odd 3 is odd".into()));
        assert_eq!(said("0"), Err("nothing nothing".into()));
        assert_eq!(said("x"), Err("invalid digit found in string invalid digit found in string".into()));
    }
}

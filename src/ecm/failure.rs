//! An error type for `main`.

/// Any error, for `main` to return: `Result<(), Failure>` ends a program with exit code 1 and the words of the error. Returned
/// itself, the error would be shown in its debug format.
///
/// ```
/// use ecmsk::ecm::{Ecm, Failure};
///
/// fn program() -> Result<(), Failure> {
///     Ecm::open("sim:?slaves=none&clock=virtual").map(|_| ())?;
///     Ok(())
/// }
/// let said = format!("{:?}", program().unwrap_err());
/// assert!(said.ends_with("it finds no slave; give it some with `slaves=`"), "{said}");
/// ```
pub struct Failure(String);

// It is no std::error::Error itself: there would be two implementations of From<Failure>.
impl<E: std::error::Error> From<E> for Failure {
    fn from(error: E) -> Self {
        Self(error.to_string())
    }
}

/// `main` shows its error in this format.
impl std::fmt::Debug for Failure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

//! An error for `main`.

/// What `main` may end with: `Result<(), Failure>` ends a program with code 1 and the error's own words, where the error
/// itself would be shown as Rust sees it.
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

// It is no std::error::Error itself, or this would be two of From<Failure>.
impl<E: std::error::Error> From<E> for Failure {
    fn from(error: E) -> Self {
        Self(error.to_string())
    }
}

/// `main` shows what it ends with by this.
impl std::fmt::Debug for Failure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

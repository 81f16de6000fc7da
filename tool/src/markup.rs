//! Text in markup: HTML and XML.

use super::visible::visible;

/// The text for an element or an attribute in double quotes. Control characters, which XML does not have, stand as their codes.
pub fn escaped(text: &str) -> String {
    visible(text).replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}

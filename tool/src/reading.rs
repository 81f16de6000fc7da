//! Verbs that only look are readers, where links tell readers from the one that writes.

use ecmsk::link::uri::LinkUri;

/// A link on which nothing is going to be written.
pub fn reading(uri: &LinkUri) -> LinkUri {
    if uri.value("role") != Some("writer") {
        return uri.clone();
    }
    // The normal form leaves out what is so by itself.
    let text = uri.to_string();
    let sign = if text.contains('?') { '&' } else { '?' };
    LinkUri::parse(&format!("{text}{sign}role=reader")).unwrap_or_else(|_| uri.clone())
}

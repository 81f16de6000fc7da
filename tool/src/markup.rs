//! Text in markup: HTML and XML.

use super::visible::visible;

/// Escapes a text for an element, or for an attribute in double quotes. Control characters, which XML does not have,
/// are written as their codes.
pub fn escaped(text: &str) -> String {
    visible(text).replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}

/// A page for a browser, without scripts: its title, which is its heading, too, and the HTML below that.
pub fn page(title: &str, below: &str) -> String {
    const STYLE: &str = "body{font:14px sans-serif;color:#202428;max-width:1200px;margin:1em auto;padding:0 1em}\
        table{border-collapse:collapse}th,td{text-align:left;padding:.2em 1em .2em 0;border-bottom:1px solid #e4e8ec}\
        pre{white-space:pre-wrap}svg{max-width:100%;height:auto}";
    let title = escaped(title);
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'\">\n\
         <title>{title} - ecmsk</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<h1>{title}</h1>\n\
         {below}</body>\n</html>\n"
    )
}

/// A figure of a page: a heading, and below it an SVG picture, or HTML text in its place.
pub fn figure(heading: &str, svg: &str) -> String {
    format!("<h3>{}</h3>\n{svg}\n", escaped(heading))
}

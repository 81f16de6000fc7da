//! Results as a file in the JUnit format, which GitLab, Jenkins and other services show: one test case for each thing that
//! was checked.

use std::path::Path;
use std::time::Duration;

use super::output_file::{Kind, OutputFile, OutputFileError, Replace};

/// A test case: one thing that was checked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Case {
    /// What was checked.
    pub name: String,
    /// What went wrong; `None` if the check has passed.
    pub failure: Option<String>,
    /// How long the check took, on the clock that the verb uses.
    pub time: Duration,
}

/// The output file of `--junit`.
pub const fn output(file: &Path, replace: Replace) -> OutputFile<'_> {
    OutputFile { file, option: "--junit", kind: Kind::Junit, replace }
}

/// Writes the cases as one test suite with the name `suite`.
///
/// # Errors
/// [`OutputFileError`] if the file cannot be written, or exists and contains something other than test results.
pub fn write(output: &OutputFile, suite: &str, cases: &[Case]) -> Result<(), OutputFileError> {
    output.write(text(suite, cases).as_bytes())
}

/// The cases as the text of a JUnit file.
pub fn text(suite: &str, cases: &[Case]) -> String {
    let failures = cases.iter().filter(|case| case.failure.is_some()).count();
    let seconds = |time: Duration| format!("{:.3}", time.as_secs_f64());
    let suite = escaped(suite);
    let (tests, time) = (cases.len(), seconds(cases.iter().map(|case| case.time).sum()));
    let counts = format!("tests=\"{tests}\" failures=\"{failures}\" errors=\"0\" time=\"{time}\"");
    let mut text = format!("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites {counts}>\n");
    text += &format!("  <testsuite name=\"{suite}\" {counts}>\n");
    for Case { name, failure, time } in cases {
        let case =
            format!("    <testcase classname=\"{suite}\" name=\"{}\" time=\"{}\"", escaped(name), seconds(*time));
        text += &match failure {
            None => format!("{case}/>\n"),
            Some(why) => format!("{case}>\n      <failure message=\"{}\"/>\n    </testcase>\n", escaped(why)),
        };
    }
    text + "  </testsuite>\n</testsuites>\n"
}

/// Escapes a text for the value of an XML attribute. XML 1.0 has no control characters, and line ends in attributes
/// become spaces.
fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\n' => escaped.push_str("&#10;"),
            letter if letter.is_control() || matches!(letter, '\u{FFFE}' | '\u{FFFF}') => escaped.push('\u{FFFD}'),
            letter => escaped.push(letter),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A parser of XML reads back what was written, whatever characters it has.
    #[test]
    fn cases_are_read_back() {
        let odd = "a < b & \"c\" > 'd'\n\u{1}\u{FFFE}é";
        let cases = [
            Case { name: odd.to_owned(), failure: Some(odd.to_owned()), time: Duration::from_micros(1_234_567) },
            Case { name: "right".to_owned(), failure: None, time: Duration::ZERO },
        ];
        let text = text("suite & all", &cases);
        let document = roxmltree::Document::parse(&text).expect(&text);
        let suite = document.descendants().find(|node| node.has_tag_name("testsuite")).expect("a suite");
        let counts = ["name", "tests", "failures", "time"].map(|name| suite.attribute(name).expect("an attribute"));
        assert_eq!(counts, ["suite & all", "2", "1", "1.235"]);
        let read: Vec<_> = suite.children().filter(roxmltree::Node::is_element).collect();
        let failures =
            read.iter().map(|case| case.first_element_child().and_then(|failure| failure.attribute("message")));
        let expected = odd.replace(['\u{1}', '\u{FFFE}'], "\u{FFFD}");
        assert_eq!(failures.collect::<Vec<_>>(), [Some(&*expected), None]);
        assert_eq!(read[0].attribute("name"), Some(&*expected));
        assert_eq!(read[1].attribute("time"), Some("0.000"));
    }
}

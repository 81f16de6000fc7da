//! Results of tests as JUnit XML, which services for continuous integration show.

use super::markup::escaped;

/// A test case.
pub struct Case {
    /// The name, which is the same at each run.
    pub name: String,
    /// Why it failed, a line for each reason; none if it passed.
    pub failures: Vec<String>,
}

/// The text of a file with one suite of test cases.
pub fn suite(name: &str, cases: &[Case]) -> String {
    let suite = escaped(name);
    let (count, failed) = (cases.len(), cases.iter().filter(|case| !case.failures.is_empty()).count());
    let cases: String = cases.iter().map(|case| element(&suite, case)).collect();
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites>\n\
         <testsuite name=\"{suite}\" tests=\"{count}\" failures=\"{failed}\" errors=\"0\" skipped=\"0\">\n\
         {cases}</testsuite>\n</testsuites>\n"
    )
}

fn element(suite: &str, case: &Case) -> String {
    let begin = format!("<testcase classname=\"{suite}\" name=\"{}\"", escaped(&case.name));
    if case.failures.is_empty() {
        return format!("{begin}/>\n");
    }
    // One element with all reasons: some services show the first failure of a case alone.
    format!("{begin}>\n<failure message=\"{}\"/>\n</testcase>\n", escaped(&case.failures.join("; ")))
}

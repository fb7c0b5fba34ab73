//! What tests have found: for people and as JUnit.

use std::fmt::Write as _;
use std::path::Path;

use ob1_station_file::finding::Finding;

/// One test that was run.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Name of the test, as the file gives it.
    pub name: String,
    /// Why it failed, with line; empty: it passed.
    pub failures: Vec<Failure>,
    /// Virtual time it ran.
    pub plc_seconds: f64,
    /// Real time it took.
    pub wall_seconds: f64,
}

/// An expectation that does not hold.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// The line in the test file; `None`: what was tested has no lines.
    pub line: Option<u32>,
    /// Step, time and what was expected and found.
    pub text: String,
}

impl Failure {
    /// With its place.
    fn at(&self, file: &str) -> String {
        let Self { line, text } = self;
        line.map_or_else(|| format!("{file}: {text}"), |line| format!("{file}:{line}: {text}"))
    }
}

/// What became of one test file.
#[derive(Clone, Debug)]
pub struct FileReport {
    /// As it was named.
    pub file: String,
    /// Why it could not be run; empty when it could.
    pub refused: Vec<Finding>,
    /// The outcomes of its tests, in the order of the file.
    pub outcomes: Vec<Outcome>,
}

impl FileReport {
    /// The tests that failed.
    pub fn failed(&self) -> usize {
        self.outcomes.iter().filter(|o| !o.failures.is_empty()).count()
    }

    /// As it is printed.
    pub fn text(&self) -> String {
        let mut out = String::new();
        for finding in &self.refused {
            let _ = writeln!(out, "{finding}");
        }
        for outcome in &self.outcomes {
            let verdict = if outcome.failures.is_empty() { "ok    " } else { "FAILED" };
            let _ = writeln!(out, "{verdict} {}: {} ({:.3} s)", self.file, outcome.name, outcome.plc_seconds);
            for failure in &outcome.failures {
                let _ = writeln!(out, "  {}", failure.at(&self.file));
            }
        }
        out
    }
}

/// Writes all reports as JUnit XML. Times are real times; a file that could not be run is a test case with an error.
///
/// # Errors
/// The file cannot be written; its name and what the system says.
pub fn write_junit(path: &Path, reports: &[FileReport]) -> Result<(), String> {
    ob1_process::files::write(path, junit(reports).as_bytes()).map_err(|error| format!("{}: {error}", path.display()))
}

fn junit(reports: &[FileReport]) -> String {
    let mut out = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites>\n");
    for report in reports {
        let refused = usize::from(!report.refused.is_empty());
        let time: f64 = report.outcomes.iter().map(|o| o.wall_seconds).sum();
        let file = escape(&report.file);
        let _ = writeln!(
            out,
            "  <testsuite name=\"{file}\" tests=\"{}\" failures=\"{}\" errors=\"{refused}\" time=\"{time:.6}\">",
            report.outcomes.len() + refused,
            report.failed(),
        );
        if refused > 0 {
            let text: String = report.refused.iter().map(ToString::to_string).collect();
            let message = report.refused.first().map_or("", |f| f.message.as_str());
            let _ = writeln!(
                out,
                "    <testcase classname=\"{file}\" name=\"load\">\n      <error message=\"{}\">{}</error>\n    </testcase>",
                escape(message),
                escape(&text)
            );
        }
        for outcome in &report.outcomes {
            let (name, time) = (escape(&outcome.name), outcome.wall_seconds);
            let _ = write!(out, "    <testcase classname=\"{file}\" name=\"{name}\" time=\"{time:.6}\"");
            let Some(first) = outcome.failures.first() else {
                out.push_str("/>\n");
                continue;
            };
            let lines: Vec<String> = outcome.failures.iter().map(|failure| failure.at(&report.file)).collect();
            let _ = writeln!(
                out,
                ">\n      <failure message=\"{}\">{}</failure>\n    </testcase>",
                escape(&first.text),
                escape(&lines.join("\n"))
            );
        }
        out.push_str("  </testsuite>\n");
    }
    out.push_str("</testsuites>\n");
    out
}

/// For XML text and attributes; XML cannot have control characters.
fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\n' | '\t' => out.push(c),
            c if c.is_control() => out.push('?'),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn junit_is_well_formed() {
        let failed = Failure { line: Some(7), text: "A 4.0 <1> & \"2\"\u{1}".into() };
        let outcome =
            |name: &str, failures| Outcome { name: name.into(), failures, plc_seconds: 1.0, wall_seconds: 0.5 };
        let report = FileReport {
            file: "a.test.toml".into(),
            refused: Vec::new(),
            outcomes: vec![outcome("one", Vec::new()), outcome("two", vec![failed])],
        };
        let text = junit(&[report]);
        assert!(text.contains("tests=\"2\" failures=\"1\" errors=\"0\" time=\"1.000000\""), "{text}");
        assert!(text.contains("name=\"one\" time=\"0.500000\"/>"), "{text}");
        assert!(text.contains("a.test.toml:7: A 4.0 &lt;1&gt; &amp; &quot;2&quot;?</failure>"), "{text}");
        assert_eq!(text.matches("<testcase").count(), 2);
    }
}

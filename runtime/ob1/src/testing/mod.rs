//! `ob1 test`: unit tests for control programs, in virtual time. docs/testing.md

pub(crate) mod bench;
mod cells;
mod file;
mod find;
mod harness;
mod plan;
pub(crate) mod replay;
mod report;
mod run;

use std::path::PathBuf;

use clap::Args;

pub use find::find_tests;
pub use report::{Failure, FileReport, Outcome, write_junit};
pub use run::{run_file, wrong_with};

use crate::exit::TestExit;

/// Test control programs in virtual time
///
/// A test is a TOML file NAME.test.toml beside the program: it sets inputs, lets time pass and says what outputs, data
/// blocks and the diagnostic buffer must hold. Nothing waits: ten minutes of a timer take milliseconds.
#[derive(Clone, Debug, Args)]
#[command(
    after_help = "Examples:\n  ob1 test examples/traffic-light\n  ob1 test press.test.toml --filter start --junit results.xml\n\n\
    Exit codes: 0 all tests passed, 1 a test failed, 2 a test file or program cannot be used, or there is no test. docs/testing.md"
)]
pub struct TestArgs {
    /// Test files, or folders that are searched for *.test.toml (the current one when none is given)
    #[arg(value_name = "FILE|DIR")]
    pub paths: Vec<PathBuf>,
    /// Run only tests whose name contains this
    #[arg(long, value_name = "TEXT")]
    pub filter: Option<String>,
    /// Write the results as JUnit XML
    #[arg(long, value_name = "FILE")]
    pub junit: Option<PathBuf>,
    /// Print failures only
    #[arg(long, short)]
    pub quiet: bool,
}

/// Runs tests and prints their results.
///
/// # Errors
/// Why none can be run, or a report cannot be written.
pub fn test(args: &TestArgs) -> Result<TestExit, String> {
    let paths = if args.paths.is_empty() { vec![PathBuf::from(".")] } else { args.paths.clone() };
    let files = find_tests(&paths)?;
    let filter = args.filter.as_deref().unwrap_or_default();
    // Plugin blocks nested as deep as any program may nest them.
    let reports = ob1_rt::with_stack(ob1_cpu::MOST_STACK_BYTES, || {
        files.iter().map(|file| run_file(file, filter)).collect::<Vec<FileReport>>()
    });
    let reports = reports.map_err(|error| format!("a thread for the tests: {error}"))?;
    for report in reports.iter().filter(|r| !args.quiet || r.failed() > 0 || !r.refused.is_empty()) {
        says!("{}", report.text());
    }
    let run: usize = reports.iter().map(|r| r.outcomes.len()).sum();
    let failed: usize = reports.iter().map(FileReport::failed).sum();
    let refused = reports.iter().filter(|r| !r.refused.is_empty()).count();
    say!("{}", verdict(run, failed, refused));
    if let Some(path) = &args.junit {
        write_junit(path, &reports)?;
    }
    Ok(match (refused, run, failed) {
        (0, 1.., 0) => TestExit::Passed,
        (0, 1.., _) => TestExit::Failed,
        _ => TestExit::Unusable,
    })
}

fn verdict(run: usize, failed: usize, refused: usize) -> String {
    let mut text = format!("{} passed, {failed} failed", run - failed);
    if refused > 0 {
        text += &format!(", {refused} {} cannot be used", if refused == 1 { "file" } else { "files" });
    }
    if run == 0 && refused == 0 {
        text += ": there is no such test";
    }
    text
}

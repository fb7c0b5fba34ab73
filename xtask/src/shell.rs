//! Starts other programs: prints the command line, runs it, and turns a failure into one sentence.

use std::ffi::OsStr;
use std::process::{Command, Output, Stdio};

use crate::failure::{Failure, Outcome, step};

/// The command line as it would be typed, with its environment.
pub(crate) fn line(command: &Command) -> String {
    let word = |text: &OsStr| text.to_string_lossy().into_owned();
    let settings = command.get_envs().filter_map(|(key, value)| Some(format!("{}={}", word(key), word(value?))));
    let program = std::path::Path::new(command.get_program()).file_name().unwrap_or(command.get_program());
    settings.chain([word(program)]).chain(command.get_args().map(word)).collect::<Vec<_>>().join(" ")
}

/// Runs it with our input and output.
///
/// # Errors
/// If it cannot be started, or its exit code is not 0.
pub(crate) fn run(command: &mut Command) -> Outcome {
    run_program(command).map_err(|failure| step(failure.to_string()))
}

/// The same for the program of a verb: its exit code becomes ours.
///
/// # Errors
/// If it cannot be started, or its exit code is not 0.
pub(crate) fn run_program(command: &mut Command) -> Outcome {
    let shown = line(command);
    eprintln!("$ {shown}");
    let status = command.status().map_err(|why| step(format!("cannot start `{shown}`: {why}")))?;
    if status.success() {
        return Ok(());
    }
    let code = status.code().and_then(|code| u8::try_from(code).ok()).unwrap_or(1);
    Err(Failure::Program(format!("`{shown}` failed ({status})"), code))
}

/// Runs it and returns its standard output; its error output goes to ours.
///
/// # Errors
/// If it cannot be started, or its exit code is not 0.
pub(crate) fn read(command: &mut Command) -> Outcome<String> {
    let shown = line(command);
    let output: Output =
        command.stderr(Stdio::inherit()).output().map_err(|why| step(format!("cannot start `{shown}`: {why}")))?;
    if !output.status.success() {
        return Err(step(format!("`{shown}` failed ({})", output.status)));
    }
    String::from_utf8(output.stdout).map_err(|_| step(format!("`{shown}` wrote something that is not text")))
}

/// Whether it starts and its exit code is 0, without any output. Used to check whether a tool is installed.
pub(crate) fn works(command: &mut Command) -> bool {
    command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success())
}

/// Runs it, shows its lines immediately, and returns those that `keep` selects, in the order they were read.
///
/// # Errors
/// If it cannot be started, or its exit code is not 0.
pub(crate) fn watch(command: &mut Command, keep: fn(&str) -> bool) -> Outcome<Vec<String>> {
    let shown = line(command);
    eprintln!("$ {shown}");
    let mut child = command
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|why| step(format!("cannot start `{shown}`: {why}")))?;
    let (from_stdout, from_stderr) = (child.stdout.take(), child.stderr.take());
    let kept = std::thread::scope(|scope| {
        let errors = scope.spawn(|| from_stderr.map(|pipe| relay(pipe, std::io::stderr(), keep)).unwrap_or_default());
        let mut kept = from_stdout.map(|pipe| relay(pipe, std::io::stdout(), keep)).unwrap_or_default();
        kept.extend(errors.join().unwrap_or_default());
        kept
    });
    let status = child.wait().map_err(|why| step(format!("waiting for `{shown}`: {why}")))?;
    if status.success() { Ok(kept) } else { Err(step(format!("`{shown}` failed ({status})"))) }
}

/// Copies lines until the pipe ends. Invalid text is marked, and a closed output does not stop the child.
fn relay(pipe: impl std::io::Read, mut to: impl std::io::Write, keep: fn(&str) -> bool) -> Vec<String> {
    let mut from = std::io::BufReader::new(pipe);
    let mut kept = Vec::new();
    let mut bytes = Vec::new();
    while std::io::BufRead::read_until(&mut from, b'\n', &mut bytes).is_ok_and(|count| count > 0) {
        let _ = to.write_all(&bytes).and_then(|()| to.flush());
        let text = String::from_utf8_lossy(&bytes);
        if keep(text.trim_end()) {
            kept.push(text.trim_end().to_owned());
        }
        bytes.clear();
    }
    kept
}

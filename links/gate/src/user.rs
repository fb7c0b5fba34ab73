//! `ob1-gate user`: the file of users, always replaced as a whole.

use std::fs;
use std::io::{BufRead as _, Write as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;
use std::process::ExitCode;

use crate::shared::{Users, hash};
use ob1_access::Right;
use rustix::termios::{LocalModes, OptionalActions, tcgetattr, tcsetattr};

use crate::UserCommand;

/// Shortest password: a shorter one is easily guessed.
const SHORTEST: usize = 8;

pub(crate) fn run(command: &UserCommand) -> ExitCode {
    let done = match command {
        UserCommand::Add { file, name, rights } => add(file, name, rights),
        UserCommand::Remove { file, name } => remove(file, name),
        UserCommand::List { file } => list(file),
    };
    let (text, exit) = match done {
        Ok(text) => (text, ExitCode::SUCCESS),
        Err(why) => (format!("ob1-gate: {why}\n"), ExitCode::from(1)),
    };
    // It is possible that nobody reads it.
    let _ = std::io::stderr().write_all(text.as_bytes());
    exit
}

fn add(file: &Path, name: &str, rights: &str) -> Result<String, String> {
    Right::named(rights).ok_or_else(|| format!("\"{rights}\" is not a right: read, write or operate"))?;
    let password = password(name)?;
    if password.chars().count() < SHORTEST {
        return Err(format!("a password has {SHORTEST} characters at least"));
    }
    let mut lines = without(file, name)?;
    lines.push(format!("{name}:{rights}:{}", hash(&password)));
    replace(file, &lines)?;
    Ok(format!("{name} may {rights}; a running gate uses this within five seconds\n"))
}

fn remove(file: &Path, name: &str) -> Result<String, String> {
    let before = lines(file)?.len();
    let lines = without(file, name)?;
    if lines.len() == before {
        return Err(format!("{} has no user \"{name}\"", file.display()));
    }
    replace(file, &lines)?;
    Ok(format!("{name} is removed; a running gate uses this within five seconds\n"))
}

fn list(file: &Path) -> Result<String, String> {
    Users::read(file).map_err(|error| error.to_string())?;
    let lines = lines(file)?;
    let of = |line: &String| line.splitn(3, ':').take(2).collect::<Vec<_>>().join("  ");
    Ok(lines.iter().filter(|line| !line.starts_with('#') && line.contains(':')).map(|line| of(line) + "\n").collect())
}

fn lines(file: &Path) -> Result<Vec<String>, String> {
    match fs::read_to_string(file) {
        Ok(text) => Ok(text.lines().map(str::to_owned).collect()),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(Vec::new()),
        Err(error) => Err(format!("{}: {error}", file.display())),
    }
}

fn without(file: &Path, name: &str) -> Result<Vec<String>, String> {
    let mut lines = lines(file)?;
    lines.retain(|line| line.split(':').next() != Some(name) || line.starts_with('#'));
    Ok(lines)
}

/// Written under another name first: a reader finds either the old file or the new one.
fn replace(file: &Path, lines: &[String]) -> Result<(), String> {
    let new = file.with_extension("new");
    let io = |error: std::io::Error| format!("{}: {error}", new.display());
    let mut text = lines.join("\n");
    text.push('\n');
    let _ = fs::remove_file(&new);
    let mut out = fs::OpenOptions::new().write(true).create_new(true).mode(0o600).open(&new).map_err(io)?;
    out.write_all(text.as_bytes()).and_then(|()| out.sync_all()).map_err(io)?;
    drop(out);
    // A file that the gate would refuse never replaces a valid one.
    if let Err(error) = Users::read(&new) {
        let _ = fs::remove_file(&new);
        return Err(error.to_string());
    }
    fs::rename(&new, file).map_err(|error| format!("{}: {error}", file.display()))
}

/// A line of standard input; a terminal does not show it.
fn password(name: &str) -> Result<String, String> {
    let input = std::io::stdin();
    let shown = tcgetattr(&input).ok();
    if let Some(shown) = &shown {
        let _ = std::io::stderr().write_all(format!("password of {name}: ").as_bytes());
        let mut hidden = shown.clone();
        hidden.local_modes.remove(LocalModes::ECHO);
        let _ = tcsetattr(&input, OptionalActions::Flush, &hidden);
    }
    let mut line = String::new();
    let read = input.lock().read_line(&mut line);
    if let Some(shown) = &shown {
        let _ = tcsetattr(&input, OptionalActions::Flush, shown);
        let _ = std::io::stderr().write_all(b"\n");
    }
    read.map_err(|error| error.to_string())?;
    Ok(line.trim_end_matches(['\r', '\n']).to_owned())
}

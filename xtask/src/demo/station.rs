//! One running station: the process, access through `ob1 get` and `ob1 set`, its report.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::failure::{Outcome, step};
use crate::shell;

/// A process `ob1 run`, which is ended when this is dropped.
pub(super) struct Station {
    name: &'static str,
    child: Child,
    file: PathBuf,
    folder: PathBuf,
    ob1: PathBuf,
}

impl Station {
    /// Starts it in `folder`. It ends by itself after `at_most`.
    pub(super) fn start(
        name: &'static str,
        folder: &Path,
        file: &str,
        binaries: &Path,
        at_most: Duration,
    ) -> Outcome<Self> {
        let ob1 = binaries.join("ob1");
        let log = folder.join(file).with_extension("log");
        let output = File::create(&log).map_err(|why| step(format!("{}: {why}", log.display())))?;
        let errors = output.try_clone().map_err(|why| step(format!("{}: {why}", log.display())))?;
        let mut command = Command::new(&ob1);
        command
            .args(["run", file, "--for", &format!("{}s", at_most.as_secs())])
            .arg("--report")
            .arg(folder.join(file).with_extension("json"))
            .current_dir(folder)
            .env("OB1_PLUGIN_DIR", binaries)
            .env("OB1_BIN_DIR", binaries)
            .stdin(Stdio::null())
            .stdout(output)
            .stderr(errors);
        eprintln!("$ {}", shell::line(&command));
        let child = command.spawn().map_err(|why| step(format!("cannot start {}: {why}", ob1.display())))?;
        Ok(Self { name, child, file: folder.join(file), folder: folder.to_owned(), ob1 })
    }

    /// # Errors
    /// If the process has ended unexpectedly.
    pub(super) fn is_alive(&mut self) -> Outcome {
        match self.child.try_wait() {
            Ok(None) => Ok(()),
            Ok(Some(status)) => {
                Err(step(format!("station {} has ended by itself ({status})\n{}", self.name, self.log())))
            }
            Err(why) => Err(step(format!("station {}: {why}", self.name))),
        }
    }

    /// The values of these operands, as signed integers of their width.
    pub(super) fn ledger<const N: usize>(&self, operands: &[&str; N]) -> Outcome<[i64; N]> {
        let mut get = self.ask("get");
        get.arg("--json").args(operands).stderr(Stdio::null());
        let output = get.output().map_err(|why| step(format!("ob1 get: {why}")))?;
        let answer: Value = serde_json::from_slice(&output.stdout)
            .map_err(|why| step(format!("station {}: `ob1 get --json` answers no JSON: {why}", self.name)))?;
        let mut values = [0; N];
        for (value, operand) in values.iter_mut().zip(operands) {
            *value = value_of(&answer, operand)
                .ok_or_else(|| step(format!("station {}: `ob1 get --json` names no value of {operand}", self.name)))?;
        }
        Ok(values)
    }

    /// Writes a cell with `ob1 set`, as NAME=VALUE.
    pub(super) fn set(&self, assignment: &str) -> Outcome {
        shell::read(self.ask("set").arg(assignment)).map(|_| ())
    }

    fn ask(&self, verb: &str) -> Command {
        let mut command = Command::new(&self.ob1);
        command.arg(verb).arg(&self.file).current_dir(&self.folder);
        command
    }

    /// Sends the signal of Ctrl-C, waits for the end and returns the report.
    pub(super) fn stop(&mut self, patience: Duration) -> Outcome<Value> {
        self.is_alive()?;
        // The `kill` of the shell: it exists on every system and needs no unsafe code here.
        shell::read(Command::new("sh").args(["-c", "kill -INT \"$0\"", &self.child.id().to_string()]))?;
        let start = Instant::now();
        let status = loop {
            match self.child.try_wait().map_err(|why| step(format!("station {}: {why}", self.name)))? {
                Some(status) => break status,
                None if start.elapsed() > patience => {
                    return Err(step(format!("station {} does not stop\n{}", self.name, self.log())));
                }
                None => sleep(Duration::from_millis(20)),
            }
        };
        if !status.success() {
            return Err(step(format!("station {} ended badly ({status})\n{}", self.name, self.log())));
        }
        let path = self.file.with_extension("json");
        let text = fs::read_to_string(&path).map_err(|why| step(format!("{}: {why}", path.display())))?;
        serde_json::from_str(&text).map_err(|why| step(format!("{}: {why}", path.display())))
    }

    /// The last lines it wrote.
    pub(super) fn log(&self) -> String {
        let text = fs::read_to_string(self.file.with_extension("log")).unwrap_or_default();
        let lines: Vec<&str> = text.lines().collect();
        let tail = &lines[lines.len().saturating_sub(15)..];
        tail.iter().map(|line| format!("    {}: {line}\n", self.name)).collect()
    }
}

impl Drop for Station {
    fn drop(&mut self) {
        // After a clean stop both fail because the process does not exist; its drivers end with it.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The value of an operand in the answer: an object by operand, or a list of objects that name it; both may be under
/// `values`.
fn value_of(answer: &Value, operand: &str) -> Option<i64> {
    if let Some(inner) = answer.get("values") {
        return value_of(inner, operand);
    }
    match answer {
        Value::Object(fields) => {
            let is_it = |text: &str| text.eq_ignore_ascii_case(operand);
            let by_key =
                fields.iter().find(|(key, _)| is_it(key)).map(|(_, value)| value.get("value").unwrap_or(value));
            let names_it = fields.values().any(|value| value.as_str().is_some_and(is_it));
            let value = by_key.or_else(|| if names_it { fields.get("value") } else { None })?;
            signed(value, operand)
        }
        Value::Array(items) => items.iter().find_map(|item| value_of(item, operand)),
        _ => None,
    }
}

/// A number as a signed value of the operand's width: DBW 0xFFFF is -1.
fn signed(value: &Value, operand: &str) -> Option<i64> {
    let number = match value {
        Value::Bool(bit) => i64::from(*bit),
        Value::String(text) => match text.rsplit_once("16#") {
            Some((_, hex)) => i64::from_str_radix(&hex.replace('_', ""), 16).ok()?,
            None => text.trim_start_matches("L#").parse().ok()?,
        },
        number => number.as_i64()?,
    };
    Some(match operand.as_bytes().iter().rev().find(|byte| byte.is_ascii_alphabetic())?.to_ascii_uppercase() {
        b'D' => i64::from(number as u32 as i32),
        b'W' => i64::from(number as u16 as i16),
        _ => number,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn an_answer_is_read_in_either_form() {
        let by_name = json!({"DB20.DBD0": 7, "DB20.DBW58": "W#16#FFFF", "M1.0": true});
        assert_eq!(value_of(&by_name, "DB20.DBD0"), Some(7));
        assert_eq!(value_of(&by_name, "DB20.DBW58"), Some(-1));
        assert_eq!(value_of(&by_name, "M1.0"), Some(1));
        assert_eq!(value_of(&by_name, "M1.1"), None);
        let list = json!([{"operand": "DB20.DBD0", "value": 4294967295u32}, {"operand": "MW2", "value": 3}]);
        assert_eq!(value_of(&list, "db20.dbd0"), Some(-1));
        assert_eq!(value_of(&json!({"values": list}), "MW2"), Some(3));
    }
}

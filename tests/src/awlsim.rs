//! awlsim as a black box: its command `awlsim-test` runs a program and prints the memory of its CPU.
//!
//! awlsim is GPL, so it is only run as a separate program: this module is based only on its `--help`, its README and
//! its output. `cargo xtask` installs it into the checkout (`tests/peers/requirements.txt`).
//!
//! It prints its registers and the first 64 bytes of each area when a fault stops it. So a program writes its results
//! there and then causes a fault: [`STOP`].

use std::error::Error;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// The reason why it could not be run, or its output instead of results.
pub type Failure = Box<dyn Error>;

/// Number of bytes it prints of each area.
pub const SHOWN: usize = 64;

/// STL that causes a fault: data block 4711 does not exist in any engine. It overwrites MW 2046.
pub const STOP: &str = "L 4711;\nT MW 2046;\nAUF DB [MW 2046];\n";

/// The memory of the CPU when the fault stopped it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shown {
    /// From MB 0 on.
    pub memory: [u8; SHOWN],
    /// From EB 0 on.
    pub inputs: [u8; SHOWN],
    /// From AB 0 on.
    pub outputs: [u8; SHOWN],
}

impl Shown {
    /// The three areas one after the other: bit memory, inputs, outputs.
    #[must_use]
    pub fn bytes(&self) -> Vec<u8> {
        [self.memory, self.inputs, self.outputs].concat()
    }
}

/// The command, in the folder of the interpreter of the partners (`OB1_PYTHON`).
#[derive(Clone, Debug)]
pub struct Awlsim {
    command: PathBuf,
}

impl Awlsim {
    /// # Errors
    /// If `cargo xtask` has not started this program, or awlsim is not installed.
    pub fn find() -> Result<Self, Failure> {
        let python = std::env::var_os("OB1_PYTHON").ok_or("OB1_PYTHON is not set; start this with cargo xtask")?;
        let command = Path::new(&python).with_file_name("awlsim-test");
        if !command.is_file() {
            return Err(format!("{}: not there; start this with cargo xtask", command.display()).into());
        }
        Ok(Self { command })
    }

    fn command(&self, options: &[&str], source: &Path) -> Command {
        let mut command = Command::new(&self.command);
        // A cycle limit much longer than any program here: it ends a hanging program, but tolerates a busy machine.
        command.args(["--mnemonics", "de", "--cycle-limit", "60"]).args(options);
        command.arg(source).stdin(Stdio::null());
        command
    }

    /// Runs a program that ends in [`STOP`].
    ///
    /// # Errors
    /// If it ends in any other way; the text is the output of awlsim.
    pub fn run(&self, source: &Path, accumulators: u8) -> Result<Shown, Failure> {
        let accumulators = if accumulators == 4 { "--fouraccu" } else { "--twoaccu" };
        let output = self.command(&[accumulators, "--no-cpu-dump", "--loglevel", "1"], source).output()?;
        let text = String::from_utf8_lossy(&output.stderr);
        if !text.contains("AUF DB [ MW 2046 ]") {
            return Err(format!("awlsim on {}:\n{text}", source.display()).into());
        }
        parse(&text).ok_or_else(|| format!("awlsim shows its memory in another form:\n{text}").into())
    }

    /// Runs a program repeatedly for `seconds`; returns the highest reported speed in statements per second, and the
    /// number of statements in one OB 1.
    ///
    /// # Errors
    /// If it cannot be run or reports no speed.
    pub fn speed(&self, source: &Path, seconds: u32) -> Result<Speed, Failure> {
        let output = self.command(&["--max-runtime", &seconds.to_string()], source).output()?;
        let text = String::from_utf8_lossy(&output.stdout);
        let speeds = text.lines().filter_map(speed);
        let best = speeds.max_by(|a, b| a.per_second.total_cmp(&b.per_second));
        best.ok_or_else(|| format!("awlsim reports no speed:\n{}", String::from_utf8_lossy(&output.stderr)).into())
    }
}

/// The speed that awlsim reports.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Speed {
    /// Statements a second.
    pub per_second: f64,
    /// Statements in one OB 1.
    pub per_cycle: f64,
}

/// `  Speed:  1.36 M stmt/s (= 0.737 us/stmt)  26652.0 stmt/cycle`
fn speed(line: &str) -> Option<Speed> {
    let words: Vec<&str> = line.trim_start().strip_prefix("Speed:")?.split_whitespace().collect();
    let unit = match *words.get(1)? {
        "M" => 1e6,
        "k" => 1e3,
        _ => 1.0,
    };
    let at = words.iter().position(|word| *word == "stmt/cycle")?;
    let per_cycle = words.get(at.checked_sub(1)?)?.parse().ok()?;
    Some(Speed { per_second: words.first()?.parse::<f64>().ok()? * unit, per_cycle })
}

/// The memory in the last state that awlsim prints: four lines of 16 bytes after `M:`, `E:` and `A:`.
fn parse(text: &str) -> Option<Shown> {
    let lines: Vec<&str> = text.lines().collect();
    let area = |name: &str| {
        let first = lines.iter().rposition(|line| line.trim_start().starts_with(name))?;
        let mut bytes = Vec::new();
        for line in lines.get(first..first + SHOWN / 16)? {
            let row = line.trim_start().strip_prefix(name).unwrap_or(line);
            bytes.extend(row.split_whitespace().map_while(|word| u8::from_str_radix(word, 16).ok()));
        }
        bytes.try_into().ok()
    };
    Some(Shown { memory: area("M:")?, inputs: area("E:")?, outputs: area("A:")? })
}

/// A folder for the sources of one run, removed when dropped.
#[derive(Debug)]
pub struct Scratch(PathBuf);

impl Scratch {
    /// Creates a folder for temporary files.
    ///
    /// # Errors
    /// If it cannot be created.
    pub fn new(name: &str) -> Result<Self, Failure> {
        let path = std::env::temp_dir().join(format!("ob1-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path)?;
        Ok(Self(path))
    }

    /// Writes a file in it.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, name: impl AsRef<OsStr>, text: &str) -> Result<PathBuf, Failure> {
        let path = self.path(name);
        std::fs::write(&path, text)?;
        Ok(path)
    }

    /// A path in it.
    pub fn path(&self, name: impl AsRef<OsStr>) -> PathBuf {
        self.0.join(Path::new(name.as_ref()))
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // A failure does not matter: the system removes temporary files.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn its_picture_is_read() {
        let row = |first: u8| (first..first + 16).map(|b| format!("{b:02X}")).collect::<Vec<_>>().join(" ");
        let area = |name: &str, first: u8| {
            let rows =
                [row(first), row(first + 16), row(first + 32), row(first + 48)].map(|row| format!("      {row}\n"));
            format!("   {name}{}", rows.concat())
        };
        let text = format!("  STW: ..\n{}{}{} PStack:\n", area("M:", 0), area("E:", 64), area("A:", 128));
        let shown = parse(&text).expect("three areas");
        assert_eq!(shown.bytes(), (0..192).collect::<Vec<u8>>());
        assert_eq!(parse("  M:  00 01"), None);
    }

    #[test]
    fn its_speed_is_read() {
        let line = "  Speed:  532.15 k stmt/s (= 1.879 us/stmt)  4.0 stmt/cycle    |";
        assert_eq!(speed(line), Some(Speed { per_second: 532_150.0, per_cycle: 4.0 }));
        assert_eq!(speed("  Speed:  -/- stmt/s (= -/- us/stmt)  0.0 stmt/cycle"), None);
        assert_eq!(speed("  OB1: avg"), None);
    }
}

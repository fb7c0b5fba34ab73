//! awlsim as a black box: its command `awlsim-test` runs a program and prints what its CPU holds.
//!
//! awlsim is GPL, so it is run as a program and nothing else: what is known of it here is its `--help`, its README
//! and what it prints. `cargo xtask` installs it into the checkout (`tests/peers/requirements.txt`).
//!
//! It prints its registers and the first 64 bytes of each area when a fault stops it. So a program shows its results
//! there and then faults on purpose: [`stop`].

use std::error::Error;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Why it could not be run, or what it printed instead of results.
pub type Failure = Box<dyn Error>;

/// Bytes of each area that it shows.
pub const SHOWN: usize = 64;

/// STL that faults: no engine has data block 4711. MW 2046 is used up for its number.
pub const STOP: &str = "L 4711;\nT MW 2046;\nAUF DB [MW 2046];\n";

/// What the CPU held when the fault stopped it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shown {
    /// MB 0 and on.
    pub memory: [u8; SHOWN],
    /// EB 0 and on.
    pub inputs: [u8; SHOWN],
    /// AB 0 and on.
    pub outputs: [u8; SHOWN],
}

impl Shown {
    /// The three areas one behind the other: bit memory, inputs, outputs.
    #[must_use]
    pub fn bytes(&self) -> Vec<u8> {
        [self.memory, self.inputs, self.outputs].concat()
    }
}

/// The command, found beside the interpreter of the partners (`OB1_PYTHON`).
#[derive(Clone, Debug)]
pub struct Awlsim {
    command: PathBuf,
}

impl Awlsim {
    /// # Errors
    /// When `cargo xtask` has not started this program, or awlsim is not installed.
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
        // A cycle limit far beyond any program here: a hang is ended, a busy machine is not.
        command.args(["--mnemonics", "de", "--cycle-limit", "60"]).args(options);
        command.arg(source).stdin(Stdio::null());
        command
    }

    /// Runs a program that ends in [`STOP`].
    ///
    /// # Errors
    /// When it ends in any other way; the text is what awlsim said.
    pub fn run(&self, source: &Path, accumulators: u8) -> Result<Shown, Failure> {
        let accumulators = if accumulators == 4 { "--fouraccu" } else { "--twoaccu" };
        let output = self.command(&[accumulators, "--no-cpu-dump", "--loglevel", "1"], source).output()?;
        let text = String::from_utf8_lossy(&output.stderr);
        if !text.contains("AUF DB [ MW 2046 ]") {
            return Err(format!("awlsim on {}:\n{text}", source.display()).into());
        }
        parse(&text).ok_or_else(|| format!("awlsim shows its memory in another form:\n{text}").into())
    }

    /// Runs a program again and again for `seconds`; the highest speed it reports, in statements a second, and how many
    /// statements it counts in one OB 1.
    ///
    /// # Errors
    /// When it cannot be run or reports no speed.
    pub fn speed(&self, source: &Path, seconds: u32) -> Result<Speed, Failure> {
        let output = self.command(&["--max-runtime", &seconds.to_string()], source).output()?;
        let text = String::from_utf8_lossy(&output.stdout);
        let speeds = text.lines().filter_map(speed);
        let best = speeds.max_by(|a, b| a.per_second.total_cmp(&b.per_second));
        best.ok_or_else(|| format!("awlsim reports no speed:\n{}", String::from_utf8_lossy(&output.stderr)).into())
    }
}

/// What awlsim says of its speed.
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

/// The memory in awlsim's last picture of itself: four lines of 16 bytes after `M:`, `E:` and `A:`.
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

/// A folder for one run's sources; gone with it.
#[derive(Debug)]
pub struct Scratch(PathBuf);

impl Scratch {
    /// A new folder among the system's temporary files.
    ///
    /// # Errors
    /// When it cannot be made.
    pub fn new(name: &str) -> Result<Self, Failure> {
        let path = std::env::temp_dir().join(format!("ob1-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path)?;
        Ok(Self(path))
    }

    /// Writes a file there.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(&self, name: impl AsRef<OsStr>, text: &str) -> Result<PathBuf, Failure> {
        let path = self.path(name);
        std::fs::write(&path, text)?;
        Ok(path)
    }

    /// A path there.
    pub fn path(&self, name: impl AsRef<OsStr>) -> PathBuf {
        self.0.join(Path::new(name.as_ref()))
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // What cannot be removed is left to the system.
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

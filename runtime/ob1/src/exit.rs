//! Exit codes of the command: one table, printed by `ob1 --help`.

use std::fmt::Display;

pub use ob1_station::exit::Exit;

/// What a command ends with; it tells first what it has failed of.
pub(crate) fn told<T, E: Display>(outcome: Result<T, E>, failed: impl FnOnce(&E) -> T) -> T {
    outcome.unwrap_or_else(|error| {
        err!("ob1: {error}");
        failed(&error)
    })
}

/// The table as `ob1 --help` prints it.
pub const TABLE: &str = "\
Exit codes:
  0  all is well
  1  wrong command line, or `check` has found an error
  2  station file, source or program rejected
  3  the CPU went to STOP because of a fault
  4  a plugin is missing, damaged or built for another interface
  5  the station runs already (run), or does not run (get, set, ctl, diag, status, top, trace,
     bus watch)
  6  the operating system refused what the station needs
  7  a native block did not return; outputs are off
  8  the running station refused a request, or did not answer
  12  the station stood still for too long; its guardian has set the outputs to their safe state
  13  a plugin has called exit(); outputs are off
  14  the runtime has crashed, in a block in C or a library; outputs are off
  exec has codes of its own: 0 stopped by SFC 46, 3 limit reached, 10 rejected, 11 CPU fault,
  15 a replay has other values.
  test: 0 passed, 1 a test failed, 2 a test file or program cannot be used.
  driver test: 0 all rules kept, 1 a rule broken, 2 the driver cannot be started.
  import, upload: 0 the whole program came over, 1 blocks were left out or the station does not start
  yet, 2 nothing could be read or written.
  load: 0 loaded, or with --check a difference; 1 nothing to load.
  download: 0 everything was loaded, 1 blocks were refused, 2 nothing could be loaded.
  compare, diff: 0 the same program, 1 another one, 2 one of them cannot be read.
  shadow: 0 equal, 1 differences, 2 nothing could be compared.
  soak: 0 pass (compare: not worse), 1 a budget is broken (compare: worse), 2 inconclusive, or it could not be measured.
  With --fence-scan a forbidden system call ends the process by SIGSYS (shells show 159).";

/// How `ob1 exec` ends: a contract with scripts and conformance suites.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExecExit {
    /// The program stopped the CPU itself.
    Stopped,
    /// The limit was reached.
    Limit,
    /// A source or symbol table was rejected.
    Rejected,
    /// A fault stopped the CPU.
    Fault,
    /// A value of a replay is another one than was recorded.
    Differs,
    /// What any command can end with: a wrong command line, a file that cannot be written.
    Other(Exit),
}

impl ExecExit {
    /// The code of the process.
    pub const fn code(self) -> u8 {
        match self {
            ExecExit::Stopped => 0,
            ExecExit::Limit => 3,
            ExecExit::Rejected => 10,
            ExecExit::Fault => 11,
            ExecExit::Differs => 15,
            ExecExit::Other(exit) => exit as u8,
        }
    }

    /// The end in a word, for `--stats`.
    pub const fn name(self) -> &'static str {
        match self {
            ExecExit::Stopped => "stopped",
            ExecExit::Limit => "limit",
            ExecExit::Rejected => "rejected",
            ExecExit::Fault => "fault",
            ExecExit::Differs => "differs",
            ExecExit::Other(_) => "other",
        }
    }
}

impl From<ExecExit> for std::process::ExitCode {
    fn from(exit: ExecExit) -> Self {
        Self::from(exit.code())
    }
}

/// How `ob1 test` ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum TestExit {
    /// All tests have passed.
    Passed = 0,
    /// At least one test failed.
    Failed = 1,
    /// A test file or program cannot be used, or there is no test.
    Unusable = 2,
}

/// How `ob1 import` ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum ImportExit {
    /// The whole program was imported.
    Whole = 0,
    /// Blocks were left out, or the station does not start yet.
    Incomplete = 1,
    /// Nothing could be read, or nothing could be written.
    Nothing = 2,
}

/// How `ob1 diff` and `ob1 compare` end: as `diff` does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum DiffExit {
    /// Both are the same program.
    Same = 0,
    /// They are different programs.
    Other = 1,
    /// One of them cannot be read.
    Nothing = 2,
}

/// How `ob1 soak` ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum SoakExit {
    /// Every budget was kept; of two runs, the second is not worse.
    Pass = 0,
    /// A budget was broken; of two runs, the second is worse.
    Broken = 1,
    /// Too little has been seen to tell, or nothing could be measured.
    Inconclusive = 2,
}

macro_rules! number_is_code {
    ($($exit:ty),*) => {$(
        impl From<$exit> for std::process::ExitCode {
            fn from(exit: $exit) -> Self {
                Self::from(exit as u8)
            }
        }
    )*};
}
number_is_code!(TestExit, ImportExit, DiffExit, SoakExit);

#[cfg(test)]
mod tests {
    use super::*;

    /// The commands whose codes mean something else.
    #[test]
    fn the_table_has_every_command_with_codes_of_its_own() {
        for command in ["exec", "test", "import", "upload", "load", "download", "compare", "diff", "soak"] {
            let mut heads = TABLE.lines().filter_map(|line| Some(line.split_once(" 0 ")?.0));
            assert!(heads.any(|head| head.contains(command)), "{command}");
        }
    }

    #[test]
    fn the_table_has_every_code() {
        let all = [
            Exit::Ok,
            Exit::Usage,
            Exit::Rejected,
            Exit::Fault,
            Exit::Plugin,
            Exit::Running,
            Exit::System,
            Exit::Hung,
            Exit::Refused,
            Exit::StoodStill,
            Exit::EndedByPlugin,
            Exit::Crashed,
        ];
        for exit in all {
            let number = exit as usize;
            assert!(TABLE.contains(&format!("\n  {number}  ")), "code {number} is not in the table");
        }
    }
}

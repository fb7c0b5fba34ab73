//! How a running station ends, as an exit code. The table `ob1 --help` prints is in the command.

/// How a command ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Exit {
    /// The command did what was asked.
    Ok = 0,
    /// The command line is wrong, or `check` has found an error.
    Usage = 1,
    /// The station file, a source or the program was rejected.
    Rejected = 2,
    /// The CPU went to STOP because of a fault.
    Fault = 3,
    /// A plugin is missing, damaged or built for another interface.
    Plugin = 4,
    /// The station runs already, or does not run.
    Running = 5,
    /// The operating system refused something the station cannot do without.
    System = 6,
    /// A native block did not return; outputs were switched off.
    Hung = 7,
    /// A running station has refused a request, or has not answered.
    Refused = 8,
    /// The station stood still; its guardian has set the outputs to their safe state.
    StoodStill = 12,
    /// A plugin has ended the process by `exit()`; outputs were switched off.
    EndedByPlugin = 13,
    /// The process has crashed: a block in C, or a library; outputs were switched off.
    Crashed = 14,
}

impl From<Exit> for std::process::ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit as u8)
    }
}

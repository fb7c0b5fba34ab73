//! The operating states of a CPU, and what an operator can ask for.

named! {
    /// Operating states of a CPU.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    pub enum OperatingState {
        /// The program does not run, outputs are 0. Links and modules are served.
        #[default]
        Stop = "STOP",
        /// OB 100 (warm), OB 101 (hot) or OB 102 (cold) runs.
        Startup = "STARTUP",
        /// The program runs: cycle after cycle.
        Run = "RUN",
        /// The program stands still at a breakpoint, and its time with it; outputs are in their safe state. Links
        /// are served.
        Hold = "HOLD",
    }
}

impl OperatingState {
    /// As a number: 0 STOP, 1 STARTUP, 2 RUN, 3 HOLD.
    pub const fn number(self) -> u8 {
        self as u8
    }

    /// The state with that number; any other is RUN.
    pub const fn of(number: u64) -> Self {
        match number {
            0 => Self::Stop,
            1 => Self::Startup,
            3 => Self::Hold,
            _ => Self::Run,
        }
    }
}

named! {
    /// What an operator can ask for, named by the word on a command line, on the socket of a station and in the web
    /// page's requests.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Command {
        /// STOP to RUN, by a warm restart. Nothing happens in RUN.
        Run = "run",
        /// To STOP, from any state.
        Stop = "stop",
        /// Warm restart: what is retentive keeps its value, by default all data blocks; process images and the rest of
        /// bit memory, timers and counters are cleared, other data blocks get their load values.
        Warm = "warm",
        /// Warm restart that keeps the values of all data blocks, whatever is retentive.
        Keep = "keep",
        /// Cold restart: nothing is kept. Data blocks get their load values, those made by the program are deleted.
        Cold = "cold",
        /// Hot restart, S7-400 only: everything keeps its value, OB 101 runs, and a new cycle begins; what was left of
        /// the interrupted one is not run. Refused, with an entry in the diagnostic buffer, on an S7-300 and where no
        /// RUN came before.
        Hot = "hot",
        /// Memory reset: STOP, everything as after loading, the diagnostic buffer stays.
        Reset = "reset",
    }
}

impl Command {
    /// The command with that word.
    pub fn of_word(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|command| command.name() == word)
    }
}

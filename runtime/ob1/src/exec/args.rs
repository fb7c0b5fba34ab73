//! The words of `ob1 exec`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::dump::Dump;
use crate::language::Language;
use ob1_station_file::EngineChoice;
use ob1_station_file::library::{Choice, Chosen};
use ob1_time::Span;

/// Run bare sources without a station file: the start OB once, then OB 1 cyclically
///
/// There are no modules: peripheral reads answer from the process image of the inputs, peripheral writes land in that
/// of the outputs. Time is virtual unless --real-time is given: each statement takes --ns-per-statement, each cycle at
/// least --min-cycle, and nothing waits, so the same sources give the same result on any machine.
#[derive(Clone, Debug, Args)]
#[command(after_help = "Examples:\n  ob1 exec press.awl --symbols press.sdf --limit 10s --dump M:0:100:m.bin\n  \
    ob1 exec main.awl lib.awl --mnemonics en --stats run.json\n  ob1 exec press.awl --replay fault.ob1trace\n\n\
    Exit codes:\n  0   the program stopped the CPU itself (SFC 46)\n  3   the limit was reached\n  10  a source or symbol table was \
    rejected\n  11  a fault stopped the CPU: the diagnostic entries are on stderr, newest first\n  1   wrong command line\n  \
    6   a file cannot be written\n  15  --replay: a value differs from the recorded one\nDumps and figures are written with exit codes 0, 3 and 11. docs/exec.md")]
pub struct ExecArgs {
    /// Sources and symbol tables, or folders of them
    #[arg(required = true, value_name = "PROG.awl")]
    pub files: Vec<PathBuf>,
    /// A symbol table: SDF, ASC, SEQ or DIF; may be given several times
    #[arg(long, value_name = "FILE")]
    pub symbols: Vec<PathBuf>,
    /// Mnemonics of the sources; auto: found for each by the words that exist in one set only
    #[arg(long, value_enum, default_value_t = Language::Auto)]
    pub mnemonics: Language,
    /// Accumulators: 2 (S7-300) or 4 (S7-400)
    #[arg(long, value_name = "2|4", default_value_t = 2, value_parser = accumulators)]
    pub accumulators: u8,
    /// The byte of bit memory with the clock pulses
    #[arg(long, value_name = "BYTE")]
    pub clock_memory: Option<u16>,
    /// Standard blocks by number; a library's name alone (IEC) takes all its blocks with STEP 7's numbers
    #[arg(long, value_name = "FC4=IEC:FC4,...", value_delimiter = ',', value_parser = Chosen::parse)]
    pub library: Vec<Chosen>,
    /// Keep the numbers of blocks that have a name only in this file
    #[arg(long, value_name = "FILE")]
    pub numbers: Option<PathBuf>,
    /// Show every message of the sources, not 20 of a file and 100 in all
    #[arg(long)]
    pub all_messages: bool,
    /// Start information in the first 20 bytes of an organization block's local data
    #[arg(long, value_enum, default_value_t = Switch::On)]
    pub ob_start_info: Switch,
    /// Bytes of the process image of the inputs
    #[arg(long, value_name = "N", default_value_t = 2048, value_parser = clap::value_parser!(u32).range(0..=8192))]
    pub inputs: u32,
    /// Bytes of the process image of the outputs
    #[arg(long, value_name = "N", default_value_t = 2048, value_parser = clap::value_parser!(u32).range(0..=8192))]
    pub outputs: u32,
    /// Bytes of bit memory
    #[arg(long, value_name = "N", default_value_t = 2048, value_parser = clap::value_parser!(u32).range(0..=65_536))]
    pub bit_memory: u32,
    /// End after this time; where time is virtual, also after 120 s of real time
    #[arg(long, value_name = "TIME", default_value = "60s", value_parser = ob1_station_file::parse_duration)]
    pub limit: Span,
    /// The engine: auto, native, reference, both (the one checked against the other), or plain (reference without its
    /// short forms)
    #[arg(long, value_name = "NAME", default_value = "auto", value_parser = EngineChoice::parse)]
    pub engine: EngineChoice,
    /// Time is virtual (this is the default)
    #[arg(long, conflicts_with = "real_time")]
    pub virtual_time: bool,
    /// Time is that of the machine
    #[arg(long)]
    pub real_time: bool,
    /// Virtual time a statement takes
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u64).range(0..=1_000_000_000))]
    pub ns_per_statement: u64,
    /// Minimum cycle time
    #[arg(long, value_name = "TIME", default_value = "1ms", value_parser = ob1_station_file::parse_duration)]
    pub min_cycle: Span,
    /// Cycle monitoring time; 0ms: none
    #[arg(long, value_name = "TIME", default_value = "150ms", value_parser = ob1_station_file::parse_duration)]
    pub watchdog: Span,
    /// The kind of start: OB 102, OB 100, OB 101
    #[arg(long, value_enum, default_value_t = Start::Warm)]
    pub start: Start,
    /// Write bytes of bit memory (M) or of a data block (DB5) to a file at the end
    #[arg(long, value_name = "M:FROM:LEN:FILE", value_parser = Dump::parse)]
    pub dump: Vec<Dump>,
    /// Write the figures of the run there as JSON
    #[arg(long, value_name = "FILE.json")]
    pub stats: Option<PathBuf>,
    /// Replay this recording: its inputs come again at their scans, and every other signal is compared (docs/record.md)
    #[arg(long, value_name = "FILE.ob1trace", conflicts_with_all = ["real_time", "dump", "stats", "limit", "min_cycle"])]
    pub replay: Option<PathBuf>,
    /// Signals of the recording that others than the program have written: they are set, not compared
    #[arg(long, value_name = "NAMES", value_delimiter = ',', requires = "replay")]
    pub drive: Vec<String>,
    /// Print no warnings of the sources; errors, faults and the line about the limit are still printed
    #[arg(long, short)]
    pub quiet: bool,
}

/// Whether something of the CPU is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Switch {
    /// It is there
    On,
    /// It is not
    Off,
}

/// How the CPU starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Start {
    /// OB 102, or OB 100 without one
    Cold,
    /// OB 100
    Warm,
    /// OB 101; memory counts as that of a RUN before, and the CPU as an S7-400
    Hot,
}

fn accumulators(text: &str) -> Result<u8, String> {
    match text {
        "2" => Ok(2),
        "4" => Ok(4),
        _ => Err("a CPU has 2 or 4 accumulators".into()),
    }
}

impl ExecArgs {
    /// As given on a command line, without `ob1 exec`.
    #[cfg(test)]
    pub(super) fn of_words(words: Vec<&str>) -> Self {
        use clap::{Command, FromArgMatches as _};
        let matches = Self::augment_args(Command::new("exec").no_binary_name(true)).get_matches_from(words);
        Self::from_arg_matches(&matches).expect("the words of a test are right")
    }

    /// The standard blocks of all `--library`.
    pub(super) fn standard(&self) -> Result<Vec<Choice>, String> {
        Chosen::together(&self.library).map_err(|clash| format!("--library: {clash}"))
    }

    /// What the words mean together.
    pub(super) fn check(&self) -> Result<(), String> {
        if let Some(byte) = self.clock_memory.filter(|byte| u32::from(*byte) >= self.bit_memory) {
            return Err(format!("--clock-memory {byte} is outside the {} bytes of bit memory", self.bit_memory));
        }
        Ok(())
    }
}

//! The command line: words, help, and what they lead to.

use std::io::IsTerminal as _;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use clap::builder::PossibleValue;
use clap::{Args, Parser, Subcommand, ValueEnum};

use crate::bus::{self, BusArgs};
use crate::exec::{self, ExecArgs};
use crate::exit::{self, Exit};
use crate::import::{self, CompareArgs, DownloadArgs, ImportArgs, UploadArgs};
use crate::new::{self, NewArgs};
use crate::testing::{self, TestArgs};
use crate::xref::{self, XrefArgs};
use crate::{check, diag, remote, soak, top, trace};
use ob1_model::Command as Operating;
use ob1_station::library::Chosen;
use ob1_station::{compiling, guardian, janitor, out, run, station_file};
use ob1_time::Span;

const AFTER: &str = "\
Examples:
  ob1 new station press                            a station that runs, to begin with
  ob1 run examples/two-stations/station-a.toml     run a station until Ctrl-C
  ob1 run press.toml --for 10s --report run.json   ten seconds, figures as JSON
  ob1 check press.toml                             everything that is wrong with a station
  ob1 exec press.awl --limit 10s                   bare sources in virtual time
  ob1 import plant.zip --out plant                 a station of a STEP 7 project, without its sources
  ob1 test                                         the tests of this folder and below
  ob1 get press.toml M1.0 DB10.DBW20               values from the running station
  ob1 set press.toml M1.0=1 DB10.DBW20=16#1234     new values
  ob1 ctl press.toml stop                          to STOP
  ob1 diag press.toml                              diagnostic buffers of CPU and CPs, with remedies
  ob1 trace press.toml                             every telegram on its lines
  ob1 top press.toml                               live: scans, CPs, telegrams, diagnostic buffer, variables
  ob1 soak press.toml --for 8h --budget wake.p99.9=200us,missed=0   hours of scans, one verdict

Times have a unit: 250us, 10ms, 1.5s, 2min, 8h. Values: 1, -5, true, 16#1A, 2#1010, 1.5.

Environment:
  OB1_LOG          what to log on stderr: error, warn, info (default), debug, trace
  OB1_CP           the driver program, if ob1-cp is neither beside ob1 nor in PATH
  OB1_IO           the program of buses, if ob1-io is neither beside ob1 nor in PATH
  OB1_PLUGIN_DIR   where plugins with a bare name are looked for first
  XDG_RUNTIME_DIR  where the station's directory ob1/NAME is made (else /run, else /tmp)
";

/// A soft PLC: runs STEP 7 style programs cyclically, with communication processors as processes of their own.
#[derive(Debug, Parser)]
#[command(name = "ob1", version, after_help = concat_after(), max_term_width = 110)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

fn concat_after() -> String {
    format!("{AFTER}\n{}", exit::TABLE)
}

#[derive(Debug, Subcommand)]
enum Command {
    Run(RunArgs),
    Check(CheckArgs),
    Bus(BusArgs),
    Exec(Box<ExecArgs>),
    Test(TestArgs),
    Xref(XrefArgs),
    Import(ImportArgs),
    Upload(UploadArgs),
    Download(DownloadArgs),
    Compare(CompareArgs),
    New(NewArgs),
    Get(GetArgs),
    Set(SetArgs),
    Ctl(CtlArgs),
    Diag(DiagArgs),
    Trace(TraceArgs),
    Top(TopArgs),
    Soak(Box<SoakArgs>),
    /// Sets the outputs of a runtime that dies to their safe state, and cleans up after it; started by `run`.
    #[command(hide = true)]
    Janitor {
        /// A runtime that is stopped counts as dead after this long.
        #[arg(long, default_value_t = 1000)]
        stopped_ms: u64,
        /// A runtime that is silent counts as dead after this long.
        #[arg(long, default_value_t = 60_000)]
        silent_ms: u64,
        /// The runtime directory.
        rundir: PathBuf,
        /// Links that drivers publish.
        published: Vec<PathBuf>,
    },
    /// Makes machine code of a program; started by `run` and `exec`.
    #[command(hide = true)]
    CompileBlocks,
}

/// Run a station: load the program, start the drivers, scan until Ctrl-C
///
/// Ctrl-C (or SIGTERM) stops in order: outputs off, drivers ended, runtime directory removed, summary printed. A second
/// Ctrl-C ends at once. A CPU in STOP because of a fault stays there to be looked at (get, diag) unless --for or
/// --scans gives the run an end.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  ob1 run press.toml\n  ob1 run press.toml --scans 10000 --report run.json --quiet\n\n\
    While it runs its directory holds control.sock (docs/access.md), io (the process I/O image,\ndocs/process-io.md) and one \
    MODULE.segment for each CP (docs/backplane.md)."
)]
struct RunArgs {
    /// The station file (docs/station-file.md)
    station: PathBuf,
    /// End after this time: 10s, 8h
    #[arg(long = "for", value_name = "TIME", value_parser = station_file::parse_duration)]
    time: Option<Span>,
    /// End after so many cycles in RUN
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    scans: Option<u64>,
    /// Write the figures of the run there as JSON
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Print warnings and errors only
    #[arg(long, short)]
    quiet: bool,
    /// Kill the process if the scan thread makes any system call but sleep, doorbell, pread64, clock_gettime
    ///
    /// A proof, not a mode of operation: a seccomp filter on the scan thread. A run that ends well has made no other
    /// call.
    #[arg(long)]
    fence_scan: bool,
    /// End with standard input; for a process that has started this one
    #[arg(long, hide = true)]
    lifeline: bool,
    /// Faults on simulated lines, beyond those of the station file; of a soak
    #[arg(long, hide = true, default_value_t = 0)]
    line_faults: u32,
    #[arg(long, hide = true, default_value_t = 0)]
    line_seed: u64,
}

/// Check sources or a station file
///
/// A station file is checked with its program and its plugins. Sources alone are checked without knowing the blocks of
/// a plugin, unless --plugin names it.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  ob1 check station.toml\n  ob1 check station.toml --verbose      both forms of the CPs' parameters\n  \
    ob1 check station.toml --posture      what the system grants the scan (as root it may grant more)\n  \
    ob1 check main.awl lib.awl --plugin ob1_cp240 --json\n  ob1 check plant/ --library TI-S7        a folder of sources and symbol tables\n  ob1 check --plugin ./libmine.so         what a plugin brings\n\n\
    Exit codes: 0 no error, 1 an error was found."
)]
struct CheckArgs {
    /// Sources (.awl) and symbol tables (.sdf), folders of them, or one station file (.toml)
    #[arg(required_unless_present = "plugin")]
    files: Vec<PathBuf>,
    /// A plugin whose blocks the sources call: a path, or a bare name like ob1_cp240
    #[arg(long, value_name = "PATH")]
    plugin: Vec<String>,
    /// A source of library blocks: compiled with the others, its own warnings are not shown
    #[arg(long, value_name = "FILE")]
    library_source: Vec<PathBuf>,
    /// A symbol table of the sources: SDF, ASC, SEQ or DIF (a station file says it itself)
    #[arg(long, value_name = "FILE")]
    symbols: Vec<PathBuf>,
    /// Standard blocks of the sources: FC4=IEC:FC4, or a whole library: IEC
    #[arg(long, alias = "standard", value_name = "FC4=IEC:FC4,...", value_delimiter = ',', value_parser = Chosen::parse)]
    library: Vec<Chosen>,
    /// Keep the numbers of blocks that have a name only in this file (a station keeps them beside its file)
    #[arg(long, value_name = "FILE")]
    numbers: Option<PathBuf>,
    /// Show every message, not 20 of a file and 100 in all
    #[arg(long)]
    all_messages: bool,
    /// Also print the compiled program: blocks, layout of data, statements
    #[arg(long)]
    listing: bool,
    /// With --listing: also the machine code that the native engine makes of each block, and its bytes by statement
    #[arg(long, requires = "listing")]
    native: bool,
    /// Look for the classic porting traps too
    #[arg(long)]
    lints: bool,
    /// Mnemonics of the sources (a station file says it itself)
    #[arg(long, value_enum, default_value_t = Language::Auto)]
    mnemonics: Language,
    /// Findings as a JSON array
    #[arg(long)]
    json: bool,
    /// Ask the system for what the station file wants for its scan, and say what was granted, what was refused, and the
    /// command that would grant it
    #[arg(long, conflicts_with_all = ["plugin", "listing", "lints"])]
    posture: bool,
    /// Also print modules, and the parameters of CPs as keys and as bytes
    #[arg(long, short)]
    verbose: bool,
}

/// The mnemonics of sources.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Language {
    /// German: U, UN, O, E, A, Z
    De,
    /// International: A, AN, O, I, Q, C
    En,
    /// Found for each source by the words that exist in one set only
    Auto,
}

impl From<Language> for station_file::Mnemonics {
    fn from(language: Language) -> Self {
        match language {
            Language::De => Self::German,
            Language::En => Self::International,
            Language::Auto => Self::Auto,
        }
    }
}

/// Read cells of a running station
#[derive(Debug, Args)]
#[command(after_help = "Names: M1.0 MB1 MW10 MD4, E/I and A/Q likewise, PEW256, DB10.DBX0.0 DB10.DBW20, T2, Z3,\n\
    components of data blocks (DB20.DONE) and symbols.\n\nExample:\n  ob1 get station-a.toml M1.0 DB20.DONE --json")]
struct GetArgs {
    /// A running station: its name or its file
    station: String,
    /// Names of cells
    #[arg(required = true)]
    items: Vec<String>,
    /// As a JSON array of {item, type, value, hex}
    #[arg(long)]
    json: bool,
}

/// Write cells of a running station
#[derive(Debug, Args)]
#[command(
    after_help = "Values: 1, 0, true, -5, 16#1A, W#16#1A, L#-5, 2#1010, 1.5.\nInputs are overwritten by the next process image; \
    write them through the process I/O image.\n\nExample:\n  ob1 set station-a.toml M1.0=1 DB10.DBW20=16#1234"
)]
struct SetArgs {
    /// A running station: its name or its file
    station: String,
    /// NAME=VALUE
    #[arg(required = true, value_name = "NAME=VALUE")]
    items: Vec<String>,
}

/// Operate a running station
#[derive(Debug, Args)]
#[command(
    after_help = "Every change from STOP to RUN sends the parameters to all CPs again.\n\nExamples:\n  ob1 ctl press stop\n  ob1 ctl \
    press.toml warm"
)]
struct CtlArgs {
    /// A running station: its name or its file
    station: String,
    /// What to do
    action: Action,
    /// Answers of status, timing and recorder as JSON
    #[arg(long)]
    json: bool,
}

/// Print the diagnostic buffers of a running station
///
/// The buffer of the CPU, and those its CPs have of their own (CP 341): newest entry first, each with its date and
/// time of day (UTC), its time since the start of the runtime, its number, what it means, where (block, line, file) and,
/// in the line below, what helps. The buffer of a CP outlives its driver.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  ob1 diag press.toml\n  ob1 diag press cp --count 5\n  ob1 diag press 272 --json\n\n\
    Exit codes: 0 printed, 1 no such CP, 5 the station does not run, 8 it does not answer.\n\nMore: docs/access.md, docs/cp341-events.md."
)]
struct DiagArgs {
    /// A running station: its name or its file
    station: String,
    /// Only this CP's buffer: its name or its logical address
    cp: Option<String>,
    /// At most so many entries of each buffer
    #[arg(long, short = 'n', value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..))]
    count: u32,
    /// As JSON: {"cpu": [...], "cps": [{name, type, address, driver, entries}]}
    #[arg(long)]
    json: bool,
}

/// Show what goes over the lines of a running station, or of a recording
///
/// Each telegram and each control character with its time (seconds since the driver's start), its direction (> from the
/// CP, < to it), its meaning and its user data. Listening does not slow the CP down: what is not fetched in time is
/// lost, and counted.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  ob1 trace press.toml\n  ob1 trace press.toml scale --raw\n  ob1 trace press --record line.trace --quiet --for 10min\n  \
    ob1 trace --from line.trace\n  ob1 trace --from line.trace --pcapng line.pcapng       Modbus RTU, for Wireshark (docs/trace.md)"
)]
struct TraceArgs {
    /// A running station: its name or its file
    #[arg(required_unless_present = "from", conflicts_with = "from")]
    station: Option<String>,
    /// One of its CPs, or the line of a bus (field.bus); without it all of them
    cp: Option<String>,
    /// Read a recording instead of a running station
    #[arg(long, value_name = "FILE", conflicts_with = "record")]
    from: Option<PathBuf>,
    /// Record into this file
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Write the frames of Modbus RTU into this file
    #[arg(long, value_name = "FILE")]
    pcapng: Option<PathBuf>,
    /// Show the characters as they were on the line instead of the user data
    #[arg(long)]
    raw: bool,
    /// Print nothing
    #[arg(long, short)]
    quiet: bool,
    /// End after this time: 10s, 8h
    #[arg(long = "for", value_name = "TIME", value_parser = station_file::parse_duration)]
    time: Option<Span>,
}

/// Show a running station, live
///
/// Pages for the scan (times, histograms, late scans), the CPs (LEDs, orders, telegrams), the diagnostic buffer, a
/// variable table, in which values can be modified after a confirmation, and the buses. Without a terminal, or with
/// --plain, it prints text. The scan does not notice.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  ob1 top press.toml\n  ob1 top press --watch M1.0,DB10.DBW20:anzw,MW10:hex\n  ob1 top press --plain --count 1 \
    | less\n\nMore: docs/top.md."
)]
struct TopArgs {
    /// A running station: its name or its file
    station: String,
    /// The variable table: NAME, or NAME:hex, NAME:bin, NAME:anzw (the indicator word of a handling block, in words),
    /// NAME:status (STATUS of P_SND_RK and P_RCV_RK, in words)
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    watch: Vec<String>,
    /// Time between two looks
    #[arg(long, value_name = "TIME", default_value = "1s", value_parser = station_file::parse_duration)]
    every: Span,
    /// End after so many looks
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    count: Option<u64>,
    /// Text instead of a screen
    #[arg(long)]
    plain: bool,
}

/// Run a station for hours, and judge its timing
///
/// The station runs as a process of its own. At the end stands a verdict: every limit of the budget kept (exit code 0),
/// one broken (1), or too little seen to tell (2). Ctrl-C ends it early, with the verdict on what has been seen. The
/// reports are written each minute.
#[derive(Debug, Args)]
#[command(
    after_help = "Limits: DISTRIBUTION.p99.9=TIME (p50 p90 p99 p99.9 p99.99 p99.999 max mean; cycle wake deadlines execution inputs\noutputs \
    ob1 ob35 ob35.late fc0 ...), counts (missed overruns watchdog late late.CLASS telegrams.lost telegrams.errors\ntelegrams.aborted \
    telegrams.doubled telegrams.wrong receive.lost receive.errors drivers.lost cell.NAME), unexplained=5%,\nSERIES.slope=AMOUNT/h (rss fds \
    drivers.rss cycle.p99 wake.p50 wake.p99 execution.p50 execution.p99).\n\nExamples:\n  ob1 soak press.toml --for 8h --budget \
    cycle.p99.9=1.2ms,wake.p99.99=200us,missed=0,rss.slope=1MiB/h\n  ob1 soak press.toml --for 10min --load \
    cpu=2,io=1,driver-kill=10/min --seed 7 --budget execution.p99=80us\n\nExit codes: 0 pass, 1 a budget is broken, 2 inconclusive, or it \
    could not be measured. More: docs/soak.md."
)]
struct SoakArgs {
    /// The station file (docs/station-file.md)
    #[arg(required_unless_present = "compare")]
    station: Option<PathBuf>,
    /// How long to measure: 10min, 8h
    #[arg(long = "for", value_name = "TIME", value_parser = station_file::parse_duration, required_unless_present = "compare")]
    time: Option<Span>,
    /// Say whether the second of two reports is worse than the first
    #[arg(long, num_args = 2, value_names = ["A.json", "B.json"], conflicts_with_all = ["station", "time", "budget", "load"])]
    compare: Option<Vec<PathBuf>>,
    /// With --compare: a difference up to this does not count as worse
    #[arg(long, value_name = "PERCENT", default_value_t = 10, requires = "compare")]
    margin: u32,
    /// The limits that have to be kept, separated by commas
    #[arg(long, value_name = "LIMIT,...", value_delimiter = ',')]
    budget: Vec<soak::Budget>,
    /// Time in RUN before the measurement begins [default: a tenth of it, at most 10s]
    #[arg(long, value_name = "TIME", value_parser = station_file::parse_duration)]
    warm_up: Option<Span>,
    /// Cells of the program to follow, such as its own counters
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    cells: Vec<String>,
    /// The cell in which the program counts telegrams that arrived twice
    #[arg(long, value_name = "NAME")]
    doubled: Option<String>,
    /// The cell in which the program counts telegrams that arrived with another content
    #[arg(long, value_name = "NAME")]
    wrong: Option<String>,
    /// The load to put the station under: cpu=2,memory=64MiB,io=1,driver-kill=10/min,line-faults=500
    #[arg(long, value_name = "KIND=AMOUNT,...", default_value = "", hide_default_value = true)]
    load: soak::Load,
    /// The seed of the load
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Where the reports go: BASE.json, BASE.html, BASE.txt, BASE.log [default: STATION-soak-DATE-TIME]
    #[arg(long, value_name = "BASE")]
    report: Option<PathBuf>,
    /// Print the verdict only
    #[arg(long, short)]
    quiet: bool,
}

#[derive(Clone, Copy, Debug)]
enum Action {
    Command(Operating),
    Status,
    Timing,
    Recorder,
}

impl ValueEnum for Action {
    fn value_variants<'a>() -> &'a [Self] {
        const ALL: [Action; 9] = [
            Action::Command(Operating::Run),
            Action::Command(Operating::Stop),
            Action::Command(Operating::Warm),
            Action::Command(Operating::Cold),
            Action::Command(Operating::Hot),
            Action::Command(Operating::Reset),
            Action::Status,
            Action::Timing,
            Action::Recorder,
        ];
        &ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        let (word, help) = match self {
            Self::Command(command) => (
                command.word(),
                match command {
                    Operating::Run => "STOP to RUN by a warm restart; nothing in RUN",
                    Operating::Stop => "To STOP: outputs off",
                    Operating::Warm => "Warm restart: OB 100; M, T, Z cleared, data blocks kept",
                    Operating::Cold => "Cold restart: OB 102 or OB 100; data blocks get their load values",
                    Operating::Hot => "Hot restart: OB 101; everything keeps its value (S7-400 only)",
                    Operating::Reset => "Memory reset: STOP, everything as after loading",
                },
            ),
            Self::Status => ("status", "State, scan statistics, modules"),
            Self::Timing => (
                "timing",
                "The accounts of every scan: distributions of times, late scans and their causes (docs/timing.md)",
            ),
            Self::Recorder => ("recorder", "The flight recorder: the scans up to the worst overrun, or up to now"),
        };
        Some(PossibleValue::new(word).help(help))
    }
}

/// Parses the command line of this process and does what it says.
#[must_use]
pub fn main() -> ExitCode {
    ob1_log::tell_panics();
    ob1_rt::survive_file_limit();
    out::finish(match Cli::try_parse() {
        Ok(cli) => {
            let _exit = ob1_rt::ExitGuard::raise(exit_is_a_fault);
            cli.command.run()
        }
        // Help and version are no errors.
        Err(error) if !error.use_stderr() => {
            let text = error.render();
            if std::io::stdout().is_terminal() {
                says!("{}", text.ansi());
            } else {
                says!("{text}");
            }
            Exit::Ok.into()
        }
        Err(error) => {
            let _ = error.print();
            Exit::Usage.into()
        }
    })
}

/// Only a plugin calls `exit()` while a command is at work; `run` has more to say.
fn exit_is_a_fault() -> u8 {
    err!("ob1: a plugin has called exit(); a block returns, it never ends the process");
    ob1_log::flush(ob1_log::LAST_WORDS);
    Exit::EndedByPlugin as u8
}

impl Command {
    fn run(self) -> ExitCode {
        let exit = match self {
            Command::Exec(args) => return exec::exec(&args).into(),
            Command::Test(args) => return testing::test(&args).into(),
            Command::Import(args) => return import::import(&args).into(),
            Command::Upload(args) => return import::upload(&args).into(),
            Command::Download(args) => return import::download(&args).into(),
            Command::Compare(args) => return import::compare(&args).into(),
            Command::Run(args) => run::run(&run::Options {
                station: args.station,
                time: args.time,
                scans: args.scans,
                report: args.report,
                quiet: args.quiet,
                fence: args.fence_scan,
                lifeline: args.lifeline,
                line_faults: args.line_faults,
                line_seed: args.line_seed,
            }),
            Command::Bus(args) => bus::run(&args),
            Command::Check(args) if args.posture => check::posture(&args.files, args.json),
            Command::Check(args) => check::check(&check::Options {
                files: args.files,
                plugins: args.plugin,
                library_sources: args.library_source,
                numbers: args.numbers,
                all_messages: args.all_messages,
                symbols: args.symbols,
                mnemonics: args.mnemonics.into(),
                standard: args.library,
                lints: args.lints,
                listing: args.listing,
                native: args.native,
                json: args.json,
                verbose: args.verbose,
            }),
            Command::Xref(args) => xref::xref(&args),
            Command::New(args) => new::new(&args),
            Command::Get(args) => remote::get(&args.station, args.items, args.json),
            Command::Set(args) => remote::set(&args.station, &args.items),
            Command::Ctl(args) => match args.action {
                Action::Command(command) => remote::command(&args.station, command),
                Action::Status => remote::status(&args.station, args.json),
                Action::Timing => remote::timing(&args.station, args.json),
                Action::Recorder => remote::recorder(&args.station, args.json),
            },
            Command::Diag(args) => {
                diag::diag(&diag::Options { station: args.station, cp: args.cp, count: args.count, json: args.json })
            }
            Command::Trace(args) => trace::trace(&trace::Options {
                station: args.station,
                cp: args.cp,
                from: args.from,
                record: args.record,
                pcapng: args.pcapng,
                raw: args.raw,
                quiet: args.quiet,
                time: args.time.map(Duration::from),
            }),
            Command::Top(args) => top::top(&top::Options {
                station: args.station,
                plain: args.plain,
                every: args.every.into(),
                count: args.count,
                watch: args.watch,
            }),
            Command::Soak(args) => return args.soak().into(),
            Command::Janitor { stopped_ms, silent_ms, rundir, published } => {
                let (stopped, silent) = (Span::from_millis(stopped_ms), Span::from_millis(silent_ms));
                janitor::run(&rundir, &published, guardian::Patience { stopped, silent });
                Exit::Ok
            }
            Command::CompileBlocks => match compiling::compile_blocks() {
                Ok(()) => Exit::Ok,
                Err(why) => {
                    errs!("ob1: compile-blocks: {why}\n");
                    Exit::System
                }
            },
        };
        exit.into()
    }
}

impl SoakArgs {
    fn soak(self) -> exit::SoakExit {
        if let Some([a, b]) = self.compare.as_deref() {
            return soak::compare(a, b, f64::from(self.margin) / 100.0);
        }
        // clap has seen to it that both are there.
        let (Some(station), Some(time)) = (self.station, self.time) else { return exit::SoakExit::Inconclusive };
        soak::soak(&soak::Options {
            station,
            time: time.into(),
            warm_up: self.warm_up.map(Duration::from),
            budget: self.budget,
            cells: self.cells,
            doubled: self.doubled,
            wrong: self.wrong,
            load: self.load,
            seed: self.seed,
            report: self.report,
            quiet: self.quiet,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory as _;

    #[test]
    fn the_command_line_is_sound() {
        Cli::command().debug_assert();
    }

    #[test]
    fn words_are_understood() {
        let run = Cli::try_parse_from(["ob1", "run", "a.toml", "--for", "1.5s", "--scans", "7"]).expect("right");
        let Command::Run(args) = run.command else { panic!("{run:?}") };
        assert_eq!((args.time, args.scans), (Some(Span::from_millis(1500)), Some(7)));
        for wrong in [
            &["ob1", "run", "a.toml", "--for", "10"][..],
            &["ob1", "run", "a.toml", "--scans", "0"],
            &["ob1", "check"],
            &["ob1", "get", "a"],
            &["ob1", "ctl", "a", "explode"],
        ] {
            assert!(Cli::try_parse_from(wrong).is_err(), "{wrong:?}");
        }
    }

    #[test]
    fn the_help_names_every_exit_code() {
        let help = Cli::command().render_long_help().to_string();
        assert!(help.contains("Exit codes:") && help.contains("  7  a native block"), "{help}");
    }
}

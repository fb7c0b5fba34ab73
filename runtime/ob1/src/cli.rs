//! The command line: words, help, and what they lead to.

use std::io::IsTerminal as _;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};

use crate::exit::{self, Exit, TestExit, told};
use crate::{
    alarms, bus, check, ctl, debug, diag, diff, driver, exec, force, import, list, load, new, print, record, remote,
    restart, roll, shadow, show, soak, status, testing, top, trace, why, xref,
};
use ob1_station::access::client::AccessError;
use ob1_station::{compiling, guardian, out, run};
use ob1_time::Span;

const AFTER: &str = "\
Examples:
  ob1 new station press                            a station that runs, to begin with
  ob1 run examples/two-stations/station-a.toml     run a station until Ctrl-C
  ob1 run press.toml --for 10s --report run.json   ten seconds, figures as JSON
  ob1 check press.toml                             everything that is wrong with a station
  ob1 exec press.awl --limit 10s                   bare sources in virtual time
  ob1 show press.toml FB 20                        a block as ladder, function plan or statements
  ob1 import plant.zip --out plant                 a station of a STEP 7 project, without its sources
  ob1 test                                         the tests of this folder and below
  ob1 driver test ./my-driver                      whether a driver of a CP keeps the rules
  ob1 get press.toml M1.0 DB10.DBW20               values from the running station
  ob1 set press.toml M1.0=1 DB10.DBW20=16#1234     new values
  ob1 force press.toml E0.0=1                      a value that stands against the program
  ob1 ctl press.toml stop                          to STOP
  ob1 diag press.toml                              diagnostic buffers of CPU and CPs, with remedies
  ob1 alarms press.toml                            alarms that are active or not acknowledged
  ob1 status press.toml FB 20                      its statements while they run: RLO, STA, accumulators
  ob1 load press.toml                              its sources as they are now, without a STOP
  ob1 trace press.toml                             every telegram on its lines
  ob1 record press.toml --signals Motor,MW10 --for 10s --out run.pftrace   every scan, for Perfetto
  ob1 list                                         all stations of this machine
  ob1 roll press1 press2 --run 'systemctl restart ob1@{}'   one after the other, as long as each comes back
  ob1 top press.toml                               live: scans, CPs, telegrams, diagnostic buffer, variables
  ob1 soak press.toml --for 8h --budget wake.p99.9=200us,missed=0   hours of scans, one verdict

Times have a unit: 250us, 10ms, 1.5s, 2min, 8h. Values: 1, -5, true, 16#1A, 2#1010, 1.5.

Environment:
  OB1_LOG          what to log on stderr: error, warn, info (default), debug, trace
  OB1_CP           the driver program, if ob1-cp is neither beside ob1 nor in PATH
  OB1_IO           the program of buses, if ob1-io is neither beside ob1 nor in PATH
  OB1_PLUGIN_DIR   where plugins with a bare name are looked for first
  NO_COLOR         with any value: no colours
  XDG_RUNTIME_DIR  where the station's directory ob1/NAME is made (else /run, else /tmp)
";

/// A soft PLC: runs STEP 7 style programs cyclically, with communication processors as processes of their own.
#[derive(Debug, Parser)]
#[command(name = "ob1", version, after_help = concat_after(), max_term_width = 110)]
#[command(mut_subcommands = times_may_begin_with_a_minus)]
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
    Check(check::CheckArgs),
    Bus(bus::BusArgs),
    Exec(Box<exec::ExecArgs>),
    Test(testing::TestArgs),
    Driver(driver::DriverArgs),
    Xref(xref::XrefArgs),
    Import(import::ImportArgs),
    Upload(import::UploadArgs),
    Download(import::DownloadArgs),
    Compare(import::CompareArgs),
    Diff(diff::DiffArgs),
    Shadow(shadow::ShadowArgs),
    Show(show::ShowArgs),
    Print(print::PrintArgs),
    Load(load::LoadArgs),
    Restart(restart::RestartArgs),
    Roll(roll::RollArgs),
    List(list::ListArgs),
    New(new::NewArgs),
    Get(remote::GetArgs),
    Set(remote::SetArgs),
    Force(force::ForceArgs),
    Ctl(ctl::CtlArgs),
    Diag(diag::DiagArgs),
    Alarms(alarms::AlarmsArgs),
    Status(status::StatusArgs),
    Why(why::WhyArgs),
    Debug(debug::DebugArgs),
    Trace(trace::TraceArgs),
    Record(record::RecordArgs),
    Top(top::TopArgs),
    Soak(Box<soak::SoakArgs>),
    /// Sets the outputs of a runtime that dies to their safe state, and cleans up after it; started by `run`.
    #[command(hide = true)]
    Guardian {
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
/// Ctrl-C ends at once. A CPU in STOP because of a fault stays there, so that get and diag can read it, unless
/// --for or --scans gives the run an end.
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
    #[arg(long = "for", value_name = "TIME", value_parser = ob1_station_file::parse_duration)]
    time: Option<Span>,
    /// End after so many cycles in RUN
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    scans: Option<u64>,
    /// Write the figures of the run there as JSON
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Print errors, and warnings of the running station only: none of its file and its sources, and no summary
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

/// A time with a minus is refused as a time, not as an option that does not exist.
fn times_may_begin_with_a_minus(command: clap::Command) -> clap::Command {
    let is_time = |arg: &clap::Arg| arg.get_value_names().is_some_and(|names| names == ["TIME"]);
    let command = command.mut_args(|arg| if is_time(&arg) { arg.allow_hyphen_values(true) } else { arg });
    command.mut_subcommands(times_may_begin_with_a_minus)
}

/// Parses the command line of this process and does what it says.
pub fn main() -> ExitCode {
    ob1_process::log::tell_panics();
    ob1_rt::survive_file_limit();
    out::finish(match Cli::try_parse() {
        Ok(cli) => {
            let _exit = ob1_rt::ExitGuard::raise(exit_is_a_fault);
            cli.command.run()
        }
        // Help and version are not errors.
        Err(error) if !error.use_stderr() => {
            let text = error.render();
            if ob1_process::log::is_coloured(std::io::stdout().is_terminal()) {
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
fn exit_is_a_fault(way: &str) -> u8 {
    err!("ob1: a plugin has called {way}; a block returns, it never ends the process");
    ob1_process::log::flush(ob1_process::log::LAST_WORDS);
    Exit::EndedByPlugin as u8
}

impl Command {
    fn run(self) -> ExitCode {
        let exit = match self {
            Command::Exec(args) => return exec::exec(&args).into(),
            Command::Test(args) => return told(testing::test(&args), |_| TestExit::Unusable).into(),
            Command::Driver(args) => return told(driver::driver(&args), |_| TestExit::Unusable).into(),
            Command::Import(args) => return import::import(&args).into(),
            Command::Upload(args) => return import::upload(&args).into(),
            Command::Download(args) => return import::download(&args).into(),
            Command::Compare(args) => return import::compare(&args).into(),
            Command::Diff(args) => return diff::diff(&args).into(),
            Command::Shadow(args) => return shadow::shadow(&args).into(),
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
            Command::Check(args) => check::check(&args),
            Command::Xref(args) => xref::xref(&args),
            Command::Show(args) => show::show(&args),
            Command::Print(args) => print::print(&args),
            Command::Load(args) => told(load::load(&args), AccessError::exit),
            Command::Restart(args) => told(restart::restart(&args), AccessError::exit),
            Command::Roll(args) => roll::roll(&args),
            Command::List(args) => list::list(&args),
            Command::New(args) => new::new(&args),
            Command::Get(args) => told(remote::get(&args), AccessError::exit),
            Command::Set(args) => told(remote::set(&args), AccessError::exit),
            Command::Force(args) => told(force::force(&args), AccessError::exit),
            Command::Ctl(args) => told(ctl::ctl(&args), AccessError::exit),
            Command::Diag(args) => told(diag::diag(&args), AccessError::exit),
            Command::Alarms(args) => told(alarms::alarms(&args), AccessError::exit),
            Command::Status(args) => told(status::status(&args), AccessError::exit),
            Command::Why(args) => told(why::why(&args), AccessError::exit),
            Command::Debug(args) => told(debug::debug(&args), AccessError::exit),
            Command::Trace(args) => trace::trace(&args),
            Command::Record(args) => record::record(&args),
            Command::Top(args) => top::top(&args),
            Command::Soak(args) => return soak::soak(&args).into(),
            Command::Guardian { stopped_ms, silent_ms, rundir, published } => {
                let (stopped, silent) = (Span::from_millis(stopped_ms), Span::from_millis(silent_ms));
                guardian::process::run(&rundir, &published, guardian::Patience { stopped, silent });
                Exit::Ok
            }
            Command::CompileBlocks => {
                let done = compiling::compile_blocks().map_err(|why| format!("compile-blocks: {why}"));
                told(done.map(|()| Exit::Ok), |_| Exit::System)
            }
        };
        exit.into()
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
            &["ob1", "ctl", "a", "explode"],
        ] {
            assert!(Cli::try_parse_from(wrong).is_err(), "{wrong:?}");
        }
    }

    #[test]
    fn a_negative_time_is_told_as_such() {
        for command in [
            &["ob1", "run", "a.toml", "--for", "-1s"][..],
            &["ob1", "exec", "a.awl", "--limit", "-1s"],
            &["ob1", "exec", "a.awl", "--min-cycle", "-1s"],
            &["ob1", "exec", "a.awl", "--watchdog", "-1s"],
            &["ob1", "top", "a.toml", "--every", "-1s"],
            &["ob1", "bus", "watch", "a.toml", "--every", "-1s"],
            &["ob1", "trace", "a.toml", "--for", "-1s"],
            &["ob1", "soak", "a.toml", "--for", "-1s"],
            &["ob1", "soak", "a.toml", "--for", "1h", "--warm-up", "-1s"],
        ] {
            let said = Cli::try_parse_from(command).expect_err("no time").to_string();
            assert!(said.contains("\"-1s\" is no time") && !said.contains("tip:"), "{command:?}: {said}");
        }
    }

    #[test]
    fn the_help_names_every_exit_code() {
        let help = Cli::command().render_long_help().to_string();
        assert!(help.contains("Exit codes:") && help.contains("  7  a native block"), "{help}");
    }
}

//! The words of `ob1 soak`.

use std::path::PathBuf;

use clap::Args;
use ob1_time::Span;

use super::{Budget, Load};

/// Run a station for hours, and judge its timing
///
/// The station runs as a process of its own. It ends with a verdict: every limit of the budget kept (exit code 0),
/// one broken (1), or too little seen to tell (2). After Ctrl-C it ends early, and no better than inconclusive. The
/// reports are written each minute.
#[derive(Debug, Args)]
#[command(
    after_help = "Limits: DISTRIBUTION.p99.9=TIME (p50 p90 p99 p99.9 p99.99 p99.999 max mean; cycle wake deadlines execution inputs\noutputs links \
    ob1 ob35 ob35.late fc0 ...), counts (missed overruns watchdog late late.CLASS telegrams.lost telegrams.errors\ntelegrams.aborted \
    telegrams.doubled telegrams.wrong receive.lost receive.errors drivers.lost cell.NAME), unexplained=5%,\nSERIES.slope=AMOUNT/h (rss fds \
    drivers.rss cycle.p99 wake.p50 wake.p99 execution.p50 execution.p99).\n\nExamples:\n  ob1 soak press.toml --for 8h --budget \
    cycle.p99.9=1.2ms,wake.p99.99=200us,missed=0,rss.slope=1MiB/h\n  ob1 soak press.toml --for 10min --load \
    cpu=2,io=1,driver-kill=10/min --seed 7 --budget execution.p99=80us\n  ob1 soak --merge host-*.json\n\nExit codes: 0 pass, 1 a budget is broken, 2 inconclusive, or it \
    could not be measured. More: docs/soak.md."
)]
pub struct SoakArgs {
    /// The station file (docs/station-file.md)
    #[arg(required_unless_present_any = ["compare", "merge"])]
    pub station: Option<PathBuf>,
    /// How long to measure: 10min, 8h
    #[arg(
        long = "for",
        value_name = "TIME",
        value_parser = ob1_station_file::parse_duration,
        required_unless_present_any = ["compare", "merge"]
    )]
    pub time: Option<Span>,
    /// Say whether the second of two reports is worse than the first
    #[arg(long, num_args = 2, value_names = ["A.json", "B.json"], conflicts_with_all = ["station", "time", "budget", "load"])]
    pub compare: Option<Vec<PathBuf>>,
    /// One verdict on many reports, of many machines; --budget instead of the limits they were judged by
    #[arg(long, num_args = 1.., value_name = "REPORT.json", conflicts_with_all = ["station", "time", "compare", "load"])]
    pub merge: Option<Vec<PathBuf>>,
    /// With --compare and --merge: a difference up to this does not count as worse
    #[arg(long, value_name = "PERCENT", default_value_t = 10)]
    pub margin: u32,
    /// The limits that have to be kept, separated by commas
    #[arg(long, value_name = "LIMIT,...", value_delimiter = ',')]
    pub budget: Vec<Budget>,
    /// Time in RUN before the measurement begins [default: a tenth of it, at most 10s]
    #[arg(long, value_name = "TIME", value_parser = ob1_station_file::parse_duration)]
    pub warm_up: Option<Span>,
    /// Cells of the program to follow, such as its own counters
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub cells: Vec<String>,
    /// The cell in which the program counts telegrams that arrived twice
    #[arg(long, value_name = "NAME")]
    pub doubled: Option<String>,
    /// The cell in which the program counts telegrams that arrived with another content
    #[arg(long, value_name = "NAME")]
    pub wrong: Option<String>,
    /// The load to put the station under: cpu=2,memory=64MiB,io=1,driver-kill=10/min,line-faults=500
    #[arg(long, value_name = "KIND=AMOUNT,...", default_value = "", hide_default_value = true)]
    pub load: Load,
    /// The seed of the load
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Where the reports go: BASE.json, BASE.html, BASE.txt, BASE.log [default: STATION-soak-DATE-TIME]
    #[arg(long, value_name = "BASE")]
    pub report: Option<PathBuf>,
    /// Print the verdict only
    #[arg(long, short)]
    pub quiet: bool,
}

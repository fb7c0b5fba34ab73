//! `cargo xtask`: every task of the project, the same on a developer's machine and in CI.
//!
//! A verb is one module with a `run`; this file only selects it. A failing verb prints one line that names the failed
//! step, after the output of the tool.

mod aarch64;
mod arch;
mod book;
mod campaign;
mod cargo;
mod ci;
mod demo;
mod failure;
mod faults;
mod figures;
mod fuzz;
mod loom_miri;
mod needs;
mod package;
mod pick;
mod python;
mod shell;
mod siege;
mod tally;
mod test;

use std::process::ExitCode;

use failure::Failure;

const USAGE: &str = "\
usage: cargo xtask VERB [...]

  demo [--for 20s] [--dirty]      the two stations of examples/two-stations, live, with a verdict; --dirty: over a bad cable
  test [--quick] [--release] [FILTER]
                                  all tests: plugins, binaries and partners are built and handed to them; --quick: those that
                                  need no foreign program and start no process
  sim [--debug] [--seeds N] [--seed S] [--minutes M] [-- ...]
                                  the whole station in virtual time, with line faults and driver kills
  programs [CP...] [--debug] [--seeds N] [--seed S --log]
                                  programs drawn at random around the handling blocks, under a judge written from the manuals
  bench [...]                     the figures of docs/figures.md, next to the floor of this machine; bench stl: the engine beside awlsim;
                                  --write: into docs/figures.md; bench counts [--write]: instructions, beside those of tests/counts.txt;
                                  bench disturb: the scan while it is looked at and its driver is killed;
                                  bench kill-runtime: how long the outputs of a killed runtime stay on;
                                  bench io: remote I/O over Modbus TCP beside libmodbus;
                                  bench causes: late scans by cause on a machine that is too busy;
                                  bench gate [items browsers flows paint] [--minutes M]: OPC UA, pages and the first paint under load
  oscat [--release 3.11] [--calls 1000] [--block NAME] [--show] [--compile] [--speed]
                                  the SCL compiler against Siemens' own, over sample releases beside the checkout (docs/scl.md);
                                  --compile: compiles only; --show: the statements of both; --speed: native code of both
  compare [--seeds N] [--seed S]  random STL programs on our engine and on awlsim; what differs is written to tests/compare
  fuzz [TARGET] [--each 10m]      the fuzz targets (all: one after the other); cargo-fuzz is installed into .tools
  faults [PROTOCOL] [--telegrams 100000]
                                  the protocol machines on bad lines, in virtual time, from seeds
  siege [WHAT] [--rounds N] [--minutes M]
                                  attacks, long (all: one after the other): kill bus bus_dp socket segment input cut writer s7_kill alarm_kill s7_sessions
                                  s7_torn gate_broker browsers, in rounds; gate_http gate_opcua gate_mqtt gate_greed, in minutes
  collect FILE...                 the outputs of the parts of a campaign as one verdict: sim, programs, compare, faults, siege and fuzz take
                                  --part I/N and --json for a batch engine (docs/campaigns.md)
  slurm [--seeds N] [--parts P] [--nodes K] [--debug]
                                  sim as an array job of Slurm on this machine, with a killed node: the verdict of one machine, to the seed
  miri                            the unit tests of the crates with unsafe code under Miri (a nightly toolchain with that component)
  aarch64 [PROGRAMS]              the native engine's tests and random programs as code for AArch64, under qemu-user
  arch [--bless]                  the guards of the invariants; --bless rewrites the clippy.toml files and the conformance table
  book [--check]                  docs/ as a book: pages, links, snippets and command lines checked, then made by mdBook into target/book
  package [--oci] [--check [--short]] [--debug]
                                  a .deb and an archive of all programs and plugins, in target/dist; --check: made twice, lintian,
                                  the unit, new stations and plugins, a bare Debian; --debug: quickly, with the book's pages as they are;
                                  --oci: an image for containers instead; with --check it runs without rights, beside its partner outside; --short: as
                                  `test` does it
  ci                              what .ci/run does
  fmt                             formats the workspace
  help                            this text
";

fn main() -> ExitCode {
    let mut args = std::env::args().skip(1);
    let verb = args.next().unwrap_or_default();
    let rest: Vec<String> = args.collect();
    let done = match verb.as_str() {
        "demo" => demo::run(&rest),
        "test" => test::run(&rest),
        "sim" => figures::sim(&rest),
        "programs" => figures::programs(&rest),
        "oscat" => figures::oscat(&rest),
        "bench" => figures::bench(&rest),
        "compare" => figures::compare(&rest),
        "fuzz" => fuzz::run(&rest),
        "faults" => faults::run(&rest),
        "siege" => siege::run(&rest),
        "collect" => campaign::collect(&rest),
        "slurm" => campaign::slurm::run(&rest),
        "miri" => loom_miri::miri(&rest),
        "aarch64" => aarch64::run(&rest),
        "arch" => arch::run(&rest),
        "book" => book::run(&rest, USAGE),
        "package" => package::run(&rest),
        "ci" => ci::ci(&rest),
        "fmt" => ci::fmt(&rest),
        "help" | "--help" | "-h" => {
            print!("{USAGE}");
            Ok(())
        }
        "" => Err(Failure::Usage("no verb".into())),
        other => Err(Failure::Usage(format!("unknown verb `{other}`"))),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(Failure::Usage(what)) => {
            eprint!("xtask: {what}\n\n{USAGE}");
            ExitCode::from(2)
        }
        Err(Failure::Step(what)) => {
            eprintln!("xtask: {what}");
            ExitCode::FAILURE
        }
        Err(Failure::Program(what, code)) => {
            eprintln!("xtask: {what}");
            ExitCode::from(code)
        }
    }
}

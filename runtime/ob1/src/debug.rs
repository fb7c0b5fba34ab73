//! `ob1 debug STATION`: breakpoints and single step, at a small prompt.

use std::io::{self, BufRead as _};
use std::time::Duration;

use clap::Args;
use ob1_station::access::client::{AccessError, Client};
use ob1_station::access::debug::{DebugStatus, DebugWanted, GoTo};
use ob1_station::access::protocol::Op;
use ob1_station::out;

use crate::exit::Exit;

/// How long the prompt waits for a hold at once; it asks again until there is one.
const WAIT: Duration = Duration::from_secs(10);

const COMMANDS: &[&str] = &[
    "break FB 20:14    hold before line 14 of its source (b); FB 20: its first statement; FB 20+3: statement 3, from 0",
    "delete [PLACE]    take one breakpoint away, or all (d)",
    "wait              until the CPU holds (w)",
    "continue          to the next breakpoint (c)",
    "step              one statement, into a called block (s)",
    "next              one statement, over a called block (n)",
    "out               to the end of the running block (o)",
    "registers, stack, local      of the place where it holds (r, bt, l)",
    "watch NAME ...    values, as ob1 get shows them",
    "quit              no breakpoints any more; a CPU in HOLD goes on in RUN (q)",
    "stop              no breakpoints any more; a CPU in HOLD goes to STOP",
];

/// Breakpoints and single step: the CPU in HOLD
///
/// The CPU goes to HOLD before the statement of a breakpoint. Then no program runs, timers, cycle monitoring and
/// time-driven organization blocks stand still, outputs are in their safe state; links are served, the clock goes on.
/// While there are breakpoints every block runs statement by statement, without machine code: for a test, not for
/// production. If this command ends in any other way than by `quit`, a CPU in HOLD goes to STOP, never to RUN.
#[derive(Clone, Debug, Args)]
#[command(
    after_help = "Commands at the prompt:\n  break FB 20:14, delete, wait, continue, step, next, out, registers, \
    stack, local, watch NAME, quit, stop; help explains them.\n\nExamples:\n  ob1 debug press.toml --break 'FB 20:14'\n  \
    echo 'wait\nstack\nquit' | ob1 debug press --break 'FC 5'\n\nExit codes: 0 left by quit, 5 the station does not run, 8 \
    refused.\n\nMore: docs/online.md."
)]
pub struct DebugArgs {
    /// A running station: its name or its file
    station: String,
    /// Breakpoints to begin with
    #[arg(long = "break", value_name = "PLACE")]
    places: Vec<String>,
}

/// Runs the prompt of `ob1 debug` until it is left.
pub fn debug(args: &DebugArgs) -> Result<Exit, AccessError> {
    let mut session = Session { client: Client::to_station(&args.station)?, places: Vec::new(), at: None };
    session.set(args.places.clone())?;
    say!("breakpoints: {}; help lists the commands", args.places.len());
    let mut lines = io::stdin().lock().lines();
    loop {
        says!("(ob1) ");
        out::flush();
        let Some(line) = lines.next().transpose()? else {
            // Nobody says that the program may go on.
            session.ask(DebugWanted::End)?;
            return Ok(Exit::Ok);
        };
        match session.obey(&line) {
            Ok(Next::Prompt) => {}
            Ok(Next::Leave(runs)) => {
                session.leave(runs)?;
                return Ok(Exit::Ok);
            }
            Err(AccessError::Refused(why)) => say!("{why}"),
            Err(other) => return Err(other),
        }
    }
}

struct Session {
    client: Client,
    places: Vec<String>,
    /// Where the CPU holds; `None`: it runs.
    at: Option<DebugStatus>,
}

/// What comes after a command.
enum Next {
    Prompt,
    /// The end, in RUN or in STOP.
    Leave(bool),
}

impl Session {
    fn ask(&mut self, wanted: DebugWanted) -> Result<DebugStatus, AccessError> {
        let debug = self.client.ask(Op::Debug(wanted))?.debug;
        debug.map(|debug| *debug).ok_or_else(|| AccessError::Refused("the station knows no breakpoints".to_owned()))
    }

    fn set(&mut self, places: Vec<String>) -> Result<(), AccessError> {
        self.ask(DebugWanted::Break { at: places.clone() })?;
        self.places = places;
        Ok(())
    }

    fn leave(&mut self, runs: bool) -> Result<(), AccessError> {
        if runs {
            self.set(Vec::new())?;
            if self.ask(DebugWanted::Wait { wait_ms: 0 })?.outcome == "held" {
                self.ask(DebugWanted::Go { to: GoTo::Run, wait_ms: 0 })?;
            }
        }
        self.ask(DebugWanted::End)?;
        Ok(())
    }

    fn obey(&mut self, line: &str) -> Result<Next, AccessError> {
        let (word, rest) = line.trim().split_once(char::is_whitespace).unwrap_or((line.trim(), ""));
        let rest = rest.trim();
        match word {
            "" => {}
            "help" | "h" | "?" => COMMANDS.iter().for_each(|line| say!("  {line}")),
            "break" | "b" if rest.is_empty() => self.places.iter().for_each(|place| say!("  {place}")),
            "break" | "b" => {
                let places = self.places.iter().cloned().chain([rest.to_owned()]).collect();
                self.set(places)?;
            }
            "delete" | "d" => {
                let places = self.places.iter().filter(|place| !rest.is_empty() && *place != rest).cloned().collect();
                self.set(places)?;
            }
            "wait" | "w" => self.wait(None)?,
            "continue" | "c" => self.wait(Some(GoTo::Run))?,
            "step" | "s" => self.wait(Some(GoTo::Into))?,
            "next" | "n" => self.wait(Some(GoTo::Over))?,
            "out" | "o" => self.wait(Some(GoTo::Out))?,
            "registers" | "r" => self.show(registers),
            "stack" | "bt" => self.show(stack),
            "local" | "l" => self.show(local),
            "watch" => {
                let items = rest.split_whitespace().map(str::to_owned).collect();
                for value in self.client.ask(Op::Get { items })?.values.unwrap_or_default() {
                    say!("  {} = {}  ({})", value.item, value.value, value.hex);
                }
            }
            "outputs" => self.outputs(rest)?,
            "quit" | "q" => return Ok(Next::Leave(true)),
            "stop" => return Ok(Next::Leave(false)),
            other => say!("there is no command \"{other}\": help lists them"),
        }
        Ok(Next::Prompt)
    }

    /// Peripheral outputs in STOP.
    fn outputs(&mut self, wanted: &str) -> Result<(), AccessError> {
        let enabled = match wanted {
            "on" => true,
            "off" => false,
            _ => {
                say!("outputs on, or outputs off");
                return Ok(());
            }
        };
        match self.ask(DebugWanted::Outputs { enabled })?.outcome.as_str() {
            "done" if enabled => {
                say!("the peripheral outputs are enabled until `outputs off`, quit or another operating state");
                say!("  ob1 set writes them; forced outputs have their values");
            }
            "done" => say!("the outputs are in their safe state"),
            _ => say!("only in STOP: in RUN the program drives the outputs, in HOLD they are in their safe state"),
        }
        Ok(())
    }

    /// Goes on, if it holds, and waits for the next hold.
    fn wait(&mut self, to: Option<GoTo>) -> Result<(), AccessError> {
        let wait_ms = WAIT.as_millis() as u64;
        let mut wanted = to.map_or(DebugWanted::Wait { wait_ms }, |to| DebugWanted::Go { to, wait_ms });
        self.at = None;
        loop {
            let status = self.ask(wanted)?;
            match status.outcome.as_str() {
                "held" => {
                    self.at = Some(status);
                    self.show(place);
                    return Ok(());
                }
                "stopped" => {
                    say!("the CPU is in STOP: ob1 diag says why");
                    return Ok(());
                }
                _ if self.places.is_empty() => {
                    say!("the CPU runs, and there is no breakpoint");
                    return Ok(());
                }
                _ => say!("no breakpoint reached for {} s: is the block called (ob1 xref)?", WAIT.as_secs()),
            }
            out::flush();
            if out::is_over() {
                return Ok(());
            }
            wanted = DebugWanted::Wait { wait_ms };
        }
    }

    fn show(&self, what: fn(&DebugStatus)) {
        match &self.at {
            Some(status) => what(status),
            None => say!("the CPU does not hold: wait, or continue"),
        }
    }
}

fn place(status: &DebugStatus) {
    let Some(at) = status.stack.first() else { return };
    say!("HOLD before {}, statement {}, in OB {}: {}", at.place, at.statement, at.ob, at.text);
}

pub(crate) fn registers(status: &DebugStatus) {
    let Some(r) = &status.registers else { return };
    let [a1, a2, a3, a4] = r.accus;
    let (db, di) = status.stack.first().map_or((0, 0), |at| (at.db, at.di));
    say!(
        "  RLO {} STA {} status word {:09b} (BR CC1 CC0 OV OS OR STA RLO /FC)",
        r.status >> 1 & 1,
        r.status >> 2 & 1,
        r.status
    );
    say!("  ACCU1 {a1:08X} ACCU2 {a2:08X} ACCU3 {a3:08X} ACCU4 {a4:08X}");
    say!("  AR1 {:08X} AR2 {:08X} DB {db} DI {di}", r.addresses[0], r.addresses[1]);
}

pub(crate) fn stack(status: &DebugStatus) {
    for (depth, at) in status.stack.iter().enumerate() {
        say!(
            "  {depth}: {}, statement {}, DB {} DI {}, in OB {}: {}",
            at.place,
            at.statement,
            at.db,
            at.di,
            at.ob,
            at.text
        );
    }
}

pub(crate) fn local(status: &DebugStatus) {
    for (row, bytes) in status.local.chunks(16).enumerate() {
        say!("  L {:3}  {}", row * 16, crate::units::hex(bytes));
    }
}

//! `ob1 status STATION FB 20`: the statements of a block while they run, each line of the source with the registers
//! behind it. Live on a terminal, once elsewhere.

use std::fmt::Write as _;
use std::io::{self, IsTerminal as _};
use std::time::Duration;

use clap::Args;
use ob1_station::access::client::{AccessError, Client};
use ob1_station::access::pass::{LineStatus, PassStatus, PassWanted, Registers};
use ob1_station::access::protocol::Op;
use ob1_station::out;
use ob1_time::Span;

use crate::exit::Exit;
use crate::live_text;
use crate::show::flowing::Picture;

/// Time between two passes of the live view; the station makes no more than ten a second.
const EVERY: Duration = Duration::from_millis(250);
/// Columns of the source's text, at least and at most.
const TEXT: [usize; 2] = [24, 60];

/// Watch the statements of a block while they run: program status
///
/// Prints each line of the block's source with the registers behind its last statement: RLO, STA, ACCU1, ACCU2, AR1,
/// AR2, the open data blocks. All values are of one pass through the block, the first of a scan that meets the
/// conditions; of a loop, those of its last round. A line that did not run in that pass shows -, never an old value.
/// On a terminal the view is live until q; elsewhere, and with --once, it is one pass.
#[derive(Clone, Debug, Args)]
#[command(
    after_help = "Examples:\n  ob1 status press.toml FB 20\n  ob1 status press.toml FB 20 --network 3 --lad\n  ob1 status press FC 5 --from FB 20 --network 3\n  \
    ob1 status press FB 20 --db 21 --once --json\n\nExit codes: 0 shown, 5 the station does not run, 8 no such block, or no such \
    pass in time.\n\nMore: docs/online.md."
)]
pub struct StatusArgs {
    /// A running station: its name or its file
    pub(crate) station: String,
    /// The block: OB 1, FC 5, FB 20, or its name
    #[arg(required = true, num_args = 1..=2, value_name = "BLOCK")]
    block: Vec<String>,
    /// Only a pass that this block has called, directly or through others
    #[arg(long, num_args = 1..=2, value_name = "BLOCK")]
    from: Vec<String>,
    /// Only this network
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) network: Option<u16>,
    /// Only a pass with this data block: the instance of an FB, the one opened at the beginning of an FC or OB
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    db: Option<u16>,
    /// How long a pass is waited for, at most 60 s
    #[arg(long, value_name = "TIME", default_value = "2s", value_parser = ob1_station_file::parse_duration)]
    wait: Span,
    /// Drawn as ladder with its power flow: green has it, blue has not, black did not run
    #[arg(long, conflicts_with = "json", group = "drawn")]
    pub(crate) lad: bool,
    /// The same as function plan
    #[arg(long, conflicts_with = "json", group = "drawn")]
    fbd: bool,
    /// One pass
    #[arg(long)]
    once: bool,
    /// Each pass as a line of JSON, until the station ends; with --once one
    #[arg(long)]
    json: bool,
}

impl StatusArgs {
    fn wanted(&self) -> PassWanted {
        PassWanted {
            block: self.block.join(" "),
            from: (!self.from.is_empty()).then(|| self.from.join(" ")),
            network: self.network,
            db: self.db,
            wait_ms: self.wait.millis(),
            statements: self.lad || self.fbd,
        }
    }
}

/// Asks for one pass, and waits for it.
pub(crate) fn ask(client: &mut Client, wanted: PassWanted) -> Result<PassStatus, AccessError> {
    let pass = client.ask(Op::Pass(wanted))?.pass;
    pass.map(|pass| *pass).ok_or_else(|| AccessError::Refused("the station knows no program status".to_owned()))
}

/// Why there are no values.
fn not_called(args: &StatusArgs, pass: &PassStatus) -> Option<String> {
    let conditions =
        [args.wanted().from.map(|from| format!(" from {from}")), args.db.map(|db| format!(" with DB {db}"))];
    let conditions: String = conditions.into_iter().flatten().collect();
    (pass.outcome == "not called").then(|| {
        format!(
            "{} was not called{conditions} within {}\n  = is the CPU in RUN (ob1 ctl STATION status), is the block called (ob1 \
             xref)? wait longer: --wait 30s",
            pass.block, args.wait
        )
    })
}

/// Shows a block until `q`, once, or until the station's end.
pub fn status(args: &StatusArgs) -> Result<Exit, AccessError> {
    let mut client = Client::to_station(&args.station)?;
    let picture = args.wanted().statements.then(|| Picture::of(args)).transpose().map_err(AccessError::Refused)?;
    let text = |pass: &PassStatus, coloured: bool| match &picture {
        Some(picture) => picture.text(pass, coloured),
        None => text(pass),
    };
    let shown =
        |pass: &PassStatus| not_called(args, pass).unwrap_or_else(|| text(pass, ob1_process::log::is_coloured(true)));
    let live = !args.once && !args.json && io::stdout().is_terminal() && io::stdin().is_terminal();
    // What is wrong with the question is told before there is a screen.
    let mut pass = ask(&mut client, args.wanted())?;
    if live {
        let next = || match ask(&mut client, args.wanted()) {
            Err(AccessError::Io(_)) => Ok(None),
            pass => pass.map(|pass| Some(shown(&pass))),
        };
        live_text::show(EVERY, shown(&pass), next)?;
        return Ok(Exit::Ok);
    }
    loop {
        if args.json {
            says!("{}\n", serde_json::to_string(&pass).map_err(io::Error::from)?);
        }
        match not_called(args, &pass) {
            Some(why) if args.once || !args.json => return Err(AccessError::Refused(why)),
            None if !args.json => says!("{}", text(&pass, ob1_process::log::is_coloured(io::stdout().is_terminal()))),
            _ => {}
        }
        out::flush();
        if args.once || !args.json || out::is_over() {
            return Ok(Exit::Ok);
        }
        std::thread::sleep(EVERY);
        pass = match ask(&mut client, args.wanted()) {
            Err(AccessError::Io(_)) => return Ok(Exit::Ok),
            pass => pass?,
        };
    }
}

/// Which pass it is, and what is missing.
pub(crate) fn heading(pass: &PassStatus) -> String {
    let mut out = pass.block.clone();
    if !pass.name.is_empty() && pass.name != pass.block {
        let _ = write!(out, " \"{}\"", pass.name);
    }
    let _ = write!(out, " in OB {}", pass.ob);
    if !pass.caller.is_empty() {
        let _ = write!(out, ", called by {}", pass.caller);
    }
    let _ = writeln!(out, ", {:.3} s", pass.time_ns as f64 / 1e9);
    if pass.outcome == "stopped" {
        out.push_str("the CPU went to STOP in this pass: what ran until then\n");
    }
    if !pass.cut.is_empty() {
        let _ = writeln!(out, "{}", pass.cut);
    }
    out
}

/// A pass as a table.
pub(crate) fn text(pass: &PassStatus) -> String {
    let mut out = heading(pass);
    if pass.file.is_empty() {
        out.push_str("without its source (none, or changed since it was loaded): as it is printed\n");
    }
    let longest = pass.lines.iter().map(|line| line.text.chars().count()).max().unwrap_or(0);
    let width = longest.clamp(TEXT[0], TEXT[1]);
    let _ = writeln!(
        out,
        "{:>5} {:<width$} RLO STA ACCU1     ACCU2     AR1       AR2       DB    DI    STW       times",
        "line", ""
    );
    for line in &pass.lines {
        out.push_str(&row(line, width, !pass.cut.is_empty()));
    }
    out
}

/// A line of it.
fn row(line: &LineStatus, width: usize, is_cut: bool) -> String {
    let number = if line.line == 0 { String::new() } else { line.line.to_string() };
    let text: String = line.text.replace('\t', "  ").chars().take(width).collect();
    let left = format!("{number:>5} {text:<width$}");
    let values = match &line.registers {
        _ if line.statements == 0 => return format!("{}\n", left.trim_end()),
        // What came after the cut may have run.
        None if is_cut => "  ?",
        None => "  -",
        Some(registers) => return format!("{left} {} {:>8}\n", columns(registers), line.times),
    };
    format!("{left} {values}\n")
}

fn columns(r: &Registers) -> String {
    let Registers { rlo, sta, status, accu1, accu2, ar1, ar2, db, di } = *r;
    let (rlo, sta) = (u8::from(rlo), u8::from(sta));
    format!("  {rlo}   {sta} {accu1:08X}  {accu2:08X}  {ar1:08X}  {ar2:08X}  {db:<5} {di:<5} {status:09b}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_that_did_not_run_shows_no_value() {
        let registers = Registers { rlo: true, sta: true, status: 0x06, accu1: 0x7FFF, db: 10, ..Registers::default() };
        let line = |number, text: &str, statements, registers: Option<Registers>| LineStatus {
            line: number,
            text: text.into(),
            network: 1,
            statements,
            times: u32::from(registers.is_some()),
            registers,
        };
        let pass = PassStatus {
            block: "FB 20".into(),
            name: "Press".into(),
            outcome: "whole".into(),
            ob: 1,
            caller: "OB 1, press.awl:3".into(),
            time_ns: 1_500_000_000,
            file: "press.awl".into(),
            lines: vec![
                line(10, "      U     #start;", 1, Some(registers)),
                line(11, "// never", 0, None),
                line(12, "      L     7;", 1, None),
            ],
            ..PassStatus::default()
        };
        let expected = "\
FB 20 \"Press\" in OB 1, called by OB 1, press.awl:3, 1.500 s
 line                          RLO STA ACCU1     ACCU2     AR1       AR2       DB    DI    STW       times
   10       U     #start;        1   1 00007FFF  00000000  00000000  00000000  10    0     000000110        1
   11 // never
   12       L     7;             -
";
        assert_eq!(text(&pass), expected);
        let cut = PassStatus { cut: "cut: there".into(), ..pass };
        assert!(text(&cut).contains("cut: there\n") && text(&cut).ends_with("L     7;             ?\n"));
    }
}

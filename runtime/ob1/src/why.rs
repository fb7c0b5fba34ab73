//! `ob1 why press A4.0`: which statement gives a bit its value, and which scan decides it.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use clap::Args;
use ob1_model::BlockId;
use ob1_station::access::client::{AccessError, Client};
use ob1_station::access::protocol::Op;
use ob1_station::access::why::{Inside, TermStatus, WhyStatus, WhyWanted};
use ob1_time::Span;

use crate::exit::Exit;
use crate::remote::print_json;

/// How deep it is asked for flags that other statements write.
const DEPTH: usize = 4;

/// Say why a bit is on or off, or why a block is not called
///
/// Names the statements that write it, the one that gave it its value last, and the scans in front of it. A scan that
/// decides alone is marked with <: with its bit the other way, and everything else as it was, the result of that pass
/// would be the other one. Flags that other statements write are asked for in turn. Each block is watched for one pass
/// (program status); passes through several blocks are of different scans.
#[derive(Clone, Debug, Args)]
#[command(
    after_help = "Examples:\n  ob1 why press A4.0\n  ob1 why press Q4.0\n  ob1 why press \"Motor\"\n  ob1 why press FB 20\n\n\
    Exit codes: 0 answered, 5 the station does not run, 8 no such name, or no pass in time.\n\nMore: docs/online.md."
)]
pub struct WhyArgs {
    /// A running station: its name or its file
    station: String,
    /// A bit, timer or counter by its name, or a block
    #[arg(required = true, num_args = 1..=2, value_name = "NAME")]
    operand: Vec<String>,
    /// How long a pass is waited for, at most 60 s
    #[arg(long, value_name = "TIME", default_value = "2s", value_parser = ob1_station_file::parse_duration)]
    wait: Span,
    /// As JSON: a list of answers, the asked one first
    #[arg(long)]
    json: bool,
}

/// Runs `ob1 why`: prints the answers, and says how it ended.
pub fn why(args: &WhyArgs) -> Result<Exit, AccessError> {
    let client = Client::to_station(&args.station)?;
    let answers = (Asking { args, client, seen: BTreeSet::new() }).all(&args.operand.join(" "))?;
    if args.json {
        return Ok(print_json(&answers.into_iter().map(|(_, why)| why).collect::<Vec<_>>()));
    }
    for (depth, why) in &answers {
        says!("{}", text(why, *depth));
    }
    Ok(Exit::Ok)
}

struct Asking<'a> {
    args: &'a WhyArgs,
    client: Client,
    seen: BTreeSet<String>,
}

impl Asking<'_> {
    /// The answer, and those to the questions it leads to, each with its depth.
    fn all(mut self, asked: &str) -> Result<Vec<(usize, WhyStatus)>, AccessError> {
        self.runs()?;
        let mut answers = Vec::new();
        let mut open = vec![(0, asked.to_owned(), Inside::default())];
        while let Some((depth, asked, inside)) = open.pop() {
            if !self.seen.insert(asked.to_uppercase().replace(' ', "")) {
                continue;
            }
            let why = self.one(&asked, &inside)?;
            if depth < DEPTH {
                let deciding: Vec<&TermStatus> = why.terms.iter().filter(|term| term.turns).collect();
                let all: Vec<&TermStatus> = if deciding.is_empty() { why.terms.iter().collect() } else { deciding };
                let next = all.into_iter().filter(|term| !term.ask.is_empty() && term.is_written);
                let mut next: Vec<(usize, String, Inside)> =
                    next.map(|term| (depth + 1, term.ask.clone(), term.inside.clone().unwrap_or_default())).collect();
                // What the called block does there.
                next.extend(why.inside.clone().map(|inside| (depth + 1, inside.ask.clone(), inside)));
                // A block that is not called is asked about one level deeper.
                if why.outcome == "not called" {
                    next.push((depth + 1, why.block.clone(), Inside::default()));
                }
                next.reverse();
                open.append(&mut next);
            }
            answers.push((depth, why));
        }
        Ok(answers)
    }

    /// Only a program that runs gives reasons.
    fn runs(&mut self) -> Result<(), AccessError> {
        let state = self.client.ask(Op::Status)?.status.map(|status| status.state).unwrap_or_default();
        let station = &self.args.station;
        match state.as_str() {
            "STOP" => Err(AccessError::Refused(format!(
                "{station} is in STOP: no program runs, and outputs are in their safe state\n{}",
                crate::ctl::why_stopped(station, 0).unwrap_or_else(|| format!("  = ob1 diag {station} says why"))
            ))),
            "HOLD" => Err(AccessError::Refused(format!(
                "{station} is in HOLD: somebody has stopped its program at a breakpoint, and outputs are in their safe state"
            ))),
            _ => Ok(()),
        }
    }

    fn one(&mut self, asked: &str, inside: &Inside) -> Result<WhyStatus, AccessError> {
        let wait_ms = self.args.wait.millis();
        let client = &mut self.client;
        // A block has no value.
        let values = client.ask(Op::Get { items: vec![asked.to_owned()] }).ok().and_then(|response| response.values);
        let now = values.and_then(|all| all.first().map(|value| value.value == true)).unwrap_or(false);
        let mut best: Option<WhyStatus> = None;
        let mut block = 0;
        loop {
            let wanted = WhyWanted { operand: asked.to_owned(), now, inside: inside.clone(), block, wait_ms };
            let answer = client.ask(Op::Why(wanted))?.why;
            let answer = *answer.ok_or_else(|| AccessError::Refused("the station cannot say why".into()))?;
            block += 1;
            let more = block < answer.blocks.len();
            if best.as_ref().is_none_or(|best| answer.rank(now) >= best.rank(now)) {
                best = Some(answer);
            }
            if !more {
                break;
            }
        }
        best.ok_or_else(|| AccessError::Refused("nothing is known of it".into()))
    }
}

/// An answer as text.
fn text(why: &WhyStatus, depth: usize) -> String {
    let gap = "    ".repeat(depth);
    let mut out = String::new();
    let state = if why.outcome.is_empty() || why.operand.contains(' ') && is_block(&why.operand) {
        String::new()
    } else {
        format!(" is {}", u8::from(why.now))
    };
    let _ = writeln!(out, "{gap}{}{state}", why.operand);
    if why.writers.is_empty() {
        let what = match why.operand.get(..2) {
            Some("OB") => "the CPU calls it when its event comes",
            _ if is_block(&why.operand) => "no statement calls it: ob1 xref shows what may",
            Some("E " | "I ") => "it is an input: the sensor, its cable or the module decides",
            _ => "no statement writes it by its address: ob1 xref shows what may",
        };
        let _ = writeln!(out, "{gap}  {what}");
        return out;
    }
    if why.writers.len() > 1 {
        let verb = if is_block(&why.operand) { "called" } else { "written" };
        let _ = writeln!(out, "{gap}  {verb} at {} places: {}", why.writers.len(), why.writers.join("; "));
    }
    if why.outcome == "not called" {
        let _ = writeln!(out, "{gap}  {} was not called: it is written at {}", why.block, why.writers.join("; "));
        return out;
    }
    if let Some(statement) = &why.statement {
        let did = match (why.skipped, why.took_effect) {
            (true, _) => "not reached: led away by",
            (false, true) => "by",
            (false, false) => "left as it was by",
        };
        let _ = writeln!(out, "{gap}  {did} {}: {}", statement.place, statement.text);
    } else if why.skipped {
        let _ = writeln!(out, "{gap}  the statements that write it were not reached");
    }
    let decides = |term: &TermStatus| why.decisive.iter().any(|other| other.operand == term.operand);
    for term in &why.terms {
        let mark = if decides(term) || why.decisive.is_empty() && term.turns { "  <" } else { "" };
        let _ = writeln!(out, "{gap}    {} {:<24} {}{mark}", u8::from(term.bit), term.operand, term.statement.text);
    }
    let elsewhere = why.decisive.iter().filter(|term| !why.terms.iter().any(|own| own.operand == term.operand));
    for term in elsewhere {
        let _ = writeln!(out, "{gap}    {} {:<24} {}  <", u8::from(term.bit), term.operand, term.statement.place);
    }
    if why.decisive.is_empty() && !why.terms.is_empty() && !why.terms.iter().any(|term| term.turns) {
        let _ = writeln!(out, "{gap}  more than one of these must change");
    }
    out
}

fn is_block(operand: &str) -> bool {
    BlockId::parse(operand).is_some()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_station::access::why::StatementStatus;

    #[test]
    fn an_answer_marks_what_decides() {
        let statement = |place: &str, text: &str| StatementStatus { place: place.into(), text: text.into() };
        let term = |operand: &str, bit, turns, text: &str| TermStatus {
            statement: statement("OB 1, network 1, p.awl:4", text),
            operand: operand.into(),
            bit,
            turns,
            ..TermStatus::default()
        };
        let mut why = WhyStatus {
            operand: "A 4.0 \"Motor\"".into(),
            outcome: "whole".into(),
            blocks: vec!["OB 1".into()],
            writers: vec!["OB 1, network 1, p.awl:6".into()],
            block: "OB 1".into(),
            statement: Some(statement("OB 1, network 1, p.awl:6", "= A 4.0;")),
            took_effect: true,
            terms: vec![term("E 0.0 \"Guard\"", false, true, "U E 0.0;"), term("E 0.1", true, false, "U E 0.1;")],
            decisive: vec![term("E 0.0 \"Guard\"", false, true, "U E 0.0;")],
            ..WhyStatus::default()
        };
        let expected = "A 4.0 \"Motor\" is 0\n  by OB 1, network 1, p.awl:6: = A 4.0;\n    0 E 0.0 \"Guard\"            U E 0.0;  <\n    \
                        1 E 0.1                    U E 0.1;\n";
        assert_eq!(text(&why, 0), expected);
        why.decisive.clear();
        why.terms.iter_mut().for_each(|term| term.turns = false);
        assert!(text(&why, 1).ends_with("      more than one of these must change\n"), "{}", text(&why, 1));
    }
}

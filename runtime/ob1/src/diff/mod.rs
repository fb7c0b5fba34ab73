//! `ob1 diff`: what differs between two programs, wherever they are.

mod blocks;
mod pictures;
mod side;

use std::collections::BTreeSet;
use std::path::PathBuf;

use clap::Args;
use ob1_ir::Program;
use ob1_model::BlockId;
use ob1_stl::Library;
use serde_json::{Value, json};

use crate::exit::{DiffExit, told};
use crate::import::Unit;
use blocks::{Change, Text, difference};
use pictures::Pictures;
pub(crate) use side::Side;

/// Show what differs between two programs
///
/// A program is a station file or its folder, a STEP 7 project (folder, .s7p, .s7l, .zip), a folder of .mc7, sources,
/// or cpu:HOST for a CPU on the network. Blocks are compared by what they mean: names, comments and time stamps do not
/// count; declarations, start values and statements do.
#[derive(Clone, Debug, Args)]
#[command(
    after_help = "Examples:\n  ob1 diff plant.zip press/station.toml\n  ob1 diff press/station.toml cpu:192.168.0.10\n  \
    ob1 diff old.mc7 new.mc7 --json\n  ob1 diff plant.zip press --lad\n\n\
    With git: `*.mc7 diff=mc7` in .gitattributes, then\n  git config diff.mc7.textconv \"ob1 diff --text\"\n\n\
    Exit codes: 0 the same program, 1 another one, 2 one of them cannot be read."
)]
pub struct DiffArgs {
    /// The two programs, the older one first
    #[arg(required = true, num_args = 1..=2, value_name = "PROGRAM")]
    pub programs: Vec<PathBuf>,
    /// The program within each STEP 7 project, as `ob1 import --list` names it
    #[arg(long, value_name = "NAME")]
    pub program: Option<String>,
    /// Only these blocks: FC5, "DB 10"
    #[arg(long = "block", value_name = "BLOCK", value_parser = block)]
    pub blocks: Vec<ob1_model::BlockId>,
    /// The names of the blocks only, not their lines
    #[arg(long)]
    pub brief: bool,
    /// Networks that differ as one picture of both: - and red is gone, + and green is new
    #[arg(long, conflicts_with_all = ["text", "json", "brief"])]
    pub lad: bool,
    /// As JSON: same, gone, added, changed [{block, parts: [{at, lines: [{side, text}]}]}]
    #[arg(long, conflicts_with = "text")]
    pub json: bool,
    /// Print one program as text, for git's textconv
    #[arg(long)]
    pub text: bool,
    #[command(flatten)]
    pub(crate) unit: Unit,
}

fn block(text: &str) -> Result<ob1_model::BlockId, String> {
    BlockId::parse(text).ok_or_else(|| format!("\"{text}\" is not a block; write FC5 or DB 10"))
}

/// Compares; prints what there is to print.
pub fn diff(args: &DiffArgs) -> DiffExit {
    told(run(args), |_| DiffExit::Nothing)
}

fn run(args: &DiffArgs) -> Result<DiffExit, String> {
    let read = |program: &PathBuf| Side::read(program, args.program.as_deref(), &args.unit);
    let sides = args.programs.iter().map(read).collect::<Result<Vec<_>, _>>()?;
    match (sides.as_slice(), args.text) {
        ([one], true) => {
            one.texts(&args.blocks, true).values().flat_map(|text| &text.lines).for_each(|line| say!("{}", line.shown));
            Ok(DiffExit::Same)
        }
        ([old, new], false) => {
            Ok(compare(&Wanted { blocks: &args.blocks, brief: args.brief, json: args.json, lad: args.lad }, old, new))
        }
        (_, true) => Err("--text takes one program".to_owned()),
        (_, false) => Err("two programs are compared; --text prints one".to_owned()),
    }
}

/// Prints what differs between two programs that call the blocks of this library.
pub(crate) fn show_between((old, new): (Program, Program), library: &Library, titles: [&str; 2]) {
    let [before, after] = titles.map(str::to_owned);
    let (old, new) = (Side::of_program(before, old, library.clone()), Side::of_program(after, new, library.clone()));
    let _ = compare(&Wanted::default(), &old, &new);
}

/// How a difference is told.
#[derive(Clone, Copy, Debug, Default)]
struct Wanted<'a> {
    blocks: &'a [BlockId],
    brief: bool,
    json: bool,
    lad: bool,
}

fn compare(args: &Wanted<'_>, old: &Side, new: &Side) -> DiffExit {
    // What is in the data blocks of a CPU changes as long as it runs.
    let values = !old.runs && !new.runs;
    let (before, after) = (old.texts(args.blocks, values), new.texts(args.blocks, values));
    let (mut same, mut gone, mut added, mut changed) = (0, Vec::new(), Vec::new(), Vec::new());
    for id in before.keys().chain(after.keys()).collect::<BTreeSet<_>>() {
        match (before.get(id), after.get(id)) {
            (Some(a), Some(b)) if a.is_same(b) => same += 1,
            (Some(a), Some(b)) => changed.push((a, b, difference(a, b))),
            (Some(a), None) => gone.push(a),
            (None, Some(b)) => added.push(b),
            (None, None) => {}
        }
    }
    let other = gone.len() + added.len() + changed.len();
    if args.json {
        let names = |texts: &[&Text]| texts.iter().map(|text| text.id.to_string()).collect::<Vec<_>>();
        let changed: Vec<Value> = changed.iter().map(|(a, _, changes)| of_block(a, changes)).collect();
        say!("{}", json!({ "same": same, "gone": names(&gone), "added": names(&added), "changed": changed }));
    } else {
        say!("--- {}", old.title);
        say!("+++ {}", new.title);
        gone.iter().for_each(|text| say!("- {}", text.title()));
        added.iter().for_each(|text| say!("+ {}", text.title()));
        let pictures = (args.lad && !changed.is_empty()).then(|| Pictures::new(old, new));
        for (_, b, changes) in &changed {
            say!("~ {}", b.title());
            for change in changes.iter().filter(|_| !args.brief) {
                match pictures.as_ref().and_then(|pictures| pictures.of(b.id, &change.at)) {
                    Some(picture) => says!("{picture}"),
                    None => show(change),
                }
            }
        }
        say!("{other} {} different, {same} the same", if other == 1 { "block is" } else { "blocks are" });
    }
    if other == 0 { DiffExit::Same } else { DiffExit::Other }
}

fn show(change: &Change<'_>) {
    say!("  {}", change.at);
    for (side, line) in &change.lines {
        say!("  {side} {line}");
    }
}

fn of_block(text: &Text, changes: &[Change<'_>]) -> Value {
    let line = |(side, text): &(char, &str)| json!({ "side": side.to_string().trim(), "text": text });
    let part =
        |change: &Change<'_>| json!({ "at": change.at, "lines": change.lines.iter().map(line).collect::<Vec<_>>() });
    json!({ "block": text.id.to_string(), "parts": changes.iter().map(part).collect::<Vec<_>>() })
}

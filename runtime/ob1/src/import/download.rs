//! `ob1 download`: blocks into a CPU on the network.

use std::fmt;
use std::path::PathBuf;

use clap::Args;
use ob1_mc7::BlockImage;
use ob1_s7::client::jobs::{Device, Refused};
use ob1_s7::codes::Code;
use ob1_s7::wire::BlockType;

use super::block_files::{Blocks, collect};
use super::wire::{CpuArgs, Socket, connect};
use crate::exit::{ImportExit, told};

/// Most blocks that are linked together, if the PDU has room for their names, and most bytes of them: they fit what a
/// CPU puts aside.
const TOGETHER: usize = 64;
const TOGETHER_BYTES: usize = 512 * 1024;

/// What becomes of a CPU that was sent to STOP and has got a part of its program.
const STAYS: &str = "the CPU stays in STOP: its program may be part old, part new";

/// Load blocks into a CPU on the network
///
/// Loads blocks into an S7-300 or S7-400 (or another ob1) over S7 communication: files in machine code (.mc7), the
/// blocks of an `ob1 upload`, or the program of a station (.toml). Statements can be changed while the CPU is in STOP;
/// data blocks in RUN, too. The CPU gets all of it, or says why not.
#[derive(Clone, Debug, Args)]
#[command(after_help = "Examples:\n  ob1 download 192.168.0.10 press/uploaded/FC5.mc7\n  \
    ob1 download 127.0.0.1:10102 press --stop\n  ob1 download 192.168.0.10 press/station.toml --stop\n\n\
    Exit codes: 0 everything was loaded, 1 blocks were refused, 2 nothing could be loaded.\n\nMore: docs/s7-link.md.")]
pub struct DownloadArgs {
    #[command(flatten)]
    pub(crate) cpu: CpuArgs,
    /// Files in machine code, folders of them or of an upload, station files
    #[arg(required = true, value_name = "FILE|DIR")]
    pub blocks: Vec<PathBuf>,
    /// Send the CPU to STOP first, and restart it afterwards, unless only some blocks were loaded
    #[arg(long)]
    pub stop: bool,
}

/// Downloads; prints what there is to print.
pub fn download(args: &DownloadArgs) -> ImportExit {
    told(run(args), |_| ImportExit::Nothing)
}

fn run(args: &DownloadArgs) -> Result<ImportExit, String> {
    let blocks = collect(&args.blocks)?;
    if blocks.is_empty() {
        return Err("there is no block to load; `ob1 upload` makes files of blocks".into());
    }
    let mut device = connect(&args.cpu)?;
    if args.stop {
        match device.stop().map_err(|error| error.0)? {
            // It is in STOP already.
            Ok(()) | Err(Refused::Job(Code::COORDINATION)) => {}
            Err(why) => return Err(format!("the CPU does not go to STOP: {why}")),
        }
    }
    let in_stop = |why: String| if args.stop { format!("{why}; {STAYS}") } else { why };
    let refused = load_all(&mut device, blocks.clone()).map_err(in_stop)?;
    for group in &refused {
        err!("{group}");
    }
    let left_out: usize = refused.iter().map(|group| group.names.len()).sum();
    say!("{} of {} blocks were loaded", blocks.len() - left_out, blocks.len());
    let is_half = left_out > 0 && left_out < blocks.len();
    if args.stop && is_half {
        err!("ob1: {STAYS}\n  = load the blocks that were refused, or the earlier ones again, then start it");
    } else if args.stop {
        let started = device.control(b"", b"P_PROGRAM").map_err(|error| error.0)?;
        started.map_err(|why| format!("the CPU does not start again: {why}"))?;
    }
    Ok(match left_out {
        0 => ImportExit::Whole,
        all if all == blocks.len() => ImportExit::Nothing,
        _ => ImportExit::Incomplete,
    })
}

/// Blocks that were to be linked together, and were refused.
#[derive(Debug)]
struct RefusedGroup {
    names: Vec<String>,
    /// The one that was refused before they were linked.
    at_fault: Option<String>,
    why: Refused,
}

impl fmt::Display for RefusedGroup {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let hint = match self.why {
            Refused::Job(Code::COORDINATION) => "; --stop sends the CPU to STOP first",
            _ => "",
        };
        let why = &self.why;
        if let [name] = self.names.as_slice() {
            return write!(f, "{name}: {why}{hint}");
        }
        let (count, names) = (self.names.len(), self.names.join(", "));
        match (&self.at_fault, why) {
            (Some(name), _) => {
                write!(f, "{name}: {why}{hint}\n  = it and what is linked with it were not loaded: {names}")
            }
            // Linking is one job: its answer names no block.
            (None, Refused::Job(Code::BLOCK | Code::NO_BLOCK)) => write!(
                f,
                "{count} blocks that are linked together: one of them is refused, {why}\n  = an ob1 names it in its \
                 log; none of these was loaded: {names}"
            ),
            (None, _) => write!(f, "{count} blocks that are linked together: {why}{hint}\n  = these are: {names}"),
        }
    }
}

/// Loads the blocks; returns those that were refused for good. One that needs another is loaded after it, in the next
/// round.
fn load_all(device: &mut Device<Socket>, blocks: Blocks) -> Result<Vec<RefusedGroup>, String> {
    let mut groups = together(blocks, device.linkable().min(TOGETHER));
    loop {
        let (before, mut refused) = (groups.len(), Vec::new());
        let mut left = Vec::new();
        for group in groups {
            if let Err((at_fault, why)) = load(device, &group)? {
                refused.push(RefusedGroup { names: group.keys().cloned().collect(), at_fault, why });
                left.push(group);
            }
        }
        if left.is_empty() || left.len() == before {
            return Ok(refused);
        }
        groups = left;
    }
}

/// Groups that fit: at most this many blocks in each.
fn together(blocks: Blocks, most: usize) -> Vec<Blocks> {
    let mut groups: Vec<Blocks> = Vec::new();
    let mut bytes = 0;
    for (name, block) in blocks {
        bytes += block.len();
        match groups.last_mut() {
            Some(group) if group.len() < most && bytes <= TOGETHER_BYTES => drop(group.insert(name, block)),
            _ => {
                bytes = block.len();
                groups.push(Blocks::from([(name, block)]));
            }
        }
    }
    groups
}

/// Loads blocks and links them, together. A refusal has the block at fault, if it was refused before the linking.
fn load(device: &mut Device<Socket>, group: &Blocks) -> Result<Result<(), (Option<String>, Refused)>, String> {
    let mut names = Vec::new();
    for (name, bytes) in group {
        let (ty, number) = named(bytes).ok_or_else(|| format!("{name} is not a block of a program"))?;
        if let Err(why) = device.download(ty, number, bytes).map_err(|error| error.0)? {
            return Ok(Err((Some(name.clone()), why)));
        }
        names.push((ty, number));
    }
    Ok(device.link(&names).map_err(|error| error.0)?.map_err(|why| (None, why)))
}

fn named(bytes: &[u8]) -> Option<(BlockType, u16)> {
    let (block, _) = BlockImage::read(bytes).ok()?;
    Some((BlockType::of_head(block.head.kind)?, block.head.number))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Which block is at fault is said where the CPU says it, and nowhere else.
    #[test]
    fn refused_blocks_are_told_once() {
        let told = |names: &[&str], at_fault: Option<&str>, code: Code| {
            let names = names.iter().map(|name| (*name).to_owned()).collect();
            RefusedGroup { names, at_fault: at_fault.map(str::to_owned), why: Refused::Job(code) }.to_string()
        };
        assert_eq!(told(&["FC5"], None, Code::BLOCK), format!("FC5: {}", Code::BLOCK));
        let linked = told(&["FC1", "FC2"], None, Code::BLOCK);
        assert!(linked.starts_with("2 blocks that are linked together: one of them is refused"), "{linked}");
        assert!(linked.ends_with("FC1, FC2"), "{linked}");
        let named = told(&["FC1", "FC2"], Some("FC2"), Code::PROTECTED);
        assert!(named.starts_with(&format!("FC2: {}\n", Code::PROTECTED)), "{named}");
        let in_run = told(&["FC1", "FC2"], None, Code::COORDINATION);
        assert!(in_run.contains("--stop") && !in_run.contains("one of them"), "{in_run}");
    }
}

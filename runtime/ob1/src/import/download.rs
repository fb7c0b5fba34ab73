//! `ob1 download`: blocks into a CPU on the network.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use clap::Args;
use ob1_mc7::BlockImage;
use ob1_model::{BlockId, BlockKind};
use ob1_s7::client::jobs::{Device, Refused};
use ob1_s7::codes::Code;
use ob1_s7::wire::BlockType;
use ob1_station::{files, program, station_file};

use super::upload::{Blocks, UPLOADED};
use super::wire::{CpuArgs, Socket, connect};
use crate::exit::ImportExit;

/// Most blocks that are linked together, and most bytes of them: their names fit any PDU we ask for, the blocks fit
/// what a CPU puts aside.
const TOGETHER: usize = 64;
const TOGETHER_BYTES: usize = 512 * 1024;

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
    /// Send the CPU to STOP first, and restart it afterwards
    #[arg(long)]
    pub stop: bool,
}

/// Downloads; prints what there is to print.
#[must_use]
pub fn download(args: &DownloadArgs) -> ImportExit {
    run(args).unwrap_or_else(|text| {
        err!("ob1: {text}");
        ImportExit::Nothing
    })
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
    let refused = load_all(&mut device, blocks.clone())?;
    for (name, why) in &refused {
        let in_run = *why == Refused::Job(Code::COORDINATION);
        err!("{name}: {why}{}", if in_run { "; --stop sends the CPU to STOP first" } else { "" });
    }
    say!("{} of {} blocks were loaded", blocks.len() - refused.len(), blocks.len());
    if args.stop {
        let started = device.control(b"", b"P_PROGRAM").map_err(|error| error.0)?;
        started.map_err(|why| format!("the CPU does not start again: {why}"))?;
    }
    Ok(match refused.len() {
        0 => ImportExit::Whole,
        all if all == blocks.len() => ImportExit::Nothing,
        _ => ImportExit::LeftOut,
    })
}

/// Loads the blocks; returns those that were refused for good. One that needs another is loaded after it, in the next
/// round.
fn load_all(device: &mut Device<Socket>, blocks: Blocks) -> Result<BTreeMap<String, Refused>, String> {
    let mut groups = together(blocks);
    loop {
        let (before, mut refused) = (groups.len(), BTreeMap::new());
        let mut left = Vec::new();
        for group in groups {
            if let Err(why) = load(device, &group)? {
                refused.extend(group.keys().map(|name| (name.clone(), why)));
                left.push(group);
            }
        }
        if left.is_empty() || left.len() == before {
            return Ok(refused);
        }
        groups = left;
    }
}

/// Groups that fit.
fn together(blocks: Blocks) -> Vec<Blocks> {
    let mut groups: Vec<Blocks> = Vec::new();
    let mut bytes = 0;
    for (name, block) in blocks {
        bytes += block.len();
        match groups.last_mut() {
            Some(group) if group.len() < TOGETHER && bytes <= TOGETHER_BYTES => drop(group.insert(name, block)),
            _ => {
                bytes = block.len();
                groups.push(Blocks::from([(name, block)]));
            }
        }
    }
    groups
}

/// Loads blocks and links them, together.
fn load(device: &mut Device<Socket>, group: &Blocks) -> Result<Result<(), Refused>, String> {
    let mut names = Vec::new();
    for (name, bytes) in group {
        let (ty, number) = named(bytes).ok_or_else(|| format!("{name} is no block of a program"))?;
        if let Err(why) = device.download(ty, number, bytes).map_err(|error| error.0)? {
            return Ok(Err(why));
        }
        names.push((ty, number));
    }
    device.link(&names).map_err(|error| error.0)
}

fn named(bytes: &[u8]) -> Option<(BlockType, u16)> {
    let (block, _) = BlockImage::read(bytes).ok()?;
    Some((BlockType::of_head(block.head.kind)?, block.head.number))
}

/// The blocks of files and folders, by their names.
pub(super) fn collect(paths: &[PathBuf]) -> Result<Blocks, String> {
    let mut blocks = Blocks::new();
    for path in paths {
        let uploaded = path.join(UPLOADED);
        let is = |ending: &str| path.extension().is_some_and(|end| end.eq_ignore_ascii_case(ending));
        if uploaded.is_dir() {
            folder(&uploaded, &mut blocks)?;
        } else if path.is_dir() {
            folder(path, &mut blocks)?;
        } else if is("toml") {
            station(path, &mut blocks)?;
        } else {
            file(path, &mut blocks)?;
        }
    }
    Ok(blocks)
}

fn folder(path: &Path, blocks: &mut Blocks) -> Result<(), String> {
    let refused = |error: std::io::Error| format!("{}: {error}", path.display());
    let mut found = false;
    for entry in std::fs::read_dir(path).map_err(refused)? {
        let path = entry.map_err(refused)?.path();
        if path.extension().is_some_and(|end| end.eq_ignore_ascii_case("mc7")) {
            file(&path, blocks)?;
            found = true;
        }
    }
    if found { Ok(()) } else { Err(format!("{}: no .mc7 lies there; `ob1 upload` makes them", path.display())) }
}

/// A file may hold several blocks, one after another.
fn file(path: &Path, blocks: &mut Blocks) -> Result<(), String> {
    let bytes = files::read(path, files::LONGEST).map_err(|error| format!("{}: {error}", path.display()))?;
    let mut rest = bytes.as_slice();
    while !rest.is_empty() {
        let (block, length) = BlockImage::read(rest).map_err(|why| format!("{}: {why}", path.display()))?;
        let kind = block.head.block_kind().ok_or_else(|| format!("{}: system data", path.display()))?;
        let (bytes, after) = rest.split_at_checked(length).unwrap_or((rest, &[]));
        blocks.insert(name(BlockId::new(kind, block.head.number)), bytes.to_vec());
        rest = after;
    }
    Ok(())
}

/// The program of a station, as machine code.
fn station(path: &Path, blocks: &mut Blocks) -> Result<(), String> {
    let told =
        |findings: &[ob1_station::finding::Finding]| findings.iter().map(ToString::to_string).collect::<String>();
    let station = station_file::load(path).map_err(|findings| told(&findings))?;
    let loaded = program::load(&station).map_err(|failure| told(failure.findings()))?;
    let library = program::library(&loaded.plugins, &station.program.library).map_err(|findings| told(&findings))?;
    let callee = |id| library.get(id).map(|block| &block.interface);
    let code = loaded.program.blocks.iter().map(|block| block.id);
    let data = loaded.program.data.iter().map(|db| BlockId::new(BlockKind::Db, db.number));
    for id in code.chain(data) {
        let image = ob1_mc7::image(&loaded.program, id, &callee).and_then(|image| image.bytes().ok());
        let image = image.ok_or_else(|| format!("{id} has a statement for which there is no machine code"))?;
        blocks.insert(name(id), image);
    }
    Ok(())
}

/// `FC5`, as files are named.
fn name(id: BlockId) -> String {
    format!("{}{}", id.kind.name(), id.number)
}

//! `ob1 upload` and `ob1 compare`: the program of a CPU on the network becomes a station, or is compared with one.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use clap::Args;
use ob1_ir::Program;
use ob1_mc7::BlockImage;
use ob1_model::BlockId;
use ob1_project::{CodePage, Folder, Note, Notes, SymbolRow};
use ob1_s7::client::Observer;
use ob1_s7::wire::BlockType;
use ob1_stl::{Library, Mnemonics};

use super::block_files::{Blocks, UPLOADED, collect};
use super::hardware::Hardware;
use super::profibus::GsdFiles;
use super::wire::{CpuArgs, Socket, observe};
use super::{INTERNATIONAL, exit, outcome, output, report, station, station_name, taken_of, translated};
use crate::exit::{DiffExit, ImportExit, told};

/// The types of blocks a program is made of.
const TYPES: [BlockType; 4] = [BlockType::Ob, BlockType::Fb, BlockType::Fc, BlockType::Db];
/// The code page of names, which have no other: eight characters each.
const PAGE: u16 = 1252;

/// Make a station of the program of a CPU on the network
///
/// Reads every block of an S7-300 or S7-400 (or of another ob1) over S7 communication, and makes a station of them as
/// `ob1 import` does. A CPU holds no names: variables are called IN0, OUT0, STAT0, unless an old project of the plant
/// still has them (--names-from). Nothing in the CPU is changed.
#[derive(Clone, Debug, Args)]
#[command(
    after_help = "Examples:\n  ob1 upload 192.168.0.10 --out press\n  ob1 upload 127.0.0.1:10102 --slot 2 --out copy\n\n\
    Exit codes: 0 the whole program was uploaded, 1 blocks were left out or the\nstation does not start yet, 2 nothing could be read or written.\n\nMore: docs/s7-link.md."
)]
pub struct UploadArgs {
    #[command(flatten)]
    pub(crate) cpu: CpuArgs,
    /// Where the station is written: a folder that is not there yet, or is empty
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Write over a station that lies there already
    #[arg(long)]
    pub overwrite: bool,
    /// An old project of the plant: its names, symbols and comments
    #[arg(long, value_name = "PROJECT")]
    pub names_from: Option<PathBuf>,
    /// The program in that project, as `ob1 import --list` names it
    #[arg(long, value_name = "NAME", requires = "names_from")]
    pub program: Option<String>,
    /// Print the outcome as JSON: programs, program, blocks, decoded, left_out, files
    #[arg(long)]
    pub json: bool,
}

/// Compare the program of a CPU on the network with an upload
///
/// Tells which blocks of the CPU differ from those in the folder of an `ob1 upload`, or of a station (its .toml):
/// changed, missing, or additional. Of data blocks the declarations and the length count, not the values.
#[derive(Clone, Debug, Args)]
#[command(after_help = "Examples:\n  ob1 compare 192.168.0.10 press\n  \
    ob1 compare 192.168.0.10 press/station.toml\n\n\
    Exit codes: 0 the same program, 1 another one, 2 nothing could be read.\n\nMore: docs/s7-link.md.")]
pub struct CompareArgs {
    #[command(flatten)]
    pub(crate) cpu: CpuArgs,
    /// The folder of the upload, or a station file
    pub folder: PathBuf,
}

/// Uploads; prints what there is to print.
pub fn upload(args: &UploadArgs) -> ImportExit {
    told(run(args), |_| ImportExit::Nothing)
}

fn run(args: &UploadArgs) -> Result<ImportExit, String> {
    let mut device = observe(&args.cpu)?;
    let notes = about(&mut device)?;
    let (blocks, refused) = read(&mut device)?;
    let wanted = OfBlocks {
        title: format!("CPU {}", args.cpu.host),
        out: (&args.out, args.overwrite),
        names: args.names_from.as_deref().map(|path| (path, args.program.as_deref())),
        set: INTERNATIONAL,
        json: args.json,
    };
    station_of(&wanted, &blocks, refused, notes)
}

/// A station to make of blocks in machine code.
pub(super) struct OfBlocks<'a> {
    /// Where they are from.
    pub(super) title: String,
    /// Where it is written, and whether over another.
    pub(super) out: (&'a Path, bool),
    /// The old project with their names, and the program in it.
    pub(super) names: Option<(&'a Path, Option<&'a str>)>,
    pub(super) set: Mnemonics,
    pub(super) json: bool,
}

/// Makes the station; prints what there is to print. `refused`: blocks that were not given.
pub(super) fn station_of(
    wanted: &OfBlocks<'_>,
    blocks: &Blocks,
    refused: BTreeMap<String, String>,
    mut notes: Notes,
) -> Result<ImportExit, String> {
    let title = &wanted.title;
    let mut folder = Folder::of_upload(blocks.clone());
    if folder.blocks.is_empty() {
        let why = refused.values().chain(folder.damaged.values()).next().map_or("it has no blocks", String::as_str);
        return Err(format!("{title}: nothing could be read: {why}"));
    }
    let (page, rows) = match wanted.names {
        Some((path, program)) => old_names(path, program, &mut folder, &mut notes)?,
        None => (page()?, Vec::new()),
    };
    let (symbols, known) = output::symbol_table(&rows);
    let (replaced, _, mut translation) = translated(&folder, page, known, wanted.set)?;
    translation.blocks += refused.len();
    translation.left_out.extend(refused);
    let named = station::Named { title, name: station_name(wanted.out.0), set: wanted.set, scl: &[] };
    let made = station::make(&named, (&folder, &translation), &Hardware::default(), &replaced, &GsdFiles::default());
    notes.extend(replaced.notes.clone());
    let mut written = output::write(wanted.out, title, &translation, &symbols, &made, &notes)?;
    written.files.extend(keep(wanted.out.0, blocks)?);
    if wanted.json {
        say!("{}", outcome(std::slice::from_ref(title), Some(title), &translation, Some(&written)));
    } else {
        says!("{}", report::summary(title, &translation, wanted.out.0, &written.errors));
    }
    Ok(exit(&translation, &written))
}

/// Lays the names of an old project over blocks; its code page, and its symbols as far as they mean the same here.
fn old_names(
    path: &Path,
    program: Option<&str>,
    folder: &mut Folder,
    notes: &mut Notes,
) -> Result<(CodePage, Vec<SymbolRow>), String> {
    let (old, mut rows) = taken_of(path, program)?;
    let names = folder.take_names(&old.folder);
    let (all, with) = (folder.blocks.keys().filter(|id| !id.kind.is_system()).count(), names.taken.len());
    notes.push(Note::info("names", format!("{with} of {all} blocks have the names of {}", old.title)));
    notes.extend(names.notes);
    let here = |id: BlockId| names.taken.iter().find(|(_, old)| **old == id).map(|(here, _)| *here);
    rows.retain_mut(|row| {
        // A block that the project numbers otherwise, or that is another one here.
        if let Some(here) = BlockId::parse(&row.ty).and_then(here) {
            row.ty = here.to_string();
        }
        let Some(id) = BlockId::parse(&row.international) else { return true };
        match here(id) {
            Some(here) if here != id => (row.german, row.international) = (here.to_string(), here.to_string()),
            Some(_) => {}
            None => return id.kind.is_system() || !folder.blocks.contains_key(&id),
        }
        true
    });
    Ok((old.project.page, rows))
}

/// The code page of the texts in uploaded blocks.
fn page() -> Result<CodePage, String> {
    Ok(CodePage::of_number(PAGE).ok_or("there is no code page 1252")?)
}

/// The program that uploaded blocks make, and what it calls.
fn program_of(blocks: Blocks) -> Result<(Program, Library), String> {
    let (_, library, translation) = translated(&Folder::of_upload(blocks), page()?, Vec::new(), INTERNATIONAL)?;
    Ok((translation.program, library))
}

/// The program of a CPU on the network, and what it calls.
///
/// # Errors
/// Why it cannot be read, the first block that it does not give.
pub(crate) fn program_of_cpu(cpu: &CpuArgs) -> Result<(Program, Library), String> {
    let (blocks, refused) = read(&mut observe(cpu)?)?;
    match refused.into_iter().next() {
        Some((block, why)) => Err(format!("{}: {block}: {why}", cpu.host)),
        None => program_of(blocks),
    }
}

/// The program of blocks in machine code, and what it calls.
///
/// # Errors
/// Why they cannot be read.
pub(crate) fn program_of_blocks(path: &Path) -> Result<(Program, Library), String> {
    program_of(collect(&[path.to_owned()])?)
}

/// Which CPU it is, and what its clock says.
fn about(device: &mut Observer<Socket>) -> Result<Notes, String> {
    let mut notes = Notes::new();
    // What a CPU does not tell is not needed.
    if let Ok((record, records)) = device.szl(0x0011, 0).map_err(|error| error.0)? {
        for module in records.chunks_exact(usize::from(record).max(1)) {
            let order = module.get(2..22).map(|text| String::from_utf8_lossy(text).trim().to_owned());
            let order = order.filter(|order| !order.is_empty() && record >= 22);
            notes.extend(order.map(|order| Note::info("CPU", format!("identifies itself as {order}"))));
        }
    }
    if let Ok(time) = device.clock().map_err(|error| error.0)? {
        let told = format!(
            "its clock says {}-{:02}-{:02} {:02}:{:02}:{:02}",
            time.year, time.month, time.day, time.hour, time.minute, time.second
        );
        notes.push(Note::info("CPU", told));
    }
    Ok(notes)
}

/// All blocks of the program, and those the CPU does not give.
fn read(device: &mut Observer<Socket>) -> Result<(Blocks, BTreeMap<String, String>), String> {
    let (mut blocks, mut refused) = (Blocks::new(), BTreeMap::new());
    for ty in TYPES {
        let listed = device.blocks(ty).map_err(|error| error.0)?;
        let numbers = listed.map_err(|why| format!("the list of {}s: {why}", ty.name()))?;
        for number in numbers {
            let name = format!("{}{number}", ty.name());
            match device.upload(ty, number).map_err(|error| error.0)? {
                Ok(bytes) => drop(blocks.insert(name, bytes)),
                Err(why) => drop(refused.insert(name, why.to_string())),
            }
        }
    }
    Ok((blocks, refused))
}

/// Keeps the blocks as they came, for `ob1 compare`.
fn keep(out: &Path, blocks: &Blocks) -> Result<Vec<String>, String> {
    let folder = out.join(UPLOADED);
    let refused = |error: std::io::Error| format!("{}: {error}", folder.display());
    std::fs::create_dir_all(&folder).map_err(refused)?;
    let mut files = Vec::new();
    for (name, bytes) in blocks {
        std::fs::write(folder.join(format!("{name}.mc7")), bytes).map_err(refused)?;
        files.push(format!("{UPLOADED}/{name}.mc7"));
    }
    Ok(files)
}

/// Compares; prints what there is to print.
pub fn compare(args: &CompareArgs) -> DiffExit {
    told(held_against(args), |_| DiffExit::Nothing)
}

fn held_against(args: &CompareArgs) -> Result<DiffExit, String> {
    let kept = collect(std::slice::from_ref(&args.folder))?;
    let (there, _) = read(&mut observe(&args.cpu)?)?;
    let names: BTreeSet<&String> = kept.keys().chain(there.keys()).collect();
    let mut other = 0;
    for name in names {
        let told = match (kept.get(name), there.get(name)) {
            (Some(kept), Some(there)) if same(kept, there) => continue,
            (Some(_), Some(_)) => "differs in the CPU",
            (Some(_), None) => "is not in the CPU",
            (None, _) => "is in the CPU only",
        };
        say!("{name} {told}");
        other += 1;
    }
    say!("{} blocks in the CPU, differences from {}: {other}", there.len(), args.folder.display());
    Ok(if other == 0 { DiffExit::Same } else { DiffExit::Other })
}

/// The values of a data block change as long as the CPU runs.
fn same(kept: &[u8], there: &[u8]) -> bool {
    match (BlockImage::read(kept), BlockImage::read(there)) {
        (Ok((a, _)), Ok((b, _))) if a.head.block_kind() == Some(ob1_model::BlockKind::Db) => {
            a.code.len() == b.code.len() && a.interface == b.interface
        }
        (Ok((a, _)), Ok((b, _))) => (a.code, a.interface, a.segments) == (b.code, b.interface, b.segments),
        _ => kept == there,
    }
}

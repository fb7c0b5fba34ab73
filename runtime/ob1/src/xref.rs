//! `ob1 xref`: who reads and writes what; who calls whom; what is free, unused, written twice.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use ob1_ir::Program;
use ob1_stl::{CrossReference, Library, Match, Mnemonics, Reference, Uses};
use serde_json::{Value, json};

use crate::check::misplaced;
use crate::exit::Exit;
use crate::language::Language;
use ob1_station::plugins;
use ob1_station::program;
use ob1_station_file::finding::{Finding, Level};
use ob1_station_file::findings::UNKNOWN_NAME;
use ob1_station_file::library::Chosen;
use ob1_station_file::sources::Sources;
use ob1_station_file::{self, Plugin};

/// Places that may be meant are listed up to this number.
const POSSIBLE: usize = 40;

/// The cross-reference of a program: who reads and writes what
#[derive(Clone, Debug, Args)]
#[command(after_help = "Examples:\n  ob1 xref press.toml\n  ob1 xref press.toml --operand \"I 8.0\"\n  \
    ob1 xref main.awl lib.awl --symbols press.sdf --operand \"MW 10\"\n  ob1 xref press.toml --calls\n  \
    ob1 xref press.toml --assignment --mnemonics en\n\n\
    --operand takes both sets of mnemonics (E 8.0, I 8.0), symbols, components (DB10.speed), blocks (FB 20), names of a\n\
    block (FB 20 #speed) and parts: IW 8, E 8 (the byte), DB 10 (all of it), M (all of it), indirect (what is known at\n\
    run time only). What overlaps is found; what may, because its address is known at run time only, is listed apart.\n\n\
    R reads, W writes, RW both, call, open, ptr loads a pointer to it. Exit codes: 0, or 1 when the program cannot be\n\
    compiled or the name is unknown.")]
pub struct XrefArgs {
    /// Sources (.awl), folders of them, or one station file (.toml)
    #[arg(required = true)]
    pub files: Vec<PathBuf>,
    /// A symbol table of the sources (a station file names its own)
    #[arg(long, value_name = "FILE")]
    pub symbols: Vec<PathBuf>,
    /// Mnemonics of the answer, and of bare sources; without it those of the program
    #[arg(long, value_enum, default_value_t = Language::Auto)]
    pub mnemonics: Language,
    /// A plugin whose blocks the sources call
    #[arg(long, value_name = "PATH")]
    pub plugin: Vec<String>,
    /// Standard blocks of the sources: FC4=IEC:FC4, or a whole library: IEC
    #[arg(long, alias = "standard", value_name = "FC4=IEC:FC4,...", value_delimiter = ',', value_parser = Chosen::parse)]
    pub library: Vec<Chosen>,
    /// Only what reaches this operand, symbol, component or block
    #[arg(long, value_name = "NAME")]
    pub operand: Option<String>,
    /// The call structure instead: who calls whom, and what nothing calls
    #[arg(long, conflicts_with_all = ["operand", "json"])]
    pub calls: bool,
    /// The assignment list instead: which inputs, outputs, flags, timers and counters are used, and which are free
    #[arg(long, conflicts_with_all = ["operand", "calls", "json"])]
    pub assignment: bool,
    /// The symbols that no statement uses instead
    #[arg(long, conflicts_with_all = ["operand", "calls", "assignment"])]
    pub unused: bool,
    /// The outputs that more than one statement writes instead
    #[arg(long, conflicts_with_all = ["operand", "calls", "assignment", "unused"])]
    pub twice: bool,
    /// As a JSON array of {operand, symbol, indirect, access, block, network, line, file, via, match}
    #[arg(long)]
    pub json: bool,
}

/// A program to be asked, with the blocks that it calls.
pub(crate) struct Asked {
    pub(crate) program: Program,
    pub(crate) library: Library,
    /// The set of the answer.
    set: Mnemonics,
}

impl Asked {
    /// That of a station file.
    pub(crate) fn of_station(file: &Path) -> Result<Self, Vec<Finding>> {
        let loaded = program::load(&ob1_station_file::load(file)?)?;
        let library = program::library(&loaded.plugins, &loaded.standard)?;
        Ok(Self { program: Arc::unwrap_or_clone(loaded.program), library, set: loaded.mnemonics })
    }

    /// That of sources, and of plugins that they call.
    pub(crate) fn of_sources(wanted: &Sources, plugins: &[Plugin]) -> Result<Self, Vec<Finding>> {
        let plugins = plugins::load(plugins)?;
        let compiled = program::compile(wanted, &program::library(&plugins, &wanted.library)?)?;
        let standard = program::in_use(&compiled.program, &wanted.library, &compiled.demanded);
        let library = program::library(&plugins, &standard)?;
        Ok(Self { program: compiled.program, library, set: compiled.mnemonics })
    }
}

/// Runs `ob1 xref`: prints the cross-reference, and says how it ended.
pub fn xref(args: &XrefArgs) -> Exit {
    let asked = match asked(args) {
        Ok(asked) => asked,
        Err(findings) => {
            findings.iter().filter(|f| f.level == Level::Error).for_each(|f| err!("{f}"));
            return Exit::Usage;
        }
    };
    let all = CrossReference::new(&asked.program, &asked.library);
    if args.calls {
        says!("{}", all.calls());
    } else if args.assignment {
        says!("{}", all.assignment().render(asked.set));
    } else if args.unused {
        return unused(&all, &asked, args.json);
    } else if args.twice {
        return twice(&all, &asked, args.json);
    } else if let Some(wanted) = &args.operand {
        return uses(&all, &asked, wanted, args.json);
    } else if args.json {
        return list(all.all.iter().map(|reference| to_json(reference, Match::Same, &asked)));
    } else {
        says!("{}", ob1_stl::render_xref(&all.all, &asked.program, asked.set));
    }
    Exit::Ok
}

fn list(all: impl Iterator<Item = Value>) -> Exit {
    crate::remote::print_json(&all.collect::<Vec<_>>())
}

/// The uses of one operand.
fn uses(all: &CrossReference<&Program>, asked: &Asked, wanted: &str, json: bool) -> Exit {
    let uses = match all.find(wanted) {
        Ok(uses) => uses,
        Err(unknown) => {
            err!("ob1: error {UNKNOWN_NAME}: {unknown}\n  = {}", unknown.remedy);
            return Exit::Usage;
        }
    };
    if json {
        return list(uses.found.iter().map(|(how, reference)| to_json(reference, *how, asked)));
    }
    says!("{}", told(&uses, asked));
    Exit::Ok
}

fn told(uses: &Uses<'_>, asked: &Asked) -> String {
    let of = |wanted: fn(Match) -> bool| -> Vec<&Reference> {
        uses.found.iter().filter(|(how, _)| wanted(*how)).map(|(_, reference)| *reference).collect()
    };
    let symbol = uses.symbol.as_ref().map(|symbol| format!(" \"{symbol}\"")).unwrap_or_default();
    let name = format!("{}{symbol}", ob1_stl::in_set(&uses.operand, asked.set));
    let certain = of(|how| how != Match::Possible);
    let mut text = if certain.is_empty() {
        format!("no statement uses {name} by its address\n")
    } else {
        ob1_stl::render_xref(certain, &asked.program, asked.set)
    };
    let possible = of(|how| how == Match::Possible);
    if !possible.is_empty() {
        text += &format!("{name} may also be reached by what is known at run time only:\n");
        text += &ob1_stl::render_xref(possible.iter().copied().take(POSSIBLE), &asked.program, asked.set);
        if possible.len() > POSSIBLE {
            text += &format!("    and {} more: --operand indirect\n", possible.len() - POSSIBLE);
        }
    }
    text
}

fn unused(all: &CrossReference<&Program>, asked: &Asked, json: bool) -> Exit {
    let unused = all.unused();
    if json {
        return list(unused.iter().map(|symbol| json!({ "symbol": symbol.name, "address": symbol.address })));
    }
    for symbol in &unused {
        say!("{:<12} \"{}\"", ob1_stl::in_set(&symbol.address, asked.set), symbol.name);
    }
    if unused.is_empty() {
        say!("each symbol is used");
    }
    Exit::Ok
}

fn twice(all: &CrossReference<&Program>, asked: &Asked, json: bool) -> Exit {
    let twice = all.written_twice();
    if json {
        let name = |name: &String| ob1_stl::in_set(name, asked.set);
        return list(twice.iter().map(|one| {
            let writers: Vec<Value> = one.writers.iter().map(|r| to_json(r, Match::Overlap, asked)).collect();
            json!({ "outputs": one.outputs.iter().map(name).collect::<Vec<_>>(), "writers": writers })
        }));
    }
    for one in &twice {
        let names: Vec<String> = one.outputs.iter().map(|name| ob1_stl::in_set(name, asked.set)).collect();
        say!("{}", names.join(", "));
        for writer in &one.writers {
            let by = if one.outputs.first() == Some(&writer.operand) { "" } else { &writer.operand_in(asked.set) };
            say!("    {:<4}  {}  {by}", writer.access.name(), writer.place(&asked.program));
        }
    }
    if twice.is_empty() {
        say!("each output is written at one place");
    }
    Exit::Ok
}

fn asked(args: &XrefArgs) -> Result<Asked, Vec<Finding>> {
    if let [file] = args.files.as_slice()
        && ob1_station_file::is_station_file(file)
    {
        let options = [
            ("--symbols", !args.symbols.is_empty()),
            ("--plugin", !args.plugin.is_empty()),
            ("--library", !args.library.is_empty()),
        ];
        if let Some(finding) = misplaced(file, &options) {
            return Err(vec![finding]);
        }
        let asked = Asked::of_station(file)?;
        return Ok(Asked { set: args.mnemonics.or(asked.set), ..asked });
    }
    let plugins: Vec<Plugin> = args.plugin.iter().map(|name| Plugin::of_name(name)).collect();
    let sources = Sources {
        files: args.files.clone(),
        symbols: args.symbols.clone(),
        mnemonics: args.mnemonics.into(),
        library: Chosen::settled(&args.library)?,
        ..Sources::default()
    };
    let asked = Asked::of_sources(&sources, &plugins)?;
    Ok(Asked { set: args.mnemonics.or(asked.set), ..asked })
}

fn to_json(r: &Reference, how: Match, asked: &Asked) -> Value {
    json!({
        "operand": r.operand_in(asked.set),
        "symbol": r.symbol,
        "indirect": r.indirect,
        "access": r.access.name(),
        "block": r.block.to_string(),
        "network": r.network,
        "line": r.line,
        "file": asked.program.sources.get(r.source as usize),
        "via": r.via,
        "match": match how {
            Match::Same => "same",
            Match::Overlap => "overlap",
            Match::Possible => "possible",
        },
    })
}

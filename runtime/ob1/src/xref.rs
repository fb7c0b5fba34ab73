//! `ob1 xref`: who reads and writes what.

use std::path::PathBuf;

use clap::Args;
use ob1_stl::Reference;
use serde_json::{Value, json};

use crate::check::misplaced;
use crate::exit::Exit;
use crate::language::Language;
use ob1_station::finding::{Finding, Level};
use ob1_station::library::Chosen;
use ob1_station::program::{self, LoadFailure};
use ob1_station::sources::Sources;
use ob1_station::station_file::{self, Plugin};

/// The cross-reference of a program: who reads and writes what
#[derive(Clone, Debug, Args)]
#[command(
    after_help = "Examples:\n  ob1 xref press.toml\n  ob1 xref main.awl lib.awl --symbols press.sdf --operand \"MW 10\"\n  ob1 xref press.toml --json\n\n\
    R reads, W writes, RW both, call, open. Exit codes: 0, or 1 when the program cannot be compiled."
)]
pub struct XrefArgs {
    /// Sources (.awl), folders of them, or one station file (.toml)
    #[arg(required = true)]
    pub files: Vec<PathBuf>,
    /// A symbol table of the sources (a station file names its own)
    #[arg(long, value_name = "FILE")]
    pub symbols: Vec<PathBuf>,
    /// Mnemonics of the sources
    #[arg(long, value_enum, default_value_t = Language::Auto)]
    pub mnemonics: Language,
    /// A plugin whose blocks the sources call
    #[arg(long, value_name = "PATH")]
    pub plugin: Vec<String>,
    /// Standard blocks of the sources: FC4=IEC:FC4, or a whole library: IEC
    #[arg(long, alias = "standard", value_name = "FC4=IEC:FC4,...", value_delimiter = ',', value_parser = Chosen::parse)]
    pub library: Vec<Chosen>,
    /// Only this operand, or this symbol
    #[arg(long, value_name = "NAME")]
    pub operand: Option<String>,
    /// As a JSON array of {operand, symbol, indirect, access, block, network, line, via}
    #[arg(long)]
    pub json: bool,
}

/// Prints the cross-reference.
#[must_use]
pub fn xref(args: &XrefArgs) -> Exit {
    let mut references = match references(args) {
        Ok(references) => references,
        Err(findings) => {
            findings.iter().filter(|f| f.level == Level::Error).for_each(|f| err!("{f}"));
            return Exit::Usage;
        }
    };
    if let Some(wanted) = &args.operand {
        let wanted = compact(wanted);
        let is_it = |text: &str| compact(text) == wanted;
        references.retain(|r| is_it(&r.operand) || r.symbol.as_deref().is_some_and(is_it));
        if references.is_empty() {
            err!("ob1: no statement uses {}", args.operand.as_deref().unwrap_or_default());
        }
    }
    if args.json {
        let list: Vec<Value> = references.iter().map(to_json).collect();
        match serde_json::to_string_pretty(&list) {
            Ok(text) => say!("{text}"),
            Err(error) => err!("ob1: {error}"),
        }
    } else {
        says!("{}", ob1_stl::render_xref(&references));
    }
    Exit::Ok
}

/// Without blanks and quotes, in capitals: `mw10` is `MW 10`.
fn compact(text: &str) -> String {
    text.chars().filter(|c| !c.is_whitespace() && *c != '"').flat_map(char::to_uppercase).collect()
}

fn references(args: &XrefArgs) -> Result<Vec<Reference>, Vec<Finding>> {
    if let [file] = args.files.as_slice()
        && station_file::is_station_file(file)
    {
        let options = [
            ("--symbols", !args.symbols.is_empty()),
            ("--mnemonics", !matches!(args.mnemonics, Language::Auto)),
            ("--plugin", !args.plugin.is_empty()),
            ("--library", !args.library.is_empty()),
        ];
        if let Some(finding) = misplaced(file, &options) {
            return Err(vec![finding]);
        }
        let station = station_file::load(file)?;
        let loaded = program::load(&station).map_err(|failure| match failure {
            LoadFailure::Plugin(findings) | LoadFailure::Rejected(findings) => findings,
        })?;
        let library = program::library(&loaded.plugins, &loaded.standard)?;
        return Ok(ob1_stl::xref_with(&loaded.program, &library));
    }
    let plugins: Vec<Plugin> = args.plugin.iter().map(|name| Plugin::of_name(name)).collect();
    let plugins = program::load_plugins(&plugins)?;
    let standard = Chosen::settled(&args.library)?;
    let library = program::library(&plugins, &standard)?;
    let sources = Sources {
        files: args.files.clone(),
        symbols: args.symbols.clone(),
        mnemonics: args.mnemonics.into(),
        library: standard,
        ..Sources::default()
    };
    let compiled = program::compile(&sources, &library)?;
    let library =
        program::library(&plugins, &program::in_use(&compiled.program, &sources.library, &compiled.demanded))?;
    Ok(ob1_stl::xref_with(&compiled.program, &library))
}

fn to_json(r: &Reference) -> Value {
    json!({
        "operand": r.operand,
        "symbol": r.symbol,
        "indirect": r.indirect,
        "access": r.access.name(),
        "block": r.block.to_string(),
        "network": r.network,
        "line": r.line,
        "via": r.via,
    })
}

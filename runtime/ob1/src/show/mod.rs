//! `ob1 show`: blocks as ladder, function plan, statements, or one line a network.

pub(crate) mod flowing;
pub(crate) mod paint;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use ob1_ir::CodeBlock;
use ob1_ladder::svg::{heading, svg};
use ob1_ladder::tree::Tree;
use ob1_ladder::{Form, NamesShown, Network, Options, Reason, View, draw, line, read, text};
use ob1_model::{BlockId, Interface};
use ob1_project::Language as Made;
use ob1_stl::Mnemonics;
use ob1_stl::print::{Listing, Printer};
use serde_json::json;

use crate::diff::Side;
use crate::exit::{Exit, told};
use crate::import::Unit;
use crate::language::Language;

/// Show blocks as ladder, function plan or statements
///
/// A program is a station file or its folder, a STEP 7 project (folder, .s7p, .s7l, .zip), a folder of .mc7, or
/// sources. A network is drawn only if its drawing gives back the very same statements; else it is shown as statements,
/// with the reason. A block of a project is shown as it was made.
#[derive(Clone, Debug, Args)]
#[command(
    after_help = "Examples:\n  ob1 show press FB 20\n  ob1 show press FB 20 --network 3 --fbd\n  ob1 show plant.zip FC5 --ascii --mnemonics en\n  \
    ob1 show press FB 20 --network 3 --svg network.svg\n  ob1 show plant.zip --count --json\n\n\
    Exit codes: 0 shown, or the program, the block or the network is not there (2).\n\nMore: docs/ladder.md."
)]
pub struct ShowArgs {
    /// The program
    pub program: PathBuf,
    /// The block: FB 20, FC5, or its name; without one all of them
    #[arg(num_args = 0..=2, value_name = "BLOCK")]
    pub block: Vec<String>,
    /// Only this network
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub network: Option<u16>,
    /// Ladder
    #[arg(long, group = "view")]
    pub lad: bool,
    /// Function plan
    #[arg(long, group = "view")]
    pub fbd: bool,
    /// Statements
    #[arg(long, group = "view")]
    pub stl: bool,
    /// One line a network, for searching and differences
    #[arg(long, group = "view")]
    pub line: bool,
    /// Only | - + ( ) instead of box characters
    #[arg(long)]
    pub ascii: bool,
    /// One network as SVG into this file; - is standard output
    #[arg(long, value_name = "FILE", requires = "network", conflicts_with_all = ["stl", "line"])]
    pub svg: Option<PathBuf>,
    /// What stands at an element
    #[arg(long, value_enum, default_value_t = Names::Both)]
    pub names: Names,
    /// Columns, beyond which a ladder goes on below
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(40..))]
    pub width: Option<u16>,
    /// Mnemonics: those of the program, unless told
    #[arg(long, value_enum, default_value_t = Language::Auto)]
    pub mnemonics: Language,
    /// The program within a STEP 7 project, as `ob1 import --list` names it
    #[arg(long = "program", value_name = "NAME", id = "within")]
    pub within: Option<String>,
    /// Count the networks that are drawn, and say why others are not
    #[arg(long, conflicts_with_all = ["view", "svg", "network"])]
    pub count: bool,
    /// The count as JSON: networks, graphical, drawn, left [{block, network, reason}]
    #[arg(long, requires = "count")]
    pub json: bool,
    #[command(flatten)]
    pub(crate) unit: Unit,
}

/// What stands at an element.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Names {
    /// E 0.0
    Address,
    /// Start, where there is a symbol
    Symbol,
    /// One above the other
    Both,
}

/// Shows; prints what there is to print.
pub fn show(args: &ShowArgs) -> Exit {
    told(run(args).map(|()| Exit::Ok), |_| Exit::Usage)
}

/// A program with what its networks are shown by.
pub(crate) struct Shown {
    pub(crate) side: Side,
    pub(crate) symbols: BTreeMap<String, String>,
    pub(crate) mnemonics: Mnemonics,
}

/// A block, ready to be shown.
pub(crate) struct Ready<'s> {
    pub(crate) block: &'s CodeBlock,
    pub(crate) networks: Vec<Network>,
    listing: Listing,
}

impl Shown {
    pub(crate) fn new(side: Side, wanted: Language) -> Self {
        let mnemonics = match wanted {
            Language::De => Mnemonics::German,
            Language::En => Mnemonics::International,
            Language::Auto => own_mnemonics(&side),
        };
        let symbols = ob1_ladder::symbols(&side.program, mnemonics);
        Self { side, symbols, mnemonics }
    }

    fn interface(&self, id: BlockId) -> Option<&Interface> {
        let own = self.side.program.blocks.iter().find(|block| block.id == id).map(|block| &block.interface);
        own.or_else(|| self.side.library.get(id).map(|block| &block.interface))
    }

    pub(crate) fn ready<'s>(&'s self, block: &'s CodeBlock) -> Ready<'s> {
        let text = self.side.sources.get(&block.id);
        let listing =
            text.map(|text| ob1_ladder::listing(block, &text.lines().collect::<Vec<_>>())).unwrap_or_default();
        let callees = |id| self.interface(id);
        let view = View { mnemonics: self.mnemonics, callees: &callees, symbols: &self.symbols, listing: &listing };
        Ready { block, networks: view.networks(block), listing }
    }

    pub(crate) fn options(&self, form: Form) -> Options {
        Options { form, mnemonics: self.mnemonics, ..Options::default() }
    }

    /// Why its statements are not shown.
    pub(crate) fn hidden(&self, id: BlockId) -> Option<String> {
        let hidden = self.side.protected.contains(&id);
        hidden.then(|| format!("{id} is know-how protected: it runs, and its statements are not printed"))
    }

    /// The view of a block: ladder or function plan as told, else that in which it was made.
    pub(crate) fn form(&self, id: BlockId, (lad, fbd): (bool, bool)) -> Form {
        let made_plan = matches!(self.side.made.get(&id), Some((Made::Fbd, _)));
        if !lad && (fbd || made_plan) { Form::Plan } else { Form::Ladder }
    }

    /// The statements of a network, as they are printed.
    pub(crate) fn statements(&self, ready: &Ready<'_>, network: u16) -> Vec<String> {
        let callees = |id| self.interface(id);
        let printer = Printer::new(self.mnemonics, &callees).with_symbols(&self.symbols);
        let of = |at: usize| ready.block.code.get(at).is_some_and(|stmt| stmt.network == network);
        match printer.lines(ready.block, &ready.listing) {
            Ok(lines) => lines.into_iter().filter(|(at, _)| of(*at)).map(|(_, text)| format!("      {text}")).collect(),
            // No source says it: the operations do.
            Err(_) => {
                let all = ready.block.code.iter().filter(|stmt| stmt.network == network);
                all.map(|stmt| format!("      {}", stmt.op)).collect()
            }
        }
    }

    pub(crate) fn of(&self, id: BlockId) -> Option<&CodeBlock> {
        self.side.program.blocks.iter().find(|block| block.id == id)
    }

    /// The code block of this name.
    pub(crate) fn block(&self, wanted: &str) -> Result<&CodeBlock, String> {
        let blocks = &self.side.program.blocks;
        let id = BlockId::parse(wanted);
        let is_it = |block: &&CodeBlock| {
            Some(block.id) == id || block.name.as_ref().is_some_and(|name| name.eq_ignore_ascii_case(wanted))
        };
        blocks.iter().find(is_it).ok_or_else(|| {
            let there: BTreeSet<BlockId> = blocks.iter().map(|block| block.id).collect();
            let list: Vec<String> = there.iter().take(20).map(BlockId::to_string).collect();
            format!("\"{wanted}\" is no block of statements of this program\n  = there are {}", list.join(", "))
        })
    }
}

/// The mnemonics of the sources: by the words that only one set has.
fn own_mnemonics(side: &Side) -> Mnemonics {
    let (mut german, mut international) = (0, 0);
    for line in side.sources.values().flat_map(|text| text.lines()) {
        let statement = line.split_once(':').map_or(line, |(_, statement)| statement).trim_start();
        match statement.split([' ', ';', '\t']).next() {
            Some("U" | "UN" | "U(" | "SPA" | "SPB" | "AUF" | "ZV") => german += 1,
            Some("A" | "AN" | "A(" | "JU" | "JC" | "OPN" | "CU") => international += 1,
            _ => {}
        }
    }
    if international > german { Mnemonics::International } else { Mnemonics::German }
}

fn run(args: &ShowArgs) -> Result<(), String> {
    let shown = Shown::new(open(&args.program, args.within.as_deref(), &args.unit)?, args.mnemonics);
    if args.count {
        return count(&shown, args);
    }
    let wanted = args.block.join(" ");
    let mut blocks: Vec<&CodeBlock> =
        if wanted.is_empty() { shown.side.program.blocks.iter().collect() } else { vec![shown.block(&wanted)?] };
    blocks.sort_by_key(|block| block.id);
    for block in blocks {
        let ready = shown.ready(block);
        if let Some(number) = args.network
            && usize::from(number) > ready.networks.len()
        {
            return Err(format!("{} has {} networks", block.id, ready.networks.len()));
        }
        match &args.svg {
            Some(file) => picture(&shown, &ready, args, file)?,
            None => {
                let options = options(&shown, block.id, args);
                let style = Style { options, network: args.network, stl: args.stl, line: args.line, ascii: args.ascii };
                page(&shown, &ready, style).iter().for_each(|line| say!("{line}"));
            }
        }
    }
    Ok(())
}

/// The program of a path. `press` may be `press.toml`, as other commands have it.
pub(crate) fn open(path: &Path, within: Option<&str>, unit: &Unit) -> Result<Side, String> {
    let file = path.with_extension("toml");
    let path = if !path.exists() && file.is_file() { &file } else { path };
    Side::read(path, within, unit)
}

fn options(shown: &Shown, id: BlockId, args: &ShowArgs) -> Options {
    let form = shown.form(id, (args.lad, args.fbd));
    let names = match args.names {
        Names::Address => NamesShown::Address,
        Names::Symbol => NamesShown::Symbol,
        Names::Both => NamesShown::Both,
    };
    Options { names, wrap: args.width.map(usize::from), ..shown.options(form) }
}

fn picture(shown: &Shown, ready: &Ready<'_>, args: &ShowArgs, file: &Path) -> Result<(), String> {
    if let Some(why) = shown.hidden(ready.block.id) {
        return Err(why);
    }
    let number = usize::from(args.network.unwrap_or(1));
    let network = ready.networks.get(number - 1).ok_or("there is no such network")?;
    let tree = read(network).map_err(|why| format!("network {number} is shown as statements: {why}"))?;
    let drawing = draw(network, &tree, &options(shown, ready.block.id, args));
    let text = svg(network, &tree, &drawing, None);
    if file.as_os_str() == "-" {
        says!("{text}");
        return Ok(());
    }
    std::fs::write(file, text).map_err(|why| format!("{}: {why}", file.display()))
}

/// How a block is written.
#[derive(Clone, Copy, Debug)]
struct Style {
    options: Options,
    network: Option<u16>,
    stl: bool,
    line: bool,
    ascii: bool,
}

/// The drawings of all blocks of a program.
pub(crate) fn pages(side: Side) -> Vec<(BlockId, String)> {
    let shown = Shown::new(side, Language::Auto);
    let page = |block: &CodeBlock| {
        let options = shown.options(shown.form(block.id, (false, false)));
        let style = Style { options, network: None, stl: false, line: false, ascii: false };
        (block.id, format!("{}\n", page(&shown, &shown.ready(block), style).join("\n")))
    };
    shown.side.program.blocks.iter().map(page).collect()
}

/// The lines of a block.
fn page(shown: &Shown, ready: &Ready<'_>, style: Style) -> Vec<String> {
    let options = style.options;
    let mut out = vec![ob1_ladder::title(ready.block.id, ready.block.name.as_deref())];
    if let Some(why) = shown.hidden(ready.block.id) {
        out.push(why);
        return out;
    }
    for network in ready.networks.iter().filter(|network| style.network.is_none_or(|n| n == network.number)) {
        let tree = if style.stl { None } else { Some(read(network)) };
        if let (Some(Ok(tree)), true) = (&tree, style.line) {
            out.push(format!("{:>3}  {}", network.number, line(network, tree, &options)));
            continue;
        }
        out.push(String::new());
        out.extend(head(network));
        match tree {
            Some(Ok(tree)) => out.extend(drawn(network, &tree, &options, style.ascii)),
            Some(Err(why)) => {
                out.push(format!("(as statements: {why})"));
                out.extend(shown.statements(ready, network.number));
            }
            None => out.extend(shown.statements(ready, network.number)),
        }
    }
    out
}

pub(crate) fn head(network: &Network) -> Vec<String> {
    let comment = network.comment.lines().map(|line| format!("  {}", line.trim()));
    std::iter::once(heading(network)).chain(comment).collect()
}

/// A drawing and the list of its names.
fn drawn(network: &Network, tree: &Tree, options: &Options, ascii: bool) -> Vec<String> {
    let drawing = draw(network, tree, options);
    let mut out = Vec::new();
    let named = !network.label.is_empty();
    if named {
        out.push(format!("{}:", network.label));
    }
    if options.form == Form::Ladder && drawing.is_plan {
        out.push("(a function plan: a ladder would say something else)".to_owned());
    }
    if !tree.as_step7 {
        out.push("(STEP 7 itself would show statements)".to_owned());
    }
    out.extend(text::lines(&drawing, ascii));
    out.extend(names(network));
    out
}

/// Address and symbol of all that has one.
fn names(network: &Network) -> Vec<String> {
    let mut all: BTreeSet<(&str, &str)> = BTreeSet::new();
    for statement in &network.statements {
        all.insert((&statement.operand, &statement.symbol));
        all.extend(statement.actuals.iter().map(|actual| (actual.text.as_str(), actual.symbol.as_str())));
    }
    let list = all.into_iter().filter(|(_, symbol)| !symbol.is_empty());
    list.map(|(address, symbol)| format!("  {address:<12} {symbol}")).collect()
}

/// What is drawn of a program.
#[derive(Debug, Default)]
struct Counted {
    /// Networks that have statements.
    networks: usize,
    /// Of these, those that somebody has drawn, or may have drawn.
    graphical: usize,
    /// Of these, those that can be drawn.
    drawn: usize,
    /// The others, each with the reason.
    left: Vec<(BlockId, u16, Reason)>,
}

fn count(shown: &Shown, args: &ShowArgs) -> Result<(), String> {
    let wanted = args.block.join(" ");
    let only = if wanted.is_empty() { None } else { Some(shown.block(&wanted)?.id) };
    let Counted { networks, graphical, drawn, left } = counted(shown, only);
    if args.json {
        let left: Vec<_> = left
            .iter()
            .map(|(id, network, why)| json!({ "block": id.to_string(), "network": network, "reason": why.to_string() }))
            .collect();
        say!("{}", json!({ "networks": networks, "graphical": graphical, "drawn": drawn, "left": left }));
    } else {
        say!("{networks} networks, {graphical} of them graphical, {drawn} drawn");
        left.iter().for_each(|(id, network, why)| say!("{id}, network {network}: {why}"));
    }
    Ok(())
}

fn counted(shown: &Shown, only: Option<BlockId>) -> Counted {
    let mut counted = Counted::default();
    let side = &shown.side;
    for block in side.program.blocks.iter().filter(|block| only.is_none_or(|id| block.id == id)) {
        let made = side.made.get(&block.id);
        for network in shown.ready(block).networks.iter().filter(|network| !network.is_empty()) {
            counted.networks += 1;
            // A project says which networks were drawn; of other programs each may have been.
            let lined = |lined: &Vec<bool>| lined.get(usize::from(network.number) - 1).copied().unwrap_or(false);
            if side.of_project && made.is_none_or(|(_, lines)| lined(lines)) {
                continue;
            }
            counted.graphical += 1;
            match read(network) {
                Ok(_) => counted.drawn += 1,
                Err(why) => counted.left.push((block.id, network.number, why)),
            }
        }
    }
    counted
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_ir::Symbol;
    use ob1_stl::{Library, Options as Compile, Source, compile};

    const TEXT: &str = "FUNCTION FC 1 : VOID\nBEGIN\nNETWORK\nTITLE = Pump\n// on demand\nU E 0.0;\n= A 4.0;\nNETWORK\nL 5;\n\
        T MW 2;\nL MW 4;\nNETWORK\nEND_FUNCTION\n";

    fn side(made: BTreeMap<BlockId, (Made, Vec<bool>)>) -> Side {
        let symbol =
            |name: &str, address: &str| Symbol { name: name.into(), address: address.into(), ..Symbol::default() };
        let symbols = vec![symbol("Start", "I 0.0"), symbol("Motor", "Q 4.0")];
        let library = Library::new();
        let output = compile(&[Source::new("a", TEXT)], &library, &Compile { symbols, ..Compile::default() });
        assert!(output.is_good(), "{:?}", output.diagnostics);
        let sources = BTreeMap::from([(output.program.blocks[0].id, TEXT.to_owned())]);
        Side { sources, of_project: true, made, ..Side::of_program("test".into(), output.program, library) }
    }

    #[test]
    fn a_block_is_drawn_with_its_titles_and_symbols() {
        let pages = pages(side(BTreeMap::new()));
        let expected = "\
FC 1

Network 1: Pump
  on demand
│ Start   Motor
│ E 0.0   A 4.0
├──┤ ├────(   )
  A 4.0        Motor
  E 0.0        Start

Network 2
(as statements: statement 3: T without NOP 0)
            L 5;
            T MW 2;
            L MW 4;
";
        assert_eq!(pages[0].1, expected);
    }

    #[test]
    fn a_project_tells_what_was_drawn() {
        let id = BlockId::new(ob1_model::BlockKind::Fc, 1);
        let count = |made| {
            let counted = counted(&Shown::new(side(made), Language::Auto), None);
            [counted.networks, counted.graphical, counted.drawn, counted.left.len()]
        };
        assert_eq!(count(BTreeMap::from([(id, (Made::Lad, vec![false, true]))])), [2, 1, 1, 0]);
        assert_eq!(count(BTreeMap::from([(id, (Made::Lad, vec![false, false]))])), [2, 2, 1, 1]);
        assert_eq!(count(BTreeMap::new()), [2, 0, 0, 0], "all of it is STL");
    }
}

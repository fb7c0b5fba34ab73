//! `ob1 print`: a whole program as a document for paper: blocks in their view, cross reference, symbols, assignment.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use ob1_ir::CodeBlock;
use ob1_ladder::svg::{STYLE, bare_svg, escaped};
use ob1_ladder::{Form, draw, read, title};
use ob1_stl::{CrossReference, in_set};

use crate::exit::{Exit, told};
use crate::import::Unit;
use crate::language::Language;
use crate::show::{Ready, Shown, open};

/// Print a whole program: blocks as ladder, cross reference, symbols
///
/// Makes one file for a browser, which prints it or keeps it as PDF: title page, blocks, call structure, each block
/// with titles and comments in the view it was made in, symbols, cross reference, assignment list. A network that
/// cannot be drawn is printed as statements, with the reason. With a name that ends in .svg the drawings alone, one
/// below the other.
#[derive(Clone, Debug, Args)]
#[command(
    after_help = "Examples:\n  ob1 print press -o press.html\n  ob1 print plant.zip --language de -o plant.html\n  \
    ob1 print press -o press.svg\n\nExit codes: 0 printed, or the program is not there (2).\n\nMore: docs/ladder.md."
)]
pub struct PrintArgs {
    /// The program: a station, a STEP 7 project, a folder of .mc7, or sources
    pub program: PathBuf,
    /// The file, .html or .svg; standard output without one
    #[arg(long, short, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Ladder, whatever a block was made in
    #[arg(long, group = "view")]
    pub lad: bool,
    /// Function plan, whatever a block was made in
    #[arg(long, group = "view")]
    pub fbd: bool,
    /// Mnemonics: those of the program, unless told
    #[arg(long, value_enum, default_value_t = Language::Auto)]
    pub mnemonics: Language,
    /// The language of headings
    #[arg(long, value_enum, default_value_t = Words::En)]
    pub language: Words,
    /// The program within a STEP 7 project, as `ob1 import --list` names it
    #[arg(long = "program", value_name = "NAME", id = "within")]
    pub within: Option<String>,
}

/// The language of headings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Words {
    /// English
    En,
    /// German
    De,
}

impl Words {
    const fn pick(self, english: &'static str, german: &'static str) -> &'static str {
        match self {
            Self::En => english,
            Self::De => german,
        }
    }
}

/// Runs `ob1 print`: writes the document, and says how it ended.
pub fn print(args: &PrintArgs) -> Exit {
    told(run(args).map(|()| Exit::Ok), |_| Exit::Usage)
}

fn run(args: &PrintArgs) -> Result<(), String> {
    let side = open(&args.program, args.within.as_deref(), &Unit { rack: 0, slot: 2, password: None })?;
    let shown = Shown::new(side, args.mnemonics);
    let name = args.program.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
    let paper = Paper { shown: &shown, args, name };
    let is_svg = args.out.as_deref().and_then(Path::extension).is_some_and(|ext| ext.eq_ignore_ascii_case("svg"));
    let text = if is_svg { paper.drawings() } else { paper.document() };
    match &args.out {
        Some(file) => std::fs::write(file, text).map_err(|why| format!("{}: {why}", file.display())),
        None => {
            says!("{text}");
            Ok(())
        }
    }
}

const PAGE: &str = "\
:root{color-scheme:light dark}body{font:14px/1.4 system-ui,sans-serif;margin:2em auto;max-width:1100px;padding:0 1em}\
table{border-collapse:collapse;width:100%}th,td{text-align:left;padding:2px 8px;border-bottom:1px solid #9998;vertical-align:top}\
pre,code,td.code{font:12px/1.35 ui-monospace,monospace}pre{white-space:pre-wrap}.quiet{opacity:.75}\
.network{margin:12px 0;overflow-x:auto}.network pre{margin:4px 0}h2{border-bottom:2px solid currentColor}\
.head td:first-child{width:12em}nav ul{columns:3;list-style:none;padding:0}\
@media print{body{max-width:none;margin:0;font-size:10pt}h2{break-before:page}.network,tr{break-inside:avoid}h3{break-after:avoid}\
nav a{color:inherit;text-decoration:none}.ladder{max-width:100%;height:auto}@page{margin:15mm 12mm 15mm 20mm}}";

struct Paper<'p> {
    shown: &'p Shown,
    args: &'p PrintArgs,
    name: String,
}

impl Paper<'_> {
    fn blocks(&self) -> Vec<&CodeBlock> {
        let mut blocks: Vec<&CodeBlock> = self.shown.side.program.blocks.iter().collect();
        blocks.sort_by_key(|block| block.id);
        blocks
    }

    fn form(&self, block: &CodeBlock) -> Form {
        self.shown.form(block.id, (self.args.lad, self.args.fbd))
    }

    fn document(&self) -> String {
        let say = |english, german| self.args.language.pick(english, german);
        let program = &self.shown.side.program;
        let all = CrossReference::new(program, &self.shown.side.library);
        let blocks = self.blocks();
        let mut out = String::new();
        let lang = say("en", "de");
        let _ = writeln!(
            out,
            "<!doctype html>\n<html lang=\"{lang}\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" \
             content=\"width=device-width\"><title>{0}</title><style>{PAGE}{STYLE}</style></head><body>\n<h1>{0}</h1>",
            escaped(&self.name)
        );
        let rows = [
            (say("Program", "Programm"), self.args.program.display().to_string()),
            (say("Blocks", "Bausteine"), blocks.len().to_string()),
            (say("Data blocks", "Datenbausteine"), program.data.len().to_string()),
            (say("Symbols", "Symbole"), program.symbols.len().to_string()),
            (say("Drawn", "Erstellt"), String::new()),
            (say("Checked", "Geprüft"), String::new()),
            (say("Plant", "Anlage"), String::new()),
        ];
        out.push_str("<table class=\"head\">");
        for (what, value) in rows {
            let _ = write!(out, "<tr><td>{what}</td><td>{}</td></tr>", escaped(&value));
        }
        out.push_str("</table>\n<nav><ul>");
        for block in &blocks {
            let (id, name) = (block.id, title(block.id, block.name.as_deref()));
            let _ = write!(out, "<li><a href=\"#{}\">{}</a></li>", anchor(&id.to_string()), escaped(&name));
        }
        let _ = write!(
            out,
            "</ul></nav>\n<h2>{}</h2><pre>{}</pre>\n",
            say("Call structure", "Aufrufstruktur"),
            escaped(&all.calls())
        );
        for block in blocks {
            self.block(&mut out, block);
        }
        self.symbols(&mut out);
        self.references(&mut out, &all);
        let assignment = all.assignment().render(self.shown.mnemonics);
        let _ = write!(
            out,
            "<h2>{}</h2><pre>{}</pre>\n</body></html>\n",
            say("Assignment list", "Belegungsplan"),
            escaped(&assignment)
        );
        out
    }

    fn block(&self, out: &mut String, block: &CodeBlock) {
        let id = block.id.to_string();
        let _ = writeln!(out, "<h2 id=\"{}\">{}</h2>", anchor(&id), escaped(&title(block.id, block.name.as_deref())));
        if let Some(why) = self.shown.hidden(block.id) {
            let _ = writeln!(out, "<p>{}</p>", escaped(&why));
            return;
        }
        let ready = self.shown.ready(block);
        for network in &ready.networks {
            let word = self.args.language.pick("Network", "Netzwerk");
            let colon = if network.title.is_empty() { "" } else { ": " };
            let heading = escaped(&network.title);
            let _ = write!(out, "<div class=\"network\"><h3>{word} {}{colon}{heading}</h3>", network.number);
            if !network.comment.is_empty() {
                let _ = write!(out, "<pre class=\"quiet\">{}</pre>", escaped(network.comment.trim_end()));
            }
            out.push_str(&self.network(&ready, network, self.form(block)));
            out.push_str("</div>\n");
        }
    }

    fn network(&self, ready: &Ready<'_>, network: &ob1_ladder::Network, form: Form) -> String {
        if network.is_empty() {
            return String::new();
        }
        match read(network) {
            Ok(tree) => bare_svg(network, &tree, &draw(network, &tree, &self.shown.options(form))),
            Err(why) => {
                let as_statements = self.args.language.pick("as statements", "als Anweisungen");
                let lines = self.shown.statements(ready, network.number).join("\n");
                let why = escaped(&why.to_string());
                format!("<p class=\"quiet\">({as_statements}: {why})</p><pre>{}</pre>", escaped(&lines))
            }
        }
    }

    fn symbols(&self, out: &mut String) {
        let say = |english, german| self.args.language.pick(english, german);
        let rows = self.shown.side.program.symbols.iter().map(|symbol| {
            let ty = symbol.ty.as_ref().map_or("", |ty| ty.name());
            [symbol.name.clone(), symbol.address.clone(), ty.to_owned(), symbol.comment.clone()]
        });
        table(
            out,
            say("Symbols", "Symbole"),
            [say("Symbol", "Symbol"), say("Address", "Adresse"), say("Type", "Typ"), say("Comment", "Kommentar")],
            rows,
        );
    }

    fn references(&self, out: &mut String, all: &CrossReference<&ob1_ir::Program>) {
        let say = |english, german| self.args.language.pick(english, german);
        let mut last = String::new();
        let rows = all.all.iter().map(|one| {
            let symbol = one.symbol.as_ref().map(|symbol| format!(" \"{symbol}\"")).unwrap_or_default();
            let operand = format!("{}{symbol}", in_set(&one.operand, self.shown.mnemonics));
            let shown = if operand == last { String::new() } else { operand.clone() };
            last = operand;
            let via = one.via.as_ref().map(|via| format!(" ({via})")).unwrap_or_default();
            [shown, format!("{}{via}", one.access.name()), one.place(all.program())]
        });
        let heads = [say("Operand", "Operand"), say("Access", "Zugriff"), say("Place", "Stelle")];
        table(out, say("Cross reference", "Querverweise"), heads, rows);
    }

    /// All drawings, one below the other.
    fn drawings(&self) -> String {
        let (mut parts, mut top, mut widest) = (String::new(), 0, 0);
        for block in self.blocks().into_iter().filter(|block| self.shown.hidden(block.id).is_none()) {
            for network in self.shown.ready(block).networks.iter().filter(|network| !network.is_empty()) {
                let Ok(tree) = read(network) else { continue };
                let drawing = draw(network, &tree, &self.shown.options(self.form(block)));
                let heading = format!("{}, {}", block.id, ob1_ladder::svg::heading(network));
                let _ = write!(parts, "<text x=\"8\" y=\"{}\">{}</text>", top + 16, escaped(&heading));
                let _ =
                    write!(parts, "<svg y=\"{}\" {}", top + 20, &bare_svg(network, &tree, &drawing)["<svg ".len()..]);
                let [width, height] = ob1_ladder::svg::size(&drawing);
                top += height + 28;
                widest = widest.max(width);
            }
        }
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"ladder\" width=\"{widest}\" height=\"{top}\"><style>{STYLE}</style>{parts}</svg>\n"
        )
    }
}

fn anchor(id: &str) -> String {
    id.replace(' ', "")
}

fn table<const N: usize>(out: &mut String, title: &str, heads: [&str; N], rows: impl Iterator<Item = [String; N]>) {
    let _ = write!(out, "<h2>{title}</h2><table><thead><tr>");
    heads.iter().for_each(|head| {
        let _ = write!(out, "<th>{head}</th>");
    });
    out.push_str("</tr></thead><tbody>\n");
    for row in rows {
        out.push_str("<tr>");
        for cell in row {
            let _ = write!(out, "<td class=\"code\">{}</td>", escaped(&cell));
        }
        out.push_str("</tr>\n");
    }
    out.push_str("</tbody></table>\n");
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser as _;

    #[derive(clap::Parser)]
    struct Line {
        #[command(flatten)]
        args: PrintArgs,
    }

    fn printed(more: &[&str]) -> String {
        let folder = tempfile::tempdir().expect("room for a folder");
        let station = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/stations/press");
        let file = folder.path().join(if more.contains(&"svg") { "a.svg" } else { "a.html" });
        let out = file.to_str().expect("a path").to_owned();
        let rest = more.iter().copied().filter(|word| *word != "svg");
        let Line { args } = Line::parse_from(["print", station, "-o", &out].into_iter().chain(rest));
        assert!(matches!(print(&args), Exit::Ok));
        std::fs::read_to_string(file).expect("it is written")
    }

    #[test]
    fn a_whole_program_is_one_document() {
        let text = printed(&["--language", "de"]);
        for part in [
            "<html lang=\"de\">",
            "<a href=\"#FB20\">",
            "Netzwerk 1: Keep what was asked for",
            "The button on, unless the button off is pressed.",
            "als Anweisungen: statement",
            "<h2>Querverweise</h2>",
            "OB 1, network 3",
            "guard closed",
            "<h2>Belegungsplan</h2>",
        ] {
            assert!(text.contains(part), "{part}");
        }
        assert_eq!(text.matches("<svg ").count(), text.matches("</svg>").count());
        assert!(text.matches("<svg ").count() >= 8, "{}", text.matches("<svg ").count());
        assert!(!text.contains("http:") || !text.replace("http://www.w3.org/2000/svg", "").contains("http:"));
        // A contact or coil of each symbol.
        assert!(text.contains("data-operand=\"A 4.2\""), "the lamp is drawn");
        let english = printed(&["--mnemonics", "en"]);
        assert!(english.contains("data-operand=\"Q 4.2\"") && english.contains("Cross reference"));
    }

    #[test]
    fn the_drawings_alone_are_one_picture() {
        let text = printed(&["svg"]);
        assert!(text.starts_with("<svg ") && text.trim_end().ends_with("</svg>"));
        assert_eq!(text.matches("<svg ").count(), text.matches("</svg>").count());
        assert!(text.contains("FB 20, Network 2: Run while the guard is closed"));
    }
}

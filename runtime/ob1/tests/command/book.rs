//! What the pages show is what the command understands: the STL on them compiles, every `ob1 ...` line parses.
//!
//! | the fence says | what is held |
//! |---|---|
//! | ```` ```stl ```` | a whole source that compiles |
//! | ```` ```stl,statements ```` | statements of an OB 1 |
//! | `,standard=CP240+IEC` | with these libraries |
//! | `,mnemonics=en` | in this set; else found by its words |
//! | `,refused=S0303` | does not compile; this number is what is said first |
//! | ```` ```toml,station ```` | a station file that is good |
//! | `,file=pump.awl` (any language) | a file that the page's command lines find |
//!
//! Lines of a page that has files and begin with `ob1 check`, `exec`, `test` or `xref` are run beside these files, and
//! must end well, or as a comment `# exit code 3` on the line says.
//!
//! `cargo xtask book` runs it, with the rules for links and the table of contents.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use clap::{CommandFactory as _, Parser as _};
use ob1_command::cli::Cli;
use pulldown_cmark::{CodeBlockKind, Event, Parser, Tag, TagEnd};

/// A code block: where, what its fence says (nothing for an indented one), its text.
struct Code {
    place: String,
    info: String,
    text: String,
}

/// Code blocks and spans of a page.
fn code_of(name: &str, text: &str) -> (Vec<Code>, Vec<Code>) {
    let (mut blocks, mut spans) = (Vec::new(), Vec::new());
    let mut open: Option<Code> = None;
    for (event, range) in Parser::new_ext(text, pulldown_cmark::Options::ENABLE_TABLES).into_offset_iter() {
        let line = text[..range.start].matches('\n').count() + 1;
        let place = format!("{name}:{line}");
        match event {
            Event::Start(Tag::CodeBlock(kind)) => {
                let info = match kind {
                    CodeBlockKind::Fenced(info) => info.into_string(),
                    CodeBlockKind::Indented => String::new(),
                };
                open = Some(Code { place, info, text: String::new() });
            }
            Event::End(TagEnd::CodeBlock) => blocks.extend(open.take()),
            Event::Text(words) => {
                if let Some(code) = &mut open {
                    code.text.push_str(&words);
                }
            }
            Event::Code(words) => spans.push(Code { place, info: String::new(), text: words.into_string() }),
            _ => {}
        }
    }
    (blocks, spans)
}

/// The pages a user reads: those of the book, and the READMEs.
fn pages() -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut found = Vec::new();
    let mut folders = vec![root.join("docs"), root.join("examples")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display())) {
            let path = entry.expect("readable").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|end| end == "md") {
                found.push(path);
            }
        }
    }
    found.extend([root.join("README.md"), root.join("ARCHITECTURE.md")]);
    found.sort();
    let page = |path: PathBuf| {
        let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        (path.strip_prefix(&root).expect("below the root").display().to_string(), text)
    };
    found.into_iter().map(page).collect()
}

/// What is wrong with an STL snippet; nothing when it is as its fence says.
fn wrong_with(code: &Code) -> Option<String> {
    let mut words = code.info.split(',').skip(1);
    let (mut arguments, mut refused, mut statements) = (Vec::new(), None, false);
    for word in &mut words {
        match word.trim().split_once('=') {
            None if word.trim() == "statements" => statements = true,
            Some(("standard", libraries)) => arguments.extend(["--library".to_owned(), libraries.replace('+', ",")]),
            Some(("mnemonics", set)) => arguments.extend(["--mnemonics".to_owned(), set.to_owned()]),
            Some(("refused", number)) => refused = Some(number.to_owned()),
            _ => {
                return Some(format!(
                    "{}: `{word}` says nothing on a fence; runtime/ob1/tests/command/book.rs lists the words",
                    code.place
                ));
            }
        }
    }
    let text = if statements {
        format!("ORGANIZATION_BLOCK OB 1\nBEGIN\nNETWORK\n{}\nEND_ORGANIZATION_BLOCK\n", code.text)
    } else {
        code.text.clone()
    };
    let folder = tempfile::tempdir().expect("a directory");
    std::fs::write(folder.path().join("snippet.awl"), text).expect("writable");
    let mut command = Command::new(env!("CARGO_BIN_EXE_ob1"));
    command.args(["check", "snippet.awl"]).args(arguments).current_dir(folder.path()).stdin(Stdio::null());
    let output = command.output().expect("ob1 starts");
    let said = String::from_utf8_lossy(&output.stderr);
    match (refused, output.status.success()) {
        (None, true) => None,
        (None, false) => Some(format!("{}: the snippet does not compile:\n{said}", code.place)),
        (Some(number), true) => Some(format!("{}: the snippet compiles; its fence says {number}", code.place)),
        (Some(number), false) => {
            let first = said.lines().next().unwrap_or_default();
            (!first.contains(&number)).then(|| format!("{}: the fence says {number}:\n{said}", code.place))
        }
    }
}

/// The words of an `ob1` command line, without prompt, path, comment and what a shell takes off. `None`: the line is no
/// such line.
fn words_of(line: &str) -> Option<Vec<String>> {
    let line = line.trim_start().trim_start_matches("$ ").trim_start_matches("sudo ");
    let line = line.strip_prefix("target/release/").unwrap_or(line);
    line.strip_prefix("ob1 ")?;
    let (mut words, mut word, mut quote) = (Vec::new(), String::new(), None);
    for c in line.chars() {
        match (c, quote) {
            (c, Some(end)) if c == end => quote = None,
            ('"' | '\'', None) => quote = Some(c),
            ('#' | '|' | '>' | '&', None) if word.is_empty() => break,
            (c, None) if c.is_whitespace() => words.extend(Some(std::mem::take(&mut word)).filter(|w| !w.is_empty())),
            (c, _) => word.push(c),
        }
    }
    words.extend(Some(word).filter(|word| !word.is_empty()));
    Some(words)
}

/// What is wrong with a command line shown in a block.
fn refused(line: &str) -> Option<String> {
    let error = Cli::try_parse_from(words_of(line)?).err()?;
    let is_help = matches!(error.kind(), clap::error::ErrorKind::DisplayHelp | clap::error::ErrorKind::DisplayVersion);
    (!is_help).then(|| error.to_string())
}

/// What is wrong with `ob1 VERB --flag ...` in a text: there the rest is often left out.
fn unknown(span: &str) -> Option<String> {
    let words = words_of(span)?;
    let command = Cli::command();
    let mut words = words.iter().skip(1).peekable();
    let verb = words.next_if(|word| word.starts_with(|c: char| c.is_ascii_lowercase()))?;
    let Some(mut verb) = command.find_subcommand(verb) else { return Some(format!("ob1 has no command `{verb}`")) };
    // A verb may have verbs of its own: `ob1 new plugin`.
    while let Some(word) = words.next_if(|word| verb.find_subcommand(word.as_str()).is_some()) {
        verb = verb.find_subcommand(word.as_str()).unwrap_or(verb);
    }
    let flags = words.filter_map(|word| word.strip_prefix("--")).map(|flag| flag.split('=').next().unwrap_or_default());
    let is_known = |flag: &str| flag == "help" || verb.get_arguments().any(|a| a.get_long() == Some(flag));
    flags.into_iter().find(|flag| !is_known(flag)).map(|flag| format!("ob1 {} has no --{flag}", verb.get_name()))
}

/// The word after `key=` on a fence.
fn of_fence<'i>(info: &'i str, key: &str) -> Option<&'i str> {
    info.split(',')
        .filter_map(|word| word.trim().split_once('='))
        .find(|(name, _)| *name == key)
        .map(|(_, value)| value)
}

/// Runs the command lines of a page beside the files it shows; what went wrong, and how many were run.
fn run_page(blocks: &[Code]) -> (String, usize) {
    let folder = tempfile::tempdir().expect("a directory");
    let (mut wrong, mut files, mut runs) = (String::new(), 0, 0);
    for block in blocks {
        if let Some(name) = of_fence(&block.info, "file") {
            std::fs::write(folder.path().join(name), &block.text).expect("writable");
            files += 1;
        }
    }
    for (block, line) in blocks.iter().flat_map(|block| block.text.lines().map(move |line| (block, line))) {
        let words = words_of(line).filter(|_| block.info.is_empty() && files > 0).unwrap_or_default();
        if !words.get(1).is_some_and(|verb| matches!(verb.as_str(), "check" | "exec" | "test" | "xref")) {
            continue;
        }
        let wanted = line.split_once("# exit code ").map_or(0, |(_, code)| code.trim().parse().unwrap_or(-1));
        let mut command = Command::new(env!("CARGO_BIN_EXE_ob1"));
        command.args(&words[1..]).current_dir(folder.path()).stdin(Stdio::null());
        let output = command.output().expect("ob1 starts");
        runs += 1;
        if output.status.code() != Some(wanted) {
            let said = String::from_utf8_lossy(&output.stdout) + String::from_utf8_lossy(&output.stderr);
            let code = output.status.code();
            let _ = writeln!(wrong, "{}: `{}` ends with {code:?}, not {wanted}:\n{said}", block.place, line.trim());
        }
    }
    (wrong, runs)
}

#[test]
fn the_pages_show_what_there_is() {
    let (mut wrong, mut snippets, mut lines, mut runs) = (String::new(), 0, 0, 0);
    for (name, text) in pages() {
        let (blocks, spans) = code_of(&name, &text);
        let (told, run) = run_page(&blocks);
        wrong += &told;
        runs += run;
        for block in &blocks {
            let language = block.info.split(',').next().unwrap_or_default();
            if language == "stl" && of_fence(&block.info, "file").is_none() {
                snippets += 1;
                wrong.extend(wrong_with(block).map(|what| what + "\n"));
            } else if block.info == "toml,station" {
                let findings = ob1_station_file::parse(&block.text, &block.place, Path::new("/station")).err();
                wrong.extend(findings.unwrap_or_default().iter().map(|finding| format!("{finding}\n")));
            } else if matches!(language, "" | "sh" | "console") {
                // A command line may go on in the next line.
                let text = block.text.replace("\\\n", " ");
                for line in text.lines().filter(|line| words_of(line).is_some()) {
                    lines += 1;
                    if let Some(why) = refused(line) {
                        let _ = writeln!(wrong, "{}: `{}`: {why}", block.place, line.trim());
                    }
                }
            }
        }
        for span in &spans {
            if let Some(why) = unknown(&span.text) {
                let _ = writeln!(wrong, "{}: `{}`: {why}", span.place, span.text);
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong}");
    let found =
        format!("only {snippets} snippets, {lines} command lines, {runs} of them run: what are they marked as?");
    assert!(snippets > 10 && lines > 60 && runs > 5, "{found}");
}

#[test]
fn each_mistake_is_told() {
    let snippet = |info: &str, text: &str| {
        let page = format!("# Page\n\n```{info}\n{text}\n```\n");
        let (blocks, _) = code_of("page.md", &page);
        assert_eq!((blocks.len(), blocks[0].place.as_str()), (1, "page.md:3"));
        wrong_with(&blocks[0])
    };
    assert_eq!(snippet("stl,statements", "U E 0.0; = A 4.0;"), None);
    assert_eq!(snippet("stl", "FUNCTION FC 1 : VOID\nBEGIN\nEND_FUNCTION"), None);
    let max = "CALL FC 25 (IN1 := MW 0, IN2 := MW 2, IN3 := MW 4, RET_VAL := MW 6);";
    assert_eq!(snippet("stl,statements,standard=IEC", max), None);
    assert!(snippet("stl,statements", max).is_some());
    assert_eq!(snippet("stl,statements,refused=S0303", "U E 0.0; JC m; m: NOP 0;"), None);
    for (info, text, part) in [
        ("stl,statements", "U E 0.8;", "page.md:3: the snippet does not compile"),
        ("stl", "U E 0.0;", "S0101"),
        ("stl,statements,refused=S0303", "U E 0.0;", "the snippet compiles"),
        ("stl,statements,refused=S0303", "U E 0.8;", "the fence says S0303"),
        ("stl,statments", "U E 0.0;", "`statments` says nothing on a fence"),
    ] {
        assert!(snippet(info, text).is_some_and(|what| what.contains(part)), "{info} {text}");
    }

    let page = |line: &str| {
        let text = format!("```stl,file=a.awl\nFUNCTION FC 1 : VOID\nBEGIN\nEND_FUNCTION\n```\n\n    {line}\n");
        run_page(&code_of("page.md", &text).0)
    };
    assert_eq!(page("ob1 check a.awl"), (String::new(), 1));
    assert_eq!(page("ob1 run a.toml"), (String::new(), 0));
    assert_eq!(page("ob1 check b.awl    # exit code 1"), (String::new(), 1));
    assert!(page("ob1 check b.awl").0.contains("page.md:7: `ob1 check b.awl` ends with Some(1), not 0"));

    assert_eq!(refused("ob1 get press.toml M1.0 \"MW 10\"    # two cells"), None);
    assert_eq!(refused("target/release/ob1 run a.toml &"), None);
    assert_eq!(refused("ob1 exec --help"), None);
    assert_eq!(refused("echo ob1 nonsense"), None);
    assert!(refused("ob1 exec a.awl --limits 1s").is_some_and(|why| why.contains("--limits")));
    assert!(refused("ob1 stop press.toml").is_some());
    assert_eq!(unknown("ob1 check STATION --verbose"), None);
    assert_eq!(unknown("ob1 exec"), None);
    assert!(unknown("ob1 stop").is_some() && unknown("ob1 check --loud").is_some());
}

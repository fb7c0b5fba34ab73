//! SCL sources of a project beside the blocks that were made of them.

use std::collections::BTreeSet;

use ob1_model::{BlockId, BlockKind};
use ob1_project::{
    Block, CodePage, NewProject, Project, SclSource, SourceText, SymbolRow, Tree, Wanted, has_ok, scl_sources,
    translate,
};
use ob1_stl::{Library, Mnemonics, Options, Source};

/// `FC number (a : INT) q : INT` with other statements, or with those that the option *set OK flag* makes.
fn function(number: u16, with_ok: bool) -> Block {
    let declarations = "VAR_INPUT\n  a : INT ;\nEND_VAR\nVAR_OUTPUT\n  q : INT ;\nEND_VAR\n";
    let statements = if with_ok { "SET; SAVE; = L 0.0; CLR; = L 0.0;" } else { "NOP 0;" };
    let text = format!(
        "FUNCTION FC {number} : VOID\n{declarations}VAR_TEMP\n  t : WORD ;\nEND_VAR\nBEGIN\n{statements}\nEND_FUNCTION\n"
    );
    let output = ob1_stl::compile(&[Source::new("a.awl", text)], &Library::new(), &Options::default());
    assert!(output.is_good(), "{:?}", output.diagnostics);
    let id = BlockId::new(BlockKind::Fc, number);
    let image = ob1_mc7::image(&output.program, id, &|_| None).expect("machine code");
    Block {
        id,
        declarations: Some(format!("\r\n{declarations}VAR_TEMP\n  t : WORD ;\nEND_VAR\n").replace('\n', "\r\n")),
        interface: image.interface,
        segments: image.segments,
        local_bytes: image.head.local_bytes,
        code: image.code,
        ..Block::default()
    }
}

fn source(name: &str, text: &str) -> SourceText {
    SourceText { name: name.into(), stl: name.starts_with("stl"), text: text.into() }
}

fn judged(blocks: Vec<Block>, sources: Vec<SourceText>) -> Vec<SclSource> {
    let symbols = vec![SymbolRow { name: "DOUBLE".into(), international: "FC 1".into(), ..SymbolRow::default() }];
    let project = NewProject {
        name: "plant".into(),
        program: "program".into(),
        blocks,
        sources,
        symbols,
        ..NewProject::default()
    };
    let files = project.files();
    let tree = Tree::new(&files);
    let project = Project::read(&tree, &tree.roots()[0]);
    let choice = project.choices()[0];
    let folder = project.blocks(&tree, choice).expect("a folder");
    let library = Library::new();
    let rows = project.symbols(&tree, choice, &mut Vec::new());
    let symbols: Vec<ob1_ir::Symbol> = rows
        .iter()
        .map(|row| ob1_ir::Symbol { name: row.name.clone(), address: row.international.clone(), ..Default::default() })
        .collect();
    let wanted = Wanted {
        page: CodePage::default(),
        library: &library,
        replaced: &BTreeSet::new(),
        symbols: symbols.clone(),
        mnemonics: Mnemonics::International,
    };
    let translation = translate(&folder, &wanted);
    assert!(
        has_ok(&translation.program, BlockId::new(BlockKind::Fc, 2)),
        "FC 2 has the option: {:?}",
        translation.notes
    );
    scl_sources(&project.sources(&tree, choice), &translation, &library, &symbols, Mnemonics::International)
}

#[test]
fn a_source_stands_in_the_place_of_its_block_where_it_fits() {
    let all = [
        (
            "DOUBLE",
            "(* a\nFUNCTION block (* of *)\ntype x *)\n// one\nFUNCTION DOUBLE : VOID VAR_INPUT a : INT; END_VAR VAR_OUTPUT q : INT; END_VAR BEGIN q := a * 2; END_FUNCTION\n",
        ),
        (
            "with ok",
            "FUNCTION FC2 : VOID VAR_INPUT a : INT; END_VAR VAR_OUTPUT q : INT; END_VAR VAR_TEMP t : INT; END_VAR\nBEGIN t := a; FC1(a := t, q := q); END_FUNCTION\n",
        ),
        (
            "other",
            "FUNCTION FC3 : VOID VAR_INPUT a : DINT; END_VAR VAR_OUTPUT q : INT; END_VAR BEGIN q := 1; END_FUNCTION\n",
        ),
        (
            "renamed",
            "FUNCTION FC4 : VOID VAR_INPUT b : INT; END_VAR VAR_OUTPUT q : INT; END_VAR BEGIN q := b; END_FUNCTION\n",
        ),
        (
            "wrong",
            "FUNCTION FC5 : VOID VAR_INPUT a : INT; END_VAR VAR_OUTPUT q : INT; END_VAR\nBEGIN\nq := gone;\nEND_FUNCTION\n",
        ),
        (
            "double2",
            "FUNCTION FC1 : VOID VAR_INPUT a : INT; END_VAR VAR_OUTPUT q : INT; END_VAR BEGIN q := a + a; END_FUNCTION\n",
        ),
        ("gone", "FUNCTION FC9 : VOID BEGIN ; END_FUNCTION\n"),
        ("data", "DATA_BLOCK DB1 STRUCT a : INT; END_STRUCT BEGIN END_DATA_BLOCK\n"),
        ("list", "DOUBLE;\nother;\n"),
        ("stl", "FUNCTION FC 1 : VOID\nBEGIN\nEND_FUNCTION\n"),
    ];
    let texts: Vec<SourceText> = all.iter().map(|(name, text)| source(name, text)).collect();
    let blocks = [1, 2, 3, 4, 5].into_iter().map(|number| function(number, number == 2)).collect();
    let judged = judged(blocks, texts);
    let said: Vec<(&str, &str)> =
        judged.iter().map(|s| (s.name.as_str(), s.why_not.as_deref().unwrap_or("it fits"))).collect();
    assert_eq!(
        said,
        [
            ("DOUBLE.scl", "it fits"),
            ("with_ok.scl", "it fits"),
            ("other.scl", "it declares other parameters than FC 3 was compiled with"),
            ("renamed.scl", "it declares other parameters than FC 4 was compiled with"),
            ("wrong.scl", "it does not compile here: line 3: gone is not known here (S2101)"),
            ("double2.scl", "FC 1 has another source"),
            ("gone.scl", "FC 9 is not in the program"),
            ("data.scl", "it declares types or data: what the project has counts"),
        ]
    );
    assert!(judged[0].text.starts_with("(* a"));
    assert!(judged[1].text.starts_with("{SCL_SetOKFlag := 'y'} FUNCTION FC2"), "{}", judged[1].text);
}

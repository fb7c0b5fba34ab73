//! What becomes of the blocks of a folder.

use std::collections::BTreeSet;

use ob1_model::{BlockId, BlockKind};
use ob1_project::{Block, CodePage, Folder, NewProject, Project, Translation, Tree, Wanted, translate};
use ob1_stl::{Library, Mnemonics};

/// The blocks of a program as a folder of a project holds them, translated.
fn translated(blocks: Vec<Block>) -> (Folder, Translation) {
    let project = NewProject { name: "plant".into(), program: "program".into(), blocks, ..NewProject::default() };
    let files = project.files();
    let tree = Tree::new(&files);
    let project = Project::read(&tree, &tree.roots()[0]);
    let folder = project.blocks(&tree, project.choices()[0]).expect("a folder");
    let library = Library::new();
    let wanted = Wanted {
        page: CodePage::default(),
        library: &library,
        replaced: &BTreeSet::new(),
        symbols: Vec::new(),
        mnemonics: Mnemonics::International,
    };
    let translation = translate(&folder, &wanted);
    (folder, translation)
}

/// A function with these declarations, their compiled form, and machine code.
fn function(number: u16, declarations: &str, interface: &[u8], code: &[u8]) -> Block {
    let mut compiled = vec![1, 1, 0, interface.len() as u8, 0, 0, 0];
    compiled.extend(interface);
    compiled.push(0);
    Block {
        id: BlockId::new(BlockKind::Fc, number),
        declarations: Some(declarations.replace('\n', "\r\n")),
        interface: compiled,
        code: code.to_vec(),
        segments: vec![1, 0, code.len() as u8 - 2, 0, 0, 0],
        ..Block::default()
    }
}

/// SCL keeps start values of a function's inputs in its declarations.
#[test]
fn start_values_of_a_functions_inputs_stay() {
    let text = "\nVAR_INPUT\n  level : BYTE  := B#16#FF;\t//most\nEND_VAR\n";
    let (_, translation) = translated(vec![function(1, text, &[0x02, 0x01], &[0x65, 0x00])]);
    assert_eq!((translation.notes.as_slice(), translation.printed), (&[][..], 1));
    let text = source(&translation, "FC_1.awl");
    assert!(text.contains("  level : BYTE  := B#16#FF;\t//most\n"), "{text}");
}

fn source(translation: &Translation, name: &str) -> String {
    let file = translation.sources.iter().find(|file| file.name == name).expect("a source");
    String::from_utf8(file.bytes.clone()).expect("text")
}

/// A compiler's own variables, and what pointers made at run time reach, are in no declaration: the head says how much
/// there is.
#[test]
fn a_block_has_the_local_data_of_its_head() {
    // L 5; T LD 30; BE.
    let code = [0x30, 0x03, 0x00, 0x05, 0x7E, 0x67, 0x00, 0x1E, 0x65, 0x00];
    let temp = "\nVAR_TEMP\n  x : WORD ;\t//one\nEND_VAR\n";
    let blocks = vec![
        Block { local_bytes: 40, ..function(1, temp, &[0x04, 0x05], &code) },
        Block { local_bytes: 60, ..function(2, "", &[], &code) },
        Block { local_bytes: 34, ..function(3, temp, &[0x04, 0x05], &code) },
        Block { local_bytes: 0, ..function(4, temp, &[0x04, 0x05], &code) },
    ];
    let (_, translation) = translated(blocks);
    let bytes: Vec<u32> = translation.program.blocks.iter().map(|block| block.interface.temp_bytes).collect();
    assert_eq!((bytes, translation.printed), (vec![40, 60, 34, 34], 4), "{:?}", translation.notes);
    let text = source(&translation, "FC_1.awl");
    let wanted = "VAR_TEMP\n  x : WORD ;\t//one\n  COMPILER_TEMP : ARRAY [1 .. 38] OF BYTE ;\nEND_VAR\n";
    assert!(text.contains(wanted), "{text}");
    assert!(source(&translation, "FC_2.awl").contains("COMPILER_TEMP : ARRAY [1 .. 60] OF BYTE ;\nEND_VAR\nBEGIN"));
    assert!(!source(&translation, "FC_3.awl").contains("COMPILER_TEMP"));
}

/// A block whose declarations are compiled only has made-up names, and that is told: nobody looks for a fault.
#[test]
fn made_up_names_are_told() {
    let with = function(1, "\nVAR_INPUT\n  level : BYTE ;\nEND_VAR\n", &[0x02, 0x01], &[0x65, 0x00]);
    let without = function(2, "", &[0x02, 0x01], &[0x65, 0x00]);
    let (_, translation) = translated(vec![with, without]);
    assert!(source(&translation, "FC_2.awl").contains("IN0 : BYTE"));
    let notes: Vec<String> = translation.notes.iter().map(ToString::to_string).collect();
    assert_eq!(notes.len(), 1, "{notes:?}");
    assert!(
        notes[0].starts_with("names: the project has none for the declarations of 1 block(s), ")
            && notes[0].contains("(FC 2)")
    );
}

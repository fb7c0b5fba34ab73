//! Names and comments of an old project over blocks that were read out of a CPU.

use std::collections::BTreeSet;

use ob1_model::{BlockId, BlockKind};
use ob1_project::{Block, CodePage, Comments, Folder, Network, OldNames, Udt, Wanted, image_of, translate};
use ob1_stl::{Library, Mnemonics};

/// `L n; L DBD n`.
fn network(n: u8) -> Vec<u8> {
    vec![0x30, 0x03, 0x00, n, 0x7E, 0x43, 0x00, n]
}

/// `U M 0.0; JCN; L n; L DBD n; label: NOP 0`, with the jump in its second word.
fn jump(n: u8) -> Vec<u8> {
    let code = network(n);
    [&[0x80, 0x00, 0xFF, 0xB8, 0x00, 0x06][..], &code, &[0x00, 0x00]].concat()
}

fn block(kind: BlockKind, number: u16, interface: &[u8], networks: &[Vec<u8>]) -> Block {
    let mut compiled = vec![if kind == BlockKind::Db { 5 } else { 1 }, number as u8, 0, interface.len() as u8, 0, 0, 0];
    compiled.extend(interface);
    compiled.push(0);
    let code: Vec<u8> = networks.concat().into_iter().chain([0x65, 0x00]).collect();
    let lengths: Vec<u16> = networks.iter().map(|network| network.len() as u16).collect();
    let mut begin = 0;
    let mut jumps = Vec::new();
    for network in networks {
        if network.len() > 10 {
            jumps.push((begin + 2) / 2);
        }
        begin += network.len() as u16;
    }
    let words = |words: &[u16]| {
        let all = [words.len() as u16].into_iter().chain(words.iter().copied());
        all.flat_map(u16::to_le_bytes).collect::<Vec<u8>>()
    };
    Block {
        id: BlockId::new(kind, number),
        interface: compiled,
        code,
        segments: [words(&lengths), words(&jumps)].concat(),
        ..Block::default()
    }
}

fn titles(names: &[&str]) -> Comments {
    let network = |name: &&str| Network { title: (*name).into(), comment: format!("of {name}"), ..Network::default() };
    Comments { title: "all".into(), networks: names.iter().map(network).collect(), ..Comments::default() }
}

/// Both interfaces begin with a word; the second has a bit more.
const WORD: &[u8] = &[0x04, 0x01];
const WORD_AND_BIT: &[u8] = &[0x04, 0x01, 0x01, 0x01];
const LEVEL: &str = "\r\nVAR_INPUT\r\n  level : WORD ;\t//of the tank\r\nEND_VAR\r\n";

fn folder(blocks: Vec<Block>) -> Folder {
    Folder { blocks: blocks.into_iter().map(|block| (block.id, block)).collect(), ..Folder::default() }
}

/// The blocks as a CPU gives them, with the names of the old project.
fn laid(here: &Folder, old: &Folder) -> (Folder, OldNames) {
    let bytes = here.blocks.iter().map(|(id, block)| (id.to_string(), image_of(block).bytes().expect("short")));
    let mut folder = Folder::of_upload(bytes);
    assert!(folder.damaged.is_empty(), "{:?}", folder.damaged);
    let names = folder.take_names(old);
    (folder, names)
}

fn source(folder: &Folder, name: &str) -> String {
    let library = Library::new();
    let wanted = Wanted {
        page: CodePage::default(),
        library: &library,
        replaced: &BTreeSet::new(),
        symbols: Vec::new(),
        mnemonics: Mnemonics::International,
    };
    let translation = translate(folder, &wanted);
    let file = translation.sources.iter().find(|file| file.name == name);
    let file = file.unwrap_or_else(|| panic!("{name}: {:?} {:?}", translation.left_out, translation.notes));
    String::from_utf8(file.bytes.clone()).expect("text")
}

fn told(names: &OldNames) -> String {
    names.notes.iter().map(|note| format!("{note}\n")).collect()
}

fn old_function(number: u16) -> Block {
    let mut old = block(BlockKind::Fc, number, WORD, &[network(1), jump(2), network(3)]);
    old.declarations = Some(LEVEL.into());
    old.comments = titles(&["first", "second", "third"]);
    old.comments.labels = vec!["out".into()];
    old
}

#[test]
fn a_block_that_is_the_same_has_all_of_it_and_nothing_is_told() {
    let old = folder(vec![old_function(7)]);
    let (here, names) = laid(&folder(vec![old_function(7)]), &old);
    assert_eq!((names.taken.len(), told(&names)), (1, String::new()));
    let text = source(&here, "FC_7.awl");
    for wanted in ["level : WORD ;\t//of the tank", "TITLE = first", "TITLE = second", "JCN out;", "//of third"] {
        assert!(text.contains(wanted), "{wanted}\n{text}");
    }
}

#[test]
fn one_that_has_moved_is_found_and_told() {
    let here = folder(vec![old_function(9)]);
    let (here, names) = laid(&here, &folder(vec![old_function(7)]));
    let text = source(&here, "FC_9.awl");
    assert!(told(&names).starts_with("FC 9: it is the same as FC 7 of the old project"), "{}", told(&names));
    assert!(text.contains("level : WORD") && text.contains("TITLE = second"), "{text}");
    // Two candidates: neither.
    let twins = folder(vec![old_function(7), old_function(8)]);
    let (_, names) = laid(&folder(vec![old_function(9)]), &twins);
    assert_eq!((names.taken.len(), told(&names).contains("no such block")), (0, true), "{}", told(&names));
}

#[test]
fn a_changed_block_keeps_the_names_of_what_is_as_it_was() {
    let mut new = block(BlockKind::Fc, 7, WORD_AND_BIT, &[network(9), network(1), network(8), jump(2), network(5)]);
    new.local_bytes = 0;
    let (here, names) = laid(&folder(vec![new]), &folder(vec![old_function(7)]));
    assert!(told(&names).contains("FC 7: it has changed since the old project: other declarations, 2 of 5 networks"));
    let networks = &here.blocks[&BlockId::new(BlockKind::Fc, 7)].comments.networks;
    let titles: Vec<&str> = networks.iter().map(|network| network.title.as_str()).collect();
    assert_eq!(titles, ["", "first", "", "second", "third"], "the last in the place of the one that changed");
    let text = source(&here, "FC_7.awl");
    assert!(
        text.contains("  level : WORD ;") && text.contains("  IN1 : BOOL ;") && text.contains("JCN out;"),
        "{text}"
    );
    // Another block of that number.
    let other = block(BlockKind::Fc, 7, &[0x01, 0x02], &[network(100), network(101)]);
    let (here, names) = laid(&folder(vec![other]), &folder(vec![old_function(7)]));
    assert!(told(&names).contains("FC 7: the old project has another block"), "{}", told(&names));
    assert!(source(&here, "FC_7.awl").contains("OUT0 : BOOL"));
}

#[test]
fn data_and_types_have_their_names_as_far_as_they_agree() {
    let data = |interface: &[u8], values: &[u8]| Block {
        code: values.to_vec(),
        segments: Vec::new(),
        ..block(BlockKind::Db, 3, interface, &[])
    };
    let mut old_data = data(&[0x05, 0x04, 0x08, 0x04], &[0; 6]);
    old_data.declarations = Some("\r\nSTRUCT\r\n  starts : INT ;\r\n  limit : REAL ;\r\n END_STRUCT ;\r\n".into());
    let mut old = folder(vec![old_data]);
    let declarations = "\r\nSTRUCT \r\n  Row : CHAR ;\r\n END_STRUCT ;\r\n".to_owned();
    old.udts.insert(1, Udt { declarations, head: ob1_project::Head::default() });
    let (here, names) = laid(&folder(vec![data(&[0x05, 0x04, 0x08, 0x04], &[0, 5, 0, 0, 0, 0])]), &old);
    assert_eq!(told(&names), "");
    let text = source(&here, "DB_3.awl");
    assert!(text.contains("starts : INT") && text.contains("starts := 5"), "{text}");
    assert!(source(&here, "UDT_1.awl").contains("Row : CHAR"));
    // A component more, and another type at the end.
    let longer = data(&[0x05, 0x04, 0x07, 0x04, 0x05, 0x04], &[0, 5, 0, 0, 0, 1, 0, 9]);
    let (here, names) = laid(&folder(vec![longer]), &old);
    assert!(told(&names).contains("DB 3: it has changed"), "{}", told(&names));
    let text = source(&here, "DB_3.awl");
    assert!(text.contains("starts : INT") && !text.contains("limit") && text.contains("starts := 5"), "{text}");
}

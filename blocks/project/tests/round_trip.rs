//! What is written is read back; damage is reported and has no further effect.

use ob1_model::{BlockId, BlockKind};
use ob1_project::{
    Area, Block, CodePage, Comments, Cpu, CpuParameters, Cyclic, DpModule, DpSlave, DpSystem, FileSource, Files,
    Folder, Head, Line, Module, Network, NewProject, Project, SourceText, SymbolRow, Tree, Udt,
};
use proptest::prelude::*;

fn example() -> NewProject {
    let block = |kind, number, declarations: &str| Block {
        id: BlockId::new(kind, number),
        declarations: Some(declarations.to_owned()),
        code: vec![0x65, 0x00],
        interface: vec![1, 0, 0, 0, 0, 0, 0, 0],
        segments: vec![1, 0, 0, 0, 0, 0],
        ..Block::default()
    };
    let comments = Comments {
        title: "Насос".into(),
        comment: "two\nlines".into(),
        networks: vec![Network {
            title: "N".into(),
            comment: String::new(),
            lines: vec![Line { statement: 3, behind: true, text: "пуск".into() }],
        }],
        labels: vec!["M001".into(), "go".into()],
        damaged: false,
    };
    let head = Head { author: "me".into(), family: "pumps".into(), name: "pump".into(), version: 0x11 };
    NewProject {
        name: "plant".into(),
        page: CodePage::of_number(1251).expect("1251"),
        program: "S7 Program(1)".into(),
        blocks: vec![
            block(BlockKind::Ob, 1, "\r\nVAR_TEMP\r\n  x : ARRAY  [0 .. 19 ] OF BYTE ;\r\nEND_VAR\r\n"),
            Block { comments, head, know_how: true, local_bytes: 6, ..block(BlockKind::Fb, 7, "") },
            Block { code: vec![1, 2], ..block(BlockKind::Db, 300, "\r\nSTRUCT\r\n  a : INT ;\r\nEND_STRUCT ;\r\n") },
        ],
        udts: vec![(
            5,
            Udt { declarations: "\r\nSTRUCT\r\n  b : BOOL ;\r\nEND_STRUCT ;\r\n".into(), head: Head::default() },
        )],
        symbols: vec![SymbolRow {
            name: "Насос вкл".into(),
            german: "E 1.0".into(),
            international: "I 1.0".into(),
            ty: "BOOL".into(),
            comment: String::new(),
        }],
        sources: vec![
            SourceText {
                name: "насос".into(),
                stl: false,
                text: "FUNCTION FC1 : VOID\r\n// пуск\r\nEND_FUNCTION\r\n".into(),
            },
            SourceText { name: "stl".into(), stl: true, text: String::new() },
        ],
        cpu: Some(Cpu {
            name: "CPU 315-2 DP".into(),
            s7_400: false,
            station: "Plant".into(),
            program: Some(1),
            parameters: CpuParameters {
                monitoring_ms: Some(200),
                clock_memory: Some(99),
                cyclic: (30..39).map(|ob| Cyclic { ob, period_ms: u16::from(ob) * 10, phase_ms: 1 }).collect(),
                other: Vec::new(),
            },
        }),
        dp: Vec::new(),
        modules: vec![Module {
            name: "DI16xDC24V".into(),
            order: "6ES7 321-1BH02-0AA0".into(),
            station: "Plant".into(),
            place: (0, 4, 0),
            inputs: vec![Area { first: 0, bytes: 2 }, Area { first: 300, bytes: 1 }],
            outputs: Vec::new(),
        }],
    }
}

/// Reads everything there is, as the command does.
fn read_all(files: &Files) -> Option<(Project, Vec<Folder>)> {
    let tree = Tree::new(files);
    let project = Project::read(&tree, tree.roots().first()?);
    let mut folders = Vec::new();
    for choice in project.choices() {
        folders.extend(project.blocks(&tree, choice));
        let _ =
            (project.symbols(&tree, choice, &mut Vec::new()), project.sources(&tree, choice), project.title(choice));
    }
    Some((project, folders))
}

/// A STEP 7 on a Windows of another language wrote its own code page into the project.
#[test]
fn texts_are_read_in_the_code_page_that_is_asked_for() {
    let mut files = example().files();
    files.put("Global/Language", "1\r\n1031\r\n0\r\n1252\r\n850\r\n");
    let tree = Tree::new(&files);
    let symbol = |page| {
        let project = Project::read_as(&tree, &tree.roots()[0], page);
        project.symbols(&tree, project.choices()[0], &mut Vec::new())[0].name.clone()
    };
    assert_eq!(symbol(None), "Íàñîñ âêë");
    assert_eq!(symbol(CodePage::of_number(1251)), "Насос вкл");
}

/// Slaves of a GSD file, and one of STEP 7's own catalogue; they come in the order of their addresses.
#[test]
fn a_master_system_is_read_with_its_slaves() {
    let module = |slot, gsd: &str, identifier: &[u8], inputs: &[Area], outputs: &[Area]| DpModule {
        slot,
        name: format!("{slot}"),
        gsd: gsd.into(),
        identifier: identifier.to_vec(),
        inputs: inputs.to_vec(),
        outputs: outputs.to_vec(),
        ..DpModule::default()
    };
    let area = |first, bytes| Area { first, bytes };
    let drive = DpSlave {
        name: "MOVIDRIVE".into(),
        address: 3,
        parameters: vec![0xC4, 0, 0, 6],
        diagnostic: Some(2046),
        modules: vec![
            module(4, "6 PD   (6 words)", &[0], &[], &[]),
            DpModule { goes_on: true, ..module(5, "6 PD   (6 words)", &[0xF5], &[area(256, 12)], &[area(256, 12)]) },
        ],
    };
    let rack = DpSlave {
        name: "IM 153-1".into(),
        address: 12,
        parameters: Vec::new(),
        diagnostic: None,
        modules: vec![DpModule { order: "6ES7 321-1BL00-0AA".into(), ..module(4, "", &[], &[area(8, 4)], &[]) }],
    };
    let system = DpSystem {
        name: "PROFIBUS(1)".into(),
        station: "Plant".into(),
        master: "CPU 315-2 DP".into(),
        slaves: vec![drive.clone(), rack.clone()],
    };
    let turned = DpSystem { slaves: vec![rack, drive], ..system.clone() };
    let (project, _) = read_all(&NewProject { dp: vec![turned], ..example() }.files()).expect("a project");
    assert_eq!(project.hardware.dp, [system]);
    assert_eq!(project.notes, []);
    let others: Vec<_> = project.hardware.modules.iter().map(|m| (m.place, m.inputs.len())).collect();
    assert_eq!(others, [((0, 4, 0), 2), ((3, 5, 0), 1), ((12, 4, 0), 1)], "they are modules too");
}

#[test]
fn what_is_written_is_read() {
    let example = example();
    let files = example.files();
    let (project, folders) = read_all(&files).expect("a project");
    assert_eq!((project.name.as_str(), project.notes.as_slice()), ("plant", &[][..]));
    assert_eq!(project.default_choice(), project.named("CPU 315-2 dp"));
    assert_eq!(project.title(project.choices()[0]), "Plant/CPU 315-2 DP/S7 Program(1)");
    assert_eq!(project.named("00000001"), project.choices());
    assert_eq!(project.named("nobody"), []);
    assert_eq!(project.hardware.cpus, example.cpu.into_iter().collect::<Vec<_>>());
    assert_eq!(project.hardware.modules, example.modules);
    let tree = Tree::new(&files);
    assert_eq!(project.symbols(&tree, project.choices()[0], &mut Vec::new()), example.symbols);
    assert_eq!(project.sources(&tree, project.choices()[0]), example.sources);
    let folder = &folders[0];
    assert_eq!(folder.notes, []);
    assert_eq!(folder.blocks.len(), 3);
    for block in &example.blocks {
        let read = &folder.blocks[&block.id];
        assert_eq!(read.declarations, block.declarations);
        assert_eq!((&read.code, &read.interface, &read.segments), (&block.code, &block.interface, &block.segments));
        assert_eq!((&read.comments, &read.head), (&block.comments, &block.head));
        assert_eq!(
            (read.know_how, read.local_bytes, read.language),
            (block.know_how, block.local_bytes, block.language)
        );
    }
    assert_eq!(folder.udts[&5], example.udts[0].1);
}

#[test]
fn files_that_are_missing_are_told() {
    let whole = example().files();
    for (missing, told) in [
        ("ombstx/offline/00000001/SUBBLK.DBT", "memo file"),
        ("hrs/linkhrs.lnk", "linkhrs.lnk"),
        ("hrs/S7RESOFF.DBF", "S7RESOFF.DBF"),
        ("Global/Language", "1252"),
        ("ombstx/offline/BSTCNTOF.DBF", "BSTCNTOF.DBF"),
        ("hOmSave7/s7hk32ax/HATTRME1.DBT", "addresses are lost"),
    ] {
        let mut files = whole.clone();
        files.0.remove(missing).expect(missing);
        let (project, folders) = read_all(&files).expect("a project");
        let mut notes: Vec<String> = project.notes.iter().map(ToString::to_string).collect();
        notes.extend(folders.iter().flat_map(|f| &f.notes).map(ToString::to_string));
        assert!(notes.iter().any(|note| note.contains(told)), "{missing}: {notes:?}");
        // The blocks are found nevertheless, those whose content is lost by name.
        let found: usize = folders.iter().map(|f| f.blocks.len() + f.damaged.len()).sum();
        assert!(found >= 3, "{missing}: {found}");
    }
}

/// A disk that was full, a copy that was ended: the rest of a table is gone, and nothing else shows it.
#[test]
fn tables_that_are_cut_off_are_told() {
    let whole = example().files();
    for cut in [
        "hrs/S7RESOFF.DBF",
        "ombstx/offline/00000001/SUBBLK.DBF",
        "YDBs/101/SYMLIST.DBF",
        "hOmSave7/s7hk32ax/HOBJECT1.DBF",
        "hOmSave7/s7hk32ax/HATTRME1.DBF",
    ] {
        let mut files = whole.clone();
        let bytes = files.0.get_mut(cut).expect(cut);
        bytes.truncate(bytes.len() - 8);
        let tree = Tree::new(&files);
        let project = Project::read(&tree, &tree.roots()[0]);
        let mut notes = project.notes.clone();
        let choice = project.choices()[0];
        notes.extend(project.blocks(&tree, choice).expect("a folder").notes);
        let _ = project.symbols(&tree, choice, &mut notes);
        let told = notes.iter().any(|note| note.of == cut && note.what.contains("1 records are missing"));
        assert!(told, "{cut}: {notes:?}");
    }
}

/// Files that are there and cannot be read, as those of an archive with a password.
#[derive(Debug)]
struct Locked(Files, &'static str);

impl FileSource for Locked {
    fn paths(&self) -> Vec<String> {
        self.0.paths()
    }

    fn read(&self, path: &str) -> Result<Vec<u8>, String> {
        if path.contains(self.1) { Err("it has a password".to_owned()) } else { self.0.read(path) }
    }
}

#[test]
fn what_is_there_and_cannot_be_read_is_not_called_missing() {
    let locked = Locked(example().files(), "offline");
    let tree = Tree::new(&locked);
    let project = Project::read(&tree, &tree.roots()[0]);
    let notes: Vec<String> = project.notes.iter().map(ToString::to_string).collect();
    assert!(notes.iter().any(|note| note.contains("BSTCNTOF.DBF: it has a password")), "{notes:?}");
    let why = project.blocks(&tree, project.choices()[0]).expect_err("it is locked");
    assert!(why.contains("SUBBLK.DBF: it has a password"), "{why}");
    let locked = Locked(example().files(), "HATTRME1.DBT");
    let tree = Tree::new(&locked);
    let notes: Vec<String> = Project::read(&tree, &tree.roots()[0]).notes.iter().map(ToString::to_string).collect();
    let told = "its addresses are lost: the memo file (.DBT) cannot be read: it has a password";
    assert!(notes.iter().any(|note| note.contains(told)), "{notes:?}");
    let locked = Locked(example().files(), "SUBBLK.DBT");
    let tree = Tree::new(&locked);
    let folder = project.blocks(&tree, project.choices()[0]).expect("names");
    let told = "the memo file (.DBT) cannot be read: it has a password";
    assert!(!folder.damaged.is_empty() && folder.damaged.values().all(|why| why == told), "{:?}", folder.damaged);
}

/// One address is enough.
#[test]
fn a_symbol_without_its_international_address_keeps_the_german_one() {
    let mut example = example();
    example.symbols[0].international.clear();
    let files = example.files();
    let tree = Tree::new(&files);
    let project = Project::read(&tree, &tree.roots()[0]);
    let rows = project.symbols(&tree, project.choices()[0], &mut Vec::new());
    assert_eq!((rows.len(), rows[0].international.as_str()), (1, "E 1.0"));
}

/// The programs are gone, the symbols are not.
#[test]
fn the_only_symbol_table_is_taken_where_no_program_names_it() {
    for missing in [&["hrs/S7RESOFF.DBF"][..], &["hrs/linkhrs.lnk", "YDBs/YLNKLIST.DBF"]] {
        let mut files = example().files();
        for file in missing {
            files.0.remove(*file).expect(file);
        }
        let tree = Tree::new(&files);
        let project = Project::read(&tree, &tree.roots()[0]);
        let mut notes = Vec::new();
        assert_eq!(project.symbols(&tree, project.choices()[0], &mut notes), example().symbols, "{missing:?}");
        assert!(notes.iter().any(|note| note.of == "YDBs"), "{notes:?}");
    }
}

/// Programs of two stations, whose hardware is gone: each can be chosen by what the list calls it.
#[test]
fn programs_of_one_name_are_told_apart() {
    let whole = NewProject { cpu: None, ..example() }.files();
    let tree = Tree::new(&whole);
    let mut project = Project::read(&tree, &tree.roots()[0]);
    assert_eq!(project.title(project.choices()[0]), "S7 Program(1)");
    let (mut program, mut folder) = (project.programs[0].clone(), project.folders[0].clone());
    (program.id, program.folder, folder.id) = (2, Some(0x1A), 0x1A);
    project.programs.push(program);
    project.folders.push(folder);
    let titles: Vec<String> = project.choices().into_iter().map(|choice| project.title(choice)).collect();
    assert_eq!(titles, ["S7 Program(1) (00000001)", "S7 Program(1) (0000001a)"]);
    for (title, choice) in titles.iter().zip(project.choices()) {
        assert_eq!(project.named(title), [choice]);
    }
    assert_eq!(project.named("S7 Program(1)").len(), 2);
    // None belongs to a CPU: both come back.
    assert_eq!(project.default_choice(), project.choices());
}

/// Without the list of block folders the one that has blocks is taken, not the first.
#[test]
fn blocks_are_counted_where_the_project_does_not_count_them() {
    let mut files = example().files();
    let empty = files.0["ombstx/offline/00000001/SUBBLK.DBF"].clone();
    for name in ["SUBBLK.DBF", "SUBBLK.DBT"] {
        let bytes = files.0.remove(&format!("ombstx/offline/00000001/{name}")).expect("a table of blocks");
        files.put(&format!("ombstx/offline/00000002/{name}"), bytes);
    }
    // No records.
    let header = usize::from(u16::from_le_bytes([empty[8], empty[9]]));
    let mut empty = empty[..header].to_vec();
    empty[4..8].fill(0);
    files.put("ombstx/offline/00000001/SUBBLK.DBF", empty);
    for missing in ["ombstx/offline/BSTCNTOF.DBF", "hrs/S7RESOFF.DBF", "hrs/linkhrs.lnk"] {
        files.0.remove(missing).expect(missing);
    }
    let (project, _) = read_all(&files).expect("a project");
    let chosen: Vec<u32> = project.default_choice().iter().map(|c| project.folders[c.folder].id).collect();
    assert_eq!(chosen, [2], "{:?}", project.folders);
    let counts: Vec<u32> = project.folders.iter().map(|folder| folder.blocks).collect();
    assert_eq!(counts, [0, example().blocks.len() as u32]);
}

#[test]
fn a_memo_file_that_is_cut_off_costs_its_blocks_alone() {
    let mut files = example().files();
    let memo = files.0.get_mut("ombstx/offline/00000001/SUBBLK.DBT").expect("a memo file");
    memo.truncate(1024);
    let (_, folders) = read_all(&files).expect("a project");
    assert!(!folders[0].damaged.is_empty(), "{:?}", folders[0]);
    assert!(folders[0].damaged.values().all(|why| why.contains(".DBT")), "{:?}", folders[0].damaged);
}

/// The second record of a stream of comments says that it is longer than the stream.
#[test]
fn comments_that_end_in_the_middle_are_told() {
    let mut files = example().files();
    let memo = files.0.get_mut("ombstx/offline/00000001/SUBBLK.DBT").expect("a memo file");
    let comment = CodePage::of_number(1251).expect("1251").bytes("пуск");
    let at = memo.windows(4).position(|bytes| bytes == comment).expect("the comment of a line");
    memo[at - 6] = 200;
    let (_, folders) = read_all(&files).expect("a project");
    let notes: Vec<String> = folders[0].notes.iter().map(ToString::to_string).collect();
    assert!(notes.iter().any(|note| note.contains("FB 7: its comments end")), "{notes:?}");
    assert_eq!(folders[0].blocks[&BlockId::new(BlockKind::Fb, 7)].comments.networks[0].lines, []);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    /// Bytes are changed, files cut off and removed anywhere: nothing panics, nothing takes more than there is.
    #[test]
    fn damage_does_no_harm(changes in prop::collection::vec((any::<prop::sample::Index>(), any::<prop::sample::Index>(), 0u8..4, any::<u8>()), 1..12)) {
        let mut files = example().files();
        for (file, at, what, byte) in changes {
            let names: Vec<String> = files.0.keys().cloned().collect();
            let name = file.get(&names).clone();
            let Some(bytes) = files.0.get_mut(&name).filter(|bytes| !bytes.is_empty()) else { continue };
            let place = at.index(bytes.len());
            match what {
                0 => bytes.truncate(place),
                1 => drop(files.0.remove(&name)),
                _ => bytes[place] = byte,
            }
        }
        let _ = read_all(&files);
    }
}

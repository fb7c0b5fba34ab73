//! `ob1 import`: the example becomes a running station; damaged parts are omitted and reported; exit codes and JSON.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use ob1_mc7::CompiledInterface;
use ob1_model::{BlockId, BlockKind};
use ob1_project::{Area, Block, Cpu, DpModule, DpSlave, DpSystem, Files, Head, NewProject, Udt};
use ob1_tests::step7;
use serde_json::Value;

use crate::common::checkout;
use crate::common::site::Site;

fn put(files: &Files, folder: &Path) {
    for (name, bytes) in &files.0 {
        let path = folder.join(name);
        fs::create_dir_all(path.parent().expect("a folder")).expect("room");
        fs::write(path, bytes).expect("room");
    }
}

pub(crate) fn project(site: &Site, files: &Files) -> String {
    let folder = site.path("project");
    put(files, &folder);
    folder.display().to_string()
}

pub(crate) fn text(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// All files below a folder.
fn files_of(folder: &Path, below: &str, found: &mut BTreeMap<String, Vec<u8>>) {
    for entry in fs::read_dir(folder.join(below)).expect("a folder").flatten() {
        let name = format!("{below}{}", entry.file_name().to_string_lossy());
        if entry.path().is_dir() {
            files_of(folder, &format!("{name}/"), found);
        } else if name != "README.md" {
            found.insert(name.clone(), fs::read(folder.join(&name)).expect("a file"));
        }
    }
}

/// The folder in `examples` matches the output of the encoder. OB1_BLESS=1 writes it.
#[test]
fn the_example_is_what_the_encoder_writes() {
    let folder = checkout("examples/step7-project");
    let made = step7::example().files();
    if std::env::var_os("OB1_BLESS").is_some() {
        put(&made, &folder);
    }
    let mut found = BTreeMap::new();
    files_of(&folder, "", &mut found);
    assert_eq!(found.keys().collect::<Vec<_>>(), made.0.keys().collect::<Vec<_>>());
    for (name, bytes) in &made.0 {
        assert_eq!(found.get(name), Some(bytes), "{name}; OB1_BLESS=1 writes it anew");
    }
}

/// A master system with one slave whose GSD file is available, and one without.
fn with_slaves() -> Files {
    let module = |slot, gsd: &str, inputs: &[Area], outputs: &[Area]| DpModule {
        slot,
        name: "66".into(),
        gsd: gsd.into(),
        identifier: vec![0x42],
        inputs: inputs.to_vec(),
        outputs: outputs.to_vec(),
        ..DpModule::default()
    };
    let area = |first| [Area { first, bytes: 2 }];
    let rack = DpSlave {
        name: "Rack \"north\"\n[[bus]]".into(),
        address: 2,
        diagnostic: Some(2040),
        modules: vec![module(4, "DI 16 x DC 24V", &area(400), &[]), module(5, "DO 16  x DC 24V", &[], &area(400))],
        ..DpSlave::default()
    };
    let drive = DpSlave {
        name: "Drive".into(),
        address: 7,
        modules: vec![module(4, "PPO 1", &area(410), &[])],
        ..DpSlave::default()
    };
    let system = DpSystem { name: "PROFIBUS(1)".into(), slaves: vec![rack, drive], ..DpSystem::default() };
    NewProject { dp: vec![system], ..step7::example() }.files()
}

#[test]
fn slaves_become_a_bus_with_their_gsd_files_and_stay_plain_bytes_without() {
    let site = Site::new();
    let project = project(&site, &with_slaves());
    let gsd = checkout("driver/dp/tests").display().to_string();
    for (n, options) in [&[][..], &["--gsd", &gsd]].into_iter().enumerate() {
        let out = site.path(format!("station{n}"));
        let folder = out.display().to_string();
        site.ob1(&[&["import", &project, "--out", &folder][..], options].concat()).fine();
        let (station, report) = (text(&out.join("station.toml")), text(&out.join("report.txt")));
        let file = out.join("station.toml").display().to_string();
        let checked = site.ob1(&["check", &file, "--verbose"]).fine();
        let has = |what: &str| station.lines().any(|line| line == what);
        // For the second slave only its modules are known.
        assert!(has("#     { slot = 1, module = \"PPO 1\", inputs = \"EB 410\" },"), "{station}");
        assert!(report.contains("DP slave 7 (Drive)"), "{report}");
        assert!(checked.contains("inputs, bytes 410..411"), "{checked}");
        if options.is_empty() {
            assert!(!has("[[bus]]") && checked.contains("inputs, bytes 400..401"), "{station}\n{checked}");
            assert!(report.contains("--gsd") && has("# station = 2"), "{report}\n{station}");
            continue;
        }
        assert!(
            has("[[bus]]") && has("type = \"dp\"") && has("station = 2") && has("gsd = \"gsd/ET200M.GSD\""),
            "{station}"
        );
        // The master gets another address, because a slave has its default address.
        assert!(has("address = 0") && has("diagnostic = 2040"), "{station}");
        assert!(has("    { slot = 2, module = \"DO 16 x DC 24V\", outputs = \"AB 400\" },"), "{station}");
        assert!(out.join("gsd/ET200M.GSD").is_file());
        assert!(
            checked.contains("coupler on profibus-1, inputs 400..401") && !checked.contains("inputs, bytes 400"),
            "{checked}"
        );
        assert!(report.contains("1 of 2 slaves are on the bus profibus-1"), "{report}");
    }
    assert_eq!(site.ob1(&["import", &project, "--out", "x", "--gsd", "nowhere"]).code, Some(2));
}

/// Blocks out of a CPU with the old project beside them: the sources are those of an import of the project.
#[test]
fn blocks_out_of_a_cpu_have_the_names_of_the_old_project() {
    let site = Site::new();
    let mut example = step7::example();
    let of_function = ob1_project::SymbolRow {
        name: "Hidden".into(),
        german: "FC     2".into(),
        international: "FC     2".into(),
        ty: "FC     2".into(),
        comment: String::new(),
    };
    example.symbols.push(of_function);
    let project = project(&site, &example.files());
    // In the CPU the function FC 2 is FC 5 now.
    let blocks = site.path("blocks");
    fs::create_dir_all(&blocks).expect("room");
    for block in &mut example.blocks {
        if block.id == BlockId::new(BlockKind::Fc, 2) {
            block.id.number = 5;
        }
        let bytes = ob1_project::image_of(block).bytes().expect("short");
        fs::write(blocks.join(format!("{}{}.mc7", block.id.kind.name(), block.id.number)), bytes).expect("room");
    }
    let import = |out: &str, more: &[&str]| {
        let folder = site.path(out).display().to_string();
        site.ob1(&[&["import", more[0], "--out", &folder][..], &more[1..]].concat());
        // An upload has no symbols.
        let read = |name: &str| fs::read_to_string(site.path(out).join(name)).unwrap_or_default();
        (read("blocks/OB_1.awl"), read("blocks/DB_1.awl"), read("symbols.sdf"), read("report.txt"))
    };
    let blocks = blocks.display().to_string();
    let direct = import("direct", &[&project]);
    let named = import("named", &[&blocks, "--names-from", &project]);
    let bare = import("bare", &[&blocks]);
    assert_eq!((&named.0, &named.1), (&direct.0, &direct.1));
    let moved = direct.2.replace("FC 2", "FC 5");
    assert_eq!(named.2, moved, "a symbol goes where its block has gone");
    assert!(named.3.contains("FC 5: it is the same as FC 2 of the old project"), "{}", named.3);
    assert!(named.3.contains("4 of 4 blocks have the names of"), "{}", named.3);
    assert!(
        direct.0.contains("\"Motor\"") && bare.0.contains("CALL") && bare.0 != direct.0 && bare.1 != direct.1,
        "{}",
        bare.0
    );
    let refused = site.ob1(&["import", &project, "--out", "x", "--names-from", &project]);
    assert!(refused.code == Some(2) && refused.err.contains("it is a project"), "{refused:?}");
}

#[test]
fn the_example_runs() {
    let site = Site::new();
    let example = checkout("examples/step7-project").display().to_string();
    let out = site.path("station");
    let said = site.ob1(&["import", &example, "--out", &out.display().to_string(), "--json"]).fine();
    let json: Value = serde_json::from_str(&said).expect("JSON");
    let keys: Vec<&String> = json.as_object().expect("an object").keys().collect();
    assert_eq!(keys, ["blocks", "decoded", "errors", "files", "left_out", "program", "programs"]);
    assert_eq!((&json["blocks"], &json["decoded"]), (&Value::from(4), &Value::from(4)));
    assert_eq!(json["program"], "Conveyor/CPU 315-2 DP/S7 Program(1)");
    let analog = "type = \"ai\"\nname = \"ai-0-6\"\naddress = 288\nchannels = 8\n";
    assert!(text(&out.join("station.toml")).contains(analog));
    assert_eq!(json["left_out"], Value::Array(Vec::new()));
    for file in json["files"].as_array().expect("a list") {
        assert!(out.join(file.as_str().expect("a name")).is_file(), "{file}");
    }
    let main = text(&out.join("blocks/OB_1.awl"));
    for wanted in [
        "CALL FC 1",
        "Start := \"Start button\"",
        "FP M 10.0;  // it has started",
        "JCN run",
        "run: ",
        "TITLE = Conveyor",
    ] {
        assert!(main.replace("  ", " ").contains(&wanted.replace("  ", " ")), "{wanted} is not in\n{main}");
    }
    assert!(text(&out.join("blocks/FC_1.awl")).contains("Made in LAD"));
    let hidden = text(&out.join("blocks/FC_2.awl"));
    assert!(
        hidden.contains("Value : INT") && !hidden.contains("+ 7") && out.join("blocks/FC_2.mc7").is_file(),
        "{hidden}"
    );
    let data = text(&out.join("blocks/DB_1.awl"));
    for wanted in [
        "Limit : REAL  := 1.000000e+001",
        "Starts := 3",
        "Limit := 1.25e",
        "Place.Row := 'A'",
        "Place.Column := W#16#7",
    ] {
        assert!(data.contains(wanted), "{wanted} is not in\n{data}");
    }
    let station = text(&out.join("station.toml"));
    for wanted in ["watchdog = \"200ms\"", "clock_memory = 100", "address = 288", "DO16xDC24V"] {
        assert!(station.contains(wanted), "{wanted} is not in\n{station}");
    }
    let file = out.join("station.toml").display().to_string();
    let checked = site.ob1(&["check", &file]).fine();
    assert!(checked.ends_with("ok\n"), "nothing is wrong with its machine code: {checked}");
    site.ob1(&["run", &file, "--scans", "20", "--quiet"]).fine();
    // Of this block there are declarations only: without its machine code it would do nothing.
    for content in [&[][..], &[0; 80]] {
        fs::write(out.join("blocks/FC_2.mc7"), content).expect("room");
        let checked = site.ob1(&["check", &file]);
        let said = format!("{}{}", checked.out, checked.err);
        assert!(checked.code == Some(1) && said.contains("FC_2.mc7: error C019: the file is empty\n"), "{said}");
    }
}

/// The name of a CPU is the user's; the folder it lies in says which family it is of.
#[test]
fn a_cpu_of_an_s7_400_is_known_under_any_name() {
    let site = Site::new();
    let mut made = step7::example();
    made.cpu = made.cpu.map(|cpu| Cpu { name: "Hall 3".into(), s7_400: true, ..cpu });
    let out = site.path("station").display().to_string();
    site.ob1(&["import", &project(&site, &made.files()), "--out", &out]).fine();
    let station = text(&site.path("station/station.toml"));
    assert!(station.contains("# Hall 3\nfamily = 400\n"), "{station}");
}

#[test]
fn what_is_damaged_is_left_out_and_told() {
    let site = Site::new();
    let mut files = step7::example().files();
    // An unknown statement in the middle of FC 1.
    let memo = files.0.get_mut("ombstx/offline/00000001/SUBBLK.DBT").expect("a memo file");
    let at = memo.windows(4).position(|bytes| bytes == [0xFB, 0x82, 0x00, 0x06]).expect("FC 1");
    memo[at..at + 2].copy_from_slice(&[0x7F, 0x7F]);
    let example = project(&site, &files);
    let out = site.path("station").display().to_string();
    let said = site.ob1(&["import", &example, "--out", &out, "--json"]);
    assert_eq!(said.code, Some(1), "{}{}", said.out, said.err);
    let json: Value = serde_json::from_str(&said.out).expect("JSON");
    assert_eq!((&json["blocks"], &json["decoded"]), (&Value::from(4), &Value::from(3)));
    assert_eq!(json["left_out"][0]["block"], "FC 1");
    assert!(json["left_out"][0]["reason"].as_str().is_some_and(|why| why.contains("S1501")), "{json}");
    let report = text(&site.path("station/report.txt"));
    assert!(report.contains("FC 1: it is left out") && !report.contains("not in the project"), "{report}");
    // The rest runs with an empty FC 1.
    let file = format!("{out}/station.toml");
    site.ob1(&["run", &file, "--scans", "20", "--quiet"]).fine();
    // A second import into the folder needs an option.
    assert_eq!(site.ob1(&["import", &example, "--out", &out]).code, Some(2));
    assert_eq!(site.ob1(&["import", &example, "--out", &out, "--overwrite"]).code, Some(1));
}

#[test]
fn nothing_that_can_be_read_is_exit_code_2() {
    let site = Site::new();
    let mut files = step7::example().files();
    files.0.remove("ombstx/offline/00000001/SUBBLK.DBT");
    let example = project(&site, &files);
    fs::create_dir(site.path("empty")).expect("a folder");
    let tia = site.path("tia");
    fs::create_dir(&tia).expect("a folder");
    fs::write(tia.join("plant.ap15_1"), "x").expect("a file");
    fs::create_dir(site.path("packed")).expect("a folder");
    fs::write(site.path("packed/plant.zip"), "x").expect("a file");
    let (tia, packed) = (tia.display().to_string(), site.path("packed").display().to_string());
    let own = format!("{tia}/plant.ap15_1");
    let (empty, out) = (site.path("empty").display().to_string(), site.path("out").display().to_string());
    for (args, told) in [
        (["import", &example, "--out", &out], "memo file"),
        (["import", &empty, "--out", &out], "no STEP 7 project"),
        (["import", &tia, "--out", &out], "plant.ap15_1 is of TIA Portal"),
        (["import", &own, "--out", &out], "it is of TIA Portal"),
        (["import", &packed, "--out", &out], "plant.zip is an archive: unpack it"),
        (["import", "/nowhere", "--out", &out], "/nowhere"),
    ] {
        let said = site.ob1(&args);
        assert_eq!(said.code, Some(2), "{}{}", said.out, said.err);
        assert!(said.err.contains(told), "{told} is not in {}", said.err);
    }
    let listed = site.ob1(&["import", &example, "--list"]).fine();
    assert!(
        listed.contains("Conveyor/CPU 315-2 DP/S7 Program(1)") && listed.contains("FC 1: the memo file"),
        "{listed}"
    );
}

/// A copy of the project lies below it, in a folder whose name is not UTF-8; a library lies beside it.
#[test]
fn projects_of_one_name_are_told_apart() {
    use std::os::unix::ffi::OsStrExt as _;
    let site = Site::new();
    let example = step7::example();
    let plant = project(&site, &example.files());
    let copy = Path::new(&plant).join(std::ffi::OsStr::from_bytes(b"backup-\xF6"));
    put(&example.files(), &copy);
    put(&NewProject { name: "library".into(), cpu: None, ..example }.files(), &Path::new(&plant).join("library"));
    let out = site.path("station").display().to_string();
    let said = site.ob1(&["import", &plant, "--out", &out]);
    assert_eq!(said.code, Some(2), "{}{}", said.out, said.err);
    let names: Vec<&str> = said.err.lines().filter_map(|line| line.trim().strip_prefix("--program ")).collect();
    assert_eq!(names.len(), 2, "{}", said.err);
    for (name, out) in names.into_iter().zip([&out, &site.path("second").display().to_string()]) {
        site.ob1(&["import", &plant, "--program", name.trim_matches('"'), "--out", out]).fine();
    }
    // The project's own file says which one is meant.
    let file = format!("{plant}/conveyor.s7p");
    site.ob1(&["import", &file, "--out", &site.path("third").display().to_string()]).fine();
}

#[test]
fn blocks_are_printed_but_for_the_protected() {
    let site = Site::new();
    let example = checkout("examples/step7-project").display().to_string();
    let listed = site.ob1(&["import", &example, "--listing", "FC1"]).fine();
    assert!(listed.contains("FUNCTION FC 1 : VOID") && listed.contains("#Motor"), "{listed}");
    assert_eq!(site.ob1(&["import", &example, "--listing", "FC 2"]).code, Some(2));
    let listed = site.ob1(&["import", &example, "--listing", "udt1"]).fine();
    assert!(listed.contains("TYPE UDT 1"), "{listed}");
    assert_eq!(site.ob1(&["import", &example, "--listing", "UDT 9"]).code, Some(2));
}

/// A function with this number and code, without parameters.
fn function(number: u16, code: &[u8]) -> Block {
    Block {
        id: BlockId::new(BlockKind::Fc, number),
        code: code.to_vec(),
        interface: vec![1, 0, 0, 0, 0, 0, 0, 0],
        declarations: Some(String::new()),
        ..Block::default()
    }
}

/// Its value is of a type that is not in the project, and no source can name the structure it was compiled with.
#[test]
fn a_block_without_a_source_is_printed_from_its_machine_code() {
    let site = Site::new();
    let mut project = step7::example();
    project.blocks.push(Block {
        interface: vec![1, 6, 0, 5, 0, 0, 0, 0x11, 6, 1, 0x05, 6, 0],
        declarations: Some("\r\nVAR_OUTPUT\r\n  RET_VAL : UDT 99;\r\nEND_VAR\r\n".to_owned()),
        // L 5; BE.
        ..function(6, &[0x30, 0x03, 0, 5, 0x65, 0])
    });
    let example = self::project(&site, &project.files());
    let listed = site.ob1(&["import", &example, "--listing", "FC6"]).fine();
    assert!(listed.contains("FUNCTION FC 6 :") && listed.contains("L 5;"), "{listed}");
}

#[test]
fn a_block_nobody_has_is_stood_in_for() {
    let site = Site::new();
    let mut project = step7::example();
    // UC SFC 250 with one pointer; UC FC 77, which is not in the project.
    let code = [0xFB, 0x74, 0, 250, 0x70, 0x0B, 0, 4, 0x83, 0, 0, 0, 0x3D, 77, 0x70, 0x0B, 0, 2, 0x65, 0];
    project.blocks.push(function(3, &code));
    let out = site.path("station").display().to_string();
    let example = self::project(&site, &project.files());
    site.ob1(&["import", &example, "--out", &out]).fine();
    let report = text(&site.path("station/report.txt"));
    for wanted in ["SFC 250: this CPU does not have it", "FC 77: it is not in the project", "FC 3 calls it"] {
        assert!(report.contains(wanted), "{wanted} is not in\n{report}");
    }
    site.ob1(&["run", &format!("{out}/station.toml"), "--scans", "20", "--quiet"]).fine();
}

/// SFC 62 CONTROL of an S7-400, which a plugin serves: without it the stand-in has the parameters of the project.
#[test]
fn a_block_of_an_s7_400_that_no_plugin_serves_is_stood_in_for() {
    let site = Site::new();
    let mut project = step7::example();
    project.cpu = project.cpu.map(|cpu| Cpu { s7_400: true, ..cpu });
    let ours = ob1_std::standard_block("S7-400:SFC62").expect("CONTROL");
    let compiled = CompiledInterface::of(62, &ours.interface, &BTreeMap::new(), &|_| None).expect("short");
    project.blocks.push(Block {
        id: BlockId::new(BlockKind::Sfc, 62),
        interface: compiled.bytes().expect("short"),
        ..function(62, &[0x65, 0])
    });
    // UC SFC 62 with ten pointers, RET_VAL into MW 100.
    let pointers = [0x8300_0000u32, 0x0009_0000, 0x8300_0050, 0x8300_0320, 0x8300_00A0, 0x8300_00B0, 0x8300_00C0];
    let pointers = [&pointers[..], &[0x8300_00D0, 0x8300_00E0, 0x8300_00F0]].concat();
    let mut code = vec![0xFB, 0x74, 0, 62, 0x70, 0x0B, 0, 2 + 2 * pointers.len() as u8];
    code.extend(pointers.iter().flat_map(|pointer| pointer.to_be_bytes()));
    code.extend([0x65, 0]);
    project.blocks.push(function(3, &code));
    let out = site.path("station").display().to_string();
    let example = self::project(&site, &project.files());
    site.ob1(&["import", &example, "--out", &out]).fine();
    site.ob1(&["run", &format!("{out}/station.toml"), "--scans", "20", "--quiet"]).fine();
}

/// However many blocks use a type that is missing, each takes its compiled form, and the station runs.
#[test]
fn a_type_that_is_missing_leaves_the_blocks_that_use_it() {
    let site = Site::new();
    let mut project = step7::example();
    // A structure of one word: a component of UDT 91, which is of UDT 90, or of an FB 90.
    let word = [0x11, 4, 1, 4, 4u8];
    let instance = [&[0x15, 90, 0][..], &word].concat();
    let interface = |kind: u8, number: u8, entries: &[u8]| {
        let head = [kind, number, 0, entries.len() as u8, 0, 0, 0];
        [&head[..], entries, &[0]].concat()
    };
    for number in 10..20u8 {
        let udt = if number % 2 == 0 { 90 } else { 91 };
        project.blocks.push(Block {
            id: BlockId::new(BlockKind::Db, number.into()),
            interface: interface(5, number, &word),
            declarations: Some(format!("\r\nSTRUCT\r\n  Part : UDT {udt};\t\r\n END_STRUCT ;\t\r\n")),
            ..function(number.into(), &[0x12, 0x34])
        });
        // L #Part; T MW 16.
        project.blocks.push(Block {
            id: BlockId::new(BlockKind::Fb, number.into()),
            interface: interface(1, number, &instance),
            declarations: Some("\r\nVAR\r\n  Part : FB 90;\t\r\nEND_VAR\r\n".to_owned()),
            ..function(number.into(), &[0xBE, 0x5A, 0, 0, 0x13, 0x10, 0x65, 0])
        });
    }
    let udt = "\r\nSTRUCT \r\n  Part : UDT 90;\t\r\n END_STRUCT ;\t\r\n".to_owned();
    project.udts.push((91, Udt { declarations: udt, head: Head::default() }));
    let out = site.path("station").display().to_string();
    let said = site.ob1(&["import", &self::project(&site, &project.files()), "--out", &out, "--json"]);
    // The UDT alone is left out.
    assert_eq!(said.code, Some(1), "{}{}", said.out, said.err);
    let json: Value = serde_json::from_str(&said.out).expect("JSON");
    assert_eq!((&json["blocks"], &json["decoded"]), (&Value::from(24), &Value::from(24)), "{json}");
    let report = text(&site.path("station/report.txt"));
    assert!(!report.contains("without names"), "{report}");
    site.ob1(&["check", &format!("{out}/station.toml")]).fine();
}

/// The project's data block is older than its FB, which has grown by a word since.
#[test]
fn an_instance_that_is_too_short_gets_the_start_values_of_the_rest() {
    let site = Site::new();
    let mut project = step7::example();
    let declarations = "\r\nVAR\r\n  Old : INT ;\t\r\n  New : INT  := 7;\t\r\nEND_VAR\r\n";
    project.blocks.push(Block {
        id: BlockId::new(BlockKind::Fb, 30),
        interface: vec![1, 30, 0, 4, 0, 2, 0, 0x05, 0x04, 0x05, 0x0C, 7, 0, 0],
        declarations: Some(declarations.to_owned()),
        ..function(30, &[0x65, 0])
    });
    project.blocks.push(Block {
        id: BlockId::new(BlockKind::Db, 30),
        interface: vec![0x0A, 30, 0, 2, 0, 0, 0, 0x05, 0x04, 0],
        declarations: Some("\r\nVAR\r\n  Old : INT ;\t\r\n".to_owned()),
        ..function(30, &[0x12, 0x34])
    });
    let out = site.path("station").display().to_string();
    site.ob1(&["import", &self::project(&site, &project.files()), "--out", &out]).fine();
    let report = text(&site.path("station/report.txt"));
    assert!(report.contains("DB 30: it is 2 bytes long") && report.contains("have start values"), "{report}");
    let image = fs::read(site.path("station/blocks/DB_30.mc7")).expect("its values");
    assert!(image.windows(4).any(|bytes| bytes == [0x12, 0x34, 0, 7]), "{image:02X?}");
    site.ob1(&["check", &format!("{out}/station.toml")]).fine();
}

/// A function block of this number and name.
fn named(number: u16, name: &str, interface: Vec<u8>) -> Block {
    Block {
        id: BlockId::new(BlockKind::Fb, number),
        head: Head { name: name.into(), ..Head::default() },
        interface,
        ..function(number, &[0x65, 0])
    }
}

/// A project with P_SND_RK as FB 12 and a CP 341 at address 304.
fn with_a_cp341() -> NewProject {
    let mut project = step7::example();
    let ours = ob1_std::standard_block("CP341:FB8").expect("P_SND_RK");
    let compiled = CompiledInterface::of(12, &ours.interface, &BTreeMap::new(), &|_| None).expect("short");
    project.blocks.push(named(12, "P_SND_RK", compiled.bytes().expect("short")));
    let mut cp = project.modules[0].clone();
    (cp.name, cp.place) = ("CP 341-RS232C".into(), (0, 7, 0));
    cp.inputs = vec![Area { first: 304, bytes: 16 }];
    project.modules.push(cp);
    project
}

#[test]
fn handling_blocks_are_replaced_by_ours() {
    let site = Site::new();
    let mut project = with_a_cp341();
    // A block with the same name but other parameters belongs to the user.
    project.blocks.push(named(13, "P_SND_RK", vec![1, 13, 0, 2, 0, 0, 0, 0x05, 0x01, 0]));
    // So does one that has the number of another block of the plugin.
    project.blocks.push(function(5, &[0x65, 0]));
    let out = site.path("station").display().to_string();
    site.ob1(&["import", &self::project(&site, &project.files()), "--out", &out]).fine();
    let station = text(&site.path("station/station.toml"));
    for wanted in [
        "\"FB 12\" = \"CP341:FB8\"",
        "path = \"ob1_cp341\"\nblocks = { \"FB 8\" = \"FB 12\", \"FB 13\" = \"FB 1000\", \"FC 5\" = \"FC 1000\" }",
        "type = \"cp341\"",
        "address = 304",
    ] {
        assert!(station.contains(wanted), "{wanted} is not in\n{station}");
    }
    assert!(!station.contains("FB_12.awl") && station.contains("FB_13.awl"), "{station}");
    let report = text(&site.path("station/report.txt"));
    assert!(
        report.contains("FB 12: it is the handling block P_SND_RK") && report.contains("has other parameters"),
        "{report}"
    );
    assert!(report.contains("ob1_cp341: the plugin's FB 13 P_PRT341 is FB 1000 here"), "{report}");
    site.ob1(&["run", &format!("{out}/station.toml"), "--scans", "5", "--quiet"]).fine();
}

/// What is written is checked: a station that does not start is told.
#[test]
fn a_station_that_does_not_start_is_told() {
    let site = Site::new();
    let mut project = with_a_cp341();
    let mut second = project.modules.last().expect("a CP").clone();
    second.place = (0, 8, 0);
    project.modules.push(second);
    let out = site.path("station").display().to_string();
    let said = site.ob1(&["import", &self::project(&site, &project.files()), "--out", &out]);
    assert_eq!(said.code, Some(1), "{}{}", said.out, said.err);
    assert!(
        said.out.contains("does not start yet") && said.out.contains("belongs to cp341-0-7 already"),
        "{}",
        said.out
    );
    let report = text(&site.path("station/report.txt"));
    assert!(report.contains("does not start yet") && report.contains("belongs to cp341-0-7"), "{report}");
    let said = site.ob1(&["import", &self::project(&site, &project.files()), "--out", &out, "--overwrite", "--json"]);
    let json: Value = serde_json::from_str(&said.out).expect("JSON");
    assert_eq!(json["errors"][0]["level"], "error");
}

#[test]
fn as_many_blocks_as_a_plant_has_come_over() {
    let site = Site::new();
    let example = project(&site, &step7::large(2000).files());
    let out = site.path("station").display().to_string();
    let json: Value =
        serde_json::from_str(&site.ob1(&["import", &example, "--out", &out, "--json"]).fine()).expect("JSON");
    assert_eq!((&json["blocks"], &json["decoded"]), (&Value::from(2004), &Value::from(2004)));
}

/// Projects in the folder OB1_STEP7_PROJECTS, each in its own folder: every block of every program with a CPU is
/// imported, and the program is in RUN after 20 scans.
#[test]
fn projects_that_lie_beside_run() {
    let Some(folder) = std::env::var_os("OB1_STEP7_PROJECTS") else {
        println!("skipped: OB1_STEP7_PROJECTS names no folder of projects");
        return;
    };
    for entry in fs::read_dir(folder).expect("a folder").flatten() {
        let (site, path) = (Site::new(), entry.path().display().to_string());
        let listed = site.ob1(&["import", &path, "--list", "--json"]);
        let json: Value = serde_json::from_str(&listed.out).expect("JSON");
        for program in json["programs"].as_array().into_iter().flatten().filter_map(Value::as_str) {
            if !program.contains('/') {
                continue;
            }
            let out = site.path("out").display().to_string();
            let said = site.ob1(&["import", &path, "--program", program, "--out", &out, "--overwrite"]);
            assert_eq!(said.code, Some(0), "{path} {program}: {}{}", said.out, said.err);
            site.ob1(&["run", &format!("{out}/station.toml"), "--scans", "20", "--quiet"]).fine();
        }
    }
}

//! The examples in the documents are what the code understands.

use std::path::Path;

use ob1_backplane::io_layout::IO_FIELDS;

fn document(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs").join(name);
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The fenced blocks of one language.
fn blocks(text: &str, language: &str) -> Vec<String> {
    let open = format!("```{language}\n");
    text.split(&open).skip(1).filter_map(|rest| Some(rest.split_once("```")?.0.to_owned())).collect()
}

#[test]
fn the_station_file_of_the_document_is_good() {
    // One file, in as many pieces as the document likes.
    let text = blocks(&document("station-file.md"), "toml").concat();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/et200m");
    let station = ob1_station_file::parse(&text, "station-file.md", &folder);
    let station = station.unwrap_or_else(|findings| panic!("{findings:?}"));
    assert_eq!((station.modules.len(), station.buses.len(), station.plugins.len()), (15, 3, 1));
}

#[test]
fn every_key_of_a_station_file_is_in_its_document() {
    let text = document("station-file.md");
    let source = include_str!("../../../station-file/src/tables.rs");
    let keys = source.lines().filter_map(|line| line.trim().strip_prefix("pub(super) ")?.split_once(':'));
    for (key, _) in keys.filter(|(key, _)| !key.contains(' ')) {
        let key = if key == "kind" { "type" } else { key.trim_end_matches('_') };
        assert!(text.contains(key), "docs/station-file.md does not name the key {key}");
    }
}

#[test]
fn the_process_io_document_is_right() {
    let text = document("process-io.md");
    let blocks = blocks(&text, "toml");
    let station = format!("[station]\nname = \"x\"\n{}", blocks[0]);
    let station = ob1_station_file::parse(&station, "process-io.md", Path::new("/s"));
    assert_eq!(station.unwrap_or_else(|findings| panic!("{findings:?}")).modules.len(), 2);
    ob1_station::io::Stimulus::parse(&blocks[1], "process-io.md").unwrap_or_else(|findings| panic!("{findings:?}"));
    let offset = |name: &str| IO_FIELDS.iter().find(|f| f.name == name).expect("a field of the image").offset;
    for (name, part) in [
        ("image.inputs", format!("| {} + n |", offset("image.inputs"))),
        ("image.outputs", format!("| {} + n |", offset("image.outputs"))),
        ("image.scan", format!("| {} |", offset("image.scan"))),
        ("image.owner", format!("| {} |", offset("image.owner"))),
        ("image.alive", format!("| {} |", offset("image.alive"))),
        ("image.output_sequence", format!("offset {}", offset("image.output_sequence"))),
    ] {
        assert!(text.contains(&part), "docs/process-io.md does not give {name} as {part}");
    }
}

#[test]
fn the_requests_of_the_access_document_are_requests() {
    let text = document("access.md");
    let requests: Vec<&str> = text
        .lines()
        .filter_map(|line| line.strip_prefix("| `{\"op\"")?.split_once("` |").map(|(rest, _)| rest))
        .collect();
    assert_eq!(requests.len(), 16);
    for rest in requests {
        let request = format!("{{\"op\"{rest}");
        serde_json::from_str::<ob1_station::access::protocol::Request>(&request)
            .unwrap_or_else(|error| panic!("{request}: {error}"));
    }
}

#[test]
fn the_numbers_of_findings_are_in_the_document() {
    let text = document("station-file.md");
    for source in [
        include_str!("../../../station-file/src/findings.rs"),
        include_str!("../../../station/src/io/stimulus.rs"),
        include_str!("../../src/check.rs"),
        include_str!("../../src/testing/harness.rs"),
    ] {
        for code in source.split('"').filter(|word| word.len() == 4 && word.starts_with("C0")) {
            assert!(text.contains(&format!("| {code} |")), "docs/station-file.md does not list {code}");
        }
    }
}

#[test]
fn every_key_of_a_test_file_is_in_its_document() {
    let text = document("testing.md");
    let source = include_str!("../../src/testing/file.rs");
    let keys = source.lines().filter_map(|line| line.trim().strip_prefix("pub(super) ")?.split_once(':'));
    for (key, _) in keys.filter(|(key, _)| !key.contains(' ')) {
        assert!(text.contains(key), "docs/testing.md does not name the key {key}");
    }
}

#[test]
fn the_test_files_of_the_document_are_understood() {
    let folder = tempfile::tempdir().expect("a directory");
    for (number, block) in blocks(&document("testing.md"), "toml").iter().enumerate() {
        // Without their programs they cannot be used; only that is reported.
        let path = folder.path().join(format!("{number}.test.toml"));
        std::fs::write(&path, block).expect("writable");
        let report = ob1_command::testing::run_file(&path, "");
        assert!(!report.refused.is_empty());
        for finding in &report.refused {
            assert_eq!(finding.code, "C001", "{finding}");
        }
    }
}

/// Documents quote the diagnostic buffer in the words of the program.
#[test]
fn quoted_events_have_the_texts_of_the_program() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let folders = std::fs::read_dir(root.join("examples")).expect("the examples are there");
    let folders = folders.map(|folder| folder.expect("readable").path()).chain([root.join("docs"), root.clone()]);
    let (mut quoted, mut helped, mut wrong) = (0, 0, Vec::new());
    for folder in folders.filter(|path| path.is_dir()) {
        for page in std::fs::read_dir(&folder).expect("readable").map(|page| page.expect("readable").path()) {
            if page.extension().is_none_or(|end| end != "md") {
                continue;
            }
            let text = std::fs::read_to_string(&page).expect("UTF-8");
            for (line, below) in text.lines().zip(text.lines().skip(1).chain([""])) {
                let Some((number, text)) = line.split_once(" s  ").and_then(|(_, entry)| entry.split_once("h ")) else {
                    continue;
                };
                let Ok(number) = u16::from_str_radix(number, 16) else { continue };
                let (known, remedy) = match ob1_words::cp341_events::row(number) {
                    Some(row) => (row.text, row.remedy),
                    None => (ob1_model::Event(number).text(), ob1_model::Event(number).remedy()),
                };
                quoted += 1;
                let rest = text.trim_start_matches("gone: ").strip_prefix(known);
                if rest.is_none_or(|rest| !(rest.is_empty() || rest.starts_with([' ', ':', ',']))) {
                    wrong.push(format!("{}: {line}\n  the program says: {known}", page.display()));
                }
                if let Some(said) = below.trim().strip_prefix("= ") {
                    helped += 1;
                    if said != remedy {
                        wrong.push(format!("{}: {below}\n  the program says: {remedy}", page.display()));
                    }
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(quoted >= 6 && helped >= 2, "{quoted}, {helped}: nothing is quoted any more");
}

/// The first mistake a new user sees on a page is what the command says about it, to the caret.
#[test]
fn the_mistake_of_the_first_page_is_told_as_it_is_shown() {
    let page = document("getting-started.md");
    let folder = tempfile::tempdir().expect("a directory");
    let put = |fence: &str, name: &str, edit: fn(String) -> String| {
        let text = blocks(&page, fence).into_iter().next().expect("a file");
        std::fs::write(folder.path().join(name), edit(text)).expect("writable");
    };
    put("stl,file=pump.awl", "pump.awl", |text| text.replacen("\"Start\";", "\"Strat\";", 1));
    put("text,file=pump.sdf", "pump.sdf", |text| text);
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_ob1"));
    command.args(["check", "pump.awl", "--symbols", "pump.sdf"]).current_dir(folder.path());
    let output = command.output().expect("ob1 starts");
    let said = String::from_utf8_lossy(&output.stderr);
    let from = page.find("    pump.awl:6:13: error").expect("it is shown");
    let shown: Vec<&str> = page[from..].lines().take_while(|line| !line.is_empty()).map(|line| &line[4..]).collect();
    assert!(
        shown.len() == 5 && said.contains(&shown.join("\n")),
        "the page shows:\n{}\nsaid:\n{said}",
        shown.join("\n")
    );
}

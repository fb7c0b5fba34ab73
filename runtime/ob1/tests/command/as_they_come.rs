//! Sources as engineers bring them, through the command: folders, names without numbers, what a file lacks.

use std::path::Path;
use std::process::{Command, Output};

fn ob1(folder: &Path, words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_ob1")).args(words).current_dir(folder).output().expect("ob1 starts")
}

fn text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

fn write(folder: &Path, name: &str, text: &str) {
    let path = folder.join(name);
    std::fs::create_dir_all(path.parent().expect("a parent")).expect("a folder");
    std::fs::write(path, text).expect("writable");
}

const MAIN: &str = "ORGANIZATION_BLOCK \"Main\"\nBEGIN\nCALL \"Pump\", \"Pump_1\" (Run := \"Start\");\nEND_ORGANIZATION_BLOCK\n\
    FUNCTION_BLOCK \"Pump\"\nVAR_INPUT\n Run : Bool;\nEND_VAR\nBEGIN\nA #Run;\n= %M1.0;\nEND_FUNCTION_BLOCK\n";
const DATA: &str = "DATA_BLOCK \"Pump_1\"\n\"Pump\"\nBEGIN\nEND_DATA_BLOCK\n";

#[test]
fn a_folder_is_a_program() {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), "plant/main.awl", MAIN);
    write(folder.path(), "plant/data/pump.db", DATA);
    write(
        folder.path(),
        "plant/tags.sdf",
        "\"Start\",\"%I0.0\",\"Bool\",\"True\",\"True\",\"True\",\"\",\"\",\"True\"\n",
    );
    write(folder.path(), "plant/readme.txt", "not a source");
    let checked = ob1(folder.path(), &["check", "plant"]);
    let said = text(&checked);
    assert!(checked.status.success(), "{said}");
    assert!(
        said.contains("2 blocks have a name and no number, and got one: \"Pump\" = FB 1000, \"Pump_1\" = DB 1000"),
        "{said}"
    );
    // Nothing is kept unless requested.
    assert!(!folder.path().join("plant.numbers").exists());
    let kept = ob1(folder.path(), &["check", "plant", "--numbers", "here.numbers"]);
    assert!(kept.status.success() && folder.path().join("here.numbers").exists(), "{}", text(&kept));
    let run = ob1(folder.path(), &["exec", "plant", "--limit", "10ms"]);
    assert_eq!(run.status.code(), Some(3), "{}", text(&run));
    let empty = ob1(folder.path(), &["check", "plant/data/../../plant/none"]);
    assert!(!empty.status.success());
}

#[test]
fn a_tag_table_that_is_not_read_is_told_where_its_symbols_are_missing() {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), "plant/main.awl", MAIN);
    write(folder.path(), "plant/pump.db", DATA);
    write(folder.path(), "plant/PLCTags.xlsx", "PK");
    let said = text(&ob1(folder.path(), &["check", "plant"]));
    assert!(said.contains("PLCTags.xlsx: warning C001: this tag table is not read"), "{said}");
    assert!(said.contains("= Export the tag table from TIA Portal as .sdf"), "{said}");
    write(folder.path(), "plant/main.awl", &MAIN.replace("\"Start\"", "I 0.0"));
    let said = text(&ob1(folder.path(), &["check", "plant"]));
    assert!(!said.contains("xlsx"), "{said}");
}

#[test]
fn numbers_stay_when_a_source_is_added() {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), "plant/main.awl", &MAIN.replace("\"Start\"", "I 0.0"));
    write(folder.path(), "plant/pump.db", DATA);
    let station = "[station]\nname = \"s\"\n\n[program]\nsources = [\"plant\"]\n";
    write(folder.path(), "s.toml", station);
    let first = ob1(folder.path(), &["check", "s.toml"]);
    assert!(text(&first).contains("\"Pump_1\" = DB 1000; kept in s.numbers"), "{}", text(&first));
    // Its name comes before the others, and it mentions the number that was given.
    write(folder.path(), "plant/new.db", "DATA_BLOCK \"A\"\nSTRUCT\n x : INT;\nEND_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n");
    let second = text(&ob1(folder.path(), &["check", "s.toml"]));
    assert!(second.contains("\"A\" = DB 1001") && second.contains("\"Pump_1\" = DB 1000"), "{second}");
    let listing = text(&ob1(folder.path(), &["check", "s.toml", "--compiled"]));
    assert!(
        listing.contains("DB 1000    \"Pump_1\"") && listing.contains("DB 1000 \"Pump_1\", instance of FB 1000"),
        "{listing}"
    );
    write(folder.path(), "s.toml", &format!("{station}numbers = {{ \"Pump\" = \"FB 35\" }}\n"));
    let fixed = text(&ob1(folder.path(), &["check", "s.toml", "--compiled"]));
    assert!(fixed.contains("FB 35 \"Pump\"") && fixed.contains("DB 1000 \"Pump_1\", instance of FB 35"), "{fixed}");
    write(folder.path(), "s.numbers", "\"Pump\" = \"MW 5\"\n");
    let broken = ob1(folder.path(), &["check", "s.toml"]);
    assert!(!broken.status.success() && text(&broken).contains("s.numbers:1:10"), "{}", text(&broken));
}

#[test]
fn a_missing_file_is_told_at_the_line_that_names_it() {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), "main.awl", "ORGANIZATION_BLOCK OB 1\nBEGIN\nEND_ORGANIZATION_BLOCK\n");
    let station =
        "[station]\nname = \"s\"\n\n[program]\nsources = [\"main.awl\", \"gone.awl\"]\nsymbols = [\"gone.sdf\"]\n";
    write(folder.path(), "s.toml", station);
    let said = text(&ob1(folder.path(), &["check", "s.toml"]));
    assert!(said.contains("s.toml:5:24: error C001: the file gone.awl cannot be read: No such file"), "{said}");
    assert!(said.contains("s.toml:6:12: error C001: the file gone.sdf cannot be read"), "{said}");
}

/// The remedy fits the mistake: a file of the command line is named by no other file.
#[test]
fn what_the_command_line_names_wrongly_is_told_with_what_helps() {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), "plant/main.awl", "ORGANIZATION_BLOCK OB 1\nBEGIN\nEND_ORGANIZATION_BLOCK\n");
    for (words, says) in [
        (["check", "gone.awl", "--mnemonics", "de"], "= paths of the command line count from the current folder"),
        (["check", "plant/main.awl", "--symbols", "plant"], "= name a source, or a symbol table"),
    ] {
        let said = text(&ob1(folder.path(), &words));
        assert!(said.contains("error C001: the file cannot be read: ") && said.contains(says), "{said}");
    }
}

#[test]
fn a_test_file_is_no_station_file() {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), "p.test.toml", "sources = [\"p.awl\"]\n[[test]]\nname = \"a\"\n");
    for command in ["check", "run"] {
        let said = text(&ob1(folder.path(), &[command, "p.test.toml"]));
        assert!(said.contains("error C002: this is a test file, not a station file\n  = `ob1 test` runs it"), "{said}");
    }
}

#[test]
fn an_empty_file_is_not_ok() {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), "main.awl", "ORGANIZATION_BLOCK OB 1\nBEGIN\nEND_ORGANIZATION_BLOCK\n");
    for content in ["", " \r\n", "\u{feff}", "\0\0\0\0"] {
        write(folder.path(), "empty.awl", content);
        for (command, code) in [("check", 1), ("exec", 10), ("xref", 1)] {
            let output = ob1(folder.path(), &[command, "empty.awl"]);
            assert_eq!(output.status.code(), Some(code), "{command}: {output:?}");
            assert!(text(&output).contains("empty.awl: error C019: the file is empty\n"), "{command}: {output:?}");
        }
    }
    // One of several, and a symbol table.
    write(folder.path(), "empty.sdf", "");
    let output = ob1(folder.path(), &["check", "main.awl", "empty.awl", "--symbols", "empty.sdf"]);
    let said = text(&output);
    assert!(output.status.success() && said.contains("ok, 2 warnings"), "{said}");
    for file in ["empty.awl", "empty.sdf"] {
        assert!(said.contains(&format!("{file}: warning C019: the file is empty\n")), "{said}");
    }
}

#[test]
fn the_program_s_block_stands_for_one_that_is_offered() {
    let folder = tempfile::tempdir().expect("a folder");
    let own = "FUNCTION FC 105 : VOID\nBEGIN\nL 7;\nT MW 2;\nEND_FUNCTION\nORGANIZATION_BLOCK OB 1\nBEGIN\nCALL FC 105;\nCALL SFC 46;\nEND_ORGANIZATION_BLOCK\n";
    write(folder.path(), "own.awl", own);
    let run = ob1(folder.path(), &["exec", "own.awl", "--library", "TI-S7", "--dump", "M:2:2:m.bin"]);
    assert_eq!(run.status.code(), Some(0), "{}", text(&run));
    assert_eq!(std::fs::read(folder.path().join("m.bin")).expect("a dump"), [0, 7]);
    let chosen = ob1(folder.path(), &["exec", "own.awl", "--library", "FC105=TI-S7:FC105"]);
    let said = text(&chosen);
    assert_eq!(chosen.status.code(), Some(10), "{said}");
    assert!(said.contains("FC 105 is both this block and SCALE of [library] \"FC 105\" = \"TI-S7:FC105\""), "{said}");
}

#[test]
fn an_instruction_by_its_bare_name_runs() {
    let folder = tempfile::tempdir().expect("a folder");
    let source = "ORGANIZATION_BLOCK OB 1\nBEGIN\nL 13824;\nT MW 0;\n\
        CALL SCALE (IN := MW 0, HI_LIM := 100.0, LO_LIM := 0.0, BIPOLAR := FALSE, RET_VAL := MW 2, OUT := MD 4);\n\
        CALL SFC 46;\nEND_ORGANIZATION_BLOCK\n";
    write(folder.path(), "scale.awl", source);
    let run = ob1(folder.path(), &["exec", "scale.awl", "--dump", "M:4:4:m.bin"]);
    assert_eq!(run.status.code(), Some(0), "{}", text(&run));
    assert_eq!(std::fs::read(folder.path().join("m.bin")).expect("a dump"), 50.0f32.to_be_bytes());
}

#[test]
fn a_function_block_without_data_can_be_called() {
    let folder = tempfile::tempdir().expect("a folder");
    let source = "FUNCTION_BLOCK FB 3\nBEGIN\nL 5;\nT MW 2;\nEND_FUNCTION_BLOCK\nDATA_BLOCK DB 5 FB 3\nBEGIN\nEND_DATA_BLOCK\n\
        ORGANIZATION_BLOCK OB 1\nBEGIN\nCALL FB 3, DB 5;\nCALL SFC 46;\nEND_ORGANIZATION_BLOCK\n";
    write(folder.path(), "fb.awl", source);
    let run = ob1(folder.path(), &["exec", "fb.awl", "--dump", "M:2:2:m.bin"]);
    assert_eq!(run.status.code(), Some(0), "{}", text(&run));
    assert_eq!(std::fs::read(folder.path().join("m.bin")).expect("a dump"), [0, 5]);
}

#[test]
fn messages_have_a_limit_and_the_rest_is_counted() {
    let folder = tempfile::tempdir().expect("a folder");
    for file in 0..8 {
        let body = "QX M 1.0;\n".repeat(50);
        write(
            folder.path(),
            &format!("p/f{file}.awl"),
            &format!("FUNCTION FC {file} : VOID\nBEGIN\n{body}END_FUNCTION\n"),
        );
    }
    let checked = ob1(folder.path(), &["check", "p"]);
    let said = text(&checked);
    assert_eq!(said.matches("error S0301").count(), 100, "{said}");
    assert_eq!(said.matches("f0.awl:").count(), 20, "{said}");
    assert!(said.contains("and 300 more") && said.contains("300 S0301 A word that is not a mnemonic."), "{said}");
    assert!(said.contains("400 errors"), "{said}");
    let all = text(&ob1(folder.path(), &["check", "p", "--all-messages"]));
    assert_eq!(all.matches("error S0301").count(), 400);
}

#[test]
fn an_instance_is_declared_by_the_name_of_its_block() {
    let folder = tempfile::tempdir().expect("a folder");
    let source = "DATA_BLOCK DB 5\nPUT\nBEGIN\nEND_DATA_BLOCK\nFUNCTION FC 1 : VOID\nBEGIN\n\
                  CALL PUT, DB 5 (REQ := M 0.0);\nEND_FUNCTION\n";
    write(folder.path(), "a.awl", source);
    let checked = ob1(folder.path(), &["check", "a.awl", "--library", "CP300"]);
    assert!(checked.status.success(), "{}", text(&checked));
    let said = text(&ob1(folder.path(), &["check", "a.awl"]));
    assert!(said.contains("SFB 15 PUT is a block of an S7-400") && said.contains("FB 15 PUT (CP300:FB15)"), "{said}");
    assert_eq!(said.matches("error").count(), 2, "one, and the verdict: {said}");
}

#[test]
fn what_the_libraries_have_is_no_matter_of_plugins() {
    let folder = tempfile::tempdir().expect("a folder");
    let call = |what: &str| format!("FUNCTION FC 1 : VOID\nBEGIN\nCALL {what};\nEND_FUNCTION\n");
    write(folder.path(), "a.awl", &call("FC 25 (IN1 := MW 0)"));
    write(folder.path(), "b.awl", &call("\"BLKMOV\" (SRCBLK := MW 0)"));
    let said = text(&ob1(folder.path(), &["check", "a.awl"]));
    assert!(said.contains("FC 25: 1 use in 1 file") && said.contains("--library FC25=IEC:FC25"), "{said}");
    assert!(!said.contains("plugin"), "{said}");
    let said = text(&ob1(folder.path(), &["check", "b.awl"]));
    assert!(said.contains("BLKMOV is also the usual name of SFC 20"), "{said}");
}

#[test]
fn a_block_in_two_files_is_told_with_both_places() {
    let folder = tempfile::tempdir().expect("a folder");
    let block = "FUNCTION FC 1 : VOID\nBEGIN\nEND_FUNCTION\n";
    write(folder.path(), "first.awl", &format!("\n{block}"));
    write(folder.path(), "second.awl", block);
    let said = text(&ob1(folder.path(), &["check", "first.awl", "second.awl"]));
    assert!(said.contains("second.awl:1:10: error S0103: FC 1 occurs twice, first in first.awl:2"), "{said}");
}

#[test]
fn calls_of_a_block_in_scl_are_held_against_its_declarations() {
    let folder = tempfile::tempdir().expect("a folder");
    let scl =
        "FUNCTION FC 7 : INT\nVAR_INPUT\n  a : INT;\nEND_VAR\nIF a > 3 THEN\n  FC7 := a;\nEND_IF;\nEND_FUNCTION\n";
    write(folder.path(), "p/limit.scl", scl);
    let call = |actual: &str| {
        format!("FUNCTION FC 1 : VOID\nBEGIN\nCALL FC 7 ({actual} := 1, RET_VAL := MW 0);\nUC FC 7;\nEND_FUNCTION\n")
    };
    let errors = |text: &str| text.lines().filter(|l| l.contains("error S")).map(str::to_owned).collect::<Vec<_>>();
    write(folder.path(), "p/caller.awl", &call("a"));
    assert_eq!(errors(&text(&ob1(folder.path(), &["check", "p"]))), Vec::<String>::new());
    write(folder.path(), "p/caller.awl", &call("b"));
    let missing = "p/caller.awl:3:1: error S0608: an actual parameter is missing in the call of FC 7: a";
    assert_eq!(errors(&text(&ob1(folder.path(), &["check", "p"]))), [missing]);
}

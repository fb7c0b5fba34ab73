//! The first day of a new user: sources as they come from STEP 7, manuals, mails and editors, through `ob1 check` and
//! `ob1 exec`.
//!
//! Each folder of `tests/first_day` is a program: sources, symbol tables, and `expected.txt` with what the two commands
//! say and the first bytes of memory. The files lie there in UTF-8 with LF; the test writes them in every encoding and
//! line end they may come in, and the answer must be the same each time, places and carets included.
//!
//! `OB1_UPDATE=1 cargo test -p ob1 --test first_day` rewrites the answers; look at the difference before you commit it.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

type Encode = fn(&str) -> Vec<u8>;

/// How a file may come, and the bytes of a text in that form.
const ENCODINGS: [(&str, Encode); 5] = [
    ("UTF-8", |text| text.as_bytes().to_vec()),
    ("UTF-8 with byte order mark", |text| format!("\u{feff}{text}").into_bytes()),
    ("CP1252", |text| text.chars().map(cp1252).collect()),
    ("UTF-16 LE", |text| "\u{feff}".encode_utf16().chain(text.encode_utf16()).flat_map(u16::to_le_bytes).collect()),
    ("UTF-16 BE", |text| "\u{feff}".encode_utf16().chain(text.encode_utf16()).flat_map(u16::to_be_bytes).collect()),
];

fn cp1252(c: char) -> u8 {
    match c {
        '€' => 0x80,
        '\u{80}'..='\u{9f}' => panic!("{c:?} is no character of a source"),
        _ => u8::try_from(u32::from(c)).unwrap_or_else(|_| panic!("{c} is not in CP1252")),
    }
}

fn sorted(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.expect("readable").path()).collect();
    paths.sort();
    paths
}

/// The answers to the files of a folder.
fn answer(folder: &Path) -> String {
    let names = |ends: &[&str]| -> Vec<String> {
        let is_one = |path: &&PathBuf| path.extension().is_some_and(|end| ends.iter().any(|e| end == *e));
        let paths = sorted(folder);
        paths
            .iter()
            .filter(is_one)
            .map(|path| path.file_name().expect("a name").to_string_lossy().into_owned())
            .collect()
    };
    let mut words = names(&["awl"]);
    for table in names(&["sdf", "asc", "seq", "dif"]) {
        words.extend(["--symbols".to_owned(), table]);
    }
    let mut out = String::new();
    for (verb, more) in [("check", &[][..]), ("exec", &["--limit", "1s", "--dump", "M:0:16:memory.bin"])] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_ob1"));
        command.arg(verb).args(&words).args(more).current_dir(folder).stdin(Stdio::null());
        let done = command.output().expect("ob1 starts");
        let _ =
            writeln!(out, "== ob1 {verb} {}: exit code {:?}", words.join(" "), done.status.code().expect("not killed"));
        out += &String::from_utf8(done.stdout).expect("UTF-8");
        out += &String::from_utf8(done.stderr).expect("UTF-8");
    }
    if let Ok(memory) = std::fs::read(folder.join("memory.bin")) {
        let _ = writeln!(out, "== MB 0: {memory:02X?}");
    }
    out
}

#[test]
fn every_form_of_a_source_gets_the_same_answer() {
    let cases = sorted(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/first_day"));
    assert!(cases.len() > 8, "{cases:?}");
    for case in cases {
        let expected = case.join("expected.txt");
        for (encoding, encode) in ENCODINGS {
            for line_end in ["\n", "\r\n"] {
                let folder = tempfile::tempdir().expect("a directory");
                for path in sorted(&case).iter().filter(|path| **path != expected) {
                    let text = std::fs::read_to_string(path).expect("UTF-8").replace('\n', line_end);
                    let name = path.file_name().expect("a name");
                    std::fs::write(folder.path().join(name), encode(&text)).expect("writable");
                }
                let answer = answer(folder.path());
                if std::env::var_os("OB1_UPDATE").is_some() && (encoding, line_end) == ("UTF-8", "\n") {
                    std::fs::write(&expected, &answer).expect("writable");
                }
                let wanted = std::fs::read_to_string(&expected).unwrap_or_default();
                assert!(
                    answer == wanted,
                    "{} in {encoding} with {line_end:?}:\n{answer}\n-- expected\n{wanted}",
                    case.display()
                );
            }
        }
    }
}

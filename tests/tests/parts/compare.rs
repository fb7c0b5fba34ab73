//! Programs for which our engine and awlsim once differed, replayed on ours: `tests/compare/*.awl`, each with the
//! expected bit memory.

use ob1_tests::compare::{regressions, replay};

#[test]
fn what_once_differed_does_not_any_more() {
    let folder = std::fs::read_dir(regressions()).expect("tests/compare");
    let files: Vec<_> = folder.map(|entry| entry.expect("an entry").path()).collect();
    let sources = files.iter().filter(|path| path.extension().is_some_and(|end| end == "awl"));
    let mut replayed = 0;
    for path in sources {
        let text = std::fs::read_to_string(path).expect("a source");
        if let Err(why) = replay(&text) {
            panic!("{}:\n{why}", path.display());
        }
        replayed += 1;
    }
    assert!(replayed > 0, "no file in tests/compare");
}

#[test]
fn a_wrong_byte_is_found() {
    let path = regressions().join("shift_right.awl");
    let text = std::fs::read_to_string(path).expect("a source");
    let first = text.lines().find(|line| line.starts_with("// expected:")).expect("expected bytes");
    let digit = if first.ends_with('0') { '1' } else { '0' };
    let wrong = text.replacen(first, &format!("{}{digit}", &first[..first.len() - 1]), 1);
    let why = replay(&wrong).expect_err("the byte is wrong").to_string();
    assert!(why.starts_with("MB 15 (its MB 215)"), "{why}");
}

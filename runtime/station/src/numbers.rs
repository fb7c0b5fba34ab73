//! The file `STATION.numbers` beside a station file: the numbers that were given to blocks with names only. They stay
//! when sources are added, because other programs and retentive data refer to data blocks by number.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use ob1_model::BlockId;
use ob1_station_file::finding::{Finding, Level, Text};
use ob1_station_file::findings::{NOT_KEPT, UNREADABLE, VALUE, of_toml};
use ob1_stl::Numbered;

/// What the first line of the file begins with; the checksum of the other lines follows. Without that line there is
/// none: the file was made or changed by hand.
const SUM: &str = "# checksum ";
/// Numbers that a note names; the file has them all.
const NAMED: usize = 20;

fn sum_of(text: &str) -> String {
    format!("{:016x}", ob1_process::files::checksum(text.bytes()))
}

/// Reads a file of numbers; none when there is no file.
///
/// # Errors
/// The file cannot be read, or a line of it has no meaning.
pub(crate) fn read(path: &Path) -> Result<Vec<Numbered>, Vec<Finding>> {
    let name = path.display().to_string();
    let text = match ob1_process::files::read_text(path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => {
            let message = format!("the file of block numbers cannot be read: {error}");
            return Err(vec![Finding::whole(
                Level::Error,
                UNREADABLE,
                &name,
                message,
                "make it readable for this user",
            )]);
        }
    };
    let source = Text { file: &name, text: &text };
    let is_whole = match text.strip_prefix(SUM) {
        Some(rest) => {
            let (sum, lines) = rest.split_once('\n').unwrap_or((rest, ""));
            sum == sum_of(lines)
        }
        None => text.is_empty() || !SUM.starts_with(text.as_str()),
    };
    if !is_whole {
        let message = "the file of block numbers is damaged or cut off, or was changed by hand".to_owned();
        let remedy = "put the file back as it was; after a change by hand remove its first line".to_owned();
        return Err(vec![source.finding(Level::Error, UNREADABLE, 0..0, message, remedy)]);
    }
    let table: BTreeMap<String, toml::Spanned<String>> =
        toml::from_str(&text).map_err(|error| vec![of_toml(source, &error, "docs/porting.md", |_, _| None)])?;
    let mut numbers = Vec::with_capacity(table.len());
    let mut wrong = Vec::new();
    for (name, number) in table {
        match BlockId::parse(number.get_ref()) {
            Some(id) => numbers.push(Numbered { name, id }),
            None => {
                let message = format!("\"{}\" is not a block", number.get_ref());
                let remedy = "write \"FC 35\", or remove the line".to_owned();
                wrong.push(source.finding(Level::Error, VALUE, number.span(), message, remedy));
            }
        }
    }
    if wrong.is_empty() { Ok(numbers) } else { Err(wrong) }
}

/// Writes what was there and what has come. A finding when it cannot be written: the numbers could then change.
pub(crate) fn write(path: &Path, kept: &[Numbered], given: &[Numbered]) -> Option<Finding> {
    let mut all: BTreeMap<&str, &Numbered> = kept.iter().map(|k| (k.name.as_str(), k)).collect();
    let before = all.len();
    for one in given {
        all.entry(one.name.as_str()).or_insert(one);
    }
    if all.len() == before {
        return None;
    }
    let mut text =
        String::from("# Numbers of blocks that have a name only, given by ob1. They stay as they are here.\n");
    for (name, one) in all {
        let _ = writeln!(text, "{} = \"{}\"", toml::Value::from(name), one.id);
    }
    let text = format!("{SUM}{}\n{text}", sum_of(&text));
    ob1_process::files::replace(path, text.as_bytes()).err().map(|error| {
        let message = format!("the numbers of blocks cannot be kept: {error}");
        let remedy = "make the folder writable, or fix them: [program] numbers = { \"name\" = \"FC 35\" }";
        Finding::whole(Level::Warning, NOT_KEPT, &path.display().to_string(), message, remedy)
    })
}

/// The note about all numbers that were given; empty when there are none.
pub fn note(given: &[Numbered], path: Option<&Path>) -> String {
    if given.is_empty() {
        return String::new();
    }
    let mut list: Vec<String> = given.iter().take(NAMED).map(|one| format!("\"{}\" = {}", one.name, one.id)).collect();
    if given.len() > NAMED {
        list.push(format!("and {} more", given.len() - NAMED));
    }
    let kept = path.map_or_else(String::new, |path| format!("; kept in {}", path.display()));
    let blocks = if given.len() == 1 { "1 block has".to_owned() } else { format!("{} blocks have", given.len()) };
    format!("note: {blocks} a name and no number, and got one: {}{kept}\n", list.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_model::{BlockId, BlockKind};

    #[test]
    fn a_note_names_the_first_numbers() {
        let given = |n: u16| (0..n).map(|i| Numbered { name: format!("B{i}"), id: BlockId::new(BlockKind::Fc, i) });
        let of = |n: u16| note(&given(n).collect::<Vec<_>>(), Some(Path::new("x.numbers")));
        assert!(of(20).ends_with("\"B19\" = FC 19; kept in x.numbers\n"), "{}", of(20));
        assert!(of(50_000).ends_with("\"B19\" = FC 19, and 49980 more; kept in x.numbers\n"), "{}", of(50_000));
    }

    #[test]
    fn numbers_are_kept_and_only_added_to() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("press.numbers");
        assert_eq!(read(&path), Ok(Vec::new()));
        let one = Numbered { name: "Pump \"A\"".into(), id: BlockId::new(BlockKind::Db, 1000) };
        let two = Numbered { name: "Mixer".into(), id: BlockId::new(BlockKind::Fb, 1000) };
        assert_eq!(write(&path, &[], std::slice::from_ref(&one)), None);
        assert_eq!(read(&path), Ok(vec![one.clone()]));
        // Given again under another number: the first stays.
        let other = Numbered { id: BlockId::new(BlockKind::Db, 7), ..one.clone() };
        assert_eq!(write(&path, std::slice::from_ref(&one), &[other, two.clone()]), None);
        assert_eq!(read(&path), Ok(vec![two, one]));
        // Every cut and every flipped bit is noticed; a file of somebody's own has no checksum.
        let good = std::fs::read(&path).expect("there");
        let is_refused = |bytes: &[u8]| {
            std::fs::write(&path, bytes).expect("written");
            read(&path).is_err_and(|found| found[0].code == UNREADABLE || !found[0].message.is_empty())
        };
        let first = good.iter().position(|byte| *byte == b'\n').expect("a line");
        for len in 1..good.len() {
            assert!(is_refused(&good[..len]), "cut at {len}");
        }
        for at in SUM.len()..good.len() {
            let mut bad = good.clone();
            bad[at] ^= 1;
            assert!(is_refused(&bad), "byte {at}");
        }
        assert!(!is_refused(&good) && !is_refused(&good[first + 1..]));
        std::fs::write(&path, "\"x\" = \"MW 5\"\n").expect("written");
        assert_eq!(read(&path).expect_err("no block")[0].line, 1);
        let given = [Numbered { name: "x".into(), id: BlockId::new(BlockKind::Fc, 1) }];
        let told = write(Path::new("/nowhere/at/all.numbers"), &[], &given).expect("there is no such folder");
        assert_eq!((told.level, told.code.as_str()), (Level::Warning, "C018"));
    }
}

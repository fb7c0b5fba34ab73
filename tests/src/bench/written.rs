//! `--write`: the tables of docs/figures.md, each between `<!-- bench NAME -->` and `<!-- end -->`, with command, date
//! and machine.

use std::fmt::Write as _;
use std::process::Command;

use super::Figure;
use super::peer::Failure;

const PAGE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/figures.md");
const END: &str = "<!-- end -->";

/// Replaces the table of a measurement.
///
/// # Errors
/// If the page has no place for it, or cannot be written.
pub fn write(name: &str, figures: &[Figure]) -> Result<(), Failure> {
    let page = std::fs::read_to_string(PAGE)?;
    let table = format!("{}\n{}", heading(name)?, table(figures));
    std::fs::write(PAGE, replaced(&page, name, &table)?)?;
    Ok(())
}

fn replaced(page: &str, name: &str, table: &str) -> Result<String, Failure> {
    let begin = format!("<!-- bench {name} -->\n");
    let missing = || format!("docs/figures.md has no {:?} with {END:?} below it", begin.trim());
    let (before, rest) = page.split_once(&begin).ok_or_else(missing)?;
    let (_, after) = rest.split_once(END).ok_or_else(missing)?;
    Ok(format!("{before}{begin}\n{table}\n{END}{after}"))
}

/// Command, date and machine.
fn heading(name: &str) -> Result<String, Failure> {
    let date = Command::new("date").arg("+%F").output()?.stdout;
    let date = String::from_utf8(date)?;
    let processors = std::fs::read_to_string("/proc/cpuinfo")?;
    let model = processors.lines().find_map(|line| line.strip_prefix("model name")?.split_once(": "));
    let model = model.map_or("an unknown processor", |(_, model)| model.trim());
    let cores = std::thread::available_parallelism()?;
    Ok(format!("`cargo xtask bench {name}`, {}, {cores} cores of {model}:\n", date.trim()))
}

fn table(figures: &[Figure]) -> String {
    let mut text = String::from("| what | measured | floor | ratio | aim |\n|---|---|---|---|---|\n");
    for Figure { what, value, unit, floor, aim } in figures {
        let (beside, ratio) = floor.map_or_else(Default::default, |(name, floor)| {
            (format!("{name}, {floor:.1} {unit}"), format!("{:.2}", value / floor))
        });
        let aim = match aim {
            ("", _) => String::new(),
            (aim, true) => (*aim).to_owned(),
            (aim, false) => format!("{aim}, missed"),
        };
        let row = [format!("{what}"), format!("{value:.1} {unit}"), beside, ratio, aim];
        let _ = writeln!(text, "| {} |", row.map(|cell| cell.trim().replace('|', "\\|")).join(" | "));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_table_of_that_name_is_replaced() {
        let page = "a\n<!-- bench scan -->\nold\n<!-- end -->\nb\n<!-- bench pair -->\nstays\n<!-- end -->\n";
        let figure = Figure {
            what: "scan".into(),
            value: 30.0,
            unit: "ns",
            floor: Some(("a floor", 20.0)),
            aim: ("<= 1 x", false),
        };
        let new = replaced(page, "scan", &table(&[figure])).expect("a place");
        assert!(new.contains("| scan | 30.0 ns | a floor, 20.0 ns | 1.50 | <= 1 x, missed |"), "{new}");
        assert!(!new.contains("old") && new.contains("stays") && new.starts_with("a\n<!-- bench scan -->\n"), "{new}");
        let why = replaced(page, "line", "").expect_err("no place").to_string();
        assert!(why.contains("bench line"), "{why}");
    }

    #[test]
    fn the_page_has_a_place_for_each() {
        let page = std::fs::read_to_string(PAGE).expect("the page");
        for name in super::super::NAMES {
            replaced(&page, name, "").unwrap_or_else(|why| panic!("{why}"));
        }
    }
}

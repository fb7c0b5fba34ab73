//! `ob1 new`: a folder with a station, a plugin or a driver, that runs at once.

mod driver;
mod folder;
mod plugin;
mod station;

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand, ValueEnum};
use ob1_station::posture;
use ob1_station_file::finding::{Finding, Level};

use crate::exit::Exit;
use folder::File;

/// The last part of the path is not a name.
const NAME: &str = "N001";
/// Something lies there already.
const TAKEN: &str = "N002";
/// The system refused to write the folder or a file of it.
const REFUSED: &str = "N003";
/// The crate for plugins in Rust is not to be found.
const NO_SDK: &str = "N004";

/// Write a new station, plugin or driver, that runs at once
///
/// The folder must not be there yet. Its name is that of the station, plugin or driver: 1 to 40 letters, digits, - and
/// _, without - in front.
#[derive(Clone, Debug, Args)]
#[command(
    after_help = "Examples:\n  ob1 new station press\n  ob1 new station press --language scl\n  ob1 new station /etc/ob1/press      where ob1@press.service looks for it\n  \
    ob1 new plugin batch\n  ob1 new plugin batch --language rust\n  \
    ob1 new driver scale\n  ob1 new driver scale --language python\n\n\
    Errors:\n  N001  the name is not valid for it\n  N002  the folder exists already\n  \
    N003  the system refuses to write there\n  N004  ob1-sdk cannot be found\n\n\
    Exit codes: 0 written, 1 nothing was written, 6 the system refused."
)]
pub struct NewArgs {
    #[command(subcommand)]
    what: What,
}

#[derive(Clone, Debug, Subcommand)]
enum What {
    /// A station: its file, a program in STL or SCL with symbols, and tests
    Station {
        /// The folder to write; its last part is the station's name
        name: PathBuf,
        /// What the program is written in
        #[arg(long, value_enum, default_value_t = Program::Stl)]
        language: Program,
    },
    /// A plugin: a block in C or Rust, and a station that calls it
    Plugin {
        /// The folder to write; its last part is the plugin's name
        name: PathBuf,
        /// What the block is written in
        #[arg(long, value_enum, default_value_t = Language::C)]
        language: Language,
        /// The folder of the crate ob1-sdk [default: that of this installation]
        #[arg(long, value_name = "DIR")]
        sdk: Option<PathBuf>,
    },
    /// A driver of a CP 240 in C or Python, and a station that uses it
    Driver {
        /// The folder to write; its last part is the driver's name
        name: PathBuf,
        /// What the driver is written in
        #[arg(long, value_enum, default_value_t = driver::Language::C)]
        language: driver::Language,
    },
}

/// The language of a station's program.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Program {
    /// Statement list
    Stl,
    /// Structured text
    Scl,
}

/// The language of a plugin.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Language {
    /// C99; any C compiler builds it
    C,
    /// Rust, with the crate ob1-sdk
    Rust,
}

/// Why nothing was written.
#[derive(Debug)]
struct Refusal {
    exit: Exit,
    finding: Box<Finding>,
}

impl Refusal {
    fn new(exit: Exit, code: &str, path: &Path, message: impl Into<String>, remedy: impl Into<String>) -> Self {
        let finding = Finding::whole(Level::Error, code, &path.display().to_string(), message, remedy);
        Self { exit, finding: Box::new(finding) }
    }
}

/// Writes what is wanted; prints what there is to do next.
pub fn new(args: &NewArgs) -> Exit {
    let written = match &args.what {
        What::Station { name, language } => {
            let isolated = ob1_rt::isolated_cores();
            let files = |name: &str| Ok(station::files(name, *language, &isolated));
            write(name, "station", files, station::NEXT)
                .map(|text| format!("{text}{}\n", posture::best(&isolated, "station.toml")))
        }
        What::Plugin { name, language, sdk } => {
            write(name, "plugin", |of| plugin::files(of, *language, sdk.as_deref(), name), plugin::next(*language))
        }
        What::Driver { name, language } => {
            write(name, "driver", |of| Ok(driver::files(of, *language)), driver::next(*language))
        }
    };
    match written {
        Ok(text) => {
            says!("{text}");
            Exit::Ok
        }
        Err(refusal) => {
            errs!("{}", refusal.finding);
            refusal.exit
        }
    }
}

fn write(
    path: &Path,
    what: &str,
    files: impl FnOnce(&str) -> Result<Vec<File>, Refusal>,
    next: &str,
) -> Result<String, Refusal> {
    let name = name_of(path, what)?;
    let files = files(name)?;
    folder::write(path, &files)?;
    let width = files.iter().map(|file| file.name.len()).max().unwrap_or_default();
    let list: String = files.iter().map(|f| format!("  {:width$}  {}\n", f.name, f.what)).collect();
    let next = next.replace("@NAME@", name);
    Ok(format!("{}: the {what} \"{name}\"\n{list}Next:\n  cd {}\n{next}", path.display(), for_cd(path)))
}

/// A path as an argument of `cd`: neither an option nor several words.
fn for_cd(path: &Path) -> String {
    let text = path.display().to_string();
    let text = if text.starts_with('-') { format!("./{text}") } else { text };
    let plain = |c: char| c.is_alphanumeric() || "/._-+=:,@".contains(c);
    if text.chars().all(plain) { text } else { format!("'{}'", text.replace('\'', "'\\''")) }
}

/// The last part of the path, if it can be a name.
fn name_of<'p>(path: &'p Path, what: &str) -> Result<&'p str, Refusal> {
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    if !ob1_station_file::is_name(name) {
        let message = format!("\"{name}\" is not a valid name for a {what}");
        return Err(Refusal::new(Exit::Usage, NAME, path, message, ob1_station_file::NAME_RULE));
    }
    Ok(name)
}

/// The text of a template: each `@WORD@` replaced.
fn fill(template: &str, words: &[(&str, &str)]) -> String {
    words.iter().fold(template.to_owned(), |text, (word, value)| text.replace(&format!("@{word}@"), value))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_printed_cd_goes_there() {
        for (path, word) in [
            ("press", "press"),
            ("/etc/ob1/press-7", "/etc/ob1/press-7"),
            ("-d/press", "./-d/press"),
            ("hall 3/press", "'hall 3/press'"),
            ("o'neill/press", "'o'\\''neill/press'"),
        ] {
            assert_eq!(for_cd(Path::new(path)), word);
        }
    }

    #[test]
    fn names_are_those_of_stations() {
        for good in ["press", "./press", "/etc/ob1/press-7/", "a_B-9"] {
            assert!(name_of(Path::new(good), "station").is_ok(), "{good}");
        }
        for bad in ["", "/", "..", "-x", "a b", "größe", "press.d", &"x".repeat(41)] {
            let refusal = name_of(Path::new(bad), "station").expect_err(bad);
            assert_eq!((refusal.finding.code.as_str(), refusal.exit), (NAME, Exit::Usage), "{bad}");
        }
    }

    #[test]
    fn every_word_of_a_template_is_filled() {
        assert_eq!(fill("ob1@@NAME@ @A@", &[("NAME", "press"), ("A", "b")]), "ob1@press b");
        let sdk = std::env::temp_dir();
        let mut all = station::files("press", Program::Stl, &[]);
        all.extend(station::files("press", Program::Scl, &[]));
        for language in [Language::C, Language::Rust] {
            all.extend(plugin::unchecked("press", language, &sdk));
        }
        for language in [driver::Language::C, driver::Language::Python] {
            all.extend(driver::files("press", language));
        }
        for file in all {
            let is_word = |text: &&str| !text.is_empty() && text.chars().all(|c| c.is_ascii_uppercase());
            let left: Vec<&str> = file.text.split('@').filter(is_word).collect();
            assert!(left.is_empty(), "{}: {left:?}", file.name);
        }
    }
}

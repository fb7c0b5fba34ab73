//! The files of a new driver: the example of its language, and a station that uses it.

use clap::ValueEnum;

use super::fill;
use super::folder::File;

/// The language of a driver.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Language {
    /// C11; any C compiler builds it
    C,
    /// Python 3, without packages
    Python,
}

/// What to do with it.
pub(super) const fn next(language: Language) -> &'static str {
    match language {
        Language::C => "  make\n  ob1 driver test ./@NAME@\n  ob1 run station.toml\n",
        Language::Python => "  ob1 driver test ./@NAME@.py\n  ob1 run station.toml\n",
    }
}

/// The files.
pub(super) fn files(name: &str, language: Language) -> Vec<File> {
    let (program, build) = match language {
        Language::C => (name.to_owned(), "make                            # a C compiler is all it needs\n    "),
        Language::Python => (format!("{name}.py"), ""),
    };
    let text = |template: &str| fill(&fill(template, &[("BUILD", build)]), &[("NAME", name), ("PROGRAM", &program)]);
    let mut files = match language {
        Language::C => vec![
            File::new(format!("{name}.c"), "the driver", include_str!("../../../../examples/driver-c/driver.c").into()),
            File::new("Makefile", "builds it", text(include_str!("driver/makefile.in"))),
        ],
        Language::Python => {
            let source = include_str!("../../../../examples/driver-python/driver.py");
            vec![File::program(format!("{name}.py"), "the driver", source.into())]
        }
    };
    files.extend([
        File::new("station.toml", "a station that uses it", text(include_str!("driver/station.toml.in"))),
        File::new("main.awl", "its program", text(include_str!("driver/main.awl.in"))),
        File::new("README.md", "what to do with it", text(include_str!("driver/README.md.in"))),
    ]);
    files
}

//! The files of a new station.

use ob1_station::posture;

use super::folder::File;
use super::{Program, fill};

/// What to do with it.
pub(super) const NEXT: &str = "  ob1 check station.toml\n  ob1 test\n  ob1 run station.toml\n";

/// For a machine with these isolated cores.
pub(super) fn files(name: &str, language: Program, isolated: &[usize]) -> Vec<File> {
    let realtime = posture::best_table(isolated);
    let (main, program) = match language {
        Program::Stl => ("main.awl", include_str!("station/main.awl.in")),
        Program::Scl => ("main.scl", include_str!("station/main.scl.in")),
    };
    let text = |template| fill(template, &[("NAME", name), ("REALTIME", &realtime), ("MAIN", main)]);
    vec![
        File::new("station.toml", "the station: CPU, program, modules", text(include_str!("station/station.toml.in"))),
        File::new(main, "its program", text(program)),
        File::new("symbols.sdf", "its symbol table", text(include_str!("station/symbols.sdf.in"))),
        File::new("main.test.toml", "its tests", text(include_str!("station/main.test.toml.in"))),
        File::new("README.md", "what to do with it", text(include_str!("station/README.md.in"))),
    ]
}

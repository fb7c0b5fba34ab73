//! The files of a new station.

use ob1_station::posture;

use super::fill;
use super::folder::File;

/// What to do with it.
pub(super) const NEXT: &str = "  ob1 check station.toml\n  ob1 test\n  ob1 run station.toml\n";

/// For a machine with these isolated cores.
pub(super) fn files(name: &str, isolated: &[usize]) -> Vec<File> {
    let realtime = posture::best_table(isolated);
    let text = |template| fill(template, &[("NAME", name), ("REALTIME", &realtime)]);
    vec![
        File::new("station.toml", "the station: CPU, program, modules", text(include_str!("station/station.toml.in"))),
        File::new("main.awl", "its program", text(include_str!("station/main.awl.in"))),
        File::new("symbols.sdf", "its symbol table", text(include_str!("station/symbols.sdf.in"))),
        File::new("main.test.toml", "its tests", text(include_str!("station/main.test.toml.in"))),
        File::new("README.md", "what to do with it", text(include_str!("station/README.md.in"))),
    ]
}

//! The SCL front end, judged as that of STL.

use ob1_stl::{Options, Source};

use super::stl::{LIBRARY, judge};

/// Compiles a source of the name `.scl`.
pub fn run(data: &[u8]) {
    let source = Source::new("fuzz.scl", data);
    let options = Options { lints: true, ..Options::default() };
    judge(&source, &ob1_scl::compile(std::slice::from_ref(&source), &LIBRARY, &options));
}

//! Bodies of the fuzz targets: none of them panics, for any bytes.
//!
//! `fuzz/` runs them under libFuzzer (`cargo xtask fuzz`); `tests/tests/parts/fuzz_corpus.rs` replays the committed
//! corpora in every test run. A new target is a module here, its line in [`TARGETS`], and its two lines in
//! `fuzz/fuzz_targets` and `fuzz/Cargo.toml`; a test checks that these agree.

pub mod cp040;
pub mod esp2;
pub mod exec;
pub mod ir;
pub mod mbus;
pub mod mc7;
pub mod modbus;
pub mod modbus32;
pub mod project;
pub mod rk512;
pub mod s7;
pub mod scl;
pub mod serial;
pub mod station;
pub mod stl;
pub mod symbols;
pub mod testfile;
pub mod trace;

/// A fuzz target.
pub type Target = fn(&[u8]);

/// All targets by name: the name of the module, of the file in `fuzz/fuzz_targets`, and of the folder in `fuzz/corpus`.
pub const TARGETS: &[(&str, Target)] = &[
    ("cp040", cp040::run),
    ("esp2", esp2::run),
    ("exec", exec::run),
    ("ir", ir::run),
    ("mbus", mbus::run),
    ("mc7", mc7::run),
    ("modbus", modbus::run),
    ("modbus32", modbus32::run),
    ("project", project::run),
    ("rk512", rk512::run),
    ("s7", s7::run),
    ("scl", scl::run),
    ("serial", serial::run),
    ("station", station::run),
    ("stl", stl::run),
    ("symbols", symbols::run),
    ("testfile", testfile::run),
    ("trace", trace::run),
];

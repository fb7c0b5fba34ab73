//! The engines the tests of the CPU run on. A further engine is one more row.

use std::cell::Cell;

use ob1_cpu::engine::{ACCOUNTING, Both, Factory, PLAIN, REFERENCE};
use ob1_native::{AtLoad, Tier};

/// Every engine.
pub const ENGINES: &[(&str, &dyn Factory)] = &[
    ("reference", REFERENCE),
    ("reference, with an account of each block", ACCOUNTING),
    ("plain", PLAIN),
    ("native", &AtLoad(Tier::Optimised)),
    ("native, fast tier", &AtLoad(Tier::Fast)),
    ("both, plain", &Both(PLAIN)),
    ("both", &Both(&AtLoad(Tier::Optimised))),
];

thread_local! {
    /// Row of the engine under test.
    static ROW: Cell<usize> = const { Cell::new(0) };
}

/// The engine under test: a CPU made in a test gets it.
pub fn engine() -> &'static dyn Factory {
    ENGINES[ROW.get()].1
}

/// Whether the engine under test is the reference: long walks that do not test the engine take a short cut on the
/// others.
pub fn is_reference() -> bool {
    ROW.get() == 0
}

/// Says which engine it was, when the test fails.
struct Named(&'static str);

impl Drop for Named {
    fn drop(&mut self) {
        if std::thread::panicking() {
            println!("engine: {}", self.0);
        }
    }
}

/// Runs a test once on each engine.
pub fn on_each_engine(test: impl Fn()) {
    for (row, (name, _)) in ENGINES.iter().enumerate() {
        let _named = Named(name);
        ROW.set(row);
        test();
    }
    ROW.set(0);
}

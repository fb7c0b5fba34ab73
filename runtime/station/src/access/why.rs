//! Why a bit has its value, asked of the running program.

use std::cell::OnceCell;

use ob1_access::why::{self, Known, Question};
pub use ob1_access::why::{Inside, StatementStatus, TermStatus, WhyStatus, WhyWanted};
use ob1_model::{BlockId, Pass, PassOrder};
use ob1_stl::{Mnemonics, Source};

use super::pass;
use crate::program_facts::KnownProgram;

/// The question, and the pass that it needs; none: nothing writes the bit.
pub(super) fn order(known: &KnownProgram, wanted: &WhyWanted) -> Result<(Question, Option<PassOrder>), String> {
    with(known, 0, |known| why::order(known, wanted))
}

/// What is told of it. `started`: when the runtime started, in nanoseconds since 1970.
pub(super) fn status(
    known: &KnownProgram,
    question: &Question,
    pass: Option<&Pass>,
    started: u64,
) -> Result<WhyStatus, String> {
    with(known, started, |known| why::status(known, question, pass))
}

/// The program with its sources, each read once at most.
fn with<T>(
    known: &KnownProgram,
    started: u64,
    ask: impl FnOnce(&Known<'_, std::sync::Arc<ob1_ir::Program>>) -> T,
) -> T {
    let read: OnceCell<(BlockId, Option<Source>)> = OnceCell::new();
    let source = |id: BlockId| {
        // A question is about one block.
        let (of, source) =
            read.get_or_init(|| (id, known.places.file(id).and_then(|file| pass::source(file, started))));
        source.as_ref().filter(|_| *of == id)
    };
    let line = |id, number: u32| {
        let at = (number as usize).checked_sub(1)?;
        source(id)?.text().lines().nth(at).map(str::to_owned)
    };
    let set = |id| source(id).map_or(Mnemonics::German, |source| ob1_stl::most(&ob1_stl::sets_of(&[&source.text()])));
    ask(&Known { all: known.cross_reference(), names: &known.names, line: &line, set: &set })
}

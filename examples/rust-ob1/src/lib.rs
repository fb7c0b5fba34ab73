//! An OB 1 wholly in Rust: a conveyor belt with a warning horn. No STL at all.
//!
//! | operand | meaning |
//! |---|---|
//! | E 0.0 | start |
//! | E 0.1 | stop, normally closed: 0 stops |
//! | E 0.2 | light barrier: a piece passes |
//! | A 0.0 | horn: sounds for 3 s before the belt moves |
//! | A 0.1 | belt |
//! | M 0.0 | the belt is wanted |
//! | MW 2  | pieces since the start |
//! | T 1   | the horn's time |

use std::cell::Cell;

use ob1_sdk::{Abort, Area, Block, Cx, Kind, OrStop, Param, TimerKind};

/// The horn's time, S5T#3S.
const HORN: u16 = 0x0300;
/// Number of the timer that ends the horn.
const HORN_TIMER: u16 = 1;
/// The word that counts.
const PIECES: u32 = 2;

ob1_sdk::state! {
    /// Edges; 0 after a start-up.
    struct Edges {
        light_barrier: Cell<bool>,
    }
}

struct Conveyor;

impl Block for Conveyor {
    const KIND: Kind = Kind::Ob;
    const NUMBER: u16 = 1;
    const NAME: &'static str = "CONVEYOR";
    const PARAMS: &'static [Param] = &[];
    type State = Edges;
    type Module = ();

    fn call(cx: &mut Cx<'_>, edges: &Edges) -> Result<(), Abort> {
        let start = cx.bit(Area::Input, 0, 0)?.or_stop(cx, "E 0.0")?;
        let run = cx.bit(Area::Input, 0, 1)?.or_stop(cx, "E 0.1")?;
        let barrier = cx.bit(Area::Input, 0, 2)?.or_stop(cx, "E 0.2")?;

        let was_wanted = cx.bit(Area::Memory, 0, 0)?.or_stop(cx, "M 0.0")?;
        let wanted = run && (start || was_wanted);
        cx.set_bit(Area::Memory, 0, 0, wanted)?.or_stop(cx, "M 0.0")?;

        cx.timer_run(HORN_TIMER, TimerKind::OnDelay, wanted, HORN)?.or_stop(cx, "T 1")?;
        let warned = cx.timer(HORN_TIMER)?.or_stop(cx, "T 1")?.output;
        cx.set_bit(Area::Output, 0, 0, wanted && !warned)?.or_stop(cx, "A 0.0")?;
        cx.set_bit(Area::Output, 0, 1, wanted && warned)?.or_stop(cx, "A 0.1")?;

        let counted = cx.word(Area::Memory, PIECES)?.or_stop(cx, "MW 2")?;
        let before = if wanted && !was_wanted { 0 } else { counted };
        let passed = !edges.light_barrier.replace(barrier) && barrier && wanted && warned;
        cx.set_word(Area::Memory, PIECES, before.wrapping_add(u16::from(passed)))?.or_stop(cx, "MW 2")
    }
}

ob1_sdk::export_plugin! {
    name: "rust-ob1",
    version: env!("CARGO_PKG_VERSION"),
    module_state: (),
    blocks: [Conveyor],
}

//! FB 100 TWO_POINT: a two-point controller with hysteresis and a minimum pause, with its memory in the instance data
//! block.
//!
//! It switches on below `SP - HYS / 2` and off above `SP + HYS / 2`. After switching off it stays off for at least
//! `PAUSE`, so that a compressor is not started against its own pressure. `SWITCHES` counts how often it has switched
//! on.

mod controller;

use ob1_sdk::{Abort, Block, Cx, Kind, Param, interface};

use controller::Controller;

interface! {
    /// The instance, 28 bytes; README.md has the table.
    mod two_point {
        /// Process value that is controlled.
        in     PV: Real;
        /// Set point, in units of the process value.
        in     SP: Real;
        /// Hysteresis, in units of the process value; below 0 it counts as 0.
        in     HYS: Real = 1.0;
        /// Shortest time off, in milliseconds.
        in     PAUSE: Time = 5_000;
        /// The output: 1 switches on.
        out    Y: Bool;
        /// Times it has switched on. Retentive if the data block is.
        static SWITCHES: DInt;
        /// Milliseconds of the runtime when it last switched off.
        static OFF_AT: DWord;
        /// It has switched off since the instance was made.
        static HAS_BEEN_ON: Bool;
    }
}

struct TwoPoint;

impl Block for TwoPoint {
    const KIND: Kind = Kind::Fb;
    const NUMBER: u16 = 100;
    const NAME: &'static str = "TWO_POINT";
    const PARAMS: &'static [Param] = two_point::PARAMS;
    type State = ();
    type Module = ();

    fn call(cx: &mut Cx<'_>, _state: &()) -> Result<(), Abort> {
        let now_ms = (cx.now() / 1_000_000) as u32;
        let off_at = cx.load(two_point::OFF_AT)?;
        let rested = !cx.load(two_point::HAS_BEEN_ON)? || {
            // The counter of milliseconds begins again with the runtime: a time in the future is of an earlier run.
            let pause = cx.get(two_point::PAUSE)?.max(0) as u32;
            now_ms.checked_sub(off_at).is_none_or(|off_for| off_for >= pause)
        };
        let controller = Controller { set_point: cx.get(two_point::SP)?, hysteresis: cx.get(two_point::HYS)? };
        let was_on = cx.get(two_point::Y)?;
        let on = controller.output(was_on, cx.get(two_point::PV)?, rested);
        if on && !was_on {
            let switches = cx.load(two_point::SWITCHES)?;
            cx.store(two_point::SWITCHES, switches.wrapping_add(1))?;
        }
        if was_on && !on {
            cx.store(two_point::OFF_AT, now_ms)?;
            cx.store(two_point::HAS_BEEN_ON, true)?;
        }
        cx.set(two_point::Y, on)
    }
}

ob1_sdk::export_plugin! {
    name: "rust-blocks",
    version: env!("CARGO_PKG_VERSION"),
    module_state: (),
    blocks: [TwoPoint],
}

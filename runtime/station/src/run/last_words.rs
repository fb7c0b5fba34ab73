//! What a station that crashes still does: outputs off, and a message that says where the program was.

use std::sync::Arc;

use ob1_cpu::{Running, ScanPosition};
use ob1_rt::LastWords;

use crate::exit::Exit;
use crate::io::ProcessIo;

/// Prepares for a crash of this process.
///
/// # Errors
/// The system does not take the handler of a crash.
pub(super) fn prepare(
    io: Option<ProcessIo>,
    running: Arc<Running>,
    position: Arc<ScanPosition>,
) -> std::io::Result<()> {
    let words = LastWords {
        // The lock inside is only tried: whoever held it when the process crashed keeps it.
        outputs_off: Box::new(move || {
            if let Some(io) = &io {
                io.switch_off();
            }
        }),
        place: Box::new(move |text| match (running.block(), position.caller(), position.ob()) {
            (Some(block), Some(site), _) => write!(text, "native block {block}, called by {site}"),
            (Some(block), None, Some(ob)) => write!(text, "native block {block} in OB {ob}"),
            (Some(block), None, None) => write!(text, "native block {block}"),
            (None, _, Some(ob)) => write!(text, "the runtime, in OB {ob}"),
            (None, _, None) => write!(text, "the runtime"),
        }),
        exit_code: Exit::Crashed as u8,
    };
    words.keep()
}

//! What the station file says about the module: `abd`.

use ob1_sdk::{Abort, Cx};

use crate::registers::Module;
use crate::state::CpState;

/// What ABD counts is not known yet: 0, as the module's memory begins.
const UNKNOWN: u8 = 0;

/// The byte that ABD means: the manual's tables say "data word", its examples count bytes. The station file decides.
pub(crate) fn offset(cx: &mut Cx<'_, CpState>, module: &Module<'_>, abd: u16) -> Result<u32, Abort> {
    let unit = &module.state.abd_bytes;
    if unit.get() == UNKNOWN {
        let mut text = [0; 8];
        let is_word = matches!(cx.setting_text(module.address, "abd", &mut text)?, Ok(b"word"));
        unit.set(if is_word { 2 } else { 1 });
    }
    Ok(u32::from(abd) * u32::from(unit.get()))
}

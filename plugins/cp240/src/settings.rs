//! The settings of the module in the station file: `abd`, `protocol`.

use ob1_sdk::{Abort, Cx};

use crate::state::CpState;

/// The setting is not read yet: 0, the initial value of the module's memory.
const UNKNOWN: u8 = 0;

/// The byte that ABD refers to: the manual's tables say "data word", its examples count bytes. The station file
/// decides.
pub(crate) fn offset(cx: &mut Cx<'_, CpState>, address: u32, state: &CpState, abd: u16) -> Result<u32, Abort> {
    let unit = &state.abd_bytes;
    if unit.get() == UNKNOWN {
        let mut text = [0; 8];
        let is_word = matches!(cx.setting_text(address, "abd", &mut text)?, Ok(b"word"));
        unit.set(if is_word { 2 } else { 1 });
    }
    Ok(u32::from(abd) * u32::from(unit.get()))
}

/// Which handling blocks the protocol of the CP supports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Service {
    /// All blocks, including FC 9 for the start-up identifier.
    All,
    /// Modbus: no start-up identifier. [S0 L1409 ff.]
    NoSynchronisation,
    /// Modbus slave "short": the registers hold the data of the master. [S0 "Modbus Slave Short"]
    Nothing,
}

/// The blocks the CP supports: all, if the host does not know the setting.
pub(crate) fn service(cx: &mut Cx<'_, CpState>, address: u32, state: &CpState) -> Result<Service, Abort> {
    let known = &state.service;
    if known.get() == UNKNOWN {
        let mut text = [0; 32];
        let protocol = cx.setting_text(address, "protocol", &mut text)?.unwrap_or(b"");
        let is_modbus = protocol.starts_with(b"modbus-");
        known.set(match is_modbus {
            true if protocol.ends_with(b"-short") => 3,
            true => 2,
            false => 1,
        });
    }
    Ok(match known.get() {
        1 => Service::All,
        2 => Service::NoSynchronisation,
        _ => Service::Nothing,
    })
}

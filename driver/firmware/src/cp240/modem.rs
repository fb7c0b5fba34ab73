//! The modem lines, and the line command that reads and sets them (FC 8 STEUERBIT) [S0 "STUEBIT (FC 8)"],
//! `docs/cp240-registers.md`.

use ob1_params::Interface;
use ob1_protocols::ModemLines;

use ob1_words::cp240::{LINE_ANSWER, LINE_DELTA_SHIFT, LINE_DTR, LINE_RTS, LINE_SET_DTR, LINE_SET_RTS};

/// The lines as the module sees and drives them; `true` is ON.
#[derive(Debug)]
pub(crate) struct Modem {
    /// `None`: the line has not reported yet.
    lines: Option<ModemLines>,
    /// CTS, DSR, RI, CD (bits 0 to 3) that have changed since the last command.
    delta: u16,
    rts: bool,
    dtr: bool,
    /// Of all lines the plug has RTS alone: RS 422 and RS 485. [S0 L1504], [S0 L1526]
    rts_alone: bool,
}

/// What a command has switched.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Switched {
    pub(crate) rts: Option<bool>,
    pub(crate) dtr: Option<bool>,
}

impl Modem {
    pub(crate) const fn new() -> Self {
        Self { lines: None, delta: 0, rts: true, dtr: true, rts_alone: false }
    }

    /// Which lines the plug has.
    pub(crate) fn set_interface(&mut self, interface: Interface) {
        self.rts_alone = !interface.has_modem_lines();
    }

    pub(crate) const fn lines(&self) -> Option<ModemLines> {
        self.lines
    }

    /// The line reports its inputs. The first report counts as no change.
    pub(crate) fn input(&mut self, lines: ModemLines) {
        if self.rts_alone {
            return;
        }
        if let Some(before) = self.lines.replace(lines) {
            self.delta |= u16::from(before.bits() ^ lines.bits());
        }
    }

    /// The protocol switches RTS (hardware flow control).
    pub(crate) fn set_rts(&mut self, on: bool) {
        self.rts = on;
    }

    /// After a start-up RTS and DTR are ON and nothing has changed.
    pub(crate) fn reset(&mut self) {
        (self.delta, self.rts, self.dtr) = (0, true, true);
    }

    /// Carries out a command; returns what was switched and the word of the answer. With hardware flow control RTS
    /// belongs to the protocol.
    pub(crate) fn command(&mut self, command: u16, rts_is_free: bool) -> (Switched, u16) {
        let mut switched = Switched::default();
        if command & LINE_SET_RTS != 0 && rts_is_free {
            self.rts = command & LINE_RTS != 0;
            switched.rts = Some(self.rts);
        }
        if command & LINE_SET_DTR != 0 && !self.rts_alone {
            self.dtr = command & LINE_DTR != 0;
            switched.dtr = Some(self.dtr);
        }
        // [S0 "STATUS, DELTA_STATUS"]
        let lines = u16::from(self.lines.unwrap_or_default().bits());
        let status = lines | u16::from(self.dtr && !self.rts_alone) << 4 | u16::from(self.rts) << 5;
        let delta = std::mem::take(&mut self.delta) << LINE_DELTA_SHIFT;
        (switched, LINE_ANSWER | delta | status)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn status_has_the_bits_of_the_manual() {
        let mut modem = Modem::new();
        assert_eq!(modem.command(0, true), (Switched::default(), 0x1C30), "RTS and DTR are ON, the others not known");
        modem.input(ModemLines { cts: true, dsr: false, ri: true, cd: false });
        assert_eq!(modem.command(0, true).1, 0x1C35, "what is told first has not changed");
        modem.input(ModemLines { cts: false, dsr: true, ri: true, cd: false });
        modem.input(ModemLines { cts: true, dsr: true, ri: true, cd: true });
        assert_eq!(modem.command(0, true).1, 0x1C3F | 0b1011 << 6, "CTS has changed and is as before");
        assert_eq!(modem.command(0, true).1, 0x1C3F, "since the last access");
    }

    /// [S0 L1504], [S0 L1526]: of all lines the plugs of RS 485 and RS 422 have RTS alone.
    #[test]
    fn rs_422_and_rs_485_have_rts_alone() {
        for interface in [Interface::Rs422, Interface::Rs485] {
            let mut modem = Modem::new();
            modem.set_interface(interface);
            modem.input(ModemLines { cts: true, dsr: true, ri: true, cd: true });
            assert_eq!(modem.command(0, true), (Switched::default(), 0x1C20), "RTS is ON");
            assert_eq!(modem.command(0b1111, true), (Switched { rts: Some(true), dtr: None }, 0x1C20));
            assert_eq!(modem.command(0b1100, true), (Switched { rts: Some(false), dtr: None }, 0x1C00));
        }
    }

    #[test]
    fn only_what_the_mask_names_is_switched() {
        let mut modem = Modem::new();
        assert_eq!(modem.command(0b0011, true).0, Switched::default());
        assert_eq!(modem.command(0b0100, true), (Switched { rts: Some(false), dtr: None }, 0x1C10));
        assert_eq!(modem.command(0b1001, true), (Switched { rts: None, dtr: Some(false) }, 0x1C00));
        assert_eq!(modem.command(0b1111, true), (Switched { rts: Some(true), dtr: Some(true) }, 0x1C30));
        assert_eq!(modem.command(0b0100, false), (Switched::default(), 0x1C30), "RTS is the protocol's");
        modem.command(0b1000, true);
        modem.reset();
        assert_eq!(modem.command(0, true).1, 0x1C30);
    }
}

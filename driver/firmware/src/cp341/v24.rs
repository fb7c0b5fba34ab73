//! The accompanying signals of the RS 232 interface, for V24_STAT and V24_SET. [TIA help "PtP data link CP 341"],
//! `docs/cp341-channels.md`

use ob1_protocols::{Instant, ModemLines, Span};

use ob1_words::channels::v24::{CTS, DCD, DRIVES, DSR, DTR, RI, RTS};

use crate::port::CpPort;
use ob1_words::cp240::Registers;

/// "The CP refreshes its status image every 20 ms". [TIA help "PtP data link CP 341"]
const REFRESH: Span = Span::from_millis(20);

/// The signals, and their image for the CPU.
#[derive(Debug)]
pub(crate) struct V24 {
    /// `None`: the line has not reported yet.
    lines: Option<ModemLines>,
    rts: bool,
    dtr: bool,
    shown: u8,
    due: Option<Instant>,
    /// Number of the last request to empty the receive buffer; 0: none yet.
    reset: u8,
    reset_shown: u8,
}

impl V24 {
    pub(crate) const fn new() -> Self {
        Self { lines: None, rts: false, dtr: false, shown: 0, due: None, reset: 0, reset_shown: 0 }
    }

    /// Switches RTS and DTR OFF.
    pub(crate) fn off(&mut self, port: &mut dyn CpPort) {
        (self.rts, self.dtr) = (false, false);
        port.rts(false);
        port.dtr(false);
    }

    /// The line's inputs, once it has reported them.
    pub(crate) fn lines(&self) -> Option<ModemLines> {
        self.lines
    }

    /// The line reports its inputs.
    pub(crate) fn input(&mut self, lines: ModemLines) {
        self.lines = Some(lines);
    }

    /// What the protocol has switched.
    pub(crate) fn switched(&mut self, rts: Option<bool>, dtr: Option<bool>) {
        self.rts = rts.unwrap_or(self.rts);
        self.dtr = dtr.unwrap_or(self.dtr);
    }

    /// P_RESET: true for a new request to empty the receive buffer. The answer is its number.
    pub(crate) fn reset(&mut self, outputs: &Registers) -> bool {
        let number = outputs[1];
        let is_new = number != 0 && number != self.reset;
        self.reset = if is_new { number } else { self.reset };
        is_new
    }

    /// V24_SET. RTS does not belong to the program where flow control drives it, and neither signal does with automatic
    /// use. [TIA help "PtP data link CP 341"]
    pub(crate) fn set(
        &mut self,
        outputs: &Registers,
        (rts_is_driven, dtr_is_driven): (bool, bool),
        port: &mut dyn CpPort,
    ) {
        let byte = outputs[0];
        if byte & DRIVES == 0 {
            return;
        }
        let (rts, dtr) = (byte & RTS != 0, byte & DTR != 0);
        if rts != self.rts && !rts_is_driven {
            self.rts = rts;
            port.rts(rts);
        }
        if dtr != self.dtr && !dtr_is_driven {
            self.dtr = dtr;
            port.dtr(dtr);
        }
    }

    /// Updates the image, at most every 20 ms; returns when the next update is due.
    pub(crate) fn refresh(&mut self, now: Instant, port: &mut dyn CpPort) -> Option<Instant> {
        let image = self.image();
        let is_answered = self.reset == self.reset_shown;
        if image == self.shown && is_answered {
            self.due = None;
            return None;
        }
        // An answer does not wait.
        let due = *self.due.get_or_insert(now.next_tick(REFRESH));
        if now < due && is_answered {
            return Some(due);
        }
        (self.shown, self.due, self.reset_shown) = (image, None, self.reset);
        let mut registers = Registers::default();
        (registers[0], registers[1]) = (image, self.reset);
        port.inputs(&registers);
        None
    }

    fn image(&self) -> u8 {
        let lines = self.lines.unwrap_or(ModemLines::UNREPORTED);
        let bits =
            [(self.dtr, DTR), (lines.dsr, DSR), (self.rts, RTS), (lines.cts, CTS), (lines.cd, DCD), (lines.ri, RI)];
        bits.into_iter().filter(|(on, _)| *on).fold(0, |image, (_, bit)| image | bit)
    }
}

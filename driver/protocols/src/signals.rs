//! Automatic use of the RS 232C secondary signals: RTS and DTR are driven, CTS and DSR are monitored. [S4 "4.3 RS 232C
//! Secondary Signals"], [TIA help "Configuration for point-to-point links"]
//!
//! ```text
//! parameters    RTS OFF, DTR ON
//! a request     RTS ON -- data output waiting time --> CTS ON? the characters
//! its end       last bit out -- time to RTS OFF --> RTS OFF
//! ```
//!
//! Used by the ASCII driver and by the loadable Modbus driver. They decide what ends when a signal goes OFF; this
//! module has the signals and both times. Without [`Times`] the signals are neither set nor checked [S4 L590]:
//! everything is clear at once.

use crate::machine::{Instant, ModemLines, Span, Wire, earliest};

/// Both times, in nanoseconds. [S4 "3.6.3 RS232 Secondary Signals"]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Times {
    /// From the last bit of a request to RTS OFF.
    pub rts_off: Span,
    /// Data output waiting time: from RTS ON to the first character.
    pub output_wait: Span,
}

/// Whether a request may be sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Clear {
    /// The request may be sent now.
    Go,
    /// The data output waiting time runs.
    Wait,
    /// DSR is OFF, or CTS was not ON in time: the request fails.
    Off,
}

/// The meaning of a change of the inputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Change {
    /// DSR has gone from ON to OFF.
    pub(crate) dsr_fell: bool,
    /// CTS is OFF now.
    pub(crate) cts_off: bool,
}

/// The signals of one interface.
#[derive(Clone, Debug)]
pub(crate) struct Signals {
    /// `None`: no automatic use.
    times: Option<Times>,
    lines: ModemLines,
    /// RTS is ON for a request whose last bit has not been sent.
    requested: bool,
    /// End of the data output waiting time.
    wait: Option<Instant>,
    /// When RTS goes OFF.
    rts_off: Option<Instant>,
}

impl Signals {
    pub(crate) const fn new(times: Option<Times>) -> Self {
        Self { times, lines: ModemLines::UNREPORTED, requested: false, wait: None, rts_off: None }
    }

    /// Whether they are used automatically.
    pub(crate) const fn are_used(&self) -> bool {
        self.times.is_some()
    }

    /// "... it switches the RTS line to OFF and the DTR line to ON." [S4 L811]
    pub(crate) fn start(&self, out: &mut dyn Wire) {
        if self.are_used() {
            out.rts(false);
            out.dtr(true);
        }
    }

    /// "When a send request is made, RTS is set to ON and the parameterized data output waiting time starts." [S4 L813]
    /// With DSR OFF the request fails.
    pub(crate) fn request(&mut self, now: Instant, out: &mut dyn Wire) -> Clear {
        let Some(times) = self.times else { return Clear::Go };
        if !self.lines.dsr {
            return Clear::Off;
        }
        // RTS may still be ON for the previous request.
        self.rts_off = None;
        self.requested = true;
        self.wait = Some(now + times.output_wait);
        out.rts(true);
        self.clear(now)
    }

    /// "When the data output time elapses and CTS = ON, the data is sent"; if CTS is not ON by then, "the send request
    /// is aborted". [S4 L813], [S4 L814]
    pub(crate) fn clear(&mut self, now: Instant) -> Clear {
        match self.wait {
            Some(until) if now < until => Clear::Wait,
            Some(_) if !self.lines.cts => Clear::Off,
            _ => {
                self.wait = None;
                Clear::Go
            }
        }
    }

    /// The last bit of the request has been sent: "the RTS line is set to OFF after the parameterized time to RTS OFF
    /// has elapsed". [S4 L815]
    pub(crate) fn sent(&mut self, now: Instant) {
        if let (Some(times), true) = (self.times, self.requested) {
            self.requested = false;
            self.rts_off = Some(now + times.rts_off);
        }
    }

    /// The request has ended before its last bit.
    pub(crate) fn drop_request(&mut self, out: &mut dyn Wire) {
        self.wait = None;
        if core::mem::take(&mut self.requested) {
            out.rts(false);
        }
    }

    pub(crate) fn tick(&mut self, now: Instant, out: &mut dyn Wire) {
        if self.rts_off.take_if(|at| now >= *at).is_some() {
            out.rts(false);
        }
    }

    pub(crate) fn deadline(&self) -> Option<Instant> {
        earliest([self.wait, self.rts_off])
    }

    /// The inputs have changed.
    pub(crate) fn inputs(&mut self, lines: ModemLines) -> Change {
        let dsr_was_on = self.lines.dsr;
        self.lines = lines;
        let used = self.are_used();
        Change { dsr_fell: used && dsr_was_on && !lines.dsr, cts_off: used && !lines.cts }
    }

    /// "Data can be received via the RS 232C interface as soon as the DSR line is set to ON." [S4 L816]
    pub(crate) fn can_receive(&self) -> bool {
        !self.are_used() || self.lines.dsr
    }
}

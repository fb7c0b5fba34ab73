//! STX/ETX: telegrams between start and end characters; nothing is acknowledged, nothing checked. [S0 "STX/ETX"]
//!
//! None, one or two characters each. Characters before the start are discarded; those between start and end go to the
//! CPU when the end has come. Without end characters a telegram ends with the silence of TMO [S0 "Technical Data
//! Protocols"]; without start characters it begins with any character. Sending and receiving are independent of each
//! other (full duplex), an order is done when ZNA has run out after the last bit, and flow control is that of
//! [`ascii`](crate::ascii).
//!
//! | the manual leaves open | here |
//! |---|---|
//! | TMO expires within a telegram that has end characters | the telegram is lost, reported as 0806h |
//! | a start within a telegram | the end was lost: that telegram is dropped and a new one begins |
//! | one of two start (end) characters alone | before a telegram discarded, within it user data |
//! | start and end are the same character | within a telegram it is the end |
//! | a telegram without user data | not delivered |
//! | a character that cannot be read, or no room | the telegram is lost, until the next start, end or silence |

mod decoder;

use crate::duplex::{Duplex, Receiver};
use crate::flow::Flow;
use crate::machine::{Event, Instant, Phase, Sink, Span, TELEGRAM_MAX, What};
pub use crate::output::Flags;
use crate::output::{Extent, Rules};
pub use decoder::{Decoder, Step};

/// Configuration of [`StxEtx`]. Times in nanoseconds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Config {
    /// Start characters, none to two.
    pub start: Flags,
    /// End characters, none to two.
    pub end: Flags,
    /// Who may stop the sender, and how.
    pub flow: Flow,
    /// ZNA: from the last bit of a telegram to the end of its order.
    pub zna: Span,
    /// TMO: longest silence within a telegram.
    pub tmo: Span,
    /// Time of one character on the line.
    pub char_time: Span,
    /// Longest time that an order waits for XON or CTS; 0: for ever. See [`ascii::Config`](crate::ascii::Config).
    pub flow_wait: Span,
}

impl Config {
    /// Nothing set: no characters, no times, no flow control. The defaults of the parameters are in `ob1-params`.
    pub const fn unset(char_time: Span) -> Self {
        Self {
            start: Flags::NONE,
            end: Flags::NONE,
            flow: Flow::None,
            zna: Span::ZERO,
            tmo: Span::ZERO,
            char_time,
            flow_wait: Span::from_secs(20),
        }
    }
}

/// The STX/ETX procedure with a send and a receive buffer of `N` bytes each.
pub type StxEtx<const N: usize = TELEGRAM_MAX> = Duplex<Receive<N>, N>;

impl<const N: usize> StxEtx<N> {
    /// A machine before its first step.
    pub fn new(config: &Config) -> Self {
        let rules = Rules {
            start: config.start,
            end: config.end,
            flow: config.flow,
            zna: config.zna,
            char_time: config.char_time,
            flow_wait: config.flow_wait,
            extent: Extent::Whole,
            pause: Span::ZERO,
            signals: None,
        };
        Duplex::of(rules, Receive::new(config))
    }
}

/// The receiving half, with a buffer of `N` bytes.
#[derive(Clone, Debug)]
pub struct Receive<const N: usize> {
    tmo: Span,
    /// There are end characters; otherwise silence ends a telegram.
    has_end: bool,
    decoder: Decoder,
    telegram: Telegram<N>,
    /// Silence until then ends the telegram being received.
    silence: Option<Instant>,
}

impl<const N: usize> Receive<N> {
    fn new(config: &Config) -> Self {
        Self {
            tmo: config.tmo,
            has_end: !config.end.as_slice().is_empty(),
            decoder: Decoder::new(config.start, config.end),
            telegram: Telegram { open: false, len: 0, data: [0; N], noise: false, completed: false },
            silence: None,
        }
    }

    /// TMO has expired. [S0 "Timeout (TMO)"]
    fn silent(&mut self, out: &mut dyn Sink) {
        let telegram = &mut self.telegram;
        self.decoder.flush(&mut |decoder, step| telegram.take(decoder, step, out));
        if self.telegram.open {
            if self.has_end {
                self.telegram.lose(What::CharacterDelay, out);
            } else {
                // [S0 "Technical Data Protocols"]: end recognition after TMO.
                self.telegram.complete(out);
            }
        }
        self.decoder.reset();
        self.silence = None;
    }

    /// Silence is monitored while anything is being received.
    fn watch(&mut self, now: Instant) {
        let runs = self.telegram.open || self.decoder.skips() || self.decoder.holds();
        self.silence = runs.then(|| now + self.tmo);
    }
}

impl<const N: usize> Receiver for Receive<N> {
    fn tick(&mut self, now: Instant, out: &mut dyn Sink) -> bool {
        if self.silence.is_some_and(|until| now >= until) {
            self.silent(out);
        }
        core::mem::take(&mut self.telegram.completed)
    }

    fn character(&mut self, now: Instant, byte: u8, out: &mut dyn Sink) -> bool {
        let telegram = &mut self.telegram;
        self.decoder.feed(byte, &mut |decoder, step| telegram.take(decoder, step, out));
        self.watch(now);
        core::mem::take(&mut self.telegram.completed)
    }

    fn unreadable(&mut self, now: Instant, what: What, out: &mut dyn Sink) {
        // It may have been the start of a telegram, which is lost then; the rest of a lost one costs nothing more.
        let phase = if self.decoder.skips() { Phase::Idle } else { Phase::Receive };
        out.report(Event { phase, what });
        self.telegram.close();
        self.decoder.skip();
        self.watch(now);
    }

    fn clear(&mut self, _out: &mut dyn Sink) {
        self.telegram.close();
        self.decoder.reset();
        self.silence = None;
    }

    fn is_receiving(&self) -> bool {
        self.telegram.open
    }

    fn deadline(&self) -> Option<Instant> {
        self.silence
    }
}

/// The telegram being received.
#[derive(Clone, Debug)]
struct Telegram<const N: usize> {
    /// A start has come, or without start characters the first character.
    open: bool,
    len: usize,
    data: [u8; N],
    /// Noise has been reported since the last telegram.
    noise: bool,
    /// A telegram was completed in this step: the receive buffer may be full now.
    completed: bool,
}

impl<const N: usize> Telegram<N> {
    fn take(&mut self, decoder: &mut Decoder, step: Step, out: &mut dyn Sink) {
        match step {
            Step::Noise(byte) => {
                // [S0 "STX/ETX"]: data must be preceded by STX. One report is enough.
                if !core::mem::replace(&mut self.noise, true) {
                    out.report(Event { phase: Phase::Idle, what: What::Unexpected(byte) });
                }
            }
            Step::Begin => {
                if self.open {
                    out.report(Event { phase: Phase::Receive, what: What::Restarted });
                }
                self.begin(decoder, out);
            }
            Step::Data(byte) => {
                if !self.open && !self.begin(decoder, out) {
                    return;
                }
                match self.data.get_mut(self.len) {
                    Some(place) => {
                        *place = byte;
                        self.len += 1;
                    }
                    None => {
                        // [S0 "Communication via back plane bus"]: the ring buffer's length is that of the longest
                        // telegram.
                        self.lose(What::TooLong, out);
                        decoder.skip();
                    }
                }
            }
            Step::End => self.complete(out),
        }
    }

    /// False: no receive buffer is free. [S0 "Communication via back plane bus"]: new telegrams are rejected.
    fn begin(&mut self, decoder: &mut Decoder, out: &mut dyn Sink) -> bool {
        self.close();
        self.noise = false;
        self.open = out.room() > 0;
        if !self.open {
            out.report(Event { phase: Phase::Receive, what: What::NoBuffer });
            decoder.skip();
        }
        self.open
    }

    /// [S0 "STX/ETX"]: the characters between STX and ETX are transferred when ETX has been received.
    fn complete(&mut self, out: &mut dyn Sink) {
        match (self.len, out.room()) {
            (0, _) => out.report(Event { phase: Phase::Receive, what: What::Empty }),
            // [S0 "Communication via back plane bus"]: when the buffer is filled up, new telegrams are rejected.
            (len, room) if len > room => out.report(Event { phase: Phase::Receive, what: What::NoBuffer }),
            (len, _) => out.deliver(&self.data[..len]),
        }
        self.completed = true;
        self.close();
    }

    fn lose(&mut self, what: What, out: &mut dyn Sink) {
        out.report(Event { phase: Phase::Receive, what });
        self.close();
    }

    fn close(&mut self) {
        (self.open, self.len) = (false, 0);
    }
}

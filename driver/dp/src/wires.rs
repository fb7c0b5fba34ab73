//! The line for the stack.
//!
//! The stack reads its line telegram by telegram, and checks less than it could: an answer is matched only by its
//! sender, a short confirmation by nothing, and the rest of a damaged telegram is read as the beginning of the next. On
//! a line with disturbances, or with an adapter that hands over characters late, that would sometimes put a diagnosis
//! into the inputs. So the line itself is strict: it hands over only whole telegrams that pass every check of the
//! standard, and while an answer is due only an answer to the request. After the first invalid character, everything is
//! noise until the line has been quiet or we have sent.

use ob1_coupler::config::{Instant, Span};
use ob1_protocols::profibus::telegram::{self, Frame};
use ob1_protocols::profibus::{Parsed, TELEGRAM_BYTES, Telegram, function, sap};
use profirust::phy::ProfibusPhy;
use profirust::time;

/// The fields of a request that its answer must mirror.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Asked {
    da: u8,
    sa: u8,
    dsap: Option<u8>,
    ssap: Option<u8>,
}

/// The line of a master.
#[derive(Default)]
pub struct Wires {
    /// The bytes to send.
    out: Vec<u8>,
    /// They are being sent, or their end has not been noticed yet.
    sending: bool,
    received: Vec<u8>,
    /// Characters since the last telegram handed over, which the stack takes for activity.
    heard: usize,
    /// The time of the last character, or of our own last bit.
    active: Instant,
    /// A character was invalid: everything after it is noise until the line has been quiet for `quiet`.
    noise: bool,
    quiet: Span,
    asked: Option<Asked>,
    /// A requested diagnosis: the slave's address, and its bytes.
    diagnosis: Option<(u8, Vec<u8>)>,
    /// Telegrams that were damaged, cut off, or did not answer the request.
    rejected: u64,
    sent: u64,
}

impl Wires {
    /// `quiet`: after this long without a character the next one begins a telegram.
    pub(crate) fn new(quiet: Span) -> Self {
        Self { quiet, ..Self::default() }
    }

    /// Resets everything: the line is new.
    pub(crate) fn reset(&mut self) {
        self.out.clear();
        self.received.clear();
        (self.sending, self.noise, self.heard, self.asked) = (false, false, 0, None);
    }

    /// Takes characters of the line; they are dropped while we send, and after noise until a pause.
    pub(crate) fn hear(&mut self, now: Instant, bytes: &[u8]) {
        self.listen(now, bytes.len());
        if self.noise || self.sending {
            return;
        }
        let room = TELEGRAM_BYTES.saturating_sub(self.received.len());
        self.received.extend(bytes.iter().take(room));
        self.check();
    }

    /// A character could not be read.
    pub(crate) fn fault(&mut self, now: Instant) {
        self.listen(now, 1);
        if !self.sending {
            self.spoil();
        }
    }

    fn listen(&mut self, now: Instant, characters: usize) {
        if self.noise && now.since(self.active) >= self.quiet {
            (self.noise, self.received) = (false, Vec::new());
        }
        self.heard += characters;
        self.active = now;
    }

    /// Everything has been sent.
    pub(crate) fn is_out(&mut self, now: Instant) {
        (self.sending, self.active) = (false, now);
    }

    pub(crate) const fn is_sending(&self) -> bool {
        self.sending
    }

    /// The bytes to send since the last call.
    pub(crate) fn take(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.out)
    }

    pub(crate) fn take_diagnosis(&mut self) -> Option<(u8, Vec<u8>)> {
        self.diagnosis.take()
    }

    /// Telegrams that were damaged, cut off, or did not answer the request.
    pub const fn rejected(&self) -> u64 {
        self.rejected
    }

    /// Number of telegrams sent; it only grows.
    pub const fn sent(&self) -> u64 {
        self.sent
    }

    fn spoil(&mut self) {
        if !std::mem::replace(&mut self.noise, true) {
            self.rejected += 1;
        }
        self.received.clear();
    }

    /// Checks whether the received characters can still become the telegram that the stack waits for.
    fn check(&mut self) {
        let fits = match telegram::parse(&self.received) {
            Parsed::Wrong => false,
            Parsed::More => true,
            Parsed::Telegram(telegram, _) => self.asked.is_none_or(|asked| answers(&asked, &telegram)),
        };
        if !fits {
            self.spoil();
        }
    }
}

/// Whether a telegram answers a request. A short confirmation is an answer if no data are due; otherwise the stack
/// treats it as no answer.
fn answers(asked: &Asked, telegram: &Telegram<'_>) -> bool {
    match telegram {
        Telegram::Confirmation => true,
        Telegram::Token { .. } => false,
        Telegram::Data(Frame { da, sa, dsap, ssap, fc, .. }) => {
            // A refusal has no service access points, because the requested one is not open.
            let bare = dsap.is_none() && ssap.is_none() && !matches!(fc & 0x0F, function::DATA | function::DATA_HIGH);
            fc & function::REQUEST == 0
                && (*da, *sa) == (asked.sa, asked.da)
                && ((*dsap, *ssap) == (asked.ssap, asked.dsap) || bare)
        }
    }
}

impl ProfibusPhy for Wires {
    fn poll_transmission(&mut self, _now: time::Instant) -> bool {
        self.sending
    }

    fn transmit_data<F, R>(&mut self, _now: time::Instant, f: F) -> R
    where
        F: FnOnce(&mut [u8]) -> (usize, R),
    {
        let mut buffer = [0; TELEGRAM_BYTES];
        let (len, result) = f(&mut buffer);
        let bytes = buffer.get(..len).unwrap_or_default();
        if !bytes.is_empty() {
            // Characters received before the request are not an answer.
            (self.received, self.noise, self.sending) = (Vec::new(), false, true);
            self.sent += 1;
            self.out.extend_from_slice(bytes);
            self.asked = match telegram::parse(bytes) {
                Parsed::Telegram(Telegram::Data(Frame { da, sa, dsap, ssap, fc, .. }), _)
                    if fc & function::REQUEST != 0 && !matches!(fc & 0x0F, function::SDN | function::SDN_HIGH) =>
                {
                    Some(Asked { da, sa, dsap, ssap })
                }
                _ => None,
            };
        }
        result
    }

    fn receive_data<F, R>(&mut self, _now: time::Instant, f: F) -> R
    where
        F: FnOnce(&[u8]) -> (usize, R),
    {
        let whole = match telegram::parse(&self.received) {
            Parsed::Telegram(telegram, len) => {
                if let (Telegram::Data(frame), Some(asked)) = (telegram, self.asked)
                    && asked.dsap == Some(sap::DIAGNOSIS)
                    && frame.ssap == asked.dsap
                {
                    self.diagnosis = Some((frame.sa, frame.data.to_vec()));
                }
                len
            }
            Parsed::More | Parsed::Wrong => 0,
        };
        let (used, result) = f(self.received.get(..whole).unwrap_or_default());
        let used = used.min(self.received.len());
        if used > 0 {
            (self.asked, self.heard) = (None, 0);
            self.received.drain(..used);
        }
        result
    }

    fn poll_pending_received_bytes(&mut self, _now: time::Instant) -> usize {
        self.heard
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const QUIET: Span = Span::from_nanos(100);
    const TICK: Span = Span::from_nanos(1);
    const AT: Instant = Instant::START;

    /// The number of bytes the stack gets of these after a request to station 8.
    fn answered(dsap: Option<u8>, bytes: &[u8]) -> usize {
        let mut wires = Wires::new(QUIET);
        let frame = Frame {
            da: 8,
            sa: 2,
            dsap,
            ssap: dsap.map(|_| sap::MASTER),
            fc: function::REQUEST | function::SRD_HIGH,
            data: &[1],
        };
        wires.transmit_data(time::Instant::ZERO, |buffer| {
            let mut telegram = [0; TELEGRAM_BYTES];
            let len = telegram::encode(&Telegram::Data(frame), &mut telegram).expect("it fits");
            buffer[..len].copy_from_slice(&telegram[..len]);
            (len, ())
        });
        wires.is_out(AT);
        bytes.iter().for_each(|byte| wires.hear(AT + TICK, &[*byte]));
        wires.receive_data(time::Instant::ZERO, |bytes| (0, bytes.len()))
    }

    fn telegram(sa: u8, dsap: Option<u8>, ssap: Option<u8>, fc: u8) -> Vec<u8> {
        let mut bytes = [0; TELEGRAM_BYTES];
        let frame = Frame { da: 2, sa, dsap, ssap, fc, data: &[7; 6] };
        let len = telegram::encode(&Telegram::Data(frame), &mut bytes).expect("it fits");
        bytes[..len].to_vec()
    }

    #[test]
    fn only_an_answer_to_what_was_asked_reaches_the_stack() {
        let (own, diagnosis) = (Some(sap::MASTER), Some(sap::DIAGNOSIS));
        for (asked, answer, taken) in [
            (None, telegram(8, None, None, function::DATA), true),
            (None, telegram(9, None, None, function::DATA), false),
            // A late diagnosis may be as long as the inputs.
            (None, telegram(8, own, diagnosis, function::DATA), false),
            (diagnosis, telegram(8, own, diagnosis, function::DATA), true),
            (diagnosis, telegram(8, None, None, function::DATA), false),
            (diagnosis, telegram(8, None, None, function::NOT_OPEN), true),
            (None, telegram(8, None, None, function::REQUEST | function::SRD), false),
            (None, vec![0xE5], true),
            (None, vec![0xDC, 2, 8], false),
        ] {
            assert_eq!(answered(asked, &answer) > 0, taken, "{asked:?} {answer:X?}");
        }
    }

    #[test]
    fn the_rest_of_a_damaged_telegram_is_noise() {
        let mut wires = Wires::new(QUIET);
        wires.hear(AT, &[0x68, 5, 6]);
        // The next character looks like a confirmation.
        wires.hear(AT + TICK, &[0xE5]);
        assert_eq!(wires.receive_data(time::Instant::ZERO, |bytes| (0, bytes.len())), 0);
        assert_eq!(wires.rejected(), 1);
        wires.hear(AT + TICK + QUIET, &[0xE5]);
        assert_eq!(wires.receive_data(time::Instant::ZERO, |bytes| (0, bytes.len())), 1);
        wires.fault(AT + 2 * TICK + QUIET);
        wires.hear(AT + 3 * TICK + QUIET, &[0xE5]);
        assert_eq!(wires.receive_data(time::Instant::ZERO, |bytes| (0, bytes.len())), 0);
    }
}

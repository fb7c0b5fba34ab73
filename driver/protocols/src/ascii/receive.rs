//! Characters to telegrams: where a telegram ends. [S0 "Communication via back plane bus"],
//! [TIA help "Configuration for point-to-point links"]
//!
//! | end criterion | a telegram ends | ZVZ expires before |
//! |---|---|---|
//! | silence | when ZVZ expires | |
//! | fragments | when ZVZ expires; each 12 bytes of it are passed on as they come | |
//! | end characters | with them; they belong to it | 0806h, what has come is dropped |
//! | length | after this many characters | 0806h, what has come is dropped |
//!
//! With the last two criteria the next character, however soon it comes, is the first of the next telegram. A lost
//! telegram (no room, an unreadable character) is still followed to its end, so that the next one is whole.

use super::{Criterion, FRAGMENT};
use crate::duplex::Receiver;
use crate::machine::{Event, Instant, Part, Phase, Sink, Span, What};

/// The telegram being received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Coming {
    /// Characters so far; with fragments: since the last part.
    len: usize,
    /// Fragments: parts of it have been passed on.
    begun: bool,
    /// The previous character, if it could be read.
    before: Option<u8>,
    /// It will not be delivered; this has been reported.
    lost: bool,
    /// Silence until then ends it.
    until: Instant,
}

impl Coming {
    const fn new(now: Instant) -> Self {
        Self { len: 0, begun: false, before: None, lost: false, until: now }
    }

    /// It will not be delivered; a receiver that already has parts of it learns that nothing follows.
    fn lose(&mut self, what: What, out: &mut dyn Sink) {
        out.report(Event { phase: Phase::Receive, what });
        self.break_off(out);
    }

    fn break_off(&mut self, out: &mut dyn Sink) {
        self.lost = true;
        if core::mem::take(&mut self.begun) {
            out.part(&[], Part::Broken);
        }
    }

    /// [S0 "Communication with ASCII-fragmented"]: blocks are transferred immediately; the telegram continues.
    fn hand_on(&mut self, data: &[u8], out: &mut dyn Sink) {
        if self.len > out.room() {
            return self.lose(What::NoBuffer, out);
        }
        out.part(&data[..self.len], Part::More);
        (self.len, self.begun) = (0, true);
    }
}

/// The receiving half, with a buffer of `N` bytes.
#[derive(Clone, Debug)]
pub struct Receive<const N: usize> {
    criterion: Criterion,
    zvz: Span,
    coming: Option<Coming>,
    data: [u8; N],
}

impl<const N: usize> Receive<N> {
    pub(super) const fn new(criterion: Criterion, zvz: Span) -> Self {
        Self { criterion, zvz, coming: None, data: [0; N] }
    }

    /// A character of the telegram, read or not; true if it has ended with it.
    fn take(&mut self, now: Instant, byte: Option<u8>, out: &mut dyn Sink) -> bool {
        let Some(coming) = &mut self.coming else { return false };
        coming.len += 1;
        coming.until = now + self.zvz;
        let ended = match self.criterion {
            Criterion::Silence => false,
            Criterion::Fragments => {
                if coming.len == FRAGMENT && !coming.lost {
                    coming.hand_on(&self.data, out);
                }
                false
            }
            Criterion::Characters { end, .. } => match *end.as_slice() {
                [only] => byte == Some(only),
                [first, second] => coming.before == Some(first) && byte == Some(second),
                _ => false,
            },
            Criterion::Length(length) => coming.len >= length,
        };
        coming.before = byte;
        if ended {
            self.end(out);
        }
        ended
    }

    /// The end of a telegram, lost or not.
    fn end(&mut self, out: &mut dyn Sink) {
        let Some(mut coming) = self.coming.take().filter(|coming| !coming.lost) else { return };
        // [S0 "Communication via back plane bus"]: when the buffer is filled up, new telegrams are rejected.
        if coming.len > out.room() {
            return coming.lose(What::NoBuffer, out);
        }
        let data = &self.data[..coming.len];
        if self.criterion == Criterion::Fragments { out.part(data, Part::Last) } else { out.deliver(data) }
    }
}

impl<const N: usize> Receiver for Receive<N> {
    fn tick(&mut self, now: Instant, out: &mut dyn Sink) -> bool {
        let Some(coming) = self.coming.filter(|coming| now >= coming.until) else { return false };
        match self.criterion {
            // [S0 "Communication via back plane bus"]: complete with the expiration of the ZVZ.
            Criterion::Silence | Criterion::Fragments => self.end(out),
            Criterion::Characters { .. } | Criterion::Length(_) if !coming.lost => {
                out.report(Event { phase: Phase::Receive, what: What::CharacterDelay });
            }
            _ => {}
        }
        self.coming = None;
        true
    }

    fn character(&mut self, now: Instant, byte: u8, out: &mut dyn Sink) -> bool {
        let is_first = self.coming.is_none();
        let coming = self.coming.get_or_insert(Coming::new(now));
        if is_first && out.room() == 0 {
            // [S0 "Number of receive buffers"]: no more data can be received while the receive buffer is occupied.
            coming.lose(What::NoBuffer, out);
        }
        if !coming.lost {
            match self.data.get_mut(coming.len) {
                Some(place) => *place = byte,
                // [S0 "Communication via back plane bus"]: the length of the ring buffer determines the max. length of
                // a telegram.
                None => coming.lose(What::TooLong, out),
            }
        }
        self.take(now, Some(byte), out)
    }

    fn unreadable(&mut self, now: Instant, what: What, out: &mut dyn Sink) {
        let coming = self.coming.get_or_insert(Coming::new(now));
        // The rest of a telegram that is already lost costs nothing more.
        let phase = if coming.lost { Phase::Idle } else { Phase::Receive };
        out.report(Event { phase, what });
        coming.break_off(out);
        self.take(now, None, out);
    }

    fn abandon(&mut self, what: What, out: &mut dyn Sink) {
        if let Some(coming) = self.coming.as_mut().filter(|coming| !coming.lost) {
            coming.lose(what, out);
        }
    }

    fn clear(&mut self, out: &mut dyn Sink) {
        if let Some(mut coming) = self.coming.take() {
            coming.break_off(out);
        }
    }

    fn is_receiving(&self) -> bool {
        self.coming.is_some()
    }

    fn deadline(&self) -> Option<Instant> {
        self.coming.map(|coming| coming.until)
    }
}

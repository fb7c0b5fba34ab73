//! The own echo: an adapter for two wires may give back what is sent. In half duplex the receiver is off until the last
//! character has left, so most of it is not heard; the rest is known by its content.
//!
//! | what comes back | is the echo |
//! |---|---|
//! | the telegram's first characters, before its last one has left | certainly: nobody can answer yet |
//! | on a wire, sooner than as many characters of an answer take | certainly |
//! | the whole telegram, and more at once | certainly: nobody repeats a request and goes on |
//! | the whole telegram on a line that is known to echo | yes, unless it is much later than ever before |
//! | the same, twice in a row, though its beginning should have come back earlier | no, an answer |
//! | the whole telegram otherwise | cannot be told from an answer that repeats its request: passed on |

use crate::line::{Instant, Span};
use crate::link::Passage;

/// The characters at the end of a telegram that are handed over a few at a time.
const SLOW: usize = 8;
/// How late an echo may come, besides twice its latest: the latency timer of a USB adapter (16 ms), a busy machine.
const LATE: Span = Span::from_millis(20);
/// Shortest pause between two parts of a telegram to a program that may echo: all of them are twice a burst of a USB
/// adapter (16 ms) and more, so that a program on a busy machine gives something back in time.
const PAUSE: Span = Span::from_millis(10);
/// The same, to a program that has not echoed: less than the silence that ends a telegram of Modbus RTU (1.75 ms), for
/// the program may hand it on to a wire.
const SHORT_PAUSE: Span = Span::from_micros(1_200);

/// What is known of the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Known {
    Nothing,
    /// The last telegram did not come back.
    Silent,
    /// Telegrams come back: the adapter has an echo.
    Echoes,
}

/// What to do with received characters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Verdict {
    /// So many at the beginning are echo.
    pub(crate) drop: usize,
    /// So many characters of the telegram were taken for echo before these came, and were none.
    pub(crate) release: usize,
}

/// What a line gives back of a telegram.
#[derive(Clone, Debug)]
pub(crate) struct Echo {
    known: Known,
    /// The last telegram sent, to compare with.
    sent: Vec<u8>,
    /// So many of its characters have come back, from the first, and nothing else.
    back: usize,
    /// They are its echo.
    certain: bool,
    /// They were passed on as an answer.
    passed: bool,
    /// Its echo may still come.
    open: bool,
    /// It was handed over in parts, so that an echo would have been seen.
    watched: bool,
    /// How long after a telegram's end its whole echo has come at most.
    latest: Span,
    /// It echoes, but the last telegram came back after its end alone: as an answer may.
    doubted: bool,
    /// Whether the line echoes, if that has changed.
    news: Option<bool>,
}

impl Echo {
    pub(crate) const fn new() -> Self {
        Self {
            known: Known::Nothing,
            sent: Vec::new(),
            back: 0,
            certain: false,
            passed: false,
            open: false,
            watched: false,
            latest: Span::ZERO,
            doubted: false,
            news: None,
        }
    }

    /// Drops the telegram, with what is known of it: it did not leave as it should.
    pub(crate) fn forget(&mut self) {
        self.sent.clear();
        (self.back, self.certain, self.passed, self.open) = (0, false, false, false);
    }

    /// The line has been opened: it may be another.
    pub(crate) fn reopened(&mut self) {
        *self = Self { sent: std::mem::take(&mut self.sent), ..Self::new() };
        self.forget();
    }

    /// A telegram begins. Returns the shortest pause between its parts, or `None` if it is handed over at once.
    pub(crate) fn begin(&mut self, passage: Passage) -> Option<Span> {
        if self.open && self.back == 0 && !self.sent.is_empty() {
            // Neither its echo has come nor another answer. A wire behind the other end may have torn its parts: the
            // next one has shorter pauses, or none.
            self.know(if self.known == Known::Nothing { Known::Silent } else { Known::Nothing });
        }
        self.forget();
        self.open = true;
        let pause = match passage {
            Passage::Wire | Passage::Simulated => None,
            Passage::Program => Some(if self.known == Known::Silent { SHORT_PAUSE } else { PAUSE }),
            Passage::Network => (self.known == Known::Nothing).then_some(Span::ZERO),
        };
        self.watched = pause.is_some();
        pause
    }

    /// Characters of the telegram.
    pub(crate) fn sends(&mut self, bytes: &[u8]) {
        self.sent.extend_from_slice(bytes);
    }

    /// So many of its last characters will not be sent.
    pub(crate) fn taken_back(&mut self, count: usize) {
        self.sent.truncate(self.sent.len().saturating_sub(count));
    }

    /// Whether what comes before the end may be an answer: a program behind a network that has the whole telegram.
    pub(crate) fn may_be_answered_early(&self, passage: Passage) -> bool {
        passage == Passage::Network && self.known == Known::Silent
    }

    /// Whether the line echoes, if that has changed since it was last asked.
    pub(crate) const fn news(&mut self) -> Option<bool> {
        self.news.take()
    }

    pub(crate) const fn has_news(&self) -> bool {
        self.news.is_some()
    }

    /// Characters taken for echo that may turn out to be none.
    pub(crate) const fn withheld(&self) -> usize {
        if self.open && !self.certain && !self.passed { self.back } else { 0 }
    }

    /// Characters came while the receiver was off and so many of the telegram waited.
    pub(crate) fn overheard(&mut self, waiting: usize, bytes: &[u8]) {
        if !self.open {
            return;
        }
        let gone = self.sent.len().saturating_sub(waiting);
        let same = self.same(bytes).min(gone.saturating_sub(self.back));
        self.back += same;
        self.certain |= same > 0;
        self.open = same == bytes.len();
        self.whole(Span::ZERO);
    }

    /// A character that could not be read; whether it is one of the echo.
    pub(crate) fn unreadable(&mut self) -> bool {
        let is_echo = self.open && self.certain && self.back < self.sent.len();
        self.back += usize::from(is_echo);
        is_echo
    }

    /// Characters came after the telegram's end.
    pub(crate) fn heard(
        &mut self,
        (now, end): (Instant, Instant),
        char_time: Span,
        passage: Passage,
        bytes: &[u8],
    ) -> Verdict {
        if !self.open || bytes.is_empty() || self.back == self.sent.len() {
            return Verdict::default();
        }
        let withheld = self.withheld();
        let same = self.same(bytes);
        let back = self.back + same;
        let (is_whole, goes_on) = (back == self.sent.len(), same < bytes.len());
        let late = now.since(end);
        if !self.certain && !self.passed && same > 0 {
            // A partner's clock may be a little faster.
            let too_soon = passage == Passage::Wire && late < char_time * back as u64 * 7 / 8;
            let one = self.sent.len() == 1 && self.known != Known::Silent && late < LATE;
            self.certain = too_soon || one || is_whole && goes_on && back > 1;
        }
        if goes_on && !is_whole && !self.certain {
            // Something else: an answer.
            (self.open, self.back) = (false, 0);
            self.know(Known::Silent);
            return Verdict { drop: 0, release: withheld };
        }
        self.back = back;
        self.open = !goes_on;
        if self.certain {
            self.whole(late);
            return Verdict { drop: same, release: 0 };
        }
        if self.known == Known::Echoes && !self.passed && !self.doubted && late <= self.latest * 2 + LATE {
            // Once more like this, and it is an answer.
            self.doubted = is_whole && self.watched;
            return Verdict { drop: same, release: 0 };
        }
        self.passed = true;
        if is_whole {
            self.know(if self.watched { Known::Silent } else { Known::Nothing });
        }
        Verdict { drop: 0, release: withheld }
    }

    /// The telegram's characters that came earlier and were taken for echo.
    pub(crate) fn released(&self, count: usize) -> &[u8] {
        self.sent.get(..count).unwrap_or(&[])
    }

    fn same(&self, bytes: &[u8]) -> usize {
        let rest = self.sent.get(self.back..).unwrap_or(&[]);
        rest.iter().zip(bytes).take_while(|(sent, came)| sent == came).count()
    }

    fn whole(&mut self, late: Span) {
        if self.certain && self.back == self.sent.len() {
            self.know(Known::Echoes);
            self.latest = self.latest.max(late);
            self.doubted = false;
        }
    }

    fn know(&mut self, known: Known) {
        let before = std::mem::replace(&mut self.known, known);
        if (before == Known::Echoes) != (known == Known::Echoes) {
            self.news = Some(known == Known::Echoes);
            (self.latest, self.doubted) = (Span::ZERO, false);
        }
    }
}

/// How many characters of a telegram are handed over next, of those left: all but the last ones, then a few at a time,
/// the last one alone.
pub(crate) const fn part(left: usize) -> usize {
    match left {
        0..=3 => 1,
        4..=SLOW => 2,
        _ => left + 2 - SLOW,
    }
}

//! Where telegrams begin and end in a stream of characters. Without time: the machine handles the silence that ends a
//! telegram. [S0 "STX/ETX"], [S0 "Number of start flags"], [S0 "Number of end flags"]

use crate::output::Flags;

/// The meaning of a character, or of one held back before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Outside a telegram: discarded.
    Noise(u8),
    /// A telegram begins; an open one is lost.
    Begin,
    /// A character of user data.
    Data(u8),
    /// The telegram is complete.
    End,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// The start characters are awaited.
    Hunt,
    /// Between start and end. Without start characters also before the first character.
    Inside,
    /// The telegram is lost; its end, or the start of another, is awaited.
    Skip,
}

/// Finds telegrams in a stream.
///
/// The first of two start or end characters is held back until the next character shows its meaning. "All the
/// characters between STX and ETX" are user data [S0 "STX/ETX"]; a start within a telegram means that its end was lost:
/// the procedure is for characters 20h..7Fh, so a start cannot be user data.
#[derive(Clone, Debug)]
pub struct Decoder {
    start: Flags,
    end: Flags,
    state: State,
    held: Option<u8>,
}

impl Decoder {
    /// Before the first character.
    pub fn new(start: Flags, end: Flags) -> Self {
        Self { start, end, state: Self::rest(start), held: None }
    }

    /// The state between telegrams: a telegram begins with its start characters, or with any character.
    fn rest(start: Flags) -> State {
        if start.as_slice().is_empty() { State::Inside } else { State::Hunt }
    }

    /// Whether a character is held back.
    pub fn holds(&self) -> bool {
        self.held.is_some()
    }

    /// Whether a telegram is being skipped.
    pub fn skips(&self) -> bool {
        self.state == State::Skip
    }

    /// Takes a character; `each` gets at most two steps.
    pub fn feed(&mut self, byte: u8, each: &mut dyn FnMut(&mut Self, Step)) {
        if let Some(first) = self.held.take() {
            let pair = [first, byte];
            if self.state != State::Hunt && self.end.as_slice() == pair {
                return self.ended(each);
            }
            if self.start.as_slice() == pair {
                return self.begun(each);
            }
            self.ordinary(first, each);
        }
        let within = self.state != State::Hunt;
        match (self.start.as_slice(), self.end.as_slice()) {
            // Start and end may be the same characters: within a telegram they are the end.
            (_, [end]) if within && byte == *end => self.ended(each),
            (_, [first, _]) if within && byte == *first => self.held = Some(byte),
            ([start], _) if byte == *start => self.begun(each),
            ([first, _], _) if byte == *first => self.held = Some(byte),
            _ => self.ordinary(byte, each),
        }
    }

    /// The line has been silent: a character held back is an ordinary one.
    pub fn flush(&mut self, each: &mut dyn FnMut(&mut Self, Step)) {
        if let Some(first) = self.held.take() {
            self.ordinary(first, each);
        }
    }

    /// The telegram is lost: nothing more of it is reported.
    pub fn skip(&mut self) {
        self.state = State::Skip;
        self.held = None;
    }

    /// The next character begins something new.
    pub fn reset(&mut self) {
        self.state = Self::rest(self.start);
        self.held = None;
    }

    fn begun(&mut self, each: &mut dyn FnMut(&mut Self, Step)) {
        self.state = State::Inside;
        each(self, Step::Begin);
    }

    fn ended(&mut self, each: &mut dyn FnMut(&mut Self, Step)) {
        let inside = self.state == State::Inside;
        self.reset();
        if inside {
            each(self, Step::End);
        }
    }

    fn ordinary(&mut self, byte: u8, each: &mut dyn FnMut(&mut Self, Step)) {
        match self.state {
            State::Hunt => each(self, Step::Noise(byte)),
            State::Inside => each(self, Step::Data(byte)),
            State::Skip => {}
        }
    }
}

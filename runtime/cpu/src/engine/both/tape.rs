//! What an engine asks of the outside and what it is answered: recorded, then played back.

use super::difference::{Difference, What};
use super::question::Question;
use super::state::{Marks, Rest, State, Writes};
use crate::Abort;
use crate::context::Context;
use crate::engine::plan::Caller;
use crate::machine::Machine;
use crate::modules::{IoError, Modules};

/// What it is answered.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Answer {
    Done(Result<(), Abort>),
    Value(Result<Option<u32>, Abort>),
    Result(Result<bool, Abort>),
    Bytes(Result<[u8; 4], IoError>),
}

impl Answer {
    pub(crate) fn done(self) -> Result<(), Abort> {
        if let Answer::Done(done) = self { done } else { Err(Abort) }
    }

    pub(crate) fn value(self) -> Result<Option<u32>, Abort> {
        if let Answer::Value(value) = self { value } else { Err(Abort) }
    }

    pub(crate) fn result(self) -> Result<bool, Abort> {
        if let Answer::Result(result) = self { result } else { Err(Abort) }
    }

    fn bytes(self) -> Result<[u8; 4], IoError> {
        if let Answer::Bytes(bytes) = self { bytes } else { Err(IoError::NoModule) }
    }
}

/// A question and its answer.
struct Event {
    question: Question,
    /// Statements when it was asked.
    pending: u32,
    /// What the engine has written since the previous answer.
    own: Writes,
    /// What the outside has written.
    outside: Writes,
    /// The rest of the state after the answer, if more than the hot state has changed.
    rest: Option<Box<Rest>>,
    hot: crate::engine::hot::Values,
    answer: Answer,
}

/// A run of an organization block on record.
pub(crate) struct Tape {
    events: Vec<Event>,
    /// What the engine has written after the last answer.
    tail: Writes,
    /// The arena as of the last recorded event.
    shadow: Box<[u8]>,
    /// Events played back; `None`: it records.
    played: Option<usize>,
    difference: Option<Difference>,
}

impl Context<'_> {
    /// Asks the outside, or the tape.
    #[inline]
    pub(crate) fn outside(&mut self, question: Question, ask: impl FnOnce(&mut Self) -> Answer) -> Answer {
        let Some(tape) = self.machine.tape.take() else { return ask(self) };
        match tape.asked(self.machine) {
            Ok(asked) => {
                let answer = ask(self);
                asked.answered(question, answer, self.machine)
            }
            Err(tape) => tape.play(question, self.machine),
        }
    }
}

impl Machine {
    /// Peripheral bytes that a statement reads while two engines are compared.
    #[cold]
    #[inline(never)]
    pub(crate) fn read_on_tape(&mut self, tape: Box<Tape>, address: u32, into: &mut [u8]) -> Result<(), IoError> {
        let len = into.len();
        let bytes = self.io(tape, Question::Read(address, len as u8), |modules| {
            let mut bytes = [0; 4];
            modules.read(address, bytes.get_mut(..len).ok_or(IoError::NoModule)?).map(|()| bytes)
        })?;
        into.copy_from_slice(bytes.get(..len).ok_or(IoError::NoModule)?);
        Ok(())
    }

    /// Peripheral bytes that a statement writes while two engines are compared.
    #[cold]
    #[inline(never)]
    pub(crate) fn write_on_tape(&mut self, tape: Box<Tape>, address: u32, from: &[u8]) -> Result<(), IoError> {
        let mut bytes = [0; 4];
        bytes.get_mut(..from.len()).ok_or(IoError::NoModule)?.copy_from_slice(from);
        let question = Question::Write(address, from.len() as u8, bytes);
        self.io(tape, question, |modules| modules.write(address, from).map(|()| bytes)).map(|_| ())
    }

    fn io(
        &mut self,
        tape: Box<Tape>,
        question: Question,
        ask: impl FnOnce(&mut Modules) -> Result<[u8; 4], IoError>,
    ) -> Result<[u8; 4], IoError> {
        let answer = match tape.asked(self) {
            Ok(asked) => {
                let answer = Answer::Bytes(ask(&mut self.modules));
                asked.answered(question, answer, self)
            }
            Err(tape) => tape.play(question, self),
        };
        answer.bytes()
    }
}

/// A question on its way: what is recorded before it is answered.
struct Asked {
    tape: Box<Tape>,
    own: Writes,
    pending: u32,
    marks: Marks,
}

impl Asked {
    /// Puts the answer on record, and the tape back.
    fn answered(self, question: Question, answer: Answer, m: &mut Machine) -> Answer {
        let Self { mut tape, own, pending, marks } = self;
        let outside = Writes::since(&mut tape.shadow, &m.memory.bytes);
        let rest = (!marks.are_still(m)).then(|| Box::new(Rest::of(m)));
        tape.events.push(Event { question, pending, own, outside, rest, hot: m.hot.values(), answer });
        m.tape = Some(tape);
        answer
    }
}

impl Tape {
    pub(super) fn recording(before: &State) -> Self {
        let shadow = before.arena.clone();
        Self { events: Vec::new(), tail: Writes::default(), shadow, played: None, difference: None }
    }

    /// Whether it plays back; otherwise it records.
    pub(crate) const fn plays(&self) -> bool {
        self.played.is_some()
    }

    /// A question is asked; `Err` gives the tape back, because it plays.
    fn asked(mut self: Box<Self>, m: &Machine) -> Result<Asked, Box<Self>> {
        if self.played.is_some() {
            return Err(self);
        }
        let own = Writes::since(&mut self.shadow, &m.memory.bytes);
        Ok(Asked { tape: self, own, pending: m.hot.pending, marks: Marks::of(m) })
    }

    /// The run is over.
    pub(super) fn recorded(&mut self, m: &Machine) {
        self.tail = Writes::since(&mut self.shadow, &m.memory.bytes);
    }

    /// Plays from the beginning, for an engine that starts from `before`.
    pub(super) fn play_back(&mut self, before: &State, m: &mut Machine) {
        self.shadow.copy_from_slice(&before.arena);
        self.played = Some(0);
        self.until_next(m);
    }

    /// Makes the next recorded safe point the next one that looks: nothing else makes the engine look earlier.
    fn until_next(&self, m: &mut Machine) {
        m.hot.look_after = match self.events.get(self.played.unwrap_or(0)) {
            Some(Event { question: Question::SafePoint(_), pending, .. }) => *pending,
            _ => u32::MAX,
        };
    }

    fn differs(&mut self, what: What, to: Option<Caller>) {
        let events = self.played.unwrap_or(0);
        let from = events.checked_sub(1).and_then(|last| self.events.get(last)).and_then(|event| event.question.at());
        // Peripheral accesses do not know their statement; the next question on record does.
        let to = to.or_else(|| self.events.get(events..)?.iter().find_map(|event| event.question.at()));
        self.difference.get_or_insert(Difference { what, from, to, events });
    }

    /// The recorded answer, if the engine asks the same question in the same state.
    fn play(mut self: Box<Self>, question: Question, m: &mut Machine) -> Answer {
        let answer = self.played_back(question, m);
        m.tape = Some(self);
        answer
    }

    fn played_back(&mut self, question: Question, m: &mut Machine) -> Answer {
        let played = self.played.unwrap_or(0);
        let at = question.at();
        // Another thread has set the flag since; in the recording it was not set.
        if matches!(question, Question::SafePoint(_)) && m.hot.pending < m.hot.look_after && self.difference.is_none() {
            return Answer::Done(Ok(()));
        }
        // At a peripheral access the count need not be in memory, and the access leaves it as it is.
        let counted = !matches!(question, Question::Read(..) | Question::Write(..));
        let executed = m.hot.pending;
        let asked = self.events.get(played).map(|event| (event.question, event.pending));
        match asked {
            _ if self.difference.is_some() => {}
            Some((recorded, _)) if recorded != question => {
                self.differs(What::Question(Some(recorded), Some(question)), at);
            }
            None => self.differs(What::Question(None, Some(question)), at),
            Some((_, pending)) if counted && pending != executed => {
                self.differs(What::Statements(pending, executed), at);
            }
            Some(_) => {}
        }
        if self.difference.is_none()
            && let Some(event) = self.events.get(played)
        {
            event.own.apply(&mut self.shadow);
            if let Some(byte) = unequal(&self.shadow, &m.memory.bytes) {
                let what = What::Byte(byte, self.shadow[byte], m.memory.bytes[byte]);
                self.differs(what, at);
            }
        }
        let Some(event) = self.events.get(played).filter(|_| self.difference.is_none()) else {
            return match question {
                Question::SafePoint(_) => Answer::Done(Err(Abort)),
                Question::Fault(..) => Answer::Value(Err(Abort)),
                Question::Native(..) => Answer::Result(Err(Abort)),
                Question::Read(..) | Question::Write(..) => Answer::Bytes(Err(IoError::NoModule)),
            };
        };
        event.outside.apply(&mut self.shadow);
        event.outside.apply(&mut m.memory.bytes);
        if let Some(rest) = &event.rest {
            rest.restore(m);
        }
        m.hot.set_values(&event.hot);
        if !counted {
            m.hot.pending = executed;
        }
        // OB 121 and OB 122 have taken the registers.
        m.interrupted = None;
        let answer = event.answer;
        self.played = Some(played + 1);
        self.until_next(m);
        answer
    }

    /// The other engine's run is over; what differs, if anything.
    pub(super) fn ended(
        mut self,
        m: &Machine,
        real: &State,
        reference: Result<(), Abort>,
        other: Result<(), Abort>,
    ) -> Option<Difference> {
        if self.difference.is_some() {
            return self.difference;
        }
        let next = self.events.get(self.played.unwrap_or(0)).map(|event| event.question);
        let to = next.and_then(|question| question.at());
        if next.is_some() {
            self.differs(What::Question(next, None), to);
        }
        self.tail.apply(&mut self.shadow);
        if reference != other {
            self.differs(What::End { reference: reference.is_ok(), other: other.is_ok() }, to);
        }
        let (hot, values) = (real.rest.hot, m.hot.values());
        if hot.pending != values.pending {
            self.differs(What::Statements(hot.pending, values.pending), to);
        }
        if let Some(byte) = unequal(&self.shadow, &m.memory.bytes) {
            let what = What::Byte(byte, self.shadow[byte], m.memory.bytes[byte]);
            self.differs(what, to);
        }
        if let Some(number) = real.rest.timers.iter().zip(&m.timers).position(|(a, b)| a != b) {
            self.differs(What::Timer(number), to);
        }
        if let Some(number) = real.rest.counters.iter().zip(&m.counters).position(|(a, b)| a != b) {
            self.differs(What::Counter(number), to);
        }
        if reference.is_ok() && (hot.local_top, hot.depth) != (values.local_top, values.depth) {
            self.differs(What::Stacks, to);
        }
        self.difference
    }
}

/// The first byte that differs.
fn unequal(a: &[u8], b: &[u8]) -> Option<usize> {
    if a == b { None } else { a.iter().zip(b).position(|(a, b)| a != b) }
}

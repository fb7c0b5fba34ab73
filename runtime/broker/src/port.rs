//! Questions for the access port of the CPU: asked in the order they came, answered in that order.

use std::collections::VecDeque;

use ob1_access::door::{Answer, Refusal, Ticket};
use ob1_cpu::{AccessClient, Answer as PortAnswer, Ask as PortAsk, Request};
use ob1_time::Instant;

/// Who has asked, and so gets the answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Asker {
    pub(crate) link: usize,
    pub(crate) client: u32,
    pub(crate) ticket: Ticket,
    /// The answers are wanted as a document.
    pub(crate) document: bool,
}

/// One question of a client: it may take several of the port.
#[derive(Debug)]
struct Question {
    asker: Asker,
    asks: VecDeque<PortAsk>,
    /// The number of its first one, once posted, and how many were.
    first: u32,
    posted: u32,
    answers: Vec<PortAnswer>,
    give_up: Instant,
}

impl Question {
    fn is_whole(&self) -> bool {
        self.asks.is_empty() && self.answers.len() == self.posted as usize
    }
}

/// The broker's end of the access port, with the questions under way.
#[derive(Debug)]
pub(crate) struct Port {
    client: AccessClient,
    questions: VecDeque<Question>,
    number: u32,
}

/// A question with all its answers; none when the CPU was silent.
pub(crate) type Answered = (Asker, Result<Vec<PortAnswer>, Answer>);

impl Port {
    pub(crate) const fn new(client: AccessClient) -> Self {
        Self { client, questions: VecDeque::new(), number: 0 }
    }

    pub(crate) fn is_idle(&self) -> bool {
        self.questions.is_empty()
    }

    pub(crate) fn ask(&mut self, asker: Asker, asks: impl IntoIterator<Item = PortAsk>, give_up: Instant) {
        let asks = asks.into_iter().collect();
        self.questions.push_back(Question { asker, asks, first: 0, posted: 0, answers: Vec::new(), give_up });
    }

    /// Posts as much as there is room for, and takes what has come.
    pub(crate) fn step(&mut self) {
        while let Some(response) = self.client.take() {
            // Other answers belong to a question that was given up.
            let whose =
                self.questions.iter_mut().find(|question| response.id.wrapping_sub(question.first) < question.posted);
            if let Some(question) = whose {
                question.answers.push(response.answer);
            }
        }
        'post: for question in &mut self.questions {
            while let Some(ask) = question.asks.front() {
                if self.client.post(Request { id: self.number, ask: *ask }).is_err() {
                    break 'post;
                }
                if question.posted == 0 {
                    question.first = self.number;
                }
                question.posted += 1;
                self.number = self.number.wrapping_add(1);
                question.asks.pop_front();
            }
        }
    }

    /// The next question that is answered, or that the CPU did not answer in time. The time is the broker's watched
    /// one.
    pub(crate) fn answered(&mut self, now: Instant) -> Option<Answered> {
        let first = self.questions.front()?;
        if !first.is_whole() && now < first.give_up {
            return None;
        }
        let question = self.questions.pop_front()?;
        let whole = question.is_whole();
        Some((question.asker, if whole { Ok(question.answers) } else { Err(Answer::Refused(Refusal::Silent)) }))
    }
}

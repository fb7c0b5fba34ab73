//! Requests that wait in the CPU for a point of the cycle or for a pass, beside the others of a connection.

use std::time::Instant;

use ob1_access::door::{Answer, Ask as Question, Door, Refusal, Ticket};
use ob1_model::{DebugOrder, PassOrder, Point, PointItem, PointOrder};
use ob1_s7::codes::ItemCode;
use ob1_s7::server::{Access, Put, Reply};

use crate::cells;

/// A request that waits in the CPU.
#[derive(Debug)]
pub(crate) struct Armed {
    pub(crate) id: u64,
    pub(crate) ticket: Ticket,
    /// What is accessed; `None`: a pass, or a hold.
    access: Option<Access>,
    /// How many items that are for the CPU.
    items: usize,
    /// Requests to forget it, and when that is done.
    pub(crate) forgets: Vec<u64>,
    forget_at: Option<Instant>,
}

impl Armed {
    pub(crate) fn at((id, client): (u64, u32), point: Point, stays: bool, access: Access, door: &mut Door) -> Self {
        let items: Vec<PointItem> = match &access {
            Access::Read(addresses) => cells::pieces(addresses).into_iter().map(PointItem::Read).collect(),
            // A value that does not fit is not written.
            Access::Write(puts) => {
                puts.iter().filter_map(|put| cells::puts(put).ok()).flatten().map(PointItem::Write).collect()
            }
        };
        let count = items.len();
        let ticket = door.ask(client, Question::Point(PointOrder { point, stays, items }));
        Self { id, ticket, access: Some(access), items: count, forgets: Vec::new(), forget_at: None }
    }

    pub(crate) fn pass(whose: (u64, u32), order: PassOrder, door: &mut Door) -> Self {
        Self::without_access(whose, Question::Pass(order), door)
    }

    /// Waits until the CPU holds.
    pub(crate) fn hold(whose: (u64, u32), order: DebugOrder, door: &mut Door) -> Self {
        Self::without_access(whose, Question::Debug(order), door)
    }

    fn without_access((id, client): (u64, u32), question: Question, door: &mut Door) -> Self {
        let ticket = door.ask(client, question);
        Self { id, ticket, access: None, items: 0, forgets: Vec::new(), forget_at: None }
    }

    /// It is not wanted any more, from this time on at the latest.
    pub(crate) fn forget(&mut self, id: u64, at: Instant) {
        self.forgets.push(id);
        self.forget_at = Some(self.forget_at.map_or(at, |before| before.min(at)));
    }

    /// Has the CPU forget it when that is due: what there is of it comes at once.
    pub(crate) fn step(&mut self, client: u32, door: &mut Door, now: Instant) {
        if self.forget_at.is_some_and(|at| at <= now) {
            self.forget_at = None;
            door.ask(client, Question::Forget(self.ticket));
        }
    }

    pub(crate) const fn due(&self) -> Option<Instant> {
        self.forget_at
    }

    /// The reply; `None` if the answer is not about a point or a pass.
    pub(crate) fn reply(&self, answer: &Answer) -> Option<Reply> {
        let reply = match (answer, &self.access) {
            (Answer::Pass(pass), None) => Reply::Pass(pass.clone()),
            (Answer::Pass(_), Some(_)) => Reply::Forgotten,
            (Answer::Point(outcomes), Some(_)) if outcomes.len() < self.items => Reply::Forgotten,
            (Answer::Point(outcomes), Some(Access::Read(addresses))) => {
                let mut outcomes = outcomes.iter().map(|one| one.as_deref().map_err(|why| *why));
                Reply::Values(cells::values(addresses, &mut || outcomes.next().unwrap_or(Err(Refusal::NotThere))))
            }
            (Answer::Point(outcomes), Some(Access::Write(puts))) => {
                let mut outcomes = outcomes.iter();
                let code = |put: &Put| match cells::puts(put) {
                    Ok(entries) => {
                        let own = outcomes.by_ref().take(entries.len());
                        own.filter_map(|one| one.as_ref().err()).last().map_or(ItemCode::DONE, |why| cells::code(*why))
                    }
                    Err(why) => why,
                };
                Reply::Written(puts.iter().map(code).collect())
            }
            _ => return None,
        };
        Some(reply)
    }
}

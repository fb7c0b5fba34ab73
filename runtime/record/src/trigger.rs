//! What begins a part of a recording.

use crate::{Event, Expression, Row};
use ob1_access::Item;

/// What begins a part.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Trigger {
    /// The first row.
    #[default]
    AtOnce,
    /// A condition that becomes true (`rising`), or false.
    Edge(Expression, bool),
    /// A late scan.
    Late,
    /// An entry of the diagnostic buffer: this one, or any.
    Diagnosis(Option<u16>),
    /// An order of a CP that ended with an error.
    OrderError,
}

const FORMS: &str = "write a condition with `rising` or `falling` (\"Motor rising\"), `late`, `diag`, `diag 4562h` or \
                     `order-error`";

impl Trigger {
    /// Reads a trigger; `find` gives the place of a signal by its name.
    ///
    /// # Errors
    /// What is wrong with it, in one sentence.
    pub fn parse(text: &str, find: &mut dyn FnMut(&str) -> Result<usize, String>) -> Result<Self, String> {
        let trimmed = text.trim();
        let mut words = trimmed.split_whitespace();
        match (words.next(), words.next(), words.next()) {
            (None, ..) => return Ok(Self::AtOnce),
            (Some("late"), None, _) => return Ok(Self::Late),
            (Some("order-error"), None, _) => return Ok(Self::OrderError),
            (Some("diag"), None, _) => return Ok(Self::Diagnosis(None)),
            (Some("diag"), Some(number), None) => {
                let digits = number.trim_start_matches("16#").trim_end_matches(['h', 'H']);
                let event = u16::from_str_radix(digits, 16).ok().filter(|_| digits.len() <= 4);
                let event =
                    event.ok_or_else(|| format!("\"{number}\" is not the number of an event, such as 4562h"))?;
                return Ok(Self::Diagnosis(Some(event)));
            }
            _ => {}
        }
        for (word, rising) in [("rising", true), ("falling", false)] {
            let condition = trimmed.strip_suffix(word).filter(|rest| rest.ends_with([' ', ')', '"']));
            if let Some(condition) = condition {
                return Ok(Self::Edge(Expression::parse(condition, find)?, rising));
            }
        }
        Err(format!("\"{trimmed}\" does not say when it fires; {FORMS}"))
    }
}

/// A trigger with what it has seen.
#[derive(Debug)]
pub(crate) struct Watching {
    trigger: Trigger,
    before: Option<bool>,
    /// An event has come: why.
    pending: Option<String>,
}

impl Watching {
    pub(crate) const fn new(trigger: Trigger) -> Self {
        Self { trigger, before: None, pending: None }
    }

    /// An event has come; it may fire with the next row.
    pub(crate) fn event(&mut self, event: &Event) {
        let why = match (&self.trigger, event) {
            (Trigger::Diagnosis(wanted), Event::Diagnosis { number, .. })
                if wanted.is_none_or(|wanted| format!("{wanted:04X}h") == *number) =>
            {
                format!("diag {number}")
            }
            (Trigger::OrderError, Event::Order { module, status, .. }) if *status != 0 => {
                format!("order-error: {module}, {status:04X}h")
            }
            _ => return,
        };
        self.pending.get_or_insert(why);
    }

    /// Whether it fires with this row: why. An edge needs a row before.
    pub(crate) fn row(&mut self, row: &Row, items: &[Item]) -> Option<String> {
        match &self.trigger {
            Trigger::AtOnce => Some("at once".into()),
            Trigger::Edge(expression, rising) => {
                let now = expression.holds(items, &|at| row.bits(at)) == *rising;
                let before = self.before.replace(now);
                let word = if *rising { "rising" } else { "falling" };
                (now && before == Some(false)).then(|| word.into())
            }
            // The row after it holds its record.
            Trigger::Late => {
                let late = row.scan.flags.is_late() && self.before.replace(true) != Some(true);
                if !row.scan.flags.is_late() {
                    self.before = Some(false);
                }
                late.then(|| format!("late: scan {}", row.scan.number))
            }
            Trigger::Diagnosis(_) | Trigger::OrderError => self.pending.take(),
        }
    }
}

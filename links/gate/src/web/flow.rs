//! Passes through blocks for all pages that show them: one job of program status at a time for the whole gate, and none
//! for a block that nobody shows.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::{Rc, Weak};
use std::time::Duration;

use crate::shared::{Client, Trouble, Who};
use ob1_access::Right;
use ob1_access::door::{Answer, Ask};
use serde_json::{Value, json};
use tokio::sync::{Semaphore, watch};
use tokio::task::JoinSet;
use tokio::time::sleep;

use super::Page;
use super::ladder::Shown;

/// Time between two passes.
const EVERY: Duration = Duration::from_millis(100);
/// How long a pass is waited for, in nanoseconds: others wait for their turn.
const WAIT: u64 = 1_000_000_000;
/// After something that does not go away by itself.
const AGAIN: Duration = Duration::from_secs(2);

/// What is watched now.
#[derive(Debug)]
pub(super) struct Flows {
    watched: RefCell<BTreeMap<Shown, Weak<Watched>>>,
    /// One pass at a time: a programming device gets the other place.
    turn: Semaphore,
}

impl Default for Flows {
    fn default() -> Self {
        Self { watched: RefCell::default(), turn: Semaphore::new(1) }
    }
}

/// A block that is watched as long as this lives.
#[derive(Debug)]
pub(super) struct Watched {
    newest: watch::Receiver<String>,
    /// With its client the job ends.
    _task: JoinSet<()>,
}

/// One page's share of it.
#[derive(Debug)]
pub(super) struct Sight {
    newest: watch::Receiver<String>,
    _watched: Rc<Watched>,
}

impl Sight {
    /// The next pass that shows something else.
    pub(super) async fn next(&mut self) -> Option<String> {
        self.newest.changed().await.ok()?;
        Some(self.newest.borrow_and_update().clone())
    }
}

impl Page {
    /// Who asks for passes, and for what is forced: nobody of the users.
    pub(super) fn nobody(&self) -> Client {
        self.station.client(Who { user: "-".into(), address: "-".into(), right: Right::Read })
    }

    /// Watches what is shown; pages that show the same share it.
    pub(super) fn watch(self: &Rc<Self>, shown: Shown) -> Sight {
        let mut all = self.flows.watched.borrow_mut();
        all.retain(|_, watched| watched.strong_count() > 0);
        let watched = all.get(&shown).and_then(Weak::upgrade).unwrap_or_else(|| {
            let (to, newest) = watch::channel(String::new());
            let mut task = JoinSet::new();
            task.spawn_local(run(Rc::clone(self), shown.clone(), to));
            let watched = Rc::new(Watched { newest, _task: task });
            all.insert(shown, Rc::downgrade(&watched));
            watched
        });
        let mut newest = watched.newest.clone();
        // Whoever comes later gets the newest at once.
        newest.mark_changed();
        Sight { newest, _watched: watched }
    }

    /// One pass, in its turn.
    pub(super) async fn pass(&self, client: &Client, order: ob1_model::PassOrder) -> Result<ob1_model::Pass, Trouble> {
        let _turn = self.flows.turn.acquire().await.map_err(|_| Trouble::Gone)?;
        match client.ask(Ask::Pass(order)).await? {
            Answer::Pass(pass) => Ok(pass),
            _ => Err(Trouble::Program("the broker sends another answer".into())),
        }
    }
}

async fn run(page: Rc<Page>, shown: Shown, to: watch::Sender<String>) {
    let client = page.nobody();
    loop {
        let (told, pause) = match one(&page, &client, &shown).await {
            Ok(told) if told["outcome"] == "whole" => (told, EVERY),
            Ok(told) => (told, AGAIN / 4),
            Err(why) => (json!({ "outcome": "trouble", "text": why.to_string() }), AGAIN),
        };
        let text = told.to_string();
        to.send_if_modified(|before| {
            let is_new = *before != text;
            if is_new {
                *before = text;
            }
            is_new
        });
        sleep(pause).await;
    }
}

async fn one(page: &Page, client: &Client, shown: &Shown) -> Result<Value, Trouble> {
    let insight = page.insight.get(&page.station).await?;
    let Some(order) = shown.order(&insight, WAIT) else { return Ok(json!({ "outcome": "changed" })) };
    let pass = page.pass(client, order).await?;
    Ok(shown.told(&insight, &order, &pass))
}

//! The task that owns the door: it alone reads the window, and uses the socket.

use std::collections::{BTreeMap, VecDeque};
use std::future::pending;
use std::os::fd::OwnedFd;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use ob1_access::door::{Answer, Ask, Door, DoorError, Event, News, NotYet, Reading, Refusal, Ticket};
use ob1_access::{Piece, Put};
use tokio::io::unix::AsyncFd;
use tokio::sync::{broadcast, mpsc, oneshot, watch};
use tokio::time::{Instant, MissedTickBehavior, interval, sleep_until};

use crate::shared::Trouble;

/// Time between two signs of life.
const BEAT: Duration = Duration::from_millis(200);
const TICK: Duration = Duration::from_secs(1);
/// Time to the next attempt when the scan was faster than a read.
const BUSY: Duration = Duration::from_millis(1);
/// Time to the next attempt when a read does not fit the share: it may fit when others watch less.
const NO_ROOM: Duration = Duration::from_secs(1);
/// A piece watched for the first time is available one cycle later. After this time, which is more than two cycles, the
/// wait ends.
const SILENT: Duration = Duration::from_secs(4);
/// Number of events kept for late listeners; beyond that a slow listener loses some.
pub(crate) const EVENTS: usize = 1024;

/// The newest result of a watch.
pub(crate) type Newest = Option<Result<Arc<Reading>, Trouble>>;

/// A request of a handle.
pub(crate) enum Order {
    Watch { pieces: Vec<Piece>, period: Duration, to: watch::Sender<Newest> },
    Read { pieces: Vec<Piece>, to: oneshot::Sender<Result<Reading, Trouble>> },
    Write { client: u32, puts: Vec<Put>, to: oneshot::Sender<Result<u64, Trouble>> },
    Ask { client: u32, ask: Ask, to: oneshot::Sender<Result<Answer, Trouble>> },
    Gone(u32),
}

/// The events so far, and the channel of the next ones.
#[derive(Debug)]
pub(crate) struct Events {
    kept: Mutex<VecDeque<Arc<Event>>>,
    to: broadcast::Sender<Arc<Event>>,
}

impl Events {
    pub(crate) fn new() -> Self {
        Self { kept: Mutex::default(), to: broadcast::channel(EVENTS).0 }
    }

    fn push(&self, event: Event) {
        let event = Arc::new(event);
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if kept.len() == EVENTS {
            kept.pop_front();
        }
        kept.push_back(Arc::clone(&event));
        // It is possible that nobody listens. Sent with the lock held, so that a listener gets each event once.
        let _ = self.to.send(event);
    }

    /// The events with a higher number, and those to come.
    pub(crate) fn after(&self, after: u64) -> (Vec<Arc<Event>>, broadcast::Receiver<Arc<Event>>) {
        let kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let known = kept.back().is_none_or(|newest| after <= newest.number);
        // A listener with a number from another run of the station starts from the beginning.
        let after = if known { after } else { 0 };
        (kept.iter().filter(|event| event.number > after).cloned().collect(), self.to.subscribe())
    }
}

struct Watched {
    pieces: Vec<Piece>,
    period: Duration,
    due: Instant,
    /// Requested, but not available yet.
    coming: bool,
    to: watch::Sender<Newest>,
}

struct Once {
    pieces: Vec<Piece>,
    give_up: Instant,
    due: Instant,
    to: oneshot::Sender<Result<Reading, Trouble>>,
}

pub(crate) struct Pump {
    door: Door,
    fd: AsyncFd<OwnedFd>,
    orders: mpsc::UnboundedReceiver<Order>,
    events: Arc<Events>,
    watched: Vec<Watched>,
    once: Vec<Once>,
    writes: BTreeMap<Ticket, oneshot::Sender<Result<u64, Trouble>>>,
    asks: BTreeMap<Ticket, oneshot::Sender<Result<Answer, Trouble>>>,
    patience: Duration,
}

impl Pump {
    /// The pump of a door that has been welcomed. Call it within a runtime.
    #[expect(deprecated, reason = "what replaces it is unsafe; an `OwnedFd` stays open as long as it is owned")]
    pub(crate) fn new(
        door: Door,
        orders: mpsc::UnboundedReceiver<Order>,
        events: Arc<Events>,
    ) -> Result<Self, DoorError> {
        let fd = AsyncFd::new(door.fd().try_clone_to_owned()?)?;
        let cycle = door.welcome().map_or(0, |welcome| welcome.min_cycle);
        Ok(Self {
            door,
            fd,
            orders,
            events,
            watched: Vec::new(),
            once: Vec::new(),
            writes: BTreeMap::new(),
            asks: BTreeMap::new(),
            patience: SILENT + Duration::from_nanos(cycle.saturating_mul(2)),
        })
    }

    /// Runs until the door is closed or the last handle is dropped.
    pub(crate) async fn run(mut self) -> DoorError {
        let mut beat = interval(BEAT);
        let mut tick = interval(TICK);
        beat.set_missed_tick_behavior(MissedTickBehavior::Delay);
        tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
        // Everything since the station started.
        self.door.ask(0, Ask::Events { after: 0 });
        loop {
            if let Err(error) = self.turn() {
                return error;
            }
            let due = self.due();
            let wake = async {
                match due {
                    Some(due) => sleep_until(due).await,
                    None => pending().await,
                }
            };
            let writable = async { if self.door.wants_write() { self.fd.writable().await } else { pending().await } };
            tokio::select! {
                ready = self.fd.readable() => match ready {
                    Ok(mut ready) => ready.clear_ready(),
                    Err(error) => return error.into(),
                },
                ready = writable => match ready {
                    Ok(mut ready) => ready.clear_ready(),
                    Err(error) => return error.into(),
                },
                order = self.orders.recv() => match order {
                    Some(order) => self.obey(order),
                    None => return DoorError::Closed,
                },
                _ = beat.tick() => self.door.beat(),
                _ = tick.tick() => self.door.tick(),
                () = wake => {}
            }
            while let Ok(order) = self.orders.try_recv() {
                self.obey(order);
            }
        }
    }

    /// Does everything that is possible now.
    fn turn(&mut self) -> Result<(), DoorError> {
        self.door.pump()?;
        let mut watching = false;
        while let Some(news) = self.door.take_news() {
            match news {
                News::Watching => watching = true,
                News::Event(event) => self.events.push(event),
                // The gate has not logged on.
                News::Alarm { .. } => {}
                News::Written { ticket, outcome, .. } => {
                    if let Some(to) = self.writes.remove(&ticket) {
                        let _ = to.send(outcome.map_err(Trouble::from));
                    }
                }
                News::Answer { ticket, answer, .. } => {
                    let Some(to) = self.asks.remove(&ticket) else { continue };
                    let _ = to.send(match answer {
                        Answer::Refused(why) => Err(why.into()),
                        answer => Ok(answer),
                    });
                }
            }
        }
        self.look(watching);
        // Requests made in between are sent before the wait.
        self.door.pump()
    }

    fn due(&self) -> Option<Instant> {
        let watched = self.watched.iter().filter(|watched| !watched.coming).map(|watched| watched.due);
        watched.chain(self.once.iter().map(|once| once.due)).min()
    }

    /// Reads what is due; with `watching` also the pieces waited for.
    fn look(&mut self, watching: bool) {
        let now = Instant::now();
        self.watched.retain(|watched| !watched.to.is_closed());
        for watched in &mut self.watched {
            if now < watched.due || (watched.coming && !watching) {
                continue;
            }
            let mut reading = Reading::new();
            watched.coming = false;
            match self.door.read(&watched.pieces, &mut reading) {
                Ok(()) => {
                    watched.to.send_replace(Some(Ok(Arc::new(reading))));
                    // A late reader does not make up for missed readings.
                    watched.due = (watched.due + watched.period).max(now);
                }
                Err(NotYet::Coming) => watched.coming = true,
                Err(NotYet::Busy) => watched.due = now + BUSY,
                Err(NotYet::TooMuch) => {
                    watched.to.send_replace(Some(Err(Trouble::TooMuch)));
                    watched.due = now + NO_ROOM;
                }
            }
        }
        for mut once in std::mem::take(&mut self.once) {
            let mut reading = Reading::new();
            let outcome = match self.door.read(&once.pieces, &mut reading) {
                Ok(()) => Ok(reading),
                Err(NotYet::TooMuch) => Err(Trouble::TooMuch),
                Err(_) if now >= once.give_up => Err(Refusal::Silent.into()),
                Err(not_yet) => {
                    once.due = if not_yet == NotYet::Busy { now + BUSY } else { once.give_up };
                    self.once.push(once);
                    continue;
                }
            };
            let _ = once.to.send(outcome);
        }
    }

    fn obey(&mut self, order: Order) {
        let now = Instant::now();
        match order {
            Order::Watch { pieces, period, to } => {
                self.watched.push(Watched { pieces, period, due: now, coming: false, to });
            }
            Order::Read { pieces, to } => {
                self.once.push(Once { pieces, give_up: now + self.patience, due: now, to });
            }
            Order::Write { client, puts, to } => match self.door.write(client, puts) {
                Ok(ticket) => drop(self.writes.insert(ticket, to)),
                Err(_) => drop(to.send(Err(Trouble::Group))),
            },
            Order::Ask { client, ask, to } => {
                let ticket = self.door.ask(client, ask);
                self.asks.insert(ticket, to);
            }
            Order::Gone(client) => self.door.client_gone(client),
        }
    }
}

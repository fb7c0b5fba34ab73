//! The station for tasks: a handle that can be cloned, and clients with the right of their user.

use std::collections::BTreeMap;
use std::future::Future;
use std::net::TcpListener;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use ob1_access::alarms::{AlarmTexts, StandingAlarm, standing};
use ob1_access::door::{Answer, Ask, Document, Door, DoorError, Event, OUTSTANDING, Reading, Welcome};
use ob1_access::{Piece, Put, Right};
use ob1_model::{AlarmOrder, AlarmQuery};
use tokio::sync::{Mutex, OnceCell, Semaphore, broadcast, mpsc, oneshot, watch};
use tokio::time::Instant;

use crate::shared::pump::{Events, Newest, Order, Pump};
use crate::shared::{Audit, Catalog, Memory, Tls, Trouble, Users};

/// Shortest period of a watch.
const SHORTEST: Duration = Duration::from_millis(10);
/// Maximum of concurrent reads of all tasks that wait for their first snapshot.
const READS: usize = 256;
/// Documents have a client of their own at the broker, so that other questions do not block them; 0 is the link.
const DOCUMENTS: u32 = 0;

/// One link of the station. Clones are the same link.
#[derive(Clone, Debug)]
pub(crate) struct Station(Arc<Shared>);

/// A document, and when it was fetched.
type Made = (Instant, Arc<[u8]>);

#[derive(Debug)]
struct Shared {
    welcome: Welcome,
    /// The maximum right of the link's clients: the broker's, or less if the process is not confined.
    ceiling: Right,
    orders: mpsc::UnboundedSender<Order>,
    events: Arc<Events>,
    catalog: OnceCell<Arc<Catalog>>,
    documents: Mutex<BTreeMap<Document, Made>>,
    alarm_texts: OnceCell<AlarmTexts>,
    reads: Semaphore,
    clients: AtomicU32,
    audit: Audit,
}

/// A link of the station with everything its protocol needs, handed to it when the process has confined itself.
#[derive(Debug)]
pub(crate) struct Link {
    /// The way to the CPU; the link's name comes with it.
    pub(crate) station: Station,
    /// Its sockets: bound, listening, non-blocking.
    pub(crate) listeners: Vec<TcpListener>,
    /// For each of them one that only this process connects to, for a link that needs it.
    pub(crate) inner: Vec<TcpListener>,
    /// Its users, if any.
    pub(crate) users: Option<Users>,
    /// Its certificate, if any.
    pub(crate) tls: Option<Tls>,
    /// A writable folder of the gate, for kinds of links that need one.
    pub(crate) state: Option<PathBuf>,
    /// The memory of this process.
    pub(crate) memory: Memory,
}

/// The user behind an action.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Who {
    /// The name of the user; `-` if the link has no users.
    pub(crate) user: String,
    /// The client's address, for the audit log.
    pub(crate) address: String,
    /// The user's right, limited by that of the link.
    pub(crate) right: Right,
}

impl Station {
    /// Makes a station of a door that has been welcomed, within a runtime: the handle, and the task that serves it. The
    /// task ends when the door is closed or no handle is left.
    ///
    /// # Errors
    /// The door has not been welcomed, or the system cannot wait for its descriptor.
    pub(crate) fn new(
        door: Door,
        ceiling: Right,
        audit: Audit,
    ) -> Result<(Self, impl Future<Output = DoorError> + Send + use<>), DoorError> {
        let welcome = door.welcome().cloned().ok_or(DoorError::Version)?;
        let (orders, wanted) = mpsc::unbounded_channel();
        let events = Arc::new(Events::new());
        let pump = Pump::new(door, wanted, Arc::clone(&events))?;
        let shared = Shared {
            ceiling: ceiling.min(welcome.rights),
            welcome,
            orders,
            events,
            catalog: OnceCell::new(),
            documents: Mutex::default(),
            alarm_texts: OnceCell::new(),
            reads: Semaphore::new(READS),
            clients: AtomicU32::new(DOCUMENTS + 1),
            audit,
        };
        Ok((Self(Arc::new(shared)), pump.run()))
    }

    /// The broker's first message: names, sizes of the areas, the rights of the link.
    #[must_use]
    pub(crate) fn welcome(&self) -> &Welcome {
        &self.0.welcome
    }

    /// The maximum right of users of this link.
    #[must_use]
    pub(crate) fn ceiling(&self) -> Right {
        self.0.ceiling
    }

    /// The audit log of this link.
    #[must_use]
    pub(crate) fn audit(&self) -> &Audit {
        &self.0.audit
    }

    /// Logs that somebody was not allowed to do this; also for actions that a protocol refuses before they become a
    /// write.
    pub(crate) fn refused(&self, who: &Who, what: &str) {
        self.0.audit.refused(&who.user, &who.address, what, "not allowed");
    }

    /// Reads these pieces, all of one scan each time, every `period` and as long as the [`Watch`] lives.
    #[must_use]
    pub(crate) fn watch(&self, pieces: Vec<Piece>, period: Duration) -> Watch {
        let (to, newest) = watch::channel(None);
        let _ = self.0.orders.send(Order::Watch { pieces, period: period.max(SHORTEST), to });
        Watch(newest)
    }

    /// Reads these pieces once, all of one scan.
    ///
    /// # Errors
    /// [`Trouble`]. A piece that the CPU does not have is refused alone, in the [`Reading`].
    pub(crate) async fn read(&self, pieces: Vec<Piece>) -> Result<Reading, Trouble> {
        let _place = self.0.reads.acquire().await.map_err(|_| Trouble::Gone)?;
        let (to, outcome) = oneshot::channel();
        self.0.orders.send(Order::Read { pieces, to }).map_err(|_| Trouble::Gone)?;
        outcome.await.map_err(|_| Trouble::Gone)?
    }

    /// The events with a higher number than `after` that are still kept, and those to come. A slow listener learns from
    /// the receiver how many are lost.
    #[must_use]
    pub(crate) fn events(&self, after: u64) -> (Vec<Arc<Event>>, broadcast::Receiver<Arc<Event>>) {
        self.0.events.after(after)
    }

    /// The program and the names of its cells.
    ///
    /// # Errors
    /// [`Trouble`].
    pub(crate) async fn catalog(&self) -> Result<Arc<Catalog>, Trouble> {
        let fetch = || async {
            let text = self.ask(DOCUMENTS, Ask::Document(Document::Program)).await.and_then(document)?;
            // A large program takes a while to read.
            let read = tokio::task::spawn_blocking(move || Catalog::read(&text)).await;
            read.map_err(|error| Trouble::Program(error.to_string()))?.map(Arc::new)
        };
        self.0.catalog.get_or_try_init(fetch).await.cloned()
    }

    /// A document of the station, not older than `age`. Concurrent requests get the same one.
    ///
    /// # Errors
    /// [`Trouble`].
    pub(crate) async fn document(&self, which: Document, age: Duration) -> Result<Arc<[u8]>, Trouble> {
        let mut documents = self.0.documents.lock().await;
        if let Some((made, document)) = documents.get(&which)
            && made.elapsed() < age
        {
            return Ok(Arc::clone(document));
        }
        let made: Arc<[u8]> = self.ask(DOCUMENTS, Ask::Document(which)).await.and_then(document)?.into();
        documents.insert(which, (Instant::now(), Arc::clone(&made)));
        Ok(made)
    }

    /// A client of this link: it may write and operate as far as the user's right and that of the link allow.
    #[must_use]
    pub(crate) fn client(&self, who: Who) -> Client {
        // After four thousand million connections the first numbers are free again; 0 is the link's.
        let number = loop {
            match self.0.clients.fetch_add(1, Ordering::Relaxed) {
                DOCUMENTS => {}
                number => break number,
            }
        };
        Client(Arc::new(Inner { station: self.clone(), who, number, turns: Semaphore::new(OUTSTANDING) }))
    }

    /// The alarms that are active or not acknowledged.
    ///
    /// # Errors
    /// [`Trouble`].
    pub(crate) async fn alarms(&self) -> Result<Vec<StandingAlarm>, Trouble> {
        // They do not change while the station runs.
        let texts = self.0.alarm_texts.get_or_try_init(async || {
            let document = self.ask(DOCUMENTS, Ask::Document(Document::AlarmTexts)).await.and_then(document)?;
            AlarmTexts::read(&document).ok_or_else(|| Trouble::Program("texts of alarms".into()))
        });
        let texts = texts.await?;
        match self.ask(DOCUMENTS, Ask::Alarms(AlarmOrder::Query(AlarmQuery::Standing))).await? {
            Answer::Alarms { list, .. } => Ok(standing(&list, texts)),
            _ => Err(Trouble::Program("the broker sends another answer".into())),
        }
    }

    async fn ask(&self, client: u32, ask: Ask) -> Result<Answer, Trouble> {
        let (to, answer) = oneshot::channel();
        self.0.orders.send(Order::Ask { client, ask, to }).map_err(|_| Trouble::Gone)?;
        answer.await.map_err(|_| Trouble::Gone)?
    }
}

fn document(answer: Answer) -> Result<Box<[u8]>, Trouble> {
    match answer {
        Answer::Document { bytes, .. } => Ok(bytes),
        _ => Err(Trouble::Program("the broker sends another answer".into())),
    }
}

/// Reads pieces repeatedly; only the newest reading is kept, so a slow task queues nothing.
#[derive(Debug)]
pub(crate) struct Watch(watch::Receiver<Newest>);

impl Watch {
    /// The next reading; an unread one is replaced by a newer one.
    ///
    /// # Errors
    /// [`Trouble::TooMuch`]: it is tried again; [`Trouble::Gone`]: nothing more will come.
    pub(crate) async fn next(&mut self) -> Result<Arc<Reading>, Trouble> {
        loop {
            self.0.changed().await.map_err(|_| Trouble::Gone)?;
            if let Some(newest) = self.0.borrow_and_update().clone() {
                return newest;
            }
        }
    }
}

/// A client of a link: everything it changes is checked and logged. When the last clone is dropped, the broker is told
/// that it is gone.
#[derive(Clone, Debug)]
pub(crate) struct Client(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    station: Station,
    who: Who,
    number: u32,
    turns: Semaphore,
}

impl Client {
    /// Who it is.
    #[must_use]
    pub(crate) fn who(&self) -> &Who {
        &self.0.who
    }

    /// Its right: that of the user, limited by that of the link.
    #[must_use]
    pub(crate) fn right(&self) -> Right {
        self.0.who.right.min(self.0.station.ceiling())
    }

    /// Writes a group: all of it is written at one cycle control point, or nothing. `what` is for the audit log: `MW10
    /// = 5`. Returns the scan that contains it; a later read sees it.
    ///
    /// # Errors
    /// [`Trouble`].
    pub(crate) async fn write(&self, what: &str, puts: Vec<Put>) -> Result<u64, Trouble> {
        let (to, outcome) = oneshot::channel();
        let order = Order::Write { client: self.0.number, puts, to };
        let done = |scan: &u64| format!("done, scan {scan}");
        self.audited(format!("write {what}"), Right::Write, order, outcome, done).await
    }

    /// Asks a question; one that changes something is checked and logged like a write.
    ///
    /// # Errors
    /// [`Trouble`].
    pub(crate) async fn ask(&self, ask: Ask) -> Result<Answer, Trouble> {
        let mut needs = Right::Operate;
        let what = match &ask {
            Ask::Command(command) => format!("command {}", command.name()),
            Ask::Alarms(order @ (AlarmOrder::Acknowledge(_) | AlarmOrder::Lock { .. })) => {
                needs = Right::Write;
                order.words().unwrap_or_default()
            }
            // Two digits in each byte.
            Ask::SetClock([y, m, d, hours, minutes, seconds, ..]) => {
                format!("set clock {y:02X}-{m:02X}-{d:02X} {hours:02X}:{minutes:02X}:{seconds:02X}")
            }
            // The gate has users of its own; they cannot be bypassed.
            Ask::Login(_) | Ask::Logout => return Err(Trouble::User),
            _ => {
                let _turn = self.0.turns.acquire().await.map_err(|_| Trouble::Gone)?;
                return self.0.station.ask(self.0.number, ask).await;
            }
        };
        let (to, answer) = oneshot::channel();
        let order = Order::Ask { client: self.0.number, ask, to };
        self.audited(what, needs, order, answer, |_: &Answer| "done".to_owned()).await
    }

    /// Does something that needs a right, and logs it, whatever its outcome and even if the caller goes away.
    async fn audited<T: Send + 'static>(
        &self,
        what: String,
        needs: Right,
        order: Order,
        outcome: oneshot::Receiver<Result<T, Trouble>>,
        done: impl FnOnce(&T) -> String + Send + 'static,
    ) -> Result<T, Trouble> {
        let client = self.clone();
        let work = async move {
            let inner = &*client.0;
            let audit = inner.station.audit();
            let note = |outcome: &str| audit.note(&inner.who.user, &inner.who.address, &what, outcome);
            if client.right() < needs {
                inner.station.refused(&inner.who, &what);
                return Err(Trouble::User);
            }
            audit.ready().map_err(|error| Trouble::Audit(error.to_string()))?;
            let _turn = inner.turns.acquire().await.map_err(|_| Trouble::Gone)?;
            inner.station.0.orders.send(order).map_err(|_| Trouble::Gone)?;
            let outcome = outcome.await.map_err(|_| Trouble::Gone)?;
            let told = match &outcome {
                Ok(value) => done(value),
                Err(trouble) => {
                    audit.refused(&inner.who.user, &inner.who.address, &what, &trouble.to_string());
                    return outcome;
                }
            };
            // The action is done; a line that cannot be written now is kept, and no further action is carried out
            // before it has been written.
            let _ = note(&told);
            outcome
        };
        // A separate task: if the caller goes away in between, the line is still written.
        tokio::spawn(work).await.map_err(|_| Trouble::Gone)?
    }
}

impl Drop for Inner {
    fn drop(&mut self) {
        let _ = self.station.0.orders.send(Order::Gone(self.number));
    }
}

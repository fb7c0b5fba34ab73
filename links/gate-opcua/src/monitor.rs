//! What clients watch: one watch of the station for all of them, and each change told once.
//!
//! The plant is not copied: of each watched value the bytes of its last sample are kept, nothing else. All values of a
//! sample are of one scan.

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use ob1_access::door::{Cover, Reading, Refusal, State};
use ob1_access::{Piece, Typed};
use ob1_gate_core::{Station, Trouble, Watch};
use opcua_server::{MonitoredItemHandle, SubscriptionCache};
use opcua_types::{AttributeId, DataValue, MonitoringMode, NodeId, StatusCode, Variant};
use parking_lot::Mutex;
use tokio::sync::{Notify, watch};
use tokio::task::AbortHandle;

use crate::events;
use crate::limits;
use crate::manager::node_id;
use crate::sample::{bad, sample, status};
use crate::space::{FACTS, Fact};

/// What is watched when nobody watches a value: one byte, for the state and the number of the scan.
const HEARTBEAT: Duration = Duration::from_millis(250);

/// See [the module](self).
pub(crate) struct Monitor {
    watched: Mutex<HashMap<String, Watched>>,
    /// Monitored items of values.
    items: AtomicUsize,
    most: usize,
    /// A byte the link may read, for the state of the CPU.
    heartbeat: Option<Piece>,
    /// Items that have been deleted since the server began.
    deleted: AtomicUsize,
    changed: Notify,
    stale: AtomicBool,
    scan: AtomicU64,
    state: AtomicU64,
    tasks: Mutex<Vec<AbortHandle>>,
    ended: watch::Sender<bool>,
}

struct Watched {
    node: NodeId,
    /// `None`: a fact about the CPU.
    typed: Option<Typed>,
    piece: Option<Piece>,
    handles: HashMap<MonitoredItemHandle, Rate>,
    next: Instant,
    last: Option<Result<Vec<u8>, Refusal>>,
    /// Where its bytes lie in the merged pieces.
    place: Option<(usize, u32)>,
}

#[derive(Clone, Copy)]
struct Rate {
    every: Duration,
    on: bool,
}

impl Watched {
    /// The shortest interval anybody wants; `None` while nobody does.
    fn every(&self) -> Option<Duration> {
        self.handles.values().filter(|rate| rate.on).map(|rate| rate.every).min()
    }
}

fn interval(ms: f64) -> Duration {
    // Negative: as often as is published; the server then samples as often as it may.
    Duration::from_secs_f64(if ms.is_finite() {
        ms.clamp(limits::SAMPLING_MS, limits::SLOWEST_MS) / 1000.0
    } else {
        1.0
    })
}

impl Monitor {
    pub(crate) fn new(most: usize, heartbeat: Option<Piece>) -> Self {
        Self {
            watched: Mutex::default(),
            items: AtomicUsize::new(0),
            most,
            heartbeat,
            deleted: AtomicUsize::new(0),
            changed: Notify::new(),
            stale: AtomicBool::new(true),
            scan: AtomicU64::new(0),
            state: AtomicU64::new(0),
            tasks: Mutex::default(),
            ended: watch::Sender::new(false),
        }
    }

    /// Samples, and tells events, until it is stopped or the station is gone.
    pub(crate) fn start(self: &Arc<Self>, station: &Station, subscriptions: &Arc<SubscriptionCache>) {
        let this = Arc::clone(self);
        let (own, cache) = (station.clone(), Arc::clone(subscriptions));
        let sampling = tokio::spawn(async move {
            this.run(own, cache).await;
            this.ended.send_replace(true);
        });
        let telling = tokio::spawn(events::run(station.clone(), Arc::clone(subscriptions)));
        self.tasks.lock().extend([sampling.abort_handle(), telling.abort_handle()]);
    }

    /// Ends what [`Monitor::start`] began.
    pub(crate) fn stop(&self) {
        self.tasks.lock().drain(..).for_each(|task| task.abort());
    }

    /// Waits until the station is gone.
    pub(crate) async fn gone(&self) {
        // The sender is this monitor's own: there is always one.
        let _ = self.ended.subscribe().wait_for(|ended| *ended).await;
    }

    /// A byte the link may read; whoever reads it learns the state of the CPU.
    pub(crate) const fn heartbeat(&self) -> Option<Piece> {
        self.heartbeat
    }

    /// STOP, STARTUP or RUN.
    pub(crate) fn state(&self) -> &'static str {
        ["STOP", "STARTUP", "RUN"][self.state.load(Ordering::Relaxed) as usize % 3]
    }

    /// The number of the newest scan that was seen.
    pub(crate) fn scan(&self) -> u64 {
        self.scan.load(Ordering::Relaxed)
    }

    /// Items deleted since the server began: each leaves a little behind in the server.
    pub(crate) fn deleted(&self) -> usize {
        self.deleted.load(Ordering::Relaxed)
    }

    /// What a reading tells besides its values; one without a value tells nothing.
    pub(crate) fn seen(&self, reading: &Reading) {
        if !(0..reading.len()).any(|index| reading.piece(index).is_ok()) {
            return;
        }
        let state = match reading.state {
            State::Stop => 0,
            State::Startup => 1,
            State::Run => 2,
        };
        self.scan.store(reading.scan, Ordering::Relaxed);
        self.state.store(state, Ordering::Relaxed);
    }

    /// Watches a value for an item.
    pub(crate) fn add(
        &self,
        id: &str,
        typed: &Typed,
        handle: MonitoredItemHandle,
        mode: MonitoringMode,
        every: f64,
    ) -> StatusCode {
        let Some(piece) = typed.piece() else { return StatusCode::BadNotReadable };
        self.insert(id, Some(typed), Some(piece), handle, mode, every)
    }

    /// Watches a fact about the CPU for an item.
    pub(crate) fn add_fact(
        &self,
        id: &str,
        handle: MonitoredItemHandle,
        mode: MonitoringMode,
        every: f64,
    ) -> StatusCode {
        self.insert(id, None, None, handle, mode, every)
    }

    fn insert(
        &self,
        id: &str,
        typed: Option<&Typed>,
        piece: Option<Piece>,
        handle: MonitoredItemHandle,
        mode: MonitoringMode,
        every: f64,
    ) -> StatusCode {
        let mut watched = self.watched.lock();
        if self.items.load(Ordering::Relaxed) >= self.most {
            return StatusCode::BadTooManyMonitoredItems;
        }
        let entry = watched.entry(id.to_owned()).or_insert_with(|| Watched {
            node: node_id(id),
            typed: typed.cloned(),
            piece,
            handles: HashMap::new(),
            next: Instant::now(),
            last: None,
            place: None,
        });
        let rate = Rate { every: interval(every), on: mode != MonitoringMode::Disabled };
        if entry.handles.insert(handle, rate).is_none() {
            self.items.fetch_add(1, Ordering::Relaxed);
        }
        // The new item has its own first value; all the others that watch it get the same again, which is no change.
        entry.last = None;
        self.touch();
        StatusCode::Good
    }

    /// Whether all that is watched fits what a link may watch.
    pub(crate) fn fits(&self) -> bool {
        let watched = self.watched.lock();
        Cover::merging(watched.values().filter_map(|entry| entry.piece.as_ref()).chain(&self.heartbeat)).fits()
    }

    pub(crate) fn interval(&self, id: &str, handle: MonitoredItemHandle, every: f64) {
        self.with(id, handle, |rate| rate.every = interval(every));
    }

    pub(crate) fn mode(&self, id: &str, handle: MonitoredItemHandle, mode: MonitoringMode) {
        self.with(id, handle, |rate| rate.on = mode != MonitoringMode::Disabled);
    }

    fn with(&self, id: &str, handle: MonitoredItemHandle, change: impl FnOnce(&mut Rate)) {
        let mut watched = self.watched.lock();
        if let Some(entry) = watched.get_mut(id)
            && let Some(rate) = entry.handles.get_mut(&handle)
        {
            change(rate);
            (entry.last, entry.next) = (None, Instant::now());
            self.touch();
        }
    }

    pub(crate) fn remove(&self, id: &str, handle: MonitoredItemHandle) {
        let mut watched = self.watched.lock();
        self.deleted.fetch_add(1, Ordering::Relaxed);
        let Some(entry) = watched.get_mut(id) else { return };
        if entry.handles.remove(&handle).is_some() {
            self.items.fetch_sub(1, Ordering::Relaxed);
        }
        if entry.handles.is_empty() {
            watched.remove(id);
        }
        self.touch();
    }

    fn touch(&self) {
        self.stale.store(true, Ordering::Relaxed);
        self.changed.notify_one();
    }

    /// Samples for as long as the server lives.
    async fn run(&self, station: Station, subscriptions: Arc<SubscriptionCache>) {
        let mut watch = self.watch(&station);
        loop {
            tokio::select! {
                newest = watch.next() => match newest {
                    Ok(reading) => self.tell(&reading, &subscriptions),
                    Err(Trouble::Gone) => {
                        self.tell_all(&bad(StatusCode::BadNoCommunication), &subscriptions);
                        return;
                    }
                    Err(trouble) => {
                        self.tell_all(&bad(status(&trouble)), &subscriptions);
                    }
                },
                () = self.changed.notified() => {
                    // Items come a thousand at a time: what comes within this time is one new watch.
                    tokio::time::sleep(limits::SETTLE).await;
                    if self.stale.load(Ordering::Relaxed) {
                        watch = self.watch(&station);
                    }
                }
            }
        }
    }

    /// A watch of all that is watched, as often as the fastest item wants.
    fn watch(&self, station: &Station) -> Watch {
        self.stale.store(false, Ordering::Relaxed);
        let mut watched = self.watched.lock();
        let pieces = watched.values().filter_map(|entry| entry.piece.as_ref());
        let cover = Cover::merging(pieces.chain(&self.heartbeat));
        let mut every = HEARTBEAT;
        for entry in watched.values_mut() {
            entry.place = entry.piece.as_ref().and_then(|piece| cover.find(piece));
            every = entry.every().map_or(every, |own| own.min(every));
        }
        station.watch(cover.pieces().to_vec(), every)
    }

    /// Tells the items whose turn it is what has changed.
    fn tell(&self, reading: &Reading, subscriptions: &SubscriptionCache) {
        self.seen(reading);
        let now = Instant::now();
        let mut changes = Vec::new();
        {
            let mut watched = self.watched.lock();
            for (id, entry) in watched.iter_mut() {
                // A quarter of a period early is in time: readings come by a clock of their own.
                let Some(every) = entry.every().filter(|every| entry.next <= now + *every / 4) else { continue };
                entry.next = (entry.next + every).max(now);
                let Some((typed, piece)) = entry.typed.as_ref().zip(entry.piece.as_ref()) else {
                    let fact = FACTS.iter().find(|(name, _)| name == id).map(|(_, fact)| *fact);
                    let (bytes, value) = match fact {
                        Some(Fact::State) => (self.state().as_bytes().to_vec(), Variant::from(self.state())),
                        Some(Fact::Scan) => (self.scan().to_be_bytes().to_vec(), Variant::UInt64(self.scan())),
                        None => continue,
                    };
                    if entry.last.as_ref() != Some(&Ok(bytes.clone())) {
                        entry.last = Some(Ok(bytes));
                        changes.push((entry.node.clone(), DataValue::new_now(value)));
                    }
                    continue;
                };
                // Not in this watch yet: in the next.
                let Some((index, skip)) = entry.place else { continue };
                let bytes = reading.piece(index).map(|bytes| {
                    let from = skip as usize;
                    bytes.get(from..from + piece.len() as usize).unwrap_or_default()
                });
                let same = match (&entry.last, &bytes) {
                    (Some(Ok(last)), Ok(bytes)) => last == bytes,
                    (Some(Err(last)), Err(now)) => last == now,
                    _ => false,
                };
                if same {
                    continue;
                }
                entry.last = Some(bytes.map(<[u8]>::to_vec));
                changes.push((entry.node.clone(), sample(typed, bytes)));
            }
        }
        notify(&changes, subscriptions);
    }

    /// Tells all items the same.
    fn tell_all(&self, value: &DataValue, subscriptions: &SubscriptionCache) {
        let mut watched = self.watched.lock();
        let changes: Vec<(NodeId, DataValue)> = watched
            .values_mut()
            .map(|entry| {
                entry.last = None;
                (entry.node.clone(), value.clone())
            })
            .collect();
        drop(watched);
        notify(&changes, subscriptions);
    }
}

/// Tells changes to the items of each node; the server gives an item of a part of an array that part.
fn notify(changes: &[(NodeId, DataValue)], subscriptions: &SubscriptionCache) {
    let mut notifier = subscriptions.data_notifier();
    for (node, value) in changes {
        if let Some(mut batch) = notifier.notify_for(node, AttributeId::Value) {
            batch.data_value(value.clone());
        }
    }
}
